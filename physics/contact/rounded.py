"""A body's surface without the edges between its facets: each facet of first order made one of second order.

Over flat facets an obstacle rolls as over a polygon: it rests on one row of nodes, then on two, and the force on it goes up in stairs.
Here every edge of a facet gets a node in its middle, and a quadrilateral one in its centre, that lie on the curve through the nodes around:

    x_m = (x_a + x_b) / 2 + (d_ab + d_ba) / 8        d_ab = G_a x . (b - a) - (x_b - x_a), d_ba the other way round

Cubic Hermite interpolation half-way between a and b. G_a x is the gradient along the surface at a of any function given at nodes, by
least squares over the neighbours of a, with weights 1 / distance, on the rest body; so x_m is a fixed sum of nodal positions, and
forces at points of the curved facets go to nodes as from any others. Motions of the whole body and even strains are kept exactly; in an
even row of nodes x_m is (-1, 9, 9, -1) / 16 of four of them (Dyn, Levin and Gregory, Comput. Aided Geom. Des. 4, 1987).

Real edges stay: facets of the rest body whose normals differ by more than SHARP are of different sides, and each side has its own
gradients. A node on such an edge has neighbours to one hand, and tells the slope across less well. So between one where more sides meet
and one where fewer do the latter decides alone: x_m = (x_a + x_b) / 2 + d_ab / 4, the parabola through both with the slope at a.

Legend: N nodes of the body, M middles and centres, F facets of k nodes, S sides, P nodes as each side has them, E edges of facets, R the
same as each side has them from either end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from physics.mesh.cell import CELLS, SECOND
from physics.mesh.mesh import Mesh
from physics.mesh.sound.rows import row_in

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SHARP = 35  # degrees between the normals of two facets
NO_SLOPE = 1e-5  # of how far neighbours lie in the other directions: none lies in this one


@dataclass(frozen=True)
class Rounded:
    """The facets of a surface, all of second order.

    facets: kind and (F, k) nodes of each; from N on they are middles and centres
    weights: (N + M, N) sparse, of the body's nodes in these nodes
    """

    facets: list[tuple[str, Integers]]
    weights: scipy.sparse.csr_matrix


def rounded(mesh: Mesh) -> Rounded:
    """The outer facets of a mesh, of first order with their edges rounded, of second order as they are."""
    count = len(mesh.points)
    if CELLS[mesh.cell].middles:
        return Rounded([(mesh.kind_of(facets), facets) for facets in mesh.boundary], scipy.sparse.identity(count, format="csr"))
    normals = [_normals(mesh, facets) for facets in mesh.boundary]
    sides = _sides(mesh, normals)
    end, side = _ends(mesh, sides)
    node = _Nodes(mesh, sides, normals)
    away = _slopes(mesh, node, end, side) - _rows(end, np.array([-1.0, 1.0]), count)  # (R, N) d_ab
    meet = node.sides[end]  # (R, 2) how many sides there are at a and b
    share = np.select([meet[:, 0] < meet[:, 1], meet[:, 0] > meet[:, 1]], [1 / 4, 0.0], 1 / 8)
    edge, which, times = np.unique(np.sort(end, axis=1), axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    mean = scipy.sparse.csr_matrix((share * 2 / times[which], (which, np.arange(len(end)))), shape=(len(edge), len(end)))  # over its sides
    return _assembled(mesh, edge, _rows(edge, np.array([0.5, 0.5]), count) + mean @ away)


def _assembled(mesh: Mesh, edge: Integers, middles: scipy.sparse.csr_matrix) -> Rounded:
    """The facets with the middles (E, N) of their edges (E, 2), and a centre where the plane cell has one."""
    count, facets = len(mesh.points), []
    weights = scipy.sparse.vstack([scipy.sparse.identity(count), middles], format="csr")
    for corners in mesh.boundary:
        kind = CELLS[SECOND[mesh.kind_of(corners)]]
        ends = [np.sort(corners[:, list(between)], axis=1) for between in kind.middles if len(between) == 2]
        facet = np.concatenate([corners, *(count + row_in(edge, pair)[:, None] for pair in ends)], axis=1)
        if facet.shape[1] < kind.nodes:  # Coons: the sum of the two ruled surfaces less the one through the corners
            centres = _rows(facet, np.repeat([-1 / 4, 1 / 2], 4), weights.shape[0]) @ weights
            facet = np.concatenate([facet, weights.shape[0] + np.arange(len(facet))[:, None]], axis=1)
            weights = scipy.sparse.vstack([weights, centres], format="csr")
        facets.append((kind.name, facet))
    return Rounded(facets, weights)


def _rows(nodes: Integers, of: Floats, count: int) -> scipy.sparse.csr_matrix:
    """(n, count) the same sum of values at some nodes (n, k) in every row."""
    return scipy.sparse.csr_matrix((np.tile(of, len(nodes)), nodes.ravel(), np.arange(len(nodes) + 1) * nodes.shape[1]),
                                   shape=(len(nodes), count))


def _sides(mesh: Mesh, normals: list[Floats]) -> list[Integers]:
    """The side that each facet (F,) of each array of the boundary is of: those that meet smoothly are of one."""
    start = np.cumsum([0, *map(len, mesh.boundary)])
    rims, owner = [], []
    for first, facets in zip(start, mesh.boundary, strict=False):
        for corners in CELLS[mesh.kind_of(facets)].edges if mesh.dimension == 3 else ((0,), (1,)):
            rims.append(np.sort(facets[:, list(corners)], axis=1))
            owner.append(first + np.arange(len(facets)))
    rim, facet = np.concatenate(rims), np.concatenate(owner).astype(np.int64)
    order = np.lexsort(rim.T)
    same = (rim[order[1:]] == rim[order[:-1]]).all(axis=1)
    one, other = facet[order[:-1][same]], facet[order[1:][same]]
    normal = np.concatenate(normals)
    smooth = np.einsum("ei,ei->e", normal[one], normal[other]) > np.cos(np.radians(SHARP))
    meet = scipy.sparse.coo_matrix((smooth[smooth], (one[smooth], other[smooth])), shape=(start[-1], start[-1]))
    return np.split(connected_components(meet, directed=False)[1].astype(np.int64), start[1:-1])


def _normals(mesh: Mesh, facets: Integers) -> Floats:
    """(F, 3) unit normals, outward; those of the sides of a plane body lie in its plane."""
    x = mesh.points[facets]
    if mesh.dimension == 2:
        normal = np.cross(x[:, 1] - x[:, 0], [0.0, 0.0, 1.0])
    elif facets.shape[1] == 3:
        normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    else:
        normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _ends(mesh: Mesh, sides: list[Integers]) -> tuple[Integers, Integers]:
    """Every edge as each side has it, from a to b and from b to a: (R, 2) and (R,) the side."""
    found = [np.stack([facets[:, i], facets[:, j], side], axis=1) for facets, side in zip(mesh.boundary, sides, strict=True)
             for pair in CELLS[mesh.kind_of(facets)].edges for i, j in (pair, pair[::-1])]
    rows = np.unique(np.concatenate(found), axis=0)
    return rows[:, :2], rows[:, 2]


class _Nodes:
    """Nodes as each side has them.

    sides: (N,) how many sides there are at each node of the body
    normal: (P, 3) unit normals, the means of the facets around
    """

    def __init__(self, mesh: Mesh, sides: list[Integers], normals: list[Floats]) -> None:
        self._count = len(mesh.points)
        keys = [(side[:, None] * self._count + facets).ravel() for facets, side in zip(mesh.boundary, sides, strict=True)]
        self._keys, at = np.unique(np.concatenate(keys), return_inverse=True)
        each = np.concatenate([np.repeat(normal, facets.shape[1], axis=0) for facets, normal in zip(mesh.boundary, normals, strict=True)])
        total = np.stack([np.bincount(at, each[:, i]) for i in range(3)], axis=1)
        self.normal = total / np.linalg.norm(total, axis=1, keepdims=True)
        self.sides = np.bincount(self._keys % self._count, minlength=self._count)

    def numbers(self, node: Integers, side: Integers) -> Integers:
        """(n,) which of the P some nodes of some sides are."""
        return np.searchsorted(self._keys, side * self._count + node)


def _slopes(mesh: Mesh, nodes: _Nodes, end: Integers, side: Integers) -> scipy.sparse.csr_matrix:
    """(R, N) of values at nodes, what makes G_a . (b - a) for every edge and end."""
    at, pairs = nodes.numbers(end[:, 0], side), len(nodes.normal)
    away = mesh.points[end[:, 1]] - mesh.points[end[:, 0]]  # (R, 3)
    normal = nodes.normal[at]
    along = away - np.einsum("ri,ri->r", away, normal)[:, None] * normal
    pull = along / np.linalg.norm(away, axis=1)[:, None]
    matrix = np.zeros((pairs, 3, 3))
    np.add.at(matrix, at, np.einsum("ri,rj->rij", pull, along))
    matrix += np.einsum("p,pi,pj->pij", np.einsum("pii->p", matrix), nodes.normal, nodes.normal)  # and none along the normal
    inverse = np.linalg.pinv(matrix, rcond=NO_SLOPE, hermitian=True)
    step = np.einsum("rij,rj->ri", inverse[at], pull)  # G_a x = sum over neighbours b of step (x_b - x_a)
    rows = (3 * at[:, None] + np.arange(3)).ravel()
    gradient = scipy.sparse.csr_matrix((step.ravel(), (rows, np.repeat(end[:, 1], 3))), shape=(3 * pairs, len(mesh.points)))
    gradient -= scipy.sparse.csr_matrix((step.ravel(), (rows, np.repeat(end[:, 0], 3))), shape=gradient.shape)
    return scipy.sparse.csr_matrix((away.ravel(), rows, np.arange(len(end) + 1) * 3), shape=(len(end), 3 * pairs)) @ gradient
