"""One answer to a scene: the path of its body through equilibria or through time, kept in a journal where one is wanted.

`solve` chooses between equilibrium/path.py, for slow loading, and motion/dynamics.py, for a body with inertia.
A path kept in a journal (journal.py) is gone on with after a kill, to the same bits as if nothing had happened.

Legend: N nodes, T steps + 1.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.body.kernel import smallest_det_f
from physics.body.schedule import Moves
from physics.body.supports import held
from physics.contact.obstacles import Rigid
from physics.equilibrium.newton import TOLERANCE
from physics.equilibrium.path import LoadPath
from physics.equilibrium.small_strain import LINEAR_TOLERANCE
from physics.equilibrium.state import NoEquilibrium, State
from physics.journal import digest_of, follow, unflatten
from physics.mesh.build import build_mesh, of_order
from physics.mesh.mesh import Mesh
from physics.mesh.sound.folded import folded
from physics.modes.locking import said_of_failure, said_of_path
from physics.motion.dynamics import Motion
from physics.scene import Scene, Steps
from physics.schema import InputError

Floats = NDArray[np.float64]

FEWEST = 4  # steps
WITHOUT_LIMIT = "forces beside them grow without limit as cells get smaller"
SEEN = "snaps", "folds", "inside out", "held"  # words of the model on what a path shows
LOOKS, TOUCHED = 40, 1e-4  # fractions of the loading at which held points are looked at; of the body's size they may be passed by


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The path of a body; arrays have one row for each of the T frames that were reached, the rest state first."""

    mesh: Mesh
    displacement: Floats  # (T, N, 3) [m]
    reaction: Floats  # (T, 3) [N] force of the body on the obstacle; without one, on the supports that move, or on all
    energy: Floats  # (T,) [J]
    penetration: Floats  # (T,) [m]
    newton_iterations: NDArray[np.int64]  # (T,)
    relative_residual: Floats  # (T,) |residual| / |reaction|
    snap: Floats  # (T,) [m] the farthest that a node moved in this step without equilibria between (snap.py)
    released: Floats  # (T,) [J] by which the potential fell in that motion
    factorisations: int
    halvings: int
    model: dict[str, str]  # what was modelled, and why
    seconds: float
    set_up: float  # [s] of the processor, before the first step
    reactions: Floats | None = None  # (T, K, 3) [N] of the body on each of K obstacles; None unless there are several
    kinetic_energy: Floats | None = None  # (T,) [J]; None where inertia is left out
    linear_steps: int = 0  # the first ones, which solve linear elasticity
    resumed: int = 0  # steps that an earlier, unfinished run had reached
    knots: tuple[int, ...] = ()  # the steps that were solved, where the others lie on splines through them (accuracy/between.py)
    steps_of_time: int | None = None  # of a motion where they are not its frames (accuracy/motion.py)
    between: float = 0.0  # how far those are off in the quantity whose error was asked for, relative
    failure: str = ""  # empty when every step was reached

    def __repr__(self) -> str:
        end = self.failure or f"largest displacement {np.linalg.norm(self.displacement[-1], axis=1).max():.4g} m"
        return f"Solution({len(self.displacement) - 1} steps of {self.mesh}: {end})"

    @cached_property
    def smallest_det_f(self) -> Floats:
        """(T,) smallest det F of all cells, as in `mesh.quality.det_f`."""
        return smallest_det_f(self.mesh, self.displacement)

    def idle(self, scene: Scene) -> tuple[str, ...]:
        """A remark when nothing moves: as where an obstacle's path is in another unit than the body."""
        if self.failure or self.displacement.any():
            return ()
        points = self.mesh.points
        low, high = ("(" + ", ".join(f"{x:.4g}" for x in corner) + ")" for corner in (points.min(axis=0), points.max(axis=0)))
        why = "no obstacle reaches the body" if scene.obstacles else "no load and no support moves the body"
        return (f"nothing moves: {why}, which lies between {low} and {high} m",)

    def stiff(self, scene: Scene) -> tuple[str, ...]:
        """A remark when the cells of its scene are much too stiff for what it does (modes/locking.py)."""
        return said_of_path(scene, self.mesh, self.displacement, self.energy, self.linear_steps)


def solve(scene: Scene, *, mesh: Mesh | None = None, on_step: Callable[[int], None] | None = None,
          journal: str | Path | None = None, tolerance: float = TOLERANCE, method: str | None = None,
          spread: bool = False, final: bool = False, partial: bool = False, small_strain: float = LINEAR_TOLERANCE,
          snaps: bool = True, look: bool = True, ahead: Sequence[State] = (), substeps: int = 1) -> Solution:
    """Follow the path of a scene from rest through all of its steps: through equilibria, or through time when the scene says so.

    Args:
        mesh: in place of the one that the scene's body describes; of first order it is given middles where the body has order 2
        on_step: called with the number of each step that is reached
        journal: a file that keeps the path as it grows; what it holds of an earlier run of the same scene is gone on from, also
            when that run ended in a failure: then the step that failed is tried again. It is left for the caller to delete.
        tolerance: of the residual force, over the reaction
        method: "direct" or "multigrid" instead of the choice by size
        spread: over all processes of an MPI run, which share the linear algebra; every one gets the whole answer
        final: only the end of the loading counts: in as few equal steps as lead there without a snap, FEWEST or more. Of several
            states in which the body could rest there, a path of small steps decides
        small_strain: error over the largest displacement that linear elasticity may make in place of finite strain
        snaps: whether the path goes on where the body snaps through or slips off; otherwise it cannot be followed beyond
        partial: give what was reached of a path that cannot be followed to its end, and why in `failure`, in place of raising
        look: whether to look for folds of the body and cells inside out, which `of_path` does
        ahead: states on this mesh that are known already, in their order: steps begin between them and the last ones. Not with a journal
        substeps: of time for each step of a body in motion

    Returns:
        the path; the last row of each array is its end

    Raises:
        NoEquilibrium: a step has no equilibrium that could be found; its `solution` is what a partial one would have been
        InputError: the scene has no solution to look for, or the journal is of another scene; final of a body in motion
        WorkError: another process has the journal open
        OSError: the journal cannot be written
    """
    if final:
        return _final(scene, mesh=mesh, on_step=on_step, journal=journal, tolerance=tolerance, method=method, spread=spread,
                      partial=partial, small_strain=small_strain, snaps=snaps, look=look)
    if substeps > 1 and not scene.steps.dynamic:
        raise InputError("substeps: of a body in motion; a step of equilibrium is halved where it has to be")
    started, processor = time.perf_counter(), time.process_time()
    mesh = of_order(mesh or build_mesh(scene.body), scene.body)
    path = _way(scene, mesh, tolerance, method, spread, small_strain, snaps, ahead)
    set_up = time.process_time() - processor
    limits = f" to {tolerance}" * (tolerance != TOLERANCE) + f" linear to {small_strain}" * (small_strain != LINEAR_TOLERANCE)
    limits += f" in {substeps} substeps" * (substeps != 1)

    def go(step: int) -> dict[str, Any]:
        if step and isinstance(path, Motion) and substeps > 1:
            return path.frame_after((step - 1 + part / substeps) / scene.steps.count for part in range(1, substeps + 1))
        if step:
            path.advance(step / scene.steps.count)
        return path.frame()

    way = follow(scene.steps.count, go, path.memory, lambda arrays: path.recall(unflatten(path.Memory, arrays)),
                 failures=(NoEquilibrium,), path=journal, identity=identity(scene, mesh) + limits, started=started, on_step=on_step)
    failure = "" if way.failed is None else "; ".join((
        "no {} at step {}: {}".format("motion" if scene.steps.dynamic else "equilibrium", *way.failed), *said_of_failure(scene, mesh)))
    found = Solution(
        mesh=mesh, **way.frames,
        factorisations=path.newton.factorisations, halvings=path.halvings, linear_steps=path.linear_steps,
        model=path.model(), seconds=way.seconds, set_up=set_up, resumed=way.resumed, knots=(), steps_of_time=None, between=0.0,
        failure=failure)
    if look:
        found = of_path(scene, found)
    if failure and not partial:
        raise NoEquilibrium(failure, found)
    return found


def _final(scene: Scene, *, partial: bool, **how: Any) -> Solution:
    """The end of a loading in as few steps as lead there: FEWEST, four times as many, ..., at last those of the scene."""
    if scene.steps.dynamic or how["journal"] is not None:
        raise InputError("final: for slow loading without a journal; a body in motion needs all of its steps")
    count, most = FEWEST, max(FEWEST, scene.steps.count)
    while True:
        found = solve(replace(scene, steps=Steps(count=count, duration=scene.steps.duration)), **how, partial=partial or count < most)
        if count == most or not (found.failure or found.snap.any()):
            return found
        count = min(4 * count, most)


def _way(scene: Scene, mesh: Mesh, tolerance: float, method: str | None, spread: bool, small_strain: float,
         snaps: bool, ahead: Sequence[State]) -> LoadPath | Motion:
    if not scene.steps.dynamic:
        return LoadPath(scene, mesh, tolerance=tolerance, method=method, spread=spread, small_strain=small_strain, snaps=snaps, ahead=ahead)
    if spread:
        raise InputError("steps.dynamic = true: motion in time runs as one process")
    return Motion(scene, mesh, tolerance=tolerance)


def identity(scene: Scene, mesh: Mesh) -> str:
    """One line that no other scene has, nor this one with another mesh in its file."""
    of_file = [mesh.places[name] for name in sorted(mesh.places)] if scene.body.shape == "file" else []
    return digest_of(scene.to_toml(), mesh.points, mesh.cells, *of_file)


def of_path(scene: Scene, solution: Solution) -> Solution:
    """The same, with what its path shows of the body in its model."""
    seen = snapped(solution.snap) | _cut(solution.mesh, solution.displacement) | _inside_out(scene, solution)
    if deep := through_held(scene, solution.mesh):
        seen["held"] = f"an obstacle passes through points that are held, by up to {deep:.3g} m: {WITHOUT_LIMIT}"
    return replace(solution, model={name: text for name, text in solution.model.items() if name not in SEEN} | seen)


def through_held(scene: Scene, mesh: Mesh) -> float:
    """How deep an obstacle passes into points of a body that are held in all directions [m]; 0 where it passes none.

    What lies beside such a point would have to move by that much within no length: the energy of that has no limit on finer cells.
    """
    points = np.flatnonzero(held(scene, mesh).all(axis=1))
    deepest, moves = 0.0, Moves(scene, mesh)
    for obstacle in map(Rigid, scene.obstacles if len(points) else ()):
        for fraction in sorted({*np.linspace(0, 1, LOOKS + 1).tolist(), *obstacle.reached.tolist()}):
            at = mesh.points[points] + moves.at(fraction)[points]
            deepest = max(deepest, -float(obstacle.gap(at, obstacle.position(fraction))[0].min()))
    return deepest if deepest > TOUCHED * float(mesh.extent.max()) else 0.0


def snapped(snap: Floats) -> dict[str, str]:
    """In which steps the body snapped, in words; snap (T,) [m] as in `Solution`."""
    steps = np.flatnonzero(snap)
    if not len(steps):
        return {}
    named = ", ".join(map(str, steps[:5])) + (f" and {len(steps) - 5} more" if len(steps) > 5 else "")
    return {"snaps": f"at step {named} the body moved by up to {snap.max():.3g} m without an equilibrium between, as in a viscous medium"}


def _cut(mesh: Mesh, displacement: Floats) -> dict[str, str]:
    """Where a body passes through itself in a path (T, N, 3), in words."""
    found = folded(mesh, displacement)
    if found is None:
        return {}
    step, where = found
    return {"folds": f"at step {step} the body passes through itself, near ({', '.join(f'{x:.3g}' for x in where)}) m: it does not feel "
                     "itself, and from there on it is not to be believed"}


def _inside_out(scene: Scene, found: Solution) -> dict[str, str]:
    """From which step of a path on a cell is turned inside out, which one law bears without resistance, in words."""
    if all(material.law != "saint-venant-kirchhoff" for material in scene.materials):
        return {}
    inverted = np.flatnonzero(found.smallest_det_f <= 0)
    if not len(inverted):
        return {}
    return {"inside out": f"at step {inverted[0]} a cell is turned inside out, which saint-venant-kirchhoff bears and no body does; from "
                          "there on it is not to be believed: take a neo-hookean law, or press less"}
