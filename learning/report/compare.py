"""Everything that predicts a path, on the same scenes, one core each: speed against error.

Learned simulators alone, corrected tenfold by Newton steps and as the start of the full Newton iteration; predictors that know
nothing; finite elements made cheaper in every way at hand; a reduced-order model; and the solver that made the data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from datagen.files.solved import as_solved, solved_on
from datagen.sets.dataset import files
from datagen.sets.generate import trajectory_of
from learning.bodies.at_once import AtOnce
from learning.devices import one_core
from learning.prediction.checkpoint import Model, load_model
from learning.prediction.foreign import Own
from learning.prediction.predictor import Case, Predictor
from learning.prediction.rivals import REFERENCE, elements, trivial
from learning.prediction.surrogates import corrected, estimated, learned
from learning.report.cost import called
from learning.report.evaluate import evenly, load_cases, own_predictors, report_on
from learning.report.table import KINDS
from physics.scene import load_solid
from physics.schema import InputError, nearest

CLOSE, LOOSE = 1e-3, 1e-2  # residual over reaction


def compare(what: str | Path, runs: Sequence[str | Path], out: str | Path, *, count: int = 5, split: str = "test",
            refined: int | None = None, repeats: int = 3, predictions: Sequence[Sequence[str]] = (),
            functions: Sequence[Own] = (), only: Sequence[str] = (), device: str = "cpu",
            say: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Measure every predictor on a scene file, or on some trajectories of a data set, and write the report folder.

    Args:
        what: a scene (.toml), or the folder of a data set
        runs: folders of trainings; none: the classical methods among themselves
        count, split: how many trajectories of which split of a data set, evenly spaced
        refined: how many of them are solved on finer cells as well; all by default
        repeats: of each timing
        predictions, functions: what users bring along, see `evaluate.own_predictors`
        only: kinds of predictors (table.KINDS) that are measured; all by default
        device: where networks run

    Returns:
        the content of report.json and "report", the folder

    Raises:
        InputError: no such scene or data set, no whole checkpoint, a trajectory without a scene
        RuntimeError: a scene that has no solution
    """
    models = {str(run): load_model(run, device) for run in runs}
    cases = scene_case(what) if Path(what).suffix.lower() == ".toml" else some_cases(what, split, count)
    with one_core():
        own, about = own_predictors(predictions, functions, cases)
        return report_on([*own, *chosen(predictors(models), only)], cases, Path(out), about=about, title="Speed against error", runs=models,
                         refined=len(cases) if refined is None else refined, repeats=repeats, say=say)


def check_kinds(only: Sequence[str]) -> None:
    """Raises `InputError` for a kind of predictors that is none."""
    for kind in only:
        if kind not in KINDS:
            raise InputError(f"--only {kind}: must be some of {', '.join(KINDS)}{nearest(kind, KINDS)}")


def chosen(every: Sequence[Predictor], only: Sequence[str]) -> list[Predictor]:
    """The predictors of some kinds, the reference always among them; all of them when no kind is named. Raises `InputError`."""
    check_kinds(only)
    return [predictor for predictor in every if not only or predictor.kind in (*only, "reference")]


def scene_case(path: str | Path) -> list[Case]:
    """The scene of a file, solved here. Raises `InputError` for a bad scene, RuntimeError for one without a solution."""
    scene = load_solid(path)
    if scene.steps.dynamic or scene.body.order != 1:
        raise InputError(f"{path}: the comparison takes quasi-static scenes of first-order cells")
    trajectory = trajectory_of(scene)
    if not trajectory.complete:
        raise RuntimeError(f"{path}: {trajectory.extra['failure']}")
    return [Case(Path(path).stem, trajectory, as_solved(scene, trajectory, scene.steps.count), solved_on(scene, trajectory))]


def some_cases(folder: str | Path, split: str, count: int) -> list[Case]:
    """At most `count` trajectories of a split, evenly spaced. Raises `InputError`."""
    found = files(folder, split)
    return load_cases([found[i] for i in evenly(count, len(found))])


def predictors(models: dict[str, Model | AtOnce]) -> list[Predictor]:
    """All of them, learned ones first; where several are of one kind these carry the names of their folders."""
    names = called(models)
    if len(set(names.values())) < len(names):
        raise InputError(f"--run: the folders {', '.join(models)} must have different names, by which the report calls them")
    rungs = [predictor for run, model in models.items()
             for predictor in (learned(model, names[run]), corrected(model, 1, names[run]), corrected(model, None, names[run]))]
    return [*rungs, *trivial(),
            elements("FE, cells twice as large", halvings=1), elements("FE, cells four times as large", halvings=2),
            elements(f"FE, a tenth of the steps, tolerance {CLOSE:g}", fewer=10, tolerance=CLOSE),
            elements(f"FE, a twentieth of the steps, tolerance {LOOSE:g}", fewer=20, tolerance=LOOSE),
            elements(f"FE, tolerance {LOOSE:g}", tolerance=LOOSE),
            elements("FE, cells twice as large, a tenth of the steps", halvings=1, fewer=10),
            elements("FE, linear elasticity", law="linear"),
            estimated("reduced-order model"), estimated("reduced-order model, few poses", rough=True), elements(REFERENCE)]
