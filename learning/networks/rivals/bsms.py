"""BSMS-GNN: message passing on the mesh, on coarser and coarser graphs above it, and back.

    encode      h_i = f_n(x_i)
    block       h_i += f_h([h_i, sum_j f_e([r_ij, h_j, h_i]), sum_j f_w([c_ij, h_j, h_i])])
    down        on level 0 .. L - 1:  a block;  s = h;  h = T h,  positions = T positions
    bottom      on level L:           a block
    up          on level L - 1 .. 0:  h = T^t h;  a block;  h += s
    decode      v_i = f_d(h_i)

r_ij are the features of a mesh edge and c_ij those of a contact edge, at every level from the positions there; no edge carries anything
from one block to the next. Levels, their edges and T are made once for a mesh, contact edges of all levels for each frame, and nothing
of it is learned: graphs/levels.py. Each level has blocks of its own for the way down and the way up; those of the mesh and of the
bottom run twice, as in the authors' code for solids. All f are MLPs of three linear layers with ReLU between them, and LayerNorm
without scale or shift at the end, except in f_d.

Choices: the obstacle keeps its edges and is pooled like any part (the authors' code deletes edges between prescribed nodes, whose
features its pooling then makes zero); kept are the smaller of the even and the odd nodes, without the code's first version's filling up
to a half; the output is scaled, as in the paper of M4GN; nodes see what they see in all networks here, and edges X and x - X (X and x).

Legend: N nodes, E edges, H hidden size, L levels above the mesh.
Source: Cao et al. 2023 (arXiv:2210.02573), section 3 and appendix; https://github.com/Eydcao/BSMS-GNN; Lei et al., M4GN,
appendix "Baselines".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from learning.graphs.graph import SOLID, Coarser, Graph
from learning.graphs.wants import Wants, Widths
from learning.networks.blocks import MLP, PRECISIONS, Network, sum_at
from learning.networks.rivals.geometry import contact_features, mesh_features, scale_of
from physics.schema import quantity

RUNS = 2  # of the blocks of the mesh and of the bottom


@dataclass(frozen=True, kw_only=True)
class BSMSConfig:
    """BSMS-GNN: message passing on coarser and coarser graphs, by bi-stride pooling. Sizes are the paper's by default.

    kind: of the network
    hidden: width of every layer
    levels: of coarser graphs above the mesh
    precision: of matrix products
    """

    kind: str = quantity("bsms", choice=("bsms",))
    hidden: int = quantity(128, at_least=1, at_most=4096)
    levels: int = quantity(4, at_least=1, at_most=20)
    precision: str = quantity("float32", choice=PRECISIONS)

    @property
    def wants(self) -> Wants:
        """What it asks of a graph."""
        return Wants(levels=self.levels)


class BSMS(Network):
    """The network of the module's equations."""

    title = "BSMS-GNN"

    def __init__(self, config: BSMSConfig, widths: Widths = SOLID) -> None:
        super().__init__(config)
        hidden, levels = config.hidden, range(config.levels)
        self.encode = MLP(widths.node, hidden, hidden, affine=False)
        self.down = nn.ModuleList([MessageBlock(hidden, widths) for _ in levels])
        self.bottom = MessageBlock(hidden, widths)
        self.up = nn.ModuleList([MessageBlock(hidden, widths) for _ in levels])
        self.decode = MLP(hidden, hidden, widths.outputs, norm=False)

    def velocity(self, graph: Graph) -> Tensor:
        h, place, scale = self.encode(graph.node), graph.place, scale_of(graph.scale)
        mesh = Edges(graph.mesh_pair, graph.contact_pair, graph.mesh_edge, graph.contact_edge)
        levels = [mesh, *(Edges.of(level, place, scale) for level, place in zip(graph.levels, pooled(place, graph.levels), strict=True))]
        skips = []
        for number, (block, level) in enumerate(zip(self.down, graph.levels, strict=True)):
            h = repeated(block, h, levels[number], RUNS if number == 0 else 1)
            skips.append(h)
            h = pool(h, level)
        h = repeated(self.bottom, h, levels[-1], RUNS)
        for number, block in reversed(list(enumerate(self.up))):
            h = unpool(h, graph.levels[number], len(skips[number]))
            h = repeated(block, h, levels[number], RUNS if number == 0 else 1) + skips[number]
        return self.decode(h)  # (N, D + F)

    @property
    def last(self) -> nn.Linear:
        return self.decode.third


@dataclass(frozen=True)
class Edges:
    """Mesh and contact edges of one level: pairs (2, E) and (2, W), features (E, 2 D + 2) and (W, D + 1)."""

    pair: Tensor
    contact_pair: Tensor
    mesh: Tensor
    contact: Tensor

    @classmethod
    def of(cls, level: Coarser, place: Tensor, scale: tuple[Tensor, Tensor]) -> Edges:
        """Those of a coarser level, whose nodes are at these places."""
        mesh, contact = mesh_features(place, level.pair, scale), contact_features(place, level.contact_pair, scale)
        return cls(level.pair, level.contact_pair, mesh, contact)


class MessageBlock(nn.Module):
    """One message over mesh edges and contact edges."""

    def __init__(self, hidden: int, widths: Widths) -> None:
        super().__init__()
        self.mesh = MLP(widths.mesh_edge + 2 * hidden, hidden, hidden, affine=False)
        self.contact = MLP(widths.contact_edge + 2 * hidden, hidden, hidden, affine=False)
        self.node = MLP(3 * hidden, hidden, hidden, affine=False)

    def forward(self, h: Tensor, edges: Edges) -> Tensor:
        """(N, H) from (N, H)."""
        sent = self.mesh.on_edges(edges.mesh, h, edges.pair)
        felt = self.contact.on_edges(edges.contact, h, edges.contact_pair)
        sums = [sum_at(pair[1], message, len(h)) for pair, message in ((edges.pair, sent), (edges.contact_pair, felt))]
        return h + self.node(torch.cat([h, *sums], dim=1))


def repeated(block: nn.Module, h: Tensor, edges: Edges, runs: int) -> Tensor:
    for _ in range(runs):
        h = block(h, edges)
    return h


def pooled(place: Tensor, levels: Sequence[Coarser]) -> list[Tensor]:
    """Places of the nodes of each level."""
    found = []
    for level in levels:
        place = pool(place, level)
        found.append(place)
    return found


def pool(x: Tensor, level: Coarser) -> Tensor:
    """T x: (n, H) from (N, H)."""
    return sum_at(level.give[1], level.weight * x.index_select(0, level.give[0]), level.nodes)


def unpool(x: Tensor, level: Coarser, nodes: int) -> Tensor:
    """T^t x: (N, H) from (n, H)."""
    return sum_at(level.give[0], level.weight * x.index_select(0, level.give[1]), nodes)
