"""A motion in few shapes: how many it takes, how far off they are, and that the figure given is the one a reader of them finds."""

import numpy as np
import pytest

from physics.view.lowrank import compress


def waves(count: int, frames: int = 30, nodes: int = 200) -> np.ndarray:
    """(T, N, 3) a sum of so many shapes of one size, moving independently."""
    rng = np.random.default_rng(3)
    return np.einsum("tr,rni->tni", rng.normal(size=(frames, count)), rng.normal(size=(count, nodes, 3)))


def off(found, frames: np.ndarray) -> float:
    """The largest distance of a node from its place, as a reader of the shapes sees it."""
    seen = found.coefficients.astype(float) @ found.shapes.astype(float)
    return float(np.linalg.norm(seen.reshape(frames.shape) - frames, axis=2).max())


@pytest.mark.parametrize("count", [1, 3, 7])
def test_a_sum_of_so_many_shapes_takes_so_many_shapes(count):
    frames = waves(count)
    found = compress(frames, 1e-3 * np.linalg.norm(frames, axis=2).max())
    assert found.shapes.shape == (count, 600) and found.coefficients.shape == (30, count)
    assert found.shapes.dtype == np.int16 and found.coefficients.dtype == np.float32 and abs(found.shapes).max() == 32767


@pytest.mark.parametrize("tolerance", [3.0, 1.0, 0.3, 0.1])
def test_the_error_is_that_of_a_reader_and_within_the_tolerance_and_fewer_shapes_would_not_do(tolerance):
    """Thirty independent frames of noise: every shape counts."""
    frames = waves(30)
    found = compress(frames, tolerance)
    assert found.error == pytest.approx(off(found, frames), rel=1e-6) and found.error <= tolerance
    fewer = compress(frames, tolerance, len(found.shapes) - 1)
    assert len(fewer.shapes) == len(found.shapes) - 1 and fewer.error > tolerance
    assert fewer.error == pytest.approx(off(fewer, frames), rel=1e-6)


def test_shapes_are_the_best_in_the_mean_square():
    """Eckart and Young: what r shapes leave is the root of the sum of the squares of the other singular values."""
    frames = waves(12)
    found = compress(frames, 0.0, 4)
    left = found.coefficients.astype(float) @ found.shapes.astype(float) - frames.reshape(30, -1)
    assert np.linalg.norm(left) == pytest.approx(np.linalg.norm(np.linalg.svd(frames.reshape(30, -1))[1][4:]), rel=1e-6)


def test_rounding_to_16_bits_is_all_that_one_shape_loses():
    frames = waves(1)
    found = compress(frames, 0.0)
    # half a step of 1 / 32767 of the largest component, in all three
    assert 0 < found.error <= np.sqrt(3) / 2 / 32767 * abs(frames).max() * 1.01


def test_what_does_not_move_takes_no_shape():
    found = compress(np.zeros((5, 4, 3)), 0.0)
    assert found.shapes.shape == (0, 12) and found.coefficients.shape == (5, 0) and found.error == 0
    assert not found.frames.any() and found.frames.shape == (5, 12)


def test_the_frames_that_are_given_stay_as_they_are():
    frames = waves(2)
    before = frames.copy()
    compress(frames, 0.0)
    assert np.array_equal(frames, before)


def test_a_vector_counts_by_its_length():
    """Off by 0.6 in each of three components is off by 1.04."""
    frames = np.full((1, 1, 3), 0.6)
    assert len(compress(frames, 1.03).shapes) == 1 and len(compress(frames, 1.04).shapes) == 0
