"""The network of learning/networks/m4gn.py as its equations read, from its bare weights: an edge's inputs side by side, in float32."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import layer_norm, linear, relu

from learning.graphs.graph import Graph
from learning.networks.m4gn import M4GN

HEADS = 8  # of the benchmark's network


def forward(network: M4GN, graph: Graph, heads: int = HEADS) -> Tensor:
    """(N, 3) normalised velocity of the nodes of one graph, or of several of one size joined."""
    weights = dict(network.named_parameters())
    h, e, w = (mlp(weights, f"encode_{name}", x) for name, x in (("node", graph.node), ("mesh", graph.mesh_edge),
                                                                  ("contact", graph.contact_edge)))
    for step in numbered(weights, "process"):
        (s, r), (a, b) = graph.mesh_pair, graph.contact_pair
        e = e + mlp(weights, f"{step}.mesh", torch.cat([e, h[s], h[r]], dim=1))
        w = w + mlp(weights, f"{step}.contact", torch.cat([w, h[a], h[b]], dim=1))
        sums = [torch.zeros_like(h).index_add(0, to, latent) for to, latent in ((r, e), (b, w))]
        h = h + mlp(weights, f"{step}.node", torch.cat([h, *sums], dim=1))
    segments = len(graph.graph_of_segment)
    nodes = torch.zeros(segments, dtype=h.dtype).index_add(0, graph.segment, torch.ones(len(h)))
    means = torch.zeros(segments, h.shape[1]).index_add(0, graph.segment, h) / nodes[:, None]
    s = mlp(weights, "encode_segment", means).view(int(graph.graph_of_segment[-1]) + 1, -1, h.shape[1])  # (B, S, H)
    for block in numbered(weights, "transform"):
        s = attend(weights, block, s, heads)
    return mlp(weights, "decode", torch.cat([h, s.flatten(0, 1)[graph.segment]], dim=1), norm=False)


def mlp(weights: dict[str, Tensor], name: str, x: Tensor, *, norm: bool = True) -> Tensor:
    """Linear, ReLU, linear, ReLU, linear, and LayerNorm."""
    for layer in ("first", "second"):
        x = relu(affine(weights, f"{name}.{layer}", x))
    x = affine(weights, f"{name}.third", x)
    return normed(weights, f"{name}.norm", x) if norm else x


def attend(weights: dict[str, Tensor], name: str, s: Tensor, heads: int) -> Tensor:
    """s + O attention(LN s), then s + FFN(LN s), of segments (B, S, H) that all see each other."""
    parts = affine(weights, f"{name}.query_key_value", normed(weights, f"{name}.norm_attention", s)).chunk(3, dim=-1)
    q, k, v = (part.view(*part.shape[:2], heads, -1).transpose(1, 2) for part in parts)  # (B, A, S, H/A)
    weight = torch.softmax(q @ k.transpose(-1, -2) / q.shape[-1] ** 0.5, dim=-1)
    s = s + affine(weights, f"{name}.out", (weight @ v).transpose(1, 2).reshape(s.shape))
    fed = relu(affine(weights, f"{name}.feed.0", normed(weights, f"{name}.norm_feed", s)))
    return s + affine(weights, f"{name}.feed.2", fed)


def affine(weights: dict[str, Tensor], name: str, x: Tensor) -> Tensor:
    return linear(x, weights[f"{name}.weight"], weights[f"{name}.bias"])


def normed(weights: dict[str, Tensor], name: str, x: Tensor) -> Tensor:
    """(x - mean) / deviation, times a weight, plus a bias."""
    return layer_norm(x, x.shape[-1:], weights[f"{name}.weight"], weights[f"{name}.bias"])


def numbered(weights: dict[str, Tensor], name: str) -> list[str]:
    """The names of the parts of a list: name.0, name.1, .."""
    return [f"{name}.{i}" for i in sorted({int(key.split(".")[1]) for key in weights if key.startswith(f"{name}.")})]
