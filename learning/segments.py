"""Cut the body's mesh into K segments, each in one piece: METIS first, then graph superpixels.

The refinement moves nodes at the border of a segment to the neighbouring segment whose centroid C_k (the mean over its
nodes) is nearest in

    d(i, C_k) = |f_obs(i) - f_obs(C_k)| + |f_md(i) - f_md(C_k)| + tau |x_i - x(C_k)|

In raw metres these terms do not compare: 19 segments of a 100 mm beam are some 13 mm wide, so tau |x| is near 0.01, while
exp(-d) of a distance in metres is 0.9 to 1 on the whole beam and a mode's amplitude is arbitrary. Here every term is
counted in segment sizes S = l (N / K)^(1/3), with l the mean edge length [m]: the edge of a cube that holds as much as a
segment.

    x           rest position / S
    f_obs       exp(-d / S), d the distance [m] at step 0 to the nearest obstacle node; 0 without an obstacle
    f_md        mode / (S g), g the mean over mesh edges of |mode_i - mode_j| / |x_i - x_j| : on the average a mode changes
                by 1 over one segment size, so segments are short where it is steep and long where it is flat

The result does not depend on a mode's sign: |f_md(i) - f_md(C_k)| is the same for -f_md, to the last bit, so the mode
enters as it is; its amplitude |mode| would also be free of sign, but has a kink at every nodal line and lumps both sides
of it together. By the same argument the modes of a multiple eigenvalue (the two bending planes of a square beam) may be
any combination of each other: all modes within 2 % of the lowest frequency are taken, scaled to unit mean square. The
paper takes the first for solids.

Contiguity: a node moves only to a segment of one of its mesh neighbours; after every sweep each segment keeps its largest
piece, and the nodes of other pieces are handed to touching segments, one layer at a time. The node nearest to its
centroid never moves, so no segment runs empty. The paper's rule to move only when d <= S compares a length with a pure
number and is left out.

Legend: N nodes of the body, E edges (each in both directions), K segments, F features, m modes.
Source: Lei et al., M4GN, algorithm 2 and appendix "Segmentation Quality Metrics"; Karypis and Kumar 1998 (METIS);
Achanta et al. 2012 (SLIC).
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from datagen.trajectory import Trajectory
from learning.graph import mesh_edges
from physics.schema import InputError, nearest

# PETSc brings Debian's METIS, of 32-bit numbers, into the same process; pymetis has to call its own, of 64-bit numbers, or
# it writes past the end of arrays.
_flags = sys.getdlopenflags()
sys.setdlopenflags(_flags | os.RTLD_DEEPBIND)
import pymetis  # noqa: E402

sys.setdlopenflags(_flags)

METHODS = ("metis", "slic-mdod-e")
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Features:
    """What the superpixel distance compares: obstacle (N, 1), mode (N, 3m), position (N, 3), counted in segment sizes."""

    obstacle: Floats
    mode: Floats
    position: Floats

    def distance(self, node: Integers, segment: Integers, centroid: Floats, tau: float) -> Floats:
        """d between listed nodes and the centroids (K, F) of listed segments."""
        difference = self.table[node] - centroid[segment]
        split = 1 + self.mode.shape[1]
        parts = difference[:, :1], difference[:, 1:split], difference[:, split:]
        obstacle, mode, position = (np.sqrt((part * part).sum(axis=1)) for part in parts)
        return obstacle + mode + tau * position

    @property
    def table(self) -> Floats:
        """(N, F) all features side by side."""
        return np.concatenate([self.obstacle, self.mode, self.position], axis=1)


def segment(trajectory: Trajectory, *, count: int = 19, method: str = "slic-mdod-e", tau: float = 0.5,
            iterations: int = 10) -> NDArray[np.int32]:
    """The segment of every node of a trajectory.

    Args:
        trajectory: its rest positions, cells, node kinds, modes and frequencies are used, nothing of its motion
        count: K, segments of the body
        method: metis, or slic-mdod-e (obstacle distance by exp, and modes)
        tau: weight of position against features; compact segments when large
        iterations: most sweeps of the refinement, which ends by itself once no node moves

    Returns:
        (N + obstacle nodes,) int32, body 0 .. K-1, and K on the obstacle (fewer than K only where METIS leaves one empty)

    Raises:
        InputError: unknown method, more segments than nodes, a mesh that is not in one piece, no modes where they are needed
    """
    if method not in METHODS:
        raise InputError(f"segmentation method {method!r}: must be one of {', '.join(METHODS)}{nearest(method, METHODS)}")
    edges = _body_edges(trajectory)
    nodes = int(trajectory.body.sum())
    if not 1 <= count <= nodes:
        raise InputError(f"{count} segments: must be from 1 to the {nodes} nodes of the body")
    pieces, piece = connected_components(_adjacency(edges, nodes), directed=False)
    if pieces > 1:
        raise InputError(f"the body's mesh falls into {pieces} pieces, the smallest of {np.bincount(piece).min()} nodes: "
                         f"only a connected mesh can be segmented")

    features = _features(trajectory, edges, count, method)
    _, label = np.unique(_metis(edges, nodes, count), return_inverse=True)  # (N,) without gaps
    label = _reattach(label, edges, features, tau)
    if method != "metis":
        for _ in range(iterations):
            refined = _reattach(_sweep(label, edges, features, tau), edges, features, tau)
            if np.array_equal(refined, label):
                break
            label = refined
    result = np.full(len(trajectory.points), label.max() + 1, np.int32)
    result[trajectory.body] = label
    return result


def segment_quality(trajectory: Trajectory, segments: NDArray[np.integer]) -> dict[str, float]:
    """How well segments separate on the body's mesh graph.

    conductance: mean over segments of (edges leaving the segment) / min(vol S, vol of the rest), vol = sum of node degrees
    edge_cut_ratio: edges between segments / all edges
    """
    edges = _body_edges(trajectory)
    label = segments[trajectory.body]
    cut = label[edges[0]] != label[edges[1]]
    volume = np.bincount(label[edges[0]])  # (K,)
    rest = np.minimum(volume, volume.sum() - volume)
    crossing = np.bincount(label[edges[0]], weights=cut)
    conductance = np.divide(crossing, rest, out=np.zeros(len(rest)), where=rest > 0)
    return {"conductance": float(conductance.mean()), "edge_cut_ratio": float(cut.mean())}


def _body_edges(trajectory: Trajectory) -> Integers:
    """(2, E) edges between nodes of the body, in both directions."""
    edges = mesh_edges(trajectory)
    edges = edges[trajectory.body[edges].all(axis=1)]
    return np.ascontiguousarray(np.concatenate([edges, edges[:, ::-1]]).T)


def _adjacency(edges: Integers, nodes: int) -> coo_array:
    return coo_array((np.ones(edges.shape[1], np.int8), (edges[0], edges[1])), shape=(nodes, nodes))


def _metis(edges: Integers, nodes: int, count: int) -> Integers:
    """(N,) parts of a graph in which METIS cuts few edges and keeps the parts of equal size."""
    if count == 1:
        return np.zeros(nodes, np.int64)
    graph = _adjacency(edges, nodes).tocsr()
    _, parts = pymetis.part_graph(count, pymetis.CSRAdjacency(graph.indptr, graph.indices))
    return np.array(parts, np.int64)


def _features(trajectory: Trajectory, edges: Integers, count: int, method: str) -> Features:
    """Features of the body's nodes; position alone for METIS, where only its stray pieces need a distance."""
    points = trajectory.points[trajectory.body]
    span = np.linalg.norm(points[edges[0]] - points[edges[1]], axis=1)  # (E,)
    size = span.mean() * (len(points) / count) ** (1 / 3)
    obstacle, mode = np.zeros((len(points), 1)), np.zeros((len(points), 0))
    if method != "metis":
        if not len(trajectory.modes):
            raise InputError(f"the trajectory carries no modes, which method {method!r} needs; method 'metis' does without")
        if not trajectory.body.all():
            rigid = trajectory.points[~trajectory.body] + trajectory.displacement[0, ~trajectory.body]
            obstacle = np.exp(-cKDTree(rigid).query(points)[0] / size)[:, None]
        mode = _lowest_modes(trajectory)
        steepness = (np.linalg.norm(mode[edges[0]] - mode[edges[1]], axis=1) / span).mean()
        mode = mode / (size * steepness) if steepness > 0 else mode
    return Features(obstacle, mode, points / size)


def _lowest_modes(trajectory: Trajectory) -> Floats:
    """(N, 3m) the m modes of the lowest frequency, each of unit mean square."""
    frequency = np.array(trajectory.frequencies_hz or (1.0,))
    lowest = np.flatnonzero(frequency <= 1.02 * frequency.min())
    modes = trajectory.modes[lowest][:, trajectory.body].astype(np.float64)  # (m, N, 3)
    modes = modes / np.sqrt((modes**2).sum(axis=2).mean(axis=1))[:, None, None]
    return modes.transpose(1, 0, 2).reshape(modes.shape[1], -1)


def _centroids(label: Integers, table: Floats) -> Floats:
    """(K, F) means of the features of each segment."""
    count = np.bincount(label)
    return np.stack([np.bincount(label, weights=column) for column in table.T], axis=1) / count[:, None]


def _nearest_of(node: Integers, candidate: Integers, distance: Floats) -> tuple[Integers, Integers, Floats]:
    """Of several candidates for each node the one at the least distance: nodes, their candidates, distances."""
    order = np.lexsort((candidate, distance, node))
    first = order[np.r_[True, node[order][1:] != node[order][:-1]]] if len(order) else order
    return node[first], candidate[first], distance[first]


def _sweep(label: Integers, edges: Integers, features: Features, tau: float) -> Integers:
    """Every border node goes to the nearest of the segments that it touches, all at once."""
    nodes = np.arange(len(label))
    centroid = _centroids(label, features.table)
    own = features.distance(nodes, label, centroid, tau)  # (N,)
    border = label[edges[0]] != label[edges[1]]
    node, candidate = edges[0, border], label[edges[1, border]]
    node, candidate, distance = _nearest_of(node, candidate, features.distance(node, candidate, centroid, tau))
    moves = distance < own[node]
    moved = label.copy()
    moved[node[moves]] = candidate[moves]
    keep = _nearest_of(label, nodes, own)[1]  # (K,) the node nearest to each centroid
    moved[keep] = label[keep]
    return moved


def _reattach(label: Integers, edges: Integers, features: Features, tau: float) -> Integers:
    """Each segment keeps its largest piece; the other pieces go to the segments around them, layer by layer."""
    within = label[edges[0]] == label[edges[1]]
    _, piece = connected_components(_adjacency(edges[:, within], len(label)), directed=False)
    owner = np.zeros(piece.max() + 1, np.int64)
    owner[piece] = label  # the segment of each piece
    size = np.bincount(piece)
    _, largest, _ = _nearest_of(owner, np.arange(len(size)), -size.astype(float))  # (K,)
    loose = ~np.isin(piece, largest)
    if not loose.any():
        return label
    label = label.copy()
    centroid = _centroids(label, features.table)
    while loose.any():
        touching = loose[edges[0]] & ~loose[edges[1]]
        node, candidate = edges[0, touching], label[edges[1, touching]]
        node, candidate, _ = _nearest_of(node, candidate, features.distance(node, candidate, centroid, tau))
        label[node] = candidate
        loose[node] = False
    return label
