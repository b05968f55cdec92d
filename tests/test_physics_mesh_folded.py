"""A body that passes through itself is noticed, and one that only comes near itself, or is crushed, is not."""

from dataclasses import replace

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.sound.folded import folded
from physics.solution import solve
from tests.scenes import beam, pressed

LENGTH = 0.3


def strip(cell, cells=(30, 2, 1), **more):
    return build_mesh(beam(body={"length": LENGTH, "width": 0.02, "height": 0.01, "cells": list(cells), "cell": cell, **more}).body)


def rolled(points, turns, aside=0.0):
    """(N, 3) displacements that roll a strip up about y by some turns, each 4 mm further out; the far end set aside along y."""
    radius = LENGTH / (2 * np.pi * turns) if turns else np.inf
    if not turns:
        return np.zeros_like(points)
    angle = points[:, 0] / radius
    inner = radius - points[:, 2] + 0.004 * angle / (2 * np.pi)
    y = points[:, 1] + aside * points[:, 0] / LENGTH
    return np.stack([inner * np.sin(angle), y, radius - inner * np.cos(angle)], axis=1) - points


@pytest.mark.parametrize("cell, order", [("prism", 1), ("tetrahedron", 1), ("hexahedron", 1), ("tetrahedron", 2), ("hexahedron", 2)])
def test_a_strip_cuts_itself_once_its_ends_have_passed_one_another(cell, order):
    """Rolled up by 1.2 turns in 40 steps: after one turn, between steps 33 and 34, where it is held, at x = 0."""
    mesh = strip(cell, order=order)
    path = np.array([rolled(mesh.points, turns) for turns in np.linspace(0, 1.2, 41)])
    step, where = folded(mesh, path)
    assert step == 34 and abs(where[0]) < 0.01 and -1e-9 <= where[2] <= 0.01
    assert folded(mesh, path[:34]) is None


def test_a_coil_whose_turns_lie_side_by_side_cuts_nothing():
    """Set aside by more than its width it passes beside itself; by less it does not."""
    mesh = strip("hexahedron")
    assert folded(mesh, np.array([0 * mesh.points, rolled(mesh.points, 1.2, aside=0.03)])) is None
    assert folded(mesh, np.array([0 * mesh.points, rolled(mesh.points, 1.2, aside=0.01)])) is not None


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_plane_strip_cuts_itself_in_its_plane(cell):
    mesh = build_mesh(beam(body={"shape": "plate", "length": LENGTH, "width": 0.01, "cells": [30, 1], "cell": cell},
                           support=[{"where": "x-min", "fixed": "xy"}]).body)
    upright = mesh.points[:, [0, 2, 1]]
    path = np.array([rolled(upright, turns)[:, [0, 2, 1]] for turns in (0.0, 0.98, 1.02)])
    assert folded(mesh, path)[0] == 2 and folded(mesh, path[:2]) is None


def test_a_blade_that_crosses_itself_without_a_node_in_it_is_seen():
    """Bent to the loop (s^3 - s, s^2), which crosses itself at s = 1 and -1; 1 mm thick, with nodes 10 mm apart and more."""
    mesh = strip("hexahedron")
    thin = replace(mesh, points=mesh.points * [1, 1, 0.1])

    def loop(end):
        s = end * (2 * thin.points[:, 0] / LENGTH - 1)
        return np.stack([0.1 * (s**3 - s), thin.points[:, 1], 0.1 * s**2 + thin.points[:, 2]], axis=1) - thin.points

    assert folded(thin, np.array([0 * mesh.points, loop(0.9)])) is None
    _, where = folded(thin, np.array([0 * mesh.points, loop(1.2)]))
    assert abs(where[0]) < 0.01 and where[2] == pytest.approx(0.1, abs=0.02)


def test_a_body_that_is_moved_turned_and_crushed_does_not_cut_itself():
    mesh = strip("tetrahedron", cells=(6, 3, 3))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    moved = mesh.points @ turn.T + [1, 2, 3] - mesh.points
    crushed = mesh.points * [0.2, 1.5, 1.5] - mesh.points
    assert folded(mesh, np.array([0 * mesh.points, moved, crushed, moved + crushed])) is None


@pytest.mark.parametrize("way, said", [(0.008, False), (0.02, True)])
def test_solve_says_when_the_ends_of_a_ring_pass_through_one_another(way, said):
    """A ring of 0.95 turns is open by 15 mm; its end is led along x by 8 mm or by 20, in 8 steps."""
    held = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "xyz", "displacement": [way, 0.0, 0.0]}]
    scene = beam(body={"length": LENGTH, "width": 0.02, "height": 0.01, "cells": [30, 1, 1], "element": "reduced"}, support=held,
                 steps={"count": 8})
    mesh = build_mesh(scene.body)
    ours = solve(scene, mesh=replace(mesh, points=mesh.points + rolled(mesh.points, 0.95)))
    assert ("folds" in ours.model) == said
    if said:
        # The upper edge of its end face comes from x = -13.6 mm, 8.4 mm high, to the face at x = 0: 13.6 / 20 of 8 steps.
        assert ours.model["folds"].startswith("at step 6 the body passes through itself, near (")


def test_a_pressed_beam_is_not_said_to_fold():
    assert not {"folds", "inside out"} & set(solve(pressed()).model)
