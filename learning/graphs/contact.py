"""Pairs of nodes that are near each other: where bodies touch, or everywhere.

A k-d tree finds them, so the cost is near linear in the nodes. Pairs are (2, W) senders and receivers, in both directions, sorted
by receiver.

Source: Pfaff et al. 2021 (arXiv:2010.03409), section 3.1, for world edges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


def contact_edges(positions: NDArray[np.float64], obstacle: NDArray[np.bool_], radius: float) -> NDArray[np.int64]:
    """(2, W) every pair of an obstacle node and a body node within a radius [m] of each other."""
    rigid = np.flatnonzero(obstacle)
    if not len(rigid):
        return np.empty((2, 0), np.int64)
    low, high = positions[rigid].min(axis=0) - radius, positions[rigid].max(axis=0) + radius
    near = np.flatnonzero(~obstacle & ((positions >= low) & (positions <= high)).all(axis=1))
    found = cKDTree(positions[rigid]).sparse_distance_matrix(cKDTree(positions[near]), radius, output_type="ndarray")
    i, j = rigid[found["i"]], near[found["j"]]  # (W/2,) each
    pair = np.stack([np.concatenate([i, j]), np.concatenate([j, i])])  # (2, W)
    return pair[:, np.lexsort(pair)]


def world_edges(positions: NDArray[np.float64], mesh: NDArray[np.int64], radius: float) -> NDArray[np.int64]:
    """(2, W) every pair of nodes within a radius [m] of each other that is none of the mesh's (2, E) edges."""
    i, j = cKDTree(positions).query_pairs(radius, output_type="ndarray").T.astype(np.int64)
    pair = np.stack([np.concatenate([i, j]), np.concatenate([j, i])])
    pair = pair[:, ~np.isin(pair[1] * len(positions) + pair[0], mesh[1] * len(positions) + mesh[0])]
    return pair[:, np.lexsort(pair)]


def with_norm(vector: NDArray[np.floating]) -> NDArray[np.float32]:
    """(M, 3) vectors followed by their norms: (M, 4) float32."""
    return np.concatenate([vector, np.linalg.norm(vector, axis=1, keepdims=True)], axis=1).astype(np.float32)
