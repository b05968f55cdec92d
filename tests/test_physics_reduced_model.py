"""The reduced-order model: exact where its shapes hold the solution, close where they nearly do."""

import numpy as np
import pytest

from physics.fidelity.verify import Checker
from physics.mesh.build import build_mesh
from physics.reduced import model as reduced
from physics.reduced.model import Reduced
from physics.solution import solve
from tests.dense import solved
from tests.scenes import beam, pressed

LINEAR = {"young_modulus": 1e6, "poisson_ratio": 0.4, "law": "linear"}


def rms(field):
    return float(np.sqrt(np.mean(np.sum(field**2, axis=-1))))


@pytest.mark.parametrize("loading", [
    {"load": [{"where": "x-max", "traction": [0.0, 300.0, -200.0]}]},
    {"support": [{"where": "x-min"}, {"where": "x-max", "fixed": "z", "displacement": [0, 0, -0.002]}]}])
def test_linear_elasticity_is_solved_exactly(loading):
    """The response to the load, or to the prescribed motion, is one of the shapes: one Newton step is the solution."""
    scene = beam(material=LINEAR, steps={"count": 3}, **loading)
    solution = solve(scene)
    found = Reduced(scene, solution.mesh).path(3)
    # The iteration ends at a change of 1e-6 m (SETTLED of a cell of 5 mm), of which a stiffness by differences leaves some 1e-2.
    np.testing.assert_allclose(found, solution.displacement, atol=5e-8)


@pytest.fixture(scope="module")
def case():
    scene = pressed()
    return scene, solve(scene)


def test_a_pressed_beam_bends_and_shortens_like_the_whole_model(case):
    scene, solution = case
    model = Reduced(scene, solution.mesh)
    found, truth = model.path(20), solution.displacement
    # Some fifty shapes for nine hundred unknowns of a stubby beam, turned by a third of a radian, squared a tenth.
    assert rms(found - truth) < 1e-2 * rms(truth)
    assert model.shapes.shape[1] < 80
    checker = Checker(scene, solution.mesh)
    assert checker.penetration(found[-1], 1.0) < 1e-5
    held = solution.mesh.places["x-min"]
    assert not found[:, held].any()
    np.testing.assert_allclose(model.shapes.T @ model.shapes, np.eye(model.shapes.shape[1]), atol=1e-10)


def test_more_modes_come_closer(case, monkeypatch):
    scene, solution = case
    errors = []
    for modes in (2, 4, 8):
        monkeypatch.setattr(reduced, "MODES", modes)
        errors.append(rms(Reduced(scene, solution.mesh).path(20) - solution.displacement))
    assert errors[0] > errors[1] > errors[2]


def test_equilibria_do_not_depend_on_the_steps_to_them(case):
    scene, solution = case
    few, many = (Reduced(scene, solution.mesh).path(steps)[-1] for steps in (4, 20))
    # Each ends when a change is below 2e-4 of a cell of 5 mm; what remains is about that, times the rate of convergence.
    assert abs(few - many).max() < 5e-6


def test_a_step_that_turns_a_cell_inside_out_is_taken_in_halves():
    """Coarse cells, pressed by three of them in one step: Newton's way leads through states that have no energy."""
    scene = pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [6, 2, 2]})
    once, tenfold = (Reduced(scene, build_mesh(scene.body)).path(steps)[-1] for steps in (1, 10))
    assert abs(once - tenfold).max() < 2e-5  # each settles within 2e-4 of a cell of 10 mm and what its rate leaves; 20 mm of motion


def test_a_body_that_the_obstacle_leaves_again_goes_back_to_rest():
    """Down by 2 mm beyond a gap of 0.5 mm and up again: pressed at the turn, and back at rest, to what ends the iteration."""
    scene = pressed(obstacle={"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, z] for z in (0.0305, 0.0285, 0.0305)]},
                    steps={"count": 8})
    found = Reduced(scene, build_mesh(scene.body)).path(8)
    assert not found[0].any() and abs(found[4]).max() > 1e-3 and abs(found[8]).max() < 1e-6


def test_the_third_order_of_a_mode_follows_from_its_second_one():
    """With v = 30 phi, w = K^-1 e(v) / 2, e the even part of the forces: v + K^-1 o, o the odd part of f(+-v - w), changed of sign."""
    scene = beam()
    model = Reduced(scene, build_mesh(scene.body))
    elasticity, rest = model.balance.elasticity, np.zeros_like(model.balance.mesh.points)
    mode = model._modes(1)[0]
    large = 30 * mode
    bow = solved(elasticity, rest, elasticity.force(large) + elasticity.force(-large)) / 2
    odd = (elasticity.force(large - bow) - elasticity.force(-large - bow)) / 2
    expected = large - solved(elasticity, rest, odd)
    found = model._odd(mode)
    assert abs(expected).max() > 1e-5 * abs(large).max()
    np.testing.assert_allclose(found, expected, atol=1e-5 * abs(expected).max())  # what cancels is ten thousand times larger
