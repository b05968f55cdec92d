"""One step of the multigrid against the dense equations, and how far it iterates."""

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.linalg import multigrid
from physics.linalg.multigrid import Felt, Multigrid, NotSolved
from physics.mesh.build import build_mesh
from tests import dense
from tests.scenes import beam

SUPPORT = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "y"}]


@pytest.fixture
def body():
    scene = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 2, 2], "cell": "hexahedron"}, support=SUPPORT)
    return Balance(scene, build_mesh(scene.body)).elasticity


def bent(body):
    return np.where(body.fixed, 0, np.random.default_rng(0).uniform(-2e-4, 2e-4, body.fixed.shape))


def solver_at(body, u):
    solver = Multigrid(body, why="as asked for")
    solver.update(u)
    return solver


def left(body, u, solution, force):
    return np.linalg.norm(dense.stiffness(body, u) @ solution.ravel() - np.where(body.fixed, 0, force).ravel())


def test_the_matrix_is_the_stiffness(body):
    """Every column: unit forces solved to 1e-10 of themselves, at two states one after the other."""
    solver = Multigrid(body, why="")
    for u in (bent(body), 0.5 * bent(body)):
        solver.update(u)
        K = dense.stiffness(body, u)
        for column in (20, 67, 100):
            force = np.where(body.fixed, 0, np.eye(body.fixed.size)[column].reshape(-1, 3))
            expected = np.linalg.solve(K, force.ravel()).reshape(-1, 3)
            assert solver.solve(force) == pytest.approx(expected, abs=1e-7 * abs(expected).max())
    assert solver.name == "none: conjugate gradients with algebraic multigrid, "


def test_a_step_without_contact_is_solved_to_a_thousandth_of_the_force(body):
    u, force = bent(body), np.random.default_rng(1).normal(size=body.fixed.shape)
    force[body.fixed] = 1e5  # what supports bear does not count
    solver = solver_at(body, u)
    step = solver.step(force, 1e-6)
    size = np.linalg.norm(force[~body.fixed])
    assert left(body, u, step, -force) <= 1.001e-3 * size
    taken = solver.iterations
    assert left(body, u, solver.solve(-force), -force) <= 1.01e-10 * size and solver.iterations - taken > 1.5 * taken
    assert abs(step[body.fixed]).max() < 1e-12 * abs(step).max()
    none = Felt(np.empty(0, int), np.empty((0, 0)), np.empty((0, 0)), np.empty(0), np.empty(0), np.empty(0))
    assert np.allclose(solver.step(force, 1e-6, none), step, rtol=0, atol=1e-1 * abs(step).max())


def felt(body, pressed, gap):
    """Four points on a face, pressed along unit vectors that are not all one; a little of the stiffness is taken by roundness."""
    rng = np.random.default_rng(3)
    cell = next(cell for cell in body.cells if (abs(body.mesh.points[cell] - [0.0525, 0.015, 0.015]) < [0.01, 0.006, 0.006]).all())
    nodes = np.sort(cell[body.mesh.points[cell, 2] > 0.02 - 1e-9]).astype(np.int64)  # two of them held aside
    weights = rng.dirichlet(np.ones(4), size=4)
    normal = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, 0.6, 0.8], [0, 0, 1.0]])
    gradient = (weights[:, :, None] * normal[:, None, :]).reshape(4, 12)
    return Felt(nodes, gradient, 0.5 * rng.normal(size=(2, 12)), np.array(gap), np.array([1e-6, 2e-6, 1.5e-6, 1e-6]), np.array(pressed))


@pytest.mark.parametrize("pressed, gap", [
    ([0.0, 0.0, 0.0, 0.0], [-1e-4, 2e-4, -5e-5, 1e-2]), ([30.0, 0.0, 20.0, 5.0], [-3e-5, 2e-4, -4e-5, 1e-2]),
    ([0.0, 0.0, 0.0, 0.0], [1e-3, 1e-2, 1e-3, 2e-3])], ids=["touched", "pressed", "open"])
def test_a_step_with_contact_is_that_of_the_active_set(body, pressed, gap):
    """(K - B^T B + G_A^T G_A / c_A) s = -r - G_A^T g_A / c_A, A the points whose gap is below zero after it: by trying all 16 sets."""
    u, contact = bent(body), felt(body, pressed, gap)
    force = np.where(body.fixed, 0, np.random.default_rng(2).normal(scale=0.02, size=body.fixed.shape))
    unknown = (3 * contact.nodes[:, None] + np.arange(3)).ravel()
    held = body.fixed.ravel()
    G, B = np.zeros((4, held.size)), np.zeros((2, held.size))
    G[:, unknown], B[:, unknown] = contact.gradient, contact.bend
    G[:, held] = B[:, held] = 0
    K, answers = dense.stiffness(body, u) - B.T @ B, []
    for number in range(16):
        active = np.array([number >> q & 1 for q in range(4)], bool)
        stiff = active / contact.softness
        s = np.linalg.solve(K + G.T @ (stiff[:, None] * G), -force.ravel() - G.T @ (stiff * contact.gap))
        after = contact.gap + G @ s
        if ((after < 0) == active).all():
            answers.append((s.reshape(-1, 3), np.where(active, -after / contact.softness, 0.0), active))
    ((expected, forces, active),) = answers
    solver = solver_at(body, u)
    before = np.linalg.norm(np.array(pressed) @ contact.gradient.reshape(4, 4, 3).sum(axis=1))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(multigrid, "FORCING", 1e-9)
        step = solver.step(force, 1e-10, contact)
    assert step == pytest.approx(expected, abs=1e-5 * abs(expected).max())
    assert contact.pressed == pytest.approx(forces, abs=1e-4 * max(forces.max(), 1e-9)) and (before > 0) == any(pressed)
    assert solver.set_ups == 1


def test_a_step_with_contact_is_solved_as_far_as_the_end_needs(body):
    """The larger of a thousandth of what is out of balance, contact included, and of a fifth of what is allowed of the reaction."""
    u, targets = bent(body), []
    force = np.where(body.fixed, 7.0, np.random.default_rng(2).normal(scale=0.02, size=body.fixed.shape))
    solver = solver_at(body, u)
    solver._solve = lambda right, nodes, contact, target: targets.append(target) or np.zeros_like(right)
    contact = felt(body, [30.0, 0.0, 20.0, 5.0], [-3e-5, 2e-4, -4e-5, -1e-2])
    push = np.zeros_like(force)
    push[contact.nodes] = (np.array([30.0, 0.0, 20.0, 5.0]) @ contact.gradient).reshape(4, 3)
    out, reaction = np.linalg.norm((force - push)[~body.fixed]), np.linalg.norm(push.sum(axis=0))
    solver.step(force, 1e-6, contact)
    solver.step(force, 0.1, felt(body, [30.0, 0.0, 20.0, 5.0], [-3e-5, 2e-4, -4e-5, -1e-2]))
    assert targets[-1] == pytest.approx(0.2 * 0.1 * reaction, rel=1e-12) and targets[0] == pytest.approx(1e-3 * out, rel=1e-12)
    assert 0.02 * reaction > 1e-3 * out
    targets.clear()
    solver.step(force, 1e-6, felt(body, [0.0, 0.0, 0.0, 0.0], [-1e-4, 2e-4, -5e-5, 1e-2]))
    assert targets == [0.0]  # nothing was pressed: as far as it goes


def test_points_that_come_and_go_for_ever_end_after_thirty_sets(body):
    solver, asked = solver_at(body, bent(body)), []

    def swing(right, nodes, contact, target):
        asked.append(1)
        moved = np.zeros_like(right)
        moved[nodes] = [0, 0, 1.0 if len(asked) % 2 else -1.0]
        return moved

    solver._solve = swing
    with pytest.raises(NotSolved, match="no set of points in contact was found in 30 attempts"):
        solver.step(np.zeros(body.fixed.shape), 1e-6, felt(body, [1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0]))
    assert len(asked) == 30


def test_a_preconditioner_is_made_anew_when_it_takes_half_as_many_more_and_five(body):
    """10 iterations with a new one: 20 are borne, 21 make the next solution begin with another; none at all, another at once."""
    solver, taken = solver_at(body, 0 * bent(body)), []
    set_up = solver._set_up
    right = np.where(body.fixed, 0, 1.0)

    def gradients(b, target):
        count = taken.pop(0)
        return abs(count), b.duplicate() if count > 0 else None

    solver._conjugate_gradients, made = gradients, []
    solver._set_up = lambda: (made.append(1), set_up())
    for count, sets in ((10, 1), (20, 1), (3, 1), (21, 1), (8, 2), (17, 2), (18, 2), (8, 3)):
        taken[:] = [count]
        solver.solve(right)
        assert len(made) == sets, count
    taken[:] = [-1000, 12]
    solver.solve(right)
    assert len(made) == 4 and not taken and solver.iterations == 10 + 20 + 3 + 21 + 8 + 17 + 18 + 8 + 1012
    taken[:] = [-1000, -1000]
    with pytest.raises(NotSolved, match="came to no solution in 1000 iterations"):
        solver.solve(right)
    assert not taken and len(made) == 5
    taken[:] = [-1000]
    with pytest.raises(NotSolved):  # a new one at once, and no other after it
        solver.solve(right)
    assert len(made) == 6 and (multigrid.ITERATIONS, multigrid.EXACT) == (1000, 1e-10)


def test_iterations_end_when_none_are_left(body, monkeypatch):
    monkeypatch.setattr(multigrid, "ITERATIONS", 1)
    with pytest.raises(NotSolved, match="in 1 iterations"):
        solver_at(body, bent(body)).solve(np.random.default_rng(0).normal(size=body.fixed.shape))
    solver = solver_at(body, bent(body))
    assert not solver.solve(np.zeros(body.fixed.shape)).any() and solver.iterations == 0
