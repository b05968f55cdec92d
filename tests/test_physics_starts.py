"""Where the steps of a predicted frame begin: the three places and their order, on paper, for bodies of one node."""

import numpy as np
import pytest

from physics.equilibrium.state import State
from physics.fidelity.starts import GROWTH, Starts


def at(*x):
    return np.array([x], float)


def state(fraction, x):
    return State(fraction, at(x, 0.0, 0.0), np.zeros(0))


def ranked(starts, fraction, guess):
    return [float(place[0, 0]) for place in starts.ranked(fraction, guess)]


def test_at_first_the_guess_is_first_and_the_last_state_second():
    """Nothing is known of how the guess is to be carried: that comes last, whatever the others missed."""
    starts, guess = Starts(state(0.0, 0.0)), at(3.0, 0.0, 0.0)
    places = starts.ranked(0.5, guess)
    assert places[0] is guess and not places[1].any() and np.array_equal(places[2], guess) and len(places) == 3
    assert starts.off == np.inf


def test_what_was_nearest_to_the_last_state_comes_first():
    """The states are 0, 1 and 4 at fractions 0, 1 and 2, their guesses 1.5 and 3: off by -0.5 and 1."""
    starts = Starts(state(0.0, 0.0))
    starts.add(state(1.0, 1.0), at(1.5, 0.0, 0.0))
    assert starts.off == 0.5 and [s.fraction for s in starts.states] == [0.0, 1.0]
    # The guess missed by 1/2, carried as well, since nothing had been moved before, the rest state by 1.
    assert ranked(starts, 2.0, at(3.0, 0, 0)) == [3.0, 2.5, 1.0]
    starts.add(state(2.0, 4.0), at(3.0, 0, 0))
    # The guess missed by 1, carried by |2.5 - 4|, the last state by 3; the line through 0 and 1 would have missed by 2, so it is next.
    assert starts.off == pytest.approx(GROWTH * 0.5) == pytest.approx(0.6)
    assert ranked(starts, 3.0, at(8.0, 0, 0)) == [8.0, 9.0, 7.0]
    starts.add(state(3.0, 7.0), at(17.0, 0, 0))  # a guess that is far off counts for little: that was 10, carried 11, the line 0
    assert starts.off == pytest.approx(0.72) and ranked(starts, 4.0, at(0.0, 0, 0)) == [10.0, 0.0, -10.0]


def test_four_states_are_kept_and_one_that_is_not_finite_has_missed_by_infinity():
    starts = Starts(state(0.0, 0.0))
    for step in range(1, 7):
        starts.add(state(float(step), step**3), at(step**3, 0.1 * (-1)**step, 0.0))
    assert [s.fraction for s in starts.states] == [3.0, 4.0, 5.0, 6.0]
    # Three and then four states foresee a cube exactly, so the extrapolated comes before the guess, off by 0.1.
    assert ranked(starts, 7.0, at(0.0, 0.1, 0.0))[0] == pytest.approx(343)
    assert starts.off == pytest.approx(0.1)
    starts.add(state(7.0, 343.0), at(np.nan, 0.0, 0.0))
    assert starts.off == pytest.approx(0.12) and ranked(starts, 8.0, at(1.0, 0.0, 0.0))[0] == pytest.approx(512)


def test_of_a_body_that_rests_only_the_last_fraction_counts():
    starts, guess = Starts(state(0.0, 0.0)), at(3.0, 4.0, 0.0)
    starts.add(state(0.1, 0.0), at(0.0, 0.0, 1.0))
    starts.rested(0.2, guess)
    assert [(s.fraction, s.u.any()) for s in starts.states] == [(0.2, False)]
    places = starts.ranked(0.3, guess)  # missed: extrapolated 0, the carried guess 1 as before, the guess 5
    assert not places[0].any() and places[1].tolist() == [[3.0, 4.0, -1.0]] and places[2] is guess
