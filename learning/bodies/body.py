"""A body of any shape under an obstacle, and what a network is shown of a pose.

Where supports alone hold the body and nothing loads it but a rigid, frictionless obstacle, what it does depends on the pose of the
obstacle, on shapes and on Poisson's ratio; Young's modulus and the way that led there play no part, as long as it does not snap.

A pose is told by numbers that do not depend on the size of the body, in the frame of its bounding box: where the obstacle's centre
is; how deep it overlaps the body at rest; the box; the obstacle; means of polynomials over the nodes, in which holes show; the same over
the nodes that are held, component by component.

Legend: N nodes, Q points of the surface, P poses, A features. [m]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.contact.obstacles import Rigid
from physics.mesh.mesh import Mesh
from physics.scene import Obstacle, Scene
from physics.schema import InputError

Floats = NDArray[np.floating[Any]]
LOOKS = 16  # poses between which the first touch is looked for, and again between two of these
KINDS = ("sphere", "cylinder", "capsule", "box", "half-space")  # of obstacles, in the order in which the network is shown them


@dataclass(frozen=True)
class Body:
    """points (N, 3) at rest; held (N, 3) True on components that are held; surface (Q, 3) points where the obstacle may touch;
    obstacle on one straight line; poisson_ratio, law: of the material; nodal: contact is felt at nodes alone."""

    points: Floats
    held: NDArray[np.bool_]
    surface: Floats
    obstacle: Obstacle
    poisson_ratio: float
    law: str

    @cached_property
    def low(self) -> Floats:
        """(3,) corner of the box."""
        return self.points.min(axis=0)

    @cached_property
    def extent(self) -> Floats:
        """(3,) of the box."""
        return np.ptp(self.points, axis=0)

    @property
    def free(self) -> NDArray[np.bool_]:
        """(N,) True on nodes of which not all is held: those that errors are of."""
        return ~self.held.all(axis=1)

    def box(self, points: Floats) -> Floats:
        """Places (.., 3) in the box, -1 to 1."""
        return 2 * (points - self.low) / self.extent - 1

    def centre(self, fraction: Floats) -> Floats:
        """(P, 3) of the obstacle at fractions of its path."""
        start, end = np.array(self.obstacle.path)
        return start + np.asarray(fraction)[:, None] * (end - start)

    def depth(self, fraction: Floats) -> Floats:
        """(P,) by how much the obstacle overlaps the body at rest; negative where it does not reach it."""
        shape, centres = Rigid(self.obstacle).shape, self.centre(fraction)
        gap, _ = shape.gap((self.surface - centres[:, None]).reshape(-1, 3))
        return -gap.reshape(len(centres), -1).min(axis=1)

    @cached_property
    def first_touch(self) -> float:
        """The fraction of the path at which the obstacle reaches the body at rest; 1 where it never does."""
        low, high = 0.0, 1.0
        for _ in range(2):
            fraction = np.linspace(low, high, LOOKS)
            depth = self.depth(fraction)
            after = int((depth > 0).argmax())
            if depth[after] <= 0:
                return 1.0
            if after == 0:
                return low
            low, high = fraction[after - 1], fraction[after]
        return float(low - depth[after - 1] * (high - low) / (depth[after] - depth[after - 1]))

    def mirrored(self, axis: int) -> Body:
        """The body in a mirror that is normal to an axis and goes through the middle of the box."""
        signs, twice = np.where(np.arange(3) == axis, -1.0, 1.0), np.where(np.arange(3) == axis, 2 * self.low + self.extent, 0.0)
        path = np.array(self.obstacle.path) * signs + twice
        turned: dict[str, Any] = {"axis": tuple(np.array(self.obstacle.axis) * signs), "path": tuple(map(tuple, path))}
        if self.obstacle.normal is not None:
            turned["normal"] = tuple(np.array(self.obstacle.normal) * signs)
        return replace(self, points=self.points * signs + twice, surface=self.surface * signs + twice,
                       obstacle=replace(self.obstacle, **turned))

    def shown(self, fraction: Floats) -> tuple[Floats, Floats]:
        """(P, A) features and (P,) depths [m] at fractions of the path."""
        depth, (long, short) = self.depth(fraction), (self.extent.max(), self.extent.min())
        deep = np.maximum(depth, 0.0)
        places = self.box(self.centre(fraction))
        pose = [*places.T, depth / long, deep / short, np.sqrt(deep / long)]
        fixed = np.concatenate([np.log(self.extent / long), [long / short, self.poisson_ratio, self.law == "neo-hookean"],
                                self._obstacle(long, short), self._moments(np.ones(len(self.points))),
                                *(self._moments(self.held[:, k].astype(float)) for k in range(3))])
        return np.column_stack([*pose, np.tile(fixed, (len(depth), 1))]), depth

    def _obstacle(self, long: float, short: float) -> Floats:
        told, one = self.obstacle, np.zeros(6)
        if told.shape in ("cylinder", "capsule"):
            axis = np.array(told.axis) / np.linalg.norm(told.axis)
            one = np.outer(axis, axis)[np.triu_indices(3)]
        normal = np.zeros(3) if told.normal is None else np.array(told.normal) / np.linalg.norm(told.normal)
        radius, length = told.radius or 0.0, told.length or 0.0
        return np.concatenate([[told.shape == name for name in KINDS], [told.contact == "nodes", radius / long, radius / short,
                               length / long], np.array(told.size or (0.0, 0.0, 0.0)) / long, one, normal]).astype(float)

    def _moments(self, weight: Floats) -> Floats:
        """(10,) share of the nodes, and means of x, y, z and their products over the box, for weights (N,)."""
        x = self.box(self.points)
        products = x[:, :, None] * x[:, None, :]
        parts = np.column_stack([np.ones(len(x)), x, products[:, *np.triu_indices(3)]])
        return weight @ parts / len(x)


def see(scene: Scene, mesh: Mesh) -> Body:
    """The body of a scene. Raises `InputError` in one line for a scene that is not of this kind, saying what it would have to be."""
    obstacle = scene.obstacles[0] if scene.obstacles else None
    wrong = [
        (len(scene.obstacles) > 1, "it has several obstacles"), (len(scene.materials) > 1, "it has several materials"),
        (mesh.dimension != 3 or scene.body.order != 1, "the body is not a solid one of first-order cells"),
        (scene.steps.dynamic or bool(scene.load), "it has loads or inertia"),
        (not scene.support or any(any(s.displacement) or s.angle is not None for s in scene.support), "its supports move, or it has none"),
        (obstacle is None, "it has no obstacle"),
        (obstacle is not None and (obstacle.shape not in KINDS or bool(obstacle.angle)), "its obstacle is a turned box or of triangles"),
        (obstacle is not None and (len(obstacle.path) != 2 or obstacle.steps is not None), "its obstacle's path is not one straight line"),
    ]
    for is_wrong, words in wrong:
        if is_wrong:
            raise InputError(f"a predictor of bodies by shapes does not take this scene: {words}")
    assert obstacle is not None
    (material,) = scene.materials
    fixed = np.zeros(mesh.points.shape, bool)
    for support in scene.support:
        for letter in support.fixed:
            fixed[mesh.place(support.where), "xyz".index(letter)] = True
    return Body(np.asarray(mesh.points, float), fixed, _surface(mesh, obstacle.contact == "nodes"), obstacle,
                material.poisson_ratio, material.law)


def _surface(mesh: Mesh, nodal: bool) -> Floats:
    """(Q, 3) the points where contact is felt: nodes of the surface, and where it is felt on facets, middles of edges and facets."""
    points = mesh.points[np.unique(np.concatenate([facets.ravel() for facets in mesh.surface]))]
    if nodal:
        return points
    found = [points]
    for facets in mesh.surface:
        corners = mesh.points[facets]
        sides = np.sort(np.stack([facets, np.roll(facets, 1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        sides = np.unique(sides[:, 0] * len(mesh.points) + sides[:, 1])
        found.append((mesh.points[sides // len(mesh.points)] + mesh.points[sides % len(mesh.points)]) / 2)
        if facets.shape[1] == 4:
            found.append(corners.mean(axis=1))
    return np.concatenate(found)
