"""Prediction with a trained network: over a whole path from the rest state, or one step from each true frame.

    x(0) = X,    x_i(t+1) = x_i(t) + v_i(t) on free nodes,    v(t) = network(graph of x(t), v of prescribed nodes)

Obstacle nodes follow their motion in the trajectory file, and so do the nodes that a support holds. Of free nodes a
rollout never sees more than their rest positions: the true motion is reduced to that of prescribed nodes before anything
else happens.

Legend: N nodes, T frames.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from datagen.trajectory import Trajectory
from learning.checkpoint import Model
from learning.data import Case, build_case
from learning.graph import build_graph, join

# Takes displacements (N, 3) of the body [m] and the number of their frame, and gives better ones.
Corrector = Callable[[NDArray[np.float64], int], NDArray[np.float64]]


def rollout(model: Model, trajectory: Trajectory, *, correct: Corrector | None = None) -> Trajectory:
    """The predicted trajectory, from the rest state to the last frame.

    Args:
        trajectory: geometry, node kinds, modes, and the motion of prescribed nodes; the motion of free nodes is not used
        correct: corrects each predicted frame, from which the next one is then predicted

    Returns:
        the same trajectory with the predicted displacement, its segments, without what only a solver knows, and with
        extra = {"run", "seconds_per_step"}

    Raises:
        FloatingPointError: a position that is not finite, with the step
        InputError: a mesh that cannot be segmented
    """
    given = np.where(trajectory.free[:, None], np.float32(0), trajectory.displacement)  # (T, N, 3)
    case = build_case(replace(trajectory, displacement=given), model.config)
    start = time.perf_counter()
    displacement = _walk(model, case, correct)
    seconds = (time.perf_counter() - start) / (len(given) - 1) if len(given) > 1 else 0.0
    return replace(case.trajectory, displacement=displacement, per_frame={}, segment=case.skeleton.segment.astype(np.int32),
                   extra={"run": model.name, "seconds_per_step": seconds})


def _walk(model: Model, case: Case, correct: Corrector | None = None) -> NDArray[np.float32]:
    """(T, N, 3) displacement, free nodes predicted, the others as given."""
    free, given = case.skeleton.free, case.trajectory.displacement
    predicted = given.copy()
    now = given[0].astype(np.float64)  # (N, 3)
    for step in range(len(given) - 1):
        velocity = given[step + 1] - now
        after = given[step + 1].astype(np.float64)
        after[free] = now[free] + _velocities(model, case, [now], [velocity])[0][free]
        if correct is not None:
            body = case.trajectory.body
            after[body] = correct(after[body], step + 1)
        if not np.isfinite(after).all():
            raise FloatingPointError(f"the rollout is not finite at step {step + 1} of {len(given) - 1}: the network has "
                                     f"left the states it was trained on; train longer, or with more noise")
        predicted[step + 1] = now = after
    return predicted


def predict_step(model: Model, trajectory: Trajectory, *, batch_size: int = 8) -> NDArray[np.float32]:
    """(T - 1, N, 3) displacement one step after each true frame 0 .. T - 2; prescribed nodes as given."""
    case = build_case(trajectory, model.config)
    true = trajectory.displacement
    predicted = true[1:].copy()
    for first in range(0, len(predicted), batch_size):
        steps = range(first, min(first + batch_size, len(predicted)))
        now = [true[step].astype(np.float64) for step in steps]
        moved = _velocities(model, case, now, [true[step + 1] - true[step] for step in steps])
        for step, before, velocity in zip(steps, now, moved, strict=True):
            predicted[step, trajectory.free] = (before + velocity)[trajectory.free]
    return predicted


def rollout_error(model: Model, case: Case) -> float:
    """Root mean square distance [m] of a rollout from the truth, over all free nodes and steps after the first frame."""
    free, true = case.skeleton.free, case.trajectory.displacement
    given = np.where(free[:, None], np.float32(0), true)
    predicted = _walk(model, Case(replace(case.trajectory, displacement=given), case.skeleton))
    return float(np.sqrt(((predicted - true)[1:, free].astype(np.float64) ** 2).sum(axis=-1).mean()))


def _velocities(model: Model, case: Case, displacements: list[NDArray[np.float64]],
                velocities: list[NDArray[np.floating]]) -> NDArray[np.float32]:
    """(frames, N, 3) predicted displacement [m] over one step from each of some frames."""
    skeleton = case.skeleton
    graph = join([build_graph(skeleton, skeleton.rest + u, v, model.config.contact_radius)
                  for u, v in zip(displacements, velocities, strict=True)])
    with torch.inference_mode():
        velocity = model.normaliser.velocity * model.network(model.normaliser.graph(graph))  # (frames N, 3)
        return velocity.numpy().reshape(len(displacements), -1, 3)
