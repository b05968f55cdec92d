"""Everything that predicts a flow, on the same flows, one core each: speed against error, and what the equations say of each.

Times are processor times of this process, over the steps from the frame that is shown on. Predictors that are shown the first half have
no error there, so all are compared in the second half too. Legend: T frames, S nodes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.prediction import find_prediction
from datagen.flow.prediction import FlowTruth, fields_of, read_flow_prediction, read_flow_truth
from learning.devices import one_core
from learning.flows.divergence import without_divergence
from learning.flows.report import ERRORS, FlowReport, write_flow_report
from learning.flows.rivals import REFERENCE, FlowPath, FlowPredictor, elements, trivial
from learning.prediction.checkpoint import Model, load_model
from learning.prediction.foreign import brought
from learning.prediction.predictor import LeftOut
from learning.prediction.rollout import predict_step, rollout
from learning.prediction.surrogates import seconds_of
from learning.report.compare import check_kinds
from learning.report.cost import called
from learning.report.table import Row
from physics.fidelity.figures import gathered
from physics.schema import InputError

Floats = NDArray[np.float64]
SAMPLE = 40  # frames whose equations are looked at
LONG = 1.0  # [s]: what takes longer is timed once


@dataclass
class Comparison:
    """What was measured: rows, what is left out and why, and of each learned predictor its worst flow: number, error [m/s], velocity."""

    rows: list[Row] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    worst: dict[str, tuple[int, float, NDArray[np.float64]]] = field(default_factory=dict)


def compare_flows(files: Sequence[Path], runs: Sequence[str | Path], out: str | Path, *, repeats: int = 1,
                  predictions: Sequence[Sequence[str]] = (), only: Sequence[str] = (), device: str = "cpu",
                  say: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Measure every predictor on some flows and write the report folder.

    Args:
        files: trajectories of flows
        runs: folders of trainings
        repeats: of each timing that is short
        predictions: of other programs, each a folder, on request a name and milliseconds a step
        only: kinds of predictors (report.table.KINDS) that are measured; all by default, the reference always

    Returns:
        the content of report.json and "report", the folder

    Raises:
        InputError: a file that is no flow, no whole checkpoint, a prediction that is missing
    """
    check_kinds(only)
    models: dict[str, Model] = {}
    for run in runs:
        model = load_model(run, device)
        if not isinstance(model, Model) or not model.normaliser.layout.flow:
            raise InputError(f"{run}: has not learned flows")
        models[str(run)] = model
    names = called(models)
    truths = [read_flow_truth(file, sample=SAMPLE) for file in files]
    own = [_foreign(words, files, truths) for words in predictions]
    nets = [learned(model, names[run], solenoidal=freed) for freed in (False, True) for run, model in models.items()]
    every = [*own, *nets, *trivial(),
             elements("FE, cells 1.5 times as large", larger=1.5), elements("FE, cells twice as large", larger=2.0),
             elements("FE, cells three times as large", larger=3.0), elements("FE, velocity of order 2", order=2), elements(REFERENCE)]
    every = [predictor for predictor in every if not only or predictor.kind in (*only, "reference", "foreign")]
    if twice := [one.name for one in every if [each.name for each in every].count(one.name) > 1]:
        raise InputError(f"two predictors are called {twice[0]!r}: give each a name of its own")
    with one_core():
        found = _measured(every, truths, [file.stem for file in files], repeats)
    report = FlowReport(found.rows, [str(file) for file in files], found.notes, list(models))
    content = write_flow_report(Path(out), report, truths, found.worst)
    if say is not None:
        for line in summary(found.rows):
            say(line)
        for note in found.notes:
            say(note)
        say(f"report: {Path(out) / 'report.html'}")
    return {**content, "report": str(out)}


def learned(model: Model, name: str, *, solenoidal: bool = False) -> FlowPredictor:
    """A network's own rollout, and with it single steps from true states, whose time does not count; on request the divergence is taken
    out of each frame of the rollout (divergence.py), and there are no single steps."""

    def predict(truth: FlowTruth) -> FlowPath:
        start, began = time.process_time(), time.perf_counter()
        correct = None
        if solenoidal:
            freed = None if truth.scene is None or truth.scene.body.shape == "file" else without_divergence(
                truth.scene, truth.reference.predicted)
            if freed is None:
                raise LeftOut("the file does not hold the nodes of quadratic functions on cells that a scene builds")

            correct = partial(_in_plane, freed)
        try:
            made = rollout(model, truth.trajectory, correct=correct)
        except FloatingPointError as error:
            raise LeftOut(f"it blows up: {error}") from None
        seconds, set_up = seconds_of(made, start, began)
        velocity, pressure = fields_of(made)
        steps = None if solenoidal else predict_step(model, truth.trajectory)[truth.first:, :, :2].astype(np.float64)
        return FlowPath(velocity=velocity, pressure=pressure, one_step=steps, seconds=seconds, set_up=set_up, shown=truth.first)

    return FlowPredictor(f"{name}, divergence taken out", "hybrid", predict) if solenoidal else FlowPredictor(name, "learned", predict)


def _in_plane(freed: Callable[[Floats], Floats], velocity: Floats, frame: int) -> Floats:
    return np.pad(freed(velocity[:, :2]), ((0, 0), (0, 1)))


def scores_of(predictor: FlowPredictor, files: Sequence[Path]) -> dict[str, float]:
    """Means over some flows of one predictor's figures; empty when it leaves one of them out."""
    found = _measured([predictor], [read_flow_truth(file, sample=SAMPLE) for file in files], [file.stem for file in files], 1)
    return found.rows[0].scores if found.rows else {}


def _foreign(words: Sequence[str], files: Sequence[Path], truths: Sequence[FlowTruth]) -> FlowPredictor:
    """What the files of another program predict, read and checked."""
    name, folder, seconds = brought(words)
    known = {}
    for file, truth in zip(files, truths, strict=True):
        velocity, pressure = read_flow_prediction(find_prediction(folder, file), truth.trajectory, file)
        steps = len(velocity) - 1 - truth.first
        known[id(truth)] = FlowPath(velocity=velocity, pressure=pressure, seconds=np.nan if seconds is None else steps * seconds,
                                    shown=truth.first)
    return FlowPredictor(name, "foreign", lambda truth: known[id(truth)])


def _measured(every: Sequence[FlowPredictor], truths: Sequence[FlowTruth], names: Sequence[str], repeats: int) -> Comparison:
    found = Comparison()
    each: dict[str, list[dict[str, float]]] = {predictor.name: [] for predictor in every}
    for number, truth in enumerate(truths):
        for predictor in every:
            try:
                path = predictor.predict(truth)
                times = [(path.seconds, path.set_up)]
                while len(times) < repeats and sum(times[0]) < LONG and predictor.kind != "foreign":
                    again = predictor.predict(truth)
                    times.append((again.seconds, again.set_up))
            except LeftOut as reason:
                found.notes.append(f"{predictor.name} is left out, because in {names[number]} {reason}.")
                continue
            scores = _scores(truth, path, *(float(np.median(column)) for column in zip(*times, strict=True)))
            each[predictor.name].append(scores)
            error = scores["velocity_rmse_all"]
            if predictor.kind in ("learned", "foreign") and error > found.worst.get(predictor.name, (0, -1.0, None))[1]:
                found.worst[predictor.name] = number, error, path.velocity
    found.rows = [Row(one.name, one.kind, gathered(each[one.name]), tuple(each[one.name])) for one in every
                  if len(each[one.name]) == len(truths)]
    return found


def _scores(truth: FlowTruth, path: FlowPath, seconds: float, set_up: float) -> dict[str, float]:
    of, steps = truth.reference, len(truth.reference.velocity) - 1 - truth.first
    figures = {name: float(value) for name, value in vars(of.verify(path.velocity, path.pressure, path.one_step)).items()}
    late = len(of.velocity) // 2 + 1
    error = (path.velocity[late:] - of.velocity[late:])[:, of.predicted]
    if path.one_step is None:  # the first step of a rollout is another thing, and that of a solver from rest too
        figures["velocity_rmse_1"] = np.nan
    if path.shown > truth.first:
        figures |= dict.fromkeys(("velocity_rmse_50", "velocity_rmse_all", "pressure_rmse_50", "pressure_rmse_all"), np.nan)
    return figures | {"velocity_rmse_late": float(np.sqrt((error**2).mean())), "ms_per_step": 1e3 * (seconds + set_up) / steps,
                      "ms_per_step_alone": 1e3 * seconds / steps, "seconds": seconds + set_up, "shown": float(path.shown)}


def summary(rows: Sequence[Row]) -> list[str]:
    """The table's first columns for a terminal."""
    said = [f"{'':34s} {'ms/step':>9s} " + " ".join(f"{column.head:>10s}" for column in ERRORS.values()) + "  [m/s, nodes inside]"]
    for row in rows:
        values = " ".join(f"{row.scores[key]:10.4g}" for key in ERRORS)
        said.append(f"{row.name:34s} {row.ms_per_step:9.3g} {values}".replace("nan", "  –"))
    return said
