"""What a predictor of bodies is shown, and what becomes of its answers, worked out on paper."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from learning.bodies.model import Bodies, Scales
from learning.bodies.path import predict
from learning.config import BodiesConfig
from learning.slender.model import MARGIN
from physics.mesh.build import build_mesh
from tests.test_learning_bodies_body import PLATE, scene, seen

# Means over the box from -1 to 1: 1, x, y, z, xx, xy, xz, yy, yz, zz
ALL = [1, 0, 0, 0, 1 / 3, 0, 0, 1 / 3, 0, 1 / 3]
HELD = [1, -1, 0, 0, 1, 0, 0, 1 / 3, 0, 1 / 3]  # the face x = -1


def test_a_pose_is_told_by_these_numbers_in_this_order():
    """The sphere of radius 20 mm half way: centre (60, 40, 29) mm, 1 mm deep in a plate of 100 x 80 x 10 mm."""
    shown, depth = seen().shown(np.array([0.5]))
    pose = [0.2, 0.0, 4.8, 0.01, 0.1, 0.1]
    box = [0.0, np.log(0.8), np.log(0.1), 10.0, 0.4, 1.0]
    sphere = [1, 0, 0, 0, 0, 0, 0.2, 2.0, 0, 0, 0, 0, *[0] * 6, 0, 0, 0]
    assert depth == pytest.approx([0.001])
    assert shown[0] == pytest.approx([*pose, *box, *sphere, *ALL, *HELD, *HELD, *HELD], abs=1e-12)


@pytest.mark.parametrize("obstacle, told", [
    ({"shape": "cylinder", "radius": 0.02, "axis": [3, 4, 0]}, [0, 1, 0, 0, 0, 0, 0.2, 2, 0, 0, 0, 0, .36, .48, 0, .64, 0, 0, 0, 0, 0]),
    ({"shape": "capsule", "radius": 0.01, "length": 0.03, "axis": [0, 3, 4], "contact": "nodes"},
     [0, 0, 1, 0, 0, 1, 0.1, 1, 0.3, 0, 0, 0, 0, 0, 0, .36, .48, .64, 0, 0, 0]),
    ({"shape": "box", "size": [0.01, 0.02, 0.04], "radius": 0.002}, [0, 0, 0, 1, 0, 0, 0.02, 0.2, 0, 0.1, 0.2, 0.4, *[0] * 6, 0, 0, 0]),
    ({"shape": "half-space", "normal": [0, -6, -8]}, [0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, *[0] * 6, 0, -0.6, -0.8]),
])
def test_an_obstacle_is_told_by_its_shape_and_by_its_sizes_over_the_bodys(obstacle, told):
    """Which shape, felt at nodes; radius over the longest and the shortest side; length, size; products of the axis; normal."""
    path = [[0.06, 0.04, 0.05], [0.06, 0.04, 0.045]]
    law = {"young_modulus": 1e6, "poisson_ratio": 0.2, "law": "saint-venant-kirchhoff"}
    shown, _ = seen(obstacle=obstacle | {"path": path}, material=law).shown(np.zeros(1))
    assert shown[0, 12:33] == pytest.approx(told, abs=1e-12)
    assert shown[0, 10:12].tolist() == [0.2, 0.0]


def test_a_half_space_in_a_mirror_turns_its_normal():
    body = seen(obstacle={"shape": "half-space", "normal": [0.6, 0, -0.8], "path": [[0.06, 0.04, 0.06], [0.06, 0.04, 0.05]]})
    assert body.mirrored(0).obstacle.normal == pytest.approx((-0.6, 0, -0.8))
    assert body.mirrored(2).obstacle.normal == pytest.approx((0.6, 0, 0.8))


def test_a_touch_at_the_very_start_is_at_zero():
    body = seen(obstacle={"shape": "sphere", "radius": 0.02, "path": [[0.06, 0.04, 0.029], [0.06, 0.04, 0.027]]})
    assert body.first_touch == 0.0


class Said(torch.nn.Module):
    """Answers (1, 2) and the logarithm of 0.25 whatever it is shown; keeps what that was."""

    def forward(self, pose):
        self.shown = pose
        return torch.tensor([[1.0, 2.0]]).expand(len(pose), 2), torch.full((len(pose),), float(np.log(0.25)))


def model(features, **changes):
    """Shapes: the first moves all nodes by 1 along z, the second along x; its answers are 3 and 5 in these, times the depth."""
    shapes = torch.zeros(2, 1, 3)
    shapes[0, 0, 2] = shapes[1, 0, 0] = 1
    wide = {"low": torch.full((features,), -100.0), "high": torch.full((features,), 100.0), "bar": torch.tensor([2.0])}
    scales = Scales(pose=torch.stack([torch.ones(features), torch.full((features,), 2.0)]), answer=torch.tensor([3.0, 2.5]),
                    degrees=torch.zeros(1, 4, dtype=torch.int64), shapes=shapes, **(wide | changes))
    return Bodies(BodiesConfig(poses=4, unsure_above=0.0012), Said(), scales, "run")


def test_an_answer_is_scaled_by_the_depth_and_features_by_their_deviation():
    one = model(2)
    amount, doubt = one.answer(torch.tensor([[3.0, -4.0]]), torch.tensor([0.5]))
    assert one.network.shown.tolist() == [[1.0, -2.5]]
    assert amount.tolist() == [[1.5, 2.5]] and doubt.tolist() == pytest.approx([0.125])


def test_what_lies_outside_of_the_range_and_a_tenth_of_it_is_strange():
    assert MARGIN == 0.1
    one = model(2, low=torch.tensor([0.0, 10.0]), high=torch.tensor([10.0, 20.0]))
    assert one.strange(torch.tensor([[-0.99, 15.0], [10.99, 20.99], [-1.01, 15.0], [5.0, 21.01], [5.0, 8.9]])).tolist() == [
        False, False, True, True, True]


def test_a_path_is_the_answer_at_each_depth_and_nothing_before_the_touch_and_on_held_nodes():
    """From -1 to 3 mm in eight frames: depths 0.5 to 3 mm from the third on; (5, 0, 3) times the depth on free nodes. The bar is half the
    depth, above 1.2 mm from 2.5 mm on."""
    body, features = seen(), seen().shown(np.zeros(1))[0].shape[1]
    found = predict(model(features), scene(), build_mesh(scene().body))
    depth = np.array([0, 0, 0, 0.5, 1, 1.5, 2, 2.5, 3]) * 1e-3
    assert np.allclose(found.displacement[:, body.free], depth[:, None, None] * [5, 0, 3], atol=1e-8)
    assert not found.displacement[:, ~body.free].any() and (~body.free).any()
    assert found.bar == pytest.approx(depth / 2, abs=1e-9)
    assert found.unsure.tolist() == [False] * 7 + [True] * 2


def test_without_a_found_bar_and_outside_of_its_ranges_a_path_is_unsure_from_the_touch_on():
    features = seen().shown(np.zeros(1))[0].shape[1]
    touched = [False] * 2 + [True] * 6  # at the third frame depth is 0 to the last digit
    mesh = build_mesh(scene().body)
    endless = predict(model(features, bar=torch.tensor([torch.inf])), scene(), mesh)
    assert np.delete(np.isinf(endless.bar), 2).tolist() == touched and np.delete(endless.unsure, 2).tolist() == touched
    narrow = predict(model(features, high=torch.full((features,), -50.0)), scene(), mesh)
    assert np.delete(narrow.unsure, 2).tolist() == touched and np.isfinite(narrow.bar).all()


def test_a_component_that_is_held_alone_stays_while_the_others_move():
    body = scene(support=[{"where": "x-min", "fixed": "z"}])
    features = seen().shown(np.zeros(1))[0].shape[1]
    found = predict(model(features), body, build_mesh(body.body))
    at_end = build_mesh(body.body).points[:, 0] == 0
    assert not found.displacement[:, at_end, 2].any() and found.displacement[8, at_end, 0] == pytest.approx(0.015)


def test_no_touch_is_no_motion():
    away = scene(obstacle={"shape": "sphere", "radius": 0.02, "path": [[0.06, 0.04, 0.05], [0.06, 0.04, 0.045]]})
    found = predict(model(73), away, build_mesh(away.body))
    assert not found.displacement.any() and not found.bar.any() and not found.unsure.any()
    assert found.displacement.shape == (9, 6 * 5 * 3, 3)


def test_a_plate_with_its_shortest_side_along_x_is_told_by_its_own_box():
    body = replace(seen(), points=np.array([[0.0, 0, 0], [0.01, 0.04, 0.02]]), held=np.zeros((2, 3), bool))
    shown, _ = body.shown(np.zeros(1))
    assert shown[0, 6:10] == pytest.approx([np.log(0.25), 0.0, np.log(0.5), 4.0])
    assert body.low.tolist() == [0, 0, 0] and PLATE["height"] == 0.01
