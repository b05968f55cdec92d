"""Train a predictor of beams: one straight loop that can be stopped at any moment and gone on with to the same weights.

    loss = mean over poses of [ weight x mean over sections of |unit x scale x answer - target|^2 ] / the same of the target alone
         + (log e - s)^2 / 100,    e the error of a pose over its depth, s what the network expects, its gradient kept from the rest

with AdamW, the learning rate falling to zero by a cosine. Each step draws poses with replacement, every other one mirrored. A weight
is one over the motion of the trajectory: the mean over trajectories of root mean square errors is what counts, and such an error grows
with the motion. Seconds are those of the processor.
The best network in validation is kept, with the factor of its error bar (slender/calibration.py).
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import torch
from torch import Tensor
from tqdm import tqdm

from datagen.files.provenance import versions
from learning.config import SlenderConfig
from learning.networks.sections import Sections
from learning.networks.stored import read_stored, under, write_stored
from learning.samples.seen import ranges, write_seen
from learning.slender.calibration import stretch
from learning.slender.model import Scales, Slender, load_slender, scaled, state_of
from learning.slender.samples import Sample, Table, fingerprint, load_samples, mirror_signs, seen_of, table_of
from physics.schema import InputError, to_table
from physics.whole import write_whole

DOUBT = 1e-2  # weight of the expected errors
WARM = 100  # steps in which the learning rate rises


def train_sections(config: SlenderConfig, files_train: Sequence[str | Path], files_valid: Sequence[str | Path], out: str | Path, *,
                   steps: int | None = None, resume: bool = False) -> dict[str, Any]:
    """Train a predictor of beams and leave it in a run folder.

    Args:
        files_train: trajectory files to learn from
        files_valid: trajectory files that choose the best network and set its error bar; with none, the last network is the best and its
            bar is infinite
        out: run folder (layout in prediction/checkpoint.py)
        steps: stop after this step, before config.steps
        resume: go on from RUN/last.safetensors

    Returns:
        as `training.train.train` does; errors are root mean square distances [m] of free nodes, means over trajectories

    Raises:
        InputError: bad files, a run of other data or config, a damaged checkpoint, a folder that holds a run already
        FloatingPointError: a loss that is not finite; the run folder keeps the last checkpoint
    """
    out = Path(out)
    if not resume and (out / "last.safetensors").exists():
        raise InputError(f"{out} holds a training already: resume it, or choose another folder")
    samples = load_samples(files_train, config.frames)
    valid = load_samples(files_valid, config.frames) if files_valid else []
    run = _Run(config, samples, out)
    if resume:
        run.go_on()
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "config.toml", tomli_w.dumps(to_table(config)).encode())
    write_seen(out, ranges([sample.told for sample in samples]))
    begun = run.about["step"], run.about["seconds"]
    run.loop(valid, config.steps if steps is None else min(steps, config.steps))
    about = run.about
    return {"run": str(out), "steps": about["step"], "seconds": about["seconds"],
            "ms_per_step": 1e3 * (about["seconds"] - begun[1]) / max(about["step"] - begun[0], 1), "loss": about["loss"],
            "best_error": about["best_error"], "best_step": about["best_step"], "last_error": about["last_error"],
            "parameters": sum(p.numel() for p in run.network.parameters()), "samples": len(run.table.depth)}


def fit_scales(table: Table) -> Scales:
    """The scales of a training's table; a feature that never changes keeps its size."""
    def moments(values: Tensor) -> Tensor:
        deviation = values.std(dim=0)
        return torch.stack([values.mean(dim=0), torch.where(deviation > 1e-5, deviation, 1.0)])

    pose = table.pose.flatten(0, 1)
    answer = (table.target.square().mean(dim=0) / table.unit.square().mean()).sqrt()
    return Scales(moments(pose), moments(table.section), torch.where(answer > 1e-9, answer, 1.0), pose.amin(dim=0), pose.amax(dim=0),
                  torch.tensor([math.inf]))


class _Run:
    """A training between two of its steps."""

    def __init__(self, config: SlenderConfig, samples: Sequence[Sample], out: Path) -> None:
        self.config, self.out, self.table = config, out, table_of(samples)
        self.scales = fit_scales(self.table)
        torch.manual_seed(config.seed)
        self.network = Sections(config.network, self.table.pose.shape[2], self.table.section.shape[1])
        self.optimizer = torch.optim.AdamW(self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
        self.generator = torch.Generator().manual_seed(config.seed)
        self.signs = mirror_signs()
        share = (self.table.weight / self.table.count).repeat_interleave(self.table.count)
        self.motion = float((share * self.table.target.square().sum(dim=1)).sum() / len(self.table.depth))
        self._seen = scaled(self.table.pose, self.scales.pose), scaled(self.table.section, self.scales.section)
        self.about: dict[str, Any] = {
            "config": to_table(config), "fingerprint": fingerprint(samples), "trajectories": len(samples),
            "versions": {"torch": torch.__version__, **versions()}, "step": 0, "seconds": 0.0, "loss": None, "best_error": None,
            "best_step": None, "last_error": None}

    def loop(self, valid: Sequence[Sample], last: int) -> None:
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
                    self.keep(valid)
                    bar.set_postfix_str(f"step {about['step']} loss {about['loss']:.3g} error {about['last_error'] or math.nan:.2e} m")
                    bar.update(100 * min(self.done(), 1.0) - bar.n)
                    about["seconds"] = time.process_time() - start

    def done(self) -> float:
        """How far the training is: 0 at its start, 1 or more at its end."""
        budget = self.config.budget_seconds
        return max(self.about["step"] / self.config.steps, self.about["seconds"] / budget if budget else 0.0)

    def step(self) -> float:
        """One step of AdamW on one batch; returns its loss."""
        table, config = self.table, self.config
        rate = config.learning_rate * (1 + math.cos(math.pi * min(self.done(), 1.0))) / 2 * min(1.0, (self.about["step"] + 1) / WARM)
        self.optimizer.param_groups[0]["lr"] = rate
        poses = torch.randint(len(table.depth), (config.batch_size,), generator=self.generator)
        flip = torch.randint(2, (config.batch_size,), generator=self.generator)
        rows, owner = table.rows(poses)
        answer, doubt = self.network(self._seen[0][flip, poses], self._seen[1][rows], owner)
        target = table.target[rows] * torch.where(flip[owner, None] == 1, self.signs, 1.0)
        error = (answer * self.scales.answer * table.unit[rows, None] - target).square().sum(dim=1)  # (r,)
        square = torch.zeros(len(poses)).index_add(0, owner, error) / table.count[poses]  # (p,)
        relative = torch.log(square.detach().sqrt() / table.depth[poses] + 1e-9)
        loss = (table.weight[poses] * square).mean() / self.motion + DOUBT * (relative - doubt).square().mean()
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), config.clip_norm)
        self.optimizer.step()
        return float(loss.detach())

    def keep(self, valid: Sequence[Sample]) -> None:
        """Validate, write the error down, keep the state, and the network where it is the best so far."""
        about = self.about
        error, bar = judge(Slender(self.config, self.network, self.scales, str(self.out)), valid) if valid else (None, math.inf)
        about["last_error"] = error
        with open(self.out / "curve.jsonl", "a") as file:
            file.write(json.dumps({"step": about["step"], "seconds": about["seconds"], "loss": about["loss"], "error": error}) + "\n")
        if error is None or about["best_error"] is None or error < about["best_error"]:
            about["best_error"], about["best_step"] = error, about["step"]
            scales = replace(self.scales, bar=torch.tensor([bar]))
            write_stored(self.out / "model.safetensors", about, state_of(self.network, scales))
        adam = {f"optimizer.{i}.{name}": torch.as_tensor(value) for i, entry in self.optimizer.state_dict()["state"].items()
                for name, value in entry.items()}
        write_stored(self.out / "last.safetensors", about,
                     state_of(self.network, self.scales) | adam | {"generator": self.generator.get_state()})

    def go_on(self) -> None:
        """Take up the state of the last checkpoint. Raises `InputError` when it is none of this data and config."""
        about, tensors = read_stored(self.out / "last.safetensors")
        if about.get("fingerprint") != self.about["fingerprint"]:
            raise InputError(f"{self.out} was trained on other data: it cannot be resumed with these files")
        ends = ("steps", "budget_seconds")
        before, asked = ({k: v for k, v in each["config"].items() if k not in ends} for each in (about, self.about))
        if before != asked:
            raise InputError(f"{self.out} was trained with another config: it cannot be resumed")
        self.network.load_state_dict(load_slender(self.out, "last").network.state_dict())
        adam: dict[int, dict[str, Tensor]] = {}
        for name, value in under("optimizer.", tensors).items():
            number, entry = name.split(".", 1)
            adam.setdefault(int(number), {})[entry] = value
        self.optimizer.load_state_dict({"state": adam, "param_groups": self.optimizer.state_dict()["param_groups"]})
        self.generator.set_state(tensors["generator"])
        self.about = {**about, "config": self.about["config"]}
        self.about.pop("schema")


def judge(model: Slender, samples: Sequence[Sample]) -> tuple[float, float]:
    """Mean over trajectories of the root mean square error [m] over frames since the touch, and the factor of the error bar."""
    errors, expected = [], []
    for sample in samples:
        answer, doubt = model.answer(seen_of(sample))
        errors.append(sample.error(answer.flatten(2)))
        expected.append(doubt)
    mean = float(np.mean([float(error.square().mean().sqrt()) for error in errors]))
    return mean, stretch(torch.cat(errors), torch.cat(expected), model.config.coverage)
