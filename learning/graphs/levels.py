"""Coarser graphs above a mesh by bi-stride pooling, and how numbers and contact edges get from one to the next.

Every connected part of a graph is pooled on its own. A breadth-first search from a node in its middle tells hop distances; kept are
the nodes at even distances, or those at odd ones where these are fewer (a lone node is kept). With A the adjacency,

    coarser edges     (A + I)^2 > 0        without the diagonal, among kept nodes: two hops become one, so no part falls apart
    contact edges     (A + I) C (A + I) > 0        likewise: contact is felt where a neighbour feels it
    pooling           x'_j = sum_i T_ji x_i,    T_ji = (w_i / d_i) / sum_k (w_k / d_k) over the neighbours of the kept node j
    and back          x_i = sum_j T_ji x'_j

d are degrees, w is 1 on the mesh and sum_k (w_k / d_k) on the kept nodes of the next level; nothing is learned. A node without
neighbours keeps what it has (in the authors' code it would get zeros).

The middle of a part is the node nearest to the mean of its rest positions; among several, the first along x, y, z.

Legend: N nodes of a level, n of the next coarser one, E edges, M entries of T.
Source: Cao et al. 2023 (arXiv:2210.02573), sections 3.1 to 3.3, and its code, https://github.com/Eydcao/BSMS-GNN.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, identity
from scipy.sparse.csgraph import connected_components

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Level:
    """One coarser graph, and how it is reached from the one below.

    kept: (n,) its nodes, by their numbers in the graph below
    pair: (2, E) senders and receivers among them, sorted by receiver
    give, weight: (2, M) nodes of the finer graph and of this one, (M,) the entries of T
    near: (n, N) A + I of the finer graph, rows of kept nodes
    """

    kept: Integers
    pair: Integers
    give: Integers
    weight: NDArray[np.float32]
    near: Any


def hierarchy(pair: Integers, rest: NDArray[np.float64], rank: Integers, count: int) -> tuple[Level, ...]:
    """Coarser and coarser graphs above a mesh.

    Args:
        pair: (2, E) mesh edges in both directions
        rest: (N, D) rest positions [m]
        rank: (N,) place of each node in an order that does not depend on its number
        count: how many levels
    """
    levels, weight = [], np.ones(len(rest))
    for _ in range(count):
        nodes = len(rest)
        adjacency = csr_matrix((np.ones(pair.shape[1]), (pair[1], pair[0])), shape=(nodes, nodes))
        kept = _kept(adjacency, rest, rank)
        near = (adjacency + identity(nodes, format="csr"))[kept]
        give, share, weight = _transfer(adjacency, weight, kept)
        pair = _pairs(near @ near.T)
        rest, rank = rest[kept], rank[kept]
        levels.append(Level(kept, pair, give, share, near))
    return tuple(levels)


def lifted(contact: Integers, nodes: int, levels: tuple[Level, ...]) -> list[Integers]:
    """The contact edges (2, W) of a mesh on each of its levels."""
    found = []
    for level in levels:
        if contact.shape[1]:
            touching = csr_matrix((np.ones(contact.shape[1]), (contact[1], contact[0])), shape=(nodes, nodes))
            contact = _pairs(level.near @ touching @ level.near.T)
        nodes = len(level.kept)
        found.append(contact)
    return found


def _pairs(matrix: csr_matrix) -> Integers:
    """(2, E) columns and rows of the entries beside the diagonal, sorted by row."""
    entries = matrix.tocoo()
    away = entries.row != entries.col
    sender, receiver = entries.col[away].astype(np.int64), entries.row[away].astype(np.int64)
    return np.stack([sender, receiver])[:, np.lexsort((sender, receiver))]


def _kept(adjacency: csr_matrix, rest: NDArray[np.float64], rank: Integers) -> Integers:
    """The nodes of the next level, ascending."""
    _, part = connected_components(adjacency, directed=False)
    size = np.bincount(part)
    middle = np.stack([np.bincount(part, weights=axis) / size for axis in rest.T], axis=1)
    away = np.linalg.norm(rest - middle[part], axis=1)
    away = np.round(away / (away.max() or 1.0), 9)  # nodes at one distance shall not be told apart by rounding
    order = np.lexsort((rank, away, part))
    seeds = order[np.concatenate([[0], np.cumsum(size)[:-1]])]
    hops, front, reached = np.zeros(len(rest), np.int64), np.zeros(len(rest), bool), np.zeros(len(rest), bool)
    front[seeds] = reached[seeds] = True
    while front.any():
        front = (adjacency @ front > 0) & ~reached
        reached |= front
        hops[front] = hops[~front & reached].max() + 1
    odd = hops % 2 == 1
    odds = np.bincount(part, weights=odd)
    fewer = (odds > 0) & (odds < size - odds)  # the parts of which the odd ones are kept
    return np.flatnonzero(odd == fewer[part])


def _transfer(adjacency: csr_matrix, weight: NDArray[np.float64],
              kept: Integers) -> tuple[Integers, NDArray[np.float32], NDArray[np.float64]]:
    """give and share of a level, and w of its nodes."""
    degree = np.diff(adjacency.indptr)
    lone = degree == 0
    rows = (adjacency + csr_matrix((lone.astype(float), (np.arange(len(lone)), np.arange(len(lone))))))[kept].tocoo()
    sent = (weight / np.maximum(degree, 1))[rows.col]
    total = np.asarray(np.bincount(rows.row, weights=sent, minlength=len(kept)), np.float64)
    return np.stack([rows.col, rows.row]).astype(np.int64), np.asarray(sent / total[rows.row], np.float32), total
