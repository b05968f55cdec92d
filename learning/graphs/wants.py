"""What a network asks of a graph, and how wide that is.

Legend: D space dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wants:
    """What a network needs to see beside nodes and their edges.

    segments: the body in segments, as the training's config has them cut
    cluster: instead of these, clusters of so many nodes each (segments/clusters.py); 0 for none
    overlap: whether it can do with nodes that belong to several segments
    walk: steps of the encodings' longest walk (encoding.py); 0 for none
    levels: how many coarser graphs there are above the mesh (levels.py); 0 for none
    world_radius: [m] edges in place of contact edges between all nodes nearer than this; 0 for contact edges as they are
    """

    segments: bool = False
    cluster: int = 0
    overlap: bool = False
    walk: int = 0
    levels: int = 0
    world_radius: float = 0.0

    @property
    def cut(self) -> bool:
        """Whether the body is cut into parts for it."""
        return self.segments or self.cluster > 0


@dataclass(frozen=True)
class Widths:
    """How many features nodes, mesh edges and contact edges have, and D, the components of the state that is predicted.

    further: numbers of all fields that are predicted beside it
    frames: that are predicted at once
    """

    node: int
    mesh_edge: int
    contact_edge: int
    space: int
    further: int = 0
    frames: int = 1

    @property
    def outputs(self) -> int:
        """How many numbers are predicted at a node."""
        return self.frames * (self.space + self.further)
