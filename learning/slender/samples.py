"""Trajectories of beams as tables, row by row a section at a pose, for a network to be trained on and tested with.

A frame's error over free nodes follows from that of its sections: with d the difference of coefficients, |d|^2 summed over them is the
mean square over a section's nodes, and what the coefficients leave out is known from the start (`left`).

Legend: P poses, R rows (sections of all poses, pose after pose), A and B features.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from datagen.files.trajectory import Trajectory, read_sound
from learning.samples.seen import Value, description
from learning.slender.beam import FUNCTIONS, see
from learning.slender.features import Seen, shown
from learning.slender.path import check_points
from physics.scene import Scene
from physics.schema import InputError

T = TypeVar("T")


@dataclass(frozen=True)
class Sample:
    """Some frames of one trajectory.

    pose, mirrored: (P, A) features, the second of the mirrored beam; section: (P, S, B); unit: (P, S) [m]; depth: (P,) [m]
    target: (P, S, 18) [m] coefficients less those of the base
    left: (P,) [m2] mean square distance over free nodes of what coefficients leave out; share: nodes over free nodes
    motion: [m] root mean square displacement of the free nodes
    told: the trajectory's description, see samples/seen.py; seconds: that it took to be made, where that is known
    """

    pose: Tensor
    mirrored: Tensor
    section: Tensor
    unit: Tensor
    depth: Tensor
    target: Tensor
    left: Tensor
    share: float
    motion: float
    told: dict[str, Value]
    digest: str
    seconds: float = 0.0

    def error(self, answer: Tensor) -> Tensor:
        """(P,) [m] root mean square distance of the free nodes for answers (P, S, 18) [m] in place of the target."""
        return (self.share * (answer - self.target).square().sum(dim=2).mean(dim=1) + self.left).sqrt()


def load_samples(files: Sequence[str | Path], frames: int) -> list[Sample]:
    """Trajectory files as samples, those in which nothing touches left out.

    Raises:
        InputError: there are none, one is damaged, or its scene is not one of a beam
    """
    return taken(files, lambda trajectory: sample_of(trajectory, frames), "beam")


def taken(files: Sequence[str | Path], take: Callable[[Trajectory], T | None], kind: str) -> list[T]:
    """What is taken of each of some trajectory files, those left out of which nothing is; kind: beam or body.

    Raises:
        InputError: there are none, one is damaged, or its scene is not of this kind
    """
    found = []
    for path in tqdm(files, desc="load", disable=None, leave=False):
        trajectory = read_sound(path)
        if not trajectory.scene:
            kinds = {"beam": "beams", "body": "bodies"}[kind]
            raise InputError(f"{path}: holds no scene, which tells a predictor of {kinds} what presses on what")
        try:
            one = take(trajectory)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        if one is not None:
            found.append(one)
    if not found:
        raise InputError(f"no trajectory files given in which an obstacle touches a {kind}")
    return found


def since_touch(first_touch: float, last: int, frames: int) -> NDArray[np.int64]:
    """At most so many frames, evenly spaced from the first touch, a fraction of the path, to the last; none where nothing touches."""
    first = int(np.floor(first_touch * last)) + 1
    return np.unique(np.linspace(first, last, frames if first <= last else 0).round().astype(int))


def sample_of(trajectory: Trajectory, frames: int) -> Sample | None:
    """At most so many frames of a trajectory, evenly spaced from the first touch to the last; None where nothing touches."""
    beam = see(Scene.from_toml(trajectory.scene))
    check_points(beam, trajectory.points[trajectory.body])
    last = len(trajectory.displacement) - 1
    picked = since_touch(beam.first_touch, last, frames)
    if not len(picked):
        return None
    truth = trajectory.displacement[picked][:, trajectory.body].astype(np.float64)
    seen, free = shown(beam, picked / last), trajectory.free[trajectory.body]
    coefficients = beam.project(truth)
    left = ((beam.nodes(coefficients) - truth)[:, free] ** 2).sum(axis=2).mean(axis=1)
    target = torch.from_numpy(coefficients) - seen.base
    digest = hashlib.sha256(np.ascontiguousarray(trajectory.displacement, "<f4").tobytes()).hexdigest()
    return Sample(seen.pose.float(), shown(beam.mirrored(), picked / last).pose.float(), seen.section.float(), seen.unit.float(),
                  seen.depth.float(), target.flatten(2).float(), torch.from_numpy(left).float(), len(free) / int(free.sum()),
                  float(np.sqrt((truth[:, free] ** 2).sum(axis=2).mean())), description(trajectory), digest,
                  float(trajectory.extra.get("seconds", 0.0)))


def seen_of(sample: Sample) -> Seen:
    """The sample as features of which the base is zero, so that a model's answer is to be the target."""
    return Seen(sample.pose, sample.section, torch.zeros(*sample.unit.shape, 3, FUNCTIONS), sample.unit, sample.depth,
                torch.zeros(len(sample.depth), dtype=torch.bool), torch.zeros(len(sample.depth)))


def mirror_signs() -> Tensor:
    """(18,) signs of the coefficients when y is turned round: odd functions of x and z displacements, even ones of y."""
    odd = torch.tensor([False, True, False, True, False, False])
    signs = torch.where(odd, -1.0, 1.0).repeat(3, 1)
    signs[1] *= -1
    return signs.flatten()


@dataclass(frozen=True)
class Table:
    """Samples one after another.

    pose: (2, P, A) features as they are and mirrored; section (R, B); target (R, 18) [m]; unit (R,) [m]; depth (P,) [m]
    first, count: (P,) row of a pose's first section and how many it has; weight: (P,) 1 over its trajectory's motion, their mean 1
    """

    pose: Tensor
    section: Tensor
    target: Tensor
    unit: Tensor
    depth: Tensor
    first: Tensor
    count: Tensor
    weight: Tensor

    def rows(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        """(r,) the rows of some poses (p,), one pose after another, and (r,) whose each is, 0 .. p - 1."""
        count = self.count[poses]
        owner = torch.repeat_interleave(torch.arange(len(poses)), count)
        begin = self.first[poses] - (count.cumsum(0) - count)
        return torch.arange(len(owner)) + begin[owner], owner


def table_of(samples: Sequence[Sample]) -> Table:
    """All of them in one."""
    count = torch.cat([torch.full((len(s.pose),), s.section.shape[1]) for s in samples])
    weight = torch.cat([torch.full((len(s.pose),), 1 / s.motion) for s in samples])
    return Table(torch.stack([torch.cat([s.pose for s in samples]), torch.cat([s.mirrored for s in samples])]),
                 torch.cat([s.section.flatten(0, 1) for s in samples]), torch.cat([s.target.flatten(0, 1) for s in samples]),
                 torch.cat([s.unit.flatten() for s in samples]), torch.cat([s.depth for s in samples]),
                 count.cumsum(0) - count, count, weight / weight.mean())


def fingerprint(samples: Sequence[Sample]) -> str:
    """SHA-256 over their displacements: tells whether two trainings saw the same data."""
    return hashlib.sha256("".join(sample.digest for sample in samples).encode()).hexdigest()
