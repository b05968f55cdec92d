"""Many paths of one beam at once: what the beam says is computed once, and poses of all paths are one batch.

The paths of a body under obstacles of one shape that press on one face differ in where the obstacle starts and ends, in its radius, and
in the turn of a cylinder. A frame that is asked for is the spline of `path.predict` through the same poses; the last frame is
itself a pose, so that nothing but one pose a path is computed where no other is asked for.

Legend: n paths, F frames that are asked for, K poses of a path, P = n K, S sections, N nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from torch import Tensor

from learning.slender.beam import Beam
from learning.slender.features import left, look
from learning.slender.model import Slender
from learning.slender.path import knots
from learning.slender.touch import Indenter, first_touch, groove

Floats = NDArray[np.floating[Any]]
POSES, NUMBERS = 1024, 20_000_000  # in a batch, at most


@dataclass(frozen=True)
class Paths:
    """Paths of one beam: start, end (n, 3) of the obstacle's centre in the beam's frame, radius, turn (n,), in place of the beam's own."""

    beam: Beam
    start: Tensor
    end: Tensor
    radius: Tensor
    turn: Tensor

    def __getitem__(self, some: slice) -> Paths:
        return Paths(self.beam, self.start[some], self.end[some], self.radius[some], self.turn[some])

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def first_touch(self) -> Tensor:
        """(n,) fractions of the paths."""
        return first_touch(self.start, self.end, self.radius, self.beam.extent[2])

    def obstacle(self, poses: int = 1) -> Indenter:
        """As theory knows it, with numbers (n * poses,), those of a path for all of its poses."""
        row = self.beam.row
        first, nodes = groove(self.start, self.end, self.first_touch, row, self.beam.cells[1])
        radius, turn, first, nodes = (each.repeat_interleave(poses) for each in (self.radius, self.turn, (first - nodes) / row, nodes))
        return Indenter(radius, self.beam.round, turn, first, row, nodes)


@dataclass(frozen=True)
class PathFrames:
    """displacement (n, F, N, 3) [m]; bar (n, F) [m] and unsure (n, F) as those of a `path.Path`; force (n, F) [m2] of the obstacle over
    Young's modulus, by theory."""

    displacement: NDArray[np.float32]
    bar: Floats
    unsure: NDArray[np.bool_]
    force: Floats


def alike(beams: Sequence[Beam]) -> Iterator[tuple[NDArray[np.int64], Paths]]:
    """Beams of one body in groups of those that look alike in their frames: the places of a group's members, and their paths."""
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for i, beam in enumerate(beams):
        kinds.setdefault((beam.round, beam.side, beam.up, beam.signs), []).append(i)
    for members in kinds.values():
        some = [beams[i] for i in members]
        start, end = (torch.as_tensor(np.array([getattr(beam, name) for beam in some])) for name in ("start", "end"))
        radius, turn = (torch.tensor([getattr(beam, name) for beam in some], dtype=torch.float64) for name in ("radius", "turn"))
        yield np.array(members), Paths(some[0], start, end, radius, turn)


def per_batch(model: Slender, frames: Floats, nodes: int) -> int:
    """How many paths are worth a batch."""
    return max(1, min(POSES // len(_shares(model, frames)), NUMBERS // (3 * nodes * len(frames))))


def _shares(model: Slender, frames: Floats) -> Floats:
    """(K,) poses of a path as shares of the way from its first touch to its end; the end alone where no other frame is asked for."""
    return knots(0.0, model.config.poses)[-1 if (frames == 1).all() else 0:]


def predict_many(model: Slender, paths: Paths, frames: Floats) -> PathFrames:
    """What the predictor says of frames, given as fractions (F,) of the paths, 0 to 1."""
    beam, touched = paths.beam, paths.first_touch.numpy()
    start = np.where(touched < 1, touched, 0.0)[:, None]  # those that never touch are looked at, and then put to rest
    share = _shares(model, frames)

    def centres(share: Floats) -> Tensor:
        at = torch.as_tensor(start + (1 - start) * share)[..., None]  # (n, K, 1)
        return paths.start[:, None] + at * (paths.end - paths.start)[:, None]

    with torch.inference_mode():
        seen = look(beam, centres(share).flatten(0, 1), paths.obstacle(len(share)))
        if beam.round:  # what happened on the way counts, even where the last frame alone is asked for
            every = knots(0.0, model.config.poses)
            seen = replace(seen, jumps=left(beam, centres(every), paths.obstacle(len(every)))[:, -len(share):].flatten())
        coefficients, doubt = model.answer(seen)
        strange = model.strange(seen)
    said = coefficients.numpy().reshape(len(paths), len(share), -1)
    bars, unlike, force = (each.numpy().reshape(len(paths), -1).astype(float) for each in (doubt, strange, seen.force))
    if len(share) > 1:
        where = (frames - start) / (1 - start)  # (n, F) in the range of the poses
        weights = CubicSpline(share, np.eye(len(share)))(where).astype(np.float32)
        said = weights @ said
        bars, unlike, force = (np.stack([np.interp(*each) for each in zip(where, [share] * len(where), values, strict=True)])
                               for values in (bars, unlike, force))
    else:
        said, bars, unlike, force = (np.repeat(each, len(frames), axis=1) for each in (said, bars, unlike, force))
    rest = frames <= touched[:, None]
    nodes = beam.nodes(said.reshape(-1, *coefficients.shape[1:])).reshape(len(paths), len(frames), -1, 3)
    nodes[rest] = 0
    factor = model.scales.bar.item()
    bars = np.where(rest, 0.0, factor * bars if np.isfinite(factor) else np.inf)
    unsure = ~rest & ((unlike > 0) | (bars > model.config.unsure_above))
    return PathFrames(nodes, bars, unsure, force)
