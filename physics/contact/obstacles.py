"""Rigid obstacles: where they are, how far a point is from them, and their surface as a mesh.

The gap of a point x is its signed distance g(x) to the obstacle's surface, negative inside; its gradient n is the
normal that points from the obstacle to x. With p = x - centre, axis a, radius r:

    sphere       |p| - r
    cylinder     |p - (p.a) a| - r                           without ends; its mesh is as long as the body asks for
    capsule      |p - clamp(p.a, -l/2, l/2) a| - r           a segment of length l, r all around
    box          |max(q, 0)| + min(max q, 0) - r             q = |p| - size/2 + r by components: edges rounded with r
    half-space   p.a                                         everything behind the plane through the centre

Where the surface is round its normal turns with the point: d2g/dx2 = (1 - n n^T) / d on a sphere, d the distance from its
centre, and without the direction of the axis on a cylinder or an edge.

Legend: Q points, P surface nodes, F triangles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.scene import Obstacle

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FINEST = 100  # edges along a side, or half around


class Rigid:
    """A rigid obstacle on its prescribed path."""

    def __init__(self, obstacle: Obstacle) -> None:
        self.shape, self.radius = obstacle.shape, obstacle.radius or 0.0
        self.path = np.array(obstacle.path)  # (W, 3)
        axis = np.array(obstacle.normal if obstacle.normal is not None else obstacle.axis)
        self.axis = axis / np.linalg.norm(axis)
        self.length = obstacle.length or 0.0
        self.half = np.array(obstacle.size or (0.0, 0.0, 0.0)) / 2

    @property
    def width(self) -> float:
        """The smallest extent [m]; infinite for a half-space."""
        if self.shape == "half-space":
            return float("inf")
        return float(2 * (self.half.min() if self.shape == "box" else self.radius))

    def position(self, fraction: float) -> Floats:
        """(3,) centre [m] at a fraction 0 .. 1 of the steps; way-points are reached at equal fractions."""
        where = np.linspace(0.0, 1.0, len(self.path))
        return np.array([np.interp(fraction, where, component) for component in self.path.T])

    def gap(self, points: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Signed distances (Q,) [m] and normals (Q, 3) of points (Q, 3) for an obstacle at a centre (3,)."""
        offset = points - centre
        along = offset @ self.axis
        if self.shape == "half-space":
            return along, np.broadcast_to(self.axis, points.shape)
        if self.shape == "box":
            return self._box(offset)
        if self.shape == "cylinder":
            offset = offset - along[:, None] * self.axis
        elif self.shape == "capsule":
            offset = offset - np.clip(along, -self.length / 2, self.length / 2)[:, None] * self.axis
        distance = np.sqrt((offset * offset).sum(axis=1))
        # On the axis itself every direction is as good as any: take a fixed one.
        normal = np.divide(offset, distance[:, None], out=np.tile(_across(self.axis), (len(points), 1)),
                           where=distance[:, None] > 0)
        return distance - self.radius, normal

    def bend(self, points: Floats, centre: Floats) -> Floats:
        """(Q, 2, 3) [1/m^0.5] vectors t along the surface whose sum of t t^T is the second derivative of the gap there."""
        found = np.zeros((len(points), 2, 3))
        if self.shape == "half-space" or not self.radius:  # what touches a sharp edge lies inside, on a face
            return found
        gap, normal = self.gap(points, centre)
        offset, curved = points - centre, gap + self.radius > 0
        straight = np.broadcast_to(self.axis, points.shape)
        ball = np.full(len(points), self.shape == "sphere")
        if self.shape == "capsule":
            ball = abs(offset @ self.axis) > self.length / 2
        elif self.shape == "box":
            beyond = abs(offset) > self.half - self.radius  # (Q, 3) the components in which a point lies beyond the faces
            ball, curved = beyond.all(axis=1), curved & (beyond.sum(axis=1) > 1)
            straight = np.eye(3)[beyond.argmin(axis=1)]
        size = np.sqrt(np.divide(1.0, gap + self.radius, out=np.zeros(len(points)), where=curved))[:, None]
        if ball.any():
            across = np.cross(normal, np.eye(3)[abs(normal).argmin(axis=1)])
            straight = np.where(ball[:, None], across / np.linalg.norm(across, axis=1, keepdims=True), straight)
            found[:, 1] = straight * size * ball[:, None]
        found[:, 0] = np.cross(straight, normal) * size
        return found

    def _box(self, offset: Floats) -> tuple[Floats, Floats]:
        beyond = abs(offset) - self.half + self.radius
        outside = np.maximum(beyond, 0)
        distance = np.sqrt((outside * outside).sum(axis=1))
        nearest = np.eye(3)[beyond.argmax(axis=1)]  # inside, the closest face
        direction = np.where(distance[:, None] > 0, outside, nearest) * np.where(offset < 0, -1.0, 1.0)
        length = np.where(distance > 0, distance, 1.0)
        return distance + np.minimum(beyond.max(axis=1), 0) - self.radius, direction / length[:, None]

    def surface_mesh(self, body: Floats, *, size: float) -> tuple[Floats, Integers]:
        """The surface with the centre at path[0]: points (P, 3) and outward triangles (F, 3).

        Args:
            body: (N, 3) rest positions of the body; a cylinder reaches past it by one edge on either side, a half-space is
                shown as a square as large as the body
            size: edge length aimed at [m]; an obstacle much larger than that is drawn with longer ones
        """
        size = max(size, np.pi * self.radius / FINEST, 2 * self.half.max() / FINEST, self.length / FINEST)
        first = _across(self.axis)
        frame = np.stack([first, np.cross(self.axis, first), self.axis])
        along = (body - self.path[0]) @ frame.T
        if self.shape == "half-space":
            middle, reach = (along.max(axis=0) + along.min(axis=0)) / 2, np.ptp(along[:, :2], axis=0).max() / 2 + size
            points, triangles = _square(middle[:2], reach, size)
        elif self.shape == "box":
            points, triangles = _rounded(*_box_surface(self.half, size), self.half, self.radius)
            frame = np.eye(3)
        elif self.shape == "cylinder":
            heights = _divide(along[:, 2].min() - size, along[:, 2].max() + size, size)
            points, triangles = _turned(np.full(len(heights), self.radius), heights, size)
        else:
            heights = _divide(-self.length / 2, self.length / 2, size)
            angles = _divide(0.0, np.pi / 2, size / self.radius)[1:]
            cap = self.radius * np.stack([np.cos(angles), np.sin(angles)])  # (2, rows): the last one is the pole
            radii = np.concatenate([cap[0, -2::-1], np.full(len(heights), self.radius), cap[0, :-1]])
            heights = np.concatenate([heights[0] - cap[1, -2::-1], heights, heights[-1] + cap[1, :-1]])
            points, triangles = _turned(radii, heights, size, poles=(-self.length / 2 - self.radius, self.length / 2 + self.radius))
        return self.path[0] + points @ frame, triangles


def _across(axis: Floats) -> Floats:
    """A unit vector normal to an axis."""
    other = np.eye(3)[np.argmin(abs(axis))]
    across = np.cross(axis, other)
    return across / np.linalg.norm(across)


def _divide(start: float, end: float, size: float) -> Floats:
    """Equally spaced numbers from start to end, about a size apart; one number when they coincide."""
    return np.linspace(start, end, max(1, round((end - start) / size)) + 1) if end > start else np.array([start])


def _turned(radii: Floats, heights: Floats, size: float, poles: tuple[float, float] | None = None) -> tuple[Floats, Integers]:
    """A surface of revolution about the third axis through rings (radius, height), closed by a point at either end."""
    around = max(8, round(2 * np.pi * radii.max() / size))
    angle = 2 * np.pi * np.arange(around) / around
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = [np.column_stack([radius * circle, np.full(around, height)]) for radius, height in zip(radii, heights, strict=True)]
    ends = poles or (heights[0], heights[-1])
    points = np.concatenate([*rings, [[0, 0, ends[0]], [0, 0, ends[1]]]])
    i = np.arange(around)
    j = (i + 1) % around
    triangles = []
    for lower in range(0, (len(rings) - 1) * around, around):
        upper = lower + around
        triangles += [np.stack([lower + i, lower + j, upper + j], axis=1), np.stack([lower + i, upper + j, upper + i], axis=1)]
    bottom, top, last = np.full(around, len(points) - 2), np.full(around, len(points) - 1), (len(rings) - 1) * around
    triangles += [np.stack([j, i, bottom], axis=1), np.stack([last + i, last + j, top], axis=1)]
    return points, np.concatenate(triangles)


def _square(middle: Floats, reach: float, size: float) -> tuple[Floats, Integers]:
    """A square in the plane of the first two axes, seen from the third."""
    ticks = _divide(-reach, reach, size)
    n = len(ticks)
    x, y = np.meshgrid(middle[0] + ticks, middle[1] + ticks, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _box_surface(half: Floats, size: float) -> tuple[Floats, Integers]:
    """The surface of a box cut into triangles, each corner and edge node once."""
    ticks = [_divide(-h, h, size) for h in half]
    points, triangles, count = [], [], 0
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3  # in cyclic order these two turn towards the third
        for outward in (-1, 1):
            u, v = np.meshgrid(ticks[first], ticks[second], indexing="ij")
            face = np.empty((u.size, 3))
            face[:, first], face[:, second], face[:, axis] = u.ravel(), v.ravel(), outward * half[axis]
            number = count + np.arange(u.size).reshape(u.shape)
            a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
            triangles.append(np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])[:, ::outward])
            points.append(face)
            count += u.size
    _, kept, number = np.unique(np.concatenate(points).round(12), axis=0, return_index=True, return_inverse=True)
    return np.concatenate(points)[kept], number.ravel()[np.concatenate(triangles)]


def _rounded(points: Floats, triangles: Integers, half: Floats, radius: float) -> tuple[Floats, Integers]:
    """Points of a box's surface moved onto the box with rounded edges."""
    inner = np.clip(points, radius - half, half - radius)
    offset = points - inner
    return inner + radius * offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-300), triangles
