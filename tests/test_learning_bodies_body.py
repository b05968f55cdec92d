"""What is known of a pose before anything is learned: depth, first touch, features, and what a mirror makes of them."""

from dataclasses import replace

import numpy as np
import pytest

from learning.bodies.body import see
from physics.mesh.build import build_mesh
from physics.scene import read_scene
from physics.schema import InputError

PLATE = {"shape": "plate", "length": 0.1, "width": 0.08, "height": 0.01, "cells": [5, 4, 2], "cell": "hexahedron"}


def scene(**changes):
    """A plate clamped at x-min under a sphere of 20 mm whose surface goes from 1 mm above z-max to 3 mm below, over the node (60, 40)."""
    table = {"body": PLATE, "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}],
             "steps": {"count": 8}, "obstacle": {"shape": "sphere", "radius": 0.02, "path": [[0.06, 0.04, 0.031], [0.06, 0.04, 0.027]]}}
    return read_scene(table | changes)


def seen(**changes):
    found = scene(**changes)
    return see(found, build_mesh(found.body))


def test_depth_is_the_overlap_with_the_body_at_rest_and_the_touch_where_it_begins():
    body = seen()
    assert body.depth(np.array([0.0, 0.5, 1.0])) == pytest.approx([-0.001, 0.001, 0.003])
    assert body.first_touch == pytest.approx(0.25)
    assert seen(obstacle={"shape": "sphere", "radius": 0.02, "path": [[0.06, 0.04, 0.04], [0.06, 0.04, 0.035]]}).first_touch == 1.0


def test_contact_is_felt_in_the_middle_of_facets_and_edges_or_at_nodes_alone():
    """A sphere over the middle of a facet 20 mm square: to the nodes 14.1 mm aside it is farther."""
    path = [[0.07, 0.03, 0.031], [0.07, 0.03, 0.027]]
    felt = seen(obstacle={"shape": "sphere", "radius": 0.02, "path": path})
    nodes = seen(obstacle={"shape": "sphere", "radius": 0.02, "path": path, "contact": "nodes"})
    assert felt.depth(np.ones(1)) == pytest.approx([0.003])
    assert nodes.depth(np.ones(1)) == pytest.approx([0.02 - np.hypot(np.hypot(0.01, 0.01), 0.017)])


def test_what_is_shown_does_not_depend_on_the_size_nor_on_youngs_modulus_but_on_shape_supports_and_ratio():
    fraction = np.array([0.5, 1.0])
    large = {key: 3 * value if key in ("length", "width", "height") else value for key, value in PLATE.items()}
    obstacle = {"shape": "sphere", "radius": 0.06, "path": [[0.18, 0.12, 0.093], [0.18, 0.12, 0.081]]}
    alike = seen(body=large, obstacle=obstacle, material={"young_modulus": 2e7, "poisson_ratio": 0.4})
    assert np.allclose(alike.shown(fraction)[0], seen().shown(fraction)[0], atol=1e-9)
    for other in (seen(support=[{"where": "x-max"}]), seen(body=PLATE | {"width": 0.09}),
                  seen(support=[{"where": "x-min"}, {"where": "x-max"}]), seen(material={"young_modulus": 1e6, "poisson_ratio": 0.3}),
                  seen(support=[{"where": "x-min"}, {"where": "y-min", "fixed": "y"}])):
        assert abs(other.shown(fraction)[0] - seen().shown(fraction)[0]).max() > 1e-3


PANEL = {"shape": "panel", "outline": [[0, 0], [0.1, 0], [0.1, 0.08], [0, 0.08]], "height": 0.01, "layers": 1, "cell_size": 0.01}
EDGE = [{"where": "edge-4"}]


def test_a_hole_shows_in_what_is_told_of_the_body():
    """Of radius 1 cm at (30, 30) mm, in a rim of ten sides: the part of the box that is left, and where its middle lies."""
    area = 5 * np.sin(2 * np.pi / 10) * 1e-4
    left = 0.008 - area
    for holes in ([], [[0.03, 0.03, 0.01]]):
        rim = {"holes": holes, "cell_size": 0.0063}
        told = seen(body=PANEL | rim, support=EDGE).shown(np.ones(1))[0][0, 33:43]
        share = 0.008 - area * len(holes)
        middle = 0.02 / 0.05 * area * len(holes), 0.01 / 0.04 * area * len(holes)
        assert told[:4] == pytest.approx([share / 0.008, middle[0] / 0.008, middle[1] / 0.008, 0], abs=1e-9)
    assert left < 0.98 * 0.008


@pytest.mark.parametrize("body, support", [
    (PLATE | {"cells": [9, 7, 3]}, "x-min"), (PLATE | {"cell": "tetrahedron"}, "x-min"),
    (PLATE | {"cell": "prism", "cells": [4, 4, 1]}, "x-min"), (PANEL, "edge-4"), (PANEL | {"cell": "tetrahedron"}, "edge-4")])
def test_what_is_told_of_a_body_and_of_what_is_held_does_not_depend_on_its_cells(body, support):
    expected, found = seen().shown(np.ones(1))[0], seen(body=body, support=[{"where": support}]).shown(np.ones(1))[0]
    assert found[:, 6:] == pytest.approx(expected[:, 6:], abs=1e-9)


def test_nodes_that_are_held_on_no_face_count_alike():
    """Two corners of the plate, (-1, -1, 1) and (1, 1, 1) in its box."""
    corners = [{"where": {"near": place, "within": 1e-6}} for place in ([0, 0, 0.01], [0.1, 0.08, 0.01])]
    assert seen(support=corners).shown(np.ones(1))[0][0, 43:53] == pytest.approx([1, 0, 0, 1, 1, 1, 0, 1, 0, 1])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirrored_body_is_shown_as_the_scene_that_one_would_write_for_it(axis):
    """x: the support at the other end; y and z: the obstacle at the other side."""
    cylinder = {"shape": "cylinder", "radius": 0.02, "axis": [0.2, 1, 0], "path": [[0.06, 0.03, 0.031], [0.06, 0.03, 0.027]]}
    sides = np.array([0.1, 0.08, 0.01])
    way = np.array(cylinder["path"])
    way[:, axis] = sides[axis] - way[:, axis]
    turned = np.array([0.2, 1, 0])
    turned[axis] *= -1
    other = seen(obstacle=cylinder | {"axis": turned.tolist(), "path": way.tolist()},
                 support=[{"where": "x-max" if axis == 0 else "x-min"}])
    fraction = np.array([0.5, 1.0])
    mirror = seen(obstacle=cylinder).mirrored(axis)
    for a, b in zip(mirror.shown(fraction), other.shown(fraction), strict=True):
        assert np.allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("changes, said", [
    ({"steps": {"count": 8, "dynamic": True, "duration": 1.0}}, "loads or inertia"),
    ({"load": [{"where": "x-max", "traction": [0, 0, 1.0]}]}, "loads or inertia"),
    ({"obstacle": None, "load": []}, "no obstacle"),
    ({"support": [{"where": "x-min", "displacement": [0.01, 0, 0]}]}, "supports move"),
    ({"obstacle": {"shape": "sphere", "radius": 0.02, "path": [[0.06, 0.04, 0.04]] * 3}}, "not one straight line"),
    ({"body": PLATE | {"order": 2}}, "first-order cells"),
])
def test_scenes_of_another_kind_are_refused(changes, said):
    table = {key: value for key, value in changes.items() if value is not None}
    one = scene(**table) if changes.get("obstacle", 1) is not None else replace(scene(), obstacle=None)
    with pytest.raises(InputError, match=said):
        see(one, build_mesh(one.body))
