"""Where on a body's surface contact is felt: points of its facets, with the share of the area that each stands for.

A point x_q = sum_a w_qa x_a over the nodes of a facet stands for an area A_q of the rest surface. By Simpson's rule a pressure gives its
nodal forces most exactly; even shares make contact alike all over a facet, so that an obstacle that rolls over it meets no steps.

Legend: N nodes, Q points, F facets of k nodes, P points of one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, Cell

Floats = NDArray[np.float64]

ROUNDING = 1e-12  # of a shape function


def points_of(facets: Sequence[tuple[str, NDArray[np.int64]]], nodes: Floats, thickness: float,
              divisions: int, *, even: bool = False) -> tuple[scipy.sparse.csr_matrix, Floats]:
    """The points of some facets, each facet divided along its edges.

    Args:
        facets: kind and nodes (F, k) of each set
        nodes: (N, 3) rest positions [m]
        thickness: [m] of a plane body, whose facets are lines
        divisions: parts of an edge; each has a point at its ends and its middle
        even: a point stands for what is nearer to it than to others, not for its share in Simpson's rule

    Returns:
        (P, N) weights and (P,) areas [m2] of the points, those that facets share as often as there are facets
    """
    rows, columns, values, areas, count = [], [], [], [], 0
    line, along, total = _line(divisions, even)
    rules = {4: _on_quadrilateral(divisions, even), 3: _on_triangle(divisions, even), 2: (line, along / total)}
    for name, facet in facets:
        kind = CELLS[name]
        shape, share = rules[kind.corners]
        corner = nodes[facet]
        if kind.middles:
            shape, tangents = _of_second_order(kind, shape, corner)
            if kind.dimension == 1:
                tangents[:, :, 1, 2] = thickness
            size = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2) * kind.weights.sum()
        elif kind.dimension == 1:
            size = np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1) * thickness
        elif kind.corners == 3:
            size = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2
        else:
            size = np.linalg.norm(np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]), axis=1) / 2
        q = count + np.arange(len(facet) * len(share)).reshape(len(facet), len(share))
        point, node = np.broadcast_arrays(q[:, :, None], facet[:, None, :])
        weight = np.broadcast_to(shape, point.shape)
        rows.append(point.ravel())
        columns.append(node.ravel())
        values.append(weight.ravel())
        areas.append((size.reshape(len(facet), -1) * share).ravel())
        count += q.size
    triplets = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return scipy.sparse.csr_matrix(triplets, shape=(count, len(nodes))), np.concatenate(areas)


def _of_second_order(kind: Cell, linear: Floats, nodes: Floats) -> tuple[Floats, Floats]:
    """Shape functions (P, k) at points given by those of first order (P, corners), and tangents (F, P, 2, 3) of facets there."""
    shape, slopes = kind.shapes(linear @ kind.places[:kind.corners])
    return np.where(abs(shape) > ROUNDING, shape, 0.0), np.einsum("pkc,fki->fpci", slopes[..., :2], nodes)


def _line(divisions: int, even: bool) -> tuple[Floats, Floats, int]:
    """Shape functions (P, 2) of points on a line, their shares (P,) and the sum of these, even or by Simpson's rule of each part."""
    along = np.linspace(0, 1, 2 * divisions + 1)
    share = np.tile([2.0, 2.0 if even else 4.0], divisions + 1)[:-1]
    share[[0, -1]] = 1
    return np.stack([1 - along, along], axis=1), share, (4 if even else 6) * divisions


def _on_quadrilateral(divisions: int, even: bool) -> tuple[Floats, Floats]:
    """Shape functions (P, 4) and shares of the area (P,): by Simpson of each part corners, middles of edges, centre.

    All shares are positive, and a pressure that is linear over a facet gives its exact nodal forces; on triangles an even one does.
    """
    one, share, total = _line(divisions, even)
    return np.einsum("ia,jb->ijab", one, one).reshape(-1, 4)[:, [0, 2, 3, 1]], np.outer(share, share).ravel() / total**2


# Points (a, b) of a triangle that is 1 or 2 points wide, and 12 times their shares.
CORNERS = 1, ((0, 0, 4), (1, 0, 4), (0, 1, 4))
AND_MIDDLES = 2, ((0, 0, 1), (2, 0, 1), (0, 2, 1), (1, 0, 3), (0, 1, 3), (1, 1, 3))


def _on_triangle(divisions: int, even: bool) -> tuple[Floats, Floats]:
    """Shape functions (P, 3) and shares of the area (P,): of each part corners (1/12) and middles (1/4), or of its quarters corners."""
    ends = 2 * divisions
    share = np.zeros((ends + 1, ends + 1))
    wide, points = CORNERS if even else AND_MIDDLES
    n = ends // wide
    upright = [(wide * i, wide * j, 1) for i in range(n) for j in range(n - i)]
    upside_down = [(wide * i, wide * j, -1) for i in range(1, n) for j in range(1, n - i + 1)]
    for i, j, turn in (*upright, *upside_down):
        for a, b, part in points:
            share[i + turn * a, j + turn * b] += part / 12 / n**2
    s, t = np.argwhere(share > 0).T
    return np.stack([ends - s - t, s, t], axis=1) / ends, share[s, t]


def merged(weights: scipy.sparse.csr_matrix, area: Floats) -> tuple[scipy.sparse.csr_matrix, Floats]:
    """Points that several facets share, made one, with the sum of their areas."""
    weights.eliminate_zeros()
    weights.sort_indices()
    nodes = np.diff(weights.indptr)
    key = np.zeros((len(nodes), 1 + 2 * int(nodes.max(initial=0))))
    key[:, 0] = nodes
    for i in range(int(nodes.max(initial=0))):
        has = key[:, 0] > i
        at = weights.indptr[:-1][has] + i
        key[has, 2 * i + 1], key[has, 2 * i + 2] = weights.indices[at], weights.data[at].round(9)
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return weights[first], np.bincount(group.ravel(), weights=area).astype(np.float64)
