"""A network for slender bodies: what the sections of a beam do at a pose of the obstacle, each section by itself.

    g = P(pose features)                         once for each pose
    y = D(relu-like(W section features + g))     for each section of it:  the 18 numbers of slender/beam.py, in units of features.py
    s = E(g)                                     the logarithm of the root mean square error to expect, of all sections together

P and D are MLPs with SiLU. Nearly all that is hard to know depends on the pose alone, of which there are few, and the sections are
many: so P is wide and D is narrow.

Legend: P poses, S sections, A and B features of a pose and a section.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from torch import Tensor, nn

from physics.schema import quantity

OUTPUTS = 18


@dataclass(frozen=True, kw_only=True)
class SectionsConfig:
    """Sizes of the network.

    pose_hidden, pose_layers: of the net that sees a pose
    hidden, layers: of the net that sees a section and what is known of the pose
    """

    kind: str = quantity("sections", choice=("sections",))
    pose_hidden: int = quantity(256, at_least=1, at_most=4096)
    pose_layers: int = quantity(3, at_least=1, at_most=20)
    hidden: int = quantity(96, at_least=1, at_most=4096)
    layers: int = quantity(2, at_least=1, at_most=20)


class Sections(nn.Module):
    """Answers (P, S, 18) and logarithms of errors (P,) from normalised features."""

    def __init__(self, config: SectionsConfig, pose: int, section: int) -> None:
        super().__init__()
        self.pose = mlp(pose, config.pose_hidden, config.pose_layers)
        self.to_section = nn.Linear(config.pose_hidden, config.hidden)
        self.section = nn.Linear(section, config.hidden, bias=False)
        self.decode = nn.Sequential(nn.SiLU(), mlp(config.hidden, config.hidden, config.layers), nn.Linear(config.hidden, OUTPUTS))
        self.doubt = nn.Linear(config.pose_hidden, 1)

    def forward(self, pose: Tensor, section: Tensor, owner: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Answers and doubts from features (P, A) and (P, S, B); or (R, B) of sections of any poses, `owner` (R,) telling whose."""
        known = self.pose(pose)
        given = self.to_section(known)
        return self.decode(self.section(section) + (given[:, None] if owner is None else given[owner])), self.doubt(known)[:, 0]


def mlp(inputs: int, hidden: int, layers: int) -> nn.Sequential:
    sizes = [inputs] + [hidden] * layers
    return nn.Sequential(*(part for a, b in pairwise(sizes) for part in (nn.Linear(a, b), nn.SiLU())))
