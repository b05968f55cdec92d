"""Which network a config asks for: every kind by its name.

A network is a torch module that makes normalised velocities of a graph scaled by a normaliser (blocks.Network). Its config is a
frozen dataclass whose `kind` names it and whose `wants` says what it needs of the graph. A new one is a file in rivals/ and an entry
in each table below.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from learning.graphs.graph import SOLID
from learning.graphs.wants import Widths
from learning.networks.blocks import Network
from learning.networks.m4gn import M4GN, M4GNConfig
from learning.networks.rivals.bsms import BSMS, BSMSConfig
from learning.networks.rivals.eagle import Eagle, EagleConfig
from learning.networks.rivals.g_u_net import GUNet, GUNetConfig
from learning.networks.rivals.gcn import GCN, GCNConfig
from learning.networks.rivals.mgn import MGN, MGNConfig
from learning.networks.rivals.transolver import Transolver, TransolverConfig

NetworkConfig = M4GNConfig | MGNConfig | GCNConfig | GUNetConfig | BSMSConfig | EagleConfig | TransolverConfig
CONFIGS: dict[str, type[Any]] = {"m4gn": M4GNConfig, "mgn": MGNConfig, "gcn": GCNConfig, "g-u-net": GUNetConfig, "bsms": BSMSConfig,
                                 "eagle": EagleConfig, "transolver": TransolverConfig}
NETWORKS: dict[str, Callable[[Any, Widths], Network]] = {"m4gn": M4GN, "mgn": MGN, "gcn": GCN, "g-u-net": GUNet, "bsms": BSMS,
                                                         "eagle": Eagle, "transolver": Transolver}


def build(config: NetworkConfig, widths: Widths = SOLID) -> Network:
    """The network of a config, its weights as torch's dice fall. Raises `InputError` for sizes that do not go together."""
    return NETWORKS[config.kind](config, widths)
