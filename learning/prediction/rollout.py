"""Prediction with a trained network: over a whole path from the rest state, or one step from each true frame.

    scheme = "step"    u(0) = 0,    u(t+1) from the graph of u(t)                               (samples/samples.py)
    scheme = "pose"    u(t) = P(t), straight from the obstacle's pose, P(0) = 0;    one step: u(t+1) = u(t) + P(t+1) - P(t)

so that in both a rollout is what single steps from the rest state lead to. Obstacle nodes follow their motion in the
trajectory file, and so do the nodes that a support holds. Of free nodes a rollout never sees more than their rest positions:
the true motion is reduced to that of prescribed nodes before anything else happens.

Of a flow u is the velocity at nodes that stay, and a path starts from the first frame of the file in which it moves. A body in a plane
is predicted in two coordinates; its third displacement is 0. Further fields that the network tells (graphs/layout.py) are those of the
frame to come.

Legend: N nodes, T frames, D space dimensions, O = D + numbers of further fields.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import Trajectory
from learning.bodies.at_once import AtOnce, path_of, rolled_out
from learning.graphs.graph import join
from learning.graphs.layout import SOLID_BODY, Layout
from learning.prediction.checkpoint import Model
from learning.samples.estimate import estimate
from learning.samples.samples import Example, build_example, describe
from physics.fidelity.along import corrected_path

BATCH = 8  # poses, or single steps, at a time
# Takes displacements (N, 3) of the body [m] and the number of their frame, and gives better ones.
Correction = Callable[[NDArray[np.float64], int], NDArray[np.float64]]


def rollout(model: Model | AtOnce, trajectory: Trajectory, *, correct: Correction | None = None, share: float = 0.0) -> Trajectory:
    """The predicted trajectory, from the rest state to the last frame.

    Args:
        trajectory: geometry, node kinds, modes, and the motion of prescribed nodes; the motion of free nodes is not used
        correct: corrects each predicted frame, from which the next one is then predicted
        share: where all frames are predicted at once, of the way from a prediction that corrections leave; 0 corrects each frame
            (physics/fidelity/along.py)

    Returns:
        the same trajectory with the predicted displacement and fields, its segments, without what only a solver knows, and with
        extra = {"run", "seconds_per_step"}, and lost_poses where its estimate found no state at some; of a predictor of beams also
        error_bar (T,) [m] and unsure (T,) for each frame

    Raises:
        FloatingPointError: a position that is not finite, with the step
        InputError: a mesh that cannot be segmented, or for a predictor of beams a scene that is none
    """
    if isinstance(model, AtOnce):
        SOLID_BODY.check(trajectory)
        return _rolled_out_at_once(model, trajectory, correct, share)
    layout = model.normaliser.layout
    example = build_example(_blind(trajectory, layout), replace(model.config, estimate=False), layout=layout)
    start = time.perf_counter()  # segments are set up before, estimates are a part of predicting
    if model.config.estimate:
        example = replace(example, estimate=estimate(example.trajectory, example.targets))
    state, told = layout.split(walk(model, example, correct))
    seconds = (time.perf_counter() - start) / max(len(state) - 1, 1)
    segment = example.skeleton.segment.astype(np.int32) if model.config.network.wants.cut else None
    moved = {"fields": {"velocity": state, **told}} if layout.flow else {"displacement": state, "fields": told}
    extra = {"run": model.name, "seconds_per_step": seconds}
    extra |= {name: trajectory.extra[name] for name in ("step_seconds",) if name in trajectory.extra}
    extra |= {"lost_poses": len(example.estimate.lost)} if example.estimate and example.estimate.lost else {}
    return replace(example.trajectory, per_frame={}, segment=segment, extra=extra, **moved)


def _rolled_out_at_once(model: AtOnce, trajectory: Trajectory, correct: Correction | None, share: float) -> Trajectory:
    """All frames at once; as many as it takes are then corrected."""
    start, body = time.perf_counter(), trajectory.body
    path = path_of(model, trajectory)
    displacement = rolled_out(trajectory, path)
    if correct is not None:
        displacement[:, body] = corrected_path(correct, displacement[:, body].astype(np.float64), share)
    seconds = (time.perf_counter() - start) / max(len(displacement) - 1, 1)
    return replace(trajectory, displacement=displacement, remainder=None,
                   per_frame={"error_bar": path.bar, "unsure": path.unsure.astype(np.int64)},
                   extra={"run": model.name, "seconds_per_step": seconds, "unsure_frames": int(path.unsure.sum())})


def _blind(trajectory: Trajectory, layout: Layout = SOLID_BODY) -> Trajectory:
    """The trajectory without the state of its free nodes, of a flow but for the first frames, and without further fields. Raises
    `InputError` for one of another layout."""
    layout.check(trajectory)
    free = layout.free(trajectory)[:, None]
    if not layout.flow:
        return replace(trajectory, displacement=np.where(free, np.float32(0), trajectory.displacement), remainder=None, fields={})
    velocity = np.where(free, np.float32(0), trajectory.fields["velocity"])
    known = slice(layout.first(trajectory) + 1)
    velocity[known] = trajectory.fields["velocity"][known]
    return replace(trajectory, fields={"velocity": velocity})


def walk(model: Model, example: Example, correct: Correction | None = None, *,
         start: NDArray[np.floating] | float = 0.0) -> NDArray[np.float32]:
    """(T, N, O) the state, free nodes predicted, the others as given, then further fields, 0 in frame 0; with scheme = "pose" at rest
    and at the example's targets.

    start: (N, D) displacement [m] of free nodes at frame 0, of which a pose knows nothing; a flow starts as the file tells
    """
    free, given, length = example.skeleton.free[:, None], example.states, example.length
    body, space, bundle = example.trajectory.body, example.layout.space, example.layout.bundle
    predicted = np.zeros((*given.shape[:2], space + sum(example.layout.sizes)), np.float32)
    predicted[..., :space] = metres = example.layout.states(example.trajectory)
    at_once = BATCH if model.config.scheme == "pose" else 1
    before = now = np.where(free & (not example.layout.flow), start / length,
                            given[example.layout.first(example.trajectory)]).astype(np.float64)
    for first in range(0, len(example.targets), at_once * bundle):
        targets = example.targets[first:first + at_once * bundle:bundle].tolist()
        said = _predict(model, example, targets, [now] * len(targets), [before] * len(targets))
        frames = [frame for target in targets for frame in range(target, target + bundle)]
        for target, found in zip(frames[:len(given) - targets[0]], said.reshape(-1, *said.shape[2:]), strict=False):
            after = np.where(free, found[:, :space], given[target])
            if correct is not None:
                after[body] = correct(length * np.pad(after[body], ((0, 0), (0, 3 - space))), target)[:, :space] / length
            if not np.isfinite(after).all():
                raise FloatingPointError(f"the rollout is not finite at step {target} of {len(given) - 1}: the network has "
                                         f"left the states it was trained on; train longer, or with more noise")
            predicted[target] = np.concatenate([length * after, np.where(body[:, None], found[:, space:], 0)], axis=1)
            before, now = now, after
    if correct is None:  # what is given stays so to the last bit
        predicted[:, ~example.skeleton.free, :space] = metres[:, ~example.skeleton.free]
    return predicted


def predict_step(model: Model | AtOnce, trajectory: Trajectory, *, batch_size: int = BATCH) -> NDArray[np.float32]:
    """(T - 1, N, 3) displacement, or velocity of a flow, one step after each true frame 0 .. T - 2; prescribed nodes as given."""
    if not isinstance(model, AtOnce):
        layout = model.normaliser.layout
        if model.config.scheme == "step":
            return layout.split(_steps(model, build_example(trajectory, model.config, layout=layout), batch_size))[0]
        poses = layout.split(walk(model, build_example(_blind(trajectory, layout), model.config, layout=layout)))[0].astype(np.float64)
    else:
        poses = rolled_out(trajectory, path_of(model, trajectory)).astype(np.float64)
    true, free = trajectory.displacement, trajectory.free
    predicted = true[1:].copy()
    predicted[:, free] = true[:-1, free] + (poses[1:] - poses[:-1])[:, free]
    return predicted


def _steps(model: Model, example: Example, batch_size: int) -> NDArray[np.float32]:
    """(T - 1, N, O) the state one step after each true frame, with further fields."""
    true, free, space = example.states, example.skeleton.free, example.layout.space
    predicted = np.zeros((len(true) - 1, true.shape[1], space + sum(example.layout.sizes)), np.float32)
    for first in range(0, len(predicted), batch_size):
        steps = list(range(first, min(first + batch_size, len(predicted))))
        found = _predict(model, example, [step + 1 for step in steps], [true[step] for step in steps],
                         [true[max(step - 1, 0)] for step in steps])
        predicted[steps] = found[:, 0]
    predicted[..., :space] *= example.length
    predicted[..., :space][:, ~free] = example.layout.states(example.trajectory)[1:, ~free]
    return predicted


def rollout_error(model: Model, example: Example) -> float:
    """Root mean square distance [m], of a flow [m/s], of a rollout from the truth, over all free nodes and the example's targets."""
    predicted = walk(model, replace(example, trajectory=_blind(example.trajectory, example.layout)))
    error = (predicted[..., :example.layout.space] - example.layout.states(example.trajectory))[example.targets][:, example.skeleton.free]
    return float(np.sqrt((error.astype(np.float64) ** 2).sum(axis=-1).mean()))


def _predict(model: Model, example: Example, targets: list[int], now: list[NDArray[np.floating]],
             before: list[NDArray[np.floating]]) -> NDArray[np.float64]:
    """(frames, b, N, D + F) predicted states and further fields of some frames, each with those told with it, from
    the states one and two frames before each."""
    shown = [describe(example, target, u, v, model.config) for target, u, v in zip(targets, now, before, strict=True)]
    said = model.said(join([each.graph for each in shown]))
    outputs = said.cpu().numpy().reshape(len(targets), -1, said.shape[1])
    space = example.layout.space
    told = np.stack([example.layout.frames_of(output) for output in outputs])
    return np.stack([np.concatenate([each.base + each.unit * frames[..., :space], frames[..., space:]], axis=2)
                     for each, frames in zip(shown, told, strict=True)])


def went_on(model: Model, example: Example, frame: int, now: NDArray[np.floating]) -> NDArray[np.float32]:
    """(N, D) the last frame that is told at once from a state (N, D) at a frame, by scheme = "step"; what is given there as given."""
    said = _predict(model, example, [frame + 1], [now], [now])[0, -1]
    after = np.where(example.skeleton.free[:, None], said[:, :example.layout.space], example.states[frame + example.layout.bundle])
    return after.astype(np.float32)
