"""The report on predicted flows: which flow its film shows, what its page says; pictures are made elsewhere."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from learning.flows import report
from learning.flows.report import COLUMNS, FlowReport, headline, write_flow_report
from learning.report.table import Row

VELOCITY = np.arange(12.0).reshape(2, 3, 2)


def row(name, kind, some, late=1.0):
    scores = dict.fromkeys(COLUMNS, 0.125) | {"velocity_rmse_50": some, "velocity_rmse_all": some, "velocity_rmse_late": late}
    return Row(name, kind, scores, (scores,))


@pytest.fixture
def pictures(monkeypatch):
    made = []
    monkeypatch.setattr(report, "pareto_picture", lambda path, rows, **named: made.append((path, rows, named)))
    monkeypatch.setattr(report, "flow_film", lambda path, mesh, velocity, **named: made.append((path, mesh, velocity, named)))
    return made


def test_the_film_is_of_the_flow_on_which_the_best_learned_predictor_is_worst(tmp_path, pictures):
    """Best is who is nearest in the second half; a row that has no worst flow, as the solver's, is none of them."""
    rows = [row("net <a>", "learned", 0.5, 0.4), row("b", "foreign", 0.1, 0.3), row("fe", "fe", 0.0, 0.0)]
    truths = [SimpleNamespace(trajectory=SimpleNamespace(mesh=f"mesh {k}", fields={"velocity": f"truth {k}"})) for k in range(3)]
    worst = {"net <a>": (0, 0.9, VELOCITY), "b": (2, 0.75, VELOCITY)}
    content = write_flow_report(tmp_path / "out", FlowReport(rows, ["f0", "f1", "f2"], ["a note & more"], ["run"]), truths, worst)
    picture, film = pictures
    assert picture == (tmp_path / "out" / "pareto.png", rows, {
        "error": "velocity_rmse_late", "factor": 1.0, "up": "RMSE of a component of the velocity in the second half of the frames [m/s]"})
    assert film[:2] == (tmp_path / "out" / "vorticity.gif", "mesh 2") and film[3] == {"truth": "truth 2", "names": ("b", "finite elements")}
    np.testing.assert_array_equal(film[2][..., :2], VELOCITY)
    assert film[2].shape == (2, 3, 3) and not film[2][..., 2].any()
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == content
    assert content["units"]["ms_per_step"] == "ms" and content["units"]["slip"] == "m/s" and content["summary"] == headline(rows)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "The vorticity of f2, on which b is farthest off (0.75 m/s): left the prediction" in page
    assert "net &lt;a&gt;" in page and "<li>a note &amp; more</li>" in page and "<li>3 flows: f0, f1, f2; means" in page
    assert "<th>time [ms/step]</th><th>RMSE-1 [m/s]</th>" in page and "<th>momentum residual</th>" in page
    assert page.count("<td>") == len(rows) * len(COLUMNS) and "<th scope=row>fe</th><td>0.125</td>" in page


def test_without_anything_learned_there_is_no_film(tmp_path, pictures):
    rows = [row("fe", "fe", 0.1)]
    content = write_flow_report(tmp_path, FlowReport(rows, ["f0"], [], []), [], {"left out": (0, 1.0, VELOCITY)})
    assert len(pictures) == 1 and "vorticity.gif" not in (tmp_path / "report.html").read_text()
    assert content["rows"][0]["scores"]["slip"] == 0.125
    write_flow_report(tmp_path, FlowReport(rows, ["f0"], [], []), [], {})  # into a folder that is there


@pytest.mark.parametrize("own, said", [(0.1, "4 times closer than a flow that does not change"),
                                       (0.4, "no better than a flow that does not change (0.4)"),
                                       (0.5, "no better than a flow that does not change (0.4)")])
def test_the_headline_is_of_the_best_over_all_steps(own, said):
    rows = [row("x", "learned", 9.0), row("y", "foreign", own), row("nothing changes", "trivial", 0.4), row("fe", "fe", 0.0)]
    assert headline(rows).startswith(f"y: over 50 steps {own:g} m/s, {said}; over all steps {own:g} m/s, {said}.")
    assert headline(rows[:2]) == headline(rows[2:]) == "No learned predictor was held against a flow that does not change."


def test_every_column_stands_once_and_the_second_half_has_one():
    assert list(COLUMNS)[:5] == ["ms_per_step", "velocity_rmse_1", "velocity_rmse_50", "velocity_rmse_all", "velocity_rmse_late"]
    assert all(column.factor == 1 and not math.isnan(column.factor) for column in COLUMNS.values())
