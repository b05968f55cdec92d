"""Contact of second order: Hertz's sphere on few nodes, an even press on any cell, and points on no common row."""

import numpy as np
import pytest
import scipy.sparse

from physics.contact.conditions import ContactSurface
from physics.contact.points import points_of
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body, read_scene
from physics.solution import solve
from tests.quarter import hertz

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5], [0.5, 0.5]])
TRIANGLE = SQUARE[[0, 1, 3, 4, 8, 7]]


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


def points(nodes, divisions=1):
    """Staggered points (P, 2) of one facet of second order in the plane z = 0, its shape functions there (P, n), and its areas (P,)."""
    kind = {6: "tetrahedron10", 9: "hexahedron27"}[len(nodes)]
    mesh = Mesh(np.column_stack([nodes, np.zeros(len(nodes))]), np.zeros((0, 1), int), kind, {})
    mesh.__dict__["boundary"] = [np.arange(len(nodes))[None]]
    rows, columns, values, areas = points_of(mesh, divisions, staggered=True)
    weights = scipy.sparse.csr_matrix((values, (rows, columns)), shape=(len(areas), len(nodes))).toarray()
    return weights @ nodes, weights, areas


@pytest.mark.parametrize("divisions", [1, 3])
@pytest.mark.parametrize("nodes", [TRIANGLE, SQUARE], ids=["triangle", "square"])
def test_staggered_points_integrate_polynomials_of_degree_three(nodes, divisions):
    """Over the triangle x^i y^j has the mean i! j! 2 / (i + j + 2)!, over the square 1 / (i + 1) (j + 1), there in each coordinate."""
    at, _, areas = points(nodes, divisions)
    assert (areas > 0).all()
    square = len(nodes) == 9
    factorial = np.cumprod([1, 1, 2, 3, 4, 5])
    for i in range(4):
        for j in range(4 if square else 4 - i):
            exact = 1 / ((i + 1) * (j + 1)) if square else factorial[i] * factorial[j] / factorial[i + j + 2]
            assert areas @ (at[:, 0]**i * at[:, 1]**j) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("nodes, order", [(TRIANGLE, [1, 2, 0, 4, 5, 3]), (TRIANGLE, [0, 2, 1, 5, 4, 3]),
                                          (SQUARE, [1, 2, 3, 0, 5, 6, 7, 4, 8]), (SQUARE, [0, 3, 2, 1, 7, 6, 5, 4, 8])])
def test_they_are_the_same_from_whichever_corner_a_facet_is_numbered(nodes, order):
    (here, _, area), (there, _, other) = points(nodes), points(nodes[order])
    first, second = (np.lexsort(x.round(9).T) for x in (here, there))
    assert here[first] == pytest.approx(there[second], abs=1e-12) and area[first] == pytest.approx(other[second])


def test_a_round_obstacle_finds_a_row_of_points_every_tenth_of_a_cell():
    """And no row between the nodes has more than two points of a facet, so that the obstacle does not go from one whole row to the next."""
    at, _, _ = points(SQUARE)
    rows, count = np.unique(at[:, 0].round(9), return_counts=True)
    assert np.diff(rows) == pytest.approx(0.1, abs=1e-9) and count.tolist() == [3, 2, 2, 2, 2, 3, 2, 2, 2, 2, 3]


def test_points_at_nodes_are_left_as_they_are_where_they_are_asked_for():
    mesh = build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="hexahedron", order=2))
    surface = ContactSurface(mesh, "nodes", np.zeros(len(mesh.points), bool))
    assert sorted(surface.area.round(12).tolist()) == sorted(
        round(a, 12) for a in [3 / 36] * 8 + [8 / 36] * 12 + [16 / 36] * 6)
