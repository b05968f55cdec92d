"""One Newton step after a prediction: never a worse state, and a much better one even where the body is about to slide."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physics.fidelity.correct import Corrector
from physics.solution import solve
from tests.scenes import beam

BODY = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [8, 3, 3]}
# A sphere beside the middle, which the beam turns away from until it slips off: its path bends, and ends.
ASIDE = {"shape": "sphere", "radius": 0.01, "path": [[0.055, 0.014, 0.0305], [0.055, 0.014, -0.0155]]}
DOWN = {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.0305], [0.05, 0.01, 0.0205]]}


def solved(obstacle, count):
    scene = beam(body=BODY, obstacle=obstacle, steps={"count": count})
    return scene, solve(scene)


@pytest.fixture(scope="module")
def sliding():
    return solved(ASIDE, 80)


@pytest.fixture(scope="module")
def pushed():
    return solved(DOWN, 10)


def corrected(scene, solution, guess, count=1):
    corrector, last = Corrector(scene, solution.mesh, count=count), len(guess) - 1
    return np.array([guess[0]] + [corrector(guess[t], t / last) for t in range(1, last + 1)]), corrector


def errors(path, solution):
    return np.sqrt(((path - solution.displacement) ** 2).mean(axis=(1, 2)))[1:]


def wave(solution, seed, size, turns):
    """(T, N, 3) a smooth error in all components: it bends, twists, stretches and shears; it grows from the clamped end."""
    rng, x = np.random.default_rng(seed), solution.mesh.points / 0.06
    error = sum(np.cos(x @ rng.uniform(-4, 4, 3) + rng.uniform(0, 6))[:, None] * rng.normal(size=3) for _ in range(5)) * x[:, :1]
    along = np.cos(turns * np.linspace(0, 6, len(solution.displacement)) + rng.uniform(0, 6))
    return size * along[:, None, None] * error / np.sqrt((error**2).mean())


@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**20), power=st.floats(-7, -3.3), turns=st.floats(0, 30))
def test_whatever_the_error_one_step_never_makes_it_worse(pushed, seed, power, turns):
    """From 0.1 um to 0.5 mm, of a motion of 10 mm; from one that stays to one that changes its sign from frame to frame."""
    scene, solution = pushed
    guess = solution.displacement + wave(solution, seed, 10**power, turns)
    found, _ = corrected(scene, solution, guess)
    before, after = errors(guess, solution), errors(found, solution)
    # 1e-9: the solution itself ends at a residual of 1e-6 of the reaction.
    assert (after <= before + 1e-9).all()
    assert np.linalg.norm(after) < 0.1 * np.linalg.norm(before) + 1e-8


@pytest.mark.parametrize("size", [1e-5, 1e-4])
def test_a_body_about_to_slide_is_ten_times_nearer_after_one_step(sliding, size):
    scene, solution = sliding
    end = int(np.flatnonzero(solution.snap)[0])
    assert 20 < end < 80 and solution.snap[end] > 0.02
    guess = solution.displacement + wave(solution, 0, size, 0.1)
    found, corrector = corrected(scene, solution, guess)
    before, after = errors(guess, solution), errors(found, solution)
    assert (after < 0.1 * before).all()
    assert corrector.iterations < 2.5 * len(after)


def test_a_prediction_that_slides_too_late_is_led_to_where_the_body_comes_to_rest(sliding):
    """Three frames late: over three frames the prediction is on the other side of the slip, 20 mm off."""
    scene, solution = sliding
    guess = solution.displacement[np.maximum(np.arange(81) - 3, 0)]
    found, _ = corrected(scene, solution, guess)
    before, after = errors(guess, solution), errors(found, solution)
    assert before.max() > 5e-3
    assert (after <= before + 1e-9).all() and np.linalg.norm(after) < 0.1 * np.linalg.norm(before)


def test_of_two_equilibria_the_one_nearer_to_the_prediction_is_taken(sliding):
    """Held back before the slip, the last state goes on beside the obstacle; what is predicted from there on is the other side."""
    scene, solution = sliding
    end = int(np.flatnonzero(solution.snap)[0])
    corrector = Corrector(scene, solution.mesh, count=1)
    guess = solution.displacement + wave(solution, 1, 1e-5, 1.0)
    for t in range(1, end):
        corrector(guess[t], t / 80)
    after = corrector(guess[end + 2], (end + 2) / 80)  # frames are left out
    assert np.sqrt(((after - solution.displacement[end + 2]) ** 2).mean()) < 1e-6
