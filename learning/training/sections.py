"""Train a predictor of beams (the loop: poses.py).

    loss = mean over poses of [ weight x mean over sections of |unit x scale x answer - target|^2 ] / the same of the target alone
         + (log e - s)^2 / 100,    e the error of a pose over its depth, s what the network expects, its gradient kept from the rest

Every other pose is mirrored. A weight is one over the motion of the trajectory: the mean over trajectories of root mean square errors is
what counts, and such an error grows with the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from learning.config import SlenderConfig
from learning.networks.sections import Sections
from learning.networks.stored import state_of
from learning.slender.calibration import stretch
from learning.slender.model import Scales, Slender, scaled
from learning.slender.samples import Sample, Table, fingerprint, load_samples, mirror_signs, seen_of, table_of
from learning.training.poses import doubted, refuse_trained, run


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
    refuse_trained(Path(out), resume)
    samples = load_samples(files_train, config.frames)
    valid = load_samples(files_valid, config.frames) if files_valid else []
    return run(config, _OfSections(config, samples, valid, str(out)), [sample.told for sample in samples], Path(out), steps=steps,
               resume=resume)


def fit_scales(table: Table) -> Scales:
    """The scales of a training's table; a feature that never changes keeps its size."""
    def moments(values: Tensor) -> Tensor:
        deviation = values.std(dim=0)
        return torch.stack([values.mean(dim=0), torch.where(deviation > 1e-5, deviation, 1.0)])

    pose = table.pose.flatten(0, 1)
    answer = (table.target.square().mean(dim=0) / table.unit.square().mean()).sqrt()
    return Scales(moments(pose), moments(table.section), torch.where(answer > 1e-9, answer, 1.0), pose.amin(dim=0), pose.amax(dim=0),
                  torch.tensor([math.inf]))


class _OfSections:
    """See poses.Learner."""

    def __init__(self, config: SlenderConfig, samples: Sequence[Sample], valid: Sequence[Sample], name: str) -> None:
        self.config, self.valid, self.name, self.table = config, valid, name, table_of(samples)
        self.fingerprint, self.poses = fingerprint(samples), len(self.table.depth)
        self.data_seconds = sum(sample.seconds for sample in (*samples, *valid))
        self.scales = fit_scales(self.table)
        torch.manual_seed(config.seed)
        self.network = Sections(config.network, self.table.pose.shape[2], self.table.section.shape[1])
        self.signs = mirror_signs()
        share = (self.table.weight / self.table.count).repeat_interleave(self.table.count)
        self.motion = float((share * self.table.target.square().sum(dim=1)).sum() / len(self.table.depth))
        self._seen = scaled(self.table.pose, self.scales.pose), scaled(self.table.section, self.scales.section)

    def loss(self, generator: torch.Generator, count: int) -> Tensor:
        table = self.table
        poses = torch.randint(len(table.depth), (count,), generator=generator)
        flip = torch.randint(2, (count,), generator=generator)
        rows, owner = table.rows(poses)
        answer, doubt = self.network(self._seen[0][flip, poses], self._seen[1][rows], owner)
        target = table.target[rows] * torch.where(flip[owner, None] == 1, self.signs, 1.0)
        error = (answer * self.scales.answer * table.unit[rows, None] - target).square().sum(dim=1)  # (r,)
        square = torch.zeros(len(poses)).index_add(0, owner, error) / table.count[poses]  # (p,)
        return (table.weight[poses] * square).mean() / self.motion + doubted(square.sqrt(), table.depth[poses], doubt)

    def judged(self) -> tuple[float | None, float]:
        return judge(Slender(self.config, self.network, self.scales, self.name), self.valid) if self.valid else (None, math.inf)

    def state(self, bar: float) -> dict[str, Tensor]:
        return state_of(self.network, replace(self.scales, bar=torch.tensor([bar])))


def judge(model: Slender, samples: Sequence[Sample]) -> tuple[float, float]:
    """Mean over trajectories of the root mean square error [m] over frames since the touch, and the factor of the error bar."""
    errors, expected = [], []
    for sample in samples:
        answer, doubt = model.answer(seen_of(sample))
        errors.append(sample.error(answer.flatten(2)))
        expected.append(doubt)
    mean = float(np.mean([float(error.square().mean().sqrt()) for error in errors]))
    return mean, stretch(errors, expected, model.config.coverage)
