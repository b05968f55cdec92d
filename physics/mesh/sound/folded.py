"""Does a body pass through itself? It does not feel itself, so where it is folded onto itself it goes on as if nothing were there.

One surface cuts another one if and only if an edge of one crosses a side of the other. Only edges and sides near one another are
looked at, and of these only those that have come near: with nodes less than half as far apart as at rest. Where nothing has, as in
nearly all bodies, a frame costs one search among the nodes of the surface, and none at all where the body hardly moves.

Legend: T frames, N nodes, n of the surface, F sides: triangles, or lines of a plane body; E edges, p pairs.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from physics.mesh.mesh import Mesh
from physics.mesh.sound.rows import unique_rows

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LOOKS = 4  # frames of a path, its last one among them
NEARER = 0.5  # of the distance at rest
ROUNDING = 1e-9  # of a volume
WITHIN = 1.1  # longest edges: a point is within half of one from an end of its edge, and within 0.58 from a corner of its triangle


def folded(mesh: Mesh, displacement: Floats) -> tuple[int, Floats] | None:
    """The first step (to LOOKS) in which a body cuts itself in a path (T, N, 3), and a place (3,) [m] where; None when it never does."""
    shape, last = _Shape(mesh), 0
    for look in np.unique(np.linspace(0, len(displacement) - 1, LOOKS + 1).round().astype(int))[1:]:
        if (where := shape.cut(displacement[look])) is None:
            last = int(look)
            continue
        first = int(look)
        while first - last > 1:
            middle = (first + last) // 2
            earlier = shape.cut(displacement[middle])
            first, last, where = (middle, last, earlier) if earlier is not None else (first, middle, where)
        return first, where
    return None


class _Shape:
    """The surface of a body, prepared for many frames."""

    def __init__(self, mesh: Mesh) -> None:
        plane = mesh.dimension == 2
        sides = [np.concatenate([facets[:, [0, i, i + 1]] for i in range(1, facets.shape[1] - 1)])
                 for facets in ([] if plane else mesh.surface) if len(facets)]
        lines = [facets[:, [[0, 2], [2, 1]]].reshape(-1, 2) if facets.shape[1] == 3 else facets for facets in mesh.boundary if plane]
        corners = np.concatenate(lines or sides)
        self.nodes, numbered = np.unique(corners, return_inverse=True)
        self.sides = numbered.reshape(corners.shape)
        k = self.sides.shape[1]
        edges = np.concatenate([self.sides[:, [i, (i + 1) % k]] for i in range(k if k > 2 else 1)])
        self.edges = unique_rows(np.sort(edges, axis=1))
        self.rest = mesh.points[self.nodes]
        self.shortest = float(np.linalg.norm(self.rest[self.edges[:, 0]] - self.rest[self.edges[:, 1]], axis=1).min())
        self._edges_of, self._sides_of = (_incidence(parts, len(self.nodes)) for parts in (self.edges, self.sides))

    def cut(self, displacement: Floats) -> Floats | None:
        """A place (3,) [m] where the body cuts itself at displacements (N, 3)."""
        u = displacement[self.nodes]
        if np.linalg.norm(np.ptp(u, axis=0)) < self.shortest / 2:
            return None
        x = self.rest + u
        near = self._near(x)
        if not len(near):
            return None
        links = scipy.sparse.coo_matrix((np.ones(len(near)), near.T), shape=(len(x), len(x)))
        met = ((self._edges_of @ links @ self._sides_of.T) > 0).astype(np.int8)
        e, f = (met - met.multiply(self._edges_of @ self._sides_of.T > 0)).nonzero()  # those that share a node do not count
        crossed = _crossed(x[self.edges[e]], x[self.sides[f]])
        return x[self.edges[e[crossed.argmax()]]].mean(axis=0) if crossed.any() else None

    def _near(self, x: Floats) -> Integers:
        """(p, 2) pairs of nodes at places (n, 3), both ways, that edges and sides at them could cross, and that have come near."""
        length, reach = np.linalg.norm(x[self.edges[:, 0]] - x[self.edges[:, 1]], axis=1), np.zeros(len(x))
        for end in self.edges.T:
            np.maximum.at(reach, end, WITHIN * length)
        tree, found = cKDTree(x), []
        size = np.ceil(np.log2(reach / reach.min()))  # cells of about one size at once: large ones look far, small ones need not
        for group in np.unique(size):
            chosen = np.flatnonzero(size == group)
            hits = cKDTree(x[chosen]).sparse_distance_matrix(tree, float(reach[chosen].max()), output_type="ndarray")
            i, j = chosen[hits["i"]], hits["j"]
            nearer = hits["v"] < NEARER * np.linalg.norm(self.rest[i] - self.rest[j], axis=1)
            found.append(np.stack([i[nearer], j[nearer]], axis=1))
        pairs = np.concatenate(found)
        return np.concatenate([pairs, pairs[:, ::-1]]).astype(np.int64)


def _incidence(parts: Integers, nodes: int) -> scipy.sparse.csr_matrix:
    """(P, n) 1 where a part (P, k) has a node."""
    rows = np.repeat(np.arange(len(parts)), parts.shape[1])
    return scipy.sparse.csr_matrix((np.ones(parts.size), (rows, parts.ravel())), shape=(len(parts), nodes))


def _crossed(edge: Floats, side: Floats) -> NDArray[np.bool_]:
    """Whether edges (p, 2, 3) cross sides (p, 3, 3) in space, or (p, 2, 3) in the plane of x and y; an end on a side does not."""
    a, b = edge[:, 0], edge[:, 1]
    if side.shape[1] == 2:
        p, q = side[:, 0], side[:, 1]
        return (_area(a, p, q) * _area(b, p, q) < 0) & (_area(p, a, b) * _area(q, a, b) <= 0)
    p, q, r = side[:, 0], side[:, 1], side[:, 2]
    below, above = _volume(a, p, q, r), _volume(b, p, q, r)
    turns = np.stack([_volume(a, b, p, q), _volume(a, b, q, r), _volume(a, b, r, p)])
    slack = ROUNDING * np.ptp(np.concatenate([edge, side], axis=1), axis=1).max(axis=1) ** 3
    through = (below * above < 0) & (np.minimum(abs(below), abs(above)) > slack)
    return through & ((turns >= -slack).all(axis=0) | (turns <= slack).all(axis=0))


def _area(a: Floats, b: Floats, c: Floats) -> Floats:
    """Twice the signed area (p,) of triangles."""
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def _volume(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Six times the signed volume (p,) of tetrahedra."""
    return (np.cross(b - a, c - a) * (d - a)).sum(axis=1)
