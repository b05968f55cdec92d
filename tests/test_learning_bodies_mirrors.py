"""What is said of a pose is the mean of what is said of it in the mirrors that the training showed, each turned back."""

import numpy as np
import pytest
import torch

from learning.bodies.body import shown_signs
from learning.bodies.model import Bodies, Scales
from learning.config import BodiesConfig
from tests.test_learning_bodies_body import seen

CYLINDER = {"shape": "cylinder", "radius": 0.02, "axis": [0.2, 1, 0.1], "path": [[0.06, 0.03, 0.031], [0.06, 0.03, 0.027]]}
SPACE = {"shape": "half-space", "normal": [0.6, 0, -0.8], "path": [[0.06, 0.04, 0.06], [0.06, 0.04, 0.05]]}


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("obstacle", [CYLINDER, SPACE], ids=("cylinder", "half-space"))
def test_a_mirror_turns_the_signs_of_what_is_shown(axis, obstacle):
    body = seen(obstacle=obstacle, support=[{"where": "x-min"}, {"where": "y-min", "fixed": "y"}])
    poses = np.array([0.5, 1.0])
    assert np.allclose(body.shown(poses)[0] * shown_signs(axis), body.mirrored(axis).shown(poses)[0], atol=1e-12)
    assert (shown_signs(axis) < 0).sum() > 10


class Said(torch.nn.Module):
    """Amounts (1 + x, 2 + 3 y) of the first two features, and the logarithm of an error, x."""

    def forward(self, pose):
        return torch.stack([1 + pose[:, 0], 2 + 3 * pose[:, 1]], dim=1), pose[:, 0]


def test_even_shapes_are_given_the_even_part_and_odd_ones_the_odd_part():
    """The first shape moves along z evenly in x, the second along z as x, which is odd: of 1 + x and 2 + 3 y at (0.5, 0.25) in a mirror
    of x they are 1 and 0; in one of y both are even, and 1.5 and 2. Errors are e^0 and e^0.5."""
    shapes = torch.zeros(2, 2, 3)
    shapes[0, 0, 2], shapes[1, 1, 2] = 1.0, 1.0
    ones, features = torch.ones(2), len(shown_signs(0))
    scales = Scales(torch.stack([torch.zeros(features), torch.ones(features)]), ones, ones, ones,
                    torch.tensor([[0, 0, 0, 0], [1, 0, 0, 0]]), shapes, torch.ones(1))
    pose = torch.zeros(1, features)
    pose[0, :2] = torch.tensor([0.5, 0.25])
    for mirrored, amounts, error in (("", [1.5, 2.75], 0.5), ("x", [1.0, 0.0], 0.0), ("y", [1.5, 2.0], 0.5), ("xy", [1.0, 0.0], 0.0)):
        said, doubt = Bodies(BodiesConfig(mirrored=mirrored), Said(), scales, "run").answer(pose, 2 * torch.ones(1))
        assert said[0].tolist() == pytest.approx([2 * each for each in amounts]) and doubt.tolist() == pytest.approx([2 * np.exp(error)])
