"""A network that sees one pose of a body under an obstacle and says how much of each of some shapes the body takes.

    known = MLP(features of the pose)           answer, expected error = W known
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from learning.networks.sections import mlp
from physics.schema import quantity


@dataclass(frozen=True, kw_only=True)
class ShapesConfig:
    """Sizes of the network.

    degree: of the polynomials that shapes are made of, along the longest side
    shapes: how many
    touched: how many more of functions about the touch
    hidden, layers: of the net
    """

    kind: str = quantity("shapes", choice=("shapes",))
    degree: int = quantity(8, at_least=1, at_most=20)
    shapes: int = quantity(24, at_least=1, at_most=200)
    touched: int = quantity(0, at_least=0, at_most=90)
    hidden: int = quantity(128, at_least=1, at_most=4096)
    layers: int = quantity(3, at_least=1, at_most=20)


class Shapes(nn.Module):
    """Answers (P, r) and logarithms of errors (P,) from normalised features (P, A)."""

    def __init__(self, config: ShapesConfig, features: int, shapes: int) -> None:
        super().__init__()
        self.pose = mlp(features, config.hidden, config.layers)
        self.amount, self.doubt = nn.Linear(config.hidden, shapes), nn.Linear(config.hidden, 1)

    def forward(self, pose: Tensor) -> tuple[Tensor, Tensor]:
        known = self.pose(pose)
        return self.amount(known), self.doubt(known)[:, 0]
