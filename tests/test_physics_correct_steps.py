"""A correction's steps are Newton's, literally: dense stiffness, out-of-balance force, a solve by numpy."""

from types import SimpleNamespace

import numpy as np
import pytest

from physics.equilibrium.state import NoEquilibrium, State
from physics.fidelity import correct
from physics.fidelity.correct import Corrector
from physics.mesh.build import build_mesh
from tests.scenes import beam

SMALL = {"length": 0.06, "width": 0.02, "height": 0.015, "cells": [3, 1, 1], "cell": "hexahedron"}
HELD = [{"where": "x-min"}, {"where": "x-max y-min", "fixed": "z", "displacement": [0, 0, -0.003]}]
LOAD = [{"where": "x-max", "traction": [40.0, 90.0, -60.0]}]


def newton(balance, u, fraction, at=None):
    """u + K^-1 (s b - f(u)) on the free components, K that of u or of another place; held ones are at s times their target."""
    u = np.where(balance.fixed, fraction * balance.target, u)
    matrix = balance.elasticity.stiffness(u if at is None else at)
    dense = matrix[:, :]
    free = np.flatnonzero(~balance.fixed.ravel())
    dofs = balance.elasticity.space.dofs.ravel()[free]
    force = (fraction * balance.load - balance.elasticity.force(u)).ravel()[free]
    step = np.zeros(u.size)
    step[free] = np.linalg.solve(dense[np.ix_(dofs, dofs)], force)
    return u + step.reshape(u.shape)


def test_a_count_is_of_orders_of_magnitude_and_held_components_are_put_on_their_share_of_the_prescription():
    scene = beam(body=SMALL, support=HELD, load=LOAD)
    mesh = build_mesh(scene.body)
    balance = Corrector(scene, mesh).balance
    truth = np.zeros_like(mesh.points)
    for _ in range(8):
        truth = newton(balance, truth, 0.4)
    guess = truth + 3e-5 * np.random.default_rng(0).normal(size=truth.shape)
    for count in (1, 2, 3):
        corrector = Corrector(scene, mesh, count=count)
        found = corrector(guess, 0.4)
        assert np.linalg.norm(found - truth) < 0.1**count * np.linalg.norm(guess - truth)
        assert corrector.factorisations == 1 and corrector.iterations <= count + 4  # the factor is that of rest
        assert found[mesh.place("x-max y-min"), 2] == pytest.approx(-0.0012, abs=1e-15) and not found[mesh.places["x-min"]].any()


def test_without_a_count_it_is_the_solution_and_all_steps_are_counted():
    scene = beam(body=SMALL, support=HELD, load=LOAD)
    mesh = build_mesh(scene.body)
    whole = Corrector(scene, mesh, count=None)
    solution = whole(np.zeros_like(mesh.points), 1.0)
    for _ in range(8):  # literal Newton steps end where it ends
        literal = newton(whole.balance, solution, 1.0)
    np.testing.assert_allclose(solution, literal, atol=1e-7)  # residuals below 1e-6 of the reaction, of a motion of 3e-3
    first = whole.iterations
    assert first >= 3
    whole(solution, 1.0)
    assert first < whole.iterations <= first + 2
    once = Corrector(scene, mesh)
    assert once.count == 1 and once.iterations == 0
    once(solution, 1.0)  # from where there is nothing left to do one step shows that
    assert once.iterations == 1


def test_before_anything_touches_rest_is_the_answer_whatever_the_guess_and_later_it_must_be_found():
    """The plane comes down on the box for half of the path, and goes up again."""
    start, low = [0.0, 0.0, 0.0152], [0.0, 0.0, 0.0147]
    obstacle = {"shape": "half-space", "normal": [0, 0, -1], "path": [start, low, start]}
    scene = beam(body=SMALL, support=[{"where": "z-min"}], obstacle=obstacle)
    mesh = build_mesh(scene.body)
    rng = np.random.default_rng(0)
    guess = 1e-4 * rng.normal(size=mesh.points.shape)
    corrector = Corrector(scene, mesh, count=1)
    assert not corrector(guess, 0.1).any() and corrector.iterations == 0
    pressed = corrector(np.zeros_like(mesh.points), 0.5)
    assert pressed[mesh.places["z-max"], 2] == pytest.approx(-0.0003, rel=0.02)  # as far as the plane; contact gives a little
    assert corrector.iterations == 2  # the second shows that the first was good
    after = corrector(guess, 1.0)
    assert after.any() and abs(after).max() < 0.03 * abs(guess).max() and corrector.iterations > 2


@pytest.mark.parametrize("stride, reached, settled", [(0.0, [], np.arange(1, 65) / 64), (4.0, np.arange(1, 5) / 4, []),
                                                      (0.5, [1.0], [])])
def test_the_last_state_is_gone_on_from_in_halves_and_where_six_of_them_lead_nowhere_the_body_comes_to_rest(
        monkeypatch, stride, reached, settled):
    """From rest to the whole load: a stride that is too long is halved before it is tried; where none succeeds, six times each."""
    mesh = build_mesh(beam(body=SMALL).body)
    corrector, found, rested = Corrector(beam(body=SMALL, support=HELD, load=LOAD), mesh), [], []
    monkeypatch.setattr(corrector.balance, "stride", lambda start, end: stride * (end - start))

    def equilibrium(fraction, guess, last):
        if not stride:
            raise NoEquilibrium("none")
        found.append(fraction)
        assert last.fraction == (found[-2] if len(found) > 1 else 0.0)
        return State(fraction, guess, last.pressure)

    def settle(fraction, last, newton):
        rested.append(fraction)
        return State(fraction, last.u, last.pressure), None

    monkeypatch.setattr(corrector.newton, "equilibrium", equilibrium)
    monkeypatch.setattr(correct, "Relaxation", lambda balance: SimpleNamespace(settle=settle))
    last = State(0.0, np.zeros_like(mesh.points), np.zeros(0))
    assert corrector._reached(1.0, last).fraction == 1.0 and found == list(reached) and rested == list(settled)
