"""The error of a sequence of solutions: exact where the sequence is a power, doubted where it is none."""

from itertools import pairwise

import numpy as np
import pytest

from physics.accuracy.estimate import FIRST, LOWEST, distance, estimate, looked, observed_order


def made(sizes, order, factor=0.3):
    """The differences of 1 + factor n^-order."""
    return [abs(factor * (a**-order - b**-order)) for a, b in pairwise(sizes)]


@pytest.mark.parametrize("order", [1.0, 1.37, 2.0, 3.3])
@pytest.mark.parametrize("sizes", [(2, 3, 5), (6, 9, 14), (1, 2, 4)])
def test_the_order_of_a_manufactured_sequence_is_seen_and_its_error_is_exact(order, sizes):
    found = estimate(list(sizes), made(sizes, order), 4.0, "displacement")
    assert found.order == pytest.approx(order, rel=1e-9) and found.how == "seen"
    assert found.error == pytest.approx(0.3 * sizes[2] ** -order, rel=1e-9)


def test_a_sequence_that_falls_faster_than_theory_counts_with_the_order_of_theory_and_the_larger_difference():
    """With p = 2 a mesh twice as fine has a third of the difference left: d_12 / 3, and of d_01 a twelfth, which is more of n^-5."""
    first, last = made((2, 4, 8), 5.0)
    found = estimate([2, 4, 8], [first, last], 2.0, "displacement")
    assert found.order == 2.0 and found.error == pytest.approx(first / 12) and first / 12 > last / 3


@pytest.mark.parametrize("differences, error", [([0.01, 0.02], 0.0270), ([0.01, 0.01], 0.0135), ([0.02, 0.019], 0.0257)])
def test_a_sequence_that_does_not_converge_is_not_trusted(differences, error):
    """With p = 0.8 a doubling leaves q = 2^-0.8 = 0.574 of the error: 1.349 d_12, or 0.775 d_01."""
    found = estimate([2, 4, 8], differences, 2.0, "displacement")
    assert found.how == "irregular" and found.error == pytest.approx(error, rel=3e-3)


def test_differences_that_do_not_fall_have_no_order():
    assert all(observed_order((2, 4, 8), pair, 2.0) == 0.0 for pair in [(0.01, 0.02), (0.01, 0.01), (np.inf, 0.01)])


def test_two_meshes_alone_count_with_the_first_order_which_is_no_better_than_one():
    found = estimate([2, 4], [0.01], 4.0, "displacement")
    assert found.how == "assumed" and found.error == pytest.approx(0.01) and max(FIRST.values()) <= 1.0
    assert estimate([2, 4], [0.01], 4.0, "stress").error > found.error
    assert all(LOWEST[name] < FIRST[name] for name in FIRST)


@pytest.mark.parametrize("order", [0.9, 1.3, 1.5])
@pytest.mark.parametrize("ways", [((1.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (0.0, 1.0)), ((1.0, 0.0), (-0.6, 0.8))])
def test_each_direction_alone_and_all_together_show_the_order_and_the_error_of_a_power(order, ways):
    """0.2 n^-p along x from 4 cells, 0.1 m^-p along y from 2: looks at 6 and 3, then a mesh of 8 x 3. Both are added as vectors."""
    x, y = np.array(ways)
    error = 0.2 * 8**-order * x + 0.1 * 3**-order * y
    alone = [(4 / 6, (0.2 * (6**-order - 4**-order) * x)[None, None]), (2 / 3, (0.1 * (3**-order - 2**-order) * y)[None, None])]
    change = float(np.linalg.norm(0.2 * 4**-order * x + 0.1 * 2**-order * y - error))
    found = looked(alone, [2.0, 1.5], change, 2.0, "displacement", np.ones(1))
    assert found.order == pytest.approx(order, rel=1e-6) and found.error == pytest.approx(np.linalg.norm(error), rel=1e-6)
    assert looked(alone, [2.0, 1.5], 3 * change, 2.0, "displacement", np.ones(1)).how == "irregular"


@pytest.mark.parametrize("usual", [1.5, 2.0])
def test_a_second_mesh_that_was_refined_in_one_direction_alone_shows_no_order_and_the_first_one_is_assumed(usual):
    """Its change is that of this direction, whatever the order: rounding is not to decide between 2 and 0.8."""
    draw = np.random.default_rng(0)
    for ratio in (1 / 2, 2 / 3, 6 / 9.0, 9 / 14):
        for _ in range(20):
            one, other = draw.normal(size=(2, 1, 5, 3))
            change = float(np.sqrt((one**2).sum()))
            found = looked([(ratio, one), (0.5, other)], [1 / ratio, 1.0], change, usual, "displacement", np.ones(5))
            left = np.sqrt(((one * ratio / (1 - ratio) + other / (1 - 0.5)) ** 2).sum())
            assert (found.order, found.how) == (1.0, "assumed") and found.error == pytest.approx(left, rel=1e-9)


def test_distance_is_the_relative_norm_over_poses_and_weighted_points():
    """Two poses, two points of weight 3/4 and 1/4: |b|^2 = 3/4 + 1 and |a - b|^2 = 1/4 0.5^2, worked out by hand."""
    finer = np.array([[[1.0], [0.0]], [[0.0], [2.0]]])
    values = finer + np.array([[[0.0], [0.0]], [[0.0], [0.5]]])
    assert distance(values, finer, np.array([0.75, 0.25])) == pytest.approx((0.0625 / 1.75) ** 0.5)
    assert distance(np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), np.ones(1)) == 0.0
    assert distance(np.ones((1, 1, 1)), np.zeros((1, 1, 1)), np.ones(1)) == np.inf
