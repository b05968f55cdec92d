"""Small strain or finite: the estimate against the true error from both sides, and what is decided by it."""

from dataclasses import replace

import numpy as np
import pytest

from physics.body.elasticity import Elasticity
from physics.equilibrium import small_strain as linear
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.small_strain import LINEAR_TOLERANCE, Linear, choose, deepest
from physics.equilibrium.state import NoEquilibrium
from physics.mesh.build import build_mesh
from tests import dense
from tests.scenes import beam

BODY = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [6, 2, 2], "cell": "hexahedron"}
HOOKE = {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.3}


def scene_of(law="neo-hookean", **changes):
    return beam(**({"body": BODY, "material": HOOKE | {"law": law}, "steps": {"count": 4}} | changes))


def made(law="neo-hookean", **changes):
    scene = scene_of(law, **changes)
    mesh = build_mesh(scene.body)
    small = Balance(replace(scene, material=replace(scene.material, law="linear")), mesh)
    return Linear(Newton(small), Balance(scene, mesh).elasticity)


def traction(*force):
    return {"load": [{"where": "x-max", "traction": list(force)}]}


def exact(scene):
    """The finite-strain equilibrium without obstacle by full Newton with dense matrices, and the force on the supports that count."""
    balance = Balance(scene, build_mesh(scene.body))
    u = np.where(balance.fixed, 0.0, 0.0)
    for part in np.arange(1, 5) / 4:
        u = u + np.where(balance.fixed, part * balance.target - u, 0.0)
        for _ in range(8):
            u = u - dense.solved(balance.elasticity, u, balance.elasticity.force(u) - part * balance.load)
    return u, balance.elasticity.force(u)[balance.bearing].sum(axis=0)


BENDING = [("bent", traction(0.0, 0.0, -2.0)), ("bent and pulled", traction(40.0, 3.0, -2.0)), ("weight", {
    "load": [{"acceleration": [0.0, 0.3, -0.981]}], "support": [{"where": "x-min"}, {"where": "x-max", "fixed": "z"}]})]
PULLED = {"support": [{"where": "x-min"}, {"where": "x-max", "fixed": "xyz", "displacement": [3e-5, 1e-5, -2e-5]}]}


@pytest.mark.parametrize("law", ["neo-hookean", "saint-venant-kirchhoff"])
@pytest.mark.parametrize("changes", [*(changes for _, changes in BENDING), PULLED, traction(100.0, 0.0, 0.0)],
                         ids=[*(name for name, _ in BENDING), "displaced", "pulled"])
def test_the_estimate_is_the_true_error_to_first_order(law, changes):
    """Of the displacement, or of the reaction, whichever is more off: e, and what is left out is of the order of e^2.

    And, for a beam of height h whose end moves by d, of some (d/h)^2: here at most 1e-4 of the displacement.
    """
    found, (u, reaction) = made(law, **changes), exact(scene_of(law, **changes))
    state = found.at(1.0)
    off = np.linalg.norm(state.u - u, axis=1).max() / np.linalg.norm(state.u, axis=1).max()
    carried = found.newton.balance.elasticity.force(state.u)[found.newton.balance.bearing]
    scale = max(np.linalg.norm(carried.sum(axis=0)), 1e-3 * np.linalg.norm(carried, axis=1).sum())
    of_reaction = np.linalg.norm(reaction - carried.sum(axis=0)) / scale
    error = max(off, of_reaction)
    assert 1e-5 < error < 2e-2
    # From both sides; measured at most 1.03 either way here.
    assert error / 1.1 < found.estimate(state.u) < 1.1 * error


def test_the_estimate_is_its_formula():
    """Any displacements, by dense matrices: max |K^-1 (f - K u)| / max |u|; the forces' change at the supports, when that is more."""
    found = made(**PULLED)
    balance = found.newton.balance
    u = np.random.default_rng(0).normal(scale=1e-5, size=balance.fixed.shape) * [1, 2, 3]
    u[balance.fixed] = (balance.target + 0)[balance.fixed]
    found.newton.tangent.solver.update(np.zeros_like(u))
    K = dense_without_supports(balance.elasticity)
    pull = (K @ u.ravel()).reshape(-1, 3)
    missing = found.finite.force(u) - pull
    free = ~balance.fixed.ravel()
    d = np.zeros(u.size)
    d[free] = np.linalg.solve(K[np.ix_(free, free)], missing.ravel()[free])
    of_displacement = np.linalg.norm(d.reshape(-1, 3), axis=1).max() / np.linalg.norm(u, axis=1).max()
    change = (missing - (K @ d).reshape(-1, 3))[balance.bearing].sum(axis=0)
    at = pull[balance.bearing]
    of_force = np.linalg.norm(change) / max(np.linalg.norm(at.sum(axis=0)), 1e-3 * np.linalg.norm(at, axis=1).sum())
    assert found.estimate(u) == pytest.approx(max(of_displacement, of_force), rel=1e-6)
    # The same with the reaction of another set of nodes, for which the other of the two is the larger one.
    for nodes in (np.arange(5), np.arange(20, 30)):
        found.newton.balance.bearing = nodes
        change, at = (missing - (K @ d).reshape(-1, 3))[nodes].sum(axis=0), pull[nodes]
        of_force = np.linalg.norm(change) / max(np.linalg.norm(at.sum(axis=0)), 1e-3 * np.linalg.norm(at, axis=1).sum())
        assert found.estimate(u) == pytest.approx(max(of_displacement, of_force), rel=1e-6)
    found.newton.balance.floor = 1e3 * np.linalg.norm(at)
    assert found.estimate(u) == pytest.approx(max(of_displacement, np.linalg.norm(change) / found.newton.balance.floor), rel=1e-6)
    assert found.estimate(0 * u) == 0.0
    found.finite = Inverted()
    assert found.estimate(u) == np.inf


class Inverted:
    def force(self, u):
        return np.full_like(u, np.nan)


def dense_without_supports(elasticity):
    """(3 N, 3 N) by the forces of unit displacements, which for Hooke's law are the columns themselves."""
    size = elasticity.fixed.size
    return np.stack([elasticity.force(row.reshape(-1, 3)).ravel() for row in np.eye(size)], axis=1)


def test_reactions_that_cancel_are_held_against_a_thousandth_of_their_parts():
    """Squeezed between two faces that both move: the sum of the forces is none, so what it changes by is held against each face's."""
    ends = [{"where": "x-min", "displacement": [1e-5, 0, 0]}, {"where": "x-max", "displacement": [-1e-5, 0, 0]}]
    found = made(support=ends)
    state = found.at(1.0)
    assert np.linalg.norm(state.reaction) < 1e-6 and found.estimate(state.u) < 1e-3


def test_a_linear_state_grows_with_its_loads_and_is_solved_once():
    ends = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "z", "displacement": [0.0, 0.0, 1e-5]}]
    found = made(support=ends, **traction(1.0, 2.0, -3.0))
    balance, whole = found.newton.balance, found.whole
    right = balance.load - balance.elasticity.force(balance.target)
    expected = balance.target + dense.solved(balance.elasticity, 0 * right, right)
    assert whole.u == pytest.approx(expected, abs=1e-9 * abs(expected).max()) and whole.iterations >= 1
    found.newton.equilibrium = lambda *_: pytest.fail("solved again")
    part = found.scaled(0.25)
    assert part.fraction == 0.25 and part.iterations == 0 and found.whole is whole
    assert part.u == pytest.approx(expected / 4, abs=1e-9 * abs(expected).max())
    assert part.reaction == pytest.approx(whole.reaction / 4) and np.linalg.norm(whole.reaction) > 0


def test_it_is_estimated_anew_when_the_body_has_moved_a_tenth_more_or_after_ten_steps():
    found, asked = made(), []

    def estimate(u):
        asked.append(float(u[0, 0]))
        return 1e-5 * u[0, 0]

    found.estimate = estimate
    for size in (1.0, 1.05, 1.09, 1.2, 1.3, 1.33, 0.5):
        assert found.holds(np.array([[size, 0.0, 0.0]]))
    assert asked == [1.0, 1.2, 1.33]
    for _ in range(12):
        found.holds(np.array([[0.5, 0.0, 0.0]]))
    assert asked == [1.0, 1.2, 1.33, 0.5]  # the tenth step after the last time
    assert found.error == pytest.approx(1.33e-5)  # the largest so far
    found.holds(np.array([[1.4, 0.0, 0.0]]))
    assert len(asked) == 4  # of the largest so far, 1.33, it is not a tenth more
    assert found.holds(np.array([[9.9, 0.0, 0.0]])) and not found.holds(np.array([[11.0, 0.0, 0.0]]))
    assert not found.holds(np.array([[0.1, 0.0, 0.0]])) and found.error == pytest.approx(1.1e-4)  # never again
    found.asked = True
    assert found.holds(np.array([[99.0, 0.0, 0.0]])) and LINEAR_TOLERANCE == 1e-4


def test_what_is_remembered_goes_on_the_same():
    one, two = made(), made()
    one.error, one._largest, one._since = 2e-5, 0.25, 7
    two.recall(one.memory())
    assert (two.error, two._largest, two._since) == (2e-5, 0.25, 7) and isinstance(two._since, int)


def ball(*heights):
    return {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.03 + height] for height in heights]}


def test_the_deepest_place_of_a_path_is_looked_for_at_twenty_places():
    def at(*heights, **changes):
        scene = scene_of(obstacle=ball(*heights), **changes)
        return deepest(Balance(scene, build_mesh(scene.body)))

    assert deepest(Balance(scene_of(), build_mesh(scene_of().body))) == (1.0, 0.0)
    assert at(1e-3, -2e-3) == pytest.approx((1.0, 2e-3), abs=1e-12)
    assert at(1e-3, -3e-3, -1e-3) == pytest.approx((0.5, 3e-3), abs=1e-12)
    assert at(1e-3, -1e-3, 1e-3, -4e-3) == pytest.approx((1.0, 4e-3), abs=1e-12)
    assert at(2e-3, 1e-3, 2e-3) == pytest.approx((1.0, -1e-3), abs=1e-12)  # nowhere in the body
    # Three legs are looked at in 7 parts each, 21 in all: the way-points are among them.
    assert at(1e-3, 5e-3, -1e-3, 9e-3) == pytest.approx((2 / 3, 1e-3), abs=1e-12)
    # With a load the end is looked at, whatever the obstacle does.
    assert at(1e-3, -3e-3, -1e-3, **traction(0.0, 0.0, 1.0)) == pytest.approx((1.0, 3e-3), abs=1e-12)
    moved = [{"where": "x-min", "displacement": [0.0, 1e-5, 0.0]}]
    assert at(1e-3, -3e-3, -1e-3, support=moved)[0] == 1.0


def chosen(**changes):
    scene = scene_of(**changes)
    mesh = build_mesh(scene.body)
    return choose(scene, mesh, Balance(scene, mesh))


def test_small_strain_is_chosen_by_its_estimate_at_the_end_of_the_loading():
    found, words = chosen(**traction(0.0, 0.0, -0.1))
    assert words == "" and not found.asked and 0 < found.estimate(found.whole.u) < 1e-4
    assert "off by an estimated 0.0e+00 of the largest displacement, 0.0001 is allowed" in found.said(found.whole.u)
    found, words = chosen(**traction(0.0, 0.0, -20.0))
    assert found is None and words == (f"finite strain: linear elasticity would be off by "
                                       f"{made_estimate(**traction(0.0, 0.0, -20.0)):.1e} of the largest displacement, 0.0001 is allowed")
    found, words = chosen()
    assert found is None and words == ("finite strain: no load, support or obstacle was found to move the body, so there is nothing to "
                                       "estimate the error of small strain by")
    assert chosen(obstacle=ball(1e-3, 1e-9))[1] == words
    assert chosen(support=[{"where": "x-min", "displacement": [0.0, 1e-6, 0.0]}])[0] is not None


def made_estimate(**changes):
    found = made(**changes)
    return found.estimate(found.at(1.0).u)


def test_an_obstacle_that_goes_in_by_more_than_a_thousandth_is_not_tried(monkeypatch):
    """Of the largest extent, 60 mm: 60 um."""
    found, words = chosen(obstacle=ball(1e-3, -61e-6))
    assert found is None and words == ("finite strain: the obstacle reaches 6.1e-05 m into where the body rests, 0.001 of its largest "
                                       "extent; small strain is not tried above 0.001")
    found, words = chosen(obstacle=ball(1e-3, -59e-6))
    assert found is None and words.startswith("finite strain: linear elasticity would be off by")
    found, words = chosen(obstacle=ball(1e-3, -1e-6, 1e-3))  # deepest on the way
    assert found is not None and words == ""


def test_the_extent_is_the_bodys_wherever_it_lies():
    """A metre away: 61 um deep is still more than a thousandth of 60 mm."""
    place = np.array([1.0, -2.0, 3.0])
    scene = scene_of(obstacle=ball(1e-3, -61e-6))
    path = tuple(tuple(np.array(point) + place) for point in scene.obstacle.path)
    scene = replace(scene, obstacle=replace(scene.obstacle, path=path))
    mesh = build_mesh(scene.body)
    mesh = replace(mesh, points=mesh.points + place)
    assert "6.1e-05 m into where the body rests, 0.001 of its largest extent" in choose(scene, mesh, Balance(scene, mesh))[1]


def test_a_body_without_linear_solution_or_that_buckles_is_of_finite_strain(monkeypatch):
    def none(self, *_):
        raise NoEquilibrium("none")

    with monkeypatch.context() as patch:
        patch.setattr(Newton, "equilibrium", none)
        assert chosen(**traction(0.0, 0.0, -0.1)) == (None, "finite strain: there is no linear solution")
    monkeypatch.setattr(Linear, "estimate", lambda self, u: LINEAR_TOLERANCE)  # just allowed
    assert chosen(**traction(0.0, 0.0, -0.1))[0] is not None
    # Euler: pi^2 E I / (2 L)^2 = 9.1 N of E A strain 2.3 %; pushed by 2e5 Pa * 4 cm2 = 80 N
    assert chosen(**traction(-2e5, 0.0, 0.0)) == (None, "finite strain: the linear solution is that of a body that buckles")
    assert chosen(**traction(2e4, 0.0, 0.0))[0] is not None
    assert linear.DEEPEST == 1e-3


def test_the_linear_law_is_what_was_asked_for_and_says_what_it_leaves_out():
    scene = scene_of("linear", **traction(0.0, 0.0, -500.0))
    mesh = build_mesh(scene.body)
    found, words = choose(scene, mesh, Balance(scene, mesh))
    assert found.asked and words == "" and found.finite.material.law == "saint-venant-kirchhoff"
    u = found.at(1.0).u
    other = Elasticity(mesh, replace(scene.material, law="saint-venant-kirchhoff"), found.newton.balance.fixed)
    assert np.array_equal(found.finite.force(u), other.force(u))
    assert f"would move the last step by about {found.estimate(u):.1e} of the largest displacement" in found.said(u)
    assert found.estimate(u) > LINEAR_TOLERANCE and found.holds(u)
