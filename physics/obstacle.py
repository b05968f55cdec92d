"""Rigid obstacles: where they are, how far a point is from them, and their surface as a mesh.

The gap of a point x is its signed distance g(x) to the obstacle's surface, negative inside; its gradient n is the
normal that points from the obstacle to x. A cylinder has no ends in this geometry; its mesh is as long as the body
asks for. Legend: Q points, P surface nodes, F triangles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.scene import Obstacle

Floats = NDArray[np.float64]


class Rigid:
    """A rigid obstacle on its prescribed path."""

    def __init__(self, obstacle: Obstacle) -> None:
        self.shape, self.radius = obstacle.shape, obstacle.radius
        self.path = np.array(obstacle.path)  # (W, 3)
        self.axis = np.array(obstacle.axis) / np.linalg.norm(obstacle.axis)

    def position(self, fraction: float) -> Floats:
        """(3,) centre [m] at a fraction 0 .. 1 of the steps; way-points are reached at equal fractions."""
        where = np.linspace(0.0, 1.0, len(self.path))
        return np.array([np.interp(fraction, where, component) for component in self.path.T])

    def gap(self, points: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Signed distances (Q,) [m] and normals (Q, 3) of points (Q, 3) for an obstacle at a centre (3,)."""
        offset = points - centre
        if self.shape == "cylinder":
            offset = offset - (offset @ self.axis)[:, None] * self.axis
        distance = np.sqrt((offset * offset).sum(axis=1))
        # On the axis itself every direction is as good as any: take a fixed one.
        normal = np.divide(offset, distance[:, None], out=np.tile(_across(self.axis), (len(points), 1)),
                           where=distance[:, None] > 0)
        return distance - self.radius, normal

    def surface_mesh(self, *, size: float, extent: tuple[float, float]) -> tuple[Floats, NDArray[np.int64]]:
        """The surface with the centre at path[0]: points (P, 3) and outward triangles (F, 3).

        Args:
            size: edge length aimed at [m]
            extent: where along the axis a cylinder begins and ends, measured from its centre [m]
        """
        if self.shape == "cylinder":
            points, triangles = _cylinder(self.radius, size, extent)
        else:
            points, triangles = _sphere(self.radius, size)
        first = _across(self.axis)
        frame = np.stack([first, np.cross(self.axis, first), self.axis])
        return self.path[0] + points @ frame, triangles


def _across(axis: Floats) -> Floats:
    """A unit vector normal to an axis."""
    other = np.eye(3)[np.argmin(abs(axis))]
    across = np.cross(axis, other)
    return across / np.linalg.norm(across)


def _ring(radius: float, count: int, height: float) -> Floats:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)], axis=1)


def _strip(lower: int, upper: int, count: int) -> list[tuple[int, int, int]]:
    """Triangles between two rings of `count` nodes each, given by their first nodes."""
    following = [(i + 1) % count for i in range(count)]
    return [triangle for i, j in enumerate(following)
            for triangle in ((lower + i, lower + j, upper + j), (lower + i, upper + j, upper + i))]


def _fan(tip: int, ring: int, count: int, *, up: bool) -> list[tuple[int, int, int]]:
    pairs = [(ring + i, ring + (i + 1) % count) for i in range(count)]
    return [(a, b, tip) if up else (b, a, tip) for a, b in pairs]


def _cylinder(radius: float, size: float, extent: tuple[float, float]) -> tuple[Floats, NDArray[np.int64]]:
    around = max(8, round(2 * np.pi * radius / size))
    heights = np.linspace(*extent, max(1, round((extent[1] - extent[0]) / size)) + 1)
    points = np.concatenate([_ring(radius, around, z) for z in heights] + [[[0, 0, heights[0]], [0, 0, heights[-1]]]])
    last = (len(heights) - 1) * around
    triangles = [t for k in range(len(heights) - 1) for t in _strip(k * around, (k + 1) * around, around)]
    triangles += _fan(len(points) - 2, 0, around, up=False) + _fan(len(points) - 1, last, around, up=True)
    return points, np.array(triangles, np.int64)


def _sphere(radius: float, size: float) -> tuple[Floats, NDArray[np.int64]]:
    around, rows = max(8, round(2 * np.pi * radius / size)), max(4, round(np.pi * radius / size))
    angles = np.pi * np.arange(1, rows) / rows
    rings = [_ring(radius * np.sin(angle), around, -radius * np.cos(angle)) for angle in angles]
    points = np.concatenate([*rings, [[0, 0, -radius], [0, 0, radius]]])
    last = (len(rings) - 1) * around
    triangles = [t for k in range(len(rings) - 1) for t in _strip(k * around, (k + 1) * around, around)]
    triangles += _fan(len(points) - 2, 0, around, up=False) + _fan(len(points) - 1, last, around, up=True)
    return points, np.array(triangles, np.int64)
