"""Shapes of rigid obstacles, seen from their centre: distance, normal, curvature, extents and mesh.

With p = x - centre, axis a, radius r:

    sphere       |p| - r
    cylinder     |p - (p.a) a| - r                           without ends; its mesh is as long as the body asks for
    capsule      |p - clamp(p.a, -l/2, l/2) a| - r           a segment of length l, r all around
    box          |max(q, 0)| + min(max q, 0) - r             q = |p| - size/2 + r by components: edges rounded with r
    half-space   p.a                                         everything behind the plane through the centre

A box may be turned: p is then seen in its own axes. Where the surface is round its normal turns with the point:
d2g/dx2 = (1 - n n^T) / d on a sphere, d the distance from its centre, and without the direction of the axis on a cylinder or an edge.

Legend: Q points, P surface nodes, F triangles.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physics.contact.surfaces import Surface, box, capped, divide, rounded, square, turned
from physics.scene import Obstacle

Floats = NDArray[np.float64]


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

    def reach(self, direction: Floats) -> float:
        """How far the surface lies from the centre in a direction (3,) of length 1 [m]; infinite where it has no end."""

    def mesh(self, along: Floats, size: float) -> Surface:
        """The surface about the centre in its frame, for a body at (N, 3) in this frame and edges of a size [m]."""


class Round:
    """All points at the distance r from a core: a point, a line or a segment along the axis.

    half: [m] of the length of the core; anywhere: (3,) the normal on the core itself, where every direction is as good as any
    """

    half = 0.0

    def __init__(self, obstacle: Obstacle) -> None:
        assert obstacle.radius is not None
        self.radius, self.axis, self.length = obstacle.radius, _unit(obstacle.axis), obstacle.length or 0.0
        self.frame = _frame(self.axis)
        self.anywhere = _across(self.axis)
        self.width, self.extent = 2 * self.radius, max(np.pi * self.radius, self.length)

    def core(self, along: Floats) -> Floats:
        """(Q,) [m] where on the axis the nearest point of the core is, for points at (Q,) along it."""
        return np.clip(along, -self.half, self.half)

    def gap(self, offset: Floats) -> tuple[Floats, Floats]:
        offset = offset - self.core(offset @ self.axis)[:, None] * self.axis
        distance = np.sqrt((offset * offset).sum(axis=1))[:, None]
        if distance.min(initial=1.0) > 0:
            return distance[:, 0] - self.radius, offset / distance
        far = distance > 0
        return distance[:, 0] - self.radius, np.where(far, offset / np.where(far, distance, 1.0), self.anywhere)

    def bend(self, offset: Floats) -> Floats:
        (gap, normal), along = self.gap(offset), offset @ self.axis
        return _bend(normal, gap + self.radius, self.axis, (self.core(along) != along) | (self.half == 0))


class Sphere(Round):
    def reach(self, direction: Floats) -> float:
        return self.radius

    def mesh(self, along: Floats, size: float) -> Surface:
        return capped(self.radius, 0.0, size)


class Cylinder(Round):
    half = float("inf")

    def reach(self, direction: Floats) -> float:
        return self.radius if abs(self.axis @ direction) <= 1e-9 else float("inf")

    def mesh(self, along: Floats, size: float) -> Surface:
        heights = divide(along[:, 2].min() - size, along[:, 2].max() + size, size)
        return turned(np.full(len(heights), self.radius), heights, size)


class Capsule(Round):
    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(obstacle)
        self.half = self.length / 2

    def reach(self, direction: Floats) -> float:
        return self.radius + self.half * abs(float(self.axis @ direction))

    def mesh(self, along: Floats, size: float) -> Surface:
        return capped(self.radius, self.length, size)


class Box:
    """A box along the coordinate axes, or turned, its edges and corners rounded."""

    def __init__(self, obstacle: Obstacle) -> None:
        assert obstacle.size is not None
        self.radius, self.half, self.frame = obstacle.radius or 0.0, np.array(obstacle.size) / 2, rotation(obstacle).T
        self._turned = bool(obstacle.angle)
        self.width, self.extent = float(2 * self.half.min()), float(max(np.pi * self.radius, 2 * self.half.max()))

    def gap(self, offset: Floats) -> tuple[Floats, Floats]:
        if not self._turned:
            return self._gap(offset)
        gap, normal = self._gap(offset @ self.frame.T)
        return gap, normal @ self.frame

    def _gap(self, offset: Floats) -> tuple[Floats, Floats]:
        """The same in the box's own axes."""
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
        if self._turned:
            offset = offset @ self.frame.T
        gap, normal = self._gap(offset)
        beyond = abs(offset) > self.half - self.radius  # (Q, 3) the components in which a point lies beyond the faces
        distance = np.where(beyond.sum(axis=1) > 1, gap + self.radius, 0.0)
        found = _bend(normal, distance, np.eye(3)[beyond.argmin(axis=1)], beyond.all(axis=1))
        return found @ self.frame if self._turned else found

    def reach(self, direction: Floats) -> float:
        share = abs(self.frame @ direction)
        return float(self.half @ share) - self.radius * (float(share.sum()) - 1)

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

    def reach(self, direction: Floats) -> float:
        return 0.0

    def mesh(self, along: Floats, size: float) -> Surface:
        middle, reach = (along.max(axis=0) + along.min(axis=0)) / 2, np.ptp(along[:, :2], axis=0).max() / 2 + size
        return square(middle[:2], reach, size)


def rotation(obstacle: Obstacle) -> Floats:
    """(3, 3) by which an obstacle is turned: `angle` [degrees] about `axis`."""
    if not obstacle.angle:
        return np.eye(3)
    return np.asarray(Rotation.from_rotvec(np.radians(obstacle.angle) * _unit(obstacle.axis)).as_matrix())


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
    if ball.any():
        across = _cross(normal, np.eye(3)[abs(normal).argmin(axis=1)])
        straight = np.where(ball[:, None], across / np.linalg.norm(across, axis=1, keepdims=True), straight)
        found[:, 1] = straight * size * ball[:, None]
    found[:, 0] = _cross(straight, normal) * size
    return found


def _cross(a: Floats, b: Floats) -> Floats:
    """Vector products (Q, 3) of vectors (Q, 3) or (3,): np.cross, which takes three times as long for a few."""
    first, second = [1, 2, 0], [2, 0, 1]
    return a[..., first] * b[..., second] - a[..., second] * b[..., first]
