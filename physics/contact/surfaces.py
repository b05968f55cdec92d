"""Surface meshes of rigid obstacles: points (P, 3) and outward triangles (F, 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Surface = tuple[Floats, Integers]


def divide(start: float, end: float, size: float) -> Floats:
    """Equally spaced numbers from start to end, about a size apart; one number when they coincide."""
    return np.linspace(start, end, max(1, round((end - start) / size)) + 1) if end > start else np.array([start])


def turned(radii: Floats, heights: Floats, size: float, poles: tuple[float, float] | None = None) -> Surface:
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


def capped(radius: float, length: float, size: float) -> Surface:
    """A capsule, or a sphere where it has no length."""
    heights = divide(-length / 2, length / 2, size)
    angles = divide(0.0, np.pi / 2, size / radius)[1:]
    cap = radius * np.stack([np.cos(angles), np.sin(angles)])  # (2, rows): the last one is the pole
    radii = np.concatenate([cap[0, -2::-1], np.full(len(heights), radius), cap[0, :-1]])
    heights = np.concatenate([heights[0] - cap[1, -2::-1], heights, heights[-1] + cap[1, :-1]])
    return turned(radii, heights, size, poles=(-length / 2 - radius, length / 2 + radius))


def square(middle: Floats, reach: float, size: float) -> Surface:
    """A square in the plane of the first two axes, seen from the third."""
    ticks = divide(-reach, reach, size)
    n = len(ticks)
    x, y = np.meshgrid(middle[0] + ticks, middle[1] + ticks, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def disc(outline: Floats, size: float) -> Surface:
    """What lies within a convex outline (P, 3) in the plane z = 0, counter-clockwise: rings about an edge apart, and the middle."""
    middle, around = outline.mean(axis=0), len(outline)
    rings = max(1, round(float(np.linalg.norm(outline - middle, axis=1).min()) / size))
    points = np.concatenate([middle + (k + 1) / rings * (outline - middle) for k in range(rings)] + [middle[None]])
    i = np.arange(around)
    j, last = (i + 1) % around, np.full(around, rings * around)
    triangles = [np.stack([last, i, j], axis=1)]
    for inner in range(0, (rings - 1) * around, around):
        outer = inner + around
        triangles += [np.stack([inner + i, outer + i, outer + j], axis=1), np.stack([inner + i, outer + j, inner + j], axis=1)]
    return points, np.concatenate(triangles)


def box(half: Floats, size: float) -> Surface:
    """The surface of a box cut into triangles, each corner and edge node once."""
    ticks = [divide(-h, h, size) for h in half]
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


def rounded(points: Floats, triangles: Integers, half: Floats, radius: float) -> Surface:
    """Points of a box's surface moved onto the box with rounded edges."""
    inner = np.clip(points, radius - half, half - radius)
    offset = points - inner
    return inner + radius * offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-300), triangles
