"""Rollouts of a trained run held against finite elements and beside their rivals, gathered in one report; where the trajectories have
no scene, as imported ones, against the data alone.

On each test trajectory: the network, the network corrected by Newton steps, trivial predictors, finite elements on coarser meshes, and the
solver that made the truth, for its time. Written by report.py, rivals in rivals.py, measured by measure.py. All rivals: compare.py.
"""

from __future__ import annotations

import datetime
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from datagen.files.prediction import read_reference
from datagen.files.provenance import commit, processor, versions
from learning.bodies.at_once import AtOnce
from learning.networks.stored import read_stored
from learning.prediction.checkpoint import Model, load_model
from learning.prediction.foreign import Own, from_folder, from_function
from learning.prediction.predictor import Case, Predictor
from learning.prediction.rivals import REFERENCE, coarser, elements, follow, trivial
from learning.prediction.surrogates import corrected, estimated, learned
from learning.report.cost import called, data_said, paid_back, payback_said
from learning.report.differences import differing, spread_said
from learning.report.measure import LONG, Measurement, measure
from learning.report.report import write_report
from learning.report.shown import exhibits, worst_frames
from learning.report.table import JUDGED, Report, Row
from learning.samples.seen import SeenRange, outside, read_seen
from physics.fidelity.figures import field_columns, shown
from physics.mesh.cell import CELLS
from physics.schema import InputError, to_table
from physics.view import ObstacleSurface, frame_picture

SAMPLE = 25  # frames of a trajectory at which equations and the deformed mesh are checked


def evaluate(run: str | Path, files: Sequence[str | Path], out: str | Path, *, correct: int = 1, refined: int = 1,
             predictions: Sequence[Sequence[str]] = (), functions: Sequence[Own] = (), beside: Sequence[str | Path] = (),
             device: str = "cpu", say: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Roll a trained network out over test trajectories and write the report folder.

    Args:
        run: folder of a training
        files, out: test trajectories, each with its scene in it; report folder
        correct: orders of magnitude by which Newton steps correct each frame of a rollout
        refined: how many of the test scenes are solved on finer cells as well
        predictions, functions: what users bring along, see `own_predictors`
        beside: other trainings, whose own rollouts are shown too; device: where the networks run
        say: takes a line of what comes out

    Returns:
        the content of report.json and "report", the folder

    Raises:
        InputError: no whole checkpoint, no files, a mesh that is not the one its scene builds
    """
    if not files:
        raise InputError("no trajectories to evaluate on")
    runs = {str(each): load_model(each, device) for each in (run, *beside)}
    names, cases = called(runs), load_cases(files)
    model, name, others = runs[str(run)], names[str(run)], [learned(runs[str(each)], names[str(each)]) for each in beside]
    alone = [estimated(f"{name}, its estimate alone")] if has_estimate(model) else []
    own, about = own_predictors(predictions, functions, cases)
    if any(case.known is None for case in cases):
        return report_on([*own, learned(model, name), *others, *trivial()], cases, Path(out),
                         title="A learned simulator held against its data", runs=runs, refined=0, about=about, say=say)
    fe = [elements("FE, cells twice as large", halvings=1), elements("FE, cells four times as large", halvings=2), elements(REFERENCE)]
    every = [*own, learned(model, name), *alone, corrected(model, correct, name), *others, *trivial(), *fe]
    return report_on(every, cases, Path(out), title="A learned simulator held against finite elements", runs=runs, refined=refined,
                     about=about, say=say)


def own_predictors(predictions: Sequence[Sequence[str]], functions: Sequence[Own],
                   cases: Sequence[Case]) -> tuple[list[Predictor], dict[str, str]]:
    """What users bring along, and where each comes from, in words.

    Args:
        predictions: each a folder, on request a name, and milliseconds a step; a file in it for each case
        functions: each a function of `Inputs`, or module:function and on request a name

    Raises:
        InputError: a file or a function is missing, or is no prediction of its case
    """
    found = [from_folder(words, cases) for words in predictions] + [from_function(words) for words in functions]
    return [predictor for predictor, _ in found], {predictor.name: said for predictor, said in found}


def has_estimate(model: Model | AtOnce) -> bool:
    """Whether a network corrects an estimate, which predicts by itself too."""
    return not isinstance(model, AtOnce) and model.config.estimate


def load_cases(files: Sequence[str | Path]) -> list[Case]:
    """The trajectories that predictions can be held against, named by their files. Raises `InputError`."""
    return [Case(Path(file).stem, *read_reference(file), Path(file)) for file in files]


def evenly(count: int, of: int) -> list[int]:
    """At most `count` numbers from 0 to of - 1, evenly spaced."""
    found: list[int] = np.unique(np.linspace(0, of - 1, min(count, of)).round().astype(int)).tolist()
    return found


def report_on(predictors: Sequence[Predictor], cases: Sequence[Case], out: Path, *, title: str, runs: dict[str, Model | AtOnce],
              refined: int, repeats: int = 1, about: dict[str, str] | None = None,
              say: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Measure predictors on cases and write the report folder; gives the content of report.json and "report", the folder.

    about: what is to be said of some predictors, by name
    """
    names = [predictor.name for predictor in predictors]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two predictors are called {twice[0]!r}: give each a name of its own")
    spans = [span for run in runs if (span := read_seen(run)) is not None]
    if cases[0].known is not None:
        warm_up(cases[0])
    with tqdm(total=len(cases) * len(predictors), desc="evaluate", disable=None, unit="rollout") as bar:
        found = measure(predictors, cases, sample=SAMPLE, refined=evenly(refined, len(cases)), repeats=repeats, on_done=bar.update)
    out.mkdir(parents=True, exist_ok=True)
    known, apart = called(runs), _apart(runs)
    found.rows = [replace(row, about=next((words for run, words in apart.items() if known[run] == row.name != runs[run].title), ""))
                  for row in found.rows]
    found.rows = paid_back(found.rows, runs)
    seeds_alone = bool(apart) and all(words.startswith("seed ") and "," not in words for words in apart.values())
    spread = [*spread_said(found.rows, chance=seeds_alone), *payback_said(found.rows)]
    report = Report(title=title, rows=found.rows, cases=[case.name for case in cases], pictures=_pictures(out, found),
                    outside={case.name: outside(case.trajectory, spans[0]) for case in cases} if spans else None,
                    facts=_facts(runs, cases, found, repeats) | (about or {}), notes=[*spread, *_limits(cases, found, runs, spans)])
    content = write_report(out, report, exhibits(found))
    if say is not None:
        for line in (*summary(found.rows), content["summary"], *spread, *found.notes, f"report: {out / 'report.html'}"):
            say(line)
    return {**content, "report": str(out)}


def _apart(runs: dict[str, Model | AtOnce]) -> dict[str, str]:
    """In what several runs differ: config, weights and trained steps; empty for one."""
    if len(runs) < 2:
        return {}
    return differing({run: {**to_table(model.config), "weights": sum(p.numel() for p in model.network.parameters()),
                            "trained steps": read_stored(Path(run) / "model.safetensors")[0]["step"]}
                      for run, model in runs.items()})


def summary(rows: Sequence[Row]) -> list[str]:
    """The table's first columns for a terminal."""
    lines = [f"{'':36s} {'ms/step':>9s} {'RMSD-1':>9s} {'RMSD-50':>9s} {'RMSD-all':>9s} {'to finer':>9s}  [mm, free nodes]"]
    for row in rows:
        errors = " ".join(f"{1e3 * row.scores[key]:9.4g}" for key in ("rmsd_1", "rmsd_50", "rmsd_all", "rmsd_refined"))
        lines.append(f"{row.name:36s} {row.ms_per_step:9.3g} {errors}".replace("nan", "  –"))
        lines += [f"    {column.head}: {shown(row.scores[key])} {column.unit}" for key, column in field_columns(row.scores).items()]
        lines += [f"    {row.about}"] * bool(row.about)
    return lines


def warm_up(case: Case) -> None:
    """Solve something small once, so that no time of below contains the loading of compiled forms."""
    scene, mesh = case.scene, case.mesh if case.scene.body.shape == "file" else None
    while (smaller := coarser(scene)) is not None:
        scene = smaller
    follow(scene, mesh=mesh)


def _pictures(out: Path, found: Measurement) -> list[tuple[str, str]]:
    """Draw the worst frame of each of the worst trajectories of the best network: file names and captions."""
    pictures = []
    for frame in worst_frames(found):
        case, step, surface = frame.case, frame.step, frame.case.trajectory.obstacle
        name = f"frame_{case.name}.png"
        frame_picture(out / name, case.mesh, prediction=frame.displacement, truth=case.truth[step], step=step, steps=case.steps,
                      obstacle=None if surface is None else ObstacleSurface(*surface).at(step), names=(frame.predictor, "finite elements"))
        pictures.append((name, f"Test trajectory {case.name}, RMSD-all {1e3 * frame.error:.3g} mm, at step {step} of {case.steps}, "
                               "where the rollout is farthest from the truth. Left the prediction, coloured by its error, over the "
                               "outline of the truth; right the truth."))
    return pictures


def _facts(runs: dict[str, Model | AtOnce], cases: Sequence[Case], found: Measurement, repeats: int) -> dict[str, str]:
    nodes = sorted({len(case.mesh.points) for case in cases})
    libraries = {"torch": torch.__version__, "pyvista": version("pyvista"), **versions()}
    threads = ", ".join(f"{name} {os.environ.get(name, 'not set')}" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"))
    timed = "each prediction timed once" if repeats == 1 else f"medians of {repeats} predictions, one for those of more than {LONG:g} s"
    facts = {
        "test trajectories": f"{len(cases)}: {', '.join(case.name for case in cases)}; {_range(nodes)} nodes, "
                             f"{_range(sorted({case.steps for case in cases}))} steps; free nodes are those that neither a "
                             "support holds nor the obstacle is made of",
        "gathering": "means over trajectories; of penetration, det F, scaled Jacobian and inverted cells the worst",
        "timing": f"processor time of one process, one predictor after the other on each scene; {timed}",
    }
    for run, model in runs.items():
        about, weights = read_stored(Path(run) / "model.safetensors")[0], sum(p.numel() for p in model.network.parameters())
        facts[f"network {Path(run).name}"] = (
            f"{model.title} from {run}: {weights} weights, trained {about['step']} steps in {about['seconds']:.0f} s{data_said(about)}, "
            f"of which step {about['best_step']} did best in validation and is shown; seed {model.config.seed}")
    return facts | {
        "truth": "the files: they hold no scene, so there are no equations to check, and no reference that could be solved again"
                 if any(case.known is None for case in cases) else
                 f"first-order {_words(CELLS[case.mesh.cell].plural for case in cases)}, "
                 f"{_words(material.law for case in cases for material in case.scene.materials)}; "
                 f"solved again here, it differs from the files by {1e3 * found.solved_again:.1e} mm at most (they hold 32-bit numbers)",
        "equations and mesh": f"checked at up to {SAMPLE} frames of each trajectory; errors and penetration at all frames",
        "machine": f"{processor()}, {os.cpu_count()} cores; {platform.platform()}",
        "threads": f"PyTorch {torch.get_num_threads()}; {threads}; the FE solver runs in one process",
        "versions": ", ".join(f"{name} {number}" for name, number in libraries.items()),
        "program": commit() or "not from a checkout",
        "date": datetime.date.today().isoformat(),
    }


def _limits(cases: Sequence[Case], found: Measurement, runs: dict[str, Model | AtOnce], spans: Sequence[SeenRange]) -> list[str]:
    notes = [
        "The truth has an error of its own, that of its mesh. An error below it means that the truth is imitated well, not that "
        "the body is known better.",
        f"Materials: {_words(_material(case) for case in cases)}. Cells: {_words(case.mesh.cell for case in cases)}. Of other "
        "materials and kinds of mesh nothing is said here.",
        "\"Keep the last velocity\" is shown the first two frames and \"quadratic extrapolation\" the first three, no more. Before the "
        "obstacle touches nothing moves, so over whole rollouts they can equal \"nothing moves\"; their RMSD-1 starts from true states.",
        "Finite elements on a coarser mesh are in equilibrium on their own mesh; carried over to the finer one they are not, which is "
        "what their residual and penetration show.",
        "The residual of a body that never moves is zero: it is in equilibrium, but the obstacle is inside of it. Read residual and "
        "penetration together.",
        "Errors are lengths of vectors. Where others average over the three components as well, their figures are smaller by the "
        "square root of 3."]
    reference = next((row for row in found.rows if row.kind == "reference"), None)
    if reference is not None and reference.scores.get("rmsd_refined", np.nan) > 0:
        own = reference.scores["rmsd_refined"]
        count = sum(not np.isnan(each["rmsd_refined"]) for each in reference.each)
        notes[0] += (f" On {count} of the {len(cases)} scenes, solved again on cells of half the size, the data are {1e3 * own:.3g} mm off"
                     f" (and the finer solution by about a third of that, if errors fall with the square of the cells' size).")
        for row in found.rows:
            if row.kind in (*JUDGED, "hybrid"):
                notes[0] += (f" {row.name}: {1e3 * row.scores['rmsd_refined']:.3g} mm from the finer solution; in "
                             f"{100 * row.scores['below_data']:.0f} % of the frames closer to the data than these to it.")
    notes += [*_of_correction(found.rows), *_of_doubt(found.rows, cases)]
    if runs:
        notes.append("The test scenes lie inside or outside of the ranges listed above. Each quantity is looked at by itself: a scene "
                     "inside of all of them may still combine values as no training scene did." if spans else
                     "The run does not say what it was trained on (no range.json), so how far outside the test scenes lie is not known.")
    return [*notes, *found.notes]


def _of_correction(rows: Sequence[Row]) -> list[str]:
    """What Newton steps make of a network, and what the network is worth as their start: a sentence each."""
    by_name, said = {row.name: row for row in rows}, []
    reference = by_name.get(REFERENCE)
    for row in rows:
        alone = by_name.get(row.name.rsplit(", ", 1)[0])
        if row.kind != "hybrid" or alone is None or reference is None:
            continue
        if row.name.endswith("Newton"):
            said.append(f"{row.name}: {row.scores['iterations']:.3g} Newton steps for each step of the loading and "
                        f"{row.ms_per_step:.3g} ms; from the polynomial through the last states, as the solver starts by itself, "
                        f"{reference.scores['iterations']:.3g} and {reference.ms_per_step:.3g} ms.")
        else:
            said.append(f"{row.name}: the error over whole rollouts falls by a factor of "
                        f"{alone.scores['rmsd_all'] / row.scores['rmsd_all']:.3g}, for {row.ms_per_step - alone.ms_per_step:.3g} ms a step "
                        f"more; the solver itself takes {reference.ms_per_step:.3g} ms.")
    return said


def _of_doubt(rows: Sequence[Row], cases: Sequence[Case]) -> list[str]:
    """Where predictors say themselves that they do not know, and how far off they are elsewhere."""
    said = []
    for row in rows:
        shares = [each.get("unsure", np.nan) for each in row.each]
        if not len(shares) or np.isnan(shares).all():
            continue
        unsure = {case.name: share for case, share in zip(cases, shares, strict=True) if share > 0}
        sure = [each["rmsd_all"] for each, share in zip(row.each, shares, strict=True) if not share > 0]
        names = ", ".join(f"{name} ({100 * share:.0f} % of the frames)" for name, share in unsure.items()) or "none of them"
        said.append(f"{row.name} says that it does not know: {names}." + (
            f" In the other {len(sure)} trajectories it is {1e3 * max(sure):.3g} mm off at most." if sure else ""))
    return said


def _material(case: Case) -> str:
    if case.known is None:
        return "not known"
    return " and ".join(f"{material.law} (E = {material.young_modulus:.3g} Pa, nu = {material.poisson_ratio:.3g})"
                        for material in case.known.materials)


def _words(values: Any) -> str:
    """Different values, at most four of them, with commas."""
    different = sorted(set(values))
    return ", ".join(different[:4]) + (f" and {len(different) - 4} more" if len(different) > 4 else "")


def _range(values: list[int]) -> str:
    return str(values[0]) if len(values) == 1 else f"{values[0]} to {values[-1]}"
