"""Several frames of a flow told at once: laid out by hand on five nodes."""

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
from tests.five_nodes import square_flow, tiny

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
    with pytest.raises(InputError, match="bundle = 2: is of flows"):
        layout_of([tiny()], bundle=2)


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
