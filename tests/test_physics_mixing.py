"""Anderson's mixing, held against its definition written out, with `numpy.linalg.lstsq` for the argmin."""

import itertools

import numpy as np
import pytest

from physics.equilibrium.mixing import Mixing


def literal(equilibria):
    """What follows the last of some steps: (u, s, p) in each of some equilibria, whose differences count together, the last three."""
    before, moved, pushed = [], [], []
    for steps in equilibria:
        for (u0, s0, p0), (u1, s1, p1) in itertools.pairwise(steps):
            before.append((s1 - s0).ravel())
            moved.append((u1 - u0 + s1 - s0).ravel())
            pushed.append(p1 - p0)
    u, s, p = equilibria[-1][-1]
    if not before:
        return u + s, p
    c = np.linalg.lstsq(np.array(before[-3:]).T, s.ravel(), rcond=None)[0]
    u = (u + s).ravel() - np.array(moved[-3:]).T @ c
    return u.reshape(-1, 3), np.maximum(p - np.array(pushed[-3:]).T @ c, 0)


def drawn(rng, size=1.0):
    return rng.normal(size=(4, 3)), size * rng.normal(size=(4, 3)), rng.uniform(0, 3, 5)


def test_it_is_what_anderson_wrote_over_the_last_three_differences():
    """Over two equilibria; steps shrink by 1e5, so the differences must be scaled before small ones are told from rounding."""
    rng, mixing, steps = np.random.default_rng(0), Mixing(), [[], []]
    for equilibrium, sizes in enumerate([(1.0, 1e-2, 1e-4), (1e-5, 2e-5, 1e-5, 1.0)]):
        mixing.begin()
        for size in sizes:
            steps[equilibrium].append(drawn(rng, size))
            u, pressure = mixing.next(*steps[equilibrium][-1])
            expected, force = literal(steps[:equilibrium + 1])
            # Normal equations square the condition of three random directions, a few: 1e-16 becomes some 1e-12 of what is taken off.
            assert u == pytest.approx(expected, rel=1e-9, abs=1e-9)
            assert pressure == pytest.approx(force, rel=1e-9, abs=1e-9) and pressure.min() >= 0
        assert len(mixing.differences) == (2, 3)[equilibrium]


def test_a_force_that_would_draw_is_none():
    """One difference, s = 2 ds, so c = 2: p = [1, 4] and [3, 3] before, 2 - 1 each: 1 - 2 (1 - 3) = 5 and 4 - 2 (4 - 3) = 2, or less."""
    mixing, one = Mixing(), np.ones((1, 3))
    mixing.next(0 * one, one, np.array([3.0, 3.0, 1.0]))
    u, pressure = mixing.next(one, 2 * one, np.array([1.0, 4.0, 2.0]))
    # ds = 1, du = 1: u = 1 + 2 - 2 (1 + 1) = -1; the third force is 2 - 2 (2 - 1) = 0, a fourth would be below
    assert u == pytest.approx(-one) and pressure == pytest.approx([5.0, 2.0, 0.0], abs=1e-12)
    mixing = Mixing()
    mixing.next(0 * one, one, np.array([0.0]))
    assert mixing.next(one, 2 * one, np.array([1.0]))[1] == [0.0]  # 1 - 2 would draw


def test_the_first_step_is_taken_as_it_is_and_after_forgetting_again():
    rng, mixing = np.random.default_rng(1), Mixing()
    for _ in range(2):
        u, step, pressure = drawn(rng)
        found, kept = mixing.next(u, step, pressure)
        assert np.array_equal(found, u + step) and kept is pressure
        mixing.next(*drawn(rng))
        assert len(mixing.differences) == 1
        mixing.forget()
        assert mixing.differences == []


def test_no_difference_is_taken_between_two_equilibria():
    rng, mixing = np.random.default_rng(2), Mixing()
    mixing.next(*drawn(rng))
    mixing.begin()
    u, step, pressure = drawn(rng)
    assert np.array_equal(mixing.next(u, step, pressure)[0], u + step) and not mixing.differences


def test_steps_that_say_nothing_are_not_kept():
    """The same step twice has no difference; one that is not finite spoils nothing, and comes out as it is."""
    rng, mixing = np.random.default_rng(3), Mixing()
    u, step, pressure = drawn(rng)
    mixing.next(u, step, pressure)
    assert np.array_equal(mixing.next(u + 1, step, pressure)[0], u + 1 + step) and not mixing.differences
    for broken in (np.inf * step, np.nan * step):
        mixing = Mixing()
        first, second = drawn(rng), drawn(rng)
        mixing.next(*first)
        mixing.next(*second)
        found, kept = mixing.next(u, broken, pressure)
        assert not np.isfinite(found).any() and kept is pressure and len(mixing.differences) == 1
        # Nor can the step after it be held against it.
        third = drawn(rng)
        assert np.isfinite(mixing.next(*third)[0]).all() and len(mixing.differences) == 1


def test_directions_that_are_hardly_two_are_one():
    """Steps whose differences are alike to 1e-6, but not those of the displacements: taken for two, they would be multiplied by 1e6."""
    rng, mixing = np.random.default_rng(4), Mixing()
    a, noise = rng.normal(size=(2, 4, 3))
    for step in (0 * a, a, 2 * a + 1e-6 * noise, rng.normal(size=(4, 3))):
        found, _ = mixing.next(rng.normal(size=(4, 3)), step, np.zeros(0))
    assert len(mixing.differences) == 3 and abs(found).max() < 100
