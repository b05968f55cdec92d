"""Train a predictor of bodies by shapes (the loop: poses.py).

    loss = mean over poses of [ weight x (a - b)^T G (a - b) ] / the same of a = 0  +  what poses.doubted says of errors over depth,

with a the amounts that the network says and b, G as in bodies/samples.py. The shapes are found first, from the training's displacements and
their mirrored copies.
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

from learning.bodies.model import Bodies, Scales
from learning.bodies.samples import Read, Sample, fingerprint, fitted, read, sample_of, shapes_of, table_of
from learning.bodies.shapes import mirrors, powers
from learning.config import BodiesConfig
from learning.networks.shapes import Shapes
from learning.networks.stored import state_of
from learning.slender.calibration import stretch
from learning.slender.model import scaled
from learning.training.poses import doubted, refuse_trained, run


def train_shapes(config: BodiesConfig, files_train: Sequence[str | Path], files_valid: Sequence[str | Path], out: str | Path, *,
                 steps: int | None = None, resume: bool = False) -> dict[str, Any]:
    """Train a predictor of bodies by shapes and leave it in a run folder; all else as in `training.sections.train_sections`."""
    refuse_trained(Path(out), resume)
    found = read(files_train, config.frames)
    valid = read(files_valid, config.frames) if files_valid else []
    return run(config, _OfShapes(config, found, valid, str(out)), [one.told for one in found], Path(out), steps=steps, resume=resume)


class _OfShapes:
    """See poses.Learner."""

    def __init__(self, config: BodiesConfig, found: Sequence[Read], valid: Sequence[Read], name: str) -> None:
        self.config, self.name = config, name
        degrees = powers(np.mean([one.body.extent for one in found], axis=0), config.network.degree, config.network.touched > 0)
        every = [fitted(one, degrees, mirror) for one in found for mirror in mirrors(config.mirrored)]
        shapes = shapes_of(every, config.network.shapes, config.network.touched)
        self.table = table = table_of([sample_of(one, shapes) for one in every])
        self.valid = [sample_of(fitted(one, degrees), shapes) for one in valid]
        self.fingerprint, self.poses = fingerprint(found), len(table.depth)
        self.data_seconds = sum(one.seconds for one in (*found, *valid))
        deviation = table.feature.std(dim=0)
        self.scales = Scales(
            torch.stack([table.feature.mean(dim=0), torch.where(deviation > 1e-5, deviation, 1.0)]),
            (table.best.square().mean(dim=0) / table.depth.square().mean()).sqrt(), table.feature.amin(dim=0), table.feature.amax(dim=0),
            torch.from_numpy(degrees), torch.from_numpy(shapes).float(), torch.tensor([math.inf]))
        torch.manual_seed(config.seed)
        self.network = Shapes(config.network, table.feature.shape[1], len(shapes))
        self.motion = float((table.weight * _square(table.best, table.gram[table.owner])).mean())
        self._seen = scaled(table.feature, self.scales.pose)

    def loss(self, generator: torch.Generator, count: int) -> Tensor:
        table = self.table
        some = torch.randint(self.poses, (count,), generator=generator)
        said, doubt = self.network(self._seen[some])
        depth = table.depth[some]
        square = _square(said * self.scales.answer * depth[:, None] - table.best[some], table.gram[table.owner[some]])
        return (table.weight[some] * square).mean() / self.motion + doubted(square.clamp(min=1e-20).sqrt(), depth.clamp(min=1e-9), doubt)

    def judged(self) -> tuple[float | None, float]:
        return judge(Bodies(self.config, self.network, self.scales, self.name), self.valid) if self.valid else (None, math.inf)

    def state(self, bar: float) -> dict[str, Tensor]:
        return state_of(self.network, replace(self.scales, bar=torch.tensor([bar])))


def judge(model: Bodies, samples: Sequence[Sample]) -> tuple[float, float]:
    """Mean over trajectories of the root mean square error [m] over frames since the touch, and the factor of the error bar."""
    answers = [model.answer(sample.feature, sample.depth) for sample in samples]
    errors = [sample.error(amount) for sample, (amount, _) in zip(samples, answers, strict=True)]
    mean = float(np.mean([float(error.square().mean().sqrt()) for error in errors]))
    return mean, stretch(errors, [expected for _, expected in answers], model.config.coverage)


def _square(amount: Tensor, gram: Tensor) -> Tensor:
    """(P,) mean squares of displacements of amounts (P, r), for products (P, r, r) of shapes."""
    return torch.einsum("pi,pij,pj->p", amount, gram, amount)
