"""A path corrected at some of its frames: which ones, and what stands between them."""

import numpy as np
import pytest

from physics.fidelity.along import corrected_path

FRAMES = np.arange(201)
SHAPE = np.random.default_rng(1).normal(size=(4, 3))


def walked(course, share, frames=FRAMES):
    """The corrected frames in the order in which they were asked for, and how far (T,) the rest is off; the truth is `course` (T,)."""
    guess = np.random.default_rng(0).normal(size=(len(frames), 4, 3))  # as rough as can be: only the correction is interpolated
    guess[0], asked = 0, []

    def correct(u, frame):
        assert np.array_equal(u, guess[frame])
        asked.append(frame)
        return u + course[frame] * SHAPE

    off = corrected_path(correct, guess, share) - guess - course[:, None, None] * SHAPE
    return asked, np.linalg.norm(off, axis=(1, 2)) / np.linalg.norm(SHAPE)


def test_a_correction_that_grows_steadily_is_worked_out_at_seventeen_of_two_hundred_frames():
    asked, off = walked(0.01 * FRAMES, 0.03)
    assert asked == [1, 2, 4, 8, 16, 32, 48, 64, 80, 96, 112, 128, 144, 160, 176, 192, 200]  # twice as wide each, sixteen at most
    assert off.max() < 1e-12


def test_without_a_share_each_frame_is_corrected():
    asked, off = walked(np.sin(FRAMES / 9), 0.0)
    assert asked == FRAMES[1:].tolist() and off.max() < 1e-15


@pytest.mark.parametrize("share", [0.03, 0.003])
def test_a_wave_is_missed_by_no_more_than_the_share(share):
    """A straight line over s frames misses 2 + sin(t / 15) by s^2 / (8 * 15^2), and may miss half of the share of 1 to 3."""
    course = 2 + np.sin(FRAMES / 15)
    course[0] = 0
    asked, off = walked(course, share)
    assert (off <= share / 2 * course)[1:].all()
    widest = 15 * np.sqrt(8 * share / 2 * 3)
    assert 1 / widest <= len(asked) / len(FRAMES) <= 4 / (15 * np.sqrt(8 * share / 2))


def test_a_kink_is_closed_in_upon_and_costs_no_frames_elsewhere():
    """Nothing to correct until the touch at frame 77, then a straight line: only the gap with the kink in it is halved."""
    asked, off = walked(0.2 * np.maximum(FRAMES - 77, 0), 0.03)
    assert sorted(asked) == [1, 2, 4, 8, 16, 32, 48, 64, 72, 76, 77, 78, 80, 84, 92, *range(108, 200, 16), 200]
    assert off.max() <= 0.2 and (off[:70] == 0).all() and off[85:].max() < 1e-12


def test_a_jump_is_seen_at_the_frame_at_which_it_is():
    course = np.where(FRAMES < 100, 0.1, 5.0) * (FRAMES > 0)
    asked, off = walked(course, 0.03)
    assert {99, 100} <= set(asked) and len(asked) < 40 and off.max() < 0.15


@pytest.mark.parametrize("last", [1, 2, 3, 4])
def test_short_paths(last):
    asked, off = walked(0.5 * FRAMES[:last + 1], 0.03, FRAMES[:last + 1])
    assert off.max() < 1e-12 and sorted(asked)[-1] == last and len(set(asked)) == len(asked)
