"""Training samples: frames of trajectories held in memory, with fresh noise, and the scale of everything in them.

A sample is the graph of frame t and the velocity that leads from it to frame t + 1. A stepwise simulator walks on its own
predictions, so it is trained on disturbed frames: to every free node, at every access anew,

    x' = x(t) + noise,    noise ~ N(0, noise^2 I) [m],    target  v = x(t+1) - x'

The target is corrected: it leads from the disturbed position to the true next one, so the network learns to repair.

The normaliser is fitted on the training trajectories only, on samples as the training sees them, noise included. Inputs
get mean and standard deviation of each feature. The velocity has a natural zero, and gets one scale for its three
components, its root mean square over free nodes, so that the loss is proportional to the squared error in metres: with
one scale each, a sideways velocity that is nothing but rounding would weigh as much as the bending.

Legend: N nodes, T frames, F features.
Source: Pfaff et al. 2021, section 3.2 and appendix A.2.2; Godwin et al. 2022 for the correction.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from datagen.trajectory import Trajectory, problems, read_trajectory
from learning.config import TrainConfig
from learning.graph import Graph, Skeleton, build_graph, build_skeleton
from learning.segment_quality import auto_segment
from learning.segments import segment
from physics.schema import InputError

FIT_FRAMES = 1000
INPUTS = ("node", "mesh_edge", "contact_edge")


@dataclass(frozen=True)
class Case:
    """A trajectory and what its graphs have in common."""

    trajectory: Trajectory
    skeleton: Skeleton


@dataclass(frozen=True)
class Normaliser:
    """(2, F) mean and standard deviation of the features of nodes and edges; (1,) scale of the velocity [m]."""

    node: Tensor
    mesh_edge: Tensor
    contact_edge: Tensor
    velocity: Tensor

    def graph(self, graph: Graph) -> Graph:
        """The graph with its features scaled."""
        return replace(graph, **{name: (getattr(graph, name) - getattr(self, name)[0]) / getattr(self, name)[1]
                                 for name in INPUTS})

    def tensors(self) -> dict[str, Tensor]:
        """The four tables by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def load_cases(files: Sequence[str | Path], config: TrainConfig) -> list[Case]:
    """Read and segment trajectory files. Raises `InputError` for none at all, and for one damaged or of a single frame."""
    if not files:
        raise InputError("no trajectory files given")
    cases = []
    for path in files:
        trajectory = read_trajectory(path)
        found = problems(trajectory)
        if len(trajectory.displacement) < 2:
            found.append("it has a single frame, and so nothing to predict")
        if found:
            raise InputError(f"{path}: {found[0]}")
        cases.append(build_case(trajectory, config))
    return cases


def build_case(trajectory: Trajectory, config: TrainConfig) -> Case:
    """Segment a trajectory in memory and collect what its graphs have in common."""
    return Case(trajectory, build_skeleton(trajectory, segments_of(trajectory, config)))


def segments_of(trajectory: Trajectory, config: TrainConfig) -> NDArray[np.int32]:
    """(N,) segment of each node, as a config wants them. Raises `InputError` for a mesh that cannot be segmented so."""
    if isinstance(config.segments, str):
        return auto_segment(trajectory, method=config.method, tau=config.tau, modes=config.modes, mode_count=config.mode_count)[0]
    return segment(trajectory, count=config.segments, method=config.method, tau=config.tau, modes=config.modes,
                   mode_count=config.mode_count)


def sample(case: Case, frame: int, config: TrainConfig, generator: torch.Generator) -> tuple[Graph, Tensor]:
    """The graph of a disturbed frame, and the velocity (N, 3) [m] from it to the next frame.

    Args:
        frame: from 0 to T - 2
        config: its contact_radius and noise are used; without noise the frame and the generator are left alone
    """
    skeleton, displacement = case.skeleton, case.trajectory.displacement
    now = skeleton.rest + displacement[frame]
    after = skeleton.rest + displacement[frame + 1]
    if config.noise:
        disturbance = config.noise * torch.randn(now.shape, generator=generator).numpy()
        now = now + np.where(skeleton.free[:, None], disturbance, 0.0)
    velocity = after - now
    return build_graph(skeleton, now, velocity, config.contact_radius), torch.from_numpy(velocity.astype(np.float32))


def fit_normaliser(cases: Sequence[Case], config: TrainConfig) -> Normaliser:
    """Scales from at most 1000 frames, spread evenly over the given (training) trajectories."""
    frames = all_frames(cases)
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, FIT_FRAMES).astype(int))]
    generator = torch.Generator().manual_seed(0)
    moments = {name: Moments() for name in (*INPUTS, "velocity")}
    for which, frame in frames.tolist():
        graph, velocity = sample(cases[which], frame, config, generator)
        for name in INPUTS:
            moments[name].add(getattr(graph, name))
        moments["velocity"].add(velocity[torch.from_numpy(cases[which].skeleton.free)].reshape(-1, 1))
    floor = 1e-6 * float(moments["mesh_edge"].mean[3])
    scale = moments["velocity"].mean_square.sqrt().float()
    tables = {name: moments[name].table(floor) for name in INPUTS}
    return Normaliser(**tables, velocity=torch.where(scale > floor, scale, 1.0))


class Moments:
    """Running count, sum and sum of squares of features, in double precision."""

    def __init__(self) -> None:
        self.count = 0
        self.sum = self.square = torch.zeros(1, dtype=torch.float64)

    def add(self, features: Tensor) -> None:
        """Take in (M, F) values, M = 0 included."""
        values = features.double()
        self.count += len(values)
        self.sum = self.sum + values.sum(dim=0)
        self.square = self.square + (values * values).sum(dim=0)

    @property
    def mean(self) -> Tensor:
        """(F,) means, zero before any value."""
        return self.sum / max(self.count, 1)

    @property
    def mean_square(self) -> Tensor:
        """(F,) means of the squares, zero before any value."""
        return self.square / max(self.count, 1)

    def table(self, floor: float) -> Tensor:
        """(2, F) float32 mean and standard deviation; a deviation below the floor is rounding, not signal, and becomes 1."""
        deviation = (self.mean_square - self.mean**2).clamp(min=0).sqrt()
        return torch.stack([self.mean, torch.where(deviation > floor, deviation, 1.0)]).float()


def all_frames(cases: Sequence[Case]) -> NDArray[np.int64]:
    """(samples, 2) every pair of a case's number and a frame that has a next one."""
    return np.concatenate([np.stack([np.full(len(case.trajectory.displacement) - 1, which),
                                     np.arange(len(case.trajectory.displacement) - 1)], axis=1)
                           for which, case in enumerate(cases)])


def fingerprint(cases: Sequence[Case]) -> str:
    """SHA-256 over rest positions and displacements: tells whether two trainings saw the same data."""
    digest = hashlib.sha256()
    for case in cases:
        digest.update(np.ascontiguousarray(case.trajectory.points, "<f8").tobytes())
        digest.update(np.ascontiguousarray(case.trajectory.displacement, "<f4").tobytes())
    return digest.hexdigest()
