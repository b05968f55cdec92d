"""What a network sees of a frame of a flow, where nodes stay and the velocity w [m/s] is what changes (layout.py):

    node         one-hot of its kind (inside, outflow, inflow, wall, airfoil); w, where it is prescribed that of the next frame
    mesh edge    X = X_s - X_r, |X|    [m], X rest positions, s sender, r receiver

Nothing touches anything, so there are no contact edges. Legend: N nodes, D space dimensions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from learning.graphs.graph import Graph, Skeleton, assembled


def flow_graph(skeleton: Skeleton, velocity: NDArray[np.floating]) -> Graph:
    """The graph of one frame of a flow; velocity: (N, D) [m/s], of the next frame where it is prescribed."""
    node = np.concatenate([skeleton.kind, velocity.astype(np.float32)], axis=1)
    return assembled(skeleton, node, skeleton.rest_edge, skeleton.rest, np.zeros_like(skeleton.place), np.empty((2, 0), np.int64))
