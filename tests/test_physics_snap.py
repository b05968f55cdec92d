"""A body left to itself: one step of its motion by whole matrices, how long steps become, and where a small arch comes to rest."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse

from physics.equilibrium import snap
from physics.equilibrium.balance import Balance
from physics.equilibrium.path import LoadPath
from physics.equilibrium.snap import Relaxation
from physics.equilibrium.state import NoEquilibrium, State
from physics.mesh.build import build_mesh
from physics.scene import Steps
from physics.solution import solve
from tests.scenes import arch, beam

BLOCK = {"length": 0.02, "width": 0.03, "height": 0.04, "cells": [1, 2, 1], "cell": "hexahedron"}
# Its edges are 8 of 15 mm, 6 of 20 mm and 6 of 40 mm: the middle is 20 mm.
SIZE, YOUNG = 0.02, 1e5


def relaxation(**changes):
    scene = beam(**({"body": BLOCK, "material": {"young_modulus": YOUNG, "poisson_ratio": 0.3},
                     "support": [{"where": "z-min", "fixed": "xyz"}],
                     "load": [{"where": "z-max", "traction": [300.0, 0.0, -500.0]}]} | changes))
    return Relaxation(Balance(scene, build_mesh(scene.body)))


def whole(body, u):
    start, column, value = body.stiffness(u).getValuesCSR()
    return scipy.sparse.csr_matrix((value, column, start)).toarray()


def test_drag_is_felt_by_the_volume_of_each_node():
    """The middle plane moved: cells of 8 and 16 cm3 whose nodes have an eighth each."""
    made = relaxation(support=[{"where": "z-min", "fixed": "z"}], load=[])
    mesh = made.balance.mesh
    points = mesh.points.copy()
    points[abs(points[:, 1] - 0.015) < 1e-9, 1] = 0.010
    mesh = replace(mesh, points=points)
    body = Balance(made.balance.scene, mesh).elasticity
    u = np.where(made.balance.fixed, 0, np.random.default_rng(0).normal(scale=1e-3, size=points.shape))
    immersed = Relaxation(Balance(made.balance.scene, mesh)).body
    immersed.added = 0.0
    assert whole(immersed, u) == pytest.approx(whole(body, u))  # without drag it is the body
    immersed.added = 3e7
    volume = 1e-6 * (1 * (points[:, 1] < 0.011) + 2 * (points[:, 1] > 0.009))
    share = body.space.to_dofs(np.where(made.balance.fixed, 0, volume[:, None]))
    expected = whole(body, u) + np.diag(3e7 * share)
    assert whole(immersed, u) == pytest.approx(expected, rel=1e-10, abs=1e-10 * abs(expected).max())


def test_the_least_drag_is_that_of_bending():
    assert relaxation().least == pytest.approx(YOUNG * SIZE**2 / 0.04**4)


@pytest.mark.parametrize("drag", [1e7, 3e8])
def test_a_step_is_one_of_implicit_euler(drag):
    made = relaxation()
    balance, body = made.balance, Balance(made.balance.scene, made.balance.mesh).elasticity
    u = np.where(balance.fixed, 0, np.random.default_rng(1).normal(scale=3e-4, size=(12, 3)))
    at, pressure, way, longest = made._euler(0.5, u, np.zeros(0), drag)
    volume = 24e-6 / 16 * np.bincount(balance.mesh.cells.ravel())
    dofs = body.space.to_dofs
    free = dofs((~balance.fixed).astype(float)) > 0
    matrix = whole(body, u) + np.diag(drag * dofs(np.repeat(volume[:, None], 3, axis=1)))
    move = np.zeros(36)
    move[free] = np.linalg.solve(matrix[np.ix_(free, free)], dofs(0.5 * balance.load - body.force(u))[free])
    assert at - u == pytest.approx(body.space.from_dofs(move), rel=1e-6, abs=1e-9 * abs(move).max())
    assert way == pytest.approx(np.linalg.norm(at - u, axis=1).max()) and longest == pytest.approx(SIZE) and not len(pressure)


def test_a_step_is_refused_when_it_is_too_long_or_its_stiffness_is_not_positive():
    made = relaxation(load=[{"where": "z-max", "traction": [0.0, 0.0, 5e5]}])
    still, squeezed = np.zeros((12, 3)), np.zeros((12, 3))
    assert made._euler(1.0, still, np.zeros(0), 1.0) is None  # five times as strong as the body is stiff: farther than a cell
    assert made._euler(0.01, still, np.zeros(0), 1.0) is not None
    assert made._euler(1.0, still, np.zeros(0), 1e12) is not None  # or with much drag
    squeezed[:, 2] = -0.95 * made.balance.mesh.points[:, 2]  # ten times shorter, nothing keeps it upright
    squeezed[:, 0] = 0.2 * made.balance.mesh.points[:, 2]
    assert made._euler(0.0, still, np.zeros(0), 1.0) is not None
    made.body.drag = 0.0
    assert np.linalg.eigvalsh(whole(made.body, squeezed)).min() < 0
    assert made._euler(0.0, squeezed, np.zeros(0), 1e-6) is None


@pytest.mark.parametrize("height, longest", [(0.006, 0.2 * SIZE + 0.006), (-1e-7, 0.2 * SIZE)])
def test_near_an_obstacle_a_step_ends_in_sight_of_it(height, longest):
    """LONGEST is 0.2 cells, 0.8 of a quarter; and what is free to it as long as it does not touch."""
    plane = {"shape": "half-space", "normal": [0.0, 0.0, -1.0], "path": [[0.0, 0.0, 0.05], [0.0, 0.0, 0.04 + height]]}
    made = relaxation(obstacle=plane, load=[])
    count = len(made.balance.contact.surface.area)
    _, pressure, _, found = made._euler(1.0, np.zeros((12, 3)), np.zeros(count), 1e9)
    assert found == pytest.approx(longest)
    assert pressure.any() == (height < 0) and len(pressure) == count


def test_the_potential_is_stored_energy_less_the_work_of_the_loads():
    made = relaxation()
    u = np.random.default_rng(2).normal(scale=3e-4, size=(12, 3))
    work = sum(0.25 * made.balance.load[a, k] * u[a, k] for a in range(12) for k in range(3))
    assert made._potential(u, 0.25) == pytest.approx(made.balance.elasticity.energy(u) - work) and abs(work) > 1e-6


class Scripted(Relaxation):
    """A relaxation whose steps end as they are told: residuals after them, or None for one that was too long."""

    def __init__(self, steps, way=0.1, founds=()):
        self.__dict__.update(relaxation().__dict__)
        self.steps, self.way, self.founds, self.drags, self.tried = iter(steps), way, iter(founds), [], []

    def _euler(self, fraction, u, pressure, drag):
        self.drags.append(drag / self.least)
        self.residual = next(self.steps)
        return None if self.residual is None else (u, pressure, self.way, 1.0)

    def _judge(self, fraction, u, force, touch, pressure, iteration):
        return State(fraction, u, pressure, iterations=iteration, residual=self.residual)

    def _finish(self, newton, fraction, state):
        self.tried.append(state.residual)
        return next(self.founds)


LAST = State(0.4, np.zeros((12, 3)), np.zeros(0))


def test_drag_doubles_after_a_step_that_was_too_long_and_halves_after_five_that_were_not(monkeypatch):
    monkeypatch.setattr(snap, "STEPS", 12)
    made = Scripted([None, None] + [1.0] * 7 + [None] + [1.0] * 2)
    with pytest.raises(NoEquilibrium, match="does not come to rest in 12 steps"):
        made.settle(0.5, LAST, None)
    assert made.drags == [1, 2, 4, 4, 4, 4, 4, 2, 1, 0.5, 1, 1]
    made = Scripted([1.0] * 12, way=0.5)  # half of the longest way is long enough
    with pytest.raises(NoEquilibrium):
        made.settle(0.5, LAST, None)
    assert made.drags == [1] * 12


def test_a_hundred_failures_in_a_row_are_enough():
    made = Scripted([None] * 100 + [1.0] + [None] * 101)
    with pytest.raises(NoEquilibrium, match="nowhere to go"):
        made.settle(0.5, LAST, None)
    assert len(made.drags) == 202


def test_it_is_finished_when_the_residual_has_fallen_to_a_tenth_and_is_small():
    """0.02 of the reaction and a tenth of the largest so far; where Newton's method fails, a tenth of what it was then."""
    end = np.zeros((12, 3))
    end[3], end[8] = [0.003, 0.0, 0.004], [0.0, 0.001, 0.0]
    made = Scripted([0.15, 0.016, 0.3, 0.021, 0.019, 0.0095, 0.0018], founds=[None, State(0.5, end, np.zeros(0))])
    state, moved, released = made.settle(0.5, LAST, None)
    assert made.tried == [0.019, 0.0018] and state.u is end and moved == pytest.approx(0.005)
    load = made.balance.load
    assert released == pytest.approx(0.5 * (load * end).sum() - made.balance.elasticity.energy(end)) and released != 0


def test_what_newton_finds_must_be_near():
    """Nearer than 0.2 of a cell, 4 mm, wherever the nodes go."""
    made = relaxation()

    class Found:
        way = 0.0

        def polished(self, fraction, state):
            if self.way is None:
                raise NoEquilibrium("none")
            u = state.u.copy()
            u[5] += [0.6 * self.way, 0.0, 0.8 * self.way]
            return replace(state, u=u, fraction=fraction)

    newton = Found()
    for way, near in ((0.0039, True), (0.0041, False), (None, False)):
        newton.way = way
        found = made._finish(newton, 0.3, LAST)
        assert (found is not None) == near
        assert not near or (found.fraction == 0.3 and found.u[5, 0] == pytest.approx(0.6 * way))


@cache
def snapped():
    """The arch's path up to its snap: what the relaxation was given, and what it gave."""
    scene, mesh, rise = arch()
    path, told = LoadPath(scene, mesh), []
    real = Relaxation.settle

    def settle(self, fraction, last, newton):
        found = real(self, fraction, last, newton)
        told.append((fraction, last, found))
        return found

    Relaxation.settle = settle
    try:
        for step in range(1, 11):
            path.advance(step / 10)
            if told:
                break
    finally:
        Relaxation.settle = real
    return path, told, rise


def test_an_arch_comes_to_rest_hanging():
    """Held against scipy's minimum of the potential near the arch turned upside down; stable, by all eigenvalues; downhill."""
    path, told, rise = snapped()
    (fraction, last, (state, moved, released)), = told
    balance = path.balance
    body, load = balance.elasticity, fraction * balance.load
    assert state.fraction == fraction and 0.8 < fraction <= 0.9
    dofs, back = body.space.to_dofs, body.space.from_dofs
    free = dofs((~balance.fixed).astype(float)) > 0
    hanging = dofs(np.where(balance.fixed, 0.0, np.outer(-2 * rise, [0, 0, 1])))

    def at(values):
        whole_field = np.zeros(free.size)
        whole_field[free] = values
        return back(whole_field)

    other = scipy.optimize.minimize(
        lambda v: body.energy(at(v)) - (load * at(v)).sum(), hanging[free], method="trust-exact",
        options={"gtol": 1e-7, "initial_trust_radius": 0.01},
        jac=lambda v: dofs(body.force(at(v)) - load)[free], hess=lambda v: whole(body, at(v))[np.ix_(free, free)])
    assert state.u == pytest.approx(at(other.x), abs=1e-5 * 0.016)  # the solver's tolerance of forces, 1e-6, in a slender body
    force = np.where(balance.fixed, 0, body.force(state.u) - load)
    assert np.linalg.norm(force) < 1e-5 * np.linalg.norm(load)
    assert np.linalg.eigvalsh(whole(body, state.u)).min() > 0
    assert moved == pytest.approx(max(np.linalg.norm(state.u - last.u, axis=1))) and moved > 0.012
    before, after = (body.energy(u) - (load * u).sum() for u in (last.u, state.u))
    assert released == pytest.approx(before - after) and released > 0


def test_a_path_goes_on_from_the_snap():
    """What the path keeps of it until the next frame: how far, how much; and one state, so that nothing is foreseen from before."""
    path, told, _ = snapped()
    (_, _, (state, moved, released)), = told
    assert path.snap == moved and path.released == released
    assert any(kept is state for kept in path.states) and min(kept.fraction for kept in path.states) == state.fraction


def test_without_snaps_the_path_ends_where_the_arch_would_snap():
    """The same way up to there, bit for bit, and a reason that says so."""
    scene, mesh, _ = arch()
    scene = replace(scene, steps=Steps(count=10))
    short, whole_path = (solve(scene, mesh=mesh, partial=True, snaps=snaps) for snaps in (False, True))
    step = int(np.flatnonzero(whole_path.snap)[0])
    assert len(short.displacement) == step and not short.snap.any()
    assert np.array_equal(short.displacement, whole_path.displacement[:step])
    assert short.failure.startswith(f"no equilibrium at step {step}") and short.failure.endswith("the path ends where the body would snap")
