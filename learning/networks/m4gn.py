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

Legend: N nodes, E edges, K segments, B graphs, S most segments in a graph, H hidden size, A heads.
Source: Lei et al., M4GN (sections "Micro-level module", "Macro-level module"; appendix "M4GN Configurations"); Pfaff et al.
2021, section 3.2; Xiong et al. 2020 for the pre-LN block.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import scaled_dot_product_attention

from learning.graphs.graph import SOLID, Graph
from learning.graphs.wants import Wants, Widths
from learning.networks.blocks import MLP, PRECISIONS, MessagePassing, Network, Padding, number_at, sum_at
from physics.schema import InputError, quantity


@dataclass(frozen=True, kw_only=True)
class M4GNConfig:
    """M4GN: message passing, then a transformer over segments of the mesh. Sizes are the paper's by default.

    kind: of the network; the others have keys of their own, below
    hidden: width of every layer
    message_steps: message-passing steps
    transformer_layers: of attention between segments
    heads: of each of these, a divisor of hidden
    feed: width of their feed-forward nets, in hidden sizes
    walk: steps of the encodings' longest walk, 0 for none
    precision: of matrix products
    """

    kind: str = quantity("m4gn", choice=("m4gn",))
    hidden: int = quantity(128, at_least=1, at_most=4096)
    message_steps: int = quantity(7, at_least=1, at_most=100)
    transformer_layers: int = quantity(4, at_least=0, at_most=100)
    heads: int = quantity(8, at_least=1, at_most=256)
    feed: int = quantity(4, at_least=1, at_most=16)
    walk: int = quantity(0, at_least=0, at_most=100)
    precision: str = quantity("float32", choice=PRECISIONS)

    @property
    def wants(self) -> Wants:
        """What it asks of a graph."""
        return Wants(segments=True, overlap=True, walk=self.walk)


class M4GN(Network):
    """The network of the module's equations."""

    title = "M4GN"
    told_by_sizes = True

    def __init__(self, config: M4GNConfig, widths: Widths = SOLID) -> None:
        if config.hidden % config.heads:
            raise InputError(f"network.hidden = {config.hidden}: must be a multiple of network.heads = {config.heads}")
        super().__init__(config)
        hidden = config.hidden
        self.encode_node = MLP(widths.node, hidden, hidden)
        self.encode_mesh = MLP(widths.mesh_edge, hidden, hidden)
        self.encode_contact = MLP(widths.contact_edge, hidden, hidden)
        self.process = nn.ModuleList([MessagePassing(hidden) for _ in range(config.message_steps)])
        self.encode_segment = MLP(hidden, hidden, hidden)
        self.transform = nn.ModuleList([TransformerBlock(hidden, config.heads, config.feed) for _ in range(config.transformer_layers)])
        self.decode = MLP(2 * hidden, hidden, widths.outputs, norm=False)
        if config.walk:
            self.place_node = MLP(config.walk, hidden, widths.node)
            self.place_segment = MLP(config.walk, hidden, hidden)

    def velocity(self, graph: Graph) -> Tensor:
        x = graph.node if graph.node_code is None else graph.node + self.place_node(graph.node_code)
        h = self.encode_node(x)  # (N, H)
        e = self.encode_mesh(graph.mesh_edge)  # (E, H)
        w = self.encode_contact(graph.contact_edge)  # (W, H)
        for step in self.process:
            h, e, w = step(h, e, graph.mesh_pair, w, graph.contact_pair)

        s = self.encode_segment(mean_of_segments(h, graph.segment, len(graph.graph_of_segment), graph.shared))  # (K, H)
        if graph.segment_code is not None:
            s = s + self.place_segment(graph.segment_code)
        rows = Padding(graph.graph_of_segment, graph.count, graph.most)
        padded = rows.padded(s)  # (B, S, H)
        for block in self.transform:
            padded = block(padded, rows.present)
        return self.decode(torch.cat([h, mean_of_own(rows.listed(padded), graph.segment, graph.shared)], dim=1))  # (N, D + F)

    @property
    def last(self) -> nn.Linear:
        return self.decode.third


def mean_of_segments(h: Tensor, segment: Tensor, count: int, shared: Tensor | None = None) -> Tensor:
    """(K, H) means of the nodes of each segment; shared: (2, M) nodes and further segments of theirs."""
    sums, number = sum_at(segment, h, count), number_at(segment, count)
    if shared is not None:
        sums = sums + sum_at(shared[1], h.index_select(0, shared[0]), count)
        number = number + number_at(shared[1], count)
    return sums / number[:, None]


def mean_of_own(s: Tensor, segment: Tensor, shared: Tensor | None = None) -> Tensor:
    """(N, H) means over the segments of each node."""
    own = s.index_select(0, segment)
    if shared is None:
        return own
    number = 1 + number_at(shared[0], len(segment))
    return (own + sum_at(shared[0], s.index_select(0, shared[1]), len(own))) / number[:, None]


class TransformerBlock(nn.Module):
    """Pre-LN self-attention and feed-forward net; a padded segment is seen by nobody."""

    def __init__(self, hidden: int, heads: int, feed: int = 4) -> None:
        super().__init__()
        self.heads = heads
        self.norm_attention = nn.LayerNorm(hidden)
        self.query_key_value = nn.Linear(hidden, 3 * hidden)
        self.out = nn.Linear(hidden, hidden)
        self.norm_feed = nn.LayerNorm(hidden)
        self.feed = nn.Sequential(nn.Linear(hidden, feed * hidden), nn.ReLU(), nn.Linear(feed * hidden, hidden))

    def forward(self, s: Tensor, present: Tensor) -> Tensor:
        """(B, S, H) from (B, S, H); present: (B, S) False on padding."""
        graphs, segments, hidden = s.shape
        qkv = self.query_key_value(self.norm_attention(s))  # (B, S, 3H)
        q, k, v = qkv.view(graphs, segments, 3, self.heads, -1).permute(2, 0, 3, 1, 4)  # (B, A, S, H/A) each
        mixed = scaled_dot_product_attention(q, k, v, attn_mask=present[:, None, None, :])  # (B, A, S, H/A)
        s = s + self.out(mixed.transpose(1, 2).reshape(graphs, segments, hidden))
        return s + self.feed(self.norm_feed(s))
