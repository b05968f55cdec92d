"""Rivals that are right where they must be, a table of means, and a report that holds every figure and needs no network."""

import csv
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.files.trajectory import write_trajectory
from datagen.sets.generate import trajectory_of
from learning.config import TrainConfig
from learning.networks.m4gn import M4GNConfig
from learning.prediction.predictor import Predictor
from learning.prediction.rivals import REFERENCE, between, coarser, keep_acceleration, keep_velocity, nothing_moves
from learning.report.compare import compare, predictors
from learning.report.evaluate import evaluate
from learning.report.measure import _row
from learning.report.pareto import front, measure_of
from learning.report.report import write_report
from learning.report.table import COLUMNS, TABLES, Report, Row, cells, headline, improvement, shown
from learning.training.train import train
from physics.mesh.quality import rmse
from physics.schema import InputError
from tests.scenes import pressed

FREE = np.array([True, True, False])


def straight(steps: int = 6) -> np.ndarray:
    """(T, 3, 3) constant velocity from the rest state; the last node is held and follows a path of its own."""
    path = np.arange(steps + 1)[:, None, None] * np.array([[1.0, 2, 3], [0, -1, 0.5], [0, 0, 0]])
    path[:, 2, 0] = np.arange(steps + 1) ** 2
    return path


def test_keep_velocity_is_exact_for_constant_velocity():
    truth = straight()
    path, steps = keep_velocity(truth, FREE)
    np.testing.assert_allclose(path, truth, atol=1e-13)
    np.testing.assert_allclose(steps[1:], truth[2:], atol=1e-13)
    assert not steps[0, FREE].any()  # the rest state has no velocity
    np.testing.assert_array_equal(steps[:, 2], truth[1:, 2])


def test_keep_velocity_sees_two_frames_only():
    truth, other = straight(), straight()
    other[2:, FREE] += 7
    np.testing.assert_array_equal(keep_velocity(truth, FREE)[0], keep_velocity(other, FREE)[0])


def test_nothing_moves_has_the_error_of_the_motion_itself():
    truth = straight()
    path, steps = nothing_moves(truth, FREE)
    assert rmse(path, truth, FREE) == pytest.approx(np.sqrt(np.mean(np.sum(truth[:, FREE] ** 2, axis=2))))
    assert rmse(steps, truth[1:], FREE) == pytest.approx(np.sqrt((14 + 1.25) / 2))
    np.testing.assert_array_equal(path[:, 2], truth[:, 2])
    np.testing.assert_array_equal(steps[:, 2], truth[1:, 2])


def test_a_parabola_is_continued_exactly_from_three_frames():
    t = np.arange(7.0)[:, None, None]
    truth = t * np.array([[1.0, 2, 3], [0, -1, 0.5], [0, 0, 0]]) + t**2 * np.array([[0.5, 0, 1], [2, 1, 0], [0, 0, 0]])
    path, steps = keep_acceleration(truth, FREE)
    np.testing.assert_allclose(path, truth, atol=1e-11)  # rounding grows with the square of the steps
    np.testing.assert_allclose(steps[2:], truth[3:], atol=1e-12)
    other = truth.copy()
    other[3:, FREE] += 7
    np.testing.assert_array_equal(keep_acceleration(other, FREE)[0][:, FREE], path[:, FREE])


def test_frames_in_between_lie_on_straight_lines():
    path = np.array([0.0, 2, 8])[:, None, None]
    np.testing.assert_allclose(between(path, 4)[:, 0, 0], [0, 1, 2, 5, 8], atol=1e-15)


def test_coarser_scenes_end():
    scene = pressed()
    assert scene.body.divisions == (12, 4, 4)
    half = coarser(scene)
    assert half.body.divisions == (6, 2, 2)
    assert coarser(half).body.divisions == (3, 2, 2)
    assert coarser(coarser(half)).body.divisions == (2, 2, 2)
    assert coarser(coarser(coarser(half))) is None
    sized = replace(scene, body=replace(scene.body, cells=None, cell_size=0.005))
    assert coarser(sized).body.divisions == (6, 2, 2)


def test_rows_hold_means_and_of_extremes_the_extreme():
    each = [{"rmse_all": 1e-3, "largest_penetration": 1e-5, "smallest_det_f": 0.9, "inverted_elements": 0.0, "rmse_refined": math.nan},
            {"rmse_all": 3e-3, "largest_penetration": 4e-5, "smallest_det_f": 0.4, "inverted_elements": 2.0, "rmse_refined": 5e-3}]
    row = _row(Predictor("M4GN", "learned", lambda case: None), each)
    assert row.scores == pytest.approx({"rmse_all": 2e-3, "largest_penetration": 4e-5, "smallest_det_f": 0.4,
                                        "inverted_elements": 2, "rmse_refined": 5e-3})
    assert [table["rmse_all"] for table in row.each] == [1e-3, 3e-3]
    assert math.isnan(_row(Predictor("FE", "fe", lambda case: None), [{"rmse_1": math.nan}]).scores["rmse_1"])


def made_up() -> list[Row]:
    def row(name: str, kind: str, ms: float, error: float) -> Row:
        scores = {key: error * (1.1 + i) for i, key in enumerate(COLUMNS)} | {"rmse_all": error, "ms_per_step": ms}
        scores |= {"rmse_refined": math.nan, "ms_per_step_alone": 0.8 * ms}
        return Row(name, kind, scores, ({"rmse_all": 0.7 * error}, {"rmse_all": 1.3 * error}))

    return [row("M4GN", "learned", 5.0, 2e-4), row("nothing moves", "trivial", 0.01, 7e-3),
            row("slow <guess> | x", "trivial", 9.0, 5e-3),
            row("FE, cells halved", "fe", 2.0, 6e-4), row("FE, the reference", "reference", 10.0, 0.0)]


def test_the_front_keeps_what_nothing_beats():
    names = [row.name for row in front(made_up())]
    assert names == ["nothing moves", "FE, cells halved", "M4GN", "FE, the reference"]
    slower = Row("late", "learned", {"rmse_all": 1e-9, "ms_per_step": 11.0})
    assert slower not in front([*made_up(), slower])  # the reference is faster and has no error


def test_the_headline_says_which_way_it_came_out():
    report = Report(title="t", rows=made_up(), cases=["0"])
    assert improvement(report.rows) == pytest.approx(35)
    assert "35 times as far off" in headline(report)
    assert "2 times as fast" in headline(report)
    worse = replace(report.rows[0], scores=report.rows[0].scores | {"rmse_all": 1.4e-2, "ms_per_step": 20.0})
    said = headline(replace(report, rows=[worse, *report.rows[1:]]))
    assert "closer" in said
    assert "the solver is 2 times as fast" in said
    assert "\"FE, cells halved\" is both faster and closer" in said


def test_the_picture_is_against_finer_cells_only_where_all_have_that_error():
    rows = made_up()
    assert measure_of(rows) == "rmse_all"
    rows = [replace(row, scores=row.scores | {"rmse_refined": 1e-4}) for row in rows]
    assert measure_of(rows) == "rmse_all"  # a mean over some trajectories only
    assert measure_of([replace(row, each=tuple(each | {"rmse_refined": 1e-4} for each in row.each)) for row in rows]) == "rmse_refined"


def test_the_report_holds_every_figure_and_opens_offline(tmp_path):
    picture = tmp_path / "frame_0.png"
    rows = made_up()
    rows[3].scores["rmse_1"] = math.nan
    write_report(tmp_path, Report(title="A & B", rows=rows, cases=["0", "1"]))
    picture.write_bytes((tmp_path / "pareto.png").read_bytes())
    facts = {"machine": "one <core>", "seed": "3"}
    far = {"0": {"steps": 0.5, "material law": math.inf}, "1": {}}
    write_report(tmp_path, Report(title="A & B", rows=rows, cases=["0", "1"], pictures=[(picture.name, "worst frame")],
                                  outside=far, facts=facts, notes=["a limit"]))
    page, text = (tmp_path / "report.html").read_text(), (tmp_path / "report.md").read_text()
    for row in rows:
        for columns in TABLES.values():
            for cell in cells(row, columns)[1:]:
                assert f"<td>{cell}</td>" in page
                assert f" {cell} |" in text
        assert f"<td>{shown(0.7e3 * row.scores['rmse_all'])}</td>" in page or row.kind == "reference"
    assert "slow &lt;guess&gt; | x" in page
    assert "slow <guess> \\| x" in text
    for said in ("A &amp; B", "one &lt;core&gt;", "a limit", "worst frame", "1 of 2 test scenes lie far outside", "0 is outside",
                 "steps by 50 %", "material law (never seen)", "1 of 2 test scenes lie inside"):
        assert said in page
    assert page.count('src="data:image/png;base64,') == 2
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert not re.search(r"(?:https?:)?//|(?:src|href)=\"(?!data:)|@import|url\(", words)

    stored = json.loads((tmp_path / "report.json").read_text())
    assert stored["rows"][3]["scores"]["rmse_1"] is None
    assert stored["rows"][0]["scores"] == rows[0].scores | {"rmse_refined": None}
    assert stored["far_outside"] == ["0"] and stored["outside"]["0"]["material law"] is None
    assert stored["facts"] == facts
    with open(tmp_path / "table.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert [line["predictor"] for line in table] == [row.name for row in rows]
    assert float(table[0]["gf_c [m2]"]) == rows[0].scores["gf_c"]


def small_config() -> TrainConfig:
    network = M4GNConfig(hidden=16, message_steps=1, transformer_layers=1, heads=2)
    return TrainConfig(segments=4, network=network, contact_radius=0.006, batch_size=2, steps=3)


def test_evaluate_writes_the_whole_folder(tmp_path):
    file = tmp_path / "beam.vtkhdf"
    write_trajectory(file, trajectory_of(pressed()))
    train(small_config(), [file], [file], tmp_path / "run")
    said: list[str] = []
    result = evaluate(tmp_path / "run", [file], tmp_path / "report", say=said.append)
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert names == {"report.html", "report.md", "report.json", "table.csv", "pareto.png", "frame_beam.png"}
    rows = {row["name"]: row["scores"] for row in result["rows"]}
    coarse = ["FE, cells halved", "FE, cells halved twice"]
    assert list(rows) == ["M4GN", "M4GN, 1 Newton step", "nothing moves", "keep the last velocity", "quadratic extrapolation",
                          *coarse, REFERENCE]
    assert rows[REFERENCE]["rmse_all"] == 0
    assert rows[REFERENCE]["relative_residual"] < 1e-3  # of the 32-bit numbers in the file
    errors = [rows[name]["rmse_all"] for name in (*coarse, "nothing moves")]
    assert 0 < errors[0] < errors[1] < errors[2]
    assert rows["keep the last velocity"]["rmse_1"] < rows["nothing moves"]["rmse_1"]
    # A prediction that is the data has the data's own error to the finer solution.
    assert 0 < rows[REFERENCE]["rmse_refined"] < rows["FE, cells halved"]["rmse_refined"]
    assert rows[REFERENCE]["below_data"] == 1 and rows["nothing moves"]["below_data"] < 0.2
    assert all(row["seconds"] == pytest.approx(0.02 * row["ms_per_step"]) for row in rows.values())
    assert rows["M4GN"]["set_up_seconds"] > 0 and rows["M4GN, 1 Newton step"]["iterations"] <= 1
    assert result["outside"] == {"beam": {}} and result["far_outside"] == []
    assert result["report"] == str(tmp_path / "report")
    assert any("RMSE-all" in line for line in said)
    json.dumps(result, allow_nan=False)


def test_what_cannot_be_the_truth_is_refused(tmp_path):
    with pytest.raises(InputError, match="no trajectories"):
        evaluate(tmp_path, [], tmp_path / "report")
    with pytest.raises(InputError, match="no such checkpoint"):
        evaluate(tmp_path, [Path("t.vtkhdf")], tmp_path / "report")


def test_compare_runs_every_rival_on_one_scene(tmp_path):
    """A scene file, no run: finite elements in all their cheap forms and the reduced model, on one picture."""
    (tmp_path / "press.toml").write_text(pressed(steps={"count": 10}).to_toml())
    result = compare(tmp_path / "press.toml", [], tmp_path / "report", repeats=2)
    rows = {row["name"]: row["scores"] for row in result["rows"]}
    assert len(rows) == 12 and "press" in result["cases"]
    own = rows[REFERENCE]["rmse_refined"]
    assert rows["reduced-order model"]["rmse_refined"] < 1.5 * own  # its own error is below the mesh's
    assert rows["FE, tolerance 0.01"]["rmse_all"] < 0.05 * own
    assert rows["FE, linear elasticity"]["rmse_all"] > own  # turned by a third of a radian
    assert rows["FE, tolerance 0.01"]["iterations"] < rows[REFERENCE]["iterations"]
    assert all(0 < row["ms_per_step_alone"] <= row["ms_per_step"] for row in rows.values())
    assert "No learned simulator" in result["summary"] and (tmp_path / "report" / "report.html").exists()
    assert not list((tmp_path / "report").glob("frame_*"))


def test_a_scene_with_inertia_is_refused(tmp_path):
    scene = pressed(steps={"count": 4, "duration": 0.1, "dynamic": True})
    (tmp_path / "fast.toml").write_text(scene.to_toml())
    with pytest.raises(InputError, match="quasi-static"):
        compare(tmp_path / "fast.toml", [], tmp_path / "report")


def test_two_runs_of_one_name_are_refused(tmp_path):
    with pytest.raises(InputError, match="different names"):
        predictors({"a/run": None, "b/run": None})
