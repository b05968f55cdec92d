"""Contact of second order: Hertz's sphere on few nodes, an even press on any cell, and points at nodes alone."""

import numpy as np
import pytest

from physics.contact.conditions import ContactSurface
from physics.mesh.build import build_mesh
from physics.scene import Body, read_scene
from physics.solution import solve
from tests.quarter import hertz


@pytest.mark.parametrize("radius", [0.93, 1.0, 1.2])
def test_hertz_holds_to_half_a_per_cent_on_fifteen_hundred_nodes(radius):
    """First order has 15 625 in tests/hard_cases.py; the rim of contact need not lie along the sides of cells."""
    nodes, force, found = hertz(radius)
    assert nodes < 15_625 / 10 and force == pytest.approx(1, abs=5e-3) and found == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("cell, order", [("tetrahedron", 1), ("prism", 1), ("hexahedron", 1), ("tetrahedron", 2), ("hexahedron", 2)])
def test_a_flat_obstacle_presses_a_block_evenly(cell, order):
    """Without friction every plane section stays plane, but for what contact gives way, less at the rim, whose points have sides too."""
    scene = read_scene({
        "body": {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [2, 2, 2], "cell": cell, "order": order},
        "material": {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 1},
        "support": [{"where": f"{axis}-min", "fixed": axis} for axis in "xyz"],
        "obstacle": {"shape": "half-space", "normal": [0.0, 0.0, -1.0], "path": [[0.0, 0.0, 0.02], [0.0, 0.0, 0.0198]]}})
    solution = solve(scene)
    u, x = solution.displacement[-1], solution.mesh.points
    assert u[:, 2].min() == pytest.approx(-0.0002, rel=1e-4)
    even = x * [-0.3, -0.3, 1.0] * u[:, 2].min() / 0.02
    assert abs(u - even).max() < 5e-5 * 0.0002
    assert solution.reaction[-1, 2] == pytest.approx(0.01 * 1e6 * 0.02**2, rel=1e-4)


def test_points_at_nodes_are_left_as_they_are_where_they_are_asked_for():
    mesh = build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="hexahedron", order=2))
    surface = ContactSurface(mesh, "nodes", np.zeros(len(mesh.points), bool))
    assert sorted(surface.area.round(12).tolist()) == sorted(
        round(a, 12) for a in [3 / 36] * 8 + [8 / 36] * 12 + [16 / 36] * 6)
