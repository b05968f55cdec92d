"""After how many scenes a training is paid back, counted by hand."""

import math

from learning.report.cost import called, counted, data_said, payback_said
from tests.rows import row


def some():
    return [row("fast", "learned", 1.0, 1e-4, seconds=0.5), row("slow", "learned", 9.0, 1e-4, seconds=4.0),
            row("old", "learned", 1.0, 1e-4, seconds=0.5), row("FE, coarse", "fe", 1.0, 1e-4, seconds=0.5),
            row("FE, the reference", "reference", 8.0, 0.0, seconds=3.5)]


def test_training_and_data_are_paid_back_by_what_each_scene_saves():
    """60 s and 3000 s; a scene saves 3.5 - 0.5 = 3 s: after 1020 scenes."""
    headers = {"fast": {"seconds": 60.0, "data_seconds": 3000.0}, "slow": {"seconds": 1.0, "data_seconds": 1.0}, "old": {"seconds": 60.0}}
    found = {each.name: each.scores["paid_back"] for each in counted(some(), headers)}
    assert found["fast"] == 1020 and found["slow"] == math.inf
    assert math.isnan(found["old"]) and math.isnan(found["FE, coarse"]) and math.isnan(found["FE, the reference"])
    assert counted(some(), {"fast": {"seconds": 60.0, "data_seconds": 3000.5}})[0].scores["paid_back"] == 1021


def test_without_a_reference_nothing_is_counted():
    assert math.isnan(counted(some()[:1], {"fast": {"seconds": 60.0, "data_seconds": 3000.0}})[0].scores["paid_back"])


def test_predictors_are_called_after_their_kind_and_where_several_are_of_one_after_their_folder():
    class Kind:
        title = "beam sections"

    class Other:
        title = "M4GN"

    assert called({"runs/a": Kind()}) == {"runs/a": "beam sections"}
    assert called({"runs/a": Kind(), "b": Kind()}) == {"runs/a": "beam sections a", "b": "beam sections b"}
    assert called({"c": Other(), "a": Kind(), "b": Kind()}) == {"c": "M4GN", "a": "beam sections a", "b": "beam sections b"}


def test_what_the_data_took_is_said_where_it_is_known():
    assert data_said({"seconds": 60.0, "data_seconds": 5293.2}) == " on data that took 5293 s" and data_said({"seconds": 60.0}) == ""


def test_only_what_is_ever_paid_back_is_told_so():
    headers = {"fast": {"seconds": 60.0, "data_seconds": 3000.0}, "slow": {"seconds": 1.0, "data_seconds": 1.0}}
    said, = payback_said(counted(some(), headers))
    assert said.startswith("fast has paid back") and "after 1020 scenes" in said
