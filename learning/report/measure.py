"""Predictors measured on test cases: every prediction through the same verdict, the truth's own error beside it.

Times are processor times of this process, which other work on the machine disturbs little, one predictor after the other on each
case; with repeats, medians. A prediction that takes longer than LONG is timed once: what disturbs it is small against it.

On some cases there is a second truth, the same scene on cells of half the size (datagen.sets.statistics.finer). Errors to it tell
how far a prediction is from the body rather than from the data, and the reference's own is the error of the data.

Legend: T frames, N nodes of the body, F frames of a finer solution.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.prediction import field_errors
from datagen.sets.statistics import finer
from learning.prediction.predictor import Case, LeftOut, Prediction, Predictor
from learning.report.table import JUDGED, Row
from physics.fem import release
from physics.fidelity.figures import gathered
from physics.fidelity.verify import Reference, as_table
from physics.mesh.quality import rmsd

LONG = 1.0  # [s]


@dataclass(frozen=True)
class WorstFrame:
    """The frame of a rollout that is farthest from the truth."""

    case: Case
    predictor: str
    step: int
    displacement: NDArray[Any]  # (N, 3)
    error: float  # [m] of the whole rollout, free nodes


@dataclass(frozen=True)
class Hardest:
    """The trajectory that a learned predictor, or without one any, does worst on: paths (T, N, 3) float32 of all that predict it."""

    case: Case
    paths: dict[str, NDArray[np.float32]]
    error: float  # [m]; infinite where a path is not finite


@dataclass
class Measurement:
    """Everything found: a row for each predictor that did all cases, worst frames of those that are judged, what went wrong."""

    rows: list[Row] = field(default_factory=list)
    frames: list[WorstFrame] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    hardest: Hardest | None = None
    solved_again: float = 0.0  # [m] largest difference of the reference to the files


def measure(predictors: Sequence[Predictor], cases: Sequence[Case], *, sample: int, refined: Collection[int] = (),
            repeats: int = 1, on_done: Callable[[], None] = lambda: None) -> Measurement:
    """Run all predictors on all cases.

    Args:
        sample: frames of each trajectory at which the equations and the deformed mesh are checked
        refined: numbers of the cases that are solved on finer cells as well
        repeats: how often each prediction is timed
        on_done: called after each prediction of a case
    """
    found = Measurement()
    each: dict[str, list[dict[str, float]]] = {predictor.name: [] for predictor in predictors}
    for number, case in enumerate(cases):
        second = _second_truth(case, found.notes) if number in refined else None
        reference = Reference(case.trajectory.exact[:, case.trajectory.body], case.known, case.mesh, case.free, sample, shapes=sample)
        paths: dict[str, NDArray[np.float32]] = {}
        errors: list[float] = []
        for predictor in predictors:
            try:
                prediction = _repeated(predictor, case, repeats)
            except LeftOut as reason:
                found.notes.append(f"{predictor.name} is left out, because in {case.name} {reason}.")
                prediction = None
            on_done()
            if prediction is None:
                continue
            path = prediction.path
            if predictor.kind == "reference":  # what counts is the file, which was solved again for its time
                found.solved_again = max(found.solved_again, float(abs(path - case.truth).max()))
                path = reference.displacement
            fidelity = reference.verify(path, prediction.one_step)
            each[predictor.name].append(_scores(fidelity, prediction, case) | field_errors(prediction.fields, case.trajectory)
                                        | _doubt(prediction, case) | _against(second, path, case))
            with np.errstate(over="ignore"):
                paths[predictor.name] = path.astype(np.float32)
            errors.append(fidelity.rmsd_all)
            if predictor.kind in JUDGED:
                found.frames.append(WorstFrame(case, predictor.name, fidelity.worst_step, path[fidelity.worst_step], fidelity.rmsd_all))
        learned = [frame.error for frame in found.frames if frame.case is case]
        error = max((each if np.isfinite(each) else np.inf for each in learned or errors), default=0.0)
        if paths and (found.hardest is None or error > found.hardest.error):
            found.hardest = Hardest(case, paths, error)
        release()
    found.rows = [_row(predictor, each[predictor.name]) for predictor in predictors if len(each[predictor.name]) == len(cases)]
    return found


def _repeated(predictor: Predictor, case: Case, repeats: int) -> Prediction:
    """The first prediction with the median times of all."""
    predictions = [_timed(predictor, case)]
    while len(predictions) < repeats and predictions[0].seconds < LONG:
        predictions.append(_timed(predictor, case))
    return replace(predictions[0], seconds=float(np.median([p.seconds for p in predictions])),
                   set_up=float(np.median([p.set_up for p in predictions])), wall=float(np.median([p.wall for p in predictions])))


def _timed(predictor: Predictor, case: Case) -> Prediction:
    """A prediction with its time by the clock on the wall: the processor's, at the ratio of both clocks over the whole call."""
    start, began = time.process_time(), time.perf_counter()
    found = predictor.predict(case)
    spent, wall = time.process_time() - start, time.perf_counter() - began
    return replace(found, wall=wall / spent * (found.seconds + found.set_up) if spent > 0 and predictor.kind != "foreign" else np.nan)


def _second_truth(case: Case, notes: list[str]) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Frames (F,) and displacements (F, N, 3) of the case solved on finer cells; None when that fails."""
    if case.known is None:
        return None
    try:
        every, displacement, _ = finer(case.scene, case.mesh)
    except RuntimeError as error:
        notes.append(f"{case.name} has no finer solution: {error}.")
        return None
    return np.arange(0, case.steps + 1, every), displacement


def _against(second: tuple[NDArray[np.int64], NDArray[np.float64]] | None, path: NDArray[Any], case: Case) -> dict[str, float]:
    """The error to the finer solution, and the share of its frames in which the error to the data is below the data's own."""
    if second is None:
        return {"rmsd_refined": np.nan, "below_data": np.nan}
    frames, fine = second
    own, error = _by_frame(case.truth[frames], fine, case), _by_frame(path[frames], case.truth[frames], case)
    return {"rmsd_refined": rmsd(path[frames[1:]], fine[1:], case.free), "below_data": float(np.mean(error[1:] < own[1:]))}


def _by_frame(a: NDArray[Any], b: NDArray[Any], case: Case) -> NDArray[np.float64]:
    """(F,) root mean square distance over the free nodes."""
    return np.sqrt(np.mean(np.sum((a - b)[:, case.free].astype(np.float64) ** 2, axis=2), axis=1))


def _doubt(prediction: Prediction, case: Case) -> dict[str, float]:
    """What a predictor says of its own error, held against that."""
    if prediction.bar is None or prediction.unsure is None:
        return {"error_bar": np.nan, "covered": np.nan, "unsure": np.nan}
    told, error = prediction.bar > 0, _by_frame(prediction.path, case.truth, case)
    if not told.any():
        return {"error_bar": np.nan, "covered": np.nan, "unsure": float(prediction.unsure[1:].mean())}
    return {"error_bar": float(prediction.bar[told].mean()), "covered": float((error <= prediction.bar)[told].mean()),
            "unsure": float(prediction.unsure[1:].mean())}


def _scores(fidelity: Any, prediction: Prediction, case: Case) -> dict[str, float]:
    table = {key: float(value) for key, value in as_table(fidelity).items() if key != "worst_step"}
    if prediction.one_step is None:  # starts no step from a given state
        table |= {key: np.nan for key in table if key.startswith(("rmsd_1", "rmse_1"))}
    whole = prediction.seconds + prediction.set_up
    motion = rmsd(case.truth[1:], np.zeros_like(case.truth[1:]), case.free)
    return {"seconds": whole, "set_up_seconds": prediction.set_up, "ms_per_step": 1e3 * whole / case.steps,
            "ms_per_step_alone": 1e3 * prediction.seconds / case.steps, "wall_ms_per_step": 1e3 * prediction.wall / case.steps,
            "of_motion": table["rmsd_all"] / motion if motion else np.nan,
            "iterations": np.nan if prediction.iterations is None else prediction.iterations / case.steps, **table}


def _row(predictor: Predictor, each: list[dict[str, float]]) -> Row:
    return Row(predictor.name, predictor.kind, gathered(each), tuple(each))
