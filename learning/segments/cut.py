"""Cut the body's mesh into K segments, each in one piece: METIS first, then graph superpixels.

The refinement moves nodes at the border of a segment to the neighbouring segment whose centroid C_k (the mean over its
nodes) is nearest in

    d(i, C_k) = |f_obs(i) - f_obs(C_k)| + |f_md(i) - f_md(C_k)| + tau |x_i - x(C_k)|

with f_obs of the distance to the obstacle, f_md the modes, x the place, all in segment sizes (features.py). The methods:

    metis          no refinement
    slic-od        obstacle distance d         slic-od-l    log(d)              slic-od-e      exp(-d)
    slic-md        modes                       slic-mdod-l  modes and log(d)    slic-mdod-e    modes and exp(-d)

Contiguity: a node moves only to a segment of one of its mesh neighbours; after every sweep each segment keeps its largest
piece, and the nodes of other pieces are handed to touching segments, one layer at a time. The node nearest to its
centroid never moves, so no segment runs empty. The paper's rule to move only when d <= S compares a length with a pure
number and is left out.

Symmetric meshes have nodes at equal distance from several segments. Distances that differ by less than 1e-5 count as equal:
then a node stays, or goes to the segment of the lower number, and rounding decides nothing (modes are stored in single
precision, and packed to 1e-6).

Legend: N nodes of the body, E edges (each in both directions, sorted by their first node), K segments, F features.
Source: Lei et al., M4GN, algorithm 2; Karypis and Kumar 1998 (METIS); Achanta et al. 2012 (SLIC).
"""

from __future__ import annotations

import os
import sys

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from datagen.files.trajectory import Trajectory
from learning.segments.edges import mesh_edges
from learning.segments.features import METHODS, MODES, Features, features
from physics.schema import InputError, nearest

# PETSc brings Debian's METIS, of 32-bit numbers, into the same process; pymetis has to call its own, of 64-bit numbers, or
# it writes past the end of arrays.
_flags = sys.getdlopenflags()
sys.setdlopenflags(_flags | os.RTLD_DEEPBIND)
import pymetis  # noqa: E402

sys.setdlopenflags(_flags)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
TIE = 1e-5  # [segment sizes] distances this close are equal


def segment(trajectory: Trajectory, *, count: int = 19, method: str = "slic-mdod-e", tau: float = 0.5, modes: str = "elastic",
            mode_count: int = 1, iterations: int = 10) -> NDArray[np.int32]:
    """The segment of every node of a trajectory.

    Args:
        trajectory: its rest positions, cells, node kinds, modes and frequencies are used, nothing of its motion
        count: K, segments of the body
        method: one of METHODS
        tau: weight of position against features; compact segments when large
        modes: elastic for solids, laplacian for fluids
        mode_count: how many of them; those within 2 % of the last one's frequency come on top
        iterations: most sweeps of the refinement, which ends by itself once no node moves

    Returns:
        (N + obstacle nodes,) int32, body 0 .. K-1, and K on the obstacle (fewer than K only where METIS leaves one empty)

    Raises:
        InputError: unknown method, more segments than nodes, a mesh that is not in one piece, no modes or no obstacle where
            they are needed
    """
    for name, value, choice in (("segmentation method", method, METHODS), ("modes", modes, MODES)):
        if value not in choice:
            raise InputError(f"{name} {value!r}: must be one of {', '.join(choice)}{nearest(value, choice)}")
    if not 0 <= tau < np.inf:
        raise InputError(f"tau = {tau:g}: must be at least 0, and finite")
    graph = body_graph(trajectory)
    nodes = graph.shape[0]
    if not 1 <= count <= nodes:
        raise InputError(f"{count} segments: must be from 1 to the {nodes} nodes of the body")
    pieces, piece = connected_components(graph, directed=False)
    if pieces > 1:
        raise InputError(f"the body's mesh falls into {pieces} pieces, the smallest of {np.bincount(piece).min()} nodes: "
                         f"only a connected mesh can be segmented")

    edges = ends(graph)
    feature = features(trajectory, edges, count=count, method=method, tau=tau, modes=modes, mode_count=mode_count)
    _, label = np.unique(_metis(graph, count), return_inverse=True)  # (N,) without gaps
    label = _reattach(label, edges, feature)
    if method != "metis":
        for _ in range(iterations):
            refined = _reattach(_sweep(label, edges, feature), edges, feature)
            if np.array_equal(refined, label):
                break
            label = refined
    result = np.full(len(trajectory.points), label.max() + 1, np.int32)
    result[trajectory.body] = label
    return result


def body_graph(trajectory: Trajectory) -> csr_matrix:
    """(N, N) adjacency of the body's nodes along its mesh edges: ones, symmetric, indices sorted."""
    edges = mesh_edges(trajectory)
    edges = edges[trajectory.body[edges].all(axis=1)]
    node, other = np.concatenate([edges, edges[:, ::-1]]).T
    nodes = int(trajectory.body.sum())
    return coo_matrix((np.ones(len(node), np.int8), (node, other)), shape=(nodes, nodes)).tocsr()


def ends(graph: csr_matrix) -> Integers:
    """(2, E) the ends of a graph's edges, in both directions, sorted by the first and then the second."""
    return np.stack([np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr)), graph.indices])


def _metis(graph: csr_matrix, count: int) -> Integers:
    """(N,) parts of a graph in which METIS cuts few edges and keeps the parts of equal size."""
    if count == 1:
        return np.zeros(graph.shape[0], np.int64)
    _, parts = pymetis.part_graph(count, pymetis.CSRAdjacency(graph.indptr, graph.indices))
    return np.array(parts, np.int64)


def _centroids(label: Integers, table: Floats) -> Floats:
    """(K, F) means of the features of each segment."""
    return np.stack([np.bincount(label, weights=column) for column in table.T], axis=1) / np.bincount(label)[:, None]


def _nearest_of(node: Integers, candidate: Integers, distance: Floats) -> tuple[Integers, Integers, Floats]:
    """Of several candidates for each node, sorted by node, the lowest of the nearest: nodes, their candidates, distances."""
    if not len(node):
        return node, candidate, distance
    first = np.flatnonzero(np.concatenate([[True], node[1:] != node[:-1]]))
    least = np.minimum.reduceat(distance, first)
    tied = distance <= np.repeat(least + TIE, np.diff(first, append=len(node)))
    return node[first], np.minimum.reduceat(np.where(tied, candidate, candidate.max()), first), least


def _sweep(label: Integers, edges: Integers, feature: Features) -> Integers:
    """Every border node goes to the nearest of the segments that it touches, all at once."""
    centroid = _centroids(label, feature.table)
    own = feature.distance(np.arange(len(label)), centroid[label])  # (N,)
    other = label[edges[1]]
    border = np.flatnonzero(label[edges[0]] != other)
    node, candidate = edges[0, border], other[border]
    node, candidate, distance = _nearest_of(node, candidate, feature.distance(node, centroid[candidate]))
    moves = distance < own[node] - TIE
    moved = label.copy()
    moved[node[moves]] = candidate[moves]
    order = np.argsort(label, kind="stable")
    keep = _nearest_of(label[order], order, own[order])[1]  # (K,) the node nearest to each centroid
    moved[keep] = label[keep]
    return moved


def _reattach(label: Integers, edges: Integers, feature: Features) -> Integers:
    """Each segment keeps its largest piece; the other pieces go to the segments around them, layer by layer."""
    nodes = len(label)
    within = np.flatnonzero(label[edges[0]] == label[edges[1]])
    start = np.concatenate([[0], np.cumsum(np.bincount(edges[0, within], minlength=nodes))])
    inside = csr_matrix((np.ones(len(within), np.int8), edges[1, within], start), shape=(nodes, nodes))
    pieces, piece = connected_components(inside, directed=False)
    if pieces == label.max() + 1:
        return label
    owner = np.empty(pieces, np.int64)
    owner[piece] = label  # the segment of each piece
    order = np.lexsort((-np.bincount(piece), owner))  # the largest piece of each segment comes first
    stray = np.ones(pieces, bool)
    stray[order[np.concatenate([[True], np.diff(owner[order]) > 0])]] = False
    loose = stray[piece]
    label = label.copy()
    centroid = _centroids(label, feature.table)
    while loose.any():
        touching = np.flatnonzero(loose[edges[0]] & ~loose[edges[1]])
        node, candidate = edges[0, touching], label[edges[1, touching]]
        node, candidate, _ = _nearest_of(node, candidate, feature.distance(node, centroid[candidate]))
        label[node] = candidate
        loose[node] = False
    return label
