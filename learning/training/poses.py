"""Train a predictor of poses: one straight loop that can be stopped at any moment and gone on with to the same weights.

AdamW, the learning rate falling to zero by a cosine after a short rise; each step draws poses with replacement. Seconds are those of the
processor. What the poses are, what is lost on them and how far off the network is in validation is a `Learner`'s affair; the best network
in validation is kept, with the factor of its error bar (slender/calibration.py).
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import tomli_w
import torch
from torch import Tensor, nn
from tqdm import tqdm

from datagen.files.provenance import versions
from learning.config import PosesConfig
from learning.networks.stored import read_stored, under, write_stored
from learning.samples.seen import Value, ranges, write_seen
from physics.schema import InputError, to_table
from physics.whole import write_whole

DOUBT = 1e-2  # weight of the expected errors
OF_STEPS = ("steps", "way of the obstacle in one step [m]")  # of a scene, of which poses know nothing
WARM = 100  # steps in which the learning rate rises


class Learner(Protocol):
    """What is learned from, and the network that learns."""

    poses: int
    fingerprint: str
    data_seconds: float  # that the trajectories took, those of validation too

    @property
    def network(self) -> nn.Module:
        """That learns."""

    def loss(self, generator: torch.Generator, count: int) -> Tensor:
        """Of some poses, drawn."""

    def judged(self) -> tuple[float | None, float]:
        """Mean over validation trajectories of the root mean square error [m] since the touch, and the factor of the error bar; None and
        infinite without any."""

    def state(self, bar: float) -> dict[str, Tensor]:
        """All that predicts, with that factor."""


def refuse_trained(out: Path, resume: bool) -> None:
    """Raise `InputError` where a training would be overwritten."""
    if not resume and (out / "last.safetensors").exists():
        raise InputError(f"{out} holds a training already: resume it, or choose another folder")


def run(config: PosesConfig, learner: Learner, told: Sequence[dict[str, Value]], out: Path, *, steps: int | None,
        resume: bool) -> dict[str, Any]:
    """Train, and leave the run folder; arguments, result and errors as in `training.sections.train_sections`.

    told: the descriptions of the training trajectories (samples/seen.py)
    """
    going = _Run(config, learner, len(told), out)
    if resume:
        going.go_on()
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "config.toml", tomli_w.dumps(to_table(config)).encode())
    write_seen(out, ranges([{name: value for name, value in each.items() if name not in OF_STEPS} for each in told]))
    begun = going.about["step"], going.about["seconds"]
    going.loop(config.steps if steps is None else min(steps, config.steps))
    about = going.about
    return {"run": str(out), "steps": about["step"], "seconds": about["seconds"],
            "ms_per_step": 1e3 * (about["seconds"] - begun[1]) / max(about["step"] - begun[0], 1), "loss": about["loss"],
            "best_error": about["best_error"], "best_step": about["best_step"], "last_error": about["last_error"],
            "parameters": sum(p.numel() for p in learner.network.parameters()), "samples": learner.poses}


def doubted(error: Tensor, depth: Tensor, doubt: Tensor) -> Tensor:
    """What is lost on the logarithms of errors that were expected (P,), for errors (P,) [m] and depths (P,) [m]."""
    return DOUBT * (torch.log(error.detach() / depth + 1e-9) - doubt).square().mean()


class _Run:
    """A training between two of its steps."""

    def __init__(self, config: PosesConfig, learner: Learner, trajectories: int, out: Path) -> None:
        self.config, self.learner, self.out = config, learner, out
        self.optimizer = torch.optim.AdamW(learner.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
        self.generator = torch.Generator().manual_seed(config.seed)
        self.about: dict[str, Any] = {
            "config": to_table(config), "fingerprint": learner.fingerprint, "trajectories": trajectories,
            "data_seconds": learner.data_seconds,
            "versions": {"torch": torch.__version__, **versions()}, "step": 0, "seconds": 0.0, "loss": None, "best_error": None,
            "best_step": None, "last_error": None}

    def loop(self, last: int) -> None:
        """Steps until the last one or the end of the budget."""
        about, losses = self.about, []
        start = time.process_time() - about["seconds"]
        with tqdm(total=100, desc="train", disable=None, bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed} {postfix}") as bar:
            while about["step"] < last and self.done() < 1:
                losses.append(self.step())
                about["step"] += 1
                about["seconds"] = time.process_time() - start
                if not math.isfinite(losses[-1]):
                    raise FloatingPointError(f"the loss is {losses[-1]} at step {about['step']}: choose a lower learning rate; {self.out} "
                                             "keeps the state of the last checkpoint")
                if about["step"] % self.config.validate_every == 0 or about["step"] == last or self.done() >= 1:
                    about["loss"] = float(np.mean(losses))
                    losses.clear()
                    self.keep()
                    bar.set_postfix_str(f"step {about['step']} loss {about['loss']:.3g} error {about['last_error'] or math.nan:.2e} m")
                    bar.update(100 * min(self.done(), 1.0) - bar.n)
                    about["seconds"] = time.process_time() - start

    def done(self) -> float:
        """How far the training is: 0 at its start, 1 or more at its end."""
        budget = self.config.budget_seconds
        return max(self.about["step"] / self.config.steps, self.about["seconds"] / budget if budget else 0.0)

    def step(self) -> float:
        """One step of AdamW on one batch; returns its loss."""
        config = self.config
        rate = config.learning_rate * (1 + math.cos(math.pi * min(self.done(), 1.0))) / 2 * min(1.0, (self.about["step"] + 1) / WARM)
        self.optimizer.param_groups[0]["lr"] = rate
        loss = self.learner.loss(self.generator, config.batch_size)
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.learner.network.parameters(), config.clip_norm)
        self.optimizer.step()
        return float(loss.detach())

    def keep(self) -> None:
        """Validate, write the error down, keep the state, and the network where it is the best so far."""
        about = self.about
        error, bar = self.learner.judged()
        about["last_error"] = error
        with open(self.out / "curve.jsonl", "a") as file:
            file.write(json.dumps({"step": about["step"], "seconds": about["seconds"], "loss": about["loss"], "error": error}) + "\n")
        if error is None or about["best_error"] is None or error < about["best_error"]:
            about["best_error"], about["best_step"] = error, about["step"]
            write_stored(self.out / "model.safetensors", about, self.learner.state(bar))
        adam = {f"optimizer.{i}.{name}": torch.as_tensor(value) for i, entry in self.optimizer.state_dict()["state"].items()
                for name, value in entry.items()}
        write_stored(self.out / "last.safetensors", about,
                     self.learner.state(math.inf) | adam | {"generator": self.generator.get_state()})

    def go_on(self) -> None:
        """Take up the state of the last checkpoint. Raises `InputError` when it is none of this data and config."""
        path = self.out / "last.safetensors"
        about, tensors = read_stored(path)
        if about.get("fingerprint") != self.about["fingerprint"]:
            raise InputError(f"{self.out} was trained on other data: it cannot be resumed with these files")
        ends = ("steps", "budget_seconds")
        before, asked = ({k: v for k, v in each["config"].items() if k not in ends} for each in (about, self.about))
        if before != asked:
            raise InputError(f"{self.out} was trained with another config: it cannot be resumed")
        try:
            self.learner.network.load_state_dict(under("weights.", tensors))
            adam: dict[int, dict[str, Tensor]] = {}
            for name, value in under("optimizer.", tensors).items():
                number, entry = name.split(".", 1)
                adam.setdefault(int(number), {})[entry] = value
            self.optimizer.load_state_dict({"state": adam, "param_groups": self.optimizer.state_dict()["param_groups"]})
            self.generator.set_state(tensors["generator"])
        except (KeyError, ValueError, RuntimeError) as error:
            raise InputError(f"{path}: not a whole checkpoint: {str(error).splitlines()[0]}") from None
        self.about = {**about, "config": self.about["config"]}
        self.about.pop("schema")
