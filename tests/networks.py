"""A small network of every kind, with weights that leave a trace, and graphs for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from datagen.files.trajectory import Trajectory
from learning.config import TrainConfig
from learning.graphs.graph import Graph, build_graph
from learning.networks.kinds import NetworkConfig, build
from learning.networks.m4gn import M4GNConfig
from learning.networks.rivals.bsms import BSMSConfig
from learning.networks.rivals.eagle import EagleConfig
from learning.networks.rivals.g_u_net import GUNetConfig
from learning.networks.rivals.gcn import GCNConfig
from learning.networks.rivals.mgn import MGNConfig
from learning.networks.rivals.transolver import TransolverConfig
from learning.samples.samples import Example, build_example, fit_normaliser
from tests.synthetic import bending

SMALL: dict[str, NetworkConfig] = {
    "m4gn": M4GNConfig(hidden=8, message_steps=2, transformer_layers=1, heads=2),
    "mgn": MGNConfig(hidden=8, message_steps=2, world_radius=0.006),
    "gcn": GCNConfig(hidden=8, layers=3),
    "g-u-net": GUNetConfig(hidden=8, levels=2),
    "bsms": BSMSConfig(hidden=8, levels=2),
    "eagle": EagleConfig(hidden=8, width=12, message_steps=2, transformer_layers=2, heads=3, cluster_size=10),
    "transolver": TransolverConfig(hidden=8, layers=2, heads=2, slices=5)}


def training(network: NetworkConfig, **changes: object) -> TrainConfig:
    """A config around a network, for the scenes of tests/synthetic.py."""
    return replace(TrainConfig(network=network, segments=7, contact_radius=0.006, noise=0.0), **changes)  # type: ignore[arg-type]


def made(config: NetworkConfig) -> torch.nn.Module:
    """A network whose scales and shifts are not ones and zeros, and whose slices differ."""
    torch.manual_seed(1)
    network = build(config).eval()
    for name, weight in network.named_parameters():
        if "norm" in name:
            torch.nn.init.normal_(weight, mean=0.7 if name.endswith("weight") else 0.1, std=0.3)
        elif "bias" in name:
            torch.nn.init.normal_(weight, std=0.1)
        elif config.kind == "transolver" and weight.dim() == 2:
            torch.nn.init.normal_(weight, std=weight.shape[1] ** -0.5)
    return network


def graph_of(case: Example, config: TrainConfig, step: int = 3, shift: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Graph:
    """The scaled graph of a frame, the whole scene moved by a shift [m]; the scales are those of the scene itself."""
    u, skeleton = case.trajectory.displacement.astype(np.float64), replace(case.skeleton, rest=case.skeleton.rest + shift)
    world = config.network.wants.world_radius
    plain = build_graph(skeleton, skeleton.rest + u[step], u[step + 1] - u[step], world or config.contact_radius, world=world > 0)
    return fit_normaliser([case], config).graph(plain)


def graph(network: NetworkConfig, step: int = 3, *, trajectory: Trajectory | None = None, **scene: object) -> Graph:
    """The same of a trajectory, by default a bending beam that an obstacle touches."""
    config = training(network)
    return graph_of(build_example(trajectory or bending(**scene), config), config, step)  # type: ignore[arg-type]
