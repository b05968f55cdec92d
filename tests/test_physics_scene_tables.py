"""Tables of steps beside a scene: what is read from a CSV file, and what is refused in one line."""

import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import read_trajectory
from physics.scene import Scene, load_scene, read_scene
from physics.schema import InputError

SCENE = """
[body]
length = 0.06
width = 0.02
height = 0.02
cells = [3, 1, 1]
[material]
young_modulus = 1e6
poisson_ratio = 0.3
[[support]]
where = "x-min"
[[load]]
where = "x-max"
traction = [0.0, 0.0, -50.0]
table = "load.csv"
[steps]
count = 4
"""
OBSTACLE = """
[obstacle]
shape = "sphere"
radius = 0.01
table = "path.csv"
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "load.csv").write_text("\ufefftime, factor\n0, 0\n\n# a remark\n1.5, 2\n6, -1\n", encoding="utf-8")
    (tmp_path / "path.csv").write_text("0, 0.05, 0.01, 0.04\n2, 0.05, 0.01, 0.035\n4, 0.05, 0.01, 0.04\n")
    return tmp_path / "scene.toml"


def test_the_last_row_is_the_last_step_and_names_and_remarks_are_passed_over(scene):
    load = load_scene(scene).load[0]
    assert load.steps == (0.0, 0.25, 1.0) and load.factor == (0.0, 2.0, -1.0)


def test_an_obstacle_has_its_way_points_from_a_file(scene):
    scene.write_text(SCENE + OBSTACLE)
    obstacle = load_scene(scene).obstacle
    assert obstacle.steps == (0.0, 0.5, 1.0) and obstacle.path[1] == (0.05, 0.01, 0.035)


def test_the_trajectory_no_longer_needs_the_file(scene, tmp_path):
    assert fidelity.main(["simulate", str(scene), "--out", str(tmp_path / "t.vtkhdf")]) == 0
    (tmp_path / "load.csv").unlink()
    made = read_trajectory(tmp_path / "t.vtkhdf")
    assert Scene.from_toml(made.scene).load[0].factor == (0.0, 2.0, -1.0)
    down = made.displacement[:, made.points[:, 0] > 0.059, 2].mean(axis=1)
    np.testing.assert_allclose(down / down[1], [0, 1, 0.5, 0, -0.5], atol=2e-3)  # nearly linear: 2, 1, 0, -1


@pytest.mark.parametrize(("text", "said"), [
    ("1, 0\n2, 1\n", "line 1: the first column must start at 0 and rise; it is 1"),
    ("0, 0\n2, 1\n2, 0\n", "line 3: the first column must start at 0 and rise; it is 2 after 2"),
    ("0, 0\n", "1 rows; 2 to 100000"),
    ("", "0 rows"),
    ("0, 0\n1, x\n", "line 2: 1,  x: numbers are expected, with commas between them"),
    ("0, 0\n1, nan\n", "line 2: 2 finite numbers"),
    ("0, 0\n1, 2, 3\n", "line 2: 2 finite numbers are expected: step, factor"),
    ("0, 0.5\n1, 1\n", r"load\[0\].factor: must start at 0"),
])
def test_a_file_that_is_no_table_is_refused_in_one_line(scene, text, said, capsys, tmp_path):
    (tmp_path / "load.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        load_scene(scene)
    assert fidelity.main(["simulate", str(scene), "--out", str(tmp_path / "t.vtkhdf")]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "t.vtkhdf").exists()


def test_a_file_that_is_missing_or_binary_is_refused(scene, tmp_path):
    (tmp_path / "load.csv").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(InputError, match="not a CSV file"):
        load_scene(scene)
    (tmp_path / "load.csv").unlink()
    with pytest.raises(InputError, match=r"load.csv: No such file"):
        load_scene(scene)
    scene.write_text(SCENE.replace("table", "factor = [0, 1]\ntable"))
    with pytest.raises(InputError, match=r"load\[0\]: give either table or factor"):
        load_scene(scene)
    scene.write_text(SCENE.replace('"load.csv"', "3"))
    with pytest.raises(InputError, match=r"load\[0\].table must be the name"):
        load_scene(scene)


@pytest.mark.parametrize(("where", "changes", "said"), [
    ("load", {"steps": [0, 1], "factor": [0, 1, 2]}, "2 steps for 3 values of factor"),
    ("load", {"steps": [0, 1]}, "2 steps for 0 values"),
    ("load", {"factor": [0, 1]}, "factor: needs steps"),
    ("load", {"steps": [0, 0.5], "factor": [0, 1]}, "rise from 0 to 1"),
    ("load", {"steps": [0.1, 1], "factor": [0, 1]}, "rise from 0 to 1"),
    ("load", {"steps": [0, 1, 1], "factor": [0, 1, 1]}, "rise from 0 to 1"),
    ("load", {"steps": [0, 1.5, 1], "factor": [0, 1, 1]}, "rise from 0 to 1"),
    ("load", {"steps": [0, 0.5, 0.5, 1], "factor": [0, 1, 1, 0]}, "rise from 0 to 1"),
    ("load", {"steps": [0], "factor": [0]}, "rise from 0 to 1"),
    ("load", {"steps": [0, 1], "factor": [1, 1]}, "must start at 0"),
    ("load", {"steps": [0, 1], "factor": [0, 1], "sudden": True}, "is not sudden"),
    ("support", {"angle": 3.0}, "has an axis and an angle"),
    ("support", {"centre": [0, 0, 0]}, "has an axis and an angle"),
    ("support", {"axis": [0, 0, 0], "angle": 3.0}, "zero vector"),
    ("support", {"axis": [0, 0, 1], "angle": 3.0, "fixed": "xy"}, "hold all of xyz"),
    ("support", {"axis": [0, 0, 1], "angle": 1e9}, "at most 36000 degrees"),
    ("obstacle", {"steps": [0, 0.5, 1]}, "3 steps for 2 values of path"),
])
def test_a_table_that_does_not_fit_is_refused(where, changes, said):
    table = {"body": {"length": 1.0, "width": 0.1, "height": 0.1, "cells": [4, 1, 1]}, "support": [{"where": "x-min"}],
             "material": {"young_modulus": 1.0, "poisson_ratio": 0.0}, "steps": {"dynamic": True, "duration": 1.0},
             "load": [{"where": "x-max", "traction": [1.0, 0, 0]}],
             "obstacle": {"shape": "sphere", "radius": 0.1, "path": [[0, 0, 1], [0, 0, 2]]}}
    table[where] = table[where] | changes if where == "obstacle" else [table[where][0] | changes]
    with pytest.raises(InputError, match=said):
        read_scene(table)
