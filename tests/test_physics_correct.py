"""With enough correction any guess becomes the finite-element solution; with one step most of its error goes."""

import numpy as np
import pytest

from physics.equilibrium.state import NoEquilibrium
from physics.fidelity.correct import Corrector
from physics.mesh.build import build_mesh
from physics.solution import solve
from tests.scenes import beam, pressed


@pytest.fixture(scope="module")
def case():
    scene = pressed(steps={"count": 60})
    return scene, solve(scene)


def wrong(solution):
    """The truth bent sideways and with noise, as a network's prediction has both."""
    x = solution.mesh.points
    noise = np.random.default_rng(0).normal(scale=5e-6, size=solution.displacement.shape)
    bend = 5e-4 * np.stack([0 * x[:, 0], (x[:, 0] / 0.06) ** 2, 0 * x[:, 0]], axis=1)
    return solution.displacement + (bend + noise) * (np.arange(len(noise)) > 0)[:, None, None]


def path(corrector, guess):
    last = len(guess) - 1
    return np.array([guess[0]] + [corrector(guess[t], t / last) for t in range(1, last + 1)])


def rms(error):
    return float(np.sqrt(np.mean(np.sum(error**2, axis=-1))))


def test_to_the_solvers_tolerance_it_is_the_solution(case):
    scene, solution = case
    corrector = Corrector(scene, solution.mesh, count=None)
    found = path(corrector, wrong(solution))
    # Both stop at a residual of 1e-6 of the reaction, so displacements of 1e-2 m differ by some 1e-8 m.
    assert abs(found - solution.displacement).max() < 1e-7
    assert corrector.iterations > len(found) - 3


@pytest.mark.parametrize("count, least", [(1, 10), (2, 100), (4, 1e4)])
def test_each_newton_step_takes_an_order_of_magnitude(case, count, least):
    scene, solution = case
    guess = wrong(solution)
    corrector = Corrector(scene, solution.mesh, count=count)
    found = path(corrector, guess)
    assert rms(guess - solution.displacement) / rms(found - solution.displacement) > least
    assert corrector.iterations < (1 + count) * len(found)
    assert corrector.factorisations < corrector.iterations / 2  # the factor is kept


def test_the_solution_stays_what_it_is(case):
    scene, solution = case
    found = path(Corrector(scene, solution.mesh, count=1), solution.displacement)
    assert abs(found - solution.displacement).max() < 1e-7


def test_held_nodes_are_put_where_they_belong_and_loads_grow(case):
    scene = beam(support=[{"where": "x-min"}, {"where": "x-max", "fixed": "z", "displacement": [0, 0, -0.002]}])
    solution = solve(scene)
    found = path(Corrector(scene, solution.mesh, count=None), 0 * solution.displacement)
    assert abs(found - solution.displacement).max() < 1e-7


@pytest.mark.parametrize("count", [1, None])
def test_what_a_guess_beyond_help_leads_to_the_last_state_does(case, count):
    scene, solution = case
    torn = np.random.default_rng(0).normal(scale=0.02, size=solution.mesh.points.shape)
    found = Corrector(scene, solution.mesh, count=count)(torn, 1.0)
    assert abs(found - solution.displacement[-1]).max() < 1e-7


def test_where_there_is_no_equilibrium_the_guess_stays_or_it_is_said():
    scene = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [3, 1, 1]},
                 load=[{"where": "x-max", "traction": [0.0, 0.0, 10.0]}])
    corrector = Corrector(scene, build_mesh(scene.body))
    guess = np.where(corrector.balance.fixed, 0.0, 1e-4)
    corrector.newton.equilibrium = corrector.newton.improve = corrector.newton.polished = nowhere
    assert (corrector(guess, 1.0) == guess).all()
    with pytest.raises(NoEquilibrium):
        corrector(np.where(corrector.balance.fixed, 0.0, np.nan), 1.0)
    corrector.count = None
    with pytest.raises(NoEquilibrium):
        corrector(guess, 1.0)


def nowhere(*given, **named):
    raise NoEquilibrium("nowhere")
