"""A few Newton steps from a guess: which factor they take, when they end, and the state they say."""

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.stability import Watch
from physics.equilibrium.state import NoEquilibrium, State
from physics.journal import flatten
from physics.mesh.build import build_mesh
from tests import dense
from tests.scenes import beam

BODY = {"length": 0.06, "width": 0.03, "height": 0.02, "cells": [4, 2, 2], "cell": "hexahedron"}
LOAD = [{"where": "x-max", "traction": [1e3, 5e2, -2e3]}]


def newton(**changes):
    scene = beam(**({"body": BODY, "load": LOAD, "steps": {"count": 4}} | changes))
    return Newton(Balance(scene, build_mesh(scene.body)))


def state_at(found, u):
    return State(0.0, u, np.zeros(0))


def noise(found, scale):
    return np.where(found.balance.fixed, 0, np.random.default_rng(0).normal(scale=scale, size=found.balance.fixed.shape))


def test_steps_are_newtons_with_the_factor_of_the_first_guess():
    """One step from the guess; two, the second with the same matrix; the state's figures are those after them."""
    found = newton()
    balance, start = found.balance, noise(newton(), 1e-4)
    K = dense.stiffness(balance.elasticity, start)
    u, states = start, []
    for _ in range(2):
        out = np.where(balance.fixed, 0, balance.elasticity.force(u) - 0.5 * balance.load)
        u = u - np.linalg.solve(K, out.ravel()).reshape(-1, 3)
        states.append(u)
    one = found.improve(0.5, start, state_at(found, 0 * start), count=1)
    assert one.u == pytest.approx(states[0], abs=1e-8 * abs(u).max()) and (one.iterations, one.fraction) == (1, 0.5)
    out = balance.elasticity.force(one.u) - 0.5 * balance.load
    assert one.residual == pytest.approx(np.linalg.norm(out[~balance.fixed]) / np.linalg.norm(out[balance.fixed]), rel=1e-9)
    found.outdate()
    K = dense.stiffness(balance.elasticity, 0 * start)  # by more than one step, the factor is that of the last state
    u = start
    for _ in range(2):
        out = np.where(balance.fixed, 0, balance.elasticity.force(u) - 0.5 * balance.load)
        u = u - np.linalg.solve(K, out.ravel()).reshape(-1, 3)
    two = found.improve(0.5, start, state_at(found, 0 * start), count=2)
    assert two.u == pytest.approx(u, abs=1e-8 * abs(u).max()) and two.iterations == 2 and found.factorisations == 2


@pytest.mark.parametrize("count", [1, 3])
def test_a_factor_serves_until_a_node_has_moved_by_0035_of_the_smallest_extent(count):
    """20 mm: 0.7 mm, of the guess where it is corrected once, of the last state where more often."""
    found, factors = newton(), []
    found._step = lambda force, touch: 0 * force
    found._refactor = lambda u: (factors.append(u), setattr(found.tangent, "factored_at", u), setattr(found.tangent, "stale", False))
    rest = np.zeros_like(found.balance.mesh.points)

    def moved(by):
        at = rest.copy()
        at[-1] = np.array([0.6, 0.0, -0.8]) * by
        return at

    def improve(by, other=5e-3):
        guess, last = (moved(by), moved(other)) if count == 1 else (moved(other), moved(by))
        found.improve(0.5, guess, state_at(found, last), count=count)
        return len(factors)

    assert improve(0.0) == 1  # there was none
    assert improve(0.69e-3) == 1 and improve(-0.69e-3) == 1
    assert improve(0.71e-3) == 2 and improve(1.40e-3) == 2 and improve(0.02e-3) == 2 and improve(-0.01e-3) == 3
    found.outdate()
    assert improve(-0.01e-3) == 4


def test_a_guess_that_would_buckle_is_corrected_with_the_factor_of_the_last_state():
    found = newton()
    squeezed = np.where(found.balance.fixed, 0.0, -0.6 * found.balance.mesh.points * [0, 0, 1])
    rest = np.zeros_like(squeezed)
    found.improve(0.5, squeezed, state_at(found, rest), count=1)
    assert found.tangent.definite and not found.tangent.factored_at.any() and found.factorisations == 2
    again = newton()
    again._refactor(squeezed)
    general = again.tangent.solver
    assert not again.tangent.definite and general.negative > 0
    again._refactor(rest)
    assert again.tangent.definite and again.tangent.solver is not general
    again._refactor(squeezed)
    assert again.tangent.solver is general and again.factorisations == 3 and not again.tangent.stale
    with pytest.raises(NoEquilibrium):
        again._refactor(np.full_like(rest, np.nan))
    assert again.tangent.stale


@pytest.mark.parametrize("residual, gap_error, taken", [
    (1e-6, 0.0, 1), (1.01e-6, 0.0, 4), (0.0, 0.9e-8, 1), (0.0, 1.2e-8, 4), (0.5e-6, 0.5e-8, 1), (np.nan, 0.0, 4)])
def test_they_end_at_an_equilibrium_or_when_there_are_no_more(residual, gap_error, taken):
    found = newton()
    assert found.balance.size == pytest.approx(0.01) or found.balance.size == pytest.approx(0.015)
    scale = found.balance.size / 0.01
    found._judge = lambda fraction, u, force, touch, pressure, iteration: State(
        fraction, u, pressure, np.zeros(3), iteration, residual, gap_error * scale)
    start = noise(found, 1e-5)
    assert found.improve(0.5, start, state_at(found, 0 * start), count=4).iterations == taken


def test_a_new_factor_forgets_the_steps_before_and_what_they_cost():
    found = newton()
    # Nothing known, and two steps taken for what a new factor needs.
    assert flatten(found.memory()) == {"tangent.made": 0, "tangent.fresh": 2, "tangent.excess": 0,
                                       "watch.softest": 0.0, "watch.unseen": 0.0, "watch.trusted": 0.0}
    found.tangent.excess, found._mixing.differences = 5, [(0, 0, 0)]
    at = noise(found, 1e-5)
    found._refactor(at)
    assert (found.tangent.excess, found._mixing.differences, found.tangent.stale, found.factorisations) == (0, [], False, 1)
    assert found.tangent.factored_at is at
    memory = found.memory()
    assert memory.tangent.factored_at is at and memory.tangent.learned is memory.zone is memory.mixing is None
    found.tangent.excess, found._watch, found.tangent.fresh = 3, Watch(7.0, 0.25, 0.5), 4
    memory = found.memory()
    assert (memory.tangent.made, memory.tangent.fresh, memory.tangent.excess) == (1, 4, 3) and memory.watch == Watch(7.0, 0.25, 0.5)
    other = newton()
    other.recall(memory)
    assert (other.factorisations, other.tangent.fresh, other.tangent.excess, other.tangent.stale) == (1, 4, 3, False)
    found.outdate()
    assert found.memory().tangent.factored_at is None
    other = newton()
    other.recall(found.memory())
    assert other.tangent.stale and other.factorisations == 1


def test_what_is_polished_has_a_new_factor_at_each_step_and_is_looked_at():
    found, seen = newton(), []
    at = noise(found, 1e-4)
    last = State(0.5, at, np.zeros(0))

    def solve(fraction, start, last, renew=False):
        seen.append((fraction, start is at, renew))
        return State(fraction, 2 * start, last.pressure)

    found._newton = solve
    found._refactor = lambda u: seen.append(float(abs(u - 2 * at).max()))
    found._check_stable = lambda touch, look: seen.append(int(look))
    assert found.polished(0.75, last).fraction == 0.75
    assert seen == [(0.75, True, True), 0.0, 1]
