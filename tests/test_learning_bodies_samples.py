"""Trajectories as samples of bodies: which frames, what is left of a displacement, how much each counts."""

import hashlib

import numpy as np
import pytest
import torch

from learning.bodies import samples as bodies
from learning.bodies.samples import Fitted, Sample, Table, sample_of, table_of
from tests.test_learning_slender_samples import SCENE, moved


def sample(motion, poses, start):
    numbers = torch.arange(start, start + poses, dtype=torch.float32)
    return Sample(torch.stack([numbers, -numbers], dim=1), numbers, start * torch.eye(2), torch.stack([numbers, 2 * numbers], dim=1),
                  torch.zeros(poses), motion)


def test_in_a_table_each_trajectory_counts_by_the_square_of_its_motion_and_the_weights_are_one_in_the_mean():
    """Motions of 1 and 3, two poses and one: 1, 1, 1/9, over their mean 19/27."""
    table: Table = table_of([sample(1.0, 2, 4), sample(3.0, 1, 6)])
    assert table.owner.tolist() == [0, 0, 1]
    assert table.weight.tolist() == pytest.approx([27 / 19, 27 / 19, 3 / 19])
    assert table.depth.tolist() == [4, 5, 6] and table.feature.tolist() == [[4, -4], [5, -5], [6, -6]]
    assert table.best.tolist() == [[4, 8], [5, 10], [6, 12]]
    assert table.gram.tolist() == [[[4, 0], [0, 4]], [[6, 0], [0, 6]]]


def test_amounts_that_fit_best_and_what_they_leave_from_products_alone():
    """One function, one node: u = (3, 4, 0), the shape (2, 0, 0): amount 1.5, and 4 of 5 is left."""
    u = np.array([[[3.0, 4.0, 0.0]]])
    one = Fitted(np.zeros((1, 1)), np.ones(1), u, np.ones((1, 1)), u, np.array([25.0]))
    found = sample_of(one, np.array([[[2.0, 0.0, 0.0]]]))
    assert found.best.tolist() == [pytest.approx([1.5], rel=1e-6)] and found.left.tolist() == pytest.approx([16.0])
    assert found.gram.tolist() == [[4.0]] and found.motion == 5.0
    assert found.error(torch.tensor([[0.0]])).tolist() == pytest.approx([5.0])


def test_a_body_is_read_at_the_same_frames():
    found = bodies._picked(moved(SCENE), 4)
    assert found.fraction.tolist() == [3 / 20, 9 / 20, 14 / 20, 1.0] and found.seconds == 2.5
    assert np.array_equal(found.displacement, moved(SCENE).displacement[[3, 9, 14, 20]].astype(float))
    digest = hashlib.sha256(moved(SCENE).displacement.astype("<f4").tobytes()).hexdigest()
    assert found.digest == digest and bodies.fingerprint([found, found]) == hashlib.sha256(2 * digest.encode()).hexdigest()
    assert bodies._picked(moved(SCENE, seconds=None), 4).seconds == 0 and found.told["nodes of the body"] == 525
