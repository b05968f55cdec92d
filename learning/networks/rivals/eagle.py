"""EAGLE's GraphViT: message passing, then attention among clusters of nodes, each of them read by a recurrent net.

    place code  P_i = [F(x_i), F(x_i - c_k)],    F(x) = [cos, sin](2^k pi x),  k = -3 .. 4,    c_k the mean of cluster k of node i
    encode      h_i = g_n(features),  e_ij = g_M(features of mesh edge),  w_ij = g_W(features of contact edge)
    L times     e_ij' = f_e([e_ij, h_i, P_i, h_j, P_j]),  w_ij' = f_w([w_ij, h_i, P_i, h_j, P_j]),
                h_i += f_h([h_i, P_i, sum_j e_ij', sum_j w_ij']);  e_ij += e_ij',  w_ij += w_ij'
    pool        s_k = g_s(last state of GRU([h_i, P_i]) over the nodes i of cluster k)
    L_S times   y = [LN s, F(c)];  s += O attention(y, y, y);  s += g_f(LN s)          among the clusters of one graph only
    dispatch    z_i = [h_i, LN(s_k), P_i];  one more step on z, e and w, without residuals;  v_i = g_d of its nodes

f are MLPs of three linear layers with ReLU between them, and LayerNorm at the end but for those of the last step; g have two layers and
no LayerNorm, g_d three with tanh between them. The state of the GRU and s are wider than h.

A GRU reads the nodes of a cluster in some order, and the result depends on it: here along x, y, z at rest, so that the numbering of
nodes has no say (the authors read them as they are stored). The unit of x is 16 cells, the mean length of a mesh edge: the code's finest
waves are then two cells long, and its coarsest 256.

Clusters: cluster_size nodes of the mesh at rest that are near each other, body and obstacle apart, cut once (segments/clusters.py; the
authors cut anew in each frame, as meshes change in theirs); or, clusters = "segments", those that M4GN would be given.
contact = true adds the terms of w, which the original does not have and the paper of M4GN adds to it.

Legend: N nodes, E mesh edges, W contact edges, K clusters, B graphs, S most clusters of a graph, D space dimensions, H hidden
size, V width of s.
Source: Janny et al. 2023 (arXiv:2302.10803), section 4; https://github.com/eagle-dataset/EagleMeshTransformer; Lei et al., M4GN,
appendix "Baselines".
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from learning.graphs.graph import SOLID, Graph
from learning.graphs.wants import Wants, Widths
from learning.networks.blocks import MLP, PRECISIONS, Network, Padding, sum_at
from learning.networks.m4gn import mean_of_segments
from learning.networks.rivals.geometry import scale_of
from physics.schema import InputError, quantity

FIRST, OCTAVES = -3, 8
UNIT = 16.0  # cells


@dataclass(frozen=True, kw_only=True)
class EagleConfig:
    """EAGLE: message passing, then attention among clusters that a recurrent net has read. Sizes are the paper's by default.

    kind: of the network
    hidden: width of nodes and edges
    width: of clusters; width + 16 D, which a place code makes it, must be a multiple of heads, with D = 3 space dimensions
    message_steps: how often neighbours talk, before clusters do
    transformer_layers: in which clusters talk
    heads: of each of these
    clusters: same-size: of cluster_size nodes; segments: as M4GN would be given them
    cluster_size: nodes in a cluster, at most
    contact: whether contact edges are seen
    precision: of matrix products
    """

    kind: str = quantity("eagle", choice=("eagle",))
    hidden: int = quantity(128, at_least=1, at_most=4096)
    width: int = quantity(512, at_least=1, at_most=4096)
    message_steps: int = quantity(4, at_least=1, at_most=100)
    transformer_layers: int = quantity(4, at_least=0, at_most=100)
    heads: int = quantity(4, at_least=1, at_most=256)
    clusters: str = quantity("same-size", choice=("same-size", "segments"))
    cluster_size: int = quantity(20, at_least=1, at_most=100_000)
    contact: bool = True
    precision: str = quantity("float32", choice=PRECISIONS)

    @property
    def wants(self) -> Wants:
        """What it asks of a graph."""
        return Wants(segments=True) if self.clusters == "segments" else Wants(cluster=self.cluster_size)


class Eagle(Network):
    """The network of the module's equations."""

    title = "EAGLE"

    def __init__(self, config: EagleConfig, widths: Widths = SOLID) -> None:
        code = 2 * OCTAVES * widths.space  # numbers in F
        if (config.width + code) % config.heads:
            raise InputError(f"network.width = {config.width}: with {code} it must be a multiple of network.heads = {config.heads}")
        super().__init__(config)
        hidden, width, contact = config.hidden, config.width, config.contact
        node = hidden + 2 * code
        self.encode_node = two_layers(widths.node, hidden, hidden)
        self.encode_mesh = two_layers(widths.mesh_edge, hidden, hidden)
        self.encode_contact = two_layers(widths.contact_edge, hidden, hidden) if contact else None
        self.process = nn.ModuleList([Step(node, hidden, contact=contact) for _ in range(config.message_steps)])
        self.read = nn.GRU(node, width, batch_first=True)
        self.encode_cluster = two_layers(width, hidden, width)
        self.attend = nn.ModuleList([Attention(width, code, config.heads) for _ in range(config.transformer_layers)])
        self.norm = nn.LayerNorm(width)
        self.dispatch = Step(node + width, hidden, contact=contact, norm=False)
        self.decode = nn.Sequential(nn.Linear(hidden, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh(),
                                    nn.Linear(hidden, widths.outputs))

    def velocity(self, graph: Graph) -> Tensor:
        clusters = len(graph.graph_of_segment)
        x = sum(graph.place.chunk(2, dim=1)) / (UNIT * scale_of(graph.scale)[0][0, graph.place.shape[1] // 2])  # (N, D)
        centre = mean_of_segments(x, graph.segment, clusters)  # (K, D)
        code = torch.cat([waves(x), waves(x - centre[graph.segment])], dim=1)  # (N, P)
        h, e = self.encode_node(graph.node), self.encode_mesh(graph.mesh_edge)
        w = None if self.encode_contact is None else self.encode_contact(graph.contact_edge)
        for step in self.process:
            more, sent, felt = step(torch.cat([h, code], dim=1), e, graph.mesh_pair, w, graph.contact_pair)
            h, e, w = h + more, e + sent, None if w is None else w + felt

        order = graph.rank.argsort()
        members = Padding(graph.segment[order], clusters)  # the nodes of each cluster
        states, _ = self.read(members.padded(torch.cat([h, code], dim=1)[order]))  # (K, nodes, V)
        s = self.encode_cluster(states[torch.arange(clusters, device=h.device), members.count - 1])  # (K, V)
        rows = Padding(graph.graph_of_segment, graph.count)
        s, places = rows.padded(s), rows.padded(waves(centre))  # (B, S, V), (B, S, P / 2)
        for block in self.attend:
            s = block(s, places, rows.present)
        s = rows.listed(self.norm(s))
        z = torch.cat([h, s[graph.segment], code], dim=1)
        return self.decode(self.dispatch(z, e, graph.mesh_pair, w, graph.contact_pair)[0])  # (N, D + F)

    @property
    def last(self) -> nn.Linear:
        last = self.decode[-1]
        assert isinstance(last, nn.Linear)
        return last


class Step(nn.Module):
    """Messages over mesh edges, and contact edges where they are seen: what nodes and edges get, without a residual."""

    def __init__(self, node: int, hidden: int, *, contact: bool, norm: bool = True) -> None:
        super().__init__()
        self.mesh = MLP(hidden + 2 * node, hidden, hidden, norm=norm)
        self.contact = MLP(hidden + 2 * node, hidden, hidden, norm=norm) if contact else None
        self.node = MLP(node + (2 if contact else 1) * hidden, hidden, hidden, norm=norm)

    def forward(self, z: Tensor, e: Tensor, mesh_pair: Tensor, w: Tensor | None,
                contact_pair: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
        """(N, H), (E, H), (W, H) from nodes (N, ·) and edges (E, H), (W, H)."""
        sent, felt = self.mesh.on_edges(e, z, mesh_pair), None
        sums = [sum_at(mesh_pair[1], sent, len(z))]
        if self.contact is not None and w is not None:
            felt = self.contact.on_edges(w, z, contact_pair)
            sums.append(sum_at(contact_pair[1], felt, len(z)))
        return self.node(torch.cat([z, *sums], dim=1)), sent, felt


class Attention(nn.Module):
    """Pre-LN attention among clusters, their places beside what they hold, and a net of two layers; padding is seen by nobody."""

    def __init__(self, width: int, code: int, heads: int) -> None:
        super().__init__()
        self.norm_attention = nn.LayerNorm(width)
        self.attention = nn.MultiheadAttention(width + code, heads, batch_first=True)
        self.out = nn.Linear(width + code, width)
        self.norm_feed = nn.LayerNorm(width)
        self.feed = two_layers(width, width, width)

    def forward(self, s: Tensor, places: Tensor, present: Tensor) -> Tensor:
        """(B, S, V) from (B, S, V); present: (B, S) False on padding."""
        y = torch.cat([self.norm_attention(s), places], dim=2)
        s = s + self.out(self.attention(y, y, y, key_padding_mask=~present, need_weights=False)[0])
        return s + self.feed(self.norm_feed(s))


def two_layers(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, outputs))


def waves(x: Tensor) -> Tensor:
    """F: (M, 16 D) cosines, then sines, of each component in turn, from (M, D)."""
    angle = x[:, :, None] * (torch.pi * 2.0 ** torch.arange(FIRST, FIRST + OCTAVES, device=x.device))  # (M, D, 8)
    return torch.cat([angle.cos(), angle.sin()], dim=2).flatten(1)
