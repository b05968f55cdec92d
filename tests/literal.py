"""Small networks' parts from their bare weights, in plain loops over nodes and edges, and a graph small enough for them."""

from __future__ import annotations

import torch
from torch import Tensor

from learning.graphs.graph import Graph
from learning.networks.kinds import NetworkConfig
from learning.samples.samples import build_example
from tests.graph_by_hand import tiny
from tests.networks import graph_of, training
from tests.plain_m4gn import affine, mlp, normed

RADIUS = 1.6  # [m] some of its pairs are nearer, some are not

__all__ = ["RADIUS", "affine", "case_of", "messages", "mlp", "normed", "plain", "two"]


def case_of(network: NetworkConfig) -> Graph:
    """Nine nodes, mesh edges in both bodies, some contact edges."""
    config = training(network, contact_radius=RADIUS, segments=2, method="metis")
    found = graph_of(build_example(tiny(), config), config, step=2)
    assert 0 < found.contact_edge.shape[0] < 40
    return found


def plain(weights: dict[str, Tensor], name: str, x: Tensor) -> Tensor:
    """An MLP whose LayerNorm has no scale and no shift."""
    x = mlp(weights, name, x, norm=False)
    return (x - x.mean(-1, keepdim=True)) / (x.var(-1, correction=0, keepdim=True) + 1e-5).sqrt()


def two(weights: dict[str, Tensor], name: str, x: Tensor) -> Tensor:
    """Linear, ReLU, linear."""
    return affine(weights, f"{name}.2", affine(weights, f"{name}.0", x).relu())


def messages(nodes: int, pair: Tensor, rows: list[Tensor], width: int) -> Tensor:
    """(N, H) sums of the rows of edges at their receivers."""
    sums = [torch.zeros(width) for _ in range(nodes)]
    for (_, receiver), row in zip(pair.T.tolist(), rows, strict=True):
        sums[receiver] = sums[receiver] + row
    return torch.stack(sums)
