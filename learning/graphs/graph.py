"""From a trajectory to graphs: what the network sees of one frame.

Nodes are those of the trajectory file, body first, obstacle last. Two kinds of directed edges, each in both directions:

    mesh edges      the edges of the body's cells and of the obstacle's surface; they never change
    contact edges   between an obstacle node and a body node with |x_i - x_j| <= r_W; found anew in every frame

Features, with X rest positions, x current positions, v = x(t+1) - x(t) [m]; every one is free of the origin:

    node            one-hot of its kind (free, obstacle, held); the v of a node whose motion is prescribed (obstacle, or
                    held), on free nodes what the scheme knows of theirs, or zero (samples/samples.py); X_i - O, x_i - X_i, with O the
                    mean rest position of the held nodes (of the body, where none is held)
    mesh edge       X = X_s - X_r, |X|, x - X, |x| - |X|    [m], x = x_s - x_r, s sender, r receiver
    contact edge    x, |x|                                 [m]

The paper gives a node x_i and a mesh edge X and x. Here the changes x - X stand beside X: the same knowledge, but a strain of
1 % is lost in the spread of x over a mesh and stands out in that of x - X. The origin O makes x_i free of where the scene is.

Edges are sorted by receiver. A k-d tree finds the contact edges, so the cost is near linear in the nodes; a frame without
any contact has empty arrays of contact edges and nothing else differs.

Legend: N nodes, E mesh edges, W contact edges, K segments, B graphs in a batch.
Source: Pfaff et al. 2021 (arXiv:2010.03409), appendix A.1; Lei et al., M4GN, section "Micro-level module".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory
from learning.graphs.encoding import mesh_graph, random_walk, segment_graph
from learning.segments.edges import mesh_edges

KINDS = (NORMAL, OBSTACLE, HANDLE)
NODE_FEATURES, MESH_EDGE_FEATURES, CONTACT_EDGE_FEATURES = len(KINDS) + 9, 8, 4


@dataclass(frozen=True)
class Skeleton:
    """What stays the same over all frames of a trajectory.

    kind: (N, 3) float32 one-hot
    free: (N,) True on the nodes that are predicted
    rest: (N, 3) float64 rest positions [m]
    place: (N, 3) float32 rest positions from O [m]
    pair: (2, E) senders and receivers of the mesh edges
    rest_edge: (E, 4) float32 rest vector and its norm [m]
    segment: (N,) segment of each node, 0 .. K-1 without gaps
    shared: (2, M) nodes and the further segments they belong to; None without overlap
    node_code: (N, w), segment_code: (K, w) random-walk encodings; None without
    """

    kind: NDArray[np.float32]
    free: NDArray[np.bool_]
    rest: NDArray[np.float64]
    place: NDArray[np.float32]
    pair: NDArray[np.int64]
    rest_edge: NDArray[np.float32]
    segment: NDArray[np.int64]
    shared: NDArray[np.int64] | None = None
    node_code: NDArray[np.float32] | None = None
    segment_code: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class Graph:
    """One frame, or several as a disjoint union.

    node: (N, 12), mesh_edge: (E, 8), contact_edge: (W, 4) features
    mesh_pair: (2, E), contact_pair: (2, W) senders and receivers
    segment: (N,) segment of each node, counted through the batch
    graph_of_segment: (K,) the graph of each segment, ascending from 0
    shared, node_code, segment_code: as in Skeleton, counted through the batch
    """

    node: torch.Tensor
    mesh_edge: torch.Tensor
    mesh_pair: torch.Tensor
    contact_edge: torch.Tensor
    contact_pair: torch.Tensor
    segment: torch.Tensor
    graph_of_segment: torch.Tensor
    shared: torch.Tensor | None = None
    node_code: torch.Tensor | None = None
    segment_code: torch.Tensor | None = None


def build_skeleton(trajectory: Trajectory, segment: NDArray[np.integer], *, overlap: int = 0, walk: int = 0) -> Skeleton:
    """The constant part of a trajectory's graphs; reads nothing of its displacement.

    Args:
        trajectory: its points, cells and node kinds are used
        segment: (N,) segment of each node, as `learning.segments.cut.segment` gives it
        overlap: 1 to let nodes also belong to the segments of their neighbours
        walk: w, steps of the longest walk of the encodings; 0 for none
    """
    edges = mesh_edges(trajectory)
    senders, receivers = np.concatenate([edges, edges[:, ::-1]]).T  # (2E,) each
    order = np.lexsort((senders, receivers))
    pair = np.stack([senders[order], receivers[order]])  # (2, E)
    rest = trajectory.points
    vector = rest[pair[0]] - rest[pair[1]]
    kind = (trajectory.node_kind[:, None] == np.array(KINDS)).astype(np.float32)  # (N, 3)
    held = trajectory.node_kind == HANDLE
    place = (rest - rest[held if held.any() else trajectory.body].mean(axis=0)).astype(np.float32)  # (N, 3)
    label = segment.astype(np.int64)
    shared = neighbours(label, pair) if overlap else None
    node_code = segment_code = None
    if walk:
        graph = mesh_graph(pair, len(rest))
        node_code, segment_code = random_walk(graph, walk), random_walk(segment_graph(graph, label, shared), walk)
    return Skeleton(kind, trajectory.free, rest, place, pair, _with_norm(vector), label, shared, node_code, segment_code)


def neighbours(segment: NDArray[np.int64], pair: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which segments nodes belong to besides their own when segments overlap by one ring, V_k + Adj(V_k).

    Args:
        segment: (N,) own segment of each node
        pair: (2, E) ends of the mesh edges, in both directions

    Returns:
        (2, M) nodes and segments, each pair once, sorted by node
    """
    node, other = pair[0], segment[pair[1]]
    away = other != segment[node]
    count = int(segment.max()) + 1
    return np.stack(np.divmod(np.unique(node[away] * count + other[away]), count))


def build_graph(skeleton: Skeleton, positions: NDArray[np.float64], velocity: NDArray[np.floating], radius: float,
                known: NDArray[np.floating] | float = 0.0) -> Graph:
    """The graph of one frame.

    Args:
        positions: (N, 3) current positions [m]
        velocity: (N, 3) displacement to the next frame [m]; read on prescribed nodes only
        radius: r_W, the largest distance of a contact edge [m]
        known: (N, 3) what stands in its place on free nodes
    """
    velocity = np.where(skeleton.free[:, None], known, velocity).astype(np.float32)  # (N, 3)
    displacement = (positions - skeleton.rest).astype(np.float32)
    senders, receivers = skeleton.pair
    change = _with_norm(positions[senders] - positions[receivers]) - skeleton.rest_edge  # (E, 4)
    contact = contact_edges(positions, skeleton.kind[:, KINDS.index(OBSTACLE)] > 0, radius)
    segments = int(skeleton.segment.max()) + 1
    return Graph(
        node=torch.from_numpy(np.concatenate([skeleton.kind, velocity, skeleton.place, displacement], axis=1)),
        mesh_edge=torch.from_numpy(np.concatenate([skeleton.rest_edge, change], axis=1)),
        mesh_pair=torch.from_numpy(skeleton.pair),
        contact_edge=torch.from_numpy(_with_norm(positions[contact[0]] - positions[contact[1]])),
        contact_pair=torch.from_numpy(contact),
        segment=torch.from_numpy(skeleton.segment),
        graph_of_segment=torch.zeros(segments, dtype=torch.int64),
        **{name: None if (array := getattr(skeleton, name)) is None else torch.from_numpy(array)
           for name in ("shared", "node_code", "segment_code")})


def contact_edges(positions: NDArray[np.float64], obstacle: NDArray[np.bool_], radius: float) -> NDArray[np.int64]:
    """(2, W) senders and receivers: every pair of an obstacle node and a body node within a radius, in both directions."""
    rigid = np.flatnonzero(obstacle)
    if not len(rigid):
        return np.empty((2, 0), np.int64)
    low, high = positions[rigid].min(axis=0) - radius, positions[rigid].max(axis=0) + radius
    near = np.flatnonzero(~obstacle & ((positions >= low) & (positions <= high)).all(axis=1))
    found = cKDTree(positions[rigid]).sparse_distance_matrix(cKDTree(positions[near]), radius, output_type="ndarray")
    i, j = rigid[found["i"]], near[found["j"]]  # (W/2,) each
    pair = np.stack([np.concatenate([i, j]), np.concatenate([j, i])])  # (2, W)
    return pair[:, np.lexsort(pair)]


def join(graphs: Sequence[Graph]) -> Graph:
    """Several graphs as one disjoint union: nodes and segments are counted on from graph to graph."""
    if len(graphs) == 1:
        return graphs[0]
    nodes = np.cumsum([0] + [len(graph.node) for graph in graphs]).tolist()
    segments = np.cumsum([0] + [len(graph.graph_of_segment) for graph in graphs]).tolist()
    count = np.cumsum([0] + [int(graph.graph_of_segment[-1]) + 1 for graph in graphs]).tolist()
    return Graph(
        node=torch.cat([graph.node for graph in graphs]),
        mesh_edge=torch.cat([graph.mesh_edge for graph in graphs]),
        mesh_pair=torch.cat([graph.mesh_pair + first for graph, first in zip(graphs, nodes, strict=False)], dim=1),
        contact_edge=torch.cat([graph.contact_edge for graph in graphs]),
        contact_pair=torch.cat([graph.contact_pair + first for graph, first in zip(graphs, nodes, strict=False)], dim=1),
        segment=torch.cat([graph.segment + first for graph, first in zip(graphs, segments, strict=False)]),
        graph_of_segment=torch.cat([graph.graph_of_segment + first for graph, first in zip(graphs, count, strict=False)]),
        shared=_joined([None if graph.shared is None else graph.shared + torch.tensor([[node], [segment]])
                        for graph, node, segment in zip(graphs, nodes, segments, strict=False)], dim=1),
        node_code=_joined([graph.node_code for graph in graphs]), segment_code=_joined([graph.segment_code for graph in graphs]))


def _joined(parts: list[torch.Tensor | None], dim: int = 0) -> torch.Tensor | None:
    """Parts end to end; None where all of them lack it."""
    there = [part for part in parts if part is not None]
    return torch.cat(there, dim=dim) if there else None


def _with_norm(vector: NDArray[np.floating]) -> NDArray[np.float32]:
    """(M, 3) vectors followed by their norms: (M, 4) float32."""
    return np.concatenate([vector, np.linalg.norm(vector, axis=1, keepdims=True)], axis=1).astype(np.float32)
