"""With enough correction any guess becomes the finite-element solution; with one step most of its error goes."""

import numpy as np
import pytest

from physics.equilibrium.state import NoEquilibrium
from physics.fidelity.correct import Corrector
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


@pytest.mark.parametrize("count, least", [(1, 10), (2, 100), (8, 1e4)])
def test_each_newton_step_takes_an_order_of_magnitude(case, count, least):
    scene, solution = case
    guess = wrong(solution)
    corrector = Corrector(scene, solution.mesh, count=count)
    found = path(corrector, guess)
    assert rms(guess - solution.displacement) / rms(found - solution.displacement) > least
    assert corrector.iterations <= count * solution.displacement.shape[0]
    assert corrector.factorisations < corrector.iterations  # the factor is kept


def test_the_solution_stays_what_it_is(case):
    scene, solution = case
    found = path(Corrector(scene, solution.mesh, count=1), solution.displacement)
    assert abs(found - solution.displacement).max() < 1e-7


def test_held_nodes_are_put_where_they_belong_and_loads_grow(case):
    scene = beam(support=[{"where": "x-min"}, {"where": "x-max", "fixed": "z", "displacement": [0, 0, -0.002]}])
    solution = solve(scene)
    found = path(Corrector(scene, solution.mesh, count=None), 0 * solution.displacement)
    assert abs(found - solution.displacement).max() < 1e-7


def test_a_guess_beyond_help_is_said_to_be_one(case):
    scene, solution = case
    torn = np.random.default_rng(0).normal(scale=0.02, size=solution.mesh.points.shape)
    with pytest.raises(NoEquilibrium):
        Corrector(scene, solution.mesh, count=None)(torn, 1.0)
