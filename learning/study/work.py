"""One training of a study, and what is measured of it. Everything found is in its folder, each file whole or not there:

    ROW/SEED/run            the training (prediction/checkpoint.py), from whose last checkpoint it goes on
    ROW/SEED/trained.json   what it took
    ROW/SEED/on-TEST.json   figures of its rollouts over a test set (physics/fidelity/figures.py): of bodies those that need no equations

The memory of a training step is what it has to hold: weights, their gradients, Adam's two moments, and what is kept of one batch for
the backward pass. Times of training are processor seconds, so that what else a machine does makes no difference; on a GPU by the clock.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from datagen.family.family import merged
from datagen.files.trajectory import read_sound, read_trajectory
from datagen.sets.dataset import files
from learning.config import TrainConfig
from learning.flows.compare import learned as learned_flow
from learning.flows.compare import scores_of
from learning.flows.rivals import IDLE
from learning.flows.rivals import trivial as trivial_flows
from learning.graphs.graph import join
from learning.networks.blocks import products
from learning.prediction.checkpoint import Model, load_model
from learning.prediction.predictor import Case, Predictor
from learning.prediction.rivals import STILL, trivial
from learning.prediction.surrogates import learned
from learning.report.measure import measure
from learning.samples.samples import all_frames, load_examples, sample
from learning.study.plan import Trial, slug
from learning.training.curve import read_curve
from learning.training.train import train
from physics.schema import finite, read_table, to_table
from physics.whole import write_whole

SHAPES = 50  # frames of a trajectory at which the deformed mesh is looked at


@dataclass(frozen=True)
class Training:
    """One training: its folder, its config, the folder of the data, and tests with the folders of theirs."""

    folder: Path
    config: TrainConfig
    data: Path
    tests: tuple[tuple[Trial, Path], ...]
    device: str = "cpu"

    @property
    def done(self) -> bool:
        """Whether all is found."""
        return all(path.exists() for path in (self.folder / "trained.json", *(self.found(test) for test, _ in self.tests)))

    def curve(self) -> list[dict[str, Any]]:
        """The lines of its training's curve, with what was spent until then."""
        return [spent(line) for line in read_curve(self.folder / "run")]

    def found(self, test: Trial) -> Path:
        """Where the figures of a test are, or will be."""
        return self.folder / f"on-{slug(test.name)}.json"


def carried_out(job: Training) -> None:
    """Train, or go on with it, and measure what has not been measured."""
    valid = files(job.data, "valid") if (job.data / "valid").is_dir() else []
    if not (job.folder / "trained.json").exists():
        found = train(job.config, files(job.data, "train"), valid, job.folder / "run", resume=True, device=job.device)
        found = {key: value for key, value in spent(found).items() if key != "run"}
        found |= {"memory": step_memory(job), "step_ms": step_ms(job.curve(), found)}
        write_json(job.folder / "trained.json", found)
    for test, folder in job.tests:
        if not job.found(test).exists():
            write_json(job.found(test), tested(load_model(job.folder / "run", job.device), test, files(folder, "test")))


def tested(model: Any, test: Trial, paths: Sequence[Path]) -> dict[str, Any]:
    """Figures of a network's rollouts and single steps, means over trajectories; empty when one of them blows up."""
    assert isinstance(model, Model)
    config = read_table(TrainConfig, merged(to_table(model.config), test.change))
    changed = Model(config, model.network, model.normaliser, model.name)
    if model.normaliser.layout.flow:
        return scores_of(learned_flow(changed, model.title), paths)
    return figures(learned(changed, model.title), paths)


def figures(predictor: Predictor, paths: Sequence[Path]) -> dict[str, Any]:
    """Figures of a predictor over test trajectories; empty when it leaves one of them out."""
    cases = [Case(path.stem, trajectory := read_sound(path), None, trajectory.mesh, path) for path in paths]
    found = measure([predictor], cases, sample=SHAPES)
    return found.rows[0].scores if found.rows else {}


def still(paths: Sequence[Path]) -> dict[str, Any]:
    """The same of a body that never moves, or of a flow that does not change."""
    if read_trajectory(paths[0]).flows:
        return scores_of(next(each for each in trivial_flows() if each.name == IDLE), paths)
    return figures(next(each for each in trivial() if each.name == STILL), paths)


def step_memory(job: Training) -> int:
    """Bytes that a training step of a trained run has to hold."""
    model, examples = load_model(job.folder / "run", job.device), load_examples(files(job.data, "train")[:1], job.config)
    assert isinstance(model, Model)
    numbers, dice, kept = all_frames(examples), torch.Generator().manual_seed(0), {}
    drawn = [sample(examples[which], frame, job.config, dice)[0] for which, frame in
             (numbers[i % len(numbers)].tolist() for i in range(job.config.batch_size))]

    def keep(tensor: torch.Tensor) -> torch.Tensor:
        storage = tensor.untyped_storage()
        kept[storage.data_ptr()] = storage.nbytes()
        return tensor

    batch = model.normaliser.graph(join(drawn).to(model.normaliser.velocity.device))
    with products(job.config.network), torch.autograd.graph.saved_tensors_hooks(keep, lambda tensor: tensor):
        said = model.network(batch)
    weights = {weight.untyped_storage().data_ptr(): weight.untyped_storage().nbytes() for weight in model.network.parameters()}
    assert said.requires_grad
    return 4 * sum(weights.values()) + sum(size for at, size in kept.items() if at not in weights)


def spent(line: dict[str, Any]) -> dict[str, Any]:
    """What a training says of itself, "seconds" being those of the processor where it ran on one."""
    seconds, processor = line["seconds"], line.get("processor")
    return {key: value for key, value in line.items() if key != "processor"} | {"seconds": seconds if processor is None else processor}


def step_ms(curve: list[dict[str, Any]], found: dict[str, Any]) -> float:
    """Milliseconds of a training step: the median between reports without a validation between them, else of the whole training."""
    spans, last = [], None
    for line in curve:
        if "loss" in line and last is not None and line["step"] > last["step"]:
            spans.append((line["seconds"] - last["seconds"]) / (line["step"] - last["step"]))
        last = line if "loss" in line else None
    return 1e3 * (statistics.median(spans) if spans else found["seconds"] / max(found["steps"], 1))


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Leave what was found, whole."""
    write_whole(path, (json.dumps(finite(content), indent=1) + "\n").encode())
