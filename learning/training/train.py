"""Train a network on trajectory files: one straight loop that can be stopped at any moment and resumed to the same weights.

    loss = mean over free nodes and components of (network(graph) - v / scale)^2, over further fields where they are asked for

with Adam. Each step draws batch_size frames, with replacement, from all training frames, some more often where estimates are
corrected (samples.chances); noise is drawn afresh (samples/samples.py).
Both fall as the seed and the number of the step tell (samples/batches.py). The learning rate is kept for the first half
of the training and then falls exponentially, where "half" is told by steps / config.steps or by seconds / budget_seconds,
whichever is further on. A resumed training equals an uninterrupted one to the last bit, unless a time budget gives the
clock a say.

Source: Lei et al., M4GN, appendix "Training Details"; Pfaff et al. 2021, appendix A.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import torch
from torch import Tensor, nn
from tqdm import tqdm

from learning.config import TrainConfig
from learning.devices import Replays, device_of
from learning.networks.blocks import products, told_by_sizes
from learning.prediction.memory import keep_freed_memory
from learning.prediction.rollout import rollout_error
from learning.processes import Processes, processes
from learning.samples.batches import Batch, Batches, ahead
from learning.samples.samples import Example, all_frames, load_examples
from learning.samples.scales import Normaliser
from learning.samples.seen import seen, write_seen
from learning.training.curve import Curve
from learning.training.run import Clock, Run, set_up
from physics.schema import InputError
from physics.whole import write_whole

REPORT_EVERY = 50  # steps
BAR = "{desc} {percentage:3.0f}%|{bar}| {elapsed} {postfix}"


def train(config: TrainConfig, files_train: Sequence[str | Path], files_valid: Sequence[str | Path], out: str | Path, *,
          steps: int | None = None, resume: bool = False, device: str = "cpu") -> dict[str, Any]:
    """Train a network and leave it in a run folder.

    Args:
        config: see TrainConfig
        files_train: trajectory files to learn from; the normaliser is fitted on these alone
        files_valid: trajectory files whose rollouts choose the best network; with none, the last network is the best
        out: run folder (layout in checkpoint.py)
        steps: stop after this step, before config.steps; the schedule of the learning rate stays that of config.steps
        resume: go on from RUN/last.safetensors, or begin where there is none
        device: where the network runs (devices.py)

    Returns:
        {"run", "steps", "seconds", "processor" (seconds of it, None on a GPU), "ms_per_step", "loss", "best_error", "best_step",
        "last_error", "parameters", "samples"}; errors in metres (rollout_error, averaged over validation trajectories), None where there is
        none

    Raises:
        InputError: bad files, a run of other data or config, a damaged checkpoint, a folder that holds a run already, a device that
            is not there, a batch that its memory does not hold
        FloatingPointError: a loss that is not finite; the run folder keeps the last checkpoint
    """
    out = Path(out)
    keep_freed_memory()
    where = device_of(device)
    with processes(config, where) as group:
        begun = (out / "last.safetensors").exists()
        if begun and not resume:
            raise InputError(f"{out} holds a training already: resume it, or choose another folder")
        examples = load_examples(files_train, config)
        examples_valid = load_examples(files_valid, config, walk=True, layout=examples[0].layout) if files_valid else []
        run = set_up(config, examples, out, resume=begun, device=where)
        if group.first:
            write_whole(out / "config.toml", tomli_w.dumps(run.about.config).encode())
            write_seen(out, seen(example.trajectory for example in examples))
        about, before = run.about, replace(run.about)
        _loop(run, examples, examples_valid, config.steps if steps is None else min(steps, config.steps), group)
    return {"run": str(out), "steps": about.step, "seconds": about.seconds, "processor": about.processor,
            "ms_per_step": 1e3 * (about.seconds - before.seconds) / max(about.step - before.step, 1),
            "loss": about.loss, "best_error": about.best_error, "best_step": about.best_step, "last_error": about.last_error,
            "parameters": sum(p.numel() for p in run.model.network.parameters()), "samples": len(all_frames(examples))}


def _loop(run: Run, examples: Sequence[Example], examples_valid: Sequence[Example], last: int, group: Processes) -> None:
    """Steps until the last one or the end of the budget, and what is said and kept on the way."""
    config, about, model = run.model.config, run.about, run.model
    device, replayed = model.device, model.device.type == "cuda" and group.count == 1 and told_by_sizes(model.network)
    batches = Batches(examples, config, run.walks, group, fill=replayed)
    curve, learner = Curve(run.out if group.first else None, about.step), group.learner(model.network)
    replays = Replays(partial(descend, learner, run.optimizer, model.normaliser, config), device) if replayed else None
    losses = about.losses
    clock = Clock(about, group, device)
    ended = about.step >= last or progress(config, about.step, about.seconds) >= 1
    drawn = iter(()) if ended else ahead(batches, about.step + 1, device)
    with curve, tqdm(total=100, desc="train", disable=None if group.first else True, bar_format=BAR) as bar, products(config.network):
        while not ended:
            clock.read()
            rate = learning_rate(config, progress(config, about.step, about.seconds))
            run.set_rate(rate)
            batch, loss = next(drawn), None
            try:
                loss = take_step(learner, run.optimizer, model.normaliser, config, batch, group, replays)
            except torch.OutOfMemoryError:
                pass  # the error holds all that the step made, and is let go before less is tried
            if loss is None:  # by this process alone, the others may be elsewhere
                raise InputError(_too_large(model.network, run.optimizer, model.normaliser, config, batches))
            losses.append(loss)
            about.step += 1
            clock.read()
            if not math.isfinite(losses[-1]):
                raise FloatingPointError(f"the loss is {losses[-1]} at step {about.step}, learning rate {rate:.2g}: "
                                         f"choose a lower one; {run.out} keeps the state of the last checkpoint")
            done = progress(config, about.step, about.seconds)
            ended = about.step == last or done >= 1
            if about.step % REPORT_EVERY == 0 or ended:
                about.loss = float(np.mean(losses))
                if about.step % REPORT_EVERY == 0:
                    losses.clear()
                curve.add(about.step, seconds=about.seconds, processor=about.processor, loss=about.loss, learning_rate=rate)
                error = "" if about.last_error is None else f" error {about.last_error:.2e} m"
                bar.set_postfix_str(f"step {about.step} loss {about.loss:.3g}{error}", refresh=False)
                bar.update(100 * min(done, 1.0) - bar.n)
            if about.step % config.validate_every == 0 or ended:
                if group.first:
                    _validate(run, examples_valid, curve)
                clock.read()
                if group.first:
                    run.keep("last", whole=True)


def learning_rate(config: TrainConfig, done: float) -> float:
    """The learning rate at a fraction of the training: constant in the first half, exponential decay in the second."""
    decay = min(1.0, max(0.0, 2 * done - 1))
    return config.learning_rate * (config.final_learning_rate / config.learning_rate) ** decay


def progress(config: TrainConfig, step: int, seconds: float) -> float:
    """How far the training is: 0 at its start, 1 or more at its end."""
    return max(step / config.steps, seconds / config.budget_seconds if config.budget_seconds else 0.0)


def take_step(learner: nn.Module, optimizer: torch.optim.Optimizer, normaliser: Normaliser, config: TrainConfig, batch: Batch,
              group: Processes, replays: Replays | None = None) -> float:
    """One step of Adam on one batch; returns its loss. replays: of `descend`, where a GPU does it."""
    if replays:
        return group.total(replays(batch).item())
    here = batch.to(normaliser.velocity.device)
    return group.total(descend(learner, optimizer, normaliser, config, here, group.count).item())


def descend(learner: nn.Module, optimizer: torch.optim.Optimizer, normaliser: Normaliser, config: TrainConfig, batch: Batch,
            processes: int = 1) -> Tensor:
    """The same, without waiting for the device; () the loss of this process's part of the batch."""
    said = learner(normaliser.graph(batch.graph))
    errors = torch.where(batch.asked, said - normaliser.target(batch.target), 0.0)
    loss = errors.square().sum() / batch.numbers
    optimizer.zero_grad()
    (processes * loss).backward()  # of which the processes' mean is taken
    torch.nn.utils.clip_grad_norm_(learner.parameters(), config.clip_norm)
    optimizer.step()
    return loss.detach()


def _too_large(network: nn.Module, optimizer: torch.optim.Optimizer, normaliser: Normaliser, config: TrainConfig, batches: Batches) -> str:
    """What to say when the device's memory does not hold a batch: how many samples it does hold, as found by halving."""
    size, said = config.batch_size // 2, f"batch_size = {config.batch_size}: the memory of {normaliser.velocity.device} does not hold"
    while size:
        optimizer.zero_grad(set_to_none=True)
        if torch.cuda.is_available():
            torch.cuda.empty_cache()
        try:
            take_step(network, optimizer, normaliser, config, batches.made(0, size), Processes())
        except torch.OutOfMemoryError:
            size //= 2
        else:
            return f"{said} it; {size} fits"
    return f"{said} a single sample"


def _validate(run: Run, examples: Sequence[Example], curve: Curve) -> None:
    """Roll the validation trajectories out, write the error down, and keep the network when it is the best so far."""
    about, error = run.about, None
    if examples:
        try:
            error = float(np.mean([rollout_error(run.model, example) for example in examples]))
        except FloatingPointError:  # an early network may blow up: no error figure then, and training goes on
            pass
        curve.add(about.step, seconds=about.seconds, processor=about.processor, error=error)
    about.last_error = error
    if not examples or (error is not None and error < (about.best_error or math.inf)) or about.best_step is None:
        about.best_error, about.best_step = error, about.step
        run.keep("model")
