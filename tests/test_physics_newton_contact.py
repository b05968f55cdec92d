"""Contact in Newton's steps: against the equations of the step as full matrices, and what counts as error."""

from functools import cache

import numpy as np
import pytest
import scipy.optimize

from physics.contact.touch import Touch
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton, NewtonMemory
from physics.equilibrium.state import State
from physics.journal import flatten, unflatten
from physics.linalg import multigrid
from physics.linalg.factor import solver_for
from physics.linalg.multigrid import Multigrid
from physics.mesh.build import build_mesh
from tests import dense
from tests.scenes import beam

BODY = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 2, 2], "cell": "hexahedron"}
BALL = {"shape": "sphere", "radius": 0.012, "path": [[0.05, 0.009, 0.0325], [0.051, 0.009, 0.026]]}
FRACTION = 0.75


def newton(method=None, **changes):
    scene = beam(**({"body": BODY, "obstacle": BALL, "steps": {"count": 4}} | changes))
    return Newton(Balance(scene, build_mesh(scene.body), method=method))


@cache
def bent():
    """A body pressed by a ball beside its middle, and the forces there."""
    found = newton()
    last = State(0.0, np.zeros_like(found.balance.mesh.points), np.zeros(len(found.balance.contact.surface.area)))
    for fraction in (0.35, 0.55, FRACTION):
        last = found.equilibrium(fraction, last.u, last)
    return found, last


def turning(contact, u, centre, pressure):
    """(3 N, 3 N) sum of p_q d2 g_q / du2, by central differences of the normals."""
    weights, step = contact.surface.weights.toarray(), 1e-7
    x, count = contact.surface.positions(contact.rest + u), u.size
    slope = np.stack([(contact.obstacle.gap(x + step * e, centre)[1] - contact.obstacle.gap(x - step * e, centre)[1]) / (2 * step)
                      for e in np.eye(3)], axis=2)  # (Q, 3, 3)
    return np.einsum("q,qa,qb,qij->aibj", pressure, weights, weights, slope).reshape(count, count)


def test_what_presses_are_the_points_with_a_force_and_no_others():
    found, last = bent()
    points = np.flatnonzero(last.pressure)
    felt = found.pressing(last)
    contact, x = found.balance.contact, last.u
    gap, normal = contact.gaps(x, contact.obstacle.position(FRACTION))
    assert 0 < len(points) < found._touch(FRACTION, x, last.pressure).zone.weights.shape[0]  # of all that are near
    assert np.array_equal(felt.pressed, last.pressure[points]) and np.allclose(felt.gap, gap[points], rtol=0, atol=1e-15)
    # A row's entries are the shares of the nodes behind a point times its normal, and the shares add up to one.
    rows = felt.gradient.reshape(len(points), -1, 3)
    assert np.allclose(rows.sum(axis=1), normal[points], rtol=0, atol=1e-12)
    assert found.pressing(State(0.0, np.zeros_like(x), np.zeros_like(last.pressure))) is None
    assert newton(obstacle=None).pressing(State(0.0, np.zeros_like(x), np.zeros(0))) is None


@pytest.mark.parametrize("method", [None, "multigrid"])
def test_a_step_solves_the_linearised_equations_with_contact(method, monkeypatch):
    """(K - sum p H) s = -r + G^T p', g + G s + c p' = 0 where p' > 0, and > 0 elsewhere; from a state that is nowhere near balance."""
    _, state = bent()
    found = newton(method)
    balance, contact = found.balance, found.balance.contact
    rng = np.random.default_rng(0)
    u = state.u + np.where(balance.fixed, 0, rng.normal(scale=2e-5, size=state.u.shape))
    centre = contact.obstacle.position(FRACTION)
    # By a thousandth of a cell deep or away from the obstacle: some points come in and some go out.
    pressure = state.pressure * rng.uniform(0.5, 1.5, len(state.pressure))
    force = balance.elasticity.force(u) - FRACTION * balance.load
    touch = found._touch(FRACTION, u, pressure)
    assert (touch.pressure > 0).sum() >= 2 and len(touch.gap) < len(pressure)
    if method is None:
        found._refactor(u)
    else:
        found.tangent.solver.update(u)
        found.tolerance = 1e-12
        monkeypatch.setattr(multigrid, "FORCING", 1e-9)
    step = found._step(force, touch)
    new = found._on_surface(touch, pressure)
    gap, normal = contact.gaps(u, centre)
    K = dense.stiffness(balance.elasticity, u)
    free = np.flatnonzero(~balance.fixed.ravel())
    K = (K - turning(contact, u, centre, pressure))[np.ix_(free, free)]
    G = (contact.surface.weights.toarray()[:, :, None] * normal[:, None, :]).reshape(len(gap), -1)[:, free]
    pushed, moved = -force.ravel()[free] + G.T @ new, step.ravel()[free]
    assert abs(step[balance.fixed]).max() < 1e-12 * abs(step).max() and new.min() == 0 and 2 <= (new > 0).sum()
    # Iterated to 1e-9 of the force that is out of balance, where stiff contact leaves rounding of 1e-8.
    limit = (1e-12 if method is None else 1e-7) * abs(force).max()
    assert K @ moved == pytest.approx(pushed, abs=limit)
    after = gap + G @ moved + contact.softness * new
    near = np.isin(np.arange(len(gap)), touch.zone.points)
    assert after[new > 0] == pytest.approx(0, abs=1e-9 * abs(step).max()) and after[near].min() > -1e-9 * abs(step).max()
    # What the obstacle's roundness takes is no small change.
    straight = dense.stiffness(balance.elasticity, u)[np.ix_(free, free)]
    assert abs(straight @ moved - pushed).max() > 10 * limit


def test_the_equilibrium_is_one_by_its_definition():
    """Forces, contact and the reaction from the whole surface, none of it by way of zones; the figures of the state are these."""
    found, state = bent()
    balance, contact = found.balance, found.balance.contact
    gap, normal = contact.gaps(state.u, contact.obstacle.position(FRACTION))
    out = balance.elasticity.force(state.u) - contact.forces(state.pressure, normal)
    push = (state.pressure[:, None] * normal).sum(axis=0)
    assert state.reaction == pytest.approx(-push, rel=1e-12) and push[2] < 0 and abs(push[1]) > 1e-3 * abs(push[2])
    residual = np.linalg.norm(out[~balance.fixed]) / np.linalg.norm(push)
    # The sum of forces that balance to 1e-7: rounding.
    assert state.residual == pytest.approx(residual, rel=1e-5, abs=1e-12) and state.residual <= 1e-6
    assert state.penetration == pytest.approx(-gap.min(), rel=1e-9) and gap.min() < 0
    off = [abs(g + c * p) if p > 0 else max(0.0, -g) for g, c, p in zip(gap, contact.softness, state.pressure, strict=True)]
    assert state.gap_error == pytest.approx(max(off), rel=1e-6) and state.gap_error <= 1e-6 * 0.01
    assert out[balance.fixed].reshape(-1, 3).sum(axis=0) == pytest.approx(-push, abs=1e-5 * np.linalg.norm(push))  # supports bear it


def judged(gap, pressure, *, force=None, found=None):
    """What is said of given gaps and forces at the points of a zone."""
    found = found or newton()
    u = np.zeros_like(found.balance.mesh.points)
    touch = found._touch(1.0, u, np.zeros(len(found.balance.contact.surface.area)))
    gaps, pushes = np.full(len(touch.gap), 0.5), np.zeros(len(touch.gap))
    gaps[:len(gap)], pushes[:len(pressure)] = gap, pressure
    normal = np.tile([0.0, 0.6, -0.8], (len(gaps), 1))
    touch = Touch(touch.zone, u, touch.centre, gaps, normal, pushes)
    force = touch.zone.forces(pushes, normal) if force is None else force
    whole = np.zeros_like(u)
    whole[touch.zone.nodes] = force
    return found._judge(0.5, u, whole, touch, found._on_surface(touch, np.zeros(len(found.balance.contact.surface.area))), 7), touch


def test_penetration_without_force_is_an_error_too():
    state, touch = judged([-3e-4, 2e-4, 1.0], [0.0, 0.0, 0.0])
    assert state.gap_error == state.penetration == 3e-4 and (state.fraction, state.iterations) == (0.5, 7)
    state, touch = judged([4e-4, -1e-5], [0.0, 0.0])
    assert state.gap_error == state.penetration == 1e-5
    state, touch = judged([4e-4, 1e-3], [0.0, 0.0])
    assert state.gap_error == state.penetration == 0.0  # open
    state, touch = judged([4e-4, 1e-3], [0.0, 2.0])  # a force across a gap
    assert state.gap_error == pytest.approx(1e-3 + 2 * touch.zone.softness[1], rel=1e-12) and state.penetration == 0
    soft = touch.zone.softness
    state, _ = judged([-3 * soft[0], -2.5 * soft[1], -soft[2]], [3.0, 2.0, 1.0])  # as deep as its force says, but for the second
    assert state.gap_error == pytest.approx(0.5 * soft[1], rel=1e-9)
    assert state.penetration == pytest.approx(max(3 * soft[0], 2.5 * soft[1], soft[2]), rel=1e-12)


def test_the_residual_is_what_is_left_of_the_force_over_the_reaction():
    """2 + 3 N along (0, 0.6, -0.8): 5 N; forces of 3 and 4 N beside those of contact on free components, and any on held ones."""
    found = newton()
    state, touch = judged([0, 0], [2.0, 3.0], found=found)
    assert state.residual == pytest.approx(0, abs=1e-15) and state.reaction == pytest.approx([0, -3.0, 4.0])
    balanced = touch.zone.forces(touch.pressure, touch.normal)
    more = balanced.copy()
    more[0, 2] += 3.0
    more[-1, 0] -= 4.0
    assert judged([0, 0], [2.0, 3.0], force=more, found=found)[0].residual == pytest.approx(1.0, rel=1e-12)
    # Without any force of contact: over those at the supports; without these, over a million times what rounding leaves.
    free = np.zeros_like(balanced)
    free[0, 1] = 1e-3 * found.balance.floor
    assert judged([1], [0.0], force=free, found=found)[0].residual == pytest.approx(1e-9, rel=1e-9)
    u, force = np.zeros_like(found.balance.mesh.points), np.zeros_like(found.balance.mesh.points)
    held = np.flatnonzero(found.balance.fixed.all(axis=1))
    force[held[0]], force[held[1]], force[-1] = [3.0, 0.0, 4.0], [-3.0, 0.0, -4.0], [0.5, 0.0, 0.0]
    state = found._judge(0.5, u, force, None, np.zeros(0), 1)
    assert state.residual == pytest.approx(0.5 / np.sqrt(50)) and not state.reaction.any()
    force[held[1]] = [0.0, 2.0, 0.0]
    state = found._judge(0.5, u, force, None, np.zeros(0), 1)
    assert state.reaction == pytest.approx([-3, -2, -4]) and state.residual == pytest.approx(0.5 / np.sqrt(29))
    assert (state.gap_error, state.penetration) == (0.0, 0.0)


def test_a_zone_is_made_anew_when_a_point_beyond_it_could_be_near():
    """It reaches two cells far; a quarter of a cell is near: 1.75 cells of 10 mm together, of the body and of the obstacle."""
    found = newton()
    u, pressure = np.zeros_like(found.balance.mesh.points), np.zeros(len(found.balance.contact.surface.area))
    found._touch(0.0, u, pressure)
    zone = found._zone
    x = found.balance.contact.surface.positions(found.balance.mesh.points)
    gap = np.linalg.norm(x - [0.05, 0.009, 0.0325], axis=1) - 0.012
    assert zone.points.tolist() == np.flatnonzero(gap < 0.02).tolist() and 0 < len(zone.points) < len(x)
    way = np.linalg.norm([0.001, 0.0, -0.0065])
    aside = np.zeros_like(u)
    aside[-1, 1] = 0.0174 - way
    found._touch(1.0, aside, pressure)
    assert found._zone is zone
    aside[-1, 1] = 0.0176 - way
    found._touch(1.0, aside, pressure)
    assert found._zone is not zone


def test_what_is_remembered_makes_the_next_equilibrium_the_same_to_the_bit():
    """Another solver, told the memory, against the one whose it is. The code against itself: that is the law here."""
    first, last = newton(), None
    last = State(0.0, np.zeros_like(first.balance.mesh.points), np.zeros(len(first.balance.contact.surface.area)))
    for fraction in (0.35, 0.55, 0.75):
        last = first.equilibrium(fraction, last.u, last)
    memory = flatten(first.memory())
    tangent = {f"tangent.{name}" for name in ("made", "fresh", "excess", "factored_at", "learned", "learned_in")}
    assert tangent | {"watch.softest", "watch.unseen", "watch.trusted", "zone.u", "zone.centre"} <= set(memory)
    assert {"mixing.u", "mixing.step", "mixing.pressure"} <= set(memory) or not first._mixing.differences
    second = newton()
    second.recall(unflatten(NewtonMemory, memory))
    again = flatten(second.memory())
    assert sorted(again) == sorted(memory)
    for name, array in memory.items():
        assert np.array_equal(again[name], array), name
    one, two = first.equilibrium(0.9, last.u, last), second.equilibrium(0.9, last.u, last)
    assert np.array_equal(one.u, two.u) and np.array_equal(one.pressure, two.pressure) and one.iterations == two.iterations
    assert first.factorisations == second.factorisations and first._watch == second._watch


def test_one_step_that_corrects_is_that_of_the_dense_equations():
    """From any displacements, no forces known: p' >= 0 by non-negative least squares over all points, then s = K^-1 (G^T p' - r)."""
    state, found = bent()[1], newton(load=[{"acceleration": [1.0, 2.0, -3.0]}])
    balance, contact, u = found.balance, found.balance.contact, 0.9 * state.u
    free = np.flatnonzero(~balance.fixed.ravel())
    K = dense.stiffness(balance.elasticity, u)[np.ix_(free, free)]
    gap, normal = contact.gaps(u, contact.obstacle.position(FRACTION))
    G = (contact.surface.weights.toarray()[:, :, None] * normal[:, None, :]).reshape(len(gap), -1)[:, free]
    out = (balance.elasticity.force(u) - FRACTION * balance.load).ravel()[free]
    matrix, unpushed = G @ np.linalg.solve(K, G.T) + np.diag(contact.softness), gap - G @ np.linalg.solve(K, out)
    lower = np.linalg.cholesky(matrix)
    pressure = scipy.optimize.nnls(lower.T, -np.linalg.solve(lower, unpushed))[0]
    expected = np.linalg.solve(K, G.T @ pressure - out)
    assert found.correction(FRACTION, u).ravel()[free] == pytest.approx(expected, abs=1e-7 * abs(expected).max())
    assert (pressure > 0).any() and found.factorisations == 1 and abs(expected).max() > 1e-4


def test_a_multigrid_takes_the_stiffness_of_each_iterate():
    found, state = newton("multigrid"), bent()[1]
    assert isinstance(found.tangent.solver, Multigrid) and not isinstance(solver_for(found.balance.elasticity), Multigrid)
    last = State(0.0, np.zeros_like(state.u), np.zeros_like(state.pressure))
    for fraction in (0.35, 0.55, FRACTION):
        last = found.equilibrium(fraction, last.u, last)
    assert abs(last.u - state.u).max() < 1e-5 * abs(state.u).max() and last.residual <= 1e-6
    assert found.factorisations == found.tangent.solver.set_ups >= 1
