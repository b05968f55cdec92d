"""Predictors that users bring along: files that another program has written, or a function of their own.

    a folder      a file for each test trajectory, named as it is; `rollout` and `datagen.predicted` write such files. Its time is
                  what is given, else the "seconds_per_step" that all files carry, else not known.
    a function    called with the `datagen.files.inputs.Inputs` of a scene, gives displacements (T, N, 3) [m] of its body, N nodes,
                  from the rest state on. Its processor time is taken as that of every other predictor; what is done once, such as
                  loading weights, belongs where its module is imported.
"""

from __future__ import annotations

import importlib
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from datagen.files.inputs import Inputs, inputs_of
from datagen.files.layout import displacements
from datagen.files.prediction import find_prediction, mistaken, read_prediction
from learning.prediction.predictor import Case, LeftOut, Prediction, Predictor
from physics.schema import InputError

Function = Callable[[Inputs], Any]
Own = Function | Sequence[str]


def brought(words: Sequence[str]) -> tuple[str, Path, float | None]:
    """Name, folder and seconds a step of FOLDER [NAME [MS]]. Raises `InputError`."""
    if len(words) > 3:
        raise InputError(f"--prediction {' '.join(words)}: takes a folder, a name and a time per step in milliseconds")
    folder, name, ms = [*words, "", ""][:3]
    try:
        seconds = 1e-3 * float(ms) if ms else None
    except ValueError:
        seconds = -1.0
    if seconds is not None and not 0 < seconds < 1e6:
        raise InputError(f"--prediction {' '.join(words)}: {ms!r} is not a number of milliseconds above 0")
    if not Path(folder).exists():
        raise InputError(f"--prediction {folder}: no such folder")
    return name or Path(folder).resolve().stem, Path(folder), seconds


def from_folder(words: Sequence[str], cases: Sequence[Case]) -> tuple[Predictor, str]:
    """What a folder predicts of some cases, all of it read and checked, and where its time comes from, in words.

    Raises:
        InputError: a file is missing, or is no prediction of its case
    """
    name, folder, seconds = brought(words)
    said, known = "given, not measured here", {}
    for case in cases:
        file = find_prediction(folder, Path(case.file or f"{case.name}.vtkhdf"))
        path, made = read_prediction(file, case.trajectory, case.name)
        took = seconds if seconds is not None else made.extra.get("seconds_per_step")
        if seconds is None:
            said = "as its files tell, not measured here" if isinstance(took, int | float) else "not known"
        known[case.name] = Prediction(path=path, seconds=case.steps * float(took) if isinstance(took, int | float) else np.nan,
                                      fields=made.fields)
    return Predictor(name, "foreign", lambda case: known[case.name]), f"read from {folder}; time {said}"


def from_function(given: Own) -> tuple[Predictor, str]:
    """The function of a user's module as a predictor, and where it stands. Raises `InputError` when there is none.

    given: the function itself, or module:function and on request a name; the module is imported from the working directory or
        wherever Python finds it
    """
    if callable(given):
        return of_function(given.__name__, given), "a function, timed as every other predictor"
    if len(given) > 2:
        raise InputError(f"--predictor {' '.join(given)}: takes module:function and a name")
    words, called = [*given, ""][:2]
    module, colon, name = words.partition(":")
    if not (module and colon and name):
        raise InputError(f"--predictor {words}: must be module:function")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        function = getattr(importlib.import_module(module), name)
    except AttributeError:
        raise InputError(f"--predictor {words}: the module has no {name}") from None
    except (Exception, SystemExit) as error:  # whatever a stranger's module raises
        raise InputError(f"--predictor {words}: cannot be imported: {_told(error)}") from None
    if not callable(function):
        raise InputError(f"--predictor {words}: {name} is not a function")
    return of_function(called or name, function), f"the function {words}, timed as every other predictor"


def of_function(name: str, function: Function) -> Predictor:
    """A function of `Inputs` as a predictor. Where it raises or gives another shape, `RuntimeError` or `InputError` says so."""
    def predict(case: Case) -> Prediction:
        inputs = inputs_of(case.trajectory)
        start = time.process_time()
        try:
            answer = function(inputs)
        except (Exception, SystemExit) as error:  # whatever a stranger's function raises
            raise RuntimeError(f"{name} on {case.name}: {_told(error)}") from None
        seconds = time.process_time() - start
        try:
            given = displacements(answer, case.steps + 1, len(case.mesh.points), "nodes of the body")
        except InputError as error:
            raise InputError(f"{name} on {case.name}: {error}") from None
        if not np.isfinite(given).all():
            raise LeftOut("what it gives is not finite")
        if doubt := mistaken(given, case.truth, case.mesh.points):
            raise InputError(f"{name} on {case.name}: {doubt}")
        return Prediction(path=given.astype(np.float64), seconds=seconds)

    return Predictor(name, "foreign", predict)


def _told(error: BaseException) -> str:
    """An exception and the line that raised it, in one line."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    what = (str(error).splitlines() or [""])[0]
    return f"{type(error).__name__}: {what} ({Path(last.filename).name}, line {last.lineno})"
