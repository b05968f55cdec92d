"""The network of learning/m4gn.py as its equations read, with its weights: the inputs of each edge side by side, in float32."""

from __future__ import annotations

import torch
from torch import Tensor

from learning.graph import Graph
from learning.m4gn import M4GN


def forward(network: M4GN, graph: Graph) -> Tensor:
    """(N, 3) normalised velocity of the nodes of one graph, or of several of one size joined."""
    h, e, w = network.encode_node(graph.node), network.encode_mesh(graph.mesh_edge), network.encode_contact(graph.contact_edge)
    for step in network.process:
        (s, r), (a, b) = graph.mesh_pair, graph.contact_pair
        e = e + step.mesh(torch.cat([e, h[s], h[r]], dim=1))
        w = w + step.contact(torch.cat([w, h[a], h[b]], dim=1))
        sums = [torch.zeros_like(h).index_add(0, to, latent) for to, latent in ((r, e), (b, w))]
        h = h + step.node(torch.cat([h, *sums], dim=1))
    segments = len(graph.graph_of_segment)
    nodes = torch.zeros(segments, dtype=h.dtype).index_add(0, graph.segment, torch.ones(len(h)))
    means = torch.zeros(segments, h.shape[1]).index_add(0, graph.segment, h) / nodes[:, None]
    s = network.encode_segment(means).view(int(graph.graph_of_segment[-1]) + 1, -1, h.shape[1])  # (B, S, H)
    for block in network.transform:
        parts = block.query_key_value(block.norm_attention(s)).chunk(3, dim=-1)
        q, k, v = (part.view(*part.shape[:2], block.heads, -1).transpose(1, 2) for part in parts)  # (B, A, S, H/A)
        weight = torch.softmax(q @ k.transpose(-1, -2) / q.shape[-1] ** 0.5, dim=-1)
        s = s + block.out((weight @ v).transpose(1, 2).reshape(s.shape))
        s = s + block.feed(block.norm_feed(s))
    return network.decode(torch.cat([h, s.flatten(0, 1)[graph.segment]], dim=1))
