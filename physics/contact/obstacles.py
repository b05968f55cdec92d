"""Rigid obstacles: where they are, how far a point is from them, and their surface as a mesh.

The gap of a point x is its signed distance g(x) to the obstacle's surface, negative inside; its gradient n is the
normal that points from the obstacle to x. With p = x - centre, axis a, radius r:

    sphere       |p| - r
    cylinder     |p - (p.a) a| - r                           without ends; its mesh is as long as the body asks for
    capsule      |p - clamp(p.a, -l/2, l/2) a| - r           a segment of length l, r all around
    box          |max(q, 0)| + min(max q, 0) - r             q = |p| - size/2 + r by components: edges rounded with r
    half-space   p.a                                         everything behind the plane through the centre

Each shape is a class with its distance, its curvature, its extents and its mesh, listed in SHAPES; which keys of a scene it needs stands in
physics/scene/parts.py. `Rigid` moves one along a path.
Where the surface is round its normal turns with the point: d2g/dx2 = (1 - n n^T) / d on a sphere, d the distance from its
centre, and without the direction of the axis on a cylinder or an edge.

Legend: Q points, P surface nodes, F triangles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physics.contact.surfaces import Surface, box, capped, disc, divide, rounded, square, turned
from physics.scene import Obstacle

Floats = NDArray[np.float64]

FINEST = 100  # edges along a side, or half around
RAYS = 720  # by which the outline of a section is found


class Shape(Protocol):
    """What an obstacle looks like, seen from its centre.

    Attributes:
        frame: (3, 3) rows are the axes that `mesh` speaks of, the third one the obstacle's own
        width: the smallest extent [m]; infinite for a half-space
        extent: the largest length along which it is curved or divided [m]
    """

    frame: Floats
    width: float
    extent: float

    def gap(self, offset: Floats) -> tuple[Floats, Floats]:
        """Signed distances (Q,) [m] and normals (Q, 3) of points at offsets (Q, 3) from the centre."""

    def bend(self, offset: Floats) -> Floats:
        """(Q, 2, 3) [1/m^0.5] vectors t along the surface whose sum of t t^T is the second derivative of the gap there."""

    def reach(self, axis: int) -> float:
        """How far the surface lies from the centre along a coordinate axis [m]; infinite where it has no end."""

    def mesh(self, along: Floats, size: float) -> Surface:
        """The surface about the centre in its frame, for a body at (N, 3) in this frame and edges of a size [m]."""


class _Round:
    """All points at the distance r from a core: a point, a line or a segment along the axis."""

    def __init__(self, obstacle: Obstacle) -> None:
        assert obstacle.radius is not None
        self.radius, self.axis, self.length = obstacle.radius, _unit(obstacle.axis), obstacle.length or 0.0
        self.frame = _frame(self.axis)
        self._anywhere = _across(self.axis)
        self.width, self.extent = 2 * self.radius, max(np.pi * self.radius, self.length)

    def core(self, along: Floats) -> Floats:
        """(Q,) [m] where on the axis the nearest point of the core is, for points at (Q,) along it."""
        raise NotImplementedError

    def gap(self, offset: Floats) -> tuple[Floats, Floats]:
        offset = offset - self.core(offset @ self.axis)[:, None] * self.axis
        distance = np.sqrt((offset * offset).sum(axis=1))
        # On the core itself every direction is as good as any: take a fixed one.
        normal = np.divide(offset, distance[:, None], out=np.tile(self._anywhere, (len(offset), 1)), where=distance[:, None] > 0)
        return distance - self.radius, normal

    def bend(self, offset: Floats) -> Floats:
        gap, normal = self.gap(offset)
        return _bend(normal, gap + self.radius, self.axis, self.core(offset @ self.axis) != offset @ self.axis)


class Sphere(_Round):
    def core(self, along: Floats) -> Floats:
        return np.zeros_like(along)

    def bend(self, offset: Floats) -> Floats:
        gap, normal = self.gap(offset)
        return _bend(normal, gap + self.radius, self.axis, np.ones(len(offset), bool))

    def reach(self, axis: int) -> float:
        return self.radius

    def mesh(self, along: Floats, size: float) -> Surface:
        return capped(self.radius, 0.0, size)


class Cylinder(_Round):
    def core(self, along: Floats) -> Floats:
        return along

    def reach(self, axis: int) -> float:
        return self.radius if abs(self.axis[axis]) <= 1e-9 else float("inf")

    def mesh(self, along: Floats, size: float) -> Surface:
        heights = divide(along[:, 2].min() - size, along[:, 2].max() + size, size)
        return turned(np.full(len(heights), self.radius), heights, size)


class Capsule(_Round):
    def core(self, along: Floats) -> Floats:
        return np.clip(along, -self.length / 2, self.length / 2)

    def reach(self, axis: int) -> float:
        return self.radius + self.length / 2 * abs(float(self.axis[axis]))

    def mesh(self, along: Floats, size: float) -> Surface:
        return capped(self.radius, self.length, size)


class Box:
    """A box along the coordinate axes, its edges and corners rounded."""

    def __init__(self, obstacle: Obstacle) -> None:
        assert obstacle.size is not None
        self.radius, self.half, self.frame = obstacle.radius or 0.0, np.array(obstacle.size) / 2, np.eye(3)
        self.width, self.extent = float(2 * self.half.min()), float(max(np.pi * self.radius, 2 * self.half.max()))

    def gap(self, offset: Floats) -> tuple[Floats, Floats]:
        beyond = abs(offset) - self.half + self.radius
        outside = np.maximum(beyond, 0)
        distance = np.sqrt((outside * outside).sum(axis=1))
        nearest = np.eye(3)[beyond.argmax(axis=1)]  # inside, the closest face
        direction = np.where(distance[:, None] > 0, outside, nearest) * np.where(offset < 0, -1.0, 1.0)
        length = np.where(distance > 0, distance, 1.0)
        return distance + np.minimum(beyond.max(axis=1), 0) - self.radius, direction / length[:, None]

    def bend(self, offset: Floats) -> Floats:
        if not self.radius:  # what touches a sharp edge lies inside, on a face
            return np.zeros((len(offset), 2, 3))
        gap, normal = self.gap(offset)
        beyond = abs(offset) > self.half - self.radius  # (Q, 3) the components in which a point lies beyond the faces
        distance = np.where(beyond.sum(axis=1) > 1, gap + self.radius, 0.0)
        return _bend(normal, distance, np.eye(3)[beyond.argmin(axis=1)], beyond.all(axis=1))

    def reach(self, axis: int) -> float:
        return float(self.half[axis])

    def mesh(self, along: Floats, size: float) -> Surface:
        return rounded(*box(self.half, size), self.half, self.radius)


class HalfSpace:
    """Everything behind the plane through the centre."""

    width, extent = float("inf"), 0.0

    def __init__(self, obstacle: Obstacle) -> None:
        assert obstacle.normal is not None
        self.normal = _unit(obstacle.normal)
        self.frame = _frame(self.normal)

    def gap(self, offset: Floats) -> tuple[Floats, Floats]:
        return offset @ self.normal, np.broadcast_to(self.normal, offset.shape)

    def bend(self, offset: Floats) -> Floats:
        return np.zeros((len(offset), 2, 3))

    def reach(self, axis: int) -> float:
        return 0.0

    def mesh(self, along: Floats, size: float) -> Surface:
        middle, reach = (along.max(axis=0) + along.min(axis=0)) / 2, np.ptp(along[:, :2], axis=0).max() / 2 + size
        return square(middle[:2], reach, size)


SHAPES: dict[str, Callable[[Obstacle], Shape]] = {
    "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule, "box": Box, "half-space": HalfSpace}


class Rigid:
    """A rigid obstacle on its prescribed path (W, 3) [m], whose way-points are reached at fractions (W,) of the steps."""

    def __init__(self, obstacle: Obstacle) -> None:
        self.shape: Shape = SHAPES[obstacle.shape](obstacle)
        self.path = np.array(obstacle.path)
        self.reached = np.linspace(0.0, 1.0, len(self.path)) if obstacle.steps is None else np.array(obstacle.steps)

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
        return np.array([np.interp(fraction, self.reached, component) for component in self.path.T])

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


def _unit(vector: tuple[float, float, float]) -> Floats:
    return np.array(vector) / np.linalg.norm(vector)


def _across(axis: Floats) -> Floats:
    """A unit vector normal to an axis."""
    across = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
    return across / np.linalg.norm(across)


def _frame(axis: Floats) -> Floats:
    first = _across(axis)
    return np.stack([first, np.cross(axis, first), axis])


def _bend(normal: Floats, distance: Floats, straight: Floats, ball: NDArray[np.bool_]) -> Floats:
    """What `Shape.bend` gives for points at distances (Q,) from the centre of curvature, 0 where the surface is flat.

    straight: (3,) or (Q, 3) the direction in which it does not curve; ball: (Q,) where it curves in both
    """
    found = np.zeros((len(normal), 2, 3))
    size = np.sqrt(np.divide(1.0, distance, out=np.zeros(len(normal)), where=distance > 0))[:, None]
    across = np.cross(normal, np.eye(3)[abs(normal).argmin(axis=1)])
    straight = np.where(ball[:, None], across / np.linalg.norm(across, axis=1, keepdims=True), straight)
    found[:, 1] = straight * size * ball[:, None]
    found[:, 0] = np.cross(straight, normal) * size
    return found
