"""Predictors that users bring along: what is read, called, timed and refused; and a model of one's own as a point on the picture."""

import dataclasses
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

import fidelity
from datagen.files.inputs import inputs_of, predicted
from datagen.files.trajectory import write_trajectory
from datagen.sets.generate import trajectory_of
from learning.prediction.foreign import brought, from_folder, from_function
from learning.prediction.predictor import Case, LeftOut
from learning.report.compare import chosen, compare, predictors
from physics.schema import InputError
from tests.scenes import beam, pressed
from tests.synthetic import bending


@pytest.fixture
def case():
    trajectory = bending(cells=(4, 2, 2), steps=5)
    return Case("a", trajectory, None, trajectory.mesh, Path("data/test/a.vtkhdf"))


def wrong(case, factor=0.5):
    return predicted(case.trajectory, factor * case.truth)


@pytest.mark.parametrize("folder", [".", "test"])
def test_a_folder_has_a_file_for_each_case_and_its_time_is_what_is_given_or_what_the_files_tell(case, tmp_path, folder):
    write_trajectory(tmp_path / folder / "a.vtkhdf" if folder == "." else _made(tmp_path / folder) / "a.vtkhdf", wrong(case))
    made, said = from_folder([str(tmp_path), "mine", "2.5"], [case])
    found = made.predict(case)
    assert (made.name, made.kind) == ("mine", "foreign") and "given" in said and found.seconds == pytest.approx(5 * 2.5e-3)
    assert np.array_equal(found.path, np.float32(0.5) * case.truth) and found.one_step is None
    made, said = from_folder([str(tmp_path)], [case])
    assert made.name == tmp_path.name and "not known" in said and np.isnan(made.predict(case).seconds)
    told = predicted(case.trajectory, case.truth, seconds_per_step=0.25)
    write_trajectory(tmp_path / folder / "a.vtkhdf", told)
    made, said = from_folder([str(tmp_path)], [case])
    assert "as its files tell" in said and made.predict(case).seconds == 1.25


def test_the_largest_time_is_a_million_seconds_a_step_and_the_last_part_of_a_path_is_its_name(tmp_path):
    assert brought([str(tmp_path), "", "9.99e8"]) == (tmp_path.name, tmp_path, pytest.approx(9.99e5))
    (tmp_path / "x").mkdir()
    assert brought([str(tmp_path / "x" / ".."), "mine", "0.001"])[::2] == ("mine", pytest.approx(1e-6))
    assert brought([str(tmp_path / "x" / "..")]) == (tmp_path.name, tmp_path / "x" / "..", None)


def test_a_prediction_is_found_by_the_name_of_its_truths_file(case, tmp_path):
    write_trajectory(tmp_path / "b.vtkhdf", predicted(case.trajectory, case.truth, seconds_per_step=2))
    other = dataclasses.replace(case, name="x", file=tmp_path / "elsewhere" / "b.vtkhdf")
    made, said = from_folder([str(tmp_path)], [other])
    assert "as its files tell" in said and made.predict(other).seconds == 10.0


def _made(folder):
    folder.mkdir()
    return folder


def test_what_is_no_prediction_of_a_case_is_refused_before_any_work(case, tmp_path):
    def refused(words, given):
        with pytest.raises(InputError, match=words):
            from_folder(given, [case])

    refused("no such folder", [str(tmp_path / "none")])
    refused("holds no file of the name a.vtkhdf", [str(tmp_path)])
    for ms in ("fast", "0", "-1", "nan", "inf", "1e9"):
        refused(f"'{ms}' is not a number of milliseconds above 0", [str(tmp_path), "mine", ms])
    refused("takes a folder, a name and a time", [str(tmp_path), "a", "1", "b"])
    write_trajectory(tmp_path / "a.vtkhdf", wrong(case, 1000.0))
    refused("millimetres", [str(tmp_path)])
    short = dataclasses.replace(case.trajectory, displacement=case.trajectory.displacement[:4])
    write_trajectory(tmp_path / "a.vtkhdf", short)
    refused("is not that of a: 4 frames of 93 nodes, there 6 frames of 93 nodes", [str(tmp_path)])


MODULE = """
import numpy as np

def halves(inputs):
    return np.where(inputs.free[:, None], 0.5, inputs.held)

def short(inputs):
    return np.zeros((2, 3))

def words(inputs):
    return [["a", 1], [2]]

def hole(inputs):
    return np.full((inputs.frames, len(inputs.points), 3), np.nan)

def bad(inputs):
    raise KeyError("weights")

def leaves(inputs):
    raise SystemExit(0)

def talks(inputs):
    print("hello")
    return inputs.held

number = 3
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "brought.py").write_text(MODULE)
    (tmp_path / "broken.py").write_text("1 / 0")
    (tmp_path / "leaving.py").write_text("import sys; sys.exit()")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield
    sys.modules.pop("brought", None)


def test_a_function_is_called_with_the_inputs_and_timed(case, module):
    made, said = from_function(["brought:halves", "mine"])
    assert (made.name, made.kind) == ("mine", "foreign") and "brought:halves" in said
    found = made.predict(case)
    assert np.array_equal(found.path, np.where(case.free[:, None], 0.5, inputs_of(case.trajectory).held)) and 0 <= found.seconds < 1
    assert sys.path[0] == os.getcwd() and sys.path.count(os.getcwd()) == 1
    assert from_function(["brought:halves"])[0].name == "halves" and from_function(len)[0].name == "len"


@pytest.mark.parametrize("given, words", [
    (["brought"], "must be module:function"), (["brought:"], "must be module:function"), ([":f"], "must be module:function"),
    (["brought:none"], "has no none"),
    (["nowhere:f"], "ModuleNotFoundError: No module named 'nowhere'"), (["brought:number"], "is not a function"),
    (["broken:f"], r"ZeroDivisionError: division by zero \(broken.py, line 1\)"), (["leaving:f"], "SystemExit: "),
    (["a:b", "c", "d"], "takes module:function and a name")])
def test_a_function_that_is_not_there_is_refused(module, given, words):
    with pytest.raises(InputError, match=words):
        from_function(given)


def test_a_function_that_fails_says_where_in_one_line(case, module):
    with pytest.raises(RuntimeError, match=r"^bad on a: KeyError: 'weights' \(brought.py, line 17\)$"):
        from_function(["brought:bad"])[0].predict(case)
    with pytest.raises(RuntimeError, match=r"^leaves on a: SystemExit: 0 \(brought.py, line 20\)$"):  # not the end of the program, status 0
        from_function(["brought:leaves"])[0].predict(case)
    with pytest.raises(InputError, match=r"^short on a: displacement has shape \(2, 3\): must be \(6, 45, 3\), frames"):
        from_function(["brought:short"])[0].predict(case)
    with pytest.raises(InputError, match="^words on a: displacement is no array of numbers: "):
        from_function(["brought:words"])[0].predict(case)
    with pytest.raises(LeftOut, match="not finite"):
        from_function(["brought:hole"])[0].predict(case)
    with pytest.raises(InputError, match="millimetres"):
        from_function(lambda inputs: 1000 * case.truth)[0].predict(case)


def test_kinds_are_chosen_and_the_reference_comes_along():
    every = predictors({})
    assert chosen(every, []) == every
    assert [each.kind for each in chosen(every, ["trivial"])] == ["trivial"] * 3 + ["reference"]
    with pytest.raises(InputError, match="--only learnt: must be some of .*did you mean 'learned'"):
        chosen(every, ["learnt"])


def test_what_is_brought_along_stands_on_the_picture_and_in_the_sentence(tmp_path):
    """On a scene of four steps: a function, and its own files with a time and without one."""
    scene = pressed(steps={"count": 4}, body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 2, 2]})
    (tmp_path / "press.toml").write_text(scene.to_toml())

    def sinking(inputs):
        return inputs.held - np.maximum(inputs.pose[0] - inputs.pose - [0, 0, 5e-4], 0)[:, None] * (inputs.points[:, :1] / 0.05) ** 2

    trajectory = trajectory_of(scene)
    (tmp_path / "mine").mkdir()
    write_trajectory(tmp_path / "mine" / "press.vtkhdf", predicted(trajectory, sinking(inputs_of(trajectory))))
    result = compare(tmp_path / "press.toml", [], tmp_path / "report", refined=0, repeats=1, functions=[sinking], only=["trivial"],
                     predictions=[[str(tmp_path / "mine"), "timed", "2"], [str(tmp_path / "mine"), "untimed"]])
    rows = {row["name"]: row for row in result["rows"]}
    assert [row["kind"] for row in rows.values()] == ["foreign"] * 3 + ["trivial"] * 3 + ["reference"]
    assert rows["timed"]["scores"]["ms_per_step"] == pytest.approx(2) and rows["untimed"]["scores"]["ms_per_step"] is None
    assert rows["sinking"]["scores"]["rmsd_all"] == pytest.approx(rows["timed"]["scores"]["rmsd_all"], rel=1e-5)
    assert rows["sinking"]["scores"]["ms_per_step"] > 0 and rows["sinking"]["scores"]["rmsd_1"] is None
    assert "given, not measured here" in result["facts"]["timed"] and "puts a free node" in result["summary"]
    with pytest.raises(InputError, match="two predictors are called 'nothing moves'"):
        compare(tmp_path / "press.toml", [], tmp_path / "report", only=["trivial"], predictions=[[str(tmp_path / "mine"), "nothing moves"]])


def test_what_a_function_prints_is_kept_out_of_the_json_and_who_is_left_out_is_said(module, tmp_path, capsys):
    obstacle = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.0305], [0.05, 0.01, 0.0295]]}
    body = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [3, 1, 1]}
    (tmp_path / "s.toml").write_text(beam(steps={"count": 2}, body=body, obstacle=obstacle).to_toml())
    assert fidelity.main(["pareto", "s.toml", "--predictor", "brought:talks", "--predictor", "brought:hole", "--only", "trivial",
                          "--refined", "0", "--repeats", "1", "--out", "p", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["report"] == "p" and "hello" in err
    assert "hole is left out, because in s what it gives is not finite.\n" in err
