"""How far is a point from a closed surface of triangles, and on which side of it?

The distance is that to the nearest point of all triangles; the sign is that of (x - nearest) . n with n the normal of the face, edge
or corner on which the nearest point lies: of an edge the sum of the normals of its two triangles, of a corner the sum of those around
it, each times its angle there (Baerentzen and Aanaes, IEEE Trans. Vis. Comput. Graph. 11, 2005). It is exact, but for rounding.

A triangle is nearest to some point within r of a middle, which is d from the surface, only if it is within d + 2 r of that middle. So
cubes of many points are halved again and again, and each part keeps the triangles that it may need.

Legend: Q points, F triangles, P corners, M pairs of a point and a triangle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Pairs = tuple[Integers, Integers]

AT_ONCE = 32  # cubes
RAYS = 1_000_000  # pairs in looking for the thinnest place
ITEMS = 100_000  # parts that large triangles are divided into, about
SLACK = 1 + 1e-9
CHILDREN = np.stack(np.meshgrid(*3 * [[-1, 1]], indexing="ij"), axis=-1).reshape(-1, 3)


class Closed:
    """A closed surface of points (P, 3) and outward triangles (F, 3)."""

    def __init__(self, points: Floats, triangles: Integers) -> None:
        self._corner = points[triangles]  # (F, 3, 3)
        self._edge = np.roll(self._corner, -1, axis=1) - self._corner  # (F, 3, 3) from each corner to the next
        across = np.cross(self._edge[:, 0], -self._edge[:, 2])
        self._face = across / np.linalg.norm(across, axis=1, keepdims=True)  # (F, 3)
        self._square = (self._edge * self._edge).sum(axis=2)  # (F, 3)
        self._inward = np.cross(self._face[:, None], self._edge)  # (F, 3, 3) from each edge into the triangle
        self._over_edge = self._edges(triangles)  # (F, 3, 3)
        self._at_corner = self._corners(points, triangles)[triangles]  # (F, 3, 3)
        self._tree, self._owner, self._part = self._parts(float(np.linalg.norm(across, axis=1).sum()) / 2)

    def _edges(self, triangles: Integers) -> Floats:
        """(F, 3, 3) of each edge the sum of the normals of its two triangles."""
        pair = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        _, number = np.unique(pair, axis=0, return_inverse=True)
        normal = np.repeat(self._face, 3, axis=0)
        total = np.stack([np.bincount(number.ravel(), normal[:, k]) for k in range(3)], axis=1)
        return total[number.ravel()].reshape(-1, 3, 3)

    def _corners(self, points: Floats, triangles: Integers) -> Floats:
        """(P, 3) of each corner the sum of the normals around it, times their angles."""
        along = self._edge / np.sqrt(self._square)[:, :, None]
        angle = np.arccos(np.clip(-(along * np.roll(along, 1, axis=1)).sum(axis=2), -1, 1))  # (F, 3)
        normal = (angle[:, :, None] * self._face[:, None]).reshape(-1, 3)
        return np.stack([np.bincount(triangles.ravel(), normal[:, k], len(points)) for k in range(3)], axis=1)

    def _parts(self, area: float) -> tuple[KDTree, Integers, float]:
        """A search tree of points such that every place of a triangle is near one of its own, their triangles, and how near [m]."""
        longest = np.sqrt(self._square.max(axis=1))
        size = max(float(np.median(longest)), np.sqrt(4 * area / ITEMS))
        divided = np.ceil(longest / size * (1 - 1e-9)).astype(int)
        points, owner = [], []
        for n in np.unique(divided):
            i, j = np.array([(i, j) for i in range(3 * n) for j in range(3 * n - i) if i % 3 == j % 3 != 0]).T / (3 * n)
            these = np.flatnonzero(divided == n)  # middles of n^2 equal parts
            corner, edge, other = self._corner[these, 0], self._edge[these, 0], -self._edge[these, 2]
            points.append((corner[:, None] + i[:, None] * edge[:, None] + j[:, None] * other[:, None]).reshape(-1, 3))
            owner.append(np.repeat(these, len(i)))
        return KDTree(np.concatenate(points)), np.concatenate(owner), float((longest / divided).max()) * 2 / 3 * SLACK

    def distance(self, points: Floats) -> tuple[Floats, Floats]:
        """Signed distances (Q,), negative inside, and the nearest points (Q, 3), of points (Q, 3)."""
        which, triangle = self._candidates(points, 0.0)
        square = self._squares(points[which], triangle)
        order = np.lexsort((square, which))
        return self._signed(points, triangle[order[np.searchsorted(which, np.arange(len(points)))]])

    def cubes(self, low: Floats, spacing: float, size: int) -> Floats:
        """(B, size, size, size) signed distances of the nodes of cubes, whose lowest node stands at (B, 3); size is a power of two."""
        parts = [self._cubes(low[start:start + AT_ONCE], spacing, size) for start in range(0, len(low), AT_ONCE)]
        return np.concatenate(parts)

    def _cubes(self, low: Floats, spacing: float, size: int) -> Floats:
        middle, width, node = low + (size - 1) / 2 * spacing, size, np.zeros((len(low), 3), np.int64)
        reach = np.sqrt(3.0) * (width - 1) / 2 * spacing
        which, triangle = self._candidates(middle, reach)
        while width > 1:
            away = np.sqrt(self._squares(middle[which], triangle))
            least = np.minimum.reduceat(away, np.searchsorted(which, np.arange(len(middle))))
            kept = away <= (least[which] + 2 * reach) * SLACK
            which, triangle = which[kept], triangle[kept]
            width //= 2
            node = (node[:, None] + width * (CHILDREN > 0)).reshape(-1, 3)
            middle = (middle[:, None] + width / 2 * spacing * CHILDREN).reshape(-1, 3)
            reach = np.sqrt(3.0) * (width - 1) / 2 * spacing
            which = (8 * which[:, None] + np.arange(8)).ravel()
            order = np.argsort(which, kind="stable")
            which, triangle = which[order], np.repeat(triangle, 8)[order]
        square = self._squares(middle[which], triangle)
        order = np.lexsort((square, which))
        value, _ = self._signed(middle, triangle[order[np.searchsorted(which, np.arange(len(middle)))]])
        found = np.empty((len(low), size, size, size))
        found[np.repeat(np.arange(len(low)), size**3), node[:, 0], node[:, 1], node[:, 2]] = value
        return found

    def _candidates(self, points: Floats, reach: float) -> Pairs:
        """(M,) points in rising order and triangles that may be nearest to what is within a reach [m] of them."""
        away, _ = self._tree.query(points)
        found = self._tree.query_ball_point(points, (away + 2 * reach + self._part) * SLACK, return_sorted=False)
        which = np.repeat(np.arange(len(points)), [len(each) for each in found])
        key = np.unique(which * len(self._face) + self._owner[np.concatenate(found).astype(np.int64)])
        one, other = np.divmod(key, len(self._face))
        return one, other

    def thickness(self) -> float:
        """The smallest one: from middles of triangles straight in, to where the surface looks the other way by 120 degrees or more.

        Of a wedge that is so sharp that its sides look away from each other it is that of the middles nearest to its edge.
        """
        middle, found = self._corner.mean(axis=1), float(np.ptp(self._corner.reshape(-1, 3), axis=0).min())
        radius = ((self._corner - middle[:, None]) ** 2).sum(axis=2).max(axis=1)  # (F,) squared
        some = np.unique(np.linspace(0, len(self._face) - 1, max(1, RAYS // len(self._face))).round().astype(int))
        for at, ray in zip(middle[some], -self._face[some], strict=True):
            seen = middle - at
            deep = seen @ ray
            hit = np.flatnonzero(((seen * seen).sum(axis=1) - deep * deep <= radius * SLACK) & (self._face @ ray >= 0.5))
            way = ((self._corner[hit, 0] - at) * self._face[hit]).sum(axis=1) / (self._face[hit] @ ray)
            offset = (at + way[:, None] * ray)[:, None] - self._corner[hit]  # (n, 3, 3)
            through = ((offset * self._inward[hit]).sum(axis=2) >= 0).all(axis=1) & (way > 1e-9 * found)
            found = min(found, float(way[through].min(initial=np.inf)))
        return found

    def _squares(self, points: Floats, triangle: Integers) -> Floats:
        """(M,) squares of the distances of points (M, 3) from triangles (M,)."""
        best, above, point = np.full(len(points), np.inf), np.ones(len(points), bool), points.T
        for k in range(3):
            edge = self._edge[triangle, k].T
            way = point - self._corner[triangle, k].T
            above &= _dot(way, self._inward[triangle, k].T) >= 0
            rest = way - np.clip(_dot(way, edge) / self._square[triangle, k], 0, 1) * edge
            np.minimum(best, _dot(rest, rest), out=best)
        height = _dot(way, self._face[triangle].T)
        return np.where(above, height * height, best)

    def _signed(self, points: Floats, nearest: Integers) -> tuple[Floats, Floats]:
        """Signed distances (Q,) of points from the triangle (Q,) that is nearest to each, and its nearest points (Q, 3)."""
        face = self._face[nearest]
        best, found, normal = np.full(len(points), np.inf), np.empty_like(points), np.empty_like(points)
        above = np.ones(len(points), bool)
        for k in range(3):
            corner, edge = self._corner[nearest, k], self._edge[nearest, k]
            way = points - corner
            above &= (way * self._inward[nearest, k]).sum(axis=1) >= 0
            share = np.clip((way * edge).sum(axis=1) / self._square[nearest, k], 0, 1)[:, None]
            rest = way - share * edge
            square = (rest * rest).sum(axis=1)
            closer = square < best
            feature = np.where(share <= 0, self._at_corner[nearest, k],
                               np.where(share >= 1, self._at_corner[nearest, (k + 1) % 3], self._over_edge[nearest, k]))
            best = np.where(closer, square, best)
            found[closer], normal[closer] = (corner + share * edge)[closer], feature[closer]
        height = (way * face).sum(axis=1)
        found, normal = np.where(above[:, None], points - height[:, None] * face, found), np.where(above[:, None], face, normal)
        side = np.where(((points - found) * normal).sum(axis=1) < 0, -1.0, 1.0)
        return side * np.where(above, abs(height), np.sqrt(best)), found


def _dot(one: Floats, other: Floats) -> Floats:
    """Products of vectors whose components stand first."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])
