"""A rigid obstacle of any closed surface of triangles: its distance made smooth, for contact needs normals that turn steadily.

The signed distance d to triangles (closed.py) has kinks at every edge; a point that slides over one, or rests in one, has a normal that
jumps, and Newton's method goes round in circles. So d is sampled on a lattice of spacing h, `radius` in a scene, and the gap is

    g(x) = sum_i d(x_i) B((x - x_i) / h),     B(t) = b(t_1) b(t_2) b(t_3), b the cubic B-spline,

which is d seen through a window 2 h wide on either side: twice differentiable, its normal its very gradient. Where the surface is flat
that changes nothing. Where its radii of curvature are R it moves it inwards by h^2 / 6 (1/R1 + 1/R2), and an edge of a box as far as
a rounding of radius about h would. In an edge the gradient is shorter than 1. The second derivative is kept where the gap curves away
from the body; where it curves towards it, in a hollow, Newton's steps do without.

Samples are taken when a point comes near, in bricks of 4 x 4 x 4. What is further than that from the surface gets a lower bound of its
distance: contact asks no more of it.

Legend: Q points, P corners, F triangles.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from physics.contact.closed import Closed
from physics.contact.shapes import rotation
from physics.contact.surfaces import Surface
from physics.scene import Obstacle
from physics.scene.surface import surface_in

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BRICK = 4
FINEST = 20  # of the smallest thickness: the spacing where a scene says nothing
MOST = 30_000_000  # nodes of a lattice
LEAST = 1e-9  # curvature times spacing that is none


class Lattice:
    """The smooth distance to one surface, sampled where it was asked for."""

    def __init__(self, points: Floats, triangles: Integers, radius: float | None) -> None:
        self._closed = Closed(points, triangles)
        self.width = self._closed.thickness()
        edges = np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2)
        low, extent = points.min(axis=0), np.ptp(points, axis=0)
        finest = float(np.prod(extent / MOST ** (1 / 3)) ** (1 / 3))
        self.h = radius or max(min(self.width / FINEST, float(np.median(edges))), finest)
        self._half = BRICK * self.h / 2 * np.sqrt(3.0)  # from the middle of a brick to its corner
        bricks = np.ceil(extent / (BRICK * self.h)).astype(int) + 4  # two beyond the surface on either side
        self._low, self._bricks = low - (bricks * BRICK * self.h - extent) / 2, bricks
        self._pad = float(min(low - self._low)) - self.h
        self._value, self._filled = np.zeros(bricks * BRICK), np.zeros(bricks, bool)
        self._middle, self._nearest, self._seen = np.zeros(bricks), np.zeros((*bricks, 3)), np.zeros(bricks, bool)

    def gap(self, points: Floats, *, second: bool = False) -> tuple[Floats, Floats, Floats]:
        """g (Q,), its gradient (Q, 3) and, on request, its second derivative (Q, 3, 3); points as in the file."""
        place = (points - self._low) / self.h  # node i stands at i + 1/2
        brick = np.floor(place / BRICK).astype(np.int64)
        outside = ((brick < 1) | (brick > self._bricks - 2)).any(axis=1)
        gap, slope, bend = np.empty(len(points)), np.empty((len(points), 3)), np.zeros((len(points) * second, 3, 3))
        if outside.any():
            gap[outside], slope[outside] = self._beyond(points[outside])
        within = np.flatnonzero(~outside)
        middle, nearest, centre = self._of_brick(brick[within])
        far = abs(middle) > self._half + 4 * self.h
        at, side = within[far], np.sign(middle[far])
        gap[at] = side * (abs(middle[far]) - np.linalg.norm(points[at] - centre[far], axis=1))
        slope[at] = (centre[far] - nearest[far]) / middle[far, None]
        at = within[~far]
        if len(at):
            gap[at], slope[at], found = self._near(place[at] - 0.5, second)
            if second:
                bend[at] = found
        return gap, slope, bend

    def _beyond(self, points: Floats) -> tuple[Floats, Floats]:
        """A lower bound outside of the lattice: from the box around the surface."""
        low = self._low + self._pad
        away = points - np.clip(points, low, low + self._bricks * BRICK * self.h - 2 * self._pad)
        distance = np.linalg.norm(away, axis=1)
        return distance, away / distance[:, None]

    def _of_brick(self, brick: Integers) -> tuple[Floats, Floats, Floats]:
        """Of bricks (Q, 3) the signed distance of the middle (Q,), the nearest point (Q, 3), and the middle itself (Q, 3)."""
        at = tuple(brick.T)
        missing = np.unique(brick[~self._seen[at]], axis=0)
        if len(missing):
            new = tuple(missing.T)
            self._middle[new], self._nearest[new] = self._closed.distance(self._low + (missing + 0.5) * BRICK * self.h)
            self._seen[new] = True
        return self._middle[at], self._nearest[at], self._low + (brick + 0.5) * BRICK * self.h

    def _near(self, place: Floats, second: bool) -> tuple[Floats, Floats, Floats]:
        """Value, gradient and second derivative of the spline at places (q, 3) in spacings, whole numbers at nodes."""
        first = np.floor(place).astype(np.int64) - 1
        ends = np.stack([first // BRICK, (first + 3) // BRICK])
        corners = np.stack([ends[[i, j, k], :, [0, 1, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]).transpose(0, 2, 1)
        self._fill(np.unique(corners.reshape(-1, 3), axis=0))
        node = (first[:, :, None] + np.arange(4)).transpose(1, 0, 2)  # (3, q, 4)
        value = self._value[node[0][:, :, None, None], node[1][:, None, :, None], node[2][:, None, None, :]]
        (x, y, z), (dx, dy, dz), (ddx, ddy, ddz) = (weights.transpose(1, 0, 2) for weights in _spline(place - np.floor(place)))

        def total(a: Floats, b: Floats, c: Floats) -> Floats:
            return np.asarray(((value @ c[:, None, :, None])[..., 0] @ b[:, :, None])[..., 0][:, None] @ a[:, :, None])[:, 0, 0]

        slope = np.stack([total(dx, y, z), total(x, dy, z), total(x, y, dz)], axis=1) / self.h
        if not second:
            return total(x, y, z), slope, np.empty((0, 3, 3))
        xy, yz, xz = total(dx, dy, z), total(x, dy, dz), total(dx, y, dz)
        rows = [[total(ddx, y, z), xy, xz], [xy, total(x, ddy, z), yz], [xz, yz, total(x, y, ddz)]]
        return total(x, y, z), slope, np.array(rows).transpose(2, 0, 1) / self.h**2

    def _fill(self, brick: Integers) -> None:
        """Sample bricks (n, 3) where that has not been done."""
        brick = brick[~self._filled[tuple(brick.T)]]
        if len(brick):
            values = self._closed.cubes(self._low + (BRICK * brick + 0.5) * self.h, self.h, BRICK)
            for at, value in zip(BRICK * brick, values, strict=True):
                self._value[tuple(slice(i, i + BRICK) for i in at)] = value
            self._filled[tuple(brick.T)] = True


def _spline(t: Floats) -> tuple[Floats, Floats, Floats]:
    """Weights (..., 4) of the nodes at -1, 0, 1 and 2 at places t in [0, 1), and their first and second derivatives."""
    u = 1 - t
    return (np.stack([u**3, 3 * t**3 - 6 * t**2 + 4, 3 * u**3 - 6 * u**2 + 4, t**3], axis=-1) / 6,
            np.stack([-u**2, 3 * t**2 - 4 * t, 4 * u - 3 * u**2, t**2], axis=-1) / 2,
            np.stack([u, 3 * t - 2, 3 * u - 2, t], axis=-1))


@functools.lru_cache(maxsize=4)
def _lattice(surface: str, scale: float, radius: float | None) -> Lattice:
    points, triangles = surface_in(surface)
    return Lattice(scale * points, triangles, radius)


class Tool:
    """A surface of triangles; its centre is the origin of its file."""

    def __init__(self, obstacle: Obstacle) -> None:
        assert obstacle.surface is not None
        self._lattice = _lattice(obstacle.surface, obstacle.scale or 1.0, obstacle.radius)
        points, self._triangles = surface_in(obstacle.surface)
        self._points = (obstacle.scale or 1.0) * points
        self.frame = rotation(obstacle).T
        self.width, self.extent = self._lattice.width, float(np.ptp(self._points, axis=0).max())

    def gap(self, offset: Floats) -> tuple[Floats, Floats]:
        gap, slope, _ = self._lattice.gap(offset @ self.frame.T)
        return gap, slope @ self.frame

    def bend(self, offset: Floats) -> Floats:
        _, _, second = self._lattice.gap(offset @ self.frame.T, second=True)
        value, vector = np.linalg.eigh(second)
        value = np.where(value > LEAST / self._lattice.h, value, 0.0)[:, :0:-1]  # the two largest
        return (np.sqrt(value)[:, :, None] * vector[:, :, :0:-1].transpose(0, 2, 1)) @ self.frame

    def reach(self, direction: Floats) -> float:
        return float((self._points @ (self.frame @ direction)).max())

    def mesh(self, along: Floats, size: float) -> Surface:
        return self._points, self._triangles
