"""The scale of everything that a network sees and says.

Inputs get mean and standard deviation of each feature. The state has a natural zero, and gets one scale for its components, its root
mean square over free nodes, so that the loss is proportional to the squared error in metres (or units c, samples.py): with one scale
each, a sideways velocity that is nothing but rounding would weigh as much as the bending. Further fields (graphs/layout.py), which
have no natural zero, get mean and standard deviation of each number over the nodes that have one.

Legend: F features, D space dimensions, b frames told at once, O = b (D + further numbers at a node).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from learning.graphs.graph import Graph
from learning.graphs.layout import SOLID_BODY, Layout

INPUTS = ("node", "mesh_edge", "contact_edge")


@dataclass(frozen=True)
class Normaliser:
    """(2, F) mean and standard deviation of the features of nodes and edges, (1,) scale of the velocity [m], (2, O - b D) of the fields.

    layout: of what the scales are
    """

    node: Tensor
    mesh_edge: Tensor
    contact_edge: Tensor
    velocity: Tensor
    fields: Tensor = field(default_factory=lambda: torch.zeros(2, 0))
    layout: Layout = SOLID_BODY

    def graph(self, graph: Graph) -> Graph:
        """The graph with its features scaled."""
        scaled = {name: (getattr(graph, name) - getattr(self, name)[0]) / getattr(self, name)[1] for name in INPUTS}
        return replace(graph, scale=(self.mesh_edge, self.contact_edge), **scaled)

    def target(self, values: Tensor) -> Tensor:
        """(N, O) what a network should say, from values in their units."""
        state, beside = self._parts(values)
        return torch.cat([state / self.velocity, (beside - self.fields[0]) / self.fields[1]], dim=1)

    def values(self, said: Tensor) -> Tensor:
        """(N, O) the other way round."""
        state, beside = self._parts(said)
        return torch.cat([self.velocity * state, self.fields[0] + self.fields[1] * beside], dim=1)

    def _parts(self, numbers: Tensor) -> list[Tensor]:
        further = self.fields.shape[1]
        return list(numbers.split([numbers.shape[1] - further, further], dim=1))

    def to(self, device: torch.device) -> Normaliser:
        return Normaliser(**{name: value.to(device) for name, value in self.tensors().items()}, layout=self.layout)

    def tensors(self) -> dict[str, Tensor]:
        """The tables by name."""
        return {name: getattr(self, name) for name in (*INPUTS, "velocity", *(["fields"] if self.fields.shape[1] else []))}


class Moments:
    """Running count, sum and sum of squares of features, in double precision."""

    def __init__(self) -> None:
        self.count = 0
        self.sum = self.square = torch.zeros(1, dtype=torch.float64)

    def add(self, features: Tensor) -> None:
        """Take in (M, F) values, M = 0 included."""
        values = features.double()
        self.count += len(values)
        self.sum = self.sum + values.sum(dim=0)
        self.square = self.square + (values * values).sum(dim=0)

    @property
    def mean(self) -> Tensor:
        """(F,) means, zero before any value."""
        return self.sum / max(self.count, 1)

    @property
    def mean_square(self) -> Tensor:
        """(F,) means of the squares, zero before any value."""
        return self.square / max(self.count, 1)

    def table(self, floor: float | Tensor) -> Tensor:
        """(2, F) float32 mean and standard deviation; a deviation below the floor is rounding, not signal, and becomes 1."""
        deviation = (self.mean_square - self.mean**2).sqrt()  # not a number where rounding makes that negative
        return torch.stack([self.mean, torch.where(deviation > floor, deviation, 1.0)]).float()
