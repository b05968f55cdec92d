"""What is compared with what: which trajectories of a set, which predictors and how much cheaper each, on one thread."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from learning.prediction.predictor import Case, LeftOut
from learning.prediction.rivals import REFERENCE
from learning.report import compare as module
from physics.equilibrium.newton import TOLERANCE
from physics.mesh.build import build_mesh
from physics.scene import load_scene
from physics.schema import InputError
from tests.scenes import beam, pressed

SMALL = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 1, 2]}
TRIVIAL = ["nothing moves", "keep the last velocity", "quadratic extrapolation"]
CHEAPER = [
    "FE, cells twice as large",
    "FE, cells four times as large",
    "FE, a tenth of the steps, tolerance 0.001",
    "FE, a twentieth of the steps, tolerance 0.01",
    "FE, tolerance 0.01",
    "FE, cells twice as large, a tenth of the steps",
    "FE, linear elasticity",
    "reduced-order model",
    "reduced-order model, few poses",
]


def model(estimate: bool = False):
    return SimpleNamespace(config=SimpleNamespace(estimate=estimate), title="M4GN")


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "press.TOML"
    path.write_text(pressed(body=SMALL, steps={"count": 3}).to_toml())
    return path


@pytest.mark.parametrize("count, chosen", [(1, [0]), (2, [0, 10]), (3, [0, 5, 10]), (4, [0, 3, 7, 10]), (11, list(range(11))),
                                           (50, list(range(11)))])
def test_trajectories_of_a_set_are_evenly_spaced(monkeypatch, count, chosen):
    monkeypatch.setattr(module, "files", lambda folder, split: [f"{folder}/{split}/{i}" for i in range(11)])
    monkeypatch.setattr(module, "load_cases", lambda found: found)
    assert module.some_cases("data", "valid", count) == [f"data/valid/{i}" for i in chosen]


def test_a_scene_is_solved_and_is_its_own_truth(scene):
    case, = module.scene_case(scene)
    assert case.name == "press" and case.steps == 3 and case.scene == load_scene(scene)
    assert np.array_equal(case.mesh.points, build_mesh(load_scene(scene).body).points) and abs(case.truth[-1]).max() > 0.01
    assert case.free.sum() == 24  # 5 x 2 x 3 nodes, of which 6 are held


@pytest.mark.parametrize("changes", [{"steps": {"count": 4, "duration": 0.1, "dynamic": True}},
                                     {"body": SMALL | {"cell": "hexahedron", "order": 2}}])
def test_scenes_in_motion_and_of_second_order_are_refused(tmp_path, changes):
    (tmp_path / "s.toml").write_text((pressed if "steps" in changes else beam)(**{"body": SMALL} | changes).to_toml())
    with pytest.raises(InputError, match=r"s\.toml: the comparison takes quasi-static scenes of first-order cells"):
        module.scene_case(tmp_path / "s.toml")


def test_a_scene_without_a_solution_says_where_it_ended(scene, monkeypatch):
    stopped = SimpleNamespace(complete=False, extra={"failure": "no equilibrium at step 2"})
    monkeypatch.setattr(module, "trajectory_of", lambda given: stopped)
    with pytest.raises(RuntimeError, match=r"press\.TOML: no equilibrium at step 2"):
        module.scene_case(scene)


def test_classical_methods_stand_among_themselves_the_reference_last():
    found = module.predictors({})
    assert [each.name for each in found] == [*TRIVIAL, *CHEAPER, REFERENCE]
    assert [each.kind for each in found] == ["trivial"] * 3 + ["fe"] * 7 + ["reduced", "reduced", "reference"]


def test_of_one_run_the_network_comes_first_of_several_each_with_the_name_of_its_folder():
    rungs = ["", ", corrected 10-fold", ", as the start of Newton"]
    one = module.predictors({"runs/a": model()})
    assert [(each.name, each.kind) for each in one[:3]] == [
        ("M4GN" + rung, kind) for rung, kind in zip(rungs, ("learned", "hybrid", "hybrid"), strict=True)
    ]
    assert one[3].name == "nothing moves" and len(one) == 16
    two = module.predictors({"runs/a": model(), "more/b": model(estimate=True)})
    assert [each.name for each in two[:7]] == [*("M4GN a" + rung for rung in rungs), *("M4GN b" + rung for rung in rungs), TRIVIAL[0]]


def test_two_runs_of_one_name_are_refused():
    with pytest.raises(InputError, match="the folders a/run, b/run must have different names"):
        module.predictors({"a/run": model(), "b/run": model()})


def test_each_is_cheaper_by_what_its_name_says(monkeypatch):
    """What the solver is asked for: cells, steps, tolerance and law of each, for 60 steps of a beam of 12 x 4 x 4 cells."""
    asked = {}

    def follow(scene, tolerance, mesh=None):
        asked[name] = (scene.body.divisions, scene.steps.count, tolerance, scene.material.law)
        raise LeftOut("enough")

    monkeypatch.setattr("learning.prediction.rivals.follow", follow)
    case = SimpleNamespace(scene=pressed(), steps=60)
    for each in module.predictors({}):
        if each.kind in ("fe", "reference"):
            name = each.name
            with pytest.raises(LeftOut):
                each.predict(case)
    assert asked == {
        "FE, cells twice as large": ((6, 2, 2), 60, TOLERANCE, "neo-hookean"),
        "FE, cells four times as large": ((3, 2, 2), 60, TOLERANCE, "neo-hookean"),
        "FE, a tenth of the steps, tolerance 0.001": ((12, 4, 4), 6, 1e-3, "neo-hookean"),
        "FE, a twentieth of the steps, tolerance 0.01": ((12, 4, 4), 3, 1e-2, "neo-hookean"),
        "FE, tolerance 0.01": ((12, 4, 4), 60, 0.01, "neo-hookean"),
        "FE, cells twice as large, a tenth of the steps": ((6, 2, 2), 6, TOLERANCE, "neo-hookean"),
        "FE, linear elasticity": ((12, 4, 4), 60, TOLERANCE, "linear"), REFERENCE: ((12, 4, 4), 60, TOLERANCE, "neo-hookean")}


def test_two_kinds_of_newton_are_one_step_and_the_whole_iteration(monkeypatch):
    asked = []
    monkeypatch.setattr("learning.prediction.surrogates.corrected_rollout",
                        lambda model, trajectory, scene, mesh, count: asked.append(count) or 1 / 0)
    monkeypatch.setattr("learning.prediction.surrogates._modes_seconds", lambda model, case: 0.0)
    for each in module.predictors({"a": model()})[1:3]:
        with pytest.raises(ZeroDivisionError):
            each.predict(Case("", None, "scene", None))
    assert asked == [1, None]


@pytest.fixture
def reported(monkeypatch):
    """compare() with a report that is not made: what it was asked for."""
    given = {}

    def report_on(predictors, cases, out, **how):
        given.update(how, names=[each.name for each in predictors], cases=cases, out=out, threads=torch.get_num_threads())
        if given.get("fail"):
            raise RuntimeError("failed")
        return {"summary": "words"}

    monkeypatch.setattr(module, "report_on", report_on)
    monkeypatch.setattr(module, "load_model", lambda run, device: model())
    monkeypatch.setattr(module, "scene_case", lambda path: ["scene", path])
    monkeypatch.setattr(module, "some_cases", lambda *how: ["set", how, "third"])
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield given
    torch.set_num_threads(before)


def test_a_scene_file_is_one_case_and_a_folder_a_set(reported, tmp_path):
    assert module.compare("a.toml", ["runs/x"], str(tmp_path), repeats=7, say=print) == {"summary": "words"}
    assert reported["cases"] == ["scene", "a.toml"] and reported["out"] == tmp_path and reported["title"] == "Speed against error"
    assert (reported["refined"], reported["repeats"], reported["say"]) == (2, 7, print)  # all cases, here "two", are solved finer
    assert list(reported["runs"]) == ["runs/x"] and reported["names"][0] == "M4GN" and len(reported["names"]) == 16
    module.compare("B.TOML", [], tmp_path)
    assert reported["cases"] == ["scene", "B.TOML"] and (reported["repeats"], reported["say"], reported["runs"]) == (3, None, {})
    module.compare("data", [], tmp_path, count=9, split="valid", refined=0)
    assert reported["cases"] == ["set", ("data", "valid", 9), "third"] and reported["refined"] == 0
    module.compare("data", [], tmp_path)
    assert reported["cases"][1] == ("data", "test", 5) and reported["refined"] == 3


def test_networks_run_on_one_thread_and_the_number_before_comes_back(reported, tmp_path):
    module.compare("data", [], tmp_path)
    assert reported["threads"] == 1 and torch.get_num_threads() == 2
    reported["fail"] = True
    with pytest.raises(RuntimeError, match="failed"):
        module.compare("data", [], tmp_path)
    assert reported["threads"] == 1 and torch.get_num_threads() == 2


def test_compare_runs_every_rival_on_one_scene(tmp_path):
    """A scene file, no run: finite elements in all their cheap forms and the reduced model, on one picture."""
    scene = pressed(steps={"count": 4}, body=SMALL | {"cells": [6, 2, 2]})
    (tmp_path / "press.toml").write_text(replace(scene, name="press").to_toml())
    result = module.compare(tmp_path / "press.toml", [], tmp_path / "report", repeats=1)
    rows = {row["name"]: row["scores"] for row in result["rows"]}
    assert list(rows) == [*TRIVIAL, *CHEAPER, REFERENCE] and result["cases"] == ["press"]
    own = rows[REFERENCE]["rmsd_refined"]
    assert rows["reduced-order model"]["rmsd_refined"] < 1.5 * own  # its own error is below the mesh's
    assert rows["reduced-order model"]["rmsd_all"] < rows["reduced-order model, few poses"]["rmsd_all"] < own
    assert rows["FE, tolerance 0.01"]["rmsd_all"] < 0.05 * own
    assert rows["FE, linear elasticity"]["rmsd_all"] > own  # turned by a third of a radian
    assert rows["FE, tolerance 0.01"]["iterations"] < rows[REFERENCE]["iterations"]
    assert all(0 < row["ms_per_step_alone"] <= row["ms_per_step"] for row in rows.values())
    assert "No learned simulator" in result["summary"] and (tmp_path / "report" / "report.html").exists()
    assert not list((tmp_path / "report").glob("frame_*"))
