"""Training samples: frames of trajectories held in memory, with fresh noise, and the scale of everything in them.

A sample is a graph, a base b and a unit c from which a network's output y (N, D) makes the displacement of one frame, f:

    u(f) = b + c y        on free nodes, and the loss compares y with (u(f) - b) / c

    scheme    estimate   the graph shows                            on free nodes also           b                       c
    step      no         frame f - 1                                -                            u(f - 1)                1
    step      no         the same, with history = 1                 last velocity v              u(f - 1) + v            1
    step      yes        the same                                   e(f) - u(f - 1)              e(f)                    c(f)
    pose      no         the body at rest, the obstacle at f        -                            0                       1
    pose      yes        the body as estimated, the obstacle at f   a(f) / c(f)                  e(f)                    c(f)

e is an estimate of the quasi-static state at the obstacle's pose, a the answer to the forces that it leaves over, c the root
mean square of a (quasistatic.py): the network learns what is wrong with the estimate in units of about how wrong it is.

A stepwise simulator walks on its own predictions, so it is trained on disturbed frames: to every free node, at every access anew,

    x' = x(f - 1) + noise,    noise ~ N(0, noise^2 I) [m]

and u(f - 1) above is that of x'. The target is corrected: it leads from the disturbed position to the true next one, so the
network learns to repair. A pose has no past, and no noise.

Lengths are in metres, or counted in cells or sizes of the body, the config's own among them: all of what is above is then in that unit.

Bodies in a plane have D = 2 coordinates, others D = 3. Of a flow u above is the velocity at nodes that stay, and only the first row
is there. Where several frames f, f + 1 ... are told at once, which goes with the first row alone, each is u less the same base, and
the graph of a body shows the ways of prescribed nodes to all of them. Further fields, stress or pressure
(graphs/layout.py), are told beside y as they are in frame f, on all nodes of the body.

Disturbed frames are not what a simulator walks into. With pushed > 0 a frame is shown as the network's own predictions have left it
(training/walks.py), and noise comes on top.

The normaliser (scales.py) is fitted on the training trajectories only, on samples as the training sees them, noise included.

Legend: N nodes, T frames, D space dimensions, b frames told at once, O = b (D + numbers of further fields).
Source: Pfaff et al. 2021, section 3.2 and appendix A.2.2; Godwin et al. 2022 for the correction; Brandstetter, Worrall and Welling
2022 (arXiv:2202.03376) for frames told at once.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from datagen.files.trajectory import Trajectory, problems, read_trajectory
from learning.config import TrainConfig
from learning.graphs.flow import flow_graph
from learning.graphs.graph import Graph, Skeleton, build_graph, build_skeleton
from learning.graphs.layout import SOLID_BODY, Layout, layout_of, moves
from learning.graphs.material import FEATURES
from learning.samples.estimate import Estimate, estimate
from learning.samples.scales import INPUTS, Moments, Normaliser
from learning.segments.clusters import clusters_of
from learning.segments.cut import segment
from learning.segments.quality import auto_segment
from physics.schema import InputError

FIT_FRAMES = 1000
SAME_MATERIAL = 1e-6  # deviation below which a number of the material is rounding
OFTENEST = 5.0  # times the mean that a frame may be drawn on account of its error
SMALLEST = 1e-8  # [m] unit of a frame whose estimate leaves no force over
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"), "fidelity", "estimates")


@dataclass(frozen=True)
class Example:
    """A trajectory and what its graphs have in common.

    targets: (F,) the frames to predict, ascending, none of them 0
    estimate: of the targets; None where the config wants none
    layout: what of it is seen and predicted
    """

    trajectory: Trajectory
    skeleton: Skeleton
    targets: NDArray[np.int64]
    estimate: Estimate | None
    layout: Layout = SOLID_BODY

    @cached_property
    def states(self) -> NDArray[np.float32]:
        """(T, N, D) displacement in units of length, or velocity [m/s] of a flow."""
        found = self.layout.states(self.trajectory)
        return found if self.length == 1 else found / np.float32(self.length)

    @cached_property
    def length(self) -> float:
        """[m] what lengths are counted in."""
        return self.layout.unit(self.trajectory)

    @cached_property
    def asked(self) -> Tensor:
        """(N, O) True on the numbers that are predicted."""
        return torch.from_numpy(self.layout.asked(self.trajectory))


@dataclass(frozen=True)
class Sample:
    """What a frame is predicted from: its graph, base (N, D) and unit, see the module."""

    graph: Graph
    base: NDArray[np.float64]
    unit: float


def load_examples(files: Sequence[str | Path], config: TrainConfig, *, walk: bool = False,
                  layout: Layout | None = None) -> list[Example]:
    """Read and segment trajectory files.

    Raises `InputError` for none at all, for one damaged, of a single frame or without a free node, and for a set in which nothing moves.

    walk: the examples are to be walked through, which for scheme = "step" takes every frame
    layout: what is seen and predicted; by default what this set has
    """
    if not files:
        raise InputError("no trajectory files given")
    examples, trajectories = [], [_trajectory(path) for path in files]
    layout = layout or _layout(trajectories, config)
    if not (walk or layout.flow or any(map(moves, trajectories))):
        others = ", ".join(trajectories[0].fields)
        raise InputError(f"nothing moves in this set: the displacement of every free node of its {len(files)} trajectories is zero, and "
                         f"that is what a network learns{f'; not {others}, which is there' if others else ''}")
    for path, trajectory in zip(tqdm(files, desc="load", disable=None, leave=False), trajectories, strict=True):
        first, last = layout.first(trajectory), len(trajectory.displacement) - (1 if walk else layout.bundle)
        if last <= first:
            raise InputError(f"{path}: bundle = {layout.bundle}: more frames than there are to predict")
        count = last - first if walk and config.scheme == "step" else min(config.frames or last, last - first)
        targets = np.linspace(first, last, count + 1).round().astype(np.int64)[1:]
        try:
            examples.append(build_example(trajectory, config, targets=targets, cache=CACHE, layout=layout))
        except (InputError, FloatingPointError) as error:
            raise InputError(f"{path}: {error}") from None
    return examples


def _layout(trajectories: Sequence[Trajectory], config: TrainConfig) -> Layout:
    return layout_of(trajectories, config.outputs.fields, bundle=config.bundle, **vars(config.inputs))


def _trajectory(path: str | Path) -> Trajectory:
    """A trajectory that something can be learned from. Raises `InputError`."""
    trajectory = read_trajectory(path)
    found = problems(trajectory)
    if len(trajectory.displacement) < 2:
        found.append("it has a single frame, and so nothing to predict")
    if not trajectory.free.any():
        found.append("no node is free to move, and so nothing to predict")
    if found:
        raise InputError(f"{path}: {found[0]}")
    return trajectory


def build_example(trajectory: Trajectory, config: TrainConfig, *, targets: NDArray[np.int64] | None = None,
                  cache: Path | None = None, layout: Layout | None = None) -> Example:
    """Segment a trajectory in memory and collect what its graphs have in common.

    Args:
        targets: the frames to predict, ascending; all after the one that a rollout starts from by default
        cache: folder of estimates made before
        layout: what is seen and predicted; by default what this trajectory has

    Raises:
        InputError: a mesh that cannot be cut, a trajectory of another layout, a scheme that flows do not know
    """
    layout = layout or _layout([trajectory], config)
    layout.check(trajectory)
    if layout.flow and (config.scheme != "step" or config.history or config.estimate):
        raise InputError('a flow is predicted step by step: scheme = "step", without history and estimate')
    if targets is None:
        targets = np.arange(layout.first(trajectory) + 1, len(trajectory.displacement))
    wants, label = config.network.wants, segments_of(trajectory, config)
    skeleton = build_skeleton(trajectory, label, overlap=config.overlap, walk=wants.walk, levels=wants.levels, layout=layout)
    found = estimate(trajectory, targets, cache=cache) if config.estimate else None
    return Example(trajectory, skeleton, targets, found, layout)


def segments_of(trajectory: Trajectory, config: TrainConfig) -> NDArray[np.int32]:
    """(N,) segment of each node, as the network wants them, or the whole as one. Raises `InputError` for a mesh that cannot be cut so."""
    if cluster := config.network.wants.cluster:
        return clusters_of(trajectory, cluster)
    if not config.network.wants.segments:
        return np.zeros(len(trajectory.points), np.int32)
    if isinstance(config.segments, str):
        return auto_segment(trajectory, method=config.method, tau=config.tau, modes=config.modes, mode_count=config.mode_count)[0]
    return segment(trajectory, count=config.segments, method=config.method, tau=config.tau, modes=config.modes,
                   mode_count=config.mode_count)


def describe(example: Example, target: int, now: NDArray[np.floating], before: NDArray[np.floating], config: TrainConfig) -> Sample:
    """What a frame is predicted from.

    Args:
        target: 1 .. T - 1; with an estimate, one of the example's targets
        now, before: (N, D) states one and two frames before; read by scheme = "step" alone
    """
    skeleton, free = example.skeleton, example.skeleton.free[:, None]  # (N, 1)
    frames = np.minimum(target + np.arange(example.layout.bundle), len(example.states) - 1)  # beyond the last nothing moves
    given, *later = example.states[frames].astype(np.float64)
    if example.layout.flow:
        shown = np.asarray(now, np.float64)
        return Sample(flow_graph(skeleton, np.where(free, shown, given)), shown, 1.0)
    base, unit = np.zeros_like(given), 1.0
    if example.estimate is not None:
        base[:], answer = (found[:, :example.layout.space] / example.length for found in example.estimate.at(target))
        unit = unit_of(answer, skeleton.free)
    if config.scheme == "pose":
        shown, velocity = np.where(free, base, given), np.zeros_like(given)
        known = velocity if example.estimate is None else answer / unit
    else:
        shown = np.asarray(now, np.float64)
        velocity = np.concatenate([given - shown, *(each - shown for each in later)], axis=1)  # (N, b D)
        known = shown - before if config.history else 0.0
        if example.estimate is None:
            base = shown + known
        else:
            known = base - shown
    world = config.network.wants.world_radius
    graph = build_graph(skeleton, skeleton.rest + shown, velocity, world or config.contact_radius, known, world=world > 0)
    return Sample(graph, base, unit)


def unit_of(answer: NDArray[np.float32], free: NDArray[np.bool_]) -> float:
    """The unit [m] of the output for a frame with an estimate, from the answer (N, 3) [m] to the forces that this leaves over."""
    return max(SMALLEST, float(np.sqrt((answer[free].astype(np.float64)**2).sum(axis=1).mean())))


def sample(example: Example, frame: int, config: TrainConfig, generator: torch.Generator, *,
           now: NDArray[np.floating] | None = None) -> tuple[Graph, Tensor]:
    """The graph from which the frame after a given one is predicted, and what a network should say (N, O), its state in the sample's unit.

    Args:
        frame: from 0 to T - 2; for scheme = "step" it is the one that is shown, disturbed
        config: its scheme, contact_radius and noise are used; without noise the frame and the generator are left alone
        now: (N, D) what is shown in place of the frame
    """
    states, free = example.states, example.skeleton.free
    now = (states[frame] if now is None else now).astype(np.float64)
    if config.noise and config.scheme == "step":
        disturbance = config.noise * torch.randn(now.shape, generator=generator).numpy()
        now = now + np.where(free[:, None], disturbance, 0.0)
    shown = describe(example, frame + 1, now, states[max(frame - 1, 0)], config)
    target = np.concatenate([(state - shown.base) / shown.unit for state in states[frame + 1:frame + 1 + example.layout.bundle]], axis=1)
    beside = example.layout.beside(example.trajectory, frame + 1)
    return shown.graph, torch.from_numpy(np.concatenate([target.astype(np.float32), beside], axis=1))


def fit_normaliser(examples: Sequence[Example], config: TrainConfig) -> Normaliser:
    """Scales from at most 1000 frames, spread evenly over the given (training) trajectories."""
    frames = all_frames(examples)
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, FIT_FRAMES).astype(int))]
    generator = torch.Generator().manual_seed(0)
    layout, moments = examples[0].layout, {name: Moments() for name in (*INPUTS, "velocity", "fields")}
    for which, frame in frames.tolist():
        graph, target = sample(examples[which], frame, config, generator)
        for name in INPUTS:
            moments[name].add(getattr(graph, name))
        state, beside = target.split([layout.bundle * layout.space, layout.bundle * sum(layout.sizes)], dim=1)
        moments["velocity"].add(state[torch.from_numpy(examples[which].skeleton.free)].reshape(-1, 1))
        moments["fields"].add(beside[torch.from_numpy(examples[which].trajectory.body)])
    floor = 1e-6 * float(moments["mesh_edge"].mean[layout.space])
    scale = moments["velocity"].mean_square.sqrt().float()
    floors = dict.fromkeys(INPUTS, torch.full((1,), floor, dtype=torch.float64))
    if layout.material:  # has no length in it
        floors["node"] = torch.cat([floors["node"].expand(layout.widths.node - FEATURES), torch.full((FEATURES,), SAME_MATERIAL)])
    tables = {name: moments[name].table(floors[name]) for name in INPUTS}
    tables["fields"] = moments["fields"].table(1e-6 * moments["fields"].mean_square.sqrt())
    return Normaliser(**tables, velocity=torch.where(scale > floor, scale, 1.0), layout=layout)


def all_frames(examples: Sequence[Example]) -> NDArray[np.int64]:
    """(samples, 2) every pair of an example's number and a frame before one of its targets."""
    return np.concatenate([np.stack([np.full(len(example.targets), which), example.targets - 1], axis=1)
                           for which, example in enumerate(examples)])


def chances(examples: Sequence[Example]) -> Tensor | None:
    """(samples,) how often each pair of `all_frames` is to be drawn; None where all are alike, without estimates.

    The error of a path is the root mean square over its frames, and what counts is its mean over paths. Its derivative by the
    mean square error of a frame, in units c_f of that frame, is in proportion to c_f^2 / (root mean square of c over the path).
    Half of the draws follow that, half are even.
    """
    shares = []
    for example in examples:
        if example.estimate is None:
            return None
        unit = np.array([unit_of(answer, example.skeleton.free) for answer in example.estimate.answer])
        shares.append(unit**2 / np.sqrt(np.mean(unit**2)))
    share = np.concatenate(shares)
    return torch.from_numpy(np.minimum(share / share.mean(), OFTENEST) + 1)
