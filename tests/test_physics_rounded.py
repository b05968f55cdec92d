"""The surface of a body with the edges between its facets rounded, and contact that is felt on it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.footing import press
from physics.contact.conditions import ContactSurface
from physics.contact.rounded import rounded
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body, read_scene
from physics.solution import solve
from tests.hard_cases import roughness

GRID = build_mesh(Body(length=0.6, width=0.4, height=0.3, cells=(6, 4, 3), cell="hexahedron"))


def node(*place):
    """The one at a place that is counted in cells."""
    return int(np.linalg.norm(GRID.points - np.array(place) / 10, axis=1).argmin())


def middle(*place):
    """Of a middle at a place that is counted in cells: the nodes that make it, and how much of each."""
    surface = rounded(GRID)
    row = surface.weights[int(np.linalg.norm(surface.weights @ GRID.points - np.array(place) / 10, axis=1).argmin())]
    return {int(n): w for n, w in zip(row.indices, row.data, strict=True) if abs(w) > 1e-12}


@pytest.mark.parametrize("at, of", [
    ((2.5, 2, 3), {(1, 2, 3): -1 / 16, (2, 2, 3): 9 / 16, (3, 2, 3): 9 / 16, (4, 2, 3): -1 / 16}),  # in an even row
    ((0.5, 2, 3), {(0, 2, 3): 3 / 8, (1, 2, 3): 6 / 8, (2, 2, 3): -1 / 8}),  # beside an edge of the body: a parabola
    ((2.5, 0, 3), {(1, 0, 3): -1 / 16, (2, 0, 3): 9 / 16, (3, 0, 3): 9 / 16, (4, 0, 3): -1 / 16}),  # along this edge
    ((0.5, 0, 3), {(0, 0, 3): 3 / 8, (1, 0, 3): 6 / 8, (2, 0, 3): -1 / 8}),  # where it ends
])
def test_the_nodes_that_make_a_middle(at, of):
    assert middle(*at) == pytest.approx({node(*place): weight for place, weight in of.items()})


def test_the_slope_at_a_node_between_unlike_neighbours():
    """At x = 0, 1, 3, 4: weights 1 / d make it that of the chord past the node, so that 7/12 (x_1 + x_3) - 1/12 (x_0 + x_4)."""
    mesh = build_mesh(Body(shape="plate", length=0.3, width=0.1, cells=(3, 1), cell="quadrilateral"))
    row = mesh.points[:, 0].copy()
    mesh = replace(mesh, points=mesh.points + np.where(np.abs(row - 0.25)[:, None] < 0.06, [0.1, 0, 0], 0.0))
    surface, top = rounded(mesh), np.flatnonzero(mesh.points[:, 1] > 0.09)
    top = top[mesh.points[top, 0].argsort()]
    assert mesh.points[top, 0] == pytest.approx([0, 0.1, 0.3, 0.4])
    at = np.linalg.norm(surface.weights @ mesh.points - [0.2, 0.1, 0.0], axis=1).argmin()
    assert surface.weights[at].toarray()[0, top] == pytest.approx([-1 / 12, 7 / 12, 7 / 12, -1 / 12])


@pytest.mark.parametrize("ratio", [10, 1000])
def test_long_cells_beside_short_ones_do_not_swing(ratio):
    """A slope from a short neighbour, taken along a long edge, would make weights grow with the ratio; the body's own are at most 1."""
    x = np.cumsum([0, 1, 1, *[1 / ratio] * 5, 1, 1]) / 10
    mesh = build_mesh(Body(length=0.9, width=0.2, height=0.1, cells=(9, 2, 1), cell="hexahedron"))
    mesh = replace(mesh, points=np.stack([x[np.rint(10 * mesh.points[:, 0]).astype(int)], *mesh.points.T[1:]], axis=1))
    weights = rounded(mesh).weights
    assert weights.min() > -0.26 and weights.max() < 1.3


def test_quadratic_functions_are_kept_on_even_grids():
    """At every middle and centre of the top, those beside its rim too."""
    surface = rounded(GRID)
    at = surface.weights @ GRID.points
    top = at[:, 2] > 0.3 - 1e-9
    for exact in (lambda x: x[:, 0] ** 2, lambda x: x[:, 0] * x[:, 1], lambda x: x[:, 1] ** 2 - 3 * x[:, 0]):
        assert (surface.weights @ exact(GRID.points))[top] == pytest.approx(exact(at)[top], abs=1e-12)


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
def test_flat_sides_stay_flat_and_even_strains_are_kept_on_uneven_meshes(cell):
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(4, 3, 3), cell=cell))
    crooked = 0.02 * np.sin(40 * mesh.points[:, [1, 2, 0]]) * (mesh.points > 1e-9) * (mesh.points < np.array([0.3, 0.2, 0.1]) - 1e-9)
    mesh = replace(mesh, points=mesh.points + crooked)  # nodes of a side within it
    surface = ContactSurface(mesh, "smooth", np.zeros(len(mesh.points), bool))
    x = surface.positions(mesh.points)
    assert surface.area.min() > 0 and surface.area.sum() == pytest.approx(2 * (0.06 + 0.03 + 0.02), rel=1e-3)
    assert np.minimum(x, np.array([0.3, 0.2, 0.1]) - x).min(axis=1) == pytest.approx(0, abs=1e-12)
    strain = np.array([[1.1, 0.3, 0.0], [0.0, 0.8, 0.2], [0.1, 0.0, 1.0]])
    assert surface.positions(mesh.points @ strain + 5.0) == pytest.approx(x @ strain + 5.0)


@pytest.mark.parametrize("sides", [8, 16])
def test_a_polygon_of_many_sides_is_a_circle_and_one_of_few_has_edges(sides):
    """Of 16 sides, that meet at t = 22.5 degrees, (-1, 9, 9, -1) / 16 has the radius 9/8 cos(t/2) - 1/8 cos(3t/2); of 8 the edges stay."""
    angle = 2 * np.pi * np.arange(sides) / sides
    points = np.concatenate([[[0.0, 0, 0]], np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)])
    around = 1 + np.arange(sides)
    mesh = Mesh(points=points, cells=np.stack([0 * around, around, 1 + around % sides], axis=1), cell="triangle", places={}, thickness=0.5)
    surface, t = rounded(mesh), 2 * np.pi / sides
    radii = np.linalg.norm((surface.weights @ points)[1 + sides:], axis=1)
    assert len(radii) == sides
    assert radii == pytest.approx(9 / 8 * np.cos(t / 2) - 1 / 8 * np.cos(3 * t / 2) if sides == 16 else np.cos(t / 2))
    smooth = ContactSurface(mesh, "smooth", np.zeros(len(points), bool), 1.0)
    assert smooth.area.sum() == pytest.approx(2 * np.pi * 0.5 if sides == 16 else 16 * np.sin(t / 2) * 0.5, rel=1e-3)


@pytest.mark.parametrize("body", [{}, {"cells": (20, 3, 3), "cell": "hexahedron", "order": 2}], ids=["prisms", "second order"])
def test_the_force_of_a_rolling_obstacle_has_no_steps(body):
    scene = press(**body)
    assert roughness(replace(scene, obstacle=replace(scene.obstacle, contact="smooth"))) < 0.0015


@pytest.mark.parametrize("cells", [6, 8])
def test_a_smooth_surface_gives_way_by_a_twentieth_of_a_cell(cells):
    """Pressed evenly, a block of n cells and points as soft as a twentieth of one share the way: n / (n + 1/20) of it is the block's."""
    scene = read_scene({
        "body": {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [cells] * 3, "cell": "hexahedron"},
        "material": {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.0}, "steps": {"count": 1},
        "support": [{"where": f"{axis}-min", "fixed": axis} for axis in "xyz"],
        "obstacle": {"shape": "half-space", "normal": [0.0, 0.0, -1.0], "contact": "smooth",
                     "path": [[0.0, 0.0, 0.02], [0.0, 0.0, 0.0198]]}})
    top = solve(scene).displacement[-1][build_mesh(scene.body).places["z-max"], 2]
    assert top.mean() == pytest.approx(-0.0002 * cells / (cells + 1 / 20), rel=2e-3)
