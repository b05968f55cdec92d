"""A trained predictor of beams: what becomes of a feature and of an answer, what counts as seen, and how many paths make a batch."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from learning.bodies.at_once import is_at_once
from learning.networks.stored import state_of
from learning.slender.beam import see
from learning.slender.features import Seen
from learning.slender.many import Paths, alike, per_batch, predict_many
from learning.slender.model import Scales, load_slender, scaled
from learning.slender.path import check_points, knots, predict
from physics.mesh.build import build_mesh
from physics.schema import InputError
from tests.slender import predictor, scene
from tests.test_learning_slender_beam import everywhere


class Told(torch.nn.Module):
    """A network that says its pose's first feature for each number of each section, and its second as the doubt."""

    def forward(self, pose, section):
        return pose[:, :1, None].expand(-1, section.shape[1], 18) * torch.arange(1.0, 19.0), pose[:, 1]


def test_a_feature_is_cut_off_at_five_deviations():
    scale = torch.tensor([[1.0, 10.0], [2.0, 0.5]])
    assert scaled(torch.tensor([[4.0, 12.4], [11.5, 7.0], [-20.0, 10.0]]), scale).tolist() == pytest.approx(
        torch.tensor([[1.5, 4.8], [5.0, -5.0], [-5.0, 0.0]]))


def seen(pose, jumps=(False, False)):
    """Two poses of two features each, of three sections."""
    base = torch.arange(2 * 3 * 18, dtype=torch.float64).reshape(2, 3, 3, 6)
    unit = torch.tensor([[0.0, 0.5, 1.0], [0.0, 1.0, 2.0]], dtype=torch.float64)
    return Seen(torch.tensor(pose), torch.zeros(2, 3, 1), base, unit, torch.tensor([3.0, 4.0]), torch.tensor(jumps), torch.zeros(2))


def model(**changes):
    ones = torch.stack([torch.zeros(2), torch.ones(2)])
    scales = Scales(ones, ones[:, :1], torch.full((18,), 0.5), torch.tensor([-1.0, 0.0]), torch.tensor([1.0, 2.0]), torch.tensor([2.0]))
    return replace(predictor([scene()]), network=Told(), scales=replace(scales, **changes))


def test_an_answer_is_laid_on_the_base_in_units_and_the_doubt_is_of_the_depth():
    """The network says 2 k and 1 k for the k-th number; times 0.5 of its scale and the section's unit; doubts exp(0) 3 and exp(1) 4."""
    given = seen([[2.0, 0.0], [1.0, 1.0]])
    answer, doubt = model().answer(given)
    for p, said in ((0, 2.0), (1, 1.0)):
        for s in range(3):
            wanted = given.base[p, s].flatten() + said * torch.arange(1, 19) * 0.5 * given.unit[p, s]
            assert answer[p, s].flatten().tolist() == pytest.approx(wanted.tolist())
    assert doubt.tolist() == pytest.approx([3.0, 4 * np.e]) and answer.dtype == torch.float32


def test_a_pose_is_strange_a_tenth_of_the_range_beyond_it_or_at_a_jump():
    for first, strange in ((-1.0, False), (-1.19, False), (-1.21, True), (1.19, False), (1.21, True)):  # the range is 2 wide
        assert model().strange(seen([[first, 0.0], [0.0, 0.0]])).tolist() == [strange, False]
    assert model().strange(seen([[0.0, 2.19], [0.0, -0.21]])).tolist() == [False, True]
    assert model().strange(seen([[0.0, 0.0], [0.0, 0.0]], jumps=(False, True))).tolist() == [False, True]
    alike = model(low=torch.tensor([1.0, 0.0]), high=torch.tensor([1.0, 2.0]))  # of what never varied a rounding is not strange
    assert alike.strange(seen([[1.000009, 0.0], [1.00002, 0.0]])).tolist() == [False, True]


def test_a_checkpoint_is_read_back_and_one_that_does_not_fit_is_refused(tmp_path):
    assert all(is_at_once({"config": {"network": {"kind": kind}}}) for kind in ("sections", "shapes"))
    assert not any(is_at_once(about) for about in (
        {}, {"config": 3}, {"config": {}}, {"config": {"network": {}}}, {"config": {"network": 1}},
        {"config": {"network": {"kind": "mgn"}}}))
    made = predictor([scene()])
    names = set(state_of(made.network, made.scales))
    assert {f"scales.{name}" for name in ("pose", "section", "answer", "low", "high", "bar")} <= names
    assert all(name.startswith(("scales.", "weights.")) for name in names)
    with pytest.raises(InputError, match="model.safetensors"):
        load_slender(tmp_path)


def test_paths_are_batched_by_poses_and_by_numbers():
    made = predictor([scene()])  # of 9 poses a path
    assert per_batch(made, np.array([1.0]), 525) == 1024  # one pose a path
    assert per_batch(made, np.array([1.0, 1.0]), 525) == 1024
    assert per_batch(made, np.array([0.0, 1.0]), 525) == per_batch(made, np.array([0.5]), 525) == 1024 // 9
    assert per_batch(made, np.array([1.0]), 100_000) == 20_000_000 // 300_000  # three numbers a node
    assert per_batch(made, np.array([1.0] * 4), 100_000) == 20_000_000 // 1_200_000 and per_batch(made, np.array([0.5]), 10**8) == 1


def test_beams_that_look_alike_are_put_together_in_their_order():
    scenes = list(everywhere())
    beams = [see(scenes[i]) for i in (0, 3, 0, 7, 3)]
    beams[2] = replace(beams[2], radius=0.02, start=beams[2].start + 1.0, turn=0.5)
    groups = [(members.tolist(), paths) for members, paths in alike(beams)]
    assert [members for members, _ in groups] == [[0, 2], [1, 4], [3]]
    paths = groups[0][1]
    assert len(paths) == 2 and paths.radius.tolist() == [0.01, 0.02] and paths.turn.tolist() == [0.0, 0.5]
    assert paths.start.numpy() == pytest.approx(np.array([beams[0].start, beams[2].start])) and paths[1:].end.numpy() == pytest.approx(
        np.array([beams[2].end]))


@pytest.mark.parametrize("frames", [[1.0], [1.0, 1.0], [0.0, 0.3, 0.45, 1.0]])
def test_many_paths_of_a_beam_are_each_what_predict_says(frames):
    """One touches after a seventh, one after half of its way, one never; single precision of 1e-2 m."""
    ways = [((0.08, 0.012, 0.036), (0.081, 0.0125, 0.022)), ((0.07, 0.012, 0.039), (0.07, 0.012, 0.029)),
            ((0.08, 0.012, 0.04), (0.08, 0.012, 0.035))]
    scenes = [scene(path=way, steps=20) for way in ways]
    made, points = predictor(scenes[:1]), build_mesh(scenes[0].body).points
    made = replace(made, config=replace(made.config, unsure_above=1.0))
    (_, paths), = alike([see(each) for each in scenes])
    found = predict_many(made, paths, np.array(frames))
    assert found.displacement.shape == (3, len(frames), len(points), 3)
    for n, each in enumerate(scenes):
        alone = predict(made, each, points)
        at = np.round(20 * np.array(frames)).astype(int)
        np.testing.assert_allclose(found.displacement[n], alone.displacement[at], atol=2e-8)
        np.testing.assert_allclose(found.bar[n], alone.bar[at], rtol=1e-4)
        assert found.unsure[n].tolist() == alone.unsure[at].tolist()
    assert not found.bar[2].any() and not found.displacement[2].any() and not found.force[2].any() and found.force[0, -1] > 0
    endless = replace(made, scales=replace(made.scales, bar=torch.tensor([torch.inf])))
    many = predict_many(endless, paths, np.array(frames))
    assert np.isinf(many.bar[:2, -1]).all() and many.unsure[:2, -1].all() and not many.unsure[2].any() and not many.bar[2].any()


def test_poses_crowd_at_the_touch_by_the_power_of_six_fifths():
    assert knots(0.25, 4) == pytest.approx([0.25, 0.25 + 0.75 * (1 / 3) ** 1.2, 0.25 + 0.75 * (2 / 3) ** 1.2, 1.0])


def test_points_are_those_of_the_grid_up_to_a_billionth_of_the_length():
    for each in (scene(), list(everywhere())[4]):
        beam, points = see(each), build_mesh(each.body).points
        check_points(beam, points + [0.9e-10, 0, 0])
        for axis in range(3):
            moved = points.copy()
            moved[:, axis] += 1e-8
            with pytest.raises(InputError, match="not the one that its scene builds"):
                check_points(beam, moved)


def test_paths_know_where_each_first_touches():
    """Radius and half the height are 10 and 12 mm: heights 36 to 22 mm above the axis touch after one, those from 20 mm at once."""
    beam = see(scene())
    start = torch.tensor([[0.08, 0, 0.036], [0.08, 0, 0.020], [0.08, 0, 0.036]], dtype=torch.float64)
    end = torch.tensor([[0.08, 0, 0.008], [0.08, 0, 0.010], [0.08, 0, 0.023]], dtype=torch.float64)
    paths = Paths(beam, start, end, torch.full((3,), 0.01, dtype=torch.float64), torch.zeros(3, dtype=torch.float64))
    assert paths.first_touch.tolist() == pytest.approx([0.5, 0.0, 1.0])
    told = paths.obstacle(2)
    assert told.radius.tolist() == [0.01] * 6 and told.row == beam.row and told.nodes.tolist() == [0.0] * 6
