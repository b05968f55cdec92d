"""g-U-Net: message passing on fewer and fewer nodes, which the network picks itself, and back.

    encode      h = f_n(x),  e = f_M(features of mesh edge),  w = f_W(features of contact edge)
    block       a step of MeshGraphNets on h, e and w of a level (mgn.py)
    down        on level 0:           a block
                on level 1 .. L:      y_i = tanh(h_i . p / |p|);  kept are the half of a graph's nodes, rounded up, with the largest y;
                                      h_i = y_i h_i;  e and w of the level's edges are encoded anew;  a block
    up          on level L - 1 .. 0:  h = s + (h on the kept nodes, 0 on the others), s what the level had;  a block
    decode      v_i = f_d(h_i)

With A the mesh edges of a level and C its contact edges, the next one has (A + I)^2 > 0 and (A + I) C (A + I) > 0 among kept nodes,
without the diagonal. All f are MLPs of three linear layers with ReLU between them, and LayerNorm at the end except in f_d.

The score y is the only way by which p learns. What is kept depends on the state, so that the levels of two frames differ.

Choices, where the paper says that torch_geometric's GraphUNet has "GNN layers similar to MGN" in place of its convolutions and how many
levels: edges of a level are described as those of the mesh and encoded by the same f; on the way up each level goes on with the edges
that its block has left on the way down; contact edges are lifted as in BSMS-GNN (bsms.py). No edges are left out, however many a level
has: there are at most n^2.

Legend: N nodes, E edges, W contact edges, n nodes of a level, H hidden size, L levels above the mesh.
Source: Gao and Ji 2019 (arXiv:1905.05178), section 3; torch_geometric's GraphUNet; Lei et al., M4GN, appendix "Baselines".
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from learning.graphs.graph import SOLID, Graph
from learning.graphs.wants import Wants, Widths
from learning.networks.blocks import MLP, PRECISIONS, MessagePassing, Network
from learning.networks.rivals.geometry import contact_features, mesh_features, scale_of
from physics.schema import quantity


@dataclass(frozen=True, kw_only=True)
class GUNetConfig:
    """g-U-Net: message passing on fewer and fewer nodes, which the network picks itself. Sizes are the paper's by default.

    kind: of the network
    hidden: width of every layer
    levels: each with half of the nodes of the one before
    precision: of matrix products
    """

    kind: str = quantity("g-u-net", choice=("g-u-net",))
    hidden: int = quantity(128, at_least=1, at_most=4096)
    levels: int = quantity(4, at_least=1, at_most=20)
    precision: str = quantity("float32", choice=PRECISIONS)

    wants = Wants()  # what it asks of a graph


class GUNet(Network):
    """The network of the module's equations."""

    title = "g-U-Net"

    def __init__(self, config: GUNetConfig, widths: Widths = SOLID) -> None:
        super().__init__(config)
        hidden = config.hidden
        self.encode_node = MLP(widths.node, hidden, hidden)
        self.encode_mesh = MLP(widths.mesh_edge, hidden, hidden)
        self.encode_contact = MLP(widths.contact_edge, hidden, hidden)
        self.down = nn.ModuleList([MessagePassing(hidden) for _ in range(config.levels + 1)])
        self.up = nn.ModuleList([MessagePassing(hidden) for _ in range(config.levels)])
        self.score = nn.ParameterList([nn.Parameter(torch.empty(hidden).uniform_(-1, 1) / hidden**0.5) for _ in range(config.levels)])
        self.decode = MLP(hidden, hidden, widths.outputs, norm=False)

    def velocity(self, graph: Graph) -> Tensor:
        scale, place, owner = scale_of(graph.scale), graph.place, graph.owner
        mesh, contact = graph.mesh_pair, graph.contact_pair
        h, e, w = self.encode_node(graph.node), self.encode_mesh(graph.mesh_edge), self.encode_contact(graph.contact_edge)
        h, e, w = self.down[0](h, e, mesh, w, contact)
        left: list[tuple[Tensor, ...]] = []  # what each level leaves for the way up
        for block, direction in zip(self.down[1:], self.score, strict=True):
            y = torch.tanh(h.float() @ (direction / direction.norm()))  # (n,)
            kept = best_half(y, owner, graph.count)
            left.append((h, e, mesh, w, contact, kept))
            h, place, owner = h[kept] * y[kept, None], place[kept], owner[kept]
            mesh, contact = two_hops(mesh, contact, kept, len(y))
            e = self.encode_mesh(mesh_features(place, mesh, scale))
            w = self.encode_contact(contact_features(place, contact, scale))
            h, e, w = block(h, e, mesh, w, contact)
        for block in self.up:
            skip, e, mesh, w, contact, kept = left.pop()
            h, _, _ = block(skip.index_add(0, kept, h.to(skip.dtype)), e, mesh, w, contact)
        return self.decode(h)  # (N, D + F)

    @property
    def last(self) -> nn.Linear:
        return self.decode.third


def best_half(score: Tensor, owner: Tensor, graphs: int) -> Tensor:
    """(m,) ascending numbers of the nodes with the largest scores (n,), the half of each graph's, rounded up."""
    count = torch.bincount(owner, minlength=graphs)
    order = score.argsort(descending=True, stable=True)
    order = order[owner[order].argsort(stable=True)]  # graph by graph, the largest first
    place = torch.arange(len(order), device=order.device) - (count.cumsum(0) - count)[owner[order]]
    return order[2 * place < count[owner[order]]].sort().values


def two_hops(mesh: Tensor, contact: Tensor, kept: Tensor, nodes: int) -> tuple[Tensor, Tensor]:
    """Mesh edges and contact edges (2, E) of the next level, from those of a level of so many nodes."""
    number = torch.full((nodes,), -1, device=kept.device)
    number[kept] = torch.arange(len(kept), device=kept.device)
    to_kept = mesh[:, number[mesh[1]] >= 0]
    rows = torch.cat([number[to_kept[1]], number[kept]])
    near = sparse(torch.stack([rows, torch.cat([to_kept[0], kept])]), len(kept), nodes)  # A + I, the rows of kept nodes
    touching = sparse(contact.flip(0), nodes, nodes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch calls its sparse matrices a beta once in each process
        return pairs(torch.sparse.mm(near, near.t())), pairs(torch.sparse.mm(torch.sparse.mm(near, touching), near.t()))


def sparse(entries: Tensor, rows: int, columns: int) -> Tensor:
    """A matrix with ones at entries (2, E)."""
    return torch.sparse_coo_tensor(entries, torch.ones(entries.shape[1], device=entries.device), (rows, columns), check_invariants=False)


def pairs(matrix: Tensor) -> Tensor:
    """(2, E) columns and rows of the entries beside the diagonal, sorted by row."""
    row, column = matrix.coalesce().indices()
    away = row != column
    return torch.stack([column[away], row[away]])
