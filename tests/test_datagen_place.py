"""Where obstacles start and how they move, by the formula of place.py written out for every face, and every limit of its keys."""

import numpy as np
import pytest

from datagen.family.family import draw, load_family
from datagen.family.place import placed, placed_on, reach
from physics.mesh.files import write_mesh
from physics.mesh.shapes.boxes import box
from physics.scene import PLACES, read_scene
from physics.schema import InputError
from tests.tools import spanner, written

SIDES = np.array([0.5, 0.3, 0.2])  # [m] length, width, height


def table(place, shape="sphere", **keys):
    return {"body": dict(zip(("length", "width", "height"), SIDES.tolist(), strict=True)) | {"cells": [5, 3, 2]},
            "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "support": [{"where": "x-min"}],
            "obstacle": {"shape": shape, "place": place, **keys}}


def by_the_formula(face, along, across, gap, depth, angles, r):
    """c(s) = touch + r n + s (-n + tan a1 t1 + tan a2 t2) from s = -gap to depth."""
    n, t1, t2 = {"x": ([1, 0, 0], [0, 1, 0], [0, 0, 1]), "y": ([0, 1, 0], [1, 0, 0], [0, 0, 1]),
                 "z": ([0, 0, 1], [1, 0, 0], [0, 1, 0])}[face[0]]
    n, t1, t2 = np.array(n), np.array(t1), np.array(t2)
    touch = along * t1 * SIDES + across * t2 * SIDES
    if face.endswith("max"):
        touch = touch + n * SIDES
    else:
        n = -n
    way = -n + np.tan(np.deg2rad(angles[0])) * t1 + np.tan(np.deg2rad(angles[1])) * t2
    return [touch + r * n + s * way for s in (-gap, depth)]


@pytest.mark.parametrize("face", PLACES)
def test_the_way_is_that_of_the_formula_before_every_face(face):
    place = {"face": face, "along": 0.3, "across": 0.8, "gap": 0.004, "depth": 0.02, "direction": [40, -25]}
    path = placed(table(place, radius=0.07))["path"]
    assert np.allclose(path, by_the_formula(face, 0.3, 0.8, 0.004, 0.02, (40, -25), 0.07), rtol=0, atol=1e-15)


def test_what_is_left_out_is_the_middle_of_the_upper_face_straight_down_from_touch():
    assert np.allclose(placed(table({"depth": 0.02}, radius=0.07))["path"], [[0.25, 0.15, 0.27], [0.25, 0.15, 0.25]], rtol=0, atol=1e-15)


@pytest.mark.parametrize(("unit", "metres"), [("m", 0.1), ("length", 0.05), ("width", 0.03), ("height", 0.02)])
def test_a_depth_may_be_measured_by_each_side_of_the_body(unit, metres):
    path = placed(table({"depth": 0.1, "depth_in": unit, "face": "y-min", "gap": 0.01}, radius=0.05))["path"]
    assert path[0][1] == pytest.approx(-0.06) and path[1][1] == pytest.approx(-0.05 + metres)


@pytest.mark.parametrize(("face", "axis"), [
    ("x-min", [0, 0.5, 0.75**0.5]), ("x-max", [0, 0.5, 0.75**0.5]), ("y-min", [0.5, 0, 0.75**0.5]), ("y-max", [0.5, 0, 0.75**0.5]),
    ("z-min", [0.5, 0.75**0.5, 0]), ("z-max", [0.5, 0.75**0.5, 0])])
def test_an_axis_is_turned_from_the_second_side_to_the_first(face, axis):
    """By 30 degrees: sin 30 = 1/2 along the first side."""
    assert placed(table({"face": face, "depth": 0.01, "turn": 30}, "cylinder", radius=0.02))["axis"] == pytest.approx(axis, abs=1e-15)
    assert placed(table({"face": face, "depth": 0.01, "turn": 0}, "capsule", radius=0.02, length=0.1))["axis"] == pytest.approx(
        np.round(axis), abs=0.0)


@pytest.mark.parametrize("face", PLACES)
def test_a_half_space_faces_the_body(face):
    normal = [0.0, 0.0, 0.0]
    normal["xyz".index(face[0])] = 1.0 if face.endswith("min") else -1.0
    found = placed(table({"face": face, "depth": 0.01}, "half-space"))
    assert found["normal"] == normal and np.allclose(found["path"], by_the_formula(face, 0.5, 0.5, 0, 0.01, (0, 0), 0))
    assert placed(table({"face": face, "depth": 0.01}, "half-space", normal=[1, 2, 3]))["normal"] == [1, 2, 3]  # unless told otherwise


@pytest.mark.parametrize(("normal", "expected"), [(0, 0.01 + 0.06 * 3 / 13), (1, 0.01 + 0.06 * 4 / 13), (2, 0.01 + 0.06 * 12 / 13)])
def test_the_reach_of_a_capsule_is_its_radius_and_what_its_axis_shows_of_half_its_length(normal, expected):
    for sign in (1, -1):
        scene = read_scene(table({}, "capsule", radius=0.01, length=0.12, axis=[6 * sign, 8, 24 * sign]) | {"obstacle": {
            "shape": "capsule", "radius": 0.01, "length": 0.12, "axis": [6 * sign, 8, 24 * sign], "path": [[9, 9, 9]]}})
        assert reach(scene.obstacle, normal, "") == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(("face", "expected"), [("x-max", 0.01), ("y-max", 0.03), ("z-max", 0.05)])
def test_the_reach_of_a_box_is_half_of_its_side(face, expected):
    path = placed(table({"face": face, "depth": 0.01}, "box", size=[0.02, 0.06, 0.1], radius=0.004))["path"]
    assert path[0]["xyz".index(face[0])] == pytest.approx(SIDES["xyz".index(face[0])] + expected)


def test_a_cylinder_lies_in_the_face():
    for lean, allowed in ((0.9e-9, True), (1.1e-9, False), (-1.1e-9, False)):
        given = table({"depth": 0.01}, "cylinder", radius=0.02, axis=[0, 1, lean])
        if allowed:
            assert placed(given)["path"][0][2] == pytest.approx(0.22)
        else:
            with pytest.raises(InputError, match="must be parallel to obstacle.place's face z-max"):
                placed(given)


@pytest.mark.parametrize(("key", "inside", "outside"), [
    ("along", (0, 1), (-1e-9, 1 + 1e-9)), ("across", (0, 1), (-1e-9, 1 + 1e-9)), ("gap", (0, 5), (-1e-12,)),
    ("depth", (1e-12, 5), (0, -1e-12)), ("turn", (-90, 90), (-90.001, 90.001)),
    ("direction", ([-75, 75], [75, -75]), ([0, 75.001], [-75.001, 0]))])
def test_the_limits_of_a_place(key, inside, outside):
    def given(value):
        return table({"depth": 0.01, key: value}, "capsule", radius=0.02, length=0.03)

    for value in inside:
        placed(given(value))
    for value in outside:
        with pytest.raises(InputError, match=f"obstacle.place.{key}"):
            placed(given(value))


def test_what_else_the_obstacle_says_is_kept():
    given = table({"depth": 0.01}, radius=0.02, contact="nodes")
    found = placed(given)
    assert {name: found[name] for name in found if name != "path"} == {"shape": "sphere", "radius": 0.02, "contact": "nodes"}
    assert "place" in given["obstacle"]  # the table itself is not changed


FAMILY = """
body = {{ shape = "file", path = "part.vtk", scale = 0.001 }}
material = {{ young_modulus = 1e6, poisson_ratio = 0.3 }}
support = [{{ where = {{ plane = [-0.1, 0, 0], normal = [1, 0, 0], within = 1e-6 }} }}]
steps = {{ count = 2 }}
[obstacle]
shape = "sphere"
radius = 0.07
place = {{ face = "{face}", along = 0.3, across = 0.8, gap = 0.004, depth = 0.1, depth_in = "width", direction = [40, -25] }}
"""


@pytest.mark.parametrize("face", PLACES)
def test_the_faces_of_a_body_from_a_file_are_those_of_the_box_around_it(tmp_path, face):
    """A box in millimetres that begins at (-100, 20, 7): the path is that on the box at the origin, moved along."""
    mesh = box(read_scene({name: value for name, value in table({}).items() if name != "obstacle"}).body)
    write_mesh(tmp_path / "part.vtk", type(mesh)(1e3 * mesh.points + [-100, 20, 7], mesh.cells, mesh.cell, {}), {})
    (tmp_path / "family.toml").write_text(FAMILY.format(face=face))
    scene = draw(load_family(tmp_path / "family.toml"), 0, 0)
    there = by_the_formula(face, 0.3, 0.8, 0.004, 0.03, (40, -25), 0.07)
    assert np.allclose(scene.obstacle.path, np.array(there) + [-0.1, 0.02, 0.007], rtol=0, atol=1e-12)
    on = placed_on(scene.body, {"shape": "half-space", "place": {"face": face, "depth": 0.1}})
    at = (np.array([-0.1, 0.02, 0.007]) + SIDES * face.endswith("max"))["xyz".index(face[0])]
    assert on.path[0]["xyz".index(face[0])] == pytest.approx(at, abs=1e-12)


def test_a_mesh_file_that_is_not_there_is_missed_by_its_name(tmp_path):
    (tmp_path / "family.toml").write_text(FAMILY.format(face="x-max"))
    with pytest.raises(InputError, match=r"part\.vtk: no such file$"):
        load_family(tmp_path / "family.toml")


def test_a_box_and_a_mesh_are_turned_about_the_normal_of_the_face_and_touch_where_they_reach_furthest(tmp_path):
    """A spanner's jaw points away from its file's origin; a turned box of sides 2, 1 and 1 reaches 0.5 towards z, however it lies on it."""
    file = written(tmp_path / "spanner.stl", spanner())
    for keys, height in (({"shape": "box", "size": [2.0, 1.0, 1.0]}, 0.5), ({"shape": "mesh", "file": file, "scale": 0.1}, 0.3)):
        for face, sign in (("z-max", 1), ("z-min", -1)):
            whole = {"body": {"shape": "plate", "length": 20.0, "width": 20.0, "height": 2.0, "cells": [4, 4, 1]},
                     "material": {"young_modulus": 1e6, "poisson_ratio": 0.3},
                     "obstacle": keys | {"place": {"face": face, "depth": 0.5, "gap": 0.1, "turn": 30.0}}}
            obstacle = read_scene(whole | {"obstacle": placed(whole)}).obstacle
            assert obstacle.angle == 30.0 and obstacle.axis == (0.0, 0.0, 1.0)
            start = 2.0 * (sign > 0) + sign * (height + 0.1)
            assert obstacle.path[0] == pytest.approx((10.0, 10.0, start)) and obstacle.path[1][2] == pytest.approx(start - sign * 0.6)
    tilted = {"shape": "mesh", "file": file, "scale": 0.1, "axis": [0, 1, 0], "angle": 90.0}  # the handle, 6 long, now points up
    for face, height in (("z-max", 1.4), ("z-min", 6.0)):
        whole |= {"obstacle": tilted | {"place": {"face": face, "depth": 0.5}}}
        assert abs(placed(whole)["path"][0][2] - 2.0 * (face == "z-max")) == pytest.approx(height)
    with pytest.raises(InputError, match="give either axis or place.turn"):
        placed(whole | {"obstacle": tilted | {"place": {"depth": 0.5, "turn": 3.0}}})


@pytest.mark.parametrize(("shape", "face", "axis"), [
    ("cylinder", "y-max", [0, 0, 1]), ("cylinder", "y-min", [0, 0, 1]), ("cylinder", "x-max", None), ("cylinder", "z-min", None),
    ("capsule", "y-max", None)])
def test_a_cylinder_without_an_axis_lies_in_any_face(shape, face, axis):
    given = table({"face": face, "depth": 0.01}, shape, radius=0.02, **({"length": 0.03} if shape == "capsule" else {}))
    assert placed(given).get("axis") == axis  # None: the obstacle's own default, y, which lies in the face or may be upright there
    along = "xyz".index(face[0])
    start = placed(given)["path"][0][along]
    reach = 0.02 if shape == "cylinder" else 0.035
    assert start == pytest.approx(-reach if face.endswith("min") else SIDES[along] + reach)
