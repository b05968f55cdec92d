"""M4GN: message passing along mesh edges, then a transformer over segments of the mesh.

    encode      h_i = f_n(x_i + f_np(p_i)),  e_ij = f_M(features of mesh edge),  w_ij = f_W(features of contact edge)
    L times     e_ij += f_e([e_ij, h_i, h_j]),  w_ij += f_w([w_ij, h_i, h_j]),
                h_i  += f_h([h_i, sum_j e_ij, sum_j w_ij])
    pool        s_k = f_s(mean of h_i over segment k) + f_sp(p_k)
    L_S times   s += O attention(LN s);  s += FFN(LN s)               among the segments of one graph only
    dispatch    v_i = f_d([h_i, mean of s_k over the segments k of i])

All f are MLPs of three linear layers with ReLU between them, and LayerNorm at the end except in f_d. As in MeshGraphNets,
from which the paper takes its encoder and processor, edges are updated before the nodes that sum them up (the paper's
formula has the nodes sum the edges of the step before, which would leave the last edge update without effect).

With walk = w > 0, p are the random-walk encodings of nodes and segments (encoding.py); else their terms are not there. Each node
has one segment, or, when the graph says that segments overlap, also those of its mesh neighbours; the paper leaves open which
of several a node gets back, here it is their mean.

The first layer of an edge MLP is linear in [e, h_i, h_j], so W [e, h_i, h_j] = W_e e + (W_i h)_i + (W_j h)_j: the
products with h are taken once for each node rather than once for each edge. This is exact, up to the order of the sums.

Arithmetic is float32 throughout with precision = "float32". "medium" is torch's word for products of float32 matrices that may
be rounded to bfloat16 inside: processors that multiply bfloat16 in tiles (AMX) do that, others multiply float32 by another
library, which is twice as fast on AMD's. With "bfloat16" layers take and give bfloat16 (8 bits of mantissa); weights, sums
over edges and segments, and the output are float32.

Legend: N nodes, E edges, K segments, B graphs, S most segments in a graph, H hidden size, A heads.
Source: Lei et al., M4GN (sections "Micro-level module", "Macro-level module"; appendix "M4GN Configurations"); Pfaff et al.
2021, section 3.2; Xiong et al. 2020 for the pre-LN block.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import linear, scaled_dot_product_attention

from learning.graphs.graph import CONTACT_EDGE_FEATURES, MESH_EDGE_FEATURES, NODE_FEATURES, Graph
from physics.schema import InputError, quantity

PRECISIONS = ("float32", "medium", "bfloat16")


@dataclass(frozen=True, kw_only=True)
class M4GNConfig:
    """Sizes of the network, the paper's by default, and its arithmetic.

    hidden: width of every layer
    message_steps: message-passing steps
    transformer_layers: of attention between segments
    heads: of each of these, a divisor of hidden
    walk: steps of the encodings' longest walk, 0 for none
    precision: of matrix products
    """

    hidden: int = quantity(128, at_least=1, at_most=4096)
    message_steps: int = quantity(7, at_least=1, at_most=100)
    transformer_layers: int = quantity(4, at_least=0, at_most=100)
    heads: int = quantity(8, at_least=1, at_most=256)
    walk: int = quantity(0, at_least=0, at_most=100)
    precision: str = quantity("float32", choice=PRECISIONS)


class M4GN(nn.Module):
    """Normalised velocity of every node from a normalised graph."""

    def __init__(self, config: M4GNConfig) -> None:
        super().__init__()
        if config.hidden % config.heads:
            raise InputError(f"network.hidden = {config.hidden}: must be a multiple of network.heads = {config.heads}")
        self.reduced = config.precision == "bfloat16"
        hidden = config.hidden
        self.encode_node = MLP(NODE_FEATURES, hidden, hidden)
        self.encode_mesh = MLP(MESH_EDGE_FEATURES, hidden, hidden)
        self.encode_contact = MLP(CONTACT_EDGE_FEATURES, hidden, hidden)
        self.process = nn.ModuleList([MessagePassing(hidden) for _ in range(config.message_steps)])
        self.encode_segment = MLP(hidden, hidden, hidden)
        self.transform = nn.ModuleList([TransformerBlock(hidden, config.heads) for _ in range(config.transformer_layers)])
        self.decode = MLP(2 * hidden, hidden, 3, norm=False)
        if config.walk:
            self.place_node = MLP(config.walk, hidden, NODE_FEATURES)
            self.place_segment = MLP(config.walk, hidden, hidden)

    def forward(self, graph: Graph) -> Tensor:
        """(N, 3) normalised velocity; meaningless on nodes that are not free."""
        with torch.autocast(graph.node.device.type, torch.bfloat16, enabled=self.reduced):
            return self._velocity(graph).float()

    def _velocity(self, graph: Graph) -> Tensor:
        x = graph.node if graph.node_code is None else graph.node + self.place_node(graph.node_code)
        h = self.encode_node(x)  # (N, H)
        e = self.encode_mesh(graph.mesh_edge)  # (E, H)
        w = self.encode_contact(graph.contact_edge)  # (W, H)
        for step in self.process:
            h, e, w = step(h, e, graph.mesh_pair, w, graph.contact_pair)

        s = self.encode_segment(mean_of_segments(h, graph.segment, len(graph.graph_of_segment), graph.shared))  # (K, H)
        if graph.segment_code is not None:
            s = s + self.place_segment(graph.segment_code)
        count = torch.bincount(graph.graph_of_segment)  # (B,)
        slot = torch.arange(len(s), device=s.device) - (count.cumsum(0) - count)[graph.graph_of_segment]  # (K,)
        present = torch.arange(int(count.max()), device=s.device) < count[:, None]  # (B, S)
        padded = s.new_zeros(*present.shape, s.shape[1])  # (B, S, H)
        padded[graph.graph_of_segment, slot] = s
        for block in self.transform:
            padded = block(padded, present)
        s = padded[graph.graph_of_segment, slot]  # (K, H)
        return self.decode(torch.cat([h, mean_of_own(s, graph.segment, graph.shared)], dim=1))  # (N, 3)


@contextmanager
def products(config: M4GNConfig) -> Iterator[None]:
    """Products of matrices in a network's precision for the time of the block, backward passes included."""
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("medium" if config.precision == "medium" else "highest")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


class MLP(nn.Module):
    """Three linear layers with ReLU between them, and LayerNorm at the end unless told otherwise."""

    def __init__(self, inputs: int, hidden: int, outputs: int, *, norm: bool = True) -> None:
        super().__init__()
        self.first = nn.Linear(inputs, hidden)
        self.second = nn.Linear(hidden, hidden)
        self.third = nn.Linear(hidden, outputs)
        self.norm = nn.LayerNorm(outputs) if norm else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        """(M, inputs) to (M, outputs)."""
        return self.after_first(self.first(x))

    def after_first(self, y: Tensor) -> Tensor:
        """What follows the first linear layer."""
        return self.norm(self.third(self.second(y.relu_()).relu_()))

    def on_edges(self, e: Tensor, h: Tensor, pair: Tensor) -> Tensor:
        """The same as forward([e, h_sender, h_receiver]), with the first layer factorised: (E, H)."""
        of_edge, of_sender, of_receiver = self.first.weight.chunk(3, dim=1)
        y = linear(e, of_edge, self.first.bias)
        return self.after_first(y + project(h, of_sender, pair[0]) + project(h, of_receiver, pair[1]))


def project(h: Tensor, weight: Tensor, index: Tensor) -> Tensor:
    """(W h)[index], in the cheaper order: (E, H)."""
    if len(index) > len(h):
        return linear(h, weight).index_select(0, index)
    return linear(h.index_select(0, index), weight)


class MessagePassing(nn.Module):
    """One step: edges from their ends, then nodes from the sums of their incoming edges; residual on all three."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.mesh = MLP(3 * hidden, hidden, hidden)
        self.contact = MLP(3 * hidden, hidden, hidden)
        self.node = MLP(3 * hidden, hidden, hidden)

    def forward(self, h: Tensor, e: Tensor, mesh_pair: Tensor, w: Tensor,
                contact_pair: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Latents of nodes, mesh edges and contact edges after the step."""
        e = e + self.mesh.on_edges(e, h, mesh_pair)
        w = w + self.contact.on_edges(w, h, contact_pair)
        sums = [sum_at(pair[1], latent, len(h)) for pair, latent in ((mesh_pair, e), (contact_pair, w))]
        return h + self.node(torch.cat([h, *sums], dim=1)), e, w


def sum_at(index: Tensor, values: Tensor, count: int) -> Tensor:
    """(count, H) float32 sums of the rows of values (M, H) that have the same index (M,)."""
    return torch.zeros(count, values.shape[1], device=values.device).index_add(0, index, values.float())


def mean_of_segments(h: Tensor, segment: Tensor, count: int, shared: Tensor | None = None) -> Tensor:
    """(K, H) means of the nodes of each segment; shared: (2, M) nodes and further segments of theirs."""
    sums, number = sum_at(segment, h, count), torch.bincount(segment, minlength=count)
    if shared is not None:
        sums = sums + sum_at(shared[1], h.index_select(0, shared[0]), count)
        number = number + torch.bincount(shared[1], minlength=count)
    return sums / number[:, None]


def mean_of_own(s: Tensor, segment: Tensor, shared: Tensor | None = None) -> Tensor:
    """(N, H) means over the segments of each node."""
    own = s.index_select(0, segment)
    if shared is None:
        return own
    number = 1 + torch.bincount(shared[0], minlength=len(segment))
    return (own + sum_at(shared[0], s.index_select(0, shared[1]), len(own))) / number[:, None]


class TransformerBlock(nn.Module):
    """Pre-LN self-attention and feed-forward net; a padded segment is seen by nobody."""

    def __init__(self, hidden: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm_attention = nn.LayerNorm(hidden)
        self.query_key_value = nn.Linear(hidden, 3 * hidden)
        self.out = nn.Linear(hidden, hidden)
        self.norm_feed = nn.LayerNorm(hidden)
        self.feed = nn.Sequential(nn.Linear(hidden, 4 * hidden), nn.ReLU(), nn.Linear(4 * hidden, hidden))

    def forward(self, s: Tensor, present: Tensor) -> Tensor:
        """(B, S, H) from (B, S, H); present: (B, S) False on padding."""
        graphs, segments, hidden = s.shape
        qkv = self.query_key_value(self.norm_attention(s))  # (B, S, 3H)
        q, k, v = qkv.view(graphs, segments, 3, self.heads, -1).permute(2, 0, 3, 1, 4)  # (B, A, S, H/A) each
        mixed = scaled_dot_product_attention(q, k, v, attn_mask=present[:, None, None, :])  # (B, A, S, H/A)
        s = s + self.out(mixed.transpose(1, 2).reshape(graphs, segments, hidden))
        return s + self.feed(self.norm_feed(s))
