"""From a trajectory to graphs: what the network sees of one frame.

Nodes are those of the trajectory file, body first, obstacle last. Two kinds of directed edges, each in both directions:

    mesh edges      the edges of the body's cells and of the obstacle's surface; they never change
    contact edges   between an obstacle node and a body node with |x_i - x_j| <= r_W; found anew in every frame (contact.py)

Features, with X rest positions, x current positions, v = x(t+1) - x(t) [m]; every one is free of the origin:

    node            one-hot of its kind (free, obstacle, held); the v of a node whose motion is prescribed (obstacle, or
                    held), on free nodes what the scheme knows of theirs, or zero (samples/samples.py); X_i - O, x_i - X_i, with O the
                    mean rest position of the held nodes (of the body, where none is held); the material, where it is told (material.py)
    mesh edge       X = X_s - X_r, |X|, x - X, |x| - |X|    [m], x = x_s - x_r, s sender, r receiver
    contact edge    x, |x|                                 [m]

A body in a plane has D = 2 coordinates, every other D = 3. Lengths may be counted in cells or body sizes instead of metres
(layout.py). Where nodes stay and a fluid flows: flow.py.

The paper gives a node x_i and a mesh edge X and x. Here the changes x - X stand beside X: the same knowledge, but a strain of
1 % is lost in the spread of x over a mesh and stands out in that of x - X. The origin O makes x_i free of where the scene is.

Edges are sorted by receiver. A frame without any contact has empty arrays of contact edges and nothing else differs. Coarser
graphs (levels.py), segments and encodings are there for networks that ask for them.

Legend: N nodes, E mesh edges, W contact edges, K segments, B graphs in a batch, k kinds of nodes.
Source: Pfaff et al. 2021 (arXiv:2010.03409), appendix A.1; Lei et al., M4GN, section "Micro-level module".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from datagen.files.trajectory import HANDLE, Trajectory
from learning.graphs.contact import contact_edges, with_norm, world_edges
from learning.graphs.encoding import mesh_graph, random_walk, segment_graph
from learning.graphs.layout import SOLID_BODY, Layout
from learning.graphs.levels import Level, hierarchy, lifted
from learning.segments.clusters import ranks
from learning.segments.edges import mesh_edges

SOLID = SOLID_BODY.widths
TABLES = ("node", "mesh_edge", "contact_edge", "place", "rank")  # of a graph, with a row each


@dataclass(frozen=True)
class Skeleton:
    """What stays the same over all frames of a trajectory.

    kind: (N, k) float32 one-hot
    free: (N,) True on the nodes that are predicted
    obstacle: (N,) True on those of the obstacle
    rest: (N, D) float64 rest positions [m]
    place: (N, D) float32 rest positions from O [m]
    pair: (2, E) senders and receivers of the mesh edges
    rest_edge: (E, D + 1) float32 rest vector and its norm [m]
    segment: (N,) segment of each node, 0 .. K-1 without gaps
    rank: (N,) place of each node in an order along x, y, z, whatever its number
    shared: (2, M) nodes and the further segments they belong to; None without overlap
    node_code: (N, w), segment_code: (K, w) random-walk encodings; None without
    material: (m,) what every node is told of the material; None without
    levels: coarser graphs above the mesh
    """

    kind: NDArray[np.float32]
    free: NDArray[np.bool_]
    obstacle: NDArray[np.bool_]
    rest: NDArray[np.float64]
    place: NDArray[np.float32]
    pair: NDArray[np.int64]
    rest_edge: NDArray[np.float32]
    segment: NDArray[np.int64]
    rank: NDArray[np.int64]
    shared: NDArray[np.int64] | None = None
    node_code: NDArray[np.float32] | None = None
    segment_code: NDArray[np.float32] | None = None
    levels: tuple[Level, ...] = ()
    material: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class Coarser:
    """One of a graph's levels, counted through the batch.

    nodes: n of all graphs
    pair: (2, E) its mesh edges, contact_pair: (2, W) its contact edges
    give: (2, M) nodes of the finer level and of this one; weight: (M, 1) of each pair in the pooling
    """

    nodes: int
    pair: torch.Tensor
    contact_pair: torch.Tensor
    give: torch.Tensor
    weight: torch.Tensor


@dataclass(frozen=True)
class Graph:
    """One frame, or several as a disjoint union.

    node: (N, (b + 2) D + 3), 7 more where the material is told, mesh_edge: (E, 2 D + 2), contact_edge: (W, D + 1) features;
        of a flow (N, k + D), (E, D + 1) and none
    mesh_pair: (2, E), contact_pair: (2, W) senders and receivers
    place: (N, 2 D) rest positions from O and displacements [m], as they stand in `node` before it is scaled
    rank: (N,) see Skeleton
    segment: (N,) segment of each node, counted through the batch; without segments a graph is one
    graph_of_segment: (K,) the graph of each segment, ascending from 0
    count: B
    most: segments that a graph has at most; 0 where they are to be counted
    scale: (2, 2 D + 2) and (2, D + 1) means and deviations by which the features of edges were scaled; None before
    shared, node_code, segment_code: as in Skeleton, counted through the batch
    """

    node: torch.Tensor
    mesh_edge: torch.Tensor
    mesh_pair: torch.Tensor
    contact_edge: torch.Tensor
    contact_pair: torch.Tensor
    place: torch.Tensor
    rank: torch.Tensor
    segment: torch.Tensor
    graph_of_segment: torch.Tensor
    count: int = 1
    most: int = 0
    scale: tuple[torch.Tensor, torch.Tensor] | None = None
    levels: tuple[Coarser, ...] = ()
    shared: torch.Tensor | None = None
    node_code: torch.Tensor | None = None
    segment_code: torch.Tensor | None = None

    def to(self, device: torch.device) -> Graph:
        """The same on another device, itself where it is there already."""
        if self.node.device == device:
            return self
        return mapped(self, lambda tensor: tensor.to(device, non_blocking=True))

    @property
    def owner(self) -> torch.Tensor:
        """(N,) the graph of each node."""
        return self.graph_of_segment[self.segment]


def mapped(value: Any, change: Callable[[torch.Tensor], torch.Tensor]) -> Any:
    """What consists of tensors, with each of them changed."""
    if isinstance(value, torch.Tensor):
        return change(value)
    if isinstance(value, tuple):
        return tuple(mapped(part, change) for part in value)
    if is_dataclass(value):
        return replace(value, **{each.name: mapped(getattr(value, each.name), change) for each in fields(value)})  # type: ignore[type-var]
    return value


def build_skeleton(trajectory: Trajectory, segment: NDArray[np.integer], *, overlap: int = 0, walk: int = 0,
                   levels: int = 0, layout: Layout = SOLID_BODY) -> Skeleton:
    """The constant part of a trajectory's graphs; reads nothing of its displacement.

    Args:
        trajectory: its points, cells and node kinds are used
        segment: (N,) segment of each node, as `learning.segments.cut.segment` gives it
        overlap: 1 to let nodes also belong to the segments of their neighbours
        walk: w, steps of the longest walk of the encodings; 0 for none
        levels: how many coarser graphs
        layout: what of it is seen; that of a solid body by default
    """
    edges = mesh_edges(trajectory)
    senders, receivers = np.concatenate([edges, edges[:, ::-1]]).T  # (2E,) each
    order = np.lexsort((senders, receivers))
    pair = np.stack([senders[order], receivers[order]])  # (2, E)
    rest = np.ascontiguousarray(trajectory.points[:, :layout.space]) / layout.unit(trajectory)
    vector = rest[pair[0]] - rest[pair[1]]
    kind = (trajectory.node_kind[:, None] == np.array(layout.kinds)).astype(np.float32)  # (N, k)
    held = trajectory.node_kind == HANDLE
    place = (rest - rest[held if held.any() else trajectory.body].mean(axis=0)).astype(np.float32)  # (N, D)
    label = segment.astype(np.int64)
    shared = neighbours(label, pair) if overlap else None
    node_code = segment_code = None
    if walk:
        graph = mesh_graph(pair, len(rest))
        node_code, segment_code = random_walk(graph, walk), random_walk(segment_graph(graph, label, shared), walk)
    rank = ranks(trajectory.points)
    return Skeleton(kind, layout.free(trajectory), ~trajectory.body, rest, place, pair, with_norm(vector), label, rank, shared, node_code,
                    segment_code, hierarchy(pair, rest, rank, levels), layout.told(trajectory))


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
                known: NDArray[np.floating] | float = 0.0, *, world: bool = False) -> Graph:
    """The graph of one frame.

    Args:
        positions: (N, D) current positions [m]
        velocity: (N, b D) displacements to the next frames [m]; read on prescribed nodes only
        radius: r_W, the largest distance of a contact edge [m]
        known: (N, D) what stands in its place on free nodes
        world: contact edges join any two nodes within the radius that no mesh edge joins
    """
    velocity = np.where(skeleton.free[:, None], known, velocity).astype(np.float32)  # (N, b D)
    displacement = (positions - skeleton.rest).astype(np.float32)
    senders, receivers = skeleton.pair
    change = with_norm(positions[senders] - positions[receivers]) - skeleton.rest_edge  # (E, D + 1)
    contact = (world_edges(positions, skeleton.pair, radius) if world else
               contact_edges(positions, skeleton.obstacle, radius))
    told = [] if skeleton.material is None else [np.tile(skeleton.material, (len(positions), 1))]
    node = np.concatenate([skeleton.kind, velocity, skeleton.place, displacement, *told], axis=1)
    return assembled(skeleton, node, np.concatenate([skeleton.rest_edge, change], axis=1), positions, displacement, contact)


def assembled(skeleton: Skeleton, node: NDArray[np.float32], mesh_edge: NDArray[np.float32], positions: NDArray[np.float64],
           displacement: NDArray[np.float32], contact: NDArray[np.int64]) -> Graph:
    """A graph with these features and contact edges (2, W)."""
    above = zip(skeleton.levels, lifted(contact, len(positions), skeleton.levels), strict=True)
    segments = int(skeleton.segment.max()) + 1
    return Graph(
        node=torch.from_numpy(node),
        mesh_edge=torch.from_numpy(mesh_edge),
        mesh_pair=torch.from_numpy(skeleton.pair),
        contact_edge=torch.from_numpy(with_norm(positions[contact[0]] - positions[contact[1]])),
        contact_pair=torch.from_numpy(contact),
        place=torch.from_numpy(np.concatenate([skeleton.place, displacement], axis=1)),
        rank=torch.from_numpy(skeleton.rank),
        segment=torch.from_numpy(skeleton.segment),
        graph_of_segment=torch.zeros(segments, dtype=torch.int64),
        levels=tuple(Coarser(len(level.kept), torch.from_numpy(level.pair), torch.from_numpy(touching), torch.from_numpy(level.give),
                             torch.from_numpy(level.weight)[:, None]) for level, touching in above),
        shared=_tensor(skeleton.shared), node_code=_tensor(skeleton.node_code), segment_code=_tensor(skeleton.segment_code))


def _tensor(array: NDArray[Any] | None) -> torch.Tensor | None:
    return None if array is None else torch.from_numpy(array)


def join(graphs: Sequence[Graph]) -> Graph:
    """Several graphs as one disjoint union: nodes, segments and the nodes of each level are counted on from graph to graph."""
    if len(graphs) == 1:
        return graphs[0]
    nodes = _starts([len(graph.node) for graph in graphs])
    segments = _starts([len(graph.graph_of_segment) for graph in graphs])
    return Graph(
        mesh_pair=_counted([graph.mesh_pair for graph in graphs], nodes),
        contact_pair=_counted([graph.contact_pair for graph in graphs], nodes),
        segment=_counted([graph.segment for graph in graphs], segments),
        graph_of_segment=_counted([graph.graph_of_segment for graph in graphs], _starts([graph.count for graph in graphs])),
        count=sum(graph.count for graph in graphs), scale=graphs[0].scale, levels=_levels(graphs, nodes),
        shared=_joined([None if graph.shared is None else graph.shared + torch.tensor([[node], [segment]])
                        for graph, node, segment in zip(graphs, nodes, segments, strict=True)], dim=1),
        node_code=_joined([graph.node_code for graph in graphs]), segment_code=_joined([graph.segment_code for graph in graphs]),
        **{name: torch.cat([getattr(graph, name) for graph in graphs]) for name in TABLES})  # type: ignore[arg-type]


def _levels(graphs: Sequence[Graph], finer: list[int]) -> tuple[Coarser, ...]:
    """The levels of several graphs; finer: the numbers at which the graphs' nodes start."""
    found = []
    for each in zip(*(graph.levels for graph in graphs), strict=True):
        own = _starts([level.nodes for level in each])
        pair, contact = (_counted([getattr(level, name) for level in each], own) for name in ("pair", "contact_pair"))
        give = torch.stack([_counted([level.give[row] for level in each], starts) for row, starts in enumerate((finer, own))])
        found.append(Coarser(sum(level.nodes for level in each), pair, contact, give, torch.cat([level.weight for level in each])))
        finer = own
    return tuple(found)


def _starts(counts: list[int]) -> list[int]:
    """The sums of the numbers before each."""
    return [0, *np.cumsum(counts[:-1]).tolist()]


def _counted(parts: list[torch.Tensor], starts: list[int]) -> torch.Tensor:
    """Numbers (M,), or pairs of them (2, M), end to end, each part counted on from its start."""
    return torch.cat([part + start for part, start in zip(parts, starts, strict=True)], dim=-1)


def _joined(parts: list[torch.Tensor | None], dim: int = 0) -> torch.Tensor | None:
    """Parts end to end; None where all of them lack it."""
    there = [part for part in parts if part is not None]
    return torch.cat(there, dim=dim) if there else None
