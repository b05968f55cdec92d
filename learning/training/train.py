"""Train M4GN on trajectory files: one straight loop that can be stopped at any moment and resumed to the same weights.

    loss = mean over free nodes and components of (network(graph) - v / scale)^2

with Adam. Each step draws batch_size frames, with replacement, from all training frames, some more often where estimates are
corrected (data.chances); noise is drawn afresh (data.py).
Both come from one torch generator whose state travels with the checkpoint. The learning rate is kept for the first half
of the training and then falls exponentially, where "half" is told by steps / config.steps or by seconds / budget_seconds,
whichever is further on. A resumed training equals an uninterrupted one to the last bit, unless a time budget gives the
clock a say.

Source: Lei et al., M4GN, appendix "Training Details"; Pfaff et al. 2021, appendix A.2.
"""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import safetensors
import scipy
import tomli_w
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from tqdm import tqdm

from learning.config import TrainConfig
from learning.graphs.graph import Graph, join
from learning.networks.m4gn import M4GN, products
from learning.prediction.checkpoint import Model, State, load_weights, read_state, write_state
from learning.prediction.memory import keep_freed_memory
from learning.prediction.rollout import rollout_error
from learning.samples.samples import Case, Normaliser, all_frames, chances, fingerprint, fit_normaliser, load_cases, sample
from learning.samples.seen import seen, write_seen
from learning.training.curve import Curve
from learning.training.processes import Processes, processes
from physics.schema import InputError, read_table, to_table
from physics.whole import write_whole

REPORT_EVERY = 50  # steps
BAR = "{desc} {percentage:3.0f}%|{bar}| {elapsed} {postfix}"


def train(config: TrainConfig, files_train: Sequence[str | Path], files_valid: Sequence[str | Path], out: str | Path, *,
          steps: int | None = None, resume: bool = False) -> dict[str, Any]:
    """Train a network and leave it in a run folder.

    Args:
        config: see TrainConfig
        files_train: trajectory files to learn from; the normaliser is fitted on these alone
        files_valid: trajectory files whose rollouts choose the best network; with none, the last network is the best
        out: run folder (layout in checkpoint.py)
        steps: stop after this step, before config.steps; the schedule of the learning rate stays that of config.steps
        resume: go on from RUN/last.safetensors

    Returns:
        {"run", "steps", "seconds", "ms_per_step", "loss", "best_error", "best_step", "last_error", "parameters",
        "samples"}; errors in metres (rollout_error, averaged over validation trajectories), None where there is none

    Raises:
        InputError: bad files, a run of other data or config, a damaged checkpoint, a folder that holds a run already
        FloatingPointError: a loss that is not finite; the run folder keeps the last checkpoint
    """
    keep_freed_memory()
    with processes(config) as group:
        return _train(config, files_train, files_valid, Path(out), steps, resume, group)


def _train(config: TrainConfig, files_train: Sequence[str | Path], files_valid: Sequence[str | Path], out: Path, steps: int | None,
           resume: bool, group: Processes) -> dict[str, Any]:
    if not resume and (out / "last.safetensors").exists():
        raise InputError(f"{out} holds a training already: resume it, or choose another folder")
    cases = load_cases(files_train, config)
    cases_valid = load_cases(files_valid, config, walk=True) if files_valid else []
    frames, chance = all_frames(cases), chances(cases)
    about = {"config": to_table(config), "fingerprint": fingerprint(cases), "versions": _versions(), "step": 0,
             "seconds": 0.0, "loss": None, "best_error": None, "best_step": None, "last_error": None}

    torch.manual_seed(config.seed)
    network = M4GN(config.network)
    if config.estimate:  # begin with the estimate as it is
        torch.nn.init.zeros_(network.decode.third.weight)
        torch.nn.init.zeros_(network.decode.third.bias)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate, fused=True)
    generator = torch.Generator().manual_seed(config.seed)
    if resume:
        state = read_state(out / "last.safetensors")
        if state.generator is None:
            raise InputError(f"{out / 'last.safetensors'} holds a network but no state of a training: it cannot be resumed")
        _check_same_run(state.about, about, out)
        about = {**state.about, "config": about["config"], "versions": about["versions"]}
        normaliser = state.normaliser
        load_weights(network, state, out / "last.safetensors")
        optimizer.load_state_dict({"state": state.optimizer, "param_groups": optimizer.state_dict()["param_groups"]})
        generator.set_state(state.generator)
    else:
        normaliser = fit_normaliser(cases, config)
    if group.first:
        write_whole(out / "config.toml", tomli_w.dumps(to_table(config)).encode())
        write_seen(out, seen(case.trajectory for case in cases))
    curve = Curve(out if group.first else None, about["step"])
    start = time.perf_counter() - about["seconds"]
    model, learner = Model(config, network, normaliser, str(out)), group.learner(network)
    losses: list[float] = []
    last = config.steps if steps is None else min(steps, config.steps)
    first_step, first_second = about["step"], time.perf_counter()
    ended = about["step"] >= last or progress(config, about["step"], about["seconds"]) >= 1

    with curve, tqdm(total=100, desc="train", disable=None if group.first else True, bar_format=BAR) as bar, products(config.network):
        while not ended:
            rate = learning_rate(config, progress(config, about["step"], group.agreed(time.perf_counter() - start)))
            optimizer.param_groups[0]["lr"] = rate
            batch = draw(cases, frames, chance, config, generator)
            losses.append(_step(learner, optimizer, normaliser, config, batch, group))
            about["step"] += 1
            about["seconds"] = group.agreed(time.perf_counter() - start)
            if not math.isfinite(losses[-1]):
                raise FloatingPointError(f"the loss is {losses[-1]} at step {about['step']}, learning rate {rate:.2g}: "
                                         f"choose a lower one; {out} keeps the state of the last checkpoint")
            done = progress(config, about["step"], about["seconds"])
            ended = about["step"] == last or done >= 1
            if about["step"] % REPORT_EVERY == 0 or ended:
                about["loss"] = float(np.mean(losses))
                losses.clear()
                curve.add(about["step"], seconds=about["seconds"], loss=about["loss"], learning_rate=rate)
                error = "" if about["last_error"] is None else f" error {about['last_error']:.2e} m"
                bar.set_postfix_str(f"step {about['step']} loss {about['loss']:.3g}{error}", refresh=False)
                bar.update(100 * min(done, 1.0) - bar.n)
            if about["step"] % config.validate_every == 0 or ended:
                if group.first:
                    _validate(model, cases_valid, about, curve, out)
                about["seconds"] = group.agreed(time.perf_counter() - start)
                if group.first:
                    write_state(out / "last.safetensors", _state(model, about, optimizer, generator))

    return {"run": str(out), "steps": about["step"], "seconds": about["seconds"],
            "ms_per_step": 1e3 * (time.perf_counter() - first_second) / max(about["step"] - first_step, 1),
            **{key: about[key] for key in ("loss", "best_error", "best_step", "last_error")},
            "parameters": sum(p.numel() for p in network.parameters()), "samples": len(frames)}


def learning_rate(config: TrainConfig, done: float) -> float:
    """The learning rate at a fraction of the training: constant in the first half, exponential decay in the second."""
    decay = min(1.0, max(0.0, 2 * done - 1))
    return config.learning_rate * (config.final_learning_rate / config.learning_rate) ** decay


def progress(config: TrainConfig, step: int, seconds: float) -> float:
    """How far the training is: 0 at its start, 1 or more at its end."""
    return max(step / config.steps, seconds / config.budget_seconds if config.budget_seconds else 0.0)


def draw(cases: Sequence[Case], frames: NDArray[np.int64], chance: Tensor | None, config: TrainConfig,
         generator: torch.Generator) -> list[tuple[Graph, Tensor, Tensor]]:
    """A batch: of each sample its graph, its target (N, 3) and which of its nodes are free (N,)."""
    if chance is None:
        picked = torch.randint(len(frames), (config.batch_size,), generator=generator)
    else:
        picked = torch.multinomial(chance, config.batch_size, replacement=True, generator=generator)
    drawn = frames[picked.numpy()].tolist()
    return [(*sample(cases[which], frame, config, generator), torch.from_numpy(cases[which].skeleton.free)) for which, frame in drawn]


def _step(learner: nn.Module, optimizer: torch.optim.Optimizer, normaliser: Normaliser, config: TrainConfig,
          batch: list[tuple[Graph, Tensor, Tensor]], group: Processes) -> float:
    """One step of Adam on one batch; returns its loss."""
    components = 3 * sum(int(free.sum()) for _, _, free in batch)
    graphs, targets, masks = zip(*batch[group.rank::group.count], strict=True)
    predicted = learner(normaliser.graph(join(graphs)))
    errors = (predicted - torch.cat(targets) / normaliser.velocity)[torch.cat(masks)]
    loss: Tensor = errors.square().sum() / components  # this process's part
    optimizer.zero_grad()
    (group.count * loss).backward()  # of which the processes' mean is taken
    torch.nn.utils.clip_grad_norm_(learner.parameters(), config.clip_norm)
    optimizer.step()
    return group.total(loss.item())


def _validate(model: Model, cases: Sequence[Case], about: dict[str, Any], curve: Curve, out: Path) -> None:
    """Roll the validation trajectories out, write the error down, and keep the network when it is the best so far."""
    error = None
    if cases:
        try:
            error = float(np.mean([rollout_error(model, case) for case in cases]))
        except FloatingPointError:  # an early network may blow up: no error figure then, and training goes on
            pass
        curve.add(about["step"], seconds=about["seconds"], error=error)
    about["last_error"] = error
    if not cases or (error is not None and error < (about["best_error"] or math.inf)) or about["best_step"] is None:
        about["best_error"], about["best_step"] = error, about["step"]
        write_state(out / "model.safetensors", _state(model, about))


def _state(model: Model, about: dict[str, Any], optimizer: torch.optim.Optimizer | None = None,
           generator: torch.Generator | None = None) -> State:
    return State(about, model.network.state_dict(), model.normaliser, optimizer.state_dict()["state"] if optimizer else {},
                 generator.get_state() if generator else None)


def _check_same_run(saved: dict[str, Any], asked: dict[str, Any], out: Path) -> None:
    """Raise `InputError` unless data and config are those of the saved run; its end (steps, budget_seconds) may be moved."""
    saved = {**saved, "config": to_table(read_table(TrainConfig, saved["config"]))}  # with the defaults of keys it did not know
    if saved["fingerprint"] != asked["fingerprint"]:
        raise InputError(f"{out} was trained on other data: it cannot be resumed with these files")
    trained = to_table(read_table(TrainConfig, saved["config"], f"{out}: config"))  # keys of later versions at their defaults
    keys = (trained.keys() | asked["config"].keys()) - {"steps", "budget_seconds"}
    changed = sorted(key for key in keys if trained.get(key) != asked["config"].get(key))
    if changed:
        raise InputError(f"{out} was trained with another {changed[0]} ({trained.get(changed[0])}, "
                         f"not {asked['config'].get(changed[0])}): it cannot be resumed")


def _versions() -> dict[str, str]:
    modules = {module.__name__: module.__version__ for module in (torch, np, scipy, h5py, safetensors)}
    return {"python": platform.python_version(), **modules, "pymetis": version("pymetis")}
