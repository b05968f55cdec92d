"""A training between two of its steps: its network, Adam, and what it knows of itself; begun, or read to go on."""

from __future__ import annotations

import hashlib
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import safetensors
import scipy
import torch

from learning.config import TrainConfig
from learning.networks.kinds import build
from learning.networks.stored import put_into
from learning.prediction.checkpoint import Checkpoint, Model, read_checkpoint, write_checkpoint
from learning.processes import Processes
from learning.samples.samples import Example, fit_normaliser
from learning.training.walks import Walks
from physics.schema import InputError, read_table, to_table


@dataclass
class About:
    """What a run knows of itself, as the header of its checkpoints tells it; errors in metres.

    config: as a table; fingerprint: of the training data; versions: of the libraries
    step, seconds: trained so far, by the clock; processor: seconds of the processor, None where a GPU trains
    loss: the mean over the steps of the last report; losses: of the steps since, for the next one
    best_error, best_step: of the network that is kept; last_error: of the last validation
    """

    config: dict[str, Any]
    fingerprint: str
    versions: dict[str, str]
    data_seconds: float = 0.0
    step: int = 0
    seconds: float = 0.0
    processor: float | None = 0.0
    loss: float | None = None
    losses: list[float] = field(default_factory=list)
    best_error: float | None = None
    best_step: int | None = None
    last_error: float | None = None


class Clock:
    """What a training has taken so far, written into what it knows of itself; goes on from what stands there."""

    def __init__(self, about: About, group: Processes, device: torch.device) -> None:
        self.about, self.group, self.on_gpu = about, group, device.type != "cpu"
        self.start, self.begun = time.perf_counter() - about.seconds, time.process_time() - (about.processor or 0.0)

    def read(self) -> None:
        """Processes agree on the time of the first."""
        self.about.seconds = self.group.agreed(time.perf_counter() - self.start)
        self.about.processor = None if self.on_gpu else time.process_time() - self.begun


@dataclass
class Run:
    """What changes from step to step, and the folder in which it is kept."""

    out: Path
    about: About
    model: Model
    optimizer: torch.optim.Optimizer
    walks: Walks | None = None  # of a training from pushed frames

    def set_rate(self, rate: float) -> None:
        """Let Adam's next step have this learning rate; a GPU that replays its steps reads it where it lies."""
        options = self.optimizer.param_groups[0]
        if isinstance(options["lr"], torch.Tensor):
            options["lr"].fill_(rate)
        else:
            options["lr"] = rate

    def keep(self, name: str, *, whole: bool = False) -> None:
        """Write RUN/NAME.safetensors: what predicts; the whole: all that is needed to go on."""
        adam = self.optimizer.state_dict()["state"] if whole else {}
        walks = self.walks.tensors() if whole and self.walks else {}
        saved = Checkpoint(vars(self.about), self.model.network.state_dict(), self.model.normaliser, adam, walks)
        write_checkpoint(self.out / f"{name}.safetensors", saved)


def set_up(config: TrainConfig, examples: Sequence[Example], out: Path, *, resume: bool, device: torch.device) -> Run:
    """A run before its first step, or as its last checkpoint left it.

    Raises:
        InputError: there is no checkpoint to go on from, it is damaged, or its data or config are not these
    """
    made = sum(float(example.trajectory.extra.get("seconds", 0.0)) for example in examples)
    about = About(to_table(config), fingerprint(examples), _versions(), made)
    torch.manual_seed(config.seed)
    network = build(config.network, examples[0].layout.widths).to(device)
    gpu = device.type == "cuda"
    rate = torch.tensor(config.learning_rate, device=device) if gpu else config.learning_rate
    optimizer = torch.optim.Adam(network.parameters(), lr=rate, fused=True, capturable=gpu)
    if not resume:
        if config.estimate:  # begin with the estimate as it is
            torch.nn.init.zeros_(network.last.weight)
            torch.nn.init.zeros_(network.last.bias)
        model = Model(config, network, fit_normaliser(examples, config).to(device), str(out))
        return Run(out, about, model, optimizer, Walks(model, examples) if config.pushed else None)

    path = out / "last.safetensors"
    saved = read_checkpoint(path)
    if not saved.optimizer:
        raise InputError(f"{path} holds a network but no state of a training: it cannot be resumed")
    _check_same_run(saved.about, about, out)
    known = {known.name: saved.about[known.name] for known in fields(About) if known.name in saved.about}
    put_into(network, saved.weights, path)
    optimizer.load_state_dict({"state": saved.optimizer, "param_groups": optimizer.state_dict()["param_groups"]})
    model = Model(config, network, saved.normaliser.to(device), str(out))
    return Run(out, About(**{**known, "config": about.config, "versions": about.versions}), model, optimizer,
               Walks(model, examples, saved.walks) if config.pushed else None)


def _check_same_run(saved: dict[str, Any], asked: About, out: Path) -> None:
    """Raise `InputError` unless data and config are those of the saved run; its end (steps, budget_seconds) may be moved."""
    trained = to_table(read_table(TrainConfig, saved["config"], f"{out}: config"))  # keys of later versions at their defaults
    if saved["fingerprint"] != asked.fingerprint:
        raise InputError(f"{out} was trained on other data: it cannot be resumed with these files")
    keys = (trained.keys() | asked.config.keys()) - {"steps", "budget_seconds"}
    changed = sorted(key for key in keys if trained.get(key) != asked.config.get(key))
    if changed:
        raise InputError(f"{out} was trained with another {changed[0]} ({trained.get(changed[0])}, "
                         f"not {asked.config.get(changed[0])}): it cannot be resumed")


def _versions() -> dict[str, str]:
    modules = {module.__name__: module.__version__ for module in (torch, np, scipy, h5py, safetensors)}
    return {"python": platform.python_version(), **modules, "pymetis": version("pymetis")}


def fingerprint(examples: Sequence[Example]) -> str:
    """SHA-256 over rest positions, displacements and further fields that are learned: tells whether two trainings saw the same data."""
    digest = hashlib.sha256()
    for example in examples:
        digest.update(np.ascontiguousarray(example.trajectory.points, "<f8").tobytes())
        digest.update(np.ascontiguousarray(example.trajectory.displacement, "<f4").tobytes())
        for name in (*example.layout.fields, *(["velocity"] if example.layout.flow else [])):
            digest.update(np.ascontiguousarray(example.trajectory.fields[name], "<f4").tobytes())
    return digest.hexdigest()
