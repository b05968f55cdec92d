"""The error of a sequence of solutions: exact where the sequence is a power, doubted where it is none."""

from itertools import pairwise

import numpy as np
import pytest

from physics.accuracy.estimate import FIRST, LOWEST, distance, estimate, observed_order


def made(sizes, order, factor=0.3):
    """The differences of 1 + factor n^-order."""
    return [abs(factor * (a**-order - b**-order)) for a, b in pairwise(sizes)]


@pytest.mark.parametrize("order", [1.0, 1.37, 2.0, 3.3])
@pytest.mark.parametrize("sizes", [(2, 3, 5), (6, 9, 14), (1, 2, 4)])
def test_the_order_of_a_manufactured_sequence_is_seen_and_its_error_is_exact(order, sizes):
    found = estimate(list(sizes), made(sizes, order), 4.0, "displacement")
    assert found.order == pytest.approx(order, rel=1e-9) and found.how == "seen"
    assert found.error == pytest.approx(0.3 * sizes[1] ** -order, rel=1e-9)


def test_a_sequence_that_falls_faster_than_theory_counts_with_the_order_of_theory():
    sizes = (2, 4, 8)
    found = estimate(list(sizes), made(sizes, 5.0), 2.0, "displacement")
    assert found.order == 2.0 and found.error == pytest.approx(made(sizes, 5.0)[1] / (1 - 0.25))


@pytest.mark.parametrize("differences", [[0.01, 0.02], [0.01, 0.01], [np.inf, 0.01]])
def test_a_sequence_that_does_not_converge_is_not_trusted(differences):
    """With p = 0.8 the larger difference of a doubling is worth 1 / (1 - 2^-0.8) = 2.35 times itself."""
    assert observed_order((2, 4, 8), tuple(differences), 2.0) == 0.0
    found = estimate([2, 4, 8], differences, 2.0, "displacement")
    assert found.how == "irregular" and found.error == pytest.approx(2.3492 * max(differences), rel=1e-4)


def test_two_meshes_alone_count_with_the_first_order_which_is_no_better_than_one():
    found = estimate([2, 4], [0.01], 4.0, "displacement")
    assert found.how == "assumed" and found.error == pytest.approx(0.02) and max(FIRST.values()) <= 1.0
    assert estimate([2, 4], [0.01], 4.0, "stress").error > found.error
    assert all(LOWEST[name] < FIRST[name] for name in FIRST)


def test_distance_is_the_relative_norm_over_poses_and_weighted_points():
    """Two poses, two points of weight 3/4 and 1/4: |b|^2 = 3/4 + 1 and |a - b|^2 = 1/4 0.5^2, worked out by hand."""
    finer = np.array([[[1.0], [0.0]], [[0.0], [2.0]]])
    values = finer + np.array([[[0.0], [0.0]], [[0.0], [0.5]]])
    assert distance(values, finer, np.array([0.75, 0.25])) == pytest.approx((0.0625 / 1.75) ** 0.5)
    assert distance(np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), np.ones(1)) == 0.0
    assert distance(np.ones((1, 1, 1)), np.zeros((1, 1, 1)), np.ones(1)) == np.inf
