"""Rollouts and single steps of a network that says something simple, against the same in a few lines of numpy."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from datagen.files.trajectory import OBSTACLE
from learning.config import TrainConfig
from learning.networks.m4gn import M4GNConfig
from learning.prediction import rollout as module
from learning.prediction.checkpoint import Model
from learning.prediction.rollout import predict_step, rollout, rollout_error, walk
from learning.samples.estimate import Estimate
from learning.samples.samples import Normaliser, build_example
from tests.synthetic import bending

BASE = TrainConfig(segments=3, method="metis", network=M4GNConfig(hidden=4, heads=2), contact_radius=0.006, noise=0.0)
CONFIGS = {"step": BASE, "history": replace(BASE, history=1), "step+estimate": replace(BASE, estimate=True),
           "pose": replace(BASE, scheme="pose"), "pose+estimate": replace(BASE, scheme="pose", estimate=True)}
SCALE = 0.5  # of the output
SHIFT = np.array([1e-4, -2e-4, 3e-4])
# float32 features and outputs of at most 2e-2 m, ten steps of them
CLOSE: dict[str, Any] = dict(rtol=0, atol=5e-8)


class Said:
    """Says 0.3 of what is known of a free node's velocity, -0.2 of its displacement, a tenth of the obstacle's, and a shift.

    In node features: kind in 0 .. 2, velocity in 3 .. 5, rest place in 6 .. 8, displacement in 9 .. 11."""

    def __init__(self, nodes):
        self.nodes, self.sizes = nodes, []

    def __call__(self, graph):
        node = graph.node.reshape(-1, self.nodes, 12)
        self.sizes.append(len(node))
        rigid = node[0, :, 1] > 0
        obstacle = node[:, rigid, 9:12].mean(dim=1, keepdim=True)
        said = 0.3 * node[:, :, 3:6] - 0.2 * node[:, :, 9:12] + 0.1 * obstacle + torch.from_numpy(SHIFT).float()
        return said.reshape(-1, 3)


@pytest.fixture(scope="module")
def trajectory():
    found = bending(cells=(4, 2, 2))
    moved = found.displacement.copy()
    moved[:, found.node_kind == OBSTACLE] += (np.arange(11.0)[:, None, None] ** 2 * [1e-5, 2e-5, 0]).astype(np.float32)
    held = found.body & ~found.free
    moved[:, held] += (np.arange(11.0)[:, None, None] * [1e-5, -2e-5, 3e-5]).astype(np.float32)  # a support that moves
    return replace(found, displacement=moved)


def model_of(name, trajectory):
    flat = {part: torch.stack([torch.zeros(count), torch.ones(count)]) for part, count in
            (("node", 12), ("mesh_edge", 8), ("contact_edge", 4))}
    return Model(CONFIGS[name], Said(len(trajectory.points)), Normaliser(**flat, velocity=torch.tensor([SCALE])), "made up")


def guessed(trajectory, frames, **options):
    """A smooth estimate and answer of every frame, that no truth is needed for."""
    place = trajectory.points / 0.1
    t = np.asarray(frames)[:, None, None] / 10
    return Estimate(np.asarray(frames), (1e-2 * t * np.sin(place + t)).astype(np.float32),
                    (1e-3 * (1 + t) * np.cos(2 * place - t)).astype(np.float32))


@pytest.fixture(autouse=True)
def estimates(monkeypatch):
    monkeypatch.setattr("learning.samples.samples.estimate", guessed)
    monkeypatch.setattr(module, "estimate", guessed)


def said_of(now, known, obstacle):
    return SCALE * (0.3 * known - 0.2 * now + 0.1 * obstacle + SHIFT)


def by_hand(name, truth, free, rigid, base, answer, *, target, now, before):
    """Displacement of the free nodes at one frame, by the table in learning/samples/samples.py."""
    obstacle = truth[target, rigid].mean(axis=0) if name.startswith("pose") else now[rigid].mean(axis=0)
    now, before = now[free], before[free]
    unit = np.sqrt((answer[target, free] ** 2).sum(axis=1).mean())
    zero = np.zeros_like(now)
    if name == "step":
        return now + said_of(now, zero, obstacle)
    if name == "history":
        return now + (now - before) + said_of(now, now - before, obstacle)
    if name == "step+estimate":
        return base[target, free] + unit * said_of(now, base[target, free] - now, obstacle)
    if name == "pose":
        return said_of(zero, zero, obstacle)
    return base[target, free] + unit * said_of(base[target, free], answer[target, free] / unit, obstacle)


def parts(trajectory):
    found = guessed(trajectory, np.arange(11))
    return (trajectory.displacement.astype(float), trajectory.free, trajectory.node_kind == OBSTACLE, found.displacement.astype(float),
            found.answer.astype(float))


def path_by_hand(name, trajectory, start=0.0, correct=None):
    truth, free, rigid, base, answer = parts(trajectory)
    path = truth.copy()
    path[0, free] = start
    for t in range(1, 11):
        path[t, free] = by_hand(name, truth, free, rigid, base, answer, target=t, now=path[t - 1], before=path[max(t - 2, 0)])
        if correct is not None:
            path[t, trajectory.body] = correct(path[t, trajectory.body], t)
    path[0, free] = 0.0 if name.startswith("pose") else start
    return path


@pytest.mark.parametrize("name", CONFIGS)
def test_a_rollout_by_hand(name, trajectory):
    model = model_of(name, trajectory)
    wild = trajectory.displacement.copy()
    wild[:, trajectory.free] = 7.0  # the truth of free nodes is never looked at, at rest neither
    found = rollout(model, replace(trajectory, displacement=wild))
    expected = path_by_hand(name, trajectory)
    np.testing.assert_allclose(found.displacement, expected, **CLOSE)
    assert np.abs(expected[:, trajectory.free]).max() > 5e-4
    assert found.displacement.dtype == np.float32 and found.segment.dtype == np.int32
    assert found.per_frame == {} and set(found.extra) == {"run", "seconds_per_step"} and found.extra["run"] == "made up"
    # poses are eight at a time, two are left; steps one after the other
    assert model.network.sizes == ([8, 2] if name.startswith("pose") else [1] * 10)


@pytest.mark.parametrize("name", ["step", "history", "pose+estimate"])
def test_a_corrector_has_the_body_after_each_step_and_the_next_starts_from_there(name, trajectory):
    told = []

    def correct(u, frame):
        assert u.shape == (int(trajectory.body.sum()), 3)
        told.append(frame)
        return 0.9 * u + 1e-4 * frame

    found = rollout(model_of(name, trajectory), trajectory, correct=correct)
    assert told == list(range(1, 11))
    np.testing.assert_allclose(found.displacement, path_by_hand(name, trajectory, correct=lambda u, t: 0.9 * u + 1e-4 * t), **CLOSE)


@pytest.mark.parametrize("name", ["step", "history", "pose"])
def test_a_walk_may_start_elsewhere_than_at_rest(name, trajectory):
    start = 1e-3 * np.random.default_rng(0).normal(size=trajectory.points.shape)
    case = build_example(trajectory, CONFIGS[name])
    free = trajectory.free
    found = walk(model_of(name, trajectory), case, start=start)
    np.testing.assert_allclose(found[1:], path_by_hand(name, trajectory, start[free])[1:], **CLOSE)


def test_a_walk_of_poses_gives_its_targets_alone(trajectory):
    case = build_example(trajectory, CONFIGS["pose+estimate"], targets=np.array([2, 7, 10]))
    found = walk(model_of("pose+estimate", trajectory), case)
    np.testing.assert_allclose(found[[2, 7, 10]], path_by_hand("pose+estimate", trajectory)[[2, 7, 10]], **CLOSE)
    others = [0, 1, 3, 4, 5, 6, 8, 9]
    np.testing.assert_array_equal(found[others], trajectory.displacement[others])


@pytest.mark.parametrize("name", CONFIGS)
@pytest.mark.parametrize("batch", [3, 8])
def test_single_steps_by_hand(name, batch, trajectory):
    truth, free, rigid, base, answer = parts(trajectory)
    model, expected = model_of(name, trajectory), truth[1:].copy()
    poses = path_by_hand(name, trajectory)
    for t in range(1, 11):
        if name.startswith("pose"):
            expected[t - 1, free] = truth[t - 1, free] + poses[t, free] - poses[t - 1, free]
        else:
            expected[t - 1, free] = by_hand(name, truth, free, rigid, base, answer, target=t, now=truth[t - 1], before=truth[max(t - 2, 0)])
    found = predict_step(model, trajectory, batch_size=batch)
    np.testing.assert_allclose(found, expected, **CLOSE)
    if not name.startswith("pose"):
        assert model.network.sizes == {3: [3, 3, 3, 1], 8: [8, 2]}[batch]
        default = model_of(name, trajectory)
        np.testing.assert_array_equal(predict_step(default, trajectory), predict_step(model, trajectory, batch_size=8))
        assert default.network.sizes == [8, 2]


def test_the_error_is_the_root_mean_square_length_over_free_nodes_and_targets(trajectory, monkeypatch):
    case, seen = build_example(trajectory, CONFIGS["pose"], targets=np.array([3, 7])), []
    off = np.zeros_like(trajectory.displacement)
    off[:, trajectory.free] = np.array([2.0, -3, 6])  # of length 7
    off[7, trajectory.free] = np.array([0.0, 0, 1])
    off[7, ~trajectory.free] = off[[1, 5]] = 100.0  # held nodes and other frames do not count

    def walked(model, case):
        seen.append(case.trajectory.displacement)
        return trajectory.displacement + off

    monkeypatch.setattr(module, "walk", walked)
    # over two frames of 7^2 and 1^2: the root of 25; displacements near 1e-2 in float32 beside 7: 5e-7
    assert rollout_error(model_of("pose", trajectory), case) == pytest.approx(5.0, rel=1e-6)
    assert not seen[0][:, trajectory.free].any()  # and the truth is not shown
    np.testing.assert_array_equal(seen[0][:, ~trajectory.free], trajectory.displacement[:, ~trajectory.free])


def test_the_error_of_a_whole_walk(trajectory):
    case = build_example(trajectory, BASE)
    off = (path_by_hand("step", trajectory) - trajectory.displacement)[1:, trajectory.free]
    expected = np.sqrt((off**2).sum(axis=2).mean())
    assert rollout_error(model_of("step", trajectory), case) == pytest.approx(expected, rel=1e-5)


def test_a_position_that_is_not_finite_stops_with_its_step(trajectory):
    for name in ("step", "pose"):
        with pytest.raises(FloatingPointError, match="not finite at step 4 of 10: "):
            rollout(model_of(name, trajectory), trajectory, correct=lambda u, frame: u * (np.inf if frame == 4 else 0.5) + 1)
    model = model_of("step", trajectory)
    broken = replace(model, network=lambda graph: torch.where(torch.arange(len(graph.node))[:, None] == 40, torch.nan, 0.0).expand(-1, 3))
    assert trajectory.free[40]
    with pytest.raises(FloatingPointError, match="step 1 of 10"):
        rollout(broken, trajectory)


def test_a_step_takes_the_wall_time_of_estimates_and_walk_but_not_of_the_set_up(trajectory, monkeypatch):
    now = [50.0]

    def later(seconds, work):
        def do(*given, **options):
            now[0] += seconds
            return work(*given, **options)
        return do

    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    monkeypatch.setattr(module, "build_example", later(1000, module.build_example))
    monkeypatch.setattr(module, "estimate", later(5, module.estimate))
    monkeypatch.setattr(module, "walk", later(15, module.walk))
    assert rollout(model_of("pose+estimate", trajectory), trajectory).extra["seconds_per_step"] == pytest.approx(2.0)
    assert rollout(model_of("pose", trajectory), trajectory).extra["seconds_per_step"] == pytest.approx(1.5)
