"""Bodies by shapes at their bounds: where the first touch is found, where contact is felt, and which scenes are none."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from learning.bodies import body as module
from learning.bodies.body import see
from learning.bodies.shapes import powers
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Steps, read_scene
from physics.schema import InputError
from tests.test_learning_bodies_body import PLATE, scene, seen
from tests.test_learning_bodies_literal import model


def test_the_first_touch_lies_on_a_line_between_two_of_sixteen_looks_between_two_of_sixteen():
    """A sphere that comes in aslant, whose depth is no straight line."""
    body = seen(obstacle={"shape": "sphere", "radius": 0.02, "path": [[0.0, 0.04, 0.033], [0.09, 0.045, 0.022]]})
    low, high = 0.0, 1.0
    for _ in range(2):
        looks = [low + (high - low) * i / 15 for i in range(16)]
        depth = [float(body.depth(np.array([look]))[0]) for look in looks]
        after = next(i for i in range(16) if depth[i] > 0)
        low, high, before, then = looks[after - 1], looks[after], depth[after - 1], depth[after]
    assert before < 0 and body.first_touch == pytest.approx(low + (high - low) * before / (before - then), abs=1e-14)
    assert 0.1 < body.first_touch < 0.9


@pytest.mark.parametrize("heights, touch", [((0.5, 0.25), 0.0), ((0.5, 0.5), 1.0), ((0.75, 0.5), 1.0), ((0.4375, 0.25), 0.0),
                                            ((0.75, 0.25), 0.5)])
def test_an_obstacle_that_just_reaches_the_body_touches_it_where_it_goes_on(heights, touch):
    """A sphere of radius 1/4 on a plate whose upper face is at 1/4, in numbers without rounding."""
    plate = PLATE | {"length": 1.0, "width": 0.5, "height": 0.25, "cells": [2, 2, 1]}
    path = [[0.5, 0.25, height] for height in heights]
    body = seen(body=plate, obstacle={"shape": "sphere", "radius": 0.25, "path": path})
    assert body.depth(np.zeros(1)).tolist() == [0.5 - heights[0]]
    assert body.first_touch == pytest.approx(touch, abs=1e-12)


@pytest.mark.parametrize("cell, facets", [("hexahedron", [[0, 1, 2, 3]]), ("tetrahedron", [[0, 1, 2], [0, 2, 3]])])
def test_contact_is_felt_at_corners_in_the_middle_of_sides_and_in_the_middle_of_facets_of_four(cell, facets, monkeypatch):
    """One face of 4 x 2, or two triangles of it, whose common side counts once; a node beside it is no part of it."""
    points = np.array([[0, 0, 0], [4, 0, 0], [4, 2, 0], [0, 2, 0], [0, 0, 5.0]])
    monkeypatch.setattr(Mesh, "surface", (np.array(facets),))
    mesh = Mesh(points, np.zeros((0, 8 if cell == "hexahedron" else 4), np.int64), cell, {})
    corners = [(0, 0), (4, 0), (4, 2), (0, 2)]
    found = module._surface(mesh, False)
    assert sorted(map(tuple, found[:, :2].tolist())) == sorted([*corners, (2, 0), (4, 1), (2, 2), (0, 1), (2, 1)]) and not found[:, 2].any()
    assert module._surface(mesh, True)[:, :2].tolist() == [list(corner) for corner in corners]


SPHERE = {"shape": "sphere", "radius": 0.02, "path": [[0.06, 0.04, 0.031], [0.06, 0.04, 0.027]]}


@pytest.mark.parametrize("changes, said", [
    ({"obstacle": [SPHERE, SPHERE | {"path": [[0.06, 0.04, -0.04]] * 2}]}, "several obstacles"),
    ({"material": [{"young_modulus": 1e6, "poisson_ratio": 0.4, **where} for where in ({"where": {"box": [[0] * 3, [0.05, 1, 1]]}}, {})]},
     "several materials"),
    ({"obstacle": {"shape": "box", "size": [0.02] * 3, "path": SPHERE["path"], "angle": 30.0}}, "turned box"),
    ({"obstacle": SPHERE | {"path": [[0.06, 0.04, 0.03]]}}, "not one straight line"),
])
def test_scenes_of_another_kind_are_refused(changes, said):
    one = scene(**changes)
    with pytest.raises(InputError, match=said):
        see(one, build_mesh(one.body))


def test_a_moving_scene_and_a_plane_body_are_refused():
    one = scene()
    mesh = build_mesh(one.body)
    with pytest.raises(InputError, match="loads or inertia"):
        see(replace(one, steps=Steps(count=8, dynamic=True, duration=1.0)), mesh)
    with pytest.raises(InputError, match="its supports move, or it has none"):
        see(replace(one, support=()), mesh)
    with pytest.raises(InputError, match="its supports move"):
        see(replace(one, support=(replace(one.support[0], angle=10.0),)), mesh)
    with pytest.raises(InputError, match="not one straight line"):
        see(replace(one, obstacle=replace(one.obstacle, steps=(8,))), mesh)
    plane = read_scene({"body": {"shape": "plate", "length": 0.1, "width": 0.08, "cells": [5, 4], "cell": "quadrilateral"},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 8}})
    with pytest.raises(InputError, match="not a solid one of first-order cells"):
        see(plane, build_mesh(plane.body))


def test_what_never_varied_may_be_off_by_a_ten_thousandth():
    one = model(1, low=torch.tensor([1.0]), high=torch.tensor([1.0]))
    assert one.strange(torch.tensor([[1.00009], [1.00011], [0.99991], [0.99989]])).tolist() == [False, True, False, True]


def test_a_linear_body_has_degrees_of_one_along_all_sides_and_short_ones_of_two():
    found = powers(np.array([0.1, 0.05, 0.01]), 1)
    assert found.tolist() == [[i, j, k, 0] for i in (0, 1) for j in (0, 1) for k in (0, 1) if i + j + k < 3]
    assert powers(np.array([0.1, 0.001, 0.001]), 3).max(axis=0).tolist() == [3, 2, 2, 0]
    assert powers(np.array([1.0, 0.5, 0.3]), 5).max(axis=0).tolist() == [5, 2, 2, 0]  # 2.5 to the even one


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirrored_body_fills_the_same_box(axis):
    body = replace(seen(), points=seen().points + [1.0, 2.0, 3.0], surface=seen().surface + [1.0, 2.0, 3.0])
    twin = body.mirrored(axis)
    assert twin.low == pytest.approx(body.low) and twin.extent == pytest.approx(body.extent)
    middle = 2 * body.low[axis] + body.extent[axis]
    path, there = np.array(body.obstacle.path), np.array(twin.obstacle.path)
    assert there[:, axis] == pytest.approx(middle - path[:, axis])
    assert twin.surface[:, axis] == pytest.approx(middle - body.surface[:, axis])
