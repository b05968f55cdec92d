"""Random-walk structural encodings: where a node is in the mesh, and a segment among segments, told by the graph alone.

A walk goes from a node to one of its neighbours by chance, in proportion to the weights A of the edges: P = D^-1 A with D the
sums of the rows of A. The encoding of node i is how likely walks of 1, 2 ... w steps that start there end there,

    p_i = [ P_ii, (P^2)_ii, ..., (P^w)_ii ]

At a boundary walks come back more often than inside, and the next lengths tell how far the boundary is. The mesh graph has
A = 1 on every edge, so P_ii = 0. The graph of segments is weighted, and has loops: A^K_ST = sum of A_mn over m in V_S, n in V_T,
in which an edge inside of S counts twice. The obstacle's segment touches no other, so all its walks come back.

The diagonal of P^k is that of (D^-1/2 A D^-1/2)^k =: M^k, and M is symmetric: (M^(a+b))_ii = sum_j (M^a)_ij (M^b)_ij. So walks of
w steps take powers up to w / 2 only, made for some rows at a time. A node without edges stays where it is: p_i = 1.

Legend: N nodes, K segments, E edges, M further memberships of nodes, w steps of the longest walk.
Source: Dwivedi et al. 2021 (arXiv:2110.07875), section 3; Rampasek et al. 2022 (arXiv:2205.12454); Lei et al., M4GN, "Position Encoding".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags, identity

Integers = NDArray[np.integer]
ROWS = 4096  # at a time


def mesh_graph(pair: Integers, nodes: int) -> csr_matrix:
    """(N, N) adjacency of a mesh from its edges (2, E) in both directions, with ones for the way to itself of a lone node."""
    lone = np.setdiff1d(np.arange(nodes), pair[0])
    ends = np.concatenate([pair, np.stack([lone, lone])], axis=1)
    return csr_matrix((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(nodes, nodes))


def segment_graph(graph: csr_matrix, segment: Integers, shared: Integers | None = None) -> csr_matrix:
    """(K, K) weights between segments.

    Args:
        graph: (N, N) adjacency of the nodes
        segment: (N,) own segment of each node
        shared: (2, M) nodes and the further segments they belong to
    """
    nodes, own = np.arange(len(segment)), segment
    if shared is not None:
        nodes, own = np.concatenate([nodes, shared[0]]), np.concatenate([own, shared[1]])
    member = csr_matrix((np.ones(len(nodes)), (nodes, own)), shape=(len(segment), int(segment.max()) + 1))
    return (member.T @ graph @ member).tocsr()


def random_walk(adjacency: csr_matrix, steps: int) -> NDArray[np.float32]:
    """(N, w) chances that walks of 1 .. w steps come back; the adjacency is symmetric, with a positive sum in every row."""
    scale = diags(1 / np.sqrt(np.asarray(adjacency.sum(axis=1)).ravel()))
    walk = (scale @ adjacency @ scale).tocsr()
    nodes, start = walk.shape[0], identity(walk.shape[0], format="csr")
    found = np.empty((nodes, steps))
    for first in range(0, nodes, ROWS):
        rows = slice(first, first + ROWS)
        before = start[rows]
        for step in range(1, steps + 1, 2):  # before = M^((step - 1) / 2)
            after = before @ walk
            found[rows, step - 1] = np.asarray(before.multiply(after).sum(axis=1)).ravel()
            if step < steps:
                found[rows, step] = np.asarray(after.multiply(after).sum(axis=1)).ravel()
            before = after
    return found.astype(np.float32)
