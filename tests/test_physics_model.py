"""Only what a scene needs: small strain where it is enough, inertia left out where that is fair, and both said with numbers."""

import dataclasses
import re

import numpy as np
import pytest

from datagen.sets.check import against_scene
from datagen.sets.generate import trajectory_of
from physics import journal
from physics.equilibrium import small_strain as linear
from physics.equilibrium.small_strain import LINEAR_TOLERANCE
from physics.motion.inertia import FAIR, fair_duration, inertia
from physics.solution import solve
from tests.scenes import beam, pressed


def tip(traction, count=10):
    return beam(load=[{"where": "x-max", "traction": [0.0, 0.0, -traction]}], steps={"count": count})


def touched(depth, count=10):
    """The beam under a cylinder that goes so deep [m] into where it rests."""
    return pressed(obstacle={"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.03001], [0.05, 0.01, 0.03 - depth]]},
                   steps={"count": count})


def finite(scene):
    solution = solve(scene, small_strain=-1.0)
    assert solution.linear_steps == 0
    return solution


def error_of(model):
    return float(model["kinematics"].split("estimated ")[1].split()[0])


@pytest.mark.parametrize("scene", [tip(0.1), tip(1.0), touched(1e-6), touched(5e-6)], ids=["load", "larger", "contact", "deeper"])
def test_small_strain_where_its_error_is_small_and_said(scene):
    solution, exact = solve(scene), finite(scene)
    assert solution.linear_steps == 10
    largest = np.linalg.norm(exact.displacement[-1], axis=1).max()
    error = np.linalg.norm(solution.displacement[-1] - exact.displacement[-1], axis=1).max() / largest
    # The estimate is of first order in a small number; the obstacle, which it lets give way, holds the body in place.
    assert error <= LINEAR_TOLERANCE
    assert 0.5 < error_of(solution.model) / error < 3
    assert solution.reaction[-1] == pytest.approx(exact.reaction[-1], rel=1e-3, abs=1e-6 * np.linalg.norm(exact.reaction[-1]))


@pytest.mark.parametrize("scene, words", [(tip(100.0), "linear elasticity would be off by"), (touched(1e-3), "1e-03|0.02 of its largest")])
def test_finite_strain_where_it_is_not(scene, words):
    solution = solve(scene)
    assert solution.linear_steps == 0
    assert solution.model["kinematics"].startswith("finite strain") and re.search(words, solution.model["kinematics"])


def test_finite_strain_from_the_moment_it_is_needed(monkeypatch, tmp_path):
    """An obstacle that presses where nobody looked: left and gone on with in the midst of it, to the same bits."""
    path = [[0.05, 0.01, 0.03001], [0.05, 0.01, 0.029995], [0.05, 0.01, 0.0295], [0.05, 0.01, 0.03001]]
    scene = pressed(obstacle={"shape": "cylinder", "radius": 0.01, "path": path}, steps={"count": 30})
    monkeypatch.setattr(linear, "deepest", lambda balance: (1 / 3, 5e-6))
    solution = solve(scene)
    assert 10 <= solution.linear_steps < 20
    assert f"after {solution.linear_steps} steps of linear elasticity" in solution.model["kinematics"]
    exact = finite(scene)
    size = abs(exact.displacement).max(axis=(1, 2))
    # Once the obstacle has left, what remains of the displacement is the solvers' tolerance.
    assert (abs(solution.displacement - exact.displacement).max(axis=(1, 2)) <= 2 * LINEAR_TOLERANCE * size + 1e-9 * size.max()).all()
    later = slice(solution.linear_steps + 1, None)
    assert abs(solution.displacement - exact.displacement)[later].max() < 1e-6 * size.max()

    monkeypatch.setattr(journal, "EVERY", 0.0)
    for at in (5, solution.linear_steps, 25):
        def on_step(step, at=at):
            if step == at:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            solve(scene, journal=tmp_path / "part", on_step=on_step)
    again = solve(scene, journal=tmp_path / "part")
    assert again.resumed == 25 and np.array_equal(again.displacement, solution.displacement) and again.model == solution.model


def test_what_is_solved_linearly_passes_the_check_of_data_sets():
    trajectory = trajectory_of(touched(5e-6))
    assert trajectory.extra["linear_steps"] == 10
    assert against_scene(trajectory) == []
    told_otherwise = dataclasses.replace(trajectory, extra=trajectory.extra | {"linear_steps": 0})
    assert against_scene(told_otherwise)  # they are no equilibria of finite strain


def test_the_linear_law_says_what_it_leaves_out():
    """Against Saint-Venant-Kirchhoff, which has the same strain energy of the full Green-Lagrange strain."""
    material = {"young_modulus": 1e6, "poisson_ratio": 0.4}
    load = [{"where": "x-max", "traction": [0.0, 0.0, -5.0]}]
    scene = beam(material={"law": "linear", **material}, load=load, steps={"count": 4})
    solution = solve(scene)
    assert solution.linear_steps == 4 and solution.factorisations == 1
    other = beam(material={"law": "saint-venant-kirchhoff", **material}, load=load, steps={"count": 4})
    exact = finite(other).displacement[-1]
    error = np.linalg.norm(solution.displacement[-1] - exact, axis=1).max() / np.linalg.norm(exact, axis=1).max()
    said = float(solution.model["kinematics"].split("by about ")[1].split()[0])
    assert said == pytest.approx(error, rel=0.1)  # of first order, at an error of 1e-3


def swing(duration, period=1.0):
    """Largest distance of an undamped oscillator from its static value after a ramp, by many small exact steps."""
    omega = 2 * np.pi / period
    u = duration - np.sin(omega * duration) / omega  # the solution during the ramp, in units of p / (k t)
    v = 1 - np.cos(omega * duration)
    return np.hypot(u - duration, v / omega) / duration


def test_the_swing_after_a_ramp_is_bounded_as_said():
    duration = np.linspace(0.05, 40, 4001)
    found = np.array([swing(t) for t in duration])
    bound = np.minimum(1 / (np.pi * duration), 2.0)
    assert (found <= bound + 1e-12).all() and (found / bound).max() > 0.999


def test_what_is_said_of_inertia():
    scene, hz = pressed(), 20.0
    assert f"at least {fair_duration(scene, 1 / hz):.3g} s" in inertia(scene, hz)
    assert fair_duration(scene, 1 / hz) == pytest.approx(1 / (np.pi * FAIR * hz))
    slow = dataclasses.replace(scene, steps=dataclasses.replace(scene.steps, duration=2.0))
    fast = dataclasses.replace(scene, steps=dataclasses.replace(scene.steps, duration=0.1))
    assert "2 s, 40 periods" in inertia(slow, hz) and "dynamic" not in inertia(slow, hz)
    assert "2 periods" in inertia(fast, hz) and "dynamic = true" in inertia(fast, hz)
    trajectory = trajectory_of(tip(1.0))
    assert f"({trajectory.frequencies_hz[0]:.4g} Hz)" in trajectory.extra["model"]["inertia"]
