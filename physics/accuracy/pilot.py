"""A scene on one of its meshes, at a few poses: the values that an error is of, at points that all meshes share, and what it costs.

displacement: its three components at the points [m]; reaction: of each pose, as in `Solution` [N]; stress: von Mises' measure of what the
nodes have (body/stress.py), carried to the points by the shape functions [Pa].

The first mesh follows the path in few steps. All others start at each pose from what the mesh before found there, carried over by its
shape functions: a factor and some Newton steps a pose. Where that leads nowhere the path is followed. Without an obstacle, on a path
that goes one way, the displacement is looked at twice, at the end and about half-way there; under one, which finds other points of
other meshes at each pose, at all of them.

Cost is a power of the nodes, not seconds, so that the same scene always leads to the same choice. Legend: K poses, M points, d components.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.accuracy.meshes.ladder import MeshFamily, Sizes, points_of
from physics.body.stress import nodal_stress, recovery, von_mises_of
from physics.contact.obstacles import Rigid
from physics.equilibrium.path import LoadPath
from physics.equilibrium.state import HALVINGS, NoEquilibrium, State
from physics.mesh.mesh import Mesh
from physics.mesh.transfer import CANDIDATES, carried, located
from physics.scene import Scene
from physics.solution import Solution, solve

Floats = NDArray[np.float64]

FEWEST = 8  # steps that are solved between two turns of what a scene says
POSES = 4  # and two for each leg of a path or row of a table
HALF = 0.6  # of the last displacement: the other pose on a path that goes one way
# Cells of boxes among which one holds a point.
EVEN = {"hexahedron": 1, "hexahedron27": 1, "quadrilateral": 1, "quadrilateral9": 1, "triangle": 6, "triangle6": 6}
FEW = 4  # nearest cells among which one mostly holds a point
STRAIN = 1e-12  # of the largest displacement over the body's extent: below it stress is of rounding, as of a body that only moves
HALVED = 3  # times the way between two poses under an obstacle may be, where another mesh's answer leads nowhere
# By dimension a step costs as much as (nodes + IDLE)^POWER: what it takes on no nodes at all, and how that grows; with cells of second
# order SECOND times as much; and a pose of a pilot as much as POSE steps, of which those of a plane body are short.
POWER, IDLE, SECOND, POSE = {3: 1.3, 2: 1.0}, {3: 300, 2: 650}, {3: 1.7, 2: 1.15}, {3: 1, 2: 7}


@dataclass(frozen=True)
class Pilot:
    """values: (K, M, d); u: (K, N, 3) displacements [m]; seconds: of the processor."""

    mesh: Mesh
    values: Floats
    u: Floats
    seconds: float

    @property
    def nodes(self) -> int:
        return len(self.mesh.points)


class Pilots:
    """The pilots of a scene, each solved once.

    fractions: of the loading, (K,), known after the first pilot; count: steps that will be solved on the mesh that is chosen

    Raises:
        NoEquilibrium: not even in as many steps as the scene has
        InputError: the mesh is too coarse for the scene, or the scene is wrong
    """

    def __init__(self, scene: Scene, families: list[MeshFamily], quantity: str, *, tolerance: float, small_strain: float,
                 balanced: bool = False) -> None:
        """Args: tolerance, small_strain: as of `solve`; balanced: whether all steps of the scene will be solved in the end."""
        self.scene, self.quantity, self.tolerance, self.small_strain = scene, quantity, tolerance, small_strain
        self.points, self.weights = points_of(families[0])
        self.graded = not families[0].body.even
        every, self.seconds = scene.steps.count, 0.0
        self.count = every if balanced else min(every, FEWEST * max(1, len(turns(scene)) - 1))
        self.fractions = np.arange(1, (poses := min(every, few(scene))) + 1) / poses
        self._known: dict[tuple[int, Sizes, float], Pilot] = {}
        self._last: Pilot | None = None
        self._placed: tuple[Mesh | None, NDArray[np.int64], Floats] = None, np.empty((0, 0), np.int64), np.empty((0, 0))

    def __call__(self, family: MeshFamily, sizes: Sizes, tolerance: float | None = None) -> Pilot:
        tolerance = tolerance or self.tolerance
        key = family.order, sizes, tolerance
        if key not in self._known:
            started = time.process_time()
            scene, mesh = family.rung(sizes)
            if self._last is None:
                found = self._fewer(self._along(scene, mesh, tolerance))
            else:
                found = self.beside(scene, mesh, tolerance, self._last, self.fractions)
            self._known[key] = self._last = replace(found, seconds=time.process_time() - started)
            self.seconds += self._last.seconds
            family.learn(sizes, found.u)
        return self._known[key]

    def __len__(self) -> int:
        return len(self._known)

    @property
    def straight(self) -> bool:
        """Whether the path goes one way, so that two poses are enough."""
        return len(self.fractions) == 2 < min(self.scene.steps.count, POSES)

    def knows(self, family: MeshFamily, sizes: Sizes) -> bool:
        """Whether a mesh was solved."""
        return (family.order, sizes, self.tolerance) in self._known

    def solved(self, order: int) -> list[tuple[Sizes, Pilot]]:
        """All meshes of an order that were solved, in their order."""
        return [(sizes, pilot) for (one, sizes, tolerance), pilot in self._known.items() if one == order and tolerance == self.tolerance]

    def of(self, scene: Scene, solution: Solution, frames: list[int]) -> Floats:
        """(K, M, d) what the error is of, at some frames of a solution."""
        linear = [frame <= solution.linear_steps for frame in frames]
        return self._values(scene, solution.mesh, solution.displacement[frames], solution.reaction[frames], linear)

    def _values(self, scene: Scene, mesh: Mesh, u: Floats, reaction: Floats, linear: list[bool]) -> Floats:
        if self.quantity == "reaction":
            return reaction[:, None]
        if self.quantity == "displacement":
            return self._at_points(mesh, u)
        return self._at_points(mesh, _stress(scene, mesh, u, linear)[..., None])

    def _at_points(self, mesh: Mesh, values: Floats) -> Floats:
        """(K, M, d) what nodes have (K, N, d) at the points that all meshes share."""
        if mesh is not self._placed[0]:  # the same mesh is mostly asked again
            outside = 1.0 if self.scene.body.drawn else 1e-6  # [cells] each mesh of a drawing has other chords of its curved sides
            self._placed = mesh, *self._located(mesh, self.points, outside)
        _, nodes, weights = self._placed
        return np.asarray(carried(values, nodes, weights))

    def _located(self, mesh: Mesh, points: Floats, outside_by: float) -> tuple[NDArray[np.int64], Floats]:
        """Where points (M, 3) of the body lie, or outside of it by so many cells: see `transfer.located`."""
        some = EVEN.get(mesh.cell, CANDIDATES) if self.scene.body.shape in ("beam", "plate") else CANDIDATES
        return located(mesh, points, outside_by, some, min(some, FEW), self.graded)

    def _fewer(self, found: Pilot) -> Pilot:
        """Keep the poses that are enough from here on."""
        size = np.sqrt(np.einsum("m,kmd->k", self.weights, found.values**2)) if self.quantity == "displacement" else np.zeros(1)
        if self.scene.obstacles or len(size) != POSES or few(self.scene) > POSES or (np.diff(size) < 0).any():
            return found
        kept = [int(np.argmin(abs(size[:-1] - HALF * size[-1]))), POSES - 1]
        self.fractions = self.fractions[kept]
        return replace(found, values=found.values[kept], u=found.u[kept])

    def beside(self, scene: Scene, mesh: Mesh, tolerance: float, near: Pilot, fractions: Floats) -> Pilot:
        """The poses at some fractions (K,) of the loading, sought where a pilot of another mesh had them, else from the pose before.

        Raises `NoEquilibrium` when a pose is found neither way.
        """
        contact = bool(scene.obstacles)
        path = LoadPath(scene, mesh, tolerance=tolerance, small_strain=self.small_strain, snaps=not contact)
        if path.linear is None:
            self.small_strain = 0.0
        states, linear = [], []
        starts = carried(near.u, *self._located(near.mesh, mesh.points, 1.0))
        for fraction, start in zip(map(float, fractions), starts, strict=True):
            balance = path.balance
            if path.linear is None and not balance.rests(fraction):
                led = np.where(balance.fixed, balance.moved(fraction), start)
                path.newton.outdate()
                try:
                    path.states = [path.newton.near(fraction, led, State(fraction, led, path.states[-1].pressure))]
                    path.order = 0
                except NoEquilibrium:
                    path.newton.outdate()
            if path.states[-1].fraction < fraction:
                path.advance(fraction, HALVINGS - HALVED if contact else 0)
            states.append(path.states[-1])
            linear.append(path.linear is not None)
        u, reaction = np.array([state.u for state in states]), np.array([state.reaction for state in states])
        return Pilot(mesh, self._values(scene, mesh, u, reaction, linear), u, 0.0)

    def _along(self, scene: Scene, mesh: Mesh, tolerance: float) -> Pilot:
        """Follow the path to all poses in few steps, or in more where it snaps or ends."""
        each, most = 1, self.scene.steps.count
        poses = round(1 / float(np.diff([0.0, *self.fractions]).min()))
        while True:
            count = min(each, -(-most // poses)) * poses
            found = solve(replace(scene, steps=replace(scene.steps, count=count)), mesh=mesh, tolerance=tolerance,
                          small_strain=self.small_strain, partial=True, look=False)
            if not (found.failure or found.snap.any()) or count >= most:
                break
            each *= 4
        if found.failure:
            raise NoEquilibrium(f"on {len(mesh.points)} nodes: {found.failure}", found)
        if not found.linear_steps:
            self.small_strain = 0.0
        frames = [round(count * float(fraction)) for fraction in self.fractions]
        return Pilot(mesh, self.of(scene, found, frames), found.displacement[frames], 0.0)


def cost(nodes: float, family: MeshFamily) -> float:
    """Of a step on a mesh of a family, in units of its own."""
    d = family.dimension
    return float((nodes + IDLE[d]) ** POWER[d]) * (SECOND[d] if family.order == 2 else 1.0)


def few(scene: Scene) -> int:
    """How many poses tell of a path: more where it goes by way-points or tables."""
    return max(POSES, 2 * min(max((len(way) - 1 for way in ways(scene)), default=1), 10))


def ways(scene: Scene) -> list[list[float]]:
    """Fractions of the loading of the way-points of each obstacle and the rows of each table."""
    tables = [load.steps for load in scene.load] + [support.steps for support in scene.support]
    return [Rigid(obstacle).reached.tolist() for obstacle in scene.obstacles] + [list(steps) for steps in tables if steps is not None]


def turns(scene: Scene) -> list[float]:
    """Fractions of the loading between which all that a scene says goes on evenly, 0 and 1 among them."""
    return sorted({0.0, 1.0, *(fraction for way in ways(scene) for fraction in way)})


def _stress(scene: Scene, mesh: Mesh, u: Floats, linear: list[bool]) -> Any:
    """(K, N) von Mises stress at the nodes, by the law that each pose was solved with; 0 where it is of rounding."""
    at_nodes = recovery(mesh, scene.material)
    small = scene.under("linear").material
    found = np.array([von_mises_of(nodal_stress(mesh, one, small if how else scene.material, at_nodes))
                      for one, how in zip(u, linear, strict=True)])
    least = STRAIN * scene.stiffest * abs(u).max(axis=(1, 2)) / float(mesh.extent.max())
    return np.where(found > least[:, None], found, 0.0)
