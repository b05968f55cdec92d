"""Values of a scene changed on the command line: any key, entries of arrays, new tables; and what leads nowhere."""

import pytest

import fidelity
from datagen import read_trajectory
from physics.scene import Scene, load_scene
from physics.schema import InputError
from tests.scenes import beam, pressed

SMALL = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 1, 1]}


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "s.toml").write_text(pressed(body=SMALL, steps={"count": 2}).to_toml())
    return tmp_path / "s.toml"


def test_any_value_can_be_changed_and_the_rest_stays(scene):
    changed = load_scene(scene, ["obstacle.radius=0.012", "body.cells[2] = 3", "support[0].fixed=xy", "name=thick",
                                 "obstacle.path[1][2]=0.02", 'material.law="linear"', "steps.dynamic = false"])
    before = load_scene(scene)
    assert (before.obstacle.radius, before.body.cells, before.support[0].fixed) == (0.01, (4, 1, 1), "xyz")
    assert (changed.obstacle.radius, changed.body.cells, changed.support[0].fixed, changed.name) == (0.012, (4, 1, 3), "xy", "thick")
    assert changed.obstacle.path == (before.obstacle.path[0], (0.05, 0.01, 0.02)) and changed.material.law == "linear"
    assert changed.body.length == before.body.length and changed.steps == before.steps


def test_keys_that_are_not_there_yet_can_be_given(tmp_path):
    (tmp_path / "s.toml").write_text(beam(body=SMALL).to_toml())
    ball = load_scene(tmp_path / "s.toml", ["obstacle.shape=sphere", "obstacle.radius=0.5", "obstacle.path=[[0, 0, 1]]"]).obstacle
    assert (ball.shape, ball.radius, ball.path) == ("sphere", 0.5, ((0.0, 0.0, 1.0),))


@pytest.mark.parametrize("text, words", [
    ("obstacle.radius", "must be KEY=VALUE"), ("=3", "must be KEY=VALUE"), ("a b=3", "must be KEY=VALUE"),
    ("support[1].fixed=x", r"there is no entry \[1\] there"), ("body[0]=1", r"there is no entry \[0\] there"),
    ("body.length.x=1", "there is no x there|there is no length"), ("obstacle.radius=-1", "obstacle.radius = -1.0: must be at least 0 m"),
    ("obstacle.radus=1", "did you mean 'radius'"), ("obstacle.radius=big", "must be a number, not a string"),
    ("body.cells[7]=1", r"there is no entry \[7\] there")])
def test_what_leads_nowhere_is_refused_in_one_line(scene, text, words):
    with pytest.raises(InputError, match=words):
        load_scene(scene, [text])


def test_simulate_writes_the_changed_scene_beside_its_solution(scene, tmp_path):
    out = str(tmp_path / "t.vtkhdf")
    assert fidelity.main(["simulate", str(scene), "--out", out, "--set", "obstacle.radius=0.009", "steps.count=3"]) == 0
    made = read_trajectory(out)
    assert Scene.from_toml(made.scene) == load_scene(scene, ["obstacle.radius=0.009", "steps.count=3"]) and len(made.displacement) == 4
    assert fidelity.main(["modes", str(scene), "--count", "1", "--out", out, "--set", "material.young_modulus=4e6"]) == 0
    assert Scene.from_toml(read_trajectory(out).scene).material.young_modulus == 4e6
    assert fidelity.main(["modes", str(scene), "--kind", "laplacian", "--set", "body.length=1"]) == 2
