"""Rigid obstacles: where they are, how far a point is from them, and their surface as a mesh.

The gap of a point x is its signed distance g(x) to the obstacle's surface, negative inside; its gradient n is the
normal that points from the obstacle to x.

Each shape is a class with its distance, its curvature, its extents and its mesh (shapes.py, tool.py), listed in SHAPES; which keys of a
scene it needs stands in physics/scene/parts.py. `Rigid` moves one along a path.

Legend: K obstacles, Q points, P surface nodes, F triangles.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from physics.contact.shapes import Box, Capsule, Cylinder, HalfSpace, Shape, Sphere
from physics.contact.surfaces import Surface, disc, divide
from physics.contact.tool import Tool
from physics.mesh.mesh import Mesh
from physics.mesh.transfer import interpolate
from physics.scene import Obstacle

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FINEST = 100  # edges along a side, or half around
RAYS = 720  # by which the outline of a section is found
COARSE = 8  # edges along an obstacle or a body where only whether one lies in the other counts

SHAPES: dict[str, Callable[[Obstacle], Shape]] = {
    "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule, "box": Box, "half-space": HalfSpace, "mesh": Tool}


class Rigid:
    """A rigid obstacle on its prescribed path (W, 3) [m], whose way-points are reached at fractions (W,) of the steps."""

    def __init__(self, obstacle: Obstacle) -> None:
        self.shape: Shape = SHAPES[obstacle.shape](obstacle)
        self.path = np.array(obstacle.path)
        self.reached = np.linspace(0.0, 1.0, len(self.path)) if obstacle.steps is None else np.array(obstacle.steps)
        self._speed = np.diff(self.path, axis=0) / np.diff(self.reached)[:, None]

    @property
    def width(self) -> float:
        """The smallest extent [m]; infinite for a half-space."""
        return self.shape.width

    @property
    def each(self) -> tuple[Rigid, ...]:
        """This one, as the only one; these five are what several have as well (several.py)."""
        return (self,)

    def among(self, points: NDArray[np.int64]) -> Rigid:
        """The obstacle of some points: this one."""
        return self

    def offset(self, points: Floats, centre: Floats) -> Floats:
        """(Q, 3) points seen from the centre."""
        return points - centre

    def along(self, normal: Floats, vector: Floats) -> Floats:
        """(Q,) parts of a vector (3,) along normals (Q, 3)."""
        return normal @ vector

    def sums(self, force: Floats, normal: Floats) -> Floats:
        """(1, 3) the sum of forces (Q,) along normals (Q, 3)."""
        return (force @ normal)[None]

    def position(self, fraction: float) -> Floats:
        """(3,) centre [m] at a fraction 0 .. 1 of the steps; between way-points on a straight line."""
        last = bisect_right(self.reached, fraction) - 1  # way-point that was passed
        if last == len(self._speed) or self.reached[last] == fraction:
            return self.path[last]
        return self._speed[last] * (fraction - self.reached[last]) + self.path[last]

    def gap(self, points: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Signed distances (Q,) [m] and normals (Q, 3) of points (Q, 3) for an obstacle at a centre (3,)."""
        return self.shape.gap(points - centre)

    def bend(self, points: Floats, centre: Floats) -> Floats:
        """(Q, 2, 3) [1/m^0.5] vectors t along the surface whose sum of t t^T is the second derivative of the gap there."""
        return self.shape.bend(points - centre)

    def surface_mesh(self, body: Floats, *, size: float, plane: bool = False) -> Surface:
        """The surface with the centre at path[0]: points (P, 3) and outward triangles (F, 3); for a plane body its section with z = 0.

        Args:
            body: (N, 3) rest positions of the body; a cylinder reaches past it by one edge on either side, a half-space is
                shown as a square as large as the body
            size: edge length aimed at [m]; an obstacle much larger than that is drawn with longer ones
        """
        if plane:
            points, triangles = disc(self._outline(body - self.path[0], size), size)
            return self.path[0] + points, triangles
        frame = self.shape.frame
        points, triangles = self.shape.mesh((body - self.path[0]) @ frame.T, max(size, self.shape.extent / FINEST))
        return self.path[0] + points @ frame, triangles

    def _outline(self, body: Floats, size: float) -> Floats:
        """(P, 3) counter-clockwise around the section with the plane z = 0, its centre at the origin; a half-space as deep as an edge."""
        if np.isinf(self.width):
            inward = -self.shape.gap(np.zeros((1, 3)))[1][0]
            along = np.array([inward[1], -inward[0], 0.0])
            from_, to = (body @ along).min() - size, (body @ along).max() + size
            line = divide(from_, to, size)[:, None] * along
            return np.concatenate([line, (line + size * inward)[::-1]])
        angle = 2 * np.pi * np.arange(RAYS) / RAYS
        ray = np.stack([np.cos(angle), np.sin(angle), np.zeros(RAYS)], axis=1)
        near, far = np.zeros(RAYS), np.full(RAYS, self.width + 2 * self.shape.extent)
        for _ in range(60):  # the section is convex and the centre lies in it
            middle = (near + far) / 2
            inside = self.shape.gap(middle[:, None] * ray)[0] < 0
            near, far = np.where(inside, middle, near), np.where(inside, far, middle)
        dense = np.concatenate([near[:, None] * ray, near[:1, None] * ray[:1]])
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
        at = np.linspace(0.0, way[-1], max(8, round(way[-1] / max(size, self.shape.extent / FINEST))), endpoint=False)
        return np.stack([np.interp(at, way, component) for component in dense.T], axis=1)


class Rigids:
    """Several obstacles, felt as one: each by its own points of the body's surface, one set of points after the other.

    A point that can touch two of them stands there twice, with two gaps and two forces. What `Rigid` says where there is one, `Rigids`
    says of all points, and of a part of them by `among`; `of` (Q,) is the number of the obstacle that each may touch, centres are (K, 3).
    """

    def __init__(self, each: Sequence[Rigid], of: Integers) -> None:
        self.each, self._of, self.width = tuple(each), of, min(rigid.width for rigid in each)

    def among(self, points: Integers) -> Rigids:
        """The same for some of the points."""
        return Rigids(self.each, self._of[points])

    def position(self, fraction: float) -> Floats:
        """(K, 3) centres [m] at a fraction 0 .. 1 of the steps."""
        return np.array([rigid.position(fraction) for rigid in self.each])

    def offset(self, points: Floats, centre: Floats) -> Floats:
        """(Q, 3) points seen from the centre of their obstacle."""
        return points - centre[self._of]

    def gap(self, points: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Signed distances (Q,) [m] and normals (Q, 3) of points (Q, 3)."""
        gap, normal = np.empty(len(points)), np.empty((len(points), 3))
        for k, rigid in enumerate(self.each):
            own = self._of == k
            gap[own], normal[own] = rigid.gap(points[own], centre[k])
        return gap, normal

    def bend(self, points: Floats, centre: Floats) -> Floats:
        """(Q, 2, 3) what `Rigid.bend` gives."""
        found = np.empty((len(points), 2, 3))
        for k, rigid in enumerate(self.each):
            found[self._of == k] = rigid.bend(points[self._of == k], centre[k])
        return found

    def along(self, normal: Floats, vector: Floats) -> Floats:
        """(Q,) parts of the vectors (K, 3) of the obstacles along normals (Q, 3)."""
        return np.asarray((normal * vector[self._of]).sum(axis=1))

    def sums(self, force: Floats, normal: Floats) -> Floats:
        """(K, 3) of each obstacle the sum of forces (Q,) along normals (Q, 3)."""
        return np.array([force[self._of == k] @ normal[self._of == k] for k in range(len(self.each))])


def buried(rigid: Rigid, mesh: Mesh) -> bool:
    """Whether a piece of an obstacle starts wholly within a body, where no facet of the body is near enough to feel it."""
    size = max(rigid.shape.extent, float(mesh.extent.max())) / COARSE
    points, triangles = rigid.surface_mesh(mesh.points, size=size, plane=mesh.dimension == 2)
    edges = scipy.sparse.csr_matrix((np.ones(triangles.size), (triangles.ravel(), np.roll(triangles, 1, axis=1).ravel())),
                                    shape=(len(points), len(points)))
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    pieces, piece = connected_components(edges, directed=False)
    for k in range(pieces):
        corner = points[piece == k]
        if (corner >= low).all() and (corner <= high).all():
            try:
                interpolate(mesh, np.zeros((1, *mesh.points.shape)), corner)
            except ValueError:  # some of them lie in no cell
                continue
            return True
    return False
