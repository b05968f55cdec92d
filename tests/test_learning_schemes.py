"""Ways to predict: what each may see, what each is told, and that a pose needs no other frame."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from datagen.files.trajectory import write_trajectory
from learning.config import TrainConfig
from learning.networks.m4gn import M4GN, M4GNConfig
from learning.prediction.checkpoint import Model, load_model, read_checkpoint, write_checkpoint
from learning.prediction.rollout import predict_step, rollout, walk
from learning.samples.samples import build_example, describe, fit_normaliser, sample
from learning.training.train import train
from physics.schema import InputError, read_table
from tests.pressed import pressed

BASE = TrainConfig(segments=5, network=M4GNConfig(hidden=16, message_steps=2, transformer_layers=1, heads=4), contact_radius=0.006,
                   batch_size=2, steps=4, validate_every=4, frames=4)
CONFIGS = {"step": BASE, "history": replace(BASE, history=1), "step+estimate": replace(BASE, estimate=True),
           "pose": replace(BASE, scheme="pose"), "pose+estimate": replace(BASE, scheme="pose", estimate=True)}


@pytest.fixture(scope="module")
def trajectory():
    return pressed()


def model_of(config, trajectory):
    torch.manual_seed(0)
    case = build_example(trajectory, config)
    return Model(config, M4GN(config.network).eval(), fit_normaliser([case], config), "untrained")


@pytest.fixture(scope="module", params=CONFIGS)
def model(request, trajectory):
    return model_of(CONFIGS[request.param], trajectory)


def test_the_future_of_free_nodes_does_not_leak(model, trajectory):
    altered = trajectory.displacement.copy()
    altered[1:, trajectory.free] = np.random.default_rng(0).normal(size=altered[1:, trajectory.free].shape)
    blind = rollout(model, replace(trajectory, displacement=altered))
    assert np.array_equal(rollout(model, trajectory).displacement, blind.displacement)


def test_one_step_from_a_frame_sees_no_later_frame(model, trajectory):
    altered = trajectory.displacement.copy()
    altered[5:, trajectory.free] += 1.0
    before, after = predict_step(model, trajectory), predict_step(model, replace(trajectory, displacement=altered))
    # from frames 0 to 4; batches with other contact edges sum in another order
    assert np.allclose(before[:5], after[:5], rtol=0, atol=1e-8)
    assert not np.array_equal(before[5:], after[5:])


def test_a_rollout_is_what_single_steps_from_rest_lead_to(model, trajectory):
    path = rollout(model, trajectory)
    # a rollout's own frames taken for the truth: each step from one of them is the next; float32 displacements of 1e-2 m,
    # and other orders of float32 sums in batches
    assert np.allclose(predict_step(model, path), path.displacement[1:], rtol=0, atol=2e-8)


@pytest.mark.parametrize("name", CONFIGS)
def test_the_truth_is_said_by_the_target(name, trajectory):
    config = replace(CONFIGS[name], noise=0.0)
    case = build_example(trajectory, config)
    _, target = sample(case, 5, config, torch.Generator())
    shown = describe(case, 6, trajectory.displacement[5], trajectory.displacement[4], config)
    # targets are float32, of the order of one unit
    assert np.allclose(shown.base + shown.unit * target.numpy(), trajectory.displacement[6], rtol=0, atol=1e-6 * max(shown.unit, 1e-3))


def test_a_pose_alone_is_that_of_the_whole_path(trajectory):
    config = CONFIGS["pose"]
    model = model_of(config, trajectory)
    whole = walk(model, build_example(trajectory, config))
    alone = walk(model, build_example(trajectory, config, targets=np.array([7])))
    assert np.allclose(alone[7], whole[7], rtol=0, atol=1e-7)  # float32 sums in other orders; the untrained network says metres


def test_a_pose_is_trained_on_few_frames_of_a_path(trajectory):
    config = replace(BASE, scheme="pose", frames=3)
    case = build_example(trajectory, config, targets=np.array([3, 7, 10]))
    with pytest.raises(KeyError, match="no estimate of frame 4"):
        build_example(trajectory, replace(config, estimate=True), targets=case.targets).estimate.at(4)


def test_a_pose_has_no_history():
    for config in ({"scheme": "pose"}, {"estimate": True}):
        with pytest.raises(InputError, match="history = 1"):
            read_table(TrainConfig, {"history": 1, **config})


def test_a_run_of_before_can_be_resumed(trajectory, tmp_path):
    write_trajectory(tmp_path / "a.vtkhdf", trajectory)
    config, run = replace(BASE, frames=None), tmp_path / "run"
    train(config, [tmp_path / "a.vtkhdf"], [], run, steps=2)
    state = read_checkpoint(run / "last.safetensors")
    for key in ("scheme", "history", "estimate"):
        del state.about["config"][key]
    write_checkpoint(run / "last.safetensors", state)
    assert train(config, [tmp_path / "a.vtkhdf"], [], run, resume=True)["steps"] == 4
    with pytest.raises(InputError, match="another scheme"):
        train(replace(config, scheme="pose"), [tmp_path / "a.vtkhdf"], [], run, resume=True)


def test_training_begins_with_the_estimate(trajectory, tmp_path):
    config = replace(CONFIGS["pose+estimate"], learning_rate=1e-30, final_learning_rate=1e-30)
    write_trajectory(tmp_path / "a.vtkhdf", trajectory)
    train(config, [tmp_path / "a.vtkhdf"], [], tmp_path / "run")
    case = build_example(trajectory, config)
    free = trajectory.free
    assert np.array_equal(rollout(load_model(tmp_path / "run"), trajectory).displacement[1:, free], case.estimate.displacement[:, free])
