"""The kept factor, with a body of two nodes whose stiffness is a matrix that numpy solves: steps, signs, when it is stale, memory."""

import numpy as np
import pytest

from physics.equilibrium import tangent
from physics.equilibrium.balance import Balance
from physics.equilibrium.state import NoEquilibrium
from physics.equilibrium.tangent import Iterated, KeptFactor, TangentMemory
from physics.linalg.cholesky import NotPositiveDefinite
from physics.linalg.multigrid import Felt, NotSolved
from physics.mesh.build import build_mesh
from tests.scenes import beam

GENERATOR = np.random.default_rng(0)
HALF = GENERATOR.normal(size=(6, 6))
STIFFNESS = HALF @ HALF.T + np.diag([3.0, 4, 5, 6, 7, 8])  # no component is like another
FORCE = np.array([[1.0, -2, 3], [-4, 5, 6]])


class Dense:
    """A factor of a given matrix, with the interface of the others; what it learns is noted."""

    worth, double = 8, True

    def __init__(self, matrix):
        self.inverse = np.linalg.inv(matrix)
        self.negative = int((np.linalg.eigvalsh(matrix) < 0).sum())
        self.learned, self.updated = [], []

    def widen(self):
        pass

    def update(self, u):
        self.updated.append(u)
        self.learned = []

    def learn(self, nodes):
        self.learned.append(nodes)

    def compliance(self, nodes):
        at = (3 * nodes[:, None] + np.arange(3)).ravel()
        return self.inverse[np.ix_(at, at)]

    def solve(self, force):
        return (self.inverse @ force.ravel()).reshape(-1, 3)

    begin = solve

    def at(self, begun, nodes):
        return begun[nodes]

    def finish(self, begun, nodes=None, push=None):
        if nodes is None:
            return begun
        force = np.zeros_like(begun)
        force[nodes] = push
        return begun + self.solve(force)


def felt(gap, gradient, bend=None, pressed=0.0):
    """One point of contact, soft by 0.01 m/N, that feels the second node."""
    return Felt(np.array([1]), np.array([gradient]), np.zeros((0, 3)) if bend is None else np.array([bend]), np.array([gap]),
                np.array([0.01]), np.array([pressed]))


def test_a_step_without_contact_is_minus_the_force_over_the_stiffness():
    kept = KeptFactor(Dense(STIFFNESS))
    assert kept.step(FORCE, 1e-6, None).ravel() == pytest.approx(np.linalg.solve(STIFFNESS, -FORCE.ravel()))
    assert kept.solve(FORCE).ravel() == pytest.approx(np.linalg.solve(STIFFNESS, FORCE.ravel()))
    assert kept.giving == 0


@pytest.mark.parametrize("bend", [None, [0.3, -0.2, 0.1]])
@pytest.mark.parametrize("gap, touches", [(-0.4, True), (5.0, False)])
def test_a_step_with_contact_solves_the_whole_system_at_once(gap, touches, bend):
    """(K - B^T B) s = -f + G^T p with gap + G s + c p = 0 where it presses, and p = 0 where the gap stays open."""
    gradient = np.array([0.1, -0.3, 0.9])
    point = felt(gap, gradient, bend)
    step = KeptFactor(Dense(STIFFNESS)).step(FORCE, 1e-6, point).ravel()
    row, curved = np.append(np.zeros(3), gradient), np.append(np.zeros(3), bend if bend else np.zeros(3))
    whole = STIFFNESS - np.outer(curved, curved)
    if touches:
        system = np.block([[whole, -row[:, None]], [row[None], np.array([[0.01]])]])
        *right, pressure = np.linalg.solve(system, np.append(-FORCE.ravel(), -gap))
        assert pressure > 0
    else:
        right, pressure = np.linalg.solve(whole, -FORCE.ravel()), 0.0
        assert gap + row @ right > 0
    assert step == pytest.approx(np.array(right)) and point.pressed == pytest.approx([pressure])


def test_contact_holds_a_body_as_sylvesters_law_says():
    """One direction gives way, -1 at the second node's z: a stiff enough point in that direction holds it, one across does not."""
    down = np.diag([1.0, 1, 1, 1, 1, -1])
    kept = KeptFactor(Dense(down))
    assert not kept.held(None) and kept.giving == 1
    assert kept.held(felt(0.0, [0.0, 0, 1]))  # -1 + 1 / 0.01 > 0
    assert not kept.held(felt(0.0, [0.0, 1, 0]))
    assert not kept.held(felt(0.0, [0.0, 0, 0.05]))  # -1 + 0.0025 / 0.01 < 0
    assert KeptFactor(Dense(STIFFNESS)).held(None)
    # A round obstacle takes B^T B = 4 from a stiffness of 1.
    kept = KeptFactor(Dense(np.eye(6)))
    assert not kept.held(felt(0.0, [0.0, 1, 0], bend=[0.0, 0, 2])) and kept.giving == 1
    assert kept.held(felt(0.0, [0.0, 0, 1], bend=[0.0, 0, 2])) and kept.giving == 1


def test_a_factor_is_stale_when_the_steps_beyond_a_new_ones_exceed_its_worth():
    kept = KeptFactor(Dense(STIFFNESS))
    assert kept.stale and kept.fresh == 2
    kept.renew(FORCE)
    assert not kept.stale and kept.made == 1 and np.array_equal(kept.factored_at, FORCE)
    kept.used(3, fresh=True)
    for iterations, excess in ((2, 0), (3, 0), (7, 4), (5, 6), (5, 8)):  # fewer than a new one's are no credit
        kept.used(iterations, fresh=False)
        assert kept.excess == excess and not kept.stale
    kept.used(4, fresh=False)
    assert kept.excess == 9 and kept.stale
    kept.renew(2 * FORCE)
    assert not kept.stale and kept.excess == 0 and kept.made == 2 and kept.fresh == 3


def test_a_factor_is_remembered_with_the_groups_it_has_learned():
    kept = KeptFactor(Dense(STIFFNESS))
    kept.made, kept.fresh, kept.excess = 5, 3, 2
    assert kept.memory() == TangentMemory(5, 3, 2)  # stale: nothing to make again
    kept.renew(FORCE)
    kept.made, kept.excess = 5, 2
    assert kept.memory().learned is None and np.array_equal(kept.memory().factored_at, FORCE)
    for group in ([4, 2], [7], [1, 9, 3]):
        kept.solver.learn(np.array(group))
    memory = kept.memory()
    assert memory.learned.tolist() == [4, 2, 7, 1, 9, 3] and memory.learned_in.tolist() == [2, 1, 3]
    again = KeptFactor(Dense(STIFFNESS))
    again.recall(memory)
    assert (again.made, again.fresh, again.excess, again.stale) == (5, 3, 2, False)
    assert [group.tolist() for group in again.solver.learned] == [[4, 2], [7], [1, 9, 3]]
    assert len(again.solver.updated) == 1 and np.array_equal(again.factored_at, FORCE)
    bare = KeptFactor(Dense(STIFFNESS))
    bare.recall(TangentMemory(5, 3, 2, True, FORCE))
    assert bare.solver.learned == [] and not bare.stale
    bare = KeptFactor(Dense(STIFFNESS))
    bare.recall(TangentMemory(4))
    assert bare.stale and bare.made == 4 and bare.solver.updated == []


def test_a_stiffness_that_is_not_positive_definite_is_refused_where_that_is_asked():
    class Refusing(Dense):
        def update(self, u):
            raise NotPositiveDefinite("not here")

    kept = KeptFactor(Refusing(STIFFNESS))
    with pytest.raises(NoEquilibrium, match="not here"):
        kept.renew(FORCE, definite=True)
    assert kept.stale and kept.made == 0 and kept.definite
    kept._general = Dense(np.diag([1.0, 1, 1, 1, 1, -1]))
    kept.renew(FORCE)
    assert not kept.definite and kept.solver.negative == 1 and kept.made == 1 and not kept.stale
    kept.used(2, fresh=True)
    kept._general = Refusing(STIFFNESS)
    with pytest.raises(NoEquilibrium, match="not here"):
        kept.renew(FORCE)
    assert kept.stale and kept.made == 1


def test_contact_begins_where_it_pressed_before_and_may_be_indefinite(monkeypatch):
    """The set that is tried first are the points with a force; a body that gives way is not said to be positive definite."""
    asked = []
    monkeypatch.setattr(tangent, "solve_complementarity",
                        lambda matrix, gap, guess, definite: (asked.append((guess.tolist(), definite)), np.zeros(len(gap)))[1])
    three = Felt(np.array([1]), np.eye(3), np.zeros((0, 3)), np.ones(3), np.full(3, 0.01), np.array([0.0, 0.5, 3.0]))
    KeptFactor(Dense(STIFFNESS)).step(FORCE, 1e-6, three)
    KeptFactor(Dense(np.diag([1.0, 1, 1, 1, 1, -1]))).step(FORCE, 1e-6, three)  # their forces are none now
    three.bend = np.array([[0.0, 0, 4]])  # of a stiffness of 1 in the one direction
    KeptFactor(Dense(np.eye(6))).step(FORCE, 1e-6, three)
    assert asked == [([False, True, True], True), ([False] * 3, False), ([False] * 3, False)]
    for error in (np.linalg.LinAlgError(), RuntimeError()):
        def fails(*given, error=error, **more):
            raise error

        monkeypatch.setattr(tangent, "solve_complementarity", fails)
        with pytest.raises(NoEquilibrium, match="^the body gives way to contact without resistance$"):
            KeptFactor(Dense(STIFFNESS)).step(FORCE, 1e-6, three)


def test_conjugate_gradients_are_made_anew_each_time_and_say_how_often_they_were():
    class Steps:
        """A multigrid that notes what it is asked; every other call it does not end."""

        def __init__(self):
            self.asked, self.set_ups = [], 0

        def update(self, u):
            self.asked.append(("update", u))

        def _told(self, *call):
            self.asked.append(call)
            self.set_ups += 1
            if self.set_ups % 2 == 0:
                raise NotSolved("too many")
            return 7 * FORCE

        def solve(self, force):
            return self._told("solve", force)

        def step(self, force, tolerance, felt):
            return self._told("step", force, tolerance, felt)

    solver, point = Steps(), felt(0.0, [0.0, 0, 1])
    made = Iterated(solver)
    assert (made.lasting, made.stale, made.definite, made.giving, made.made) == (False, True, True, 0, 0) and made.solver is solver
    made.renew(FORCE)
    made.used(99, fresh=False)
    assert made.stale and np.array_equal(made.solve(FORCE), 7 * FORCE) and made.made == 1
    with pytest.raises(NoEquilibrium, match="^too many$"):
        made.step(FORCE, 1e-6, point)
    assert made.made == 2 and np.array_equal(made.step(2 * FORCE, 1e-7, None), 7 * FORCE) and made.made == 3
    with pytest.raises(NoEquilibrium, match="^too many$"):
        made.solve(FORCE)
    assert [call[0] for call in solver.asked] == ["update", "solve", "step", "step", "solve"] and solver.asked[2][2:] == (1e-6, point)
    assert made.held(None) and made.held(point) and made.memory() == TangentMemory(4)
    again = Iterated(Steps())
    again.recall(TangentMemory(9))
    assert again.made == 9 and again.solver.asked == []


@pytest.mark.parametrize(("method", "lasting"), [("direct", True), ("multigrid", False)])
def test_what_suits_a_scene_is_what_its_solver_is(method, lasting):
    scene = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [2, 1, 1]})
    found = tangent.tangent_for(Balance(scene, build_mesh(scene.body), method=method))
    assert found.lasting == lasting and type(found) is (KeptFactor if lasting else Iterated) and found.made == 0
