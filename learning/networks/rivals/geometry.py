"""Edges between any two nodes of a graph, with the features that mesh edges and contact edges have (graphs/graph.py).

Where a coarser graph joins nodes that the mesh does not, its edges are described as those of the mesh are, and scaled as they were.

Legend: N nodes, E edges, D space dimensions.
"""

from __future__ import annotations

import torch
from torch import Tensor

Scale = tuple[Tensor, Tensor]


def mesh_features(place: Tensor, pair: Tensor, scale: Scale) -> Tensor:
    """(E, 2 D + 2) scaled X, |X|, x - X, |x| - |X| of pairs (2, E), without the last two where nothing moves; place: (N, 2 D) X and x - X
    of nodes [m]."""
    rest, change = (place.index_select(0, pair[0]) - place.index_select(0, pair[1])).chunk(2, dim=1)  # (E, D) each
    length = rest.norm(dim=1, keepdim=True)
    features = torch.cat([rest, length, change, (rest + change).norm(dim=1, keepdim=True) - length], dim=1)
    return (features[:, :scale[0].shape[1]] - scale[0][0]) / scale[0][1]


def contact_features(place: Tensor, pair: Tensor, scale: Scale) -> Tensor:
    """(E, D + 1) scaled x, |x| of pairs (2, E)."""
    rest, change = (place.index_select(0, pair[0]) - place.index_select(0, pair[1])).chunk(2, dim=1)
    return (torch.cat([rest + change, (rest + change).norm(dim=1, keepdim=True)], dim=1) - scale[1][0]) / scale[1][1]


def scale_of(scale: Scale | None) -> Scale:
    """The scale of a graph. Raises ValueError for one whose edges were never scaled."""
    if scale is None:
        raise ValueError("the graph is as it was built: a normaliser has to scale it first")
    return scale
