"""Estimates of the quasi-static states at the obstacle's poses, made once for some frames of a trajectory and kept for the next time.

How a state is found: physics/reduced/quasistatic.py. Only rest shape, material, supports and the obstacle's poses are read: never
the motion of a free node.

Legend: N nodes, F frames.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import HANDLE, Trajectory
from physics.reduced.quasistatic import Estimator
from physics.scene import Scene
from physics.schema import InputError
from physics.whole import written_whole

VERSION = 7  # of the estimates: to be raised with every change to their numbers


@dataclass(frozen=True)
class Estimate:
    """Estimates at some frames of a trajectory.

    frames: (F,) their numbers, ascending
    displacement: (F, N, 3) [m] of all nodes, the obstacle's as given
    answer: (F, N, 3) [m] what the rest stiffness answers to the forces left over: about how wrong the estimate is, and which way
    lost: frames of poses to which no state was found, so that those around it are guessed
    """

    frames: NDArray[np.int64]
    displacement: NDArray[np.float32]
    answer: NDArray[np.float32]
    lost: tuple[int, ...] = ()

    def at(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Displacement and answer (N, 3) at one of the frames. Raises KeyError for another."""
        row = int(np.searchsorted(self.frames, frame))
        if row == len(self.frames) or self.frames[row] != frame:
            raise KeyError(f"no estimate of frame {frame}")
        return self.displacement[row], self.answer[row]


def estimate(trajectory: Trajectory, frames: NDArray[np.int64], *, cache: Path | None = None) -> Estimate:
    """Estimates at some frames of a trajectory.

    Args:
        frames: (F,) ascending
        cache: a folder to look in and to leave the result in

    Raises:
        InputError: the trajectory holds no scene, or one of a kind that is not known here
    """
    body = trajectory.body
    path = None if cache is None else cache / f"{_key(trajectory, frames)}.npz"
    if path is not None and path.exists():
        with np.load(path) as kept:
            found, lost = kept["found"], kept["lost"]
    else:
        estimator = estimator_of(trajectory)
        found, lost = np.stack(estimator.frames(frames.tolist())), np.array(estimator.lost, np.int64)
        if path is not None:
            with written_whole(path) as part, open(part, "wb") as handle:
                np.savez(handle, found=found, lost=lost)
    displacement, answer = trajectory.displacement[frames].copy(), np.zeros_like(trajectory.displacement[frames])
    displacement[:, body], answer[:, body] = found
    return Estimate(frames, displacement, answer, tuple(lost.tolist()))


def estimator_of(trajectory: Trajectory, *, rough: bool = False) -> Estimator:
    if not trajectory.scene:
        raise InputError('the trajectory holds no scene, which estimate = true needs: train with estimate = false')
    scene, body = Scene.from_toml(trajectory.scene), trajectory.body
    moved = trajectory.displacement[:, ~body].astype(np.float64).mean(axis=1) if not body.all() else np.zeros((1, 3))  # (T, 3)
    start = np.array(scene.obstacles[0].path[0]) if scene.obstacles else np.zeros(3)
    return Estimator(scene, trajectory.mesh, trajectory.node_kind[body] == HANDLE, start + moved, rough=rough)


def _key(trajectory: Trajectory, frames: NDArray[np.int64]) -> str:
    """What an estimate depends on, as a short text."""
    digest = hashlib.sha256(f"{VERSION} {trajectory.scene}".encode())
    given = trajectory.displacement[:, ~trajectory.body]
    for array in (trajectory.points, trajectory.connectivity, trajectory.node_kind, given, frames):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]
