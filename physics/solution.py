"""One answer to a scene: the path of its body through equilibria or through time, kept in a journal where one is wanted.

`solve` chooses between equilibrium/path.py, for slow loading, and motion/dynamics.py, for a body with inertia.
A path kept in a journal (journal.py) is gone on with after a kill, to the same bits as if nothing had happened.

Legend: N nodes, T steps + 1.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.equilibrium.newton import TOLERANCE
from physics.equilibrium.path import LoadPath
from physics.equilibrium.state import NoEquilibrium
from physics.journal import Journal, flatten, unflatten
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.mesh.quality import smallest_det_f
from physics.motion.dynamics import Motion
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.float64]


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
    kinetic_energy: Floats | None = None  # (T,) [J]; None where inertia is left out
    linear_steps: int = 0  # the first ones, which solve linear elasticity
    resumed: int = 0  # steps that an earlier, unfinished run had reached
    failure: str = ""  # empty when every step was reached

    @cached_property
    def smallest_det_f(self) -> Floats:
        """(T,) smallest det F of all cells, as in `mesh.quality.det_f`."""
        return smallest_det_f(self.mesh.points, self.displacement, self.mesh.cells, self.mesh.cell)


def solve(scene: Scene, *, mesh: Mesh | None = None, on_step: Callable[[int], None] | None = None,
          journal: str | Path | None = None, tolerance: float = TOLERANCE, method: str | None = None,
          spread: bool = False) -> Solution:
    """Follow the path of a scene from rest through all of its steps: through equilibria, or through time when the scene says so.

    Args:
        mesh: in place of the one that the scene's body describes
        on_step: called with the number of each step that is reached
        journal: a file that keeps the path as it grows; what it holds of an earlier run of the same scene is gone on from, also
            when that run ended in a failure: then the step that failed is tried again. It is left for the caller to delete.
        tolerance: of the residual force, over the reaction
        method: "direct" or "multigrid" instead of the choice by size
        spread: over all processes of an MPI run, which share the linear algebra; every one gets the whole answer

    Returns:
        the path; when a step has no equilibrium that could be found, all steps before it and `failure`

    Raises:
        InputError: the scene has no solution to look for, or the journal is of another scene
        WorkError: another process has the journal open
        OSError: the journal cannot be written
    """
    started, processor, spent = time.perf_counter(), time.process_time(), 0.0
    mesh = mesh or build_mesh(scene.body)
    path, frames, failure = _way(scene, mesh, tolerance, method, spread), [], ""
    set_up = time.process_time() - processor
    kept = None if journal is None else Journal(journal, identity(scene, mesh) + f" to {tolerance}" * (tolerance != TOLERANCE))
    try:
        if kept is not None and kept.frames:
            frames = [dict(zip(kept.frames, rows, strict=True)) for rows in zip(*kept.frames.values(), strict=True)]
            spent = float(kept.memory["seconds"])
            path.recall(unflatten(path.Memory, kept.memory))
        resumed = max(0, len(frames) - 1)
        for step in range(len(frames), scene.steps.count + 1):
            try:
                if step:
                    path.advance(step / scene.steps.count)
            except NoEquilibrium as error:
                failure = f"no {'motion' if scene.steps.dynamic else 'equilibrium'} at step {step}: {error}"
                break
            frames.append(path.frame())
            if kept is not None:
                kept.add(frames[-1], flatten(path.memory()) | {"seconds": np.array(spent + time.perf_counter() - started)})
            if on_step is not None and step:
                on_step(step)
        if kept is not None:
            kept.save()
    finally:
        if kept is not None:
            kept.close()
    rows = {name: np.array([frame[name] for frame in frames]) for name in frames[0]}
    return Solution(
        mesh=mesh, **rows,
        factorisations=path.newton.factorisations, halvings=path.halvings, linear_steps=path.linear_steps,
        model=path.model() | snapped(rows["snap"]),
        seconds=spent + time.perf_counter() - started, set_up=set_up, resumed=resumed, failure=failure)


def _way(scene: Scene, mesh: Mesh, tolerance: float, method: str | None, spread: bool) -> LoadPath | Motion:
    if not scene.steps.dynamic:
        return LoadPath(scene, mesh, tolerance=tolerance, method=method, spread=spread)
    if spread:
        raise InputError("steps.dynamic = true: motion in time runs as one process")
    return Motion(scene, mesh, tolerance=tolerance)


def identity(scene: Scene, mesh: Mesh) -> str:
    """One line that no other scene has, nor this one with another mesh in its file."""
    digest = hashlib.sha256(scene.to_toml().encode())
    of_file = [mesh.places[name] for name in sorted(mesh.places)] if scene.body.shape == "file" else []
    for array in (mesh.points, mesh.cells, *of_file):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def snapped(snap: Floats) -> dict[str, str]:
    """In which steps the body snapped, in words; snap (T,) [m] as in `Solution`."""
    steps = np.flatnonzero(snap)
    if not len(steps):
        return {}
    named = ", ".join(map(str, steps[:5])) + (f" and {len(steps) - 5} more" if len(steps) > 5 else "")
    return {"snaps": f"at step {named} the body moved by up to {snap.max():.3g} m without an equilibrium between, as in a viscous medium"}
