"""GCN: graph convolutions, which mix a node with the mean of its neighbours and see nothing of the edges between them.

    encode      h = f_n(x)
    L times     h = relu(D^-1/2 (A + I) D^-1/2 h W + b)
    decode      v = f_d(h)

A joins the ends of mesh edges and of contact edges alike, D has the row sums of A + I. W begins as Glorot's uniform numbers, b as zero.

Choices, where the paper says "15 GCN layers with a hidden dimension of 128" and no more: the encoder and the decoder that the paper's
other networks have around their 15 layers (f: three linear layers with ReLU between them, LayerNorm at the end of f_n), so that GCN is
no straw man for lack of them; ReLU after every convolution; no residual and no other normalisation, as torch_geometric has it;
contact edges among the rest, without which contact would be invisible. Positions are among the features of a node here, of all networks.

Legend: N nodes, H hidden size.
Source: Kipf and Welling 2017 (arXiv:1609.02907), equation 2; Lei et al., M4GN, appendix "Baselines".
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from learning.graphs.graph import SOLID, Graph
from learning.graphs.wants import Wants, Widths
from learning.networks.blocks import MLP, PRECISIONS, Network, number_at, sum_at
from physics.schema import quantity


@dataclass(frozen=True, kw_only=True)
class GCNConfig:
    """GCN: graph convolutions that see no edges. Sizes are the paper's by default.

    kind: of the network
    hidden: width of every layer
    layers: of convolution
    precision: of matrix products
    """

    kind: str = quantity("gcn", choice=("gcn",))
    hidden: int = quantity(128, at_least=1, at_most=4096)
    layers: int = quantity(15, at_least=1, at_most=100)
    precision: str = quantity("float32", choice=PRECISIONS)

    wants = Wants()  # what it asks of a graph


class GCN(Network):
    """The network of the module's equations."""

    title = "GCN"
    told_by_sizes = True

    def __init__(self, config: GCNConfig, widths: Widths = SOLID) -> None:
        super().__init__(config)
        hidden = config.hidden
        self.encode = MLP(widths.node, hidden, hidden)
        self.process = nn.ModuleList([Convolution(hidden) for _ in range(config.layers)])
        self.decode = MLP(hidden, hidden, widths.outputs, norm=False)

    def velocity(self, graph: Graph) -> Tensor:
        h = self.encode(graph.node)  # (N, H)
        pair = torch.cat([graph.mesh_pair, graph.contact_pair], dim=1)
        scale = (1 + number_at(pair[1], len(h))).rsqrt()[:, None]  # (N, 1)
        for convolution in self.process:
            h = convolution(h, pair, scale).relu()
        return self.decode(h)  # (N, D + F)

    @property
    def last(self) -> nn.Linear:
        return self.decode.third


class Convolution(nn.Module):
    """D^-1/2 (A + I) D^-1/2 h W + b."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.mix = nn.Linear(hidden, hidden)
        nn.init.xavier_uniform_(self.mix.weight)
        nn.init.zeros_(self.mix.bias)

    def forward(self, h: Tensor, pair: Tensor, scale: Tensor) -> Tensor:
        """(N, H) from (N, H); pair: (2, E) of A; scale: (N, 1) the diagonal of D^-1/2."""
        sent = scale * nn.functional.linear(h, self.mix.weight)
        return scale * (sent + sum_at(pair[1], sent.index_select(0, pair[0]), len(h))) + self.mix.bias
