"""What is measured of predicted flows, with predictors, truths and their figures made up."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from learning.flows import compare
from learning.flows.compare import _measured, _scores, summary
from learning.flows.report import ERRORS
from learning.flows.rivals import FlowPath, FlowPredictor
from learning.prediction.predictor import LeftOut
from learning.report.table import Row

FRAMES, NODES = 9, 3
INSIDE = np.array([True, False, True])
FIGURES = {"velocity_rmse_1": 1.0, "velocity_rmse_50": 2.0, "velocity_rmse_all": 3.0, "pressure_rmse_50": 4.0, "pressure_rmse_all": 5.0,
           "slip": 6.0}


def truth_of(first=1, **figures):
    """At rest, whatever is predicted has the figures; asked: what was given to be verified."""
    asked = []

    def verify(*given):
        asked.append(given)
        return SimpleNamespace(**FIGURES | figures)

    return SimpleNamespace(first=first, asked=asked,
                           reference=SimpleNamespace(velocity=np.zeros((FRAMES, NODES, 2)), predicted=INSIDE, verify=verify))


def path_of(one_step=None, shown=1, seconds=14.0, set_up=7.0):
    """3 and 4 m/s at the nodes inside from frame 5 on, more before and elsewhere."""
    velocity = np.full((FRAMES, NODES, 2), 50.0)
    velocity[5:, INSIDE] = 3.0, 4.0
    return FlowPath(velocity=velocity, one_step=one_step, seconds=seconds, set_up=set_up, shown=shown)


def test_scores_are_the_figures_the_error_of_the_second_half_and_times_of_a_step():
    """Of 9 frames the second half begins at 5: root of (9 + 16) / 2. Seven steps from frame 1 on."""
    truth, step = truth_of(), np.zeros((7, NODES, 2))
    path = path_of(step)
    found = _scores(truth, path, 14.0, 7.0)
    assert found == FIGURES | {"velocity_rmse_late": pytest.approx(math.sqrt(12.5)), "ms_per_step": pytest.approx(3000.0),
                               "ms_per_step_alone": pytest.approx(2000.0), "seconds": 21.0, "shown": 1.0}
    assert truth.asked == [(path.velocity, None, step)]


def test_the_first_step_of_a_rollout_is_no_single_step_and_what_was_shown_has_no_error():
    nothing = {name for name, value in _scores(truth_of(), path_of(), 1.0, 0.0).items() if math.isnan(value)}
    assert nothing == {"velocity_rmse_1"}
    shown = _scores(truth_of(), path_of(np.zeros((7, NODES, 2)), shown=2), 1.0, 0.0)
    assert {name for name, value in shown.items() if math.isnan(value)} == {"velocity_rmse_50", "velocity_rmse_all", "pressure_rmse_50",
                                                                            "pressure_rmse_all"}
    assert shown["velocity_rmse_1"] == 1.0 and shown["shown"] == 2.0


def predictor(name, kind, *times):
    """Takes the next of some times at each call, the last one for ever; (seconds, set_up) each."""
    calls = []

    def predict(truth):
        calls.append(truth)
        seconds, set_up = times[min(len(calls), len(times)) - 1]
        return path_of(seconds=seconds, set_up=set_up)

    return FlowPredictor(name, kind, predict), calls


@pytest.mark.parametrize("first, kind, count, seconds, set_up", [
    ((0.5, 0.2), "fe", 3, 0.6, 0.3),  # the medians of 0.5, 0.8, 0.6 and 0.2, 0.3, 0.4
    ((0.6, 0.41), "fe", 1, 0.6, 0.41),  # longer than a second together
    ((0.6, 0.4), "fe", 1, 0.6, 0.4),
    ((0.5, 0.2), "foreign", 1, 0.5, 0.2)])
def test_what_is_short_is_timed_again_and_its_median_counts(first, kind, count, seconds, set_up):
    one, calls = predictor("it", kind, first, (0.8, 0.3), (0.6, 0.4), (9.0, 9.0))
    found = _measured([one], [truth_of()], ["a"], 3)
    assert len(calls) == count
    assert found.rows[0].scores["seconds"] == pytest.approx(seconds + set_up)
    assert found.rows[0].scores["ms_per_step_alone"] == pytest.approx(1e3 * seconds / 7)
    calls.clear()
    _measured([one], [truth_of()], ["a"], 1)
    assert len(calls) == 1


def test_what_is_left_out_of_one_flow_has_no_row_and_the_worst_flow_of_each_learned_one_is_kept():
    """Errors 3, 8, 8 and 4: the first of the worst counts. Rows are means over flows, each flow's beside them."""
    truths = [truth_of(velocity_rmse_all=error) for error in (3.0, 8.0, 8.0, 4.0)]
    net, _ = predictor("net", "learned", (2.0, 0.0))
    own, _ = predictor("own", "foreign", (2.0, 0.0))
    idle, _ = predictor("idle", "trivial", (2.0, 0.0))

    def fails(truth):
        if truth is truths[2]:
            raise LeftOut("it blows up")
        return path_of()

    found = _measured([net, FlowPredictor("bad", "learned", fails), own, idle], truths, ["a", "b", "c", "d"], 1)
    assert [(row.name, row.kind) for row in found.rows] == [("net", "learned"), ("own", "foreign"), ("idle", "trivial")]
    assert found.notes == ["bad is left out, because in c it blows up."]
    assert found.rows[0].scores["velocity_rmse_all"] == pytest.approx(math.sqrt((9 + 64 + 64 + 16) / 4))
    assert [each["velocity_rmse_all"] for each in found.rows[0].each] == [3.0, 8.0, 8.0, 4.0]
    assert set(found.worst) == {"net", "bad", "own"}
    assert found.worst["net"][:2] == (1, 8.0) and found.worst["net"][2].shape == (FRAMES, NODES, 2)
    zero = _measured([net], [truth_of(velocity_rmse_all=0.0)], ["a"], 1)
    assert zero.worst["net"][:2] == (0, 0.0)


def test_a_terminal_is_told_the_time_and_the_errors_of_each():
    rows = [Row("net", "learned", {"ms_per_step": 1.5, **dict.fromkeys(ERRORS, 0.25)}),
            Row("fe", "fe", {"ms_per_step": 1234.5, **dict.fromkeys(ERRORS, 0.5), "velocity_rmse_1": math.nan})]
    head, *lines = summary(rows)
    assert head.split() == ["ms/step", "RMSE-1", "RMSE-50", "RMSE-all", "RMSE-late", "[m/s,", "nodes", "inside]"]
    assert [line.split() for line in lines] == [["net", "1.5", *["0.25"] * 4], ["fe", "1.23e+03", "–", *["0.5"] * 3]]
    assert {len(line) for line in lines} == {34 + 1 + 9 + 4 * 11}


def test_a_prediction_of_another_program_has_its_time_by_its_steps(tmp_path, monkeypatch):
    truths = [truth_of(), truth_of(first=2)]
    for truth in truths:
        truth.trajectory = object()
    monkeypatch.setattr(compare, "brought", lambda words: ("theirs", tmp_path, words[0]))
    monkeypatch.setattr(compare, "find_prediction", lambda folder, file: folder / file)
    monkeypatch.setattr(compare, "read_flow_prediction", lambda path, trajectory, file: (np.zeros((9, 1, 2)), str(path)))
    one = compare._foreign([0.5], ["a", "b"], truths)
    assert (one.name, one.kind) == ("theirs", "foreign")
    paths = [one.predict(truth) for truth in truths]
    assert [path.seconds for path in paths] == [3.5, 3.0] and [path.shown for path in paths] == [1, 2]
    assert [path.pressure for path in paths] == [str(tmp_path / "a"), str(tmp_path / "b")] and paths[0].one_step is None
    assert math.isnan(compare._foreign([None], ["a", "b"], truths).predict(truths[0]).seconds)
