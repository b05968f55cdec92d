"""Transolver: attention among soft slices of the body, to which every node belongs by shares that are learned; no edges.

    encode      h_i = W_2 gelu(W_1 x_i) + c                                           c a learned vector
    L times     h += slice attention(LN h);  h += W_4 gelu(W_3 LN h)
    decode      v_i = W_5 LN h_i

    slice attention, in each head:
                s_im = softmax over m of (V a_i / tau)_m,    a = A y, f = B y of the nodes' y = LN h
                t_m  = sum_i s_im f_i / (sum_i s_im + 1e-5)              over the nodes of one graph only
                t'_m = sum_n softmax over n of (Q t_m . K t_n / sqrt(H / heads)) U t_n
                out_i = sum_m s_im t'_m,   heads side by side, and a linear layer

V, Q, K, U are the same for all heads, tau is one number for each. Weights begin as normal numbers of deviation 0.02 cut off at two
deviations, biases as zero, tau as 0.5.

Choices: of the published variants the one for irregular meshes, in its standard sizes, which came after the paper of M4GN and is not in
its tables; nodes see what they see in all networks here, places among it; contact is seen only through that.

Legend: N nodes, B graphs, S most nodes in a graph, H hidden size, A heads, M slices.
Source: Wu et al. 2024 (arXiv:2402.02366), section 3, and its code, https://github.com/thuml/Transolver.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import scaled_dot_product_attention

from learning.graphs.graph import SOLID, Graph
from learning.graphs.wants import Wants, Widths
from learning.networks.blocks import PRECISIONS, Network, Padding
from physics.schema import InputError, quantity


@dataclass(frozen=True, kw_only=True)
class TransolverConfig:
    """Transolver: attention among soft slices of the body, no edges. Sizes are its authors' by default.

    kind: of the network
    hidden: width of every layer
    layers: of attention
    heads: of each of these, a divisor of hidden
    slices: of each head
    precision: of matrix products
    """

    kind: str = quantity("transolver", choice=("transolver",))
    hidden: int = quantity(128, at_least=1, at_most=4096)
    layers: int = quantity(8, at_least=1, at_most=100)
    heads: int = quantity(8, at_least=1, at_most=256)
    slices: int = quantity(64, at_least=1, at_most=4096)
    precision: str = quantity("float32", choice=PRECISIONS)

    wants = Wants()  # what it asks of a graph


class Transolver(Network):
    """The network of the module's equations."""

    title = "Transolver"

    def __init__(self, config: TransolverConfig, widths: Widths = SOLID) -> None:
        if config.hidden % config.heads:
            raise InputError(f"network.hidden = {config.hidden}: must be a multiple of network.heads = {config.heads}")
        super().__init__(config)
        hidden = config.hidden
        self.encode = nn.Sequential(nn.Linear(widths.node, 2 * hidden), nn.GELU(), nn.Linear(2 * hidden, hidden))
        self.shift = nn.Parameter(torch.rand(hidden) / hidden)
        self.process = nn.ModuleList([Block(hidden, config.heads, config.slices) for _ in range(config.layers)])
        self.norm = nn.LayerNorm(hidden)
        self.decode = nn.Linear(hidden, widths.outputs)
        for part in self.modules():
            if isinstance(part, nn.Linear):
                nn.init.trunc_normal_(part.weight, std=0.02, a=-0.04, b=0.04)
                if part.bias is not None:
                    nn.init.zeros_(part.bias)

    def velocity(self, graph: Graph) -> Tensor:
        h = self.encode(graph.node) + self.shift  # (N, H)
        rows = Padding(graph.owner, graph.count)
        h = rows.padded(h)  # (B, S, H)
        for block in self.process:
            h = block(h, rows.present)
        return self.decode(self.norm(rows.listed(h)))  # (N, D + F)

    @property
    def last(self) -> nn.Linear:
        return self.decode


class Block(nn.Module):
    """Slice attention and a net of two layers, pre-LN; padded nodes belong to no slice."""

    def __init__(self, hidden: int, heads: int, slices: int) -> None:
        super().__init__()
        self.heads, size = heads, hidden // heads
        self.norm_attention = nn.LayerNorm(hidden)
        self.to_share = nn.Linear(hidden, hidden)
        self.to_token = nn.Linear(hidden, hidden)
        self.temperature = nn.Parameter(torch.full((heads, 1, 1), 0.5))
        self.share = nn.Linear(size, slices)
        self.query, self.key, self.value = (nn.Linear(size, size, bias=False) for _ in range(3))
        self.out = nn.Linear(hidden, hidden)
        self.norm_feed = nn.LayerNorm(hidden)
        self.feed = nn.Sequential(nn.Linear(hidden, hidden), nn.GELU(), nn.Linear(hidden, hidden))

    def forward(self, h: Tensor, present: Tensor) -> Tensor:
        """(B, S, H) from (B, S, H); present: (B, S) False on padding."""
        y = self.norm_attention(h)
        shared, told = (layer(y).unflatten(2, (self.heads, -1)).transpose(1, 2)  # (B, A, S, H/A) each
                        for layer in (self.to_share, self.to_token))
        share = torch.softmax(self.share(shared) / self.temperature, dim=3) * present[:, None, :, None]  # (B, A, S, M)
        token = share.transpose(2, 3) @ told / (share.sum(dim=2)[..., None] + 1e-5)  # (B, A, M, H/A)
        token = scaled_dot_product_attention(self.query(token), self.key(token), self.value(token))
        h = h + self.out((share @ token).transpose(1, 2).flatten(2))
        return h + self.feed(self.norm_feed(h))
