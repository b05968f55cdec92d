"""One equilibrium: a step held against the dense equations, and what decides on steps, factors and looks at stability."""

from dataclasses import replace

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import ITERATIONS, TOLERANCE, Newton
from physics.equilibrium.stability import Watch
from physics.equilibrium.state import NoEquilibrium, State
from physics.mesh.build import build_mesh
from tests import dense
from tests.scenes import beam

BODY = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 2, 2], "cell": "hexahedron"}
BENT = [{"where": "x-max", "traction": [1e3, 5e2, -2e3]}]
BALL = {"shape": "sphere", "radius": 0.012, "path": [[0.05, 0.009, 0.0325], [0.051, 0.009, 0.026]]}


def newton(**changes):
    scene = beam(**({"body": BODY, "steps": {"count": 4}} | changes))
    return Newton(Balance(scene, build_mesh(scene.body)))


def rest(found):
    contact = found.balance.contact
    return State(0.0, np.zeros_like(found.balance.mesh.points), np.zeros(0 if contact is None else len(contact.surface.area)))


def scripted(found, states, *, factors=None):
    """Steps do nothing, and the states after them are said to be so far off: (residual, gap error)."""
    states = iter(states)
    found._refactor = lambda u: (factors is not None and factors.append(u.copy()), setattr(found.tangent, "stale", False),
                                 setattr(found.tangent, "excess", 0))
    found._step = lambda force, touch: np.zeros_like(force)

    def judge(fraction, u, force, touch, pressure, iteration):
        residual, gap_error = next(states)
        return State(fraction, u, pressure, np.zeros(3), iteration, residual, gap_error)

    found._judge = judge
    return found


def test_the_tolerance_is_a_millionth_of_the_reaction():
    assert TOLERANCE == 1e-6 and newton().tolerance == 1e-6 and ITERATIONS == 12
    assert Newton(newton().balance, tolerance=1e-8).tolerance == 1e-8


@pytest.mark.parametrize("residual, gap_error, ends", [
    (1e-6, 0.0, True), (1.01e-6, 0.0, False), (0.0, 1e-8, True), (0.0, 1.02e-8, False), (2e-6, 2e-8, False)])
def test_an_equilibrium_is_one_in_forces_and_in_gaps(residual, gap_error, ends):
    """Cells of 10 mm: a gap may be 1e-6 of that off."""
    found = scripted(newton(obstacle=BALL), [(residual, gap_error * (1 - 1e-9)), (1e-9, 0.0)])
    assert found.balance.size == pytest.approx(0.01)
    assert found._newton(0.5, rest(found).u, rest(found)).iterations == (1 if ends else 2)


def test_it_is_given_up_when_it_is_ten_times_as_far_off_as_before_or_not_a_number_or_after_12_steps():
    def taken(errors):
        found, left = newton(), list(errors)
        scripted(found, ((left.pop(0) * 1e-6, 0.0) for _ in range(99)))
        try:
            return found._newton(0.5, rest(found).u, rest(found)).iterations
        except NoEquilibrium as error:
            return str(error)

    assert taken([5, 4, 39, 30, 39.9, 0.5]) == 6  # the least so far is what counts
    assert taken([5, 4, 41]) == "|R| = 4.1e-05 of the reaction, a gap is 0.0e+00 m off"
    assert taken([np.inf]) == taken([5, np.nan]) == "forces are no numbers: a cell turns inside out, or they overflow"
    assert taken(11 * [5] + [0.9]) == 12 and taken(12 * [5]).startswith("|R| = 5.0e-06")


def test_a_factor_is_kept_until_the_steps_beyond_the_first_ones_outweigh_a_new_one(monkeypatch):
    """Three steps with the new factor; worth 8: 2 + 3 + 3 beyond is as much, one more is too many. Fewer steps save nothing."""
    found, factors, counts = newton(), [], iter([3, 5, 2, 6, 6, 4, 7, 9, 20, 1, 8])
    found.tangent.solver.worth = 8
    found._refactor = lambda u: (factors.append(u.copy()), setattr(found.tangent, "stale", False), setattr(found.tangent, "excess", 0))
    found._newton = lambda fraction, start, last, renew=False: State(fraction, start, last.pressure, iterations=next(counts))
    found._look = lambda state, stride: None
    made, last = [], rest(found)
    for step in range(11):
        start = np.full_like(last.u, step + 1.0)
        last = found.equilibrium(step / 10, start, last)
        made.append(len(factors))
    # 3 | 5 2 6 6 (2 + 0 + 3 + 3 = 8) 4 (9: too many) || 7 | 9 (2) 20 (15: too many) || 1 | 8 (7)
    assert made == [1, 1, 1, 1, 1, 1, 2, 2, 2, 3, 3]
    # The first at rest: predicted displacements may be far from any equilibrium. Then at the start of the step.
    assert [float(u[0, 0]) for u in factors] == [0.0, 7.0, 10.0]
    found.outdate()
    counts = iter([2])
    found.equilibrium(1.2, np.full_like(last.u, 77.0), last)
    assert len(factors) == 4 and factors[-1][0, 0] == 77.0


def test_a_worn_factor_that_leads_nowhere_is_renewed_and_then_at_each_iterate():
    found, factors, seen, last = newton(), [], [], None
    found._refactor = lambda u: (factors.append(1), setattr(found.tangent, "stale", False))
    found._look = lambda state, last: seen.append(("watch", state.iterations, state.fraction - last.fraction))
    last, found.tangent.stale = State(0.25, np.ones_like(rest(found).u), np.zeros(0)), False
    fails = {"old": True, "new": True}

    def solve(fraction, start, last, renew=False):
        kind = "each" if renew else "new" if factors else "old"
        seen.append(kind)
        if fails.get(kind):
            raise NoEquilibrium(kind)
        return State(fraction, start, last.pressure, iterations=4)

    found._newton = solve
    found.equilibrium(0.75, last.u, last)
    assert seen == ["old", "new", "each", ("watch", 4, 0.5)] and len(factors) == 1 and found.tangent.fresh == 4
    fails["new"], found.tangent.stale = False, True
    seen.clear()
    found.equilibrium(0.75, last.u, last)
    assert seen == ["new", ("watch", 4, 0.5)]
    fails |= {"new": True, "each": True}
    found.tangent.stale = True
    with pytest.raises(NoEquilibrium, match="each"):
        found.equilibrium(0.75, last.u, last)


@pytest.mark.parametrize("worth", [0, 8, 10**9])
def test_too_old_a_factor_still_gives_the_same_answer(worth):
    """The factor of the rest state, or a new one for every step: the same bent beam to the tolerance, by the dense equations."""
    found = newton(load=[{"where": "x-max", "traction": [0.0, 2e3, -8e3]}])
    balance, last = found.balance, rest(found)
    found.tangent.solver.worth, found._watch = worth, Watch(trusted=1e9)  # and no looks at stability
    for fraction in np.arange(1, 9) / 8:
        last = found.equilibrium(float(fraction), last.u, last)
        assert last.residual <= 1e-6
    # New ones are made whenever a step was more than the first time, or only where the old one led nowhere.
    low, high = {0: (4, 8), 8: (1, 4), 10**9: (1, 3)}[worth]
    assert low <= found.factorisations <= high
    exact = last.u
    for _ in range(3):  # full Newton from there
        exact = exact - dense.solved(balance.elasticity, exact, balance.elasticity.force(exact) - balance.load)
    assert abs(exact).max() > 0.01, abs(exact).max()  # a sixth of the length
    # 1e-6 of the force; a beam turns that into up to ten times as much of its displacement.
    assert abs(last.u - exact).max() < 1e-5 * abs(exact).max()


def test_the_softest_mode_is_that_of_inverse_iteration():
    found = newton()
    found._refactor(np.zeros_like(found.balance.mesh.points))
    K = dense.stiffness(found.balance.elasticity, np.zeros_like(found.balance.mesh.points))
    free = np.flatnonzero(~found.balance.fixed.ravel())
    mode = np.cos(np.arange(K.shape[0]))[free]
    for _ in range(3):
        mode = np.linalg.solve(K[np.ix_(free, free)], mode / np.linalg.norm(mode))
    assert found._softest_mode() == pytest.approx(1 / np.linalg.norm(mode), rel=1e-9)
    least = np.linalg.eigvalsh(K[np.ix_(free, free)])[0]
    assert least <= found._softest_mode() < 1.1 * least


def test_looks_at_stability_come_when_three_tenths_of_the_softest_stiffness_could_be_gone():
    """Softest 10 at rest. Each row: stride, whether it looks, what it finds, and how much of the loading it then trusts."""
    found, softest, factors = newton(), [], []
    found._refactor = lambda u: factors.append(u.copy())
    found._softest_mode = lambda: softest.pop(0)
    checked = []
    found._check_stable = lambda touch, look: checked.append(int(look))
    u = np.ones_like(rest(found).u)
    rows = [
        (0.01, [10.0, 10.0], 0.02),  # no loss: twice as much as from the last look
        (0.015, None, 0.02),
        (0.015, [8.0], 0.036),  # over 0.03 a loss of (10 - 8) / 8 / 0.03 = 8.33 for all of it: 0.3 / 8.33 = 0.036
        (0.036, [8.0], 0.05),  # none: twice 0.036, but 0.05 at most
        (0.05, [9.0], 0.05),  # stiffer
        (0.1, [3.0], 0.3 / (6 / 3 / 0.1)),
        (0.014, None, 0.015), (0.001, [1.0], 0.3 / (2 / 1 / 0.015)),
    ]
    for i, (stride, finds, trusted) in enumerate(rows):
        softest[:] = finds or []
        before = len(factors)
        found.tangent.stale, found.tangent.giving = True, 0
        found._look(State(stride, u, np.zeros(0)), State(0.0, u, np.zeros(0)))
        assert len(factors) - before == (0 if finds is None else 1 + (i == 0)) and not softest
        assert found._watch.trusted == pytest.approx(trusted, rel=1e-12)
        assert found._watch.unseen == pytest.approx(0.015 if i == 1 else 0.014 if i == 6 else 0.0)
        assert found.tangent.stale == (finds is None) and len(checked) == sum(row[1] is not None for row in rows[:i + 1])
    assert not factors[0].any() and all((at == 1).all() for at in factors[1:]) and set(checked) == {1}
    linear = newton(material={"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.4})
    linear._refactor = lambda u: pytest.fail("a linear body is as stable as it was")
    linear._look(State(1.0, u, np.zeros(0)), State(0.0, u, np.zeros(0)))


@pytest.mark.parametrize("load, at, made", [
    ({}, 0.0, 1), ({}, 1e-6, 2), ({"where": "x-max", "pressure": 1e3, "follower": True}, 0.0, 2)])
def test_the_first_look_takes_the_factor_of_rest_where_there_is_one(load, at, made):
    """One at rest and one at the state, or only that; a pressure that follows its face is another stiffness at rest by now."""
    found = newton(load=[load or BENT[0]])
    state = State(0.25, np.where(found.balance.fixed, 0.0, 1e-5), np.zeros(0))
    found._refactor(np.where(found.balance.fixed, 0.0, at))
    before = found.factorisations
    found._look(state, rest(found))
    assert found.factorisations - before == made and np.array_equal(found.tangent.factored_at, state.u)
    bare = newton()  # whose softest mode is known from its own factor; the state is hardly bent
    bare._refactor(np.zeros_like(state.u))
    assert found._watch.softest == pytest.approx(bare._softest_mode(), rel=1e-2) and 0 < found._watch.trusted <= 0.05


def test_an_unstable_state_that_is_found_leaves_the_factor_stale():
    found = newton()
    found._refactor = lambda u: setattr(found.tangent, "stale", False)
    found._softest_mode = lambda: 1.0

    def unstable(touch, look):
        raise NoEquilibrium("unstable")

    found._check_stable = unstable
    with pytest.raises(NoEquilibrium):
        found._look(replace(rest(found), fraction=1.0), rest(found))
    assert found.tangent.stale


def test_a_body_that_is_touched_anew_is_looked_at_at_once():
    found, looks = newton(), []
    found._refactor = looks.append
    found._softest_mode, found._check_stable = lambda: 4.0, lambda touch, look: None
    found._watch = Watch(4.0, trusted=0.05)
    u = np.ones_like(rest(found).u)
    free, touched = (State(0.5, u, np.array([0.0, force])) for force in (0.0, 1.0))
    for last, now, at_once in ((free, free, 0), (touched, touched, 0), (touched, free, 0), (free, touched, 1)):
        found._look(replace(now, fraction=0.501), last)
        assert len(looks) == at_once


@pytest.mark.parametrize("giving, held, stable", [(0, 0, True), (1, 0, False), (1, 1, True), (2, 1, False), (2, 2, True)])
def test_contact_must_hold_every_direction_in_which_the_body_would_give_way(giving, held, stable):
    found = newton(obstacle=BALL)
    touch = found._touch(1.0, rest(found).u, np.ones_like(rest(found).pressure))
    assert len(touch.gap) > 3

    class Given:
        negative = giving

    found.tangent.solver, found.tangent.giving = Given(), giving
    signs = np.where(np.arange(len(touch.gap)) < held, -1.0, 1.0)

    class Found:
        matrix = np.diag(signs)

    found.tangent._condense = lambda *_: Found()
    if stable:
        found._check_stable(touch)
    else:
        with pytest.raises(NoEquilibrium, match="the body is unstable"):
            found._check_stable(touch)
    if giving:  # contact without force holds nothing, and so does none
        found.tangent.giving = giving
        with pytest.raises(NoEquilibrium):
            found._check_stable(replace(touch, pressure=0 * touch.pressure))
        found.tangent.giving = giving
        with pytest.raises(NoEquilibrium):
            found._check_stable(None)


def test_held_components_are_led_and_the_body_follows_to_first_order():
    """What is linear follows exactly: forces that were in balance still are."""
    ends = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "yz", "displacement": [0.0, 0.002, -0.004]}]
    found = newton(material={"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.4}, support=ends)
    balance = found.balance
    load = np.random.default_rng(0).normal(size=balance.fixed.shape)
    u = dense.solved(balance.elasticity, 0 * load, load)
    before = balance.elasticity.force(u)[~balance.fixed]
    led = found.led(u, balance.target)
    assert np.array_equal(led[balance.fixed], balance.target[balance.fixed])
    # The difference of forces is divided by the short way, 1e-4 of a cell: rounding of 1e-16 f becomes some 1e-11 f.
    assert balance.elasticity.force(led)[~balance.fixed] == pytest.approx(before, abs=1e-7 * abs(before).max())
    found.tangent.solve = lambda force: pytest.fail("too short a way to solve for")
    short = 0.99e-6 * balance.size
    way = np.where(balance.fixed, short, 5.0)  # free components have no target
    assert np.array_equal(found.led(u, u + way), np.where(balance.fixed, u + short, u))
    with pytest.raises(pytest.fail.Exception):
        found.led(u, u - 1.02 / 0.99 * way)


def test_a_bent_body_is_led_by_its_own_stiffness():
    ends = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "z", "displacement": [0.0, 0.0, -0.004]}]
    found = newton(support=ends)
    u = np.random.default_rng(1).normal(scale=2e-4, size=found.balance.fixed.shape) * ~found.balance.fixed
    elasticity, way = found.balance.elasticity, 0.1 * found.balance.target
    free = ~found.balance.fixed
    K = np.concatenate([(elasticity.force(u + e) - elasticity.force(u - e)).reshape(1, -1) / 2e-9 for e in  # columns, held ones too
                        1e-9 * np.eye(u.size).reshape(-1, *u.shape)]).T
    at = free.ravel()
    expected = u + way
    expected[free] -= np.linalg.solve(K[np.ix_(at, at)], (K @ way.ravel())[at])
    # The way is taken for linear over 1e-4 of a cell of 1 cm, against strains of some per cent.
    assert found.led(u, u + way) == pytest.approx(expected, abs=1e-3 * abs(way).max())
    assert found.factorisations == 1  # there was none
    found.led(u, u + way)
    assert found.factorisations == 1
