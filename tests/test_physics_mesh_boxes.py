"""Boxes whose cells get shorter towards some of their faces: where they end, worked out on paper, and what that gains at a clamp."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid

from physics.mesh.build import build_mesh
from physics.mesh.quality import cell_volumes
from physics.mesh.transfer import _located, carried, interpolate, located
from physics.scene import read_body
from physics.schema import InputError
from physics.solution import solve
from tests.scenes import beam

TO_MIN = [0, 1 / 8, 8**-0.5, 27**0.5 / 8, 1]  # (k / 4)^(3/2)
TO_BOTH = [0, 32**-0.5, 0.5, 1 - 32**-0.5, 1]  # half of (k / 2)^(3/2), and mirrored


def mesh_of(graded, cells=(4, 4, 4), **changes):
    return build_mesh(read_body({"body": {"length": 3.0, "width": 2.0, "height": 0.5, "cells": list(cells), "graded": graded} | changes}))


def ends(mesh, axis):
    """Where cells end along an axis."""
    return np.unique(mesh.points[:, axis].round(12))


@pytest.mark.parametrize("shape, cell", [("beam", "prism"), ("beam", "tetrahedron"), ("plate", "hexahedron"), ("plate", "prism")])
def test_cells_of_a_box_end_at_powers_of_three_halves_from_the_faces_they_are_graded_to(shape, cell):
    mesh = mesh_of(["x-min", "y-max", "z-max", "z-min"], shape=shape, cell=cell)
    np.testing.assert_allclose(ends(mesh, 0), 3 * np.array(TO_MIN), atol=1e-12)
    np.testing.assert_allclose(ends(mesh, 1), 2 * (1 - np.array(TO_MIN[::-1])), atol=1e-12)
    np.testing.assert_allclose(ends(mesh, 2), 0.5 * np.array(TO_BOTH), atol=1e-12)
    assert cell_volumes(mesh.points, mesh.cells, mesh.cell).sum() == pytest.approx(3.0)
    assert {name: len(nodes) for name, nodes in mesh.places.items()} == dict.fromkeys(mesh.places, 25)


def test_a_rectangle_is_graded_too_and_what_is_not_named_stays_even():
    mesh = build_mesh(read_body({"body": {"shape": "plate", "length": 3.0, "width": 2.0, "cells": [4, 4], "cell": "triangle",
                                          "graded": ["y-min"]}}))
    np.testing.assert_allclose(ends(mesh, 0), 3 * np.linspace(0, 1, 5), atol=1e-12)
    np.testing.assert_allclose(ends(mesh, 1), 2 * np.array(TO_MIN), atol=1e-12)


def test_around_a_place_there_are_four_times_as_many_cells_as_far_away():
    """The cells up to each end are k of n when 1 + 3 / (1 + (x - c)^2 / w^2) is summed up to there, the face's place with w = L / 10."""
    mesh = mesh_of(["x-max"], cells=(7, 5, 2), focus_x=[[0.9, 0.2]], focus_y=[[0.5, 0.1], [1.5, 0.4]])
    for axis, n, side, spots in ((0, 7, 3.0, [(0.9, 0.2), (3.0, 0.3)]), (1, 5, 2.0, [(0.5, 0.1), (1.5, 0.4)])):
        x = np.linspace(0, side, 200_001)
        density = 1 + sum(3 / (1 + (x - place)**2 / within**2) for place, within in spots)
        parts = [trapezoid(density[x <= end], x[x <= end]) for end in ends(mesh, axis)]
        np.testing.assert_allclose(parts / trapezoid(density, x), np.arange(n + 1) / n, atol=2e-5)
    np.testing.assert_allclose(ends(mesh, 2), [0, 0.25, 0.5], atol=1e-12)
    assert cell_volumes(mesh.points, mesh.cells, mesh.cell).sum() == pytest.approx(3.0)


def test_nodes_of_second_order_are_in_the_middles_of_graded_cells():
    mesh = mesh_of(["x-min"], cells=(2, 1, 1), cell="hexahedron", order=2)
    first = 3 * 8**-0.5
    np.testing.assert_allclose(ends(mesh, 0), [0, first / 2, first, (first + 3) / 2, 3], atol=1e-12)


@pytest.mark.parametrize("changes, words", [
    ({"graded": ["x-mim"]}, r"body.graded = 'x-mim': must be one of .*did you mean 'x-min'"),
    ({"shape": "plate", "cell": "triangle", "cells": [2, 2], "height": None, "graded": ["z-min"]}, "a plane plate has no z-min, but x-min"),
    ({"shape": "panel", "outline": [[0, 0], [1, 0], [0, 1]], "length": None, "width": None, "cells": None, "cell_size": 0.1,
      "graded": ["z-min"]}, "body.graded: a panel takes outline"),
    ({"focus_y": [[2.1, 0.1]]}, r"body.focus_y\[0\] = \[2.1, 0.1\]: give a place on the side, from 0 to 2 m, and over how far"),
    ({"focus_x": [[1.0, 0.1], [1.0, 0.0]]}, r"body.focus_x\[1\] = \[1, 0\]: give a place"),
    ({"focus_x": [[1.0, 3.1]]}, "above 0 and at most as long"),
    ({"shape": "plate", "cell": "triangle", "cells": [2, 2], "height": None, "focus_z": [[0.0, 0.1]]}, "plate has no side along z")])
def test_faces_that_are_none_are_refused(changes, words):
    table = {"length": 3.0, "width": 2.0, "height": 0.5, "cells": [2, 2, 2]} | changes
    with pytest.raises(InputError, match=words):
        read_body({"body": {key: value for key, value in table.items() if value is not None}})


def test_in_a_box_of_uneven_layers_the_cell_of_a_point_is_found_at_once():
    mesh = mesh_of(["x-min", "z-max"], cells=(30, 3, 4), cell="hexahedron")
    dice = np.random.default_rng(0)
    points, linear = dice.uniform(0, 1, (500, 3)) * [3, 2, 0.5], mesh.points @ dice.normal(size=(3, 3))
    nodes, weights = located(mesh, points, candidates=1, layered=True)
    np.testing.assert_allclose(carried(linear[None], nodes, weights), interpolate(mesh, linear[None], points, candidates=200), atol=1e-12)
    lost = [(_located(mesh, points, 1, 0.0, layered)[0] > 1e-6).sum() for layered in (True, False)]
    assert lost[0] == 0 < lost[1]  # the nearest middle is often that of a neighbour


def test_at_a_clamp_a_graded_mesh_is_three_times_as_close_as_an_even_one():
    """The tip of a thin strip under its weight, of small strain, against a mesh of twice as many cells along each side."""
    scene = beam(body={"length": 0.09, "width": 0.02, "height": 0.0035, "cells": [12, 3, 1], "cell": "hexahedron", "order": 2},
                 load=[{"acceleration": [0, 0, -0.5]}], steps={"count": 1})

    def tip(cells, graded):
        body = replace(scene.body, cells=cells, graded=graded)
        found = solve(replace(scene, body=body), mesh=build_mesh(body))
        return found.displacement[-1, found.mesh.places["x-max"], 2].mean()

    exact = tip((24, 6, 2), ("x-min",))
    even, graded = (abs(tip((12, 3, 1), to) / exact - 1) for to in (None, ("x-min",)))
    assert 0.005 < even and graded < even / 3


def test_under_a_cylinder_cells_graded_to_clamp_and_contact_are_twice_as_close_as_even_ones():
    """A cantilever of bricks, bent down by a fifth of its length, against half as many again along each side."""
    down = {"shape": "cylinder", "radius": 0.01, "contact": "smooth", "path": [[0.08, 0.01, 0.03], [0.08, 0.01, 0.01]]}
    scene = beam(body={"length": 0.1, "width": 0.02, "height": 0.02, "cells": [40, 5, 5], "cell": "hexahedron",
                       "element": "mean-dilatation"}, obstacle=down, steps={"count": 40})
    grid = np.array(np.meshgrid(*[(np.arange(n) + 0.5) / n * side for n, side in ((20, 0.1), (4, 0.02), (4, 0.02))])).reshape(3, -1).T

    def end(cells, **grading):
        body = replace(scene.body, cells=cells, **grading)
        found = solve(replace(scene, body=body), mesh=build_mesh(body), final=True)
        return interpolate(found.mesh, found.displacement[-1:], grid)[0]

    graded = {"graded": ("x-min",), "focus_x": ((0.08, 0.005),)}
    exact = end((60, 8, 8), **graded)
    even, close = (np.linalg.norm(end((40, 5, 5), **how) - exact) / np.linalg.norm(exact) for how in ({}, graded))
    assert 0.001 < even < 0.01 and close < even / 2
