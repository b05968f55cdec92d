"""Where on a body's surface contact is felt: points of its facets, with the share of the area that each stands for.

A point x_q = sum_a w_qa x_a over the nodes of a facet stands for an area A_q of the rest surface.

Legend: N nodes, Q points, F facets of k nodes, P points of one.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, Cell
from physics.mesh.mesh import Mesh

Floats = NDArray[np.float64]

ROUNDING = 1e-12  # of a shape function


def points_of(mesh: Mesh, divisions: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Point number, node and weight triplets, and areas, of the points of all facets, each facet divided along its edges."""
    rows, columns, values, areas, count = [], [], [], [], 0
    line, along = _simpson(divisions)
    rules = {4: _on_quadrilateral(divisions), 3: _on_triangle(divisions), 2: (line, along / (6 * divisions))}
    for facets in mesh.boundary:
        kind = CELLS[mesh.kind_of(facets)]
        shape, share = rules[kind.corners]
        corner = mesh.points[facets]
        if kind.middles:
            shape, tangents = _of_second_order(kind, shape, corner)
            if mesh.dimension == 2:
                tangents[:, :, 1, 2] = mesh.thickness
            size = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2) * kind.weights.sum()
        elif facets.shape[1] == 2:
            size = np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1) * mesh.thickness
        elif facets.shape[1] == 3:
            size = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2
        else:
            size = np.linalg.norm(np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]), axis=1) / 2
        q = count + np.arange(len(facets) * len(share)).reshape(len(facets), len(share))
        point, node = np.broadcast_arrays(q[:, :, None], facets[:, None, :])
        weight = np.broadcast_to(shape, point.shape)
        rows.append(point.ravel())
        columns.append(node.ravel())
        values.append(weight.ravel())
        areas.append((size.reshape(len(facets), -1) * share).ravel())
        count += q.size
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values), np.concatenate(areas)


def _of_second_order(kind: Cell, linear: Floats, nodes: Floats) -> tuple[Floats, Floats]:
    """Shape functions (P, k) at points given by those of first order (P, corners), and tangents (F, P, 2, 3) of facets there."""
    shape, slopes = kind.shapes(linear @ kind.places[:kind.corners])
    return np.where(abs(shape) > ROUNDING, shape, 0.0), np.einsum("pkc,fki->fpci", slopes[..., :2], nodes)


def _simpson(divisions: int) -> tuple[Floats, Floats]:
    """Shape functions (P, 2) and shares (P,) of a line times 6 divisions, by Simpson's rule: of each part ends and middle."""
    along = np.linspace(0, 1, 2 * divisions + 1)
    share = np.tile([2.0, 4.0], divisions + 1)[:-1]
    share[[0, -1]] = 1
    return np.stack([1 - along, along], axis=1), share


def _on_quadrilateral(divisions: int) -> tuple[Floats, Floats]:
    """Shape functions (P, 4) and shares of the area (P,) of Simpson's rule: of each part corners, middles of edges, centre.

    All shares are positive, and a pressure that is linear over a facet gives its exact nodal forces; on triangles an even one does.
    """
    one, share = _simpson(divisions)
    return np.einsum("ia,jb->ijab", one, one).reshape(-1, 4)[:, [0, 2, 3, 1]], np.outer(share, share).ravel() / (6 * divisions) ** 2


def _on_triangle(divisions: int) -> tuple[Floats, Floats]:
    """Shape functions (P, 3) and shares of the area (P,): of each part corners (1/12) and middles of edges (1/4)."""
    ends = 2 * divisions
    share = np.zeros((ends + 1, ends + 1))
    upright = [(2 * i, 2 * j, 1) for i in range(divisions) for j in range(divisions - i)]
    upside_down = [(2 * i, 2 * j, -1) for i in range(1, divisions) for j in range(1, divisions - i + 1)]
    for i, j, turn in (*upright, *upside_down):
        for a, b, part in ((0, 0, 1), (2, 0, 1), (0, 2, 1), (1, 0, 3), (0, 1, 3), (1, 1, 3)):
            share[i + turn * a, j + turn * b] += part / 12 / divisions**2
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
