"""MeshGraphNets: every node hears what lies as many edges away as there are steps.

    encode      h_i = f_n(x_i),  e_ij = f_M(features of mesh edge),  w_ij = f_W(features of world edge)
    L times     e_ij += f_e([e_ij, h_i, h_j]),  w_ij += f_w([w_ij, h_i, h_j]),
                h_i  += f_h([h_i, sum_j e_ij, sum_j w_ij])
    decode      v_i = f_d(h_i)

All f are MLPs of three linear layers with ReLU between them, and LayerNorm at the end except in f_d.

World edges join any two nodes nearer than world_radius that no mesh edge joins, of one body too. With world_radius = 0 they are the
contact edges that all other networks here see.

Choices: nodes sum the edges as they are after their step (in the authors' code before the residual is added; the equations of
their paper leave it open). The paper of M4GN says no more than 15 steps and the radius.

Legend: N nodes, E edges, W world edges, H hidden size.
Source: Pfaff et al. 2021 (arXiv:2010.03409), sections 3.1 and 3.2; Lei et al., M4GN, appendix "Baselines".
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from learning.graphs.graph import SOLID, Graph
from learning.graphs.wants import Wants, Widths
from learning.networks.blocks import MLP, PRECISIONS, MessagePassing, Network
from physics.schema import quantity


@dataclass(frozen=True, kw_only=True)
class MGNConfig:
    """MeshGraphNets: message passing alone. Sizes are the paper's by default.

    kind: of the network
    hidden: width of every layer
    message_steps: how often neighbours talk
    world_radius: any two nodes nearer than this talk, too; 0 for those within contact_radius of the obstacle alone
    precision: of matrix products
    """

    kind: str = quantity("mgn", choice=("mgn",))
    hidden: int = quantity(128, at_least=1, at_most=4096)
    message_steps: int = quantity(15, at_least=1, at_most=100)
    world_radius: float = quantity(0.003, unit="m", at_least=0)
    precision: str = quantity("float32", choice=PRECISIONS)

    @property
    def wants(self) -> Wants:
        """What it asks of a graph."""
        return Wants(world_radius=self.world_radius)


class MGN(Network):
    """The network of the module's equations."""

    title = "MGN"
    told_by_sizes = True

    def __init__(self, config: MGNConfig, widths: Widths = SOLID) -> None:
        super().__init__(config)
        hidden = config.hidden
        self.encode_node = MLP(widths.node, hidden, hidden)
        self.encode_mesh = MLP(widths.mesh_edge, hidden, hidden)
        self.encode_world = MLP(widths.contact_edge, hidden, hidden)
        self.process = nn.ModuleList([MessagePassing(hidden) for _ in range(config.message_steps)])
        self.decode = MLP(hidden, hidden, widths.outputs, norm=False)

    def velocity(self, graph: Graph) -> Tensor:
        h = self.encode_node(graph.node)  # (N, H)
        e = self.encode_mesh(graph.mesh_edge)  # (E, H)
        w = self.encode_world(graph.contact_edge)  # (W, H)
        for step in self.process:
            h, e, w = step(h, e, graph.mesh_pair, w, graph.contact_pair)
        return self.decode(h)  # (N, D + F)

    @property
    def last(self) -> nn.Linear:
        return self.decode.third
