"""A scene on one of its meshes, at a few poses: the values that an error is of, at points that all meshes share, and what it costs.

displacement: its three components at the points [m]; reaction: of each pose, as in `Solution` [N]; stress: von Mises' measure of what the
nodes have (body/stress.py), carried to the points by the shape functions [Pa].

Cost is counted, in Newton steps and factors times a power of the nodes, so that the same scene always leads to the same choice; seconds
are told only. Legend: K poses, M points, d components.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physics.accuracy.ladder import Family, Sizes, points_of
from physics.body.stress import nodal_stress, recovery, von_mises_of
from physics.equilibrium.state import NoEquilibrium
from physics.mesh.mesh import Mesh
from physics.mesh.transfer import interpolate
from physics.scene import Scene
from physics.solution import Solution, solve

Floats = NDArray[np.float64]

POSES = 4  # and two for each leg of a path or row of a table
POWER, IDLE = 1.3, 300  # a step costs as much as (nodes + IDLE)^POWER: what it takes on no nodes at all, and how that grows
FACTOR = 8  # Newton steps that a factor costs


@dataclass(frozen=True)
class Pilot:
    """values: (K, M, d); nodes: of the mesh; work: counted; seconds: of the processor."""

    values: Floats
    nodes: int
    work: float
    seconds: float
    last: Floats  # (1, M, d) at the end


class Pilots:
    """The pilots of a scene, each solved once.

    Raises:
        NoEquilibrium: not even in as many steps as the scene has
        InputError: the mesh is too coarse for the scene, or the scene is wrong
    """

    def __init__(self, scene: Scene, families: list[Family], quantity: str, *, tolerance: float, small_strain: float) -> None:
        self.quantity, self.tolerance, self.small_strain = quantity, tolerance, small_strain
        self.points, self.weights = points_of(families[0])
        self.count, self.poses, self.seconds = scene.steps.count, min(scene.steps.count, few(scene)), 0.0
        self._known: dict[tuple[int, Sizes, float], Pilot] = {}

    def __call__(self, family: Family, sizes: Sizes, tolerance: float | None = None) -> Pilot:
        tolerance = tolerance or self.tolerance
        key = family.order, sizes, tolerance
        if key not in self._known:
            started = time.process_time()
            self._known[key] = self._solved(*family.rung(sizes), tolerance)
            self.seconds += time.process_time() - started
        return self._known[key]

    def __len__(self) -> int:
        return len(self._known)

    def knows(self, family: Family, sizes: Sizes) -> bool:
        """Whether a mesh was solved."""
        return (family.order, sizes, self.tolerance) in self._known

    def of(self, scene: Scene, solution: Solution, frames: list[int]) -> Floats:
        """(K, M, d) what the error is of, at some frames of a solution."""
        if self.quantity == "reaction":
            return solution.reaction[frames][:, None]
        mesh = solution.mesh
        if self.quantity == "displacement":
            return np.asarray(interpolate(mesh, solution.displacement[frames], self.points))
        stress = _stress(scene, mesh, solution, frames)
        return np.asarray(interpolate(mesh, stress[..., None], self.points))

    def _solved(self, scene: Scene, mesh: Mesh, tolerance: float) -> Pilot:
        started, count = time.process_time(), self.poses
        while True:
            found = solve(replace(scene, steps=replace(scene.steps, count=count)), mesh=mesh, tolerance=tolerance,
                          small_strain=self.small_strain, partial=True)
            if not (found.failure or found.snap.any()) or count >= self.count:
                break
            count = min(4 * count, self.count)
        if found.failure:
            raise NoEquilibrium(f"on {len(mesh.points)} nodes: {found.failure}", found)
        work = (int(found.newton_iterations.sum()) + FACTOR * found.factorisations) * (IDLE + len(mesh.points))**POWER
        frames = [round(count * (k + 1) / self.poses) for k in range(self.poses)]
        values = self.of(scene, found, frames)
        return Pilot(values, len(mesh.points), work, time.process_time() - started, values[-1:])


def few(scene: Scene) -> int:
    """How many poses tell of a path: more where it goes by way-points or tables."""
    rows = [len(obstacle.path) - 1 for obstacle in scene.obstacles]
    rows += [len(load.steps) - 1 for load in scene.load if load.steps is not None]
    rows += [len(support.steps) - 1 for support in scene.support if support.steps is not None]
    return max(POSES, 2 * min(max(rows, default=1), 10))


def _stress(scene: Scene, mesh: Mesh, solution: Solution, frames: list[int]) -> Floats:
    """(K, N) von Mises stress at the nodes, by the law that each frame was solved with."""
    at_nodes = recovery(mesh, scene.material)
    linear = scene.under("linear").material
    laws = [linear if frame <= solution.linear_steps else scene.material for frame in frames]
    return np.array([von_mises_of(nodal_stress(mesh, solution.displacement[frame], law, at_nodes))
                     for frame, law in zip(frames, laws, strict=True)])
