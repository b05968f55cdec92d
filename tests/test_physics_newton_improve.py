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


def test_a_step_is_newtons_with_the_factor_of_the_last_state():
    found = newton()
    balance, start, last = found.balance, noise(newton(), 1e-4), noise(newton(), 1e-5)
    K = dense.stiffness(balance.elasticity, last)
    out = np.where(balance.fixed, 0, balance.elasticity.force(start) - 0.5 * balance.load)
    expected = start - np.linalg.solve(K, out.ravel()).reshape(-1, 3)
    one = found.improve(0.5, start, state_at(found, last), guess=start, share=1.0)
    assert one.u == pytest.approx(expected, abs=1e-8 * abs(expected).max()) and (one.iterations, one.fraction) == (1, 0.5)
    assert found.factorisations == found.taken == 1 and (found.tangent.factored_at == last).all()


def test_steps_end_at_a_share_of_the_way_from_the_guess():
    """Steps that are made up: 1, 0.2, 0.04 ... of a way; after two the state is 2.2 from the guess, and 0.2 / 2.2 is 0.0909."""
    for share, taken in [(1.0, 1), (0.91, 1), (0.2, 2), (0.091, 2), (0.0908, 3), (0.0179, 3), (0.0178, 4)]:
        found = newton()
        way = noise(found, 1e-4)
        steps = iter(way * 0.2**k for k in range(9))
        found._step = lambda force, touch, steps=steps: next(steps)
        found._mixing.next = lambda u, step, pressure: (u + step, pressure)
        found._judge = lambda fraction, u, *rest: State(fraction, u, np.zeros(0), residual=1.0)
        state = found.improve(0.5, way, state_at(found, 0 * way), guess=0 * way, share=share)
        assert state.iterations == taken, share
        assert state.u == pytest.approx(way * (1 + sum(0.2**k for k in range(taken))))


@pytest.mark.parametrize("factor, said", [(2.1, "grow"), (np.nan, "grow"), (0.9, "slowly"), (1.9, "slowly")])
def test_steps_that_lead_nowhere_are_said_to(factor, said):
    found = newton()
    way = noise(found, 1e-4)
    steps = iter(way * (-factor)**k for k in range(9))
    found._step = lambda force, touch: next(steps)
    found._mixing.next = lambda u, step, pressure: (u + step, pressure)
    found._judge = lambda fraction, u, *rest: State(fraction, u, np.zeros(0), residual=1.0)
    with pytest.raises(NoEquilibrium, match=said):
        found.improve(0.5, way, state_at(found, 0 * way), guess=0 * way, share=1e-3)


def test_a_factor_serves_until_a_node_has_moved_by_a_tenth_of_the_smallest_extent():
    """20 mm: 2 mm, of the last state."""
    found, factors = newton(), []
    found._step = lambda force, touch: 0 * force
    found._refactor = lambda u: (factors.append(u), setattr(found.tangent, "factored_at", u), setattr(found.tangent, "stale", False))
    rest = np.zeros_like(found.balance.mesh.points)

    def improve(by):
        last = rest.copy()
        last[-1] = np.array([0.6, 0.0, -0.8]) * by
        found.improve(0.5, rest + 5e-3, state_at(found, last), guess=rest, share=1.0)
        return len(factors)

    assert improve(0.0) == 1  # there was none
    assert improve(1.99e-3) == 1 and improve(-1.99e-3) == 1
    assert improve(2.01e-3) == 2 and improve(4.00e-3) == 2 and improve(0.02e-3) == 2 and improve(-0.01e-3) == 3
    found.outdate()
    assert improve(-0.01e-3) == 4


def test_a_last_state_that_is_not_stable_is_not_gone_on_from():
    found = newton()
    squeezed = np.where(found.balance.fixed, 0.0, -0.6 * found.balance.mesh.points * [0, 0, 1])
    rest = np.zeros_like(squeezed)
    with pytest.raises(NoEquilibrium, match="unstable"):
        found.improve(0.5, rest, state_at(found, squeezed), guess=rest, share=1.0)
    assert not found.tangent.definite
    found.outdate()
    assert found.improve(0.5, squeezed, state_at(found, rest), guess=rest, share=np.inf).iterations == 1 and found.tangent.definite


@pytest.mark.parametrize("residual, gap_error, taken", [
    (1e-6, 0.0, 1), (1.01e-6, 0.0, 4), (0.0, 0.9e-8, 1), (0.0, 1.2e-8, 4), (0.5e-6, 0.5e-8, 1), (np.nan, 0.0, 4)])
def test_they_end_at_an_equilibrium(residual, gap_error, taken):
    found = newton()
    scale = found.balance.size / 0.01
    found._judge = lambda fraction, u, force, touch, pressure, iteration: State(
        fraction, u, pressure, np.zeros(3), iteration, residual, gap_error * scale)
    way = noise(found, 1e-5)
    steps = iter(way * 0.1**k for k in range(9))
    found._step = lambda force, touch: next(steps)
    found._mixing.next = lambda u, step, pressure: (u + step, pressure)
    found.improve(0.5, way, state_at(found, 0 * way), guess=way, share=2e-3)
    assert len(list(steps)) == 9 - taken


def test_a_new_factor_forgets_the_steps_before_and_what_they_cost():
    found = newton()
    # Nothing known, and two steps taken for what a new factor needs.
    assert flatten(found.memory()) == {"tangent.made": 0, "tangent.fresh": 2, "tangent.excess": 0, "tangent.double": True,
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
