"""The folder of one training run: everything needed to go on, or to predict, and nothing that runs code when it is read.

    RUN/config.toml          the resolved config, for the reader
    RUN/model.safetensors    the best network so far: weights, normaliser
    RUN/last.safetensors     the newest state: weights, normaliser, Adam's moments
    RUN/range.json           the ranges of the training scenes (seen.py)
    RUN/curve.jsonl          one JSON object a line: loss and learning rate, validation errors

Both safetensors files carry in their header, as JSON: schema, config, step, seconds trained, best validation error [m],
SHA-256 of the training data, versions of the libraries, and what of trajectories is seen and predicted (graphs/layout.py; without it a
solid body's displacement). One file holds one state, written under another name, flushed and
renamed: a training killed at any moment leaves a whole one. No pickle: safetensors holds numbers, JSON the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from learning.bodies.at_once import AtOnce, is_at_once, load_at_once
from learning.config import TrainConfig
from learning.devices import Replays, device_of
from learning.graphs.alike import alike
from learning.graphs.graph import Graph
from learning.graphs.layout import Layout
from learning.networks.blocks import products, told_by_sizes
from learning.networks.kinds import build
from learning.networks.stored import put_into, read_stored, under, write_stored
from learning.prediction.memory import keep_freed_memory
from learning.samples.scales import INPUTS, Normaliser
from physics.schema import InputError, read_table, to_table


@dataclass(frozen=True)
class Checkpoint:
    """Content of one checkpoint file.

    about: the header's JSON: config, step, seconds, best, fingerprint, versions
    weights: the network's state dictionary
    normaliser: the scales fitted on the training split
    optimizer: parameter number -> name -> tensor; empty in model.safetensors
    walks: of a training from pushed frames, where its trajectories are (training/walks.py)
    """

    about: dict[str, Any]
    weights: dict[str, Tensor]
    normaliser: Normaliser
    optimizer: dict[int, dict[str, Tensor]]
    walks: dict[str, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class Model:
    """A trained network and what it needs to be applied: its config, its scales, and where it came from.

    network: takes a scaled graph, gives (N, O) as the normaliser has it
    """

    config: TrainConfig
    network: torch.nn.Module
    normaliser: Normaliser
    name: str

    def to(self, device: torch.device) -> Model:
        """The same on another device."""
        return replace(self, network=self.network.to(device), normaliser=self.normaliser.to(device))

    def said(self, graph: Graph) -> Tensor:
        """(N, O) what the network says of a graph, in units of its values, on its device; there it is replayed where that can be
        (devices.Replays). The graph is anywhere, and may be filled up already (graphs/alike.py)."""
        with torch.inference_mode(), products(self.config.network):
            if self._replays is None:
                return self._say(graph.to(self.device))
            return self._replays(graph if graph.most else alike(graph))[:len(graph.node)]

    def _say(self, graph: Graph) -> Tensor:
        return self.normaliser.values(self.network(self.normaliser.graph(graph)))

    @cached_property
    def _replays(self) -> Replays | None:
        return Replays(self._say, self.device) if self.device.type == "cuda" and told_by_sizes(self.network) else None

    @property
    def device(self) -> torch.device:
        """Where it is."""
        return self.normaliser.velocity.device

    @property
    def title(self) -> str:
        """In reports: the kind's, or the class's name of a network of one's own."""
        return getattr(self.network, "title", type(self.network).__name__)


def write_checkpoint(path: Path, saved: Checkpoint) -> None:
    """Write a whole checkpoint, or none. Raises OSError."""
    tensors = {f"weights.{name}": value for name, value in saved.weights.items()}
    tensors |= {f"normaliser.{name}": value for name, value in saved.normaliser.tensors().items()}
    tensors |= {f"optimizer.{i}.{name}": value for i, entry in saved.optimizer.items() for name, value in entry.items()}
    tensors |= {f"walks.{name}": value for name, value in saved.walks.items()}
    write_stored(path, {**saved.about, "layout": to_table(saved.normaliser.layout)}, tensors)


def read_checkpoint(path: str | Path) -> Checkpoint:
    """Read a checkpoint. Raises `InputError` in one line when it is missing, cut short, or something else."""
    about, tensors = read_stored(path)
    try:
        optimizer: dict[int, dict[str, Tensor]] = {}
        for name, value in under("optimizer.", tensors).items():
            number, entry = name.split(".", 1)
            optimizer.setdefault(int(number), {})[entry] = value
        layout = read_table(Layout, about.pop("layout", {}), f"{path}: layout")
        scales = (*INPUTS, "velocity", *(["fields"] if layout.fields else []))
        normaliser = Normaliser(**{name: tensors[f"normaliser.{name}"] for name in scales}, layout=layout)
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: not a whole checkpoint: {str(error).splitlines()[0]}") from None
    for name in INPUTS:
        if (found := tuple(getattr(normaliser, name).shape)) != (asked := (2, getattr(layout.widths, name))):
            raise InputError(f"{path}: not a whole checkpoint: normaliser.{name} has shape {found}, not {asked}")
    return Checkpoint(about, under("weights.", tensors), normaliser, optimizer, under("walks.", tensors))


def load_model(run: str | Path, device: str = "cpu") -> Model | AtOnce:
    """The best network of a run folder, on a device (devices.py; a predictor of all frames at once stays on the processor).

    Raises `InputError` when the folder holds no whole one, or the device is not there.
    """
    where = device_of(device)
    path = Path(run) / "model.safetensors"
    about, _ = read_stored(path)
    keep_freed_memory()
    if is_at_once(about):
        return load_at_once(run, about)
    saved = read_checkpoint(path)
    config = read_table(TrainConfig, saved.about.get("config"), f"{path}: config")
    network = build(config.network, saved.normaliser.layout.widths)
    put_into(network, saved.weights, path)
    return Model(config, network.eval(), saved.normaliser, str(run)).to(where)
