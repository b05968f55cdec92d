"""A body of any shape under an obstacle, and what a network is shown of a pose.

Where supports alone hold the body and nothing loads it but a rigid, frictionless obstacle, what it does depends on the pose of the
obstacle, on shapes and on Poisson's ratio; Young's modulus and the way that led there play no part, as long as it does not snap.

A pose is told by numbers that do not depend on the size of the body, in the frame of its bounding box: where the obstacle's centre
is; how deep it overlaps the body at rest; the box; the obstacle; means of polynomials over the volume, in which outlines and holes show;
the same over the faces that are held, component by component. So finer and coarser meshes of one body, and meshes of other cells, are
told alike.

Legend: N nodes, Q points of the surface, P poses, A features. [m]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.contact.obstacles import Rigid
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.mesh.quality import cell_volumes
from physics.scene import Obstacle, Scene
from physics.schema import InputError

Floats = NDArray[np.floating[Any]]
Weighed = tuple[Floats, Floats]  # points and their weights
FEW = 8  # poses at which it is seen which points of the surface the obstacle comes near to
NEXT = 0.1  # of the thickness: where the gap is larger by so much, a point counts 1/e
LOOKS = 16  # poses between which the first touch is looked for, and again between two of these
KINDS = ("sphere", "cylinder", "capsule", "box", "half-space")  # of obstacles, in the order in which the network is shown them


@dataclass(frozen=True)
class PressedBody:
    """points (N, 3) at rest; held (N, 3) True on components that are held; surface (Q, 3) points where the obstacle may touch; obstacle
    on one straight line; poisson_ratio, law: of the material. Points that integrate polynomials of degree 2: inside (I, 3) the body, with
    weights (I,) over the volume of the box, and seats (J, 3) on what is held, with weights (J, 3) by component, whose sums are 1 or 0."""

    points: Floats
    held: NDArray[np.bool_]
    surface: Floats
    obstacle: Obstacle
    poisson_ratio: float
    law: str
    inside: Weighed
    seats: Weighed

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
        return -self._gaps(self._near, fraction).min(axis=1)

    @cached_property
    def _near(self) -> Floats:
        """(.., 3) the points of the surface that may lie deepest at some pose: from one pose to another a gap changes by their distance at
        most, so that others are not among those whose gap is within that, for them and for the deepest, of the least."""
        looks = np.linspace(0.0, 1.0, FEW)
        gap = self._gaps(self.surface, looks)
        way = float(np.linalg.norm(np.diff(self.centre(looks[:2]), axis=0)))
        return self.surface[(gap <= gap.min(axis=1, keepdims=True) + way * (1 + 1e-9)).any(axis=0)]

    def _gaps(self, points: Floats, fraction: Floats) -> Floats:
        """(P, n) of points (n, 3) at fractions (P,) of the path."""
        gap, _ = Rigid(self.obstacle).shape.gap((points - self.centre(fraction)[:, None]).reshape(-1, 3))
        return gap.reshape(len(fraction), -1)

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

    @cached_property
    def touch(self) -> Floats:
        """(3,) where the obstacle first touches: the mean of the points of the surface, those counting that it is next to then."""
        gap = self._gap(self.surface)
        weight = np.exp((gap.min() - gap) / (NEXT * self.extent.min()))
        return np.asarray(weight @ self.surface / weight.sum())

    def aside(self, points: Floats) -> Floats:
        """(..,) squares of how far points (.., 3) lie aside of the first touch [m2]: g (g + 2 R) for a gap g to the obstacle there and its
        radius R, which for a point on a face is the square of the distance in the face: from the touch of a sphere, the line of a
        cylinder, the flat part of a rounded box."""
        gap = np.maximum(self._gap(points), 0.0)
        return np.asarray(gap * (gap + 2 * (self.obstacle.radius or 0.0)))

    def _gap(self, points: Floats) -> Floats:
        return self._gaps(points, np.array([self.first_touch]))[0]

    def mirrored(self, axis: int) -> PressedBody:
        """The body in a mirror that is normal to an axis and goes through the middle of the box."""
        signs, twice = np.where(np.arange(3) == axis, -1.0, 1.0), np.where(np.arange(3) == axis, 2 * self.low + self.extent, 0.0)
        path = np.array(self.obstacle.path) * signs + twice
        turned: dict[str, Any] = {"axis": tuple(np.array(self.obstacle.axis) * signs), "path": tuple(map(tuple, path))}
        if self.obstacle.normal is not None:
            turned["normal"] = tuple(np.array(self.obstacle.normal) * signs)
        return replace(self, points=self.points * signs + twice, surface=self.surface * signs + twice,
                       inside=(self.inside[0] * signs + twice, self.inside[1]), seats=(self.seats[0] * signs + twice, self.seats[1]),
                       obstacle=replace(self.obstacle, **turned))

    def shown(self, fraction: Floats) -> tuple[Floats, Floats]:
        """(P, A) features and (P,) depths [m] at fractions of the path."""
        depth, (long, short) = self.depth(fraction), (self.extent.max(), self.extent.min())
        deep = np.maximum(depth, 0.0)
        places = self.box(self.centre(fraction))
        pose = [*places.T, depth / long, deep / short, np.sqrt(deep / long)]
        fixed = np.concatenate([np.log(self.extent / long), [long / short, self.poisson_ratio, self.law == "neo-hookean"],
                                self._obstacle(long, short), self._moments(*self.inside),
                                *self._moments(*self.seats).T])
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

    def _moments(self, points: Floats, weight: Floats) -> Floats:
        """(10, ..) sums of 1, of x, y, z and of their products in the box, for points (I, 3) and weights (I, ..)."""
        x = self.box(points)
        products = x[:, :, None] * x[:, None, :]
        return np.asarray(np.column_stack([np.ones(len(x)), x, products[:, *np.triu_indices(3)]]).T @ weight)


def shown_signs(axis: int) -> Floats:
    """(A,) what a mirror normal to an axis makes of features, as factors."""
    one = np.where(np.arange(3) == axis, -1.0, 1.0)
    two = np.outer(one, one)[np.triu_indices(3)]
    return np.concatenate([one, np.ones(3 + 6 + len(KINDS) + 7), two, one, np.tile(np.concatenate([[1.0], one, two]), 4)])


def see(scene: Scene, mesh: Mesh) -> PressedBody:
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
    return PressedBody(np.asarray(mesh.points, float), fixed, _surface(mesh, obstacle.contact == "nodes"), obstacle,
                       material.poisson_ratio, material.law, _inside(mesh), _seats(mesh, fixed))


def _inside(mesh: Mesh) -> Weighed:
    """Of a body, where its cells have their points; in cells with bent sides nearly so."""
    rule = CELLS[mesh.cell.replace("tetrahedron", "tetrahedron10")]  # whose is of degree 2
    volume = cell_volumes(mesh.points, mesh.cells, mesh.cell) / np.ptp(mesh.points, axis=0).prod()
    points = CELLS[mesh.cell].shapes(rule.points)[0] @ mesh.points[mesh.cells]  # (C, points of the rule, 3)
    return points.reshape(-1, 3), np.outer(volume, rule.weights / rule.weights.sum()).ravel()


def _seats(mesh: Mesh, held: NDArray[np.bool_]) -> Weighed:
    """Of a body, corners and middles of facets of which all corners are held; of a component that is held on no facet, its nodes."""
    points, weights = [], []
    for facets in mesh.boundary:
        corners, count = mesh.points[facets], facets.shape[1]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0]), axis=1) * (1.0 if count > 3 else 0.5)
        borne = held[facets].all(axis=1) * area[:, None]  # (F, 3)
        part = 1 / 3 if count > 3 else 1 / 4  # of the weight at the corners
        points += [corners.reshape(-1, 3), corners.mean(axis=1)]
        weights += [np.repeat(borne * part / count, count, axis=0), borne * (1 - part)]
    some = held * (np.concatenate(weights).sum(axis=0) == 0)
    weight = np.concatenate([*weights, some])
    kept = weight.any(axis=1)
    return np.concatenate([*points, mesh.points])[kept], weight[kept] / np.maximum(weight.sum(axis=0), 1e-300)


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
