"""Rollouts held against finite elements and beside their rivals, gathered in one report.

On each test trajectory: the network, "nothing moves", "keep the last velocity", finite elements on coarser meshes, and the
finite-element solver that made the truth, solved again here for its time. Every prediction goes through the same
physics.verify, on the same nodes. What is written: see report.py; what the rivals are: see rivals.py.
"""

from __future__ import annotations

import datetime
import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from datagen.generate import commit, versions
from datagen.prediction import read_truth
from datagen.trajectory import Trajectory
from learning.checkpoint import Model, load_model, read_state
from learning.report import write_report
from learning.rivals import coarser, interpolate, keep_velocity, nothing_moves
from learning.rollout import predict_step, rollout
from learning.table import Report, Row
from physics.equilibrium import solve
from physics.fem import release
from physics.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError
from physics.verify import Checker, Fidelity, as_table, verify
from physics.view import Obstacle, frame_picture

Floats = NDArray[np.floating[Any]]
RUNGS = {"FE, cells halved": 1, "FE, cells halved twice": 2}
REFERENCE = "FE, the reference"
HYBRID = "M4GN, 1 Newton step"


class LeftOut(Exception):
    """A predictor that cannot be measured on a trajectory; the message completes "because in this trajectory ..."."""


@dataclass(frozen=True)
class _Case:
    """A test trajectory with its scene and the mesh that the scene builds."""

    name: str
    trajectory: Trajectory
    scene: Scene
    mesh: Mesh

    @property
    def truth(self) -> NDArray[np.float32]:
        """(T, N, 3) displacement of the body."""
        return self.trajectory.displacement[:, self.trajectory.body]

    @property
    def free(self) -> NDArray[np.bool_]:
        """(N,) True on the body's nodes that are not held."""
        return self.trajectory.free[self.trajectory.body]

    @property
    def steps(self) -> int:
        return len(self.trajectory.displacement) - 1


@dataclass
class _Measured:
    """What one predictor did on the trajectories so far."""

    kind: str
    ms: list[float] = field(default_factory=list)
    found: list[Fidelity] = field(default_factory=list)

    def row(self, name: str) -> Row:
        """Means over trajectories; of extremes the extreme. The step of the largest error has neither."""
        each = [as_table(fidelity) for fidelity in self.found]
        if self.kind in ("fe", "reference", "hybrid"):  # starts no step from a given state
            each = [{**table, "rmse_1": np.nan, "rmse_1_pooled": np.nan} for table in each]
        gather = {"largest_penetration": max, "smallest_det_f": min, "inverted_elements": max}
        scores = {key: float(gather.get(key, np.mean)([table[key] for table in each]))
                  for key in each[0] if key != "worst_step"}
        each = [{**table, "ms_per_step": ms} for table, ms in zip(each, self.ms, strict=True)]
        return Row(name, self.kind, float(np.mean(self.ms)), scores, tuple(each))


def evaluate(run: str | Path, files: Sequence[str | Path], out: str | Path, *, sample: int = 25,
             say: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Roll a trained network out over test trajectories and write the report folder.

    Args:
        run: folder of a training
        files: trajectories of finite elements, complete ones, with their scenes in them
        sample: the equations are checked at about this many frames of each trajectory
        say: takes the lines of the summary

    Returns:
        what stands in report.json, and "report", the folder

    Raises:
        InputError: no run or trajectory there, or one that cannot serve as the truth
        FloatingPointError: a rollout that is not finite
    """
    if not files:
        raise InputError("no trajectories to evaluate")
    out, model = Path(out), load_model(run)
    last = Path(run) / "last.safetensors"
    about = read_state(last if last.exists() else Path(run) / "model.safetensors").about
    cases = [_Case(Path(file).stem, *read_truth(file)) for file in files]
    out.mkdir(parents=True, exist_ok=True)
    measured: dict[str, _Measured] = {}
    pictures: list[tuple[str, str]] = []
    notes: list[str] = []
    again = 0.0
    _warm_up(cases[0].scene)

    with tqdm(total=len(cases) * (5 + len(RUNGS)), desc="evaluate", disable=None, unit="rollout") as bar:
        for case in cases:
            for name, kind, predict in _predictors(model, case):
                bar.update()
                try:
                    path, one_step, ms = predict()
                except LeftOut as reason:
                    notes.append(f"{name} is left out, because in {case.name} {reason}.")
                    continue
                if kind == "reference":  # what counts is the file, which was solved again for its time
                    again = max(again, float(abs(path - case.truth).max()))
                    path = case.truth
                fidelity = verify(path, case.truth, scene=case.scene, mesh=case.mesh, free=case.free, one_step=one_step,
                                  sample=sample)
                if kind == "learned":
                    pictures.append(_picture(out, case, path, fidelity.worst_step))
                entry = measured.setdefault(name, _Measured(kind))
                entry.ms.append(ms)
                entry.found.append(fidelity)
            release()

    rows = [entry.row(name) for name, entry in measured.items() if len(entry.found) == len(cases)]
    report = Report(title="A learned simulator held against finite elements", rows=rows, cases=[case.name for case in cases],
                    pictures=pictures, facts=_facts(model, about, Path(run), cases, sample, again), notes=_limits(rows) + notes)
    content = write_report(out, report)
    if say is not None:
        for line in (*_summary(rows), content["summary"], f"report: {out / 'report.html'}"):
            say(line)
    return {**content, "report": str(out)}


def _warm_up(scene: Scene) -> None:
    """Solve something small once, so that no time of below contains the loading of compiled forms."""
    while (smaller := coarser(scene)) is not None:
        scene = smaller
    solve(scene)


def _predictors(model: Model, case: _Case) -> list[tuple[str, str, Callable[[], tuple[Any, Any, float]]]]:
    """Name, kind and a function for each predictor, which gives its path (T, N, 3), its single steps (T - 1, N, 3) or None when
    it takes none, and its time [ms/step]; or raises `LeftOut`."""

    def learned() -> tuple[Any, Any, float]:
        predicted = rollout(model, case.trajectory)
        body = case.trajectory.body
        steps = predict_step(model, case.trajectory)[:, body]
        return predicted.displacement[:, body], steps, 1e3 * predicted.extra["seconds_per_step"]

    def hybrid() -> tuple[Any, Any, float]:
        start = time.perf_counter()
        checker, truth = Checker(case.scene, case.mesh), case.truth
        set_up = time.perf_counter() - start

        def correct(u: NDArray[np.float64], frame: int) -> NDArray[np.float64]:
            at, held = frame / case.steps, ~case.free
            return np.where(held[:, None], truth[frame], u + checker.correction(u, at))

        try:
            predicted = rollout(model, case.trajectory, correct=correct)
        except FloatingPointError:
            raise LeftOut("a Newton step led nowhere") from None
        ms = 1e3 * (predicted.extra["seconds_per_step"] + set_up / case.steps)
        return predicted.displacement[:, case.trajectory.body], None, ms

    def trivial(rule: Callable[..., tuple[Floats, Floats]]) -> tuple[Any, Any, float]:
        start = time.perf_counter()
        path, steps = rule(case.truth, case.free)
        return path, steps, 1e3 * (time.perf_counter() - start) / case.steps

    def elements(halvings: int) -> tuple[Any, Any, float]:
        scene: Scene | None = case.scene
        for _ in range(halvings):
            scene = coarser(scene) if scene is not None else None
        if scene is None:
            raise LeftOut("there are no cells left to halve")
        solution = solve(scene)
        if solution.failure:
            raise LeftOut(f"there is {solution.failure}")
        path = interpolate(solution.mesh, solution.displacement, case.mesh.points) if halvings else solution.displacement
        return path, None, 1e3 * solution.seconds / case.steps

    return [("M4GN", "learned", learned), (HYBRID, "hybrid", hybrid), ("nothing moves", "trivial", lambda: trivial(nothing_moves)),
            ("keep the last velocity", "trivial", lambda: trivial(keep_velocity)),
            *((name, "fe", lambda halvings=halvings: elements(halvings)) for name, halvings in RUNGS.items()),
            (REFERENCE, "reference", lambda: elements(0))]


def _picture(out: Path, case: _Case, path: Floats, step: int) -> tuple[str, str]:
    """Draw one frame of a rollout: the file's name and a caption."""
    name = f"frame_{case.name}.png"
    surface = case.trajectory.obstacle
    obstacle = None if surface is None else Obstacle(*surface).at(step)
    frame_picture(out / name, case.mesh, prediction=path[step], truth=case.truth[step], step=step, steps=case.steps,
                  obstacle=obstacle, names=("M4GN", "finite elements"))
    return name, (f"Test trajectory {case.name}, step {step} of {case.steps}, where the rollout is farthest from the "
                  "truth. Left the "
                  f"prediction, coloured by its error, over the outline of the truth; right the truth.")


def _facts(model: Model, about: dict[str, Any], run: Path, cases: list[_Case], sample: int, again: float) -> dict[str, str]:
    nodes = sorted({len(case.mesh.points) for case in cases})
    libraries = {"torch": torch.__version__, "pyvista": version("pyvista"), **versions()}
    threads = ", ".join(f"{name} {os.environ.get(name, 'not set')}" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"))
    return {
        "test trajectories": f"{len(cases)}: {', '.join(case.name for case in cases)}; {_range(nodes)} nodes, "
                             f"{_range(sorted({case.steps for case in cases}))} steps; free nodes are those that neither a "
                             "support holds nor the obstacle is made of",
        "gathering": "means over trajectories; of penetration, det F and inverted cells the worst",
        "network": f"M4GN from {run}: {sum(p.numel() for p in model.network.parameters())} weights, trained {about['step']} "
                   f"steps in {about['seconds']:.0f} s, of which step {about['best_step']} did best in validation and is shown; "
                   f"seed {model.config.seed}",
        "truth": f"first-order {cases[0].mesh.cell}s, {cases[0].scene.material.law}; solved again here, it differs from the "
                 f"files by {1e3 * again:.1e} mm at most (they hold 32-bit numbers)",
        "equations": f"residual force at up to {sample} frames of each trajectory, everything else at all frames",
        "machine": f"{_processor()}, {os.cpu_count()} cores; {platform.platform()}",
        "threads": f"PyTorch {torch.get_num_threads()}; {threads}; the FE solver runs in one process",
        "versions": ", ".join(f"{name} {number}" for name, number in libraries.items()),
        "program": commit() or "not from a checkout",
        "date": datetime.date.today().isoformat(),
    }


def _limits(rows: list[Row]) -> list[str]:
    notes = ["The truth has an error of its own, that of its mesh. An error below it means that the truth is imitated "
             "well, not that "
             "the body is known better."]
    half = next((row for row in rows if row.name in RUNGS), None)
    if half is not None:
        notes[0] += (" For scale: finite elements with half the cells along each direction are "
                     f"{1e3 * half.scores['rmse_all']:.3g} mm "
                     f"away from it.")
    return [*notes,
            "The test scenes are drawn from the same ranges as the training scenes. Nothing here speaks of other scenes.",
            "\"Keep the last velocity\" is shown the first two frames, no more. Before the obstacle touches nothing "
            "moves, so over whole "
            "rollouts it can equal \"nothing moves\"; its RMSE-1 starts from true states.",
            "Finite elements on a coarser mesh are in equilibrium on their own mesh; carried over to the finer one they are "
            "not, which is what their residual and penetration show.",
            "The residual of a body that never moves is zero: it is in equilibrium, but the obstacle is inside of it. "
            "Read residual and "
            "penetration together.",
            "Errors are lengths of vectors. Where others average over the three components as well, their figures are "
            "smaller by the "
            "square root of 3."]


def _summary(rows: list[Row]) -> list[str]:
    lines = [f"{'':24s} {'ms/step':>9s} {'RMSE-1':>9s} {'RMSE-50':>9s} {'RMSE-all':>9s}  [mm, free nodes]"]
    for row in rows:
        errors = " ".join(f"{1e3 * row.scores[key]:9.4g}" for key in ("rmse_1", "rmse_50", "rmse_all"))
        lines.append(f"{row.name:24s} {row.ms_per_step:9.3g} {errors}".replace("nan", "  –"))
    return lines


def _range(values: list[int]) -> str:
    return str(values[0]) if len(values) == 1 else f"{values[0]} to {values[-1]}"


def _processor() -> str:
    """The processor's name where Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.machine()
