"""Which files a prediction may be held against, and that what is compared is the body of both; what is measured stands in physics."""

import dataclasses
import json
import math
import types

import numpy as np
import pytest

from datagen.files import prediction
from datagen.files.prediction import finite, read_truth, verify_files
from datagen.files.trajectory import write_trajectory
from physics.schema import InputError
from tests.unsolved import scene, trajectory


def still(**changes):
    return scene(steps={"count": 3}, **changes)


BODY = {"length": 0.05, "width": 0.02, "height": 0.01, "cells": [3, 2, 1], "cell": "hexahedron"}


@pytest.fixture
def truth(tmp_path):
    made = trajectory(still())
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
    assert given == still() and np.array_equal(read.displacement, truth.displacement) and np.array_equal(mesh.points, read.mesh.points)
    write_trajectory(path, dataclasses.replace(truth, extra={"linear_steps": 3}))
    assert read_truth(path)[1].material.law == "linear"


@pytest.mark.parametrize(("change", "words"), [
    ({"scene": ""}, "holds no scene"), ({"scene": "]"}, "its scene is wrong"),
    ({"scene": 'name = "x"'}, "its scene is wrong: body: missing"),
    ({"scene": scene().to_toml(), "complete": True}, "a body in motion"), ({"complete": False}, "the solver stopped"),
    ({"scene": still(body=BODY | {"cells": [3, 2, 2]}).to_toml()}, "its mesh"),
    ({"scene": still(body=BODY | {"length": 0.06}).to_toml()}, "its mesh")])
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


def test_the_bodies_are_compared_prediction_first(truth, predicted, tmp_path, monkeypatch):
    asked = []

    def verify(u, v, *, scene, mesh, free):
        asked.append((u, v, scene, len(mesh.points), free))
        return types.SimpleNamespace(worst_step=2)

    monkeypatch.setattr(prediction, "verify", verify)
    monkeypatch.setattr(prediction, "as_table", lambda found: {"worst_step": found.worst_step, "ratio": math.nan})
    pictures = []
    monkeypatch.setattr("physics.view.frame_picture", lambda path, mesh, **given: pictures.append((path, given)))
    files = tmp_path / "p.vtkhdf", tmp_path / "truth.vtkhdf"
    found = verify_files(*files)
    assert found["worst_step"] == 2 and math.isnan(found["ratio"]) and not pictures
    body = truth.body
    u, v, given, nodes, free = asked[0]
    assert np.array_equal(u, predicted.displacement[:, body]) and np.array_equal(v, truth.displacement[:, body]) and given == still()
    assert nodes == 24 and free.tolist() == truth.free[:24].tolist() and free.sum() == 18
    verify_files(*files, tmp_path / "deep" / "report")
    assert json.loads((tmp_path / "deep" / "report" / "verify.json").read_text()) == {"worst_step": 2, "ratio": None}
    path, given = pictures[0]
    assert path == tmp_path / "deep" / "report" / "worst.png" and (given["step"], given["steps"]) == (2, 3)
    assert np.array_equal(given["prediction"], u[2]) and np.array_equal(given["truth"], v[2])


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
