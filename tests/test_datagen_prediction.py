"""Which files a prediction may be held against, and that what is compared is the body of both; what is measured stands in physics."""

import dataclasses
import json
import math
import types

import numpy as np
import pytest

from datagen.files import prediction
from datagen.files.prediction import lines, mistaken, read_truth, verify_files
from datagen.files.trajectory import write_trajectory
from physics.fidelity.figures import FIGURES
from physics.schema import InputError, finite
from tests.full_disk import full_after
from tests.unsolved import scene, trajectory


def still_scene(**changes):
    return scene(steps={"count": 3}, **changes)


BODY = {"length": 0.05, "width": 0.02, "height": 0.01, "cells": [3, 2, 1], "cell": "hexahedron"}


@pytest.fixture
def truth(tmp_path):
    made = trajectory(still_scene())
    u = made.displacement.copy()
    u[1:, made.free] = np.arange(1, 4)[:, None, None] * np.float32(1e-3)
    write_trajectory(tmp_path / "truth.vtkhdf", dataclasses.replace(made, displacement=u, extra={"linear_steps": 2}))
    return dataclasses.replace(made, displacement=u)


def test_numbers_that_json_has_no_word_for_become_none():
    given = {"a": math.nan, "b": [1.5, (math.inf, -math.inf, 2)], "c": "x", "d": None, "e": {"f": 0.0}}
    assert finite(given) == {"a": None, "b": [1.5, [None, None, 2]], "c": "x", "d": None, "e": {"f": 0.0}}


def test_a_truth_comes_with_the_law_of_its_last_step(truth, tmp_path):
    """Two steps of three were linear, then all three."""
    path = tmp_path / "truth.vtkhdf"
    read, given, mesh = read_truth(path)
    assert given == still_scene() and np.array_equal(read.displacement, truth.displacement)
    assert np.array_equal(mesh.points, read.mesh.points)
    write_trajectory(path, dataclasses.replace(truth, extra={"linear_steps": 3}))
    assert read_truth(path)[1].material.law == "linear"


@pytest.mark.parametrize(("change", "words"), [
    ({"scene": ""}, "holds no scene"), ({"scene": "]"}, "its scene is wrong"),
    ({"scene": 'name = "x"'}, "its scene is wrong: body: missing"),
    ({"scene": scene().to_toml(), "complete": True}, "a body in motion"), ({"complete": False}, "the solver stopped"),
    ({"scene": still_scene(body=BODY | {"cells": [3, 2, 2]}).to_toml()}, "its mesh"),
    ({"scene": still_scene(body=BODY | {"length": 0.06}).to_toml()}, "its mesh")])
def test_what_is_no_truth_is_refused(truth, tmp_path, change, words):
    write_trajectory(tmp_path / "truth.vtkhdf", dataclasses.replace(truth, **change))
    with pytest.raises(InputError, match=rf"truth\.vtkhdf: .*{words}"):
        read_truth(tmp_path / "truth.vtkhdf")


def test_a_mesh_of_the_same_points_and_other_cells_is_no_truth(truth, tmp_path):
    cells = truth.connectivity.copy()
    cells[[0, 1]] = cells[[1, 0]]
    write_trajectory(tmp_path / "truth.vtkhdf", dataclasses.replace(truth, connectivity=cells))
    with pytest.raises(InputError, match="its mesh is not the one"):
        read_truth(tmp_path / "truth.vtkhdf")


@pytest.fixture
def predicted(truth, tmp_path):
    made = dataclasses.replace(truth, displacement=truth.displacement * np.float32(1.5), complete=False, scene="")
    write_trajectory(tmp_path / "p.vtkhdf", made)
    return made


def table(error, **changes):
    """Figures of one prediction, all alike but for the error and the changes."""
    return dict.fromkeys(FIGURES, 0.25) | {"inverted_elements": 0, "worst_step": 2, "rmsd_all": error} | changes


@pytest.fixture
def asked(monkeypatch):
    """What is asked of `verify`, which answers an error of 1 mm, of 8 mm for a body at rest; and of the picture."""
    given = types.SimpleNamespace(calls=[], pictures=[])

    def verify(u, v, *, scene, mesh, free):
        given.calls.append((u, v, scene, len(mesh.points), free))
        return types.SimpleNamespace(u=u)

    monkeypatch.setattr(prediction, "verify", verify)
    monkeypatch.setattr(prediction, "as_table", lambda found: table(1e-3 if found.u.any() else 8e-3, effectivity=math.nan))
    monkeypatch.setattr("physics.view.frame_picture", lambda path, mesh, **how: given.pictures.append((path, how)))
    return given


def test_the_bodies_are_compared_prediction_first_and_beside_a_body_at_rest(truth, predicted, tmp_path, asked):
    files = tmp_path / "p.vtkhdf", tmp_path / "truth.vtkhdf"
    found = verify_files(*files)
    assert found["worst_step"] == 2 and math.isnan(found["effectivity"]) and not asked.pictures
    assert (found["rmsd_all"], found["nothing_moves"]["rmsd_all"], found["units"]["gf_c"]) == (1e-3, 8e-3, "m2")
    assert found["verdict"] == ("Better than if nothing moved: 1 mm off, 8 times closer; 25 % of the largest reaction is missing to "
                                "equilibrium, the obstacle is up to 250 mm inside the body, no cell is turned inside out.")
    body = truth.body
    (u, v, given, nodes, free), (still, *_) = asked.calls
    assert np.array_equal(u, predicted.displacement[:, body]) and np.array_equal(v, truth.displacement[:, body]) and given == still_scene()
    assert nodes == 24 and free.tolist() == truth.free[:24].tolist() and free.sum() == 18
    assert not still[:, free].any() and np.array_equal(still[:, ~free], v[:, ~free])
    verify_files(*files, tmp_path / "deep" / "report")
    kept = json.loads((tmp_path / "deep" / "report" / "verify.json").read_text())
    assert (kept["worst_step"], kept["effectivity"], kept["verdict"]) == (2, None, found["verdict"])
    path, given = asked.pictures[0]
    assert path == tmp_path / "deep" / "report" / "worst.png" and (given["step"], given["steps"]) == (2, 3)
    assert np.array_equal(given["prediction"], u[2]) and np.array_equal(given["truth"], v[2])
    points, displacement = truth.points[24:], truth.displacement[2, 24:]
    assert np.allclose(given["obstacle"].points, points + displacement, atol=1e-9) and displacement.any()


def test_on_a_full_disk_the_error_says_the_name_of_the_report(truth, predicted, tmp_path, asked):
    with full_after(100), pytest.raises(OSError) as error:
        verify_files(tmp_path / "p.vtkhdf", tmp_path / "truth.vtkhdf", tmp_path / "report")
    assert error.value.filename == str(tmp_path / "report" / "verify.json") and not list((tmp_path / "report").iterdir())


def test_every_figure_stands_in_its_unit_beside_that_of_a_body_at_rest(truth, predicted, tmp_path, asked):
    said = lines(verify_files(tmp_path / "p.vtkhdf", tmp_path / "truth.vtkhdf"))
    assert said[0].split() == ["prediction", "nothing", "moves"] and len(said) == 1 + len(FIGURES) + 2
    assert said[3].split() == ["RMSD-all", "[mm]", "1", "8"] and [line.split() for line in said if "GF_c" in line] == [
        ["GF_c", "[mm²]", "2.5e+05", "2.5e+05"]]
    assert [line.split()[-2:] for line in said if line.startswith("effectivity")] == [["–", "–"]]
    assert said[-2].split() == ["farthest", "off", "at", "frame", "2"] and said[-1].startswith("Better than if nothing moved")


def test_folders_are_held_against_each_other_by_the_names_of_their_files(truth, predicted, tmp_path, monkeypatch, asked):
    for name in ("train/a", "test/a", "test/b"):
        (tmp_path / "data" / name).parent.mkdir(parents=True, exist_ok=True)
        write_trajectory(tmp_path / "data" / f"{name}.vtkhdf", truth)
    (tmp_path / "mine").mkdir()
    for name in "ab":
        write_trajectory(tmp_path / "mine" / f"{name}.vtkhdf", predicted)
    errors = iter([table(1e-3, largest_penetration=0.5), table(8e-3), table(3e-3, largest_penetration=0.125), table(4e-3)])
    monkeypatch.setattr(prediction, "as_table", lambda found: next(errors))
    found = verify_files(tmp_path / "mine", tmp_path / "data" / "test")
    assert found["rmsd_all"] == 2e-3 and found["nothing_moves"]["rmsd_all"] == 6e-3 and found["largest_penetration"] == 0.5
    assert {name: figures["rmsd_all"] for name, figures in found["files"].items()} == {"a": 1e-3, "b": 3e-3} and "worst_step" not in found
    assert "b: RMSD-all 3 mm, residual 0.25" in lines(found)
    for one, other, words in (("mine", "data", "holds several files of the name a.vtkhdf"), ("data", "mine", "holds no file"),
                              ("mine", "truth.vtkhdf", "mine is a folder and .*truth.vtkhdf is not one"),
                              ("truth.vtkhdf", "mine", "mine is a folder and .*truth.vtkhdf is not one"),
                              ("nowhere", "mine", "nowhere: no such file or folder"), ("mine", "nowhere", "no such file or folder"),
                              ("empty", "mine", "no trajectory files")):
        (tmp_path / "empty").mkdir(exist_ok=True)
        if other == "mine" and one == "data":
            write_trajectory(tmp_path / "data" / "test" / "c.vtkhdf", truth)
        with pytest.raises(InputError, match=words):
            verify_files(tmp_path / one, tmp_path / other)


def test_millimetres_and_positions_are_noticed(truth, tmp_path):
    def told(u):
        return mistaken(u, truth.displacement[:, truth.body], truth.points[truth.body])

    u = truth.displacement[:, truth.body].astype(float)
    rough = u + 2e-4 * np.random.default_rng(0).standard_normal(u.shape)
    assert told(rough) == told(100 * u) == told(1e4 * u) == told(-1e3 * u) == told(0 * u) == told(1e3 * (rough - u)) == ""
    assert told(299 * u) == told(3000.5 * u) == "" and "millimetres" in told(301 * u) and "millimetres" in told(2999 * u)
    assert "are they in millimetres?" in told(1e3 * rough) and "1e+03 times" in told(1e3 * u)
    assert "positions" in told(rough + truth.points[truth.body])
    write_trajectory(tmp_path / "p.vtkhdf", dataclasses.replace(truth, displacement=1000 * truth.displacement))
    with pytest.raises(InputError, match=r"p\.vtkhdf: its displacements are 1e\+03 times"):
        verify_files(tmp_path / "p.vtkhdf", tmp_path / "truth.vtkhdf")


def test_a_prediction_of_another_mesh_or_with_holes_is_refused(truth, predicted, tmp_path, monkeypatch):
    def refused(words, **change):
        write_trajectory(tmp_path / "p.vtkhdf", dataclasses.replace(predicted, **change))
        with pytest.raises(InputError, match=rf"p\.vtkhdf: .*{words}"):
            verify_files(tmp_path / "p.vtkhdf", tmp_path / "truth.vtkhdf")

    points = predicted.points.copy()
    points[3, 1] += 1e-9
    refused("is not that of", points=points)
    refused("is not that of", displacement=predicted.displacement[:-1])
    for frame, value in ((2, np.nan), (1, np.inf)):
        holed = predicted.displacement.copy()
        holed[frame:, 4, 2] = value
        refused(f"not finite at frame {frame}", displacement=holed)
