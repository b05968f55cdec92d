"""Trajectories walked by the network's own predictions while it learns, by hand: a network that tells the same change, on five nodes."""

import numpy as np
import pytest
import torch

from datagen.files.trajectory import write_trajectory
from learning.config import TrainConfig
from learning.networks.rivals.gcn import GCNConfig
from learning.prediction.checkpoint import load_model
from learning.samples.batches import Batches
from learning.samples.samples import build_example
from learning.training.train import train
from learning.training.walks import Walks
from physics.schema import InputError
from tests.five_nodes import square_flow, tiny
from tests.test_learning_bundle import CONFIG, FREE, model

GIVEN = [0, 1, 3]


def walks(pushed, targets, flows=1):
    """Of flows in which node n has (f^2, n f) / 16 [m/s] at frame f, walked by a network that tells (3, 6) more in three frames."""
    config = TrainConfig(bundle=3, pushed=pushed, noise=0.0, batch_size=1, outputs=CONFIG.outputs, network=CONFIG.network)
    truth = square_flow()
    examples = [build_example(truth, config, targets=np.array(targets)) for _ in range(flows)]
    return config, Walks(model(truth, config), examples)


def never():
    """A generator whose first numbers begin no walk anew."""
    generator = torch.Generator().manual_seed(0)
    assert (torch.rand(5, generator=generator) * 101 >= 1).all()
    return generator.manual_seed(0)


def test_a_walk_begins_at_the_true_frame_and_goes_on_by_what_the_network_tells():
    _, told = walks(100, [2, 3, 4, 5, 6])
    true, generator = told.examples[0].states, never()
    told.motion = [9.0] * len(told.motion)  # so much that three and six more are not astray
    frame, shown = told.next(0, 1, generator)
    assert frame == 1 and np.array_equal(shown, true[1])
    frame, shown = told.next(0, 2, generator)  # the frame that is drawn plays no part
    assert frame == 4
    np.testing.assert_allclose(shown[FREE], true[1, FREE] + [3, 6], rtol=1e-6)
    np.testing.assert_array_equal(shown[GIVEN], true[4, GIVEN])
    frame, shown = told.next(0, 2, generator)  # at 7 the flow is over: there are no three frames more
    assert frame == 2 and np.array_equal(shown, true[2])


def test_a_walk_that_is_farther_astray_than_the_trajectory_moves_begins_anew():
    """After one prediction it is (3 - 15, 6 - 3 n) / 16 off at nodes n = 2 and 4."""
    _, told = walks(100, [2, 3, 4, 5, 6])
    error = np.sqrt(np.mean([(3 - 15 / 16) ** 2, (6 - 6 / 16) ** 2, (3 - 15 / 16) ** 2, (6 - 12 / 16) ** 2]))
    squares = [f**4 / 256 for f in range(9)] * 2 + [(n * f) ** 2 / 256 for f in range(9) for n in FREE]
    assert told.motion == [pytest.approx(np.sqrt(np.mean(squares)), rel=1e-6)]
    for motion, at in ((0.999 * error, -1), (1.001 * error, 4)):
        told.frame[:], told.motion = -1, [motion]
        assert told.next(0, 1, never())[0] == 1 and told.frame.tolist() == [at]
    told.frame[:], told.state[0] = 1, np.full((5, 2), np.nan, np.float32)
    told.next(0, 3, never())
    assert told.frame.tolist() == [-1]


def test_as_many_predictions_lie_behind_a_frame_in_the_mean_as_are_asked_for():
    """Walks of equal chance to end at each step: four predictions in the mean, none behind every fifth frame."""
    _, told = walks(4, range(2, 7))
    told.frame[:] = 1
    generator, anew = torch.Generator().manual_seed(0), 0
    for _ in range(1000):
        told.frame[0], told.state[0] = 1, np.full((5, 2), np.float32(7))
        anew += told.next(0, 2, generator)[0] == 2
    assert abs(anew - 200) < 40  # three deviations


def test_flows_are_walked_each_by_itself_and_kept_as_they_are():
    _, told = walks(100, [2, 3, 4, 5, 6], flows=3)
    told.motion = [9.0] * len(told.motion)
    told.next(1, 1, never())
    assert told.frame.tolist() == [-1, 4, -1]
    again = Walks(told.model, told.examples, told.tensors())
    assert again.frame.tolist() == [-1, 4, -1] and np.array_equal(again.state[1], told.state[1])
    assert again.next(1, 1, never())[0] == 4


def test_a_batch_shows_walked_frames_and_asks_for_the_true_ones_after_them():
    config, told = walks(100, [2, 3, 4, 5, 6])
    told.motion = [9.0] * len(told.motion)
    true = told.examples[0].states
    batches = Batches(told.examples, config, told)
    batches.frames = batches.frames[:1]  # the walk begins at frame 1
    shown, targets = [], []
    for number in range(2):  # whose dice begin no walk anew
        batch = batches[number]
        shown.append(batch.graph.node[4, -2:].numpy())
        targets.append(batch.target[4, :2].numpy())
    np.testing.assert_allclose(shown, [true[1, 4], true[1, 4] + [3, 6]], rtol=1e-6)
    np.testing.assert_allclose(targets, [true[2, 4] - true[1, 4], true[5, 4] - true[1, 4] - [3, 6]], rtol=1e-6)


def test_a_training_on_walked_flows_stopped_and_gone_on_with_comes_to_the_same_weights(tmp_path):
    write_trajectory(tmp_path / "0000.vtkhdf", square_flow())
    config = TrainConfig(bundle=2, pushed=9, noise=0.01, batch_size=2, steps=6, validate_every=3, network=CONFIG.network)
    file = [tmp_path / "0000.vtkhdf"]
    train(config, file, file, tmp_path / "whole")
    train(config, file, file, tmp_path / "cut", steps=3)
    train(config, file, file, tmp_path / "cut", resume=True)
    whole, cut = (load_model(tmp_path / name) for name in ("whole", "cut"))
    assert all(torch.equal(a, b) for a, b in zip(whole.network.parameters(), cut.network.parameters(), strict=True))
    assert whole.normaliser.layout.bundle == 2


def test_bodies_are_walked_too_and_what_has_no_single_past_frame_is_not(tmp_path):
    write_trajectory(tmp_path / "0000.vtkhdf", tiny())
    file = [tmp_path / "0000.vtkhdf"]
    result = train(TrainConfig(pushed=3, batch_size=2, steps=4, segments=1, network=CONFIG.network), file, file, tmp_path / "run")
    assert result["steps"] == 4 and np.isfinite(result["loss"])
    for other in ({"scheme": "pose"}, {"history": 1}, {"estimate": True}):
        with pytest.raises(InputError, match="pushed: goes with"):
            TrainConfig(pushed=2, network=GCNConfig(), **other)
