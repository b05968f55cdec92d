"""Clusters of equal size by place alone: k-means in which every cluster keeps its number of nodes.

    min  sum_i |x_i - c(i)|^2,    c(i) the mean of the cluster of i,    sizes of any two clusters differing by one at most

It begins with the body halved again and again across its longest side. Then, as long as that brings clusters' nodes nearer to
their means, two clusters swap a node each: of all pairs of clusters the best swaps first, means anew after each round.

The result does not depend on how nodes are numbered: they are taken in the order of their places along x, y, z.

Legend: N nodes, K clusters, D space dimensions.
Source: Janny et al. 2023 (EAGLE, arXiv:2302.10803), which takes "same-size k-means" with nodes assigned greedily and then swapped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import Trajectory

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
ROUNDS = 200


def clusters_of(trajectory: Trajectory, size: int) -> NDArray[np.int32]:
    """(N,) cluster of each node, at most `size` nodes in each; the obstacle, which moves against the body, has clusters of its own."""
    label, first = np.zeros(len(trajectory.points), np.int64), 0
    for part in (trajectory.body, ~trajectory.body):
        if part.any():
            label[part] = first + same_size(trajectory.points[part], size)
            first = int(label.max()) + 1
    return label.astype(np.int32)


def same_size(points: Floats, size: int) -> Integers:
    """(N,) cluster of each point (N, D)."""
    order, count = np.argsort(ranks(points)), -(-len(points) // size)
    x = _levelled(points)[order]
    label = np.zeros(len(x), np.int64)
    _halve(x, np.arange(len(x)), 0, count, label)
    clusters = np.arange(count)
    for _ in range(ROUNDS if count > 1 else 0):
        mean = np.stack([np.bincount(label, weights=axis) for axis in x.T], axis=1) / np.bincount(label)[:, None]
        squared = ((x[:, None] - mean) ** 2).sum(axis=2)  # (N, K)
        gain = squared[np.arange(len(x)), label][:, None] - squared  # of going there
        rows = np.argsort(label, kind="stable")
        best = np.maximum.reduceat(gain[rows], np.searchsorted(label[rows], clusters))  # (K, K) from, to
        swap = np.triu(best + best.T, 1)
        taken = np.zeros(count, bool)
        for a, b in zip(*np.unravel_index(np.argsort(-swap, axis=None, kind="stable"), swap.shape), strict=True):
            if swap[a, b] <= 1e-9 * squared.max():
                break
            if not (taken[a] or taken[b]):
                taken[[a, b]] = True
                i, j = (int(np.flatnonzero((label == own) & (gain[:, to] == best[own, to]))[0]) for own, to in ((a, b), (b, a)))
                label[i], label[j] = b, a
        if not taken.any():
            break
    found = np.empty_like(label)
    found[order] = label
    return found


def ranks(points: Floats) -> Integers:
    """(N,) place of each point in the order along x, then y, then z; points that differ by rounding alone count as level."""
    place = np.empty(len(points), np.int64)
    place[np.lexsort(_levelled(points).T[::-1])] = np.arange(len(points))
    return place


def _levelled(points: Floats) -> Floats:
    """(N, D) places from the lowest corner in units of the longest side, so that the same body elsewhere has the same numbers."""
    return np.round((points - points.min(axis=0)) / (np.ptp(points, axis=0).max() or 1.0), 9)


def _halve(x: Floats, nodes: Integers, first: int, count: int, label: Integers) -> None:
    """Number listed nodes by `count` clusters from `first` on."""
    if count == 1:
        label[nodes] = first
        return
    axis = int(np.argmax(np.round(np.ptp(x[nodes], axis=0), 9)))
    order = nodes[np.argsort(x[nodes, axis], kind="stable")]
    left = count // 2
    cut = len(nodes) * left // count
    _halve(x, order[:cut], first, left, label)
    _halve(x, order[cut:], first + left, count - left, label)
