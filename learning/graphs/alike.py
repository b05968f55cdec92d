"""Graphs of few sizes: one more graph, that nothing is asked of, fills a batch up, so that most batches are as large as one before.

A GPU that has recorded a training step for a batch can then replay it for all of the same sizes (learning/devices.py).

    nodes n      to the next of 8 sizes an octave
    edges        to as many for each node as there are now, contact edges at least to a quarter of the nodes: so nodes tell their number too

The nodes of the filling stand at one place in a ring of edges, its segments have a node each at least, and no number in it is other than
finite. No edge, segment or attention leads from it to the others.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from learning.graphs.graph import Graph, join

SIZES = 8  # an octave


def alike(batch: Graph) -> Graph:
    """A batch without levels, and one more graph at its end that fills it up; `most` says how many segments a graph can have."""
    assert not batch.levels
    segments, nodes, where = len(batch.graph_of_segment), len(batch.node), batch.node.device
    more = _size(segments + 1) - segments
    full = _size(nodes + more)
    e, w = (_size(max(pair.shape[1], least)) - pair.shape[1] for pair, least in
            ((batch.mesh_pair, -(-batch.mesh_pair.shape[1] // nodes) * full), (batch.contact_pair, full // 4)))
    n, shared = full - nodes, None
    if batch.shared is not None:
        pairs = torch.arange(_size(max(batch.shared.shape[1], full)) - batch.shared.shape[1], device=where)
        shared = torch.stack([pairs % n, pairs % more])
    filling = Graph(
        node=batch.node.new_zeros(n, batch.node.shape[1]), place=batch.place.new_zeros(n, batch.place.shape[1]),
        mesh_edge=batch.mesh_edge.new_zeros(e, batch.mesh_edge.shape[1]), mesh_pair=_ring(e, n, where),
        contact_edge=batch.contact_edge.new_zeros(w, batch.contact_edge.shape[1]), contact_pair=_ring(w, n, where),
        rank=torch.arange(n, device=where), segment=torch.arange(n, device=where) % more,
        graph_of_segment=batch.graph_of_segment.new_zeros(more), shared=shared,
        node_code=None if batch.node_code is None else batch.node_code.new_zeros(n, batch.node_code.shape[1]),
        segment_code=None if batch.segment_code is None else batch.segment_code.new_zeros(more, batch.segment_code.shape[1]))
    whole = join([batch, filling])
    return replace(whole, most=_size(int(torch.bincount(whole.graph_of_segment).max())))


def _size(count: int) -> int:
    """The next of the sizes, 8 an octave."""
    step = 2 ** max(0, count.bit_length() - SIZES.bit_length())
    return -(-count // step) * step


def _ring(edges: int, nodes: int, where: torch.device) -> torch.Tensor:
    """(2, E) edges each from a node to the next, round and round."""
    sender = torch.arange(edges, device=where) % nodes
    return torch.stack([sender, (sender + 1) % nodes])
