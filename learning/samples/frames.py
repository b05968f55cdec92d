"""Frames of trajectories for a network of your own: a torch data set of graphs and what follows each.

    frames = Frames(files, TrainConfig(contact_radius=0.006))
    loader = DataLoader(frames, batch_size=8, shuffle=True, collate_fn=collate)
    for graph, target, asked in loader:
        loss = (network(graph) - target)[asked].square().mean()

What the graph shows and what the target is follow from the config as they do for every network here (samples.py): scheme, history,
estimate, noise; graphs are scaled by the set's own means and deviations and targets by its own scale. A network that takes such a
graph and gives numbers of the target's shape predicts whole paths as
`rollout(Model(config, network, frames.normaliser, "its name"), trajectory)`.

The noise of a step falls as torch's own dice do: `torch.manual_seed`, and in workers as `DataLoader` seeds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.utils.data import Dataset

from learning.config import TrainConfig
from learning.graphs.graph import Graph, join
from learning.samples.samples import all_frames, fit_normaliser, load_examples, sample
from learning.samples.scales import Normaliser
from physics.schema import InputError

Frame = tuple[Graph, Tensor, Tensor]


class Frames(Dataset[Frame]):
    """Every frame that a training would learn from: its graph, its target (N, O) in normalised units, which of these are asked for (N, O).

    O is 3 for a body in space, 2 for one in a plane, of which coordinates of free nodes are asked for; further fields come behind.

    normaliser: the scales of graphs and targets
    """

    def __init__(self, files: str | Path | Sequence[str | Path], config: TrainConfig | None = None,
                 normaliser: Normaliser | None = None) -> None:
        """Args:
            files: trajectory files, or one
            config: TrainConfig() by default
            normaliser: of another set, as of the training set for validation; made from these files by default

        Raises:
            InputError: no files, or one from which nothing can be learned
        """
        self.config = TrainConfig() if config is None else config
        files = [files] if isinstance(files, str | Path) else files
        self._examples = load_examples(files, self.config, layout=None if normaliser is None else normaliser.layout)
        self._numbers = all_frames(self._examples)
        self.normaliser = fit_normaliser(self._examples, self.config) if normaliser is None else normaliser

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, index: int) -> Frame:
        which, frame = self._numbers[index].tolist()
        graph, target = sample(self._examples[which], frame, self.config, torch.default_generator)
        return self.normaliser.graph(graph), self.normaliser.target(target), self._examples[which].asked


def collate(frames: Sequence[Frame]) -> Frame:
    """Several frames as one: their graphs side by side."""
    graphs, targets, asked = zip(*frames, strict=True)
    return join(graphs), torch.cat(targets), torch.cat(asked)


def to_pyg(frame: Frame) -> Any:
    """A frame as torch_geometric's Data: x, edge_index and edge_attr of the mesh, contact_edge_index and contact_edge_attr, pos (N, D)
    places [m] from the held nodes, y the target, asked; torch_geometric's own loader batches them. Raises `InputError` without it."""
    try:
        from torch_geometric.data import Data
    except ImportError:
        raise InputError("torch_geometric is not installed: .venv/bin/pip install torch_geometric") from None
    graph, target, asked = frame
    rest, moved = graph.place.chunk(2, dim=1)
    return Data(x=graph.node, edge_index=graph.mesh_pair, edge_attr=graph.mesh_edge, contact_edge_index=graph.contact_pair,
                contact_edge_attr=graph.contact_edge, pos=rest + moved, y=target, asked=asked)
