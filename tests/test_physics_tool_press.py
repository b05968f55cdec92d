"""Bodies pressed by triangles: three tools beside the smooth shapes that they stand for, and all that is made of a trajectory."""

import json

import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import read_trajectory
from datagen.sets.check import against_scene
from physics import read_scene, solve
from tests.tools import ball, brick, spanner, written

BODY = {"body": {"shape": "plate", "length": 0.1, "width": 0.06, "height": 0.01, "cells": [10, 6, 1], "cell": "hexahedron"},
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 8}}


def scene(path, **obstacle):
    return read_scene(BODY | {"obstacle": obstacle | {"path": path}})


def pressed(path, **obstacle):
    found = solve(scene(path, **obstacle))
    assert not found.failure and found.relative_residual.max() <= 1e-6
    return found


def test_a_ball_of_triangles_presses_as_a_ball_does_to_the_size_of_its_triangles(tmp_path):
    path, off = [[0.07, 0.025, 0.0205], [0.07, 0.027, 0.014]], []
    smooth = pressed(path, shape="sphere", radius=0.01)
    for size in (0.006, 0.003):
        found = pressed(path, shape="mesh", file=written(tmp_path / "ball.stl", ball(0.01, size)))
        off.append(abs(found.displacement - smooth.displacement).max())
        assert off[-1] < size / 8  # the free end turns and slides a little more than what touches is off
        assert found.reaction[-1, 2] == pytest.approx(smooth.reaction[-1, 2], rel=0.1)
    assert off[1] < off[0] / 2
    assert found.newton_iterations.sum() < 1.3 * smooth.newton_iterations.sum()


def test_a_turned_brick_of_triangles_presses_as_the_rounded_box_does(tmp_path):
    path, keys = [[0.07, 0.03, 0.0208], [0.07, 0.03, 0.015]], {"axis": [1.0, 0.2, 0.1], "angle": 30.0}
    half, radius = np.array([0.012, 0.008, 0.006]), 0.003
    smooth = pressed(path, shape="box", size=list(2 * half), radius=radius, **keys)
    found = pressed(path, shape="mesh", file=written(tmp_path / "brick.stl", brick(half, radius, 0.002)), **keys)
    assert abs(found.displacement - smooth.displacement).max() < 0.002 / 8
    assert found.reaction[-1, 2] == pytest.approx(smooth.reaction[-1, 2], rel=0.12)  # an edge against few points


def test_a_spanner_is_followed_with_its_force_and_without_its_file(tmp_path, capsys):
    """Solved, written, checked, shown and verified from the trajectory alone; flat on a plate its jaw presses with its edges."""
    file = written(tmp_path / "spanner.stl", spanner())
    table = BODY | {"obstacle": {"shape": "mesh", "file": "spanner.stl", "scale": 0.001, "axis": [0, 0, 1], "angle": 20.0,
                                 "path": [[0.09, 0.03, 0.0135], [0.09, 0.03, 0.01]]}}
    import tomli_w

    (tmp_path / "s.toml").write_text(tomli_w.dumps(table))
    out = tmp_path / "s.vtkhdf"
    assert fidelity.main(["simulate", str(tmp_path / "s.toml"), "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert "rigid mesh (spanner.stl)" in said["model"]["contact"]
    (tmp_path / "spanner.stl").unlink()
    made = read_trajectory(out)
    assert against_scene(made, steps=3) == [] and made.per_frame["reaction"][-1][2] > 0.1
    points, triangles = made.obstacle
    assert len(triangles) == 44 and points.shape[:2] == (9, 24) and abs(points[-1] - points[0] - [0, 0, -0.0035]).max() < 1e-8
    assert fidelity.main(["view", str(out), "--out", str(tmp_path / "s.html")]) == 0 and capsys.readouterr()
    assert fidelity.main(["verify", str(out), "--reference", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["relative_residual"] < 1e-5  # of single precision
    assert file.endswith(".stl")


def test_a_bad_file_is_one_line_and_status_2(tmp_path, capsys):
    points, triangles = spanner()
    written(tmp_path / "open.stl", (points, triangles[1:]))
    (tmp_path / "s.toml").write_text('[body]\nlength = 0.1\nwidth = 0.02\nheight = 0.02\ncells = [4, 1, 1]\n[material]\nyoung_modulus = '
                                     '1e6\npoisson_ratio = 0.4\n[obstacle]\nshape = "mesh"\nfile = "open.stl"\npath = [[0, 0, 1]]\n')
    assert fidelity.main(["simulate", str(tmp_path / "s.toml"), "--out", str(tmp_path / "s.vtkhdf")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and "obstacle.file" in said[0] and "is not closed: the edge from" in said[0]
    assert not (tmp_path / "s.vtkhdf").exists()


@pytest.mark.slow
def test_two_tools_are_felt_as_one_each(tmp_path):
    """Beside each other on a plate, a ball of triangles and a ball: the force of each is that of the other way round, mirrored."""
    mesh = {"shape": "mesh", "file": written(tmp_path / "ball.stl", ball(0.01, 0.004))}
    forces = []
    for first, second in ((mesh, {"shape": "sphere", "radius": 0.01}), ({"shape": "sphere", "radius": 0.01}, mesh)):
        both = [each | {"path": [[0.07, y, 0.0205], [0.07, y, 0.016]]} for each, y in ((first, 0.015), (second, 0.045))]
        forces.append(solve(read_scene(BODY | {"obstacle": both})).reactions[-1])
    assert forces[0][0] == pytest.approx(forces[1][1] * [1, -1, 1], rel=0.05, abs=0.05 * abs(forces[0]).max())
