"""A scene outside of what a run was trained on is told from one inside."""

import json
import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from datagen.files.trajectory import INFLOW, NORMAL, WALL
from learning.samples import seen as module
from learning.samples.seen import FILE, SeenRange, description, outside, read_seen, seen, write_seen
from physics.scene import Where
from physics.schema import InputError
from tests.flows import channel_flow
from tests.graph_by_hand import REST, one_cell, tiny
from tests.scenes import beam, pressed
from tests.synthetic import bending
from tests.test_learning_layout import channel

# the obstacle's middle from frame to frame: 5 m, 12 m, 3 m and 4 m
PATH = np.array([[0, 0, 0], [3, 0, 4], [3, -12, 4], [3, -12, 1], [-1, -12, 1]], np.float32)
TRAINING = [bending(length=0.1, travel=0.015), bending(length=0.12, travel=0.02)]


def on_paper(**changes):
    """`tiny` in 2 and 4 times its length along y and z, its obstacle on PATH; the nodes beside its middle turn about it."""
    trajectory = tiny()
    moved = trajectory.displacement.copy()
    moved[:, 5:] = PATH[:, None]
    moved[3, 5:7] += [[1, 2, 3], [-1, -2, -3]]
    moved[:, 0] += 100  # the body's motion is no part of it
    return replace(trajectory, points=REST * [1, 2, 4], displacement=moved, **changes)


def test_a_description_on_paper():
    told = description(on_paper())
    # body x from 3 to 4, y from 2 (-2) to 2 (-1.125), z from 4 * 5 to 4 * 6
    assert [told[f"extent along {axis} [m]"] for axis in "xyz"] == [1, 1.75, 4]
    scaled = REST[:5] * [1, 2, 4]
    sides = sorted(sum((scaled[a] - scaled[b]) ** 2) ** 0.5 for a, b in combinations(range(5), 2) if (a, b) != (0, 4))
    assert told["cell size [m]"] == pytest.approx(sides[4], rel=1e-12)  # the middle one of nine
    assert (told["nodes of the body"], told["steps"], told["cells"]) == (5, 4, "tetrahedron")
    # obstacle x from 4.25 to 5, y from 2 (-1.375) to 2 (-0.75), z from 4 * 6.125 to 4 * 7; its middle's x is 4.59375
    assert told["smallest extent of the obstacle [m]"] == 0.75
    assert told["way of the obstacle [m]"] == pytest.approx(24) and told["way of the obstacle in one step [m]"] == pytest.approx(12)
    assert told["end of the obstacle's path along x, in lengths of the body"] == pytest.approx(4.59375 - 1 - 3)
    assert told["direction of the obstacle"] == "-y" and len(told) == 12


def test_the_end_of_the_path_is_told_in_lengths_of_the_body():
    twice = on_paper()
    twice = replace(twice, points=twice.points * 2, displacement=twice.displacement * 2)  # the body now from 6 to 8
    assert description(twice)["end of the obstacle's path along x, in lengths of the body"] == pytest.approx(0.59375)
    still = replace(twice, displacement=0 * twice.displacement[:1])
    told = description(still)  # one frame: no way, and no step
    assert (told["steps"], told["way of the obstacle [m]"], told["way of the obstacle in one step [m]"]) == (0, 0, 0)


def test_a_body_alone_is_told_by_its_mesh_and_a_scene_by_its_words():
    assert len(description(one_cell())) == 7
    scene = pressed(support=[{"where": "x-min", "fixed": "xz"}, {"where": "x-max", "fixed": "y"}],
                    load=[{"where": "y-min", "traction": [0, 3.0, 0]}, {"acceleration": [0, 0, -9.81]}])
    told = description(replace(one_cell(), scene=scene.to_toml()))
    assert {name: told[name] for name in list(told)[7:]} == {
        "Young's modulus [Pa]": 1e6, "Poisson's ratio": 0.4, "density [kg/m3]": 1000.0, "material law": "neo-hookean",
        "shape of the body": "beam",
        "supports": "x-max (y), x-min (xz)", "loads": "acceleration, y-min", "obstacle": "cylinder"}
    told = description(replace(one_cell(), scene=beam().to_toml()))
    assert (told["supports"], told["loads"], told["obstacle"]) == ("x-min (xyz)", "none", "none")


def test_a_flow_is_told_by_its_fastest_inflow_and_its_reynolds_number():
    """At the inflow (3, 4) m/s in the third frame; a node inside is faster."""
    flow = channel(frames=4)
    flow.fields["velocity"][:, flow.node_kind == INFLOW] = [0.5, 0.5, 0]
    flow.fields["velocity"][2, flow.node_kind == INFLOW] = [3, -4, 0]
    flow.fields["velocity"][1, flow.node_kind == NORMAL] = [30, 40, 0]
    told = description(flow)
    assert told["fastest inflow [m/s]"] == 5 and "Reynolds number" not in told and len(told) == 8
    scene = channel_flow()
    told = description(replace(flow, scene=scene.to_toml()))
    assert told["Reynolds number"] == scene.reynolds_number == pytest.approx(20) and len(told) == 9
    closed = replace(flow, node_kind=np.where(flow.node_kind == INFLOW, WALL, flow.node_kind).astype(np.uint8))
    assert description(closed)["fastest inflow [m/s]"] == 0


def test_of_several_obstacles_none_has_a_path_and_of_several_materials_the_stiffest_and_the_least_compressible_count():
    scene = pressed()
    assert "way of the obstacle [m]" in description(on_paper(scene=scene.to_toml()))
    other = replace(scene.obstacle, path=tuple((x, y, -z) for x, y, z in scene.obstacle.path))
    several = replace(scene, obstacle=(scene.obstacle, other))
    several = replace(several, material=(
        replace(scene.material, young_modulus=3e6, poisson_ratio=0.2, where=Where(box=((0, 0, 0), (1, 1, 1)))), scene.material))
    told = description(on_paper(scene=several.to_toml()))
    assert "way of the obstacle [m]" not in told and told["obstacle"] == several.pressed_by
    assert (told["Young's modulus [Pa]"], told["Poisson's ratio"], told["material law"]) == (3e6, 0.4, "neo-hookean and neo-hookean")


def test_ranges_are_of_those_that_have_a_quantity(monkeypatch):
    told = iter([{"a": 3.0, "word": "red"}, {"a": -1.0, "b": 5.0, "word": "blue"}, {"a": 2.0, "word": "red"}])
    monkeypatch.setattr(module, "description", lambda _: next(told))
    assert seen([1, 2, 3]) == SeenRange({"a": (-1.0, 3.0), "b": (5.0, 5.0)}, {"word": ("blue", "red")}, 3)


@pytest.mark.parametrize("span, value, beyond", [
    ((2.0, 4.0), 1.0, 0.5), ((2.0, 4.0), 7.0, 1.5), ((2.0, 4.0), 2.0, None), ((2.0, 4.0), 4.0, None), ((2.0, 4.0), 3.9, None),
    ((2.0, 4.0), 4.0 + 1.9e-6, None), ((2.0, 4.0), 4.0 + 2.1e-6, 1.05e-6),  # a millionth of the width is rounding
    ((5.0, 5.0), 6.0, 0.2), ((5.0, 5.0), 4.0, 0.2), ((-5.0, -5.0), -15.0, 2.0), ((5.0, 5.0), 5.0, None),  # one value: relative to it
    ((1.0, 1.0 + 0.9e-6), 2.0 + 0.9e-6, 1.0), ((1.0, 1.0 + 1.1e-6), 1 + 3.3e-6, 2.0),  # a width of less than a millionth is none
    ((-1.0 - 0.9e-6, -1.0), 0.0, 1.0), ((0.0, 0.0), 3.0, 3.0), ((-2.0, 2.0), 6.0, 1.0)])
def test_by_how_much_a_value_is_outside(span, value, beyond, monkeypatch):
    monkeypatch.setattr(module, "description", lambda _: {"known": value, "unknown": 1e9, "new word": "any", "word": "red"})
    found = outside(None, SeenRange({"known": span}, {"word": ("blue", "red")}, 2))
    assert found == ({} if beyond is None else {"known": pytest.approx(beyond, rel=1e-4)})


def test_the_farthest_outside_comes_first(monkeypatch):
    monkeypatch.setattr(module, "description", lambda _: {"a": 2.0, "b": 4.0, "word": "green", "c": 3.0})
    found = outside(None, SeenRange(dict.fromkeys("abc", (0.0, 1.0)), {"word": ("blue", "red")}, 2))
    assert list(found.items()) == [("word", math.inf), ("b", 3.0), ("c", 2.0), ("a", 1.0)]


def test_inside_nothing_is_said_and_outside_by_how_much():
    known = seen(TRAINING)
    assert known.trajectories == 2 and known.numbers["extent along x [m]"] == pytest.approx((0.1, 0.12))
    assert outside(TRAINING[0], known) == {}
    far = outside(bending(length=0.13, travel=0.018), known)
    assert far["extent along x [m]"] == pytest.approx(0.5)  # half the width of 20 mm beyond 120 mm
    assert "way of the obstacle [m]" not in far
    assert next(iter(far.values())) == max(far.values())


def test_a_value_that_never_varied_is_compared_by_its_ratio():
    assert outside(bending(length=0.11, travel=0.018, steps=20), seen(TRAINING))["steps"] == pytest.approx(1.0)


def test_words_of_the_scene_count():
    scene = pressed()
    stiffer = replace(scene, material=replace(scene.material, young_modulus=2e6, law="linear"))
    known = seen([replace(TRAINING[0], scene=scene.to_toml())])
    far = outside(replace(TRAINING[0], scene=stiffer.to_toml()), known)
    assert far == {"material law": math.inf, "Young's modulus [Pa]": pytest.approx(1.0)}


def test_the_direction_of_the_push_is_a_word():
    up = TRAINING[0].displacement.copy()
    up[:, ~TRAINING[0].body] *= -1
    assert description(TRAINING[0])["direction of the obstacle"] == "-z"
    assert outside(replace(TRAINING[0], displacement=up), seen(TRAINING))["direction of the obstacle"] == math.inf


def test_ranges_survive_their_file(tmp_path):
    known = seen(TRAINING)
    assert read_seen(tmp_path) is None
    write_seen(tmp_path, known)
    assert read_seen(tmp_path) == known
    (tmp_path / FILE).write_text(json.dumps({"numbers": 3}))
    with pytest.raises(InputError, match="not the ranges of a run"):
        read_seen(tmp_path)
