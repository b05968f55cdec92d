"""Several frames told at once, of a flow and of a body that an obstacle moves: laid out by hand on five nodes."""

import dataclasses

import numpy as np
import pytest
import torch

from datagen.files.trajectory import write_trajectory
from learning.config import Outputs, TrainConfig
from learning.graphs.layout import layout_of
from learning.networks.rivals.gcn import GCNConfig
from learning.prediction.checkpoint import Model
from learning.prediction.rollout import predict_step, rollout
from learning.samples.samples import all_frames, build_example, fit_normaliser, load_examples, sample
from learning.samples.scales import INPUTS, Normaliser
from physics.schema import InputError
from tests.five_nodes import UNIT, square_flow, tiny

FREE = [2, 4]
CONFIG = TrainConfig(bundle=3, noise=0.0, outputs=Outputs(fields=("pressure",)), network=GCNConfig(hidden=4, layers=1))


class Told(torch.nn.Module):
    """Tells (j + 1, 2 j + 2) more in the j-th of three frames, and the pressures 10, 20, 30, whatever it is shown."""

    def forward(self, graph):
        return torch.tensor([[1.0, 2, 2, 4, 3, 6, 10, 20, 30]]).repeat(len(graph.node), 1)


def model(trajectory, config=CONFIG):
    layout = layout_of([trajectory], config.outputs.fields, bundle=config.bundle)
    one = {name: torch.tensor([[0.0], [1.0]]) for name in INPUTS}
    scales = Normaliser(**one, velocity=torch.ones(1), fields=torch.tensor([[0.0] * 3, [1.0] * 3]), layout=layout)
    return Model(config, Told(), scales, "told")


def test_a_target_is_the_change_to_each_of_the_frames_and_then_their_pressures():
    example = build_example(square_flow(), CONFIG)
    graph, target = sample(example, 2, CONFIG, torch.Generator())
    assert example.layout.widths.outputs == target.shape[1] == 9 and example.asked.shape == (5, 9)
    # node 4 from frame 2 to 3, 4 and 5: (9 - 4, 4), (16 - 4, 8), (25 - 4, 12) sixteenths; pressures 3.5, 4.5, 5.5
    np.testing.assert_array_equal(target[4], [5 / 16, 4 / 16, 12 / 16, 8 / 16, 21 / 16, 12 / 16, 3.5, 4.5, 5.5])
    np.testing.assert_array_equal(graph.node[4, -2:], [4 / 16, 8 / 16])
    assert example.asked[FREE].all() and not example.asked[[0, 1, 3], :6].any() and example.asked[:, 6:].all()


def test_one_scale_holds_for_all_frames_told_at_once():
    example = build_example(square_flow(), CONFIG, targets=np.array([2, 6]))
    changes = [[((f + j) ** 2 - f**2, n * j) for f in (1, 5) for j in (1, 2, 3)] for n in FREE]
    found = fit_normaliser([example], CONFIG)
    assert found.velocity.shape == (1,) and found.fields.shape == (2, 3)
    assert float(found.velocity) == pytest.approx(np.sqrt(np.mean(np.square(changes))) / 16, rel=1e-6)
    np.testing.assert_allclose(found.fields[0], [4 + 0.25, 5.25, 6.25], rtol=1e-6)  # frames 2 and 6, 3 and 7, 4 and 8


def test_frames_are_learned_from_that_have_all_frames_after_them(tmp_path):
    write_trajectory(tmp_path / "0000.vtkhdf", square_flow())
    frames = all_frames(load_examples([tmp_path / "0000.vtkhdf"], CONFIG))
    assert frames[:, 1].tolist() == [1, 2, 3, 4, 5]  # from 5 on to 6, 7 and 8, the last
    walked = load_examples([tmp_path / "0000.vtkhdf"], CONFIG, walk=True)
    assert walked[0].targets.tolist() == [2, 3, 4, 5, 6, 7, 8]
    with pytest.raises(InputError, match="bundle = 9: more frames than there are to predict"):
        load_examples([tmp_path / "0000.vtkhdf"], TrainConfig(bundle=9, network=GCNConfig()))


def test_a_rollout_goes_on_from_the_last_of_the_frames_told_at_once():
    """From frame 1 on frames 2, 3 and 4 are 1, 2 and 3 changes on, 5 again one more than 4; the last bundle is cut off at the end."""
    truth = square_flow()
    found = rollout(model(truth), truth)
    for frame in range(2, 9):
        np.testing.assert_array_equal(found.fields["velocity"][frame, 4, :2], [1 / 16 + frame - 1, 4 / 16 + 2 * (frame - 1)])
    np.testing.assert_array_equal(found.fields["pressure"][2:, 4, 0], [10, 20, 30, 10, 20, 30, 10])
    np.testing.assert_array_equal(found.fields["velocity"][:, [0, 1, 3]], truth.fields["velocity"][:, [0, 1, 3]])


def test_a_single_step_is_the_first_of_the_frames_told_at_once():
    truth = square_flow()
    np.testing.assert_array_equal(predict_step(model(truth), truth)[3, 4, :2], truth.fields["velocity"][3, 4, :2] + [1, 2])


BODY = TrainConfig(bundle=2, noise=0.0, segments=1, contact_radius=1e-6, network=GCNConfig(hidden=4, layers=1))


def pressed():
    """Five frames of a body.

    In frame t the free nodes n = 1, 2 and 4 lie (t^2, 0, n t) from rest, the obstacle (0, 3 t, 0), node 3 (0, 0, t), in units of 2^-10 m.
    """
    t, n = np.meshgrid(np.arange(5), np.arange(8), indexing="ij")
    u = np.zeros((5, 8, 3), np.float32)
    for node in (1, 2, 4):
        u[:, node] = np.stack([t**2, 0 * t, n * t], axis=2)[:, node]
    u[:, 5:, 1], u[:, 3, 2] = 3 * t[:, 5:], t[:, 3]
    return tiny(displacement=u * np.float32(UNIT), per_frame={})


class ToldOfBody(torch.nn.Module):
    """Tells (1, 2, 3) and (10, 20, 30) units more in the next two frames, and keeps what it is shown."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def forward(self, graph):
        self.seen.append(graph.node.clone())
        return torch.tensor([[1.0, 2, 3, 10, 20, 30]]).repeat(len(graph.node), 1) * UNIT


def model_of_body(trajectory):
    layout = layout_of([trajectory], bundle=2)
    one = {name: torch.tensor([[0.0], [1.0]]) for name in INPUTS}
    return Model(BODY, ToldOfBody(), Normaliser(**one, velocity=torch.ones(1), layout=layout), "told")


def test_a_body_is_shown_the_way_of_what_moves_it_to_each_of_the_frames():
    """Features of a node: three of its kind, the ways to both frames, its place, its displacement."""
    example = build_example(pressed(), BODY)
    graph, target = sample(example, 1, BODY, torch.Generator())
    assert example.layout.widths.node == graph.node.shape[1] == 3 + 6 + 3 + 3 and target.shape == (8, 6)
    ways = graph.node[:, 3:9].numpy() / UNIT
    np.testing.assert_array_equal(ways[[0, 3, 5]], [[0] * 6, [0, 0, 1, 0, 0, 2], [0, 3, 0, 0, 6, 0]])
    assert not ways[[1, 2, 4]].any()  # of free nodes nothing is told
    # node 4 from frame 1 on to 2 and 3: (4 - 1, 0, 4), (9 - 1, 0, 8)
    np.testing.assert_array_equal(target[4].numpy() / UNIT, [3, 0, 4, 8, 0, 8])


def test_a_body_s_rollout_takes_two_frames_a_step_and_what_moves_it_rests_beyond_the_last():
    truth = pressed()
    truth = dataclasses.replace(truth, displacement=truth.displacement[:4])  # frame 4 would be the second of the last two
    told = model_of_body(truth)
    found = rollout(told, truth).displacement / np.float32(UNIT)
    np.testing.assert_array_equal(found[:, 4], [[0, 0, 0], [1, 2, 3], [10, 20, 30], [11, 22, 33]])
    np.testing.assert_array_equal(found[:, [0, 3, 5]], truth.displacement[:, [0, 3, 5]] / np.float32(UNIT))
    first, last = (seen[5, 3:9].numpy() / UNIT for seen in told.network.seen)
    np.testing.assert_array_equal(first, [0, 3, 0, 0, 6, 0])
    np.testing.assert_array_equal(last, [0, 3, 0, 0, 3, 0])


def test_a_correction_is_asked_for_at_every_frame_and_the_next_two_go_on_from_it():
    truth, asked = pressed(), []

    def correct(u, frame):
        asked.append(frame)
        return u + UNIT * 100 * (frame == 2)

    found = rollout(model_of_body(truth), truth, correct=correct).displacement / np.float32(UNIT)
    assert asked == [1, 2, 3, 4]
    np.testing.assert_array_equal(found[1:, 4], [[1, 2, 3], [110, 120, 130], [111, 122, 133], [120, 140, 160]])


def test_several_frames_at_once_go_with_steps_alone():
    for other in ({"scheme": "pose"}, {"history": 1}, {"estimate": True}):
        with pytest.raises(InputError, match="bundle: goes with"):
            TrainConfig(bundle=2, network=GCNConfig(), **other)
