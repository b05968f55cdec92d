"""The path-following solver: against plain Newton, against energy, against theory, and where it has to give up."""

import dataclasses

import numpy as np
import pytest

from datagen.family import draw, load_family
from physics import equilibrium
from physics.equilibrium import TOLERANCE, cell_size, solve
from physics.schema import InputError
from tests import plain_newton
from tests.scenes import beam, pressed


def test_first_beam_of_the_demo_agrees_with_plain_newton():
    scene = draw(load_family("demo"), seed=0, index=0)
    ours, plain = solve(scene).displacement, plain_newton.solve(scene)
    assert abs(ours - plain).max() < 1e-6 * abs(plain).max()


@pytest.mark.parametrize("contact", ["facets", "nodes"])
def test_work_of_the_obstacle_is_stored(contact):
    scene = pressed(steps={"count": 100})
    scene = dataclasses.replace(scene, obstacle=dataclasses.replace(scene.obstacle, contact=contact))
    solution = solve(scene)
    height = np.linspace(*(point[2] for point in scene.obstacle.path), 101)
    push = -solution.reaction[:, 2]
    work = np.sum((push[1:] + push[:-1]) / 2 * np.diff(height))
    # The trapezoidal rule over 100 steps of a smooth curve is good to far less than 1 %; a wrong reaction is not.
    assert work == pytest.approx(solution.energy[-1], rel=1e-2)
    assert solution.energy[-1] > 0


def test_every_step_is_in_equilibrium_without_penetration():
    solution = solve(pressed())
    assert not solution.failure
    assert solution.relative_residual.max() <= TOLERANCE
    assert solution.penetration.max() < 1e-4 * cell_size(solution.mesh)
    assert solution.smallest_det_f.min() > 0
    assert len(solution.displacement) == 21
    assert not solution.displacement[0].any()


def test_nothing_is_solved_before_the_first_touch():
    scene = pressed(obstacle={"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.05], [0.05, 0.01, 0.04]]})
    solution = solve(scene)
    assert solution.newton_iterations.sum() == solution.factorisations == 0
    assert not solution.displacement.any()


def test_a_mirrored_scene_has_the_mirrored_solution():
    """Pressed from above and from below: the body is turned by half a turn about its axis, its mesh onto itself."""
    down = solve(pressed())
    up = solve(pressed(obstacle={"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, -0.0105], [0.05, 0.01, 0.0045]]}))
    turned = down.mesh.points * [1, -1, -1] + [0, 0.02, 0.02]
    order = [int(np.argmin(np.linalg.norm(up.mesh.points - point, axis=1))) for point in turned]
    # Both are solved to 1e-6 of the reaction; a beam turns that into about as much of its displacement.
    assert abs(up.displacement[:, order] - down.displacement * [1, -1, -1]).max() < 1e-5 * abs(down.displacement).max()


def test_small_tip_load_gives_the_deflection_of_beam_theory():
    length, side, force = 0.2, 0.02, 1e-4
    scene = beam(body={"length": length, "width": side, "height": side, "cells": [80, 8, 8], "cell": "hexahedron"},
                 material={"young_modulus": 1e6, "poisson_ratio": 0.0},
                 load=[{"where": "x-max", "traction": [0.0, 0.0, -force / side**2]}], steps={"count": 1})
    tip = solve(scene).displacement[-1, :, 2].min()
    inertia = side**4 / 12
    timoshenko = force * length**3 / (3e6 * inertia) + force * length / (5 / 6 * 0.5e6 * side**2)
    # Fully integrated first-order hexahedra lock in bending by about (h/H)^2 = 1/64 of it.
    assert -tip == pytest.approx(timoshenko, rel=0.03)
    assert -tip < timoshenko


def test_gravity_pulls_with_the_weight():
    solution = solve(beam(load=[{"acceleration": [0.0, 0.0, -9.81]}], steps={"count": 2}))
    weight = 1000 * 0.06 * 0.02 * 0.02 * 9.81
    assert solution.reaction[-1] == pytest.approx([0, 0, -weight], abs=1e-5 * weight)  # of the body on its supports


def test_a_step_too_large_is_halved():
    whole, halves = solve(pressed(steps={"count": 40})), solve(pressed(steps={"count": 1}))
    assert halves.halvings > 0
    assert abs(whole.displacement[-1] - halves.displacement[-1]).max() < 1e-5 * abs(whole.displacement[-1]).max()


def test_what_cannot_be_solved_fails_clearly_and_keeps_what_was(monkeypatch):
    """A block is pushed flat against its other, fixed face: sooner or later no equilibrium can be found."""
    scene = beam(body={"length": 0.02, "width": 0.02, "height": 0.02, "cells": [2, 2, 2]},
                 support=[{"where": "z-min", "fixed": "xyz"}, {"where": "z-max", "fixed": "xyz", "displacement": [0.0, 0.0, -0.03]}],
                 steps={"count": 6})
    solution = solve(scene)
    assert solution.failure.startswith("no equilibrium at step")
    assert "halvings" in solution.failure and "\n" not in solution.failure
    reached = len(solution.displacement) - 1
    assert 1 <= reached < 6
    assert solution.relative_residual.max() <= TOLERANCE
    assert solution.smallest_det_f.min() > 0


def test_scenes_without_a_solution_are_refused():
    with pytest.raises(InputError, match="3 rigid motions"):
        solve(pressed(support=[{"where": "x-min", "fixed": "x"}]))
    with pytest.raises(InputError, match="inside the body"):
        solve(pressed(obstacle={"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.02]]}))


def test_the_same_scene_gives_the_same_bits():
    assert np.array_equal(solve(pressed()).displacement, solve(pressed()).displacement)
    assert equilibrium.REFACTOR_COST == 8  # a measured time in its place would break this
