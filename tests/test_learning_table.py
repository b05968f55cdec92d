"""What a report says: every figure in its unit, on rows made by hand, and the sentences with their numbers worked out."""

import math

import pytest

from learning.report.table import (
    COLUMNS,
    KINDS,
    TABLES,
    Row,
    best_learned,
    by_case,
    cells,
    far_outside,
    headline,
    heads,
    improvement,
    plain,
    shown,
    told,
)
from learning.samples.seen import ALARM
from tests.rows import report, row, rows

# Column -> value in the unit of the files, heading, and what stands in the table: lengths in mm (a thousand to the metre), areas in
# mm2 (a million to the square metre), times in ms and s as they are, shares and ratios without a unit as they are.
WHOLE = {
    "Time and error": {
        "ms_per_step": (12.5, "ms", "time [ms/step]", "12.5"),
        "ms_per_step_alone": (11.25, "ms", "time, set-up excluded [ms/step]", "11.2"),
        "wall_ms_per_step": (13.5, "ms", "by the clock [ms/step]", "13.5"),
        "seconds": (1.75, "s", "time of a trajectory [s]", "1.75"),
        "set_up_seconds": (0.25, "s", "set-up [s]", "0.25"),
        "paid_back": (1216.0, "1", "paid back after [scenes]", "1.22e+03"),
        "rmsd_1": (2.5e-6, "m", "RMSD-1 [mm]", "0.0025"),
        "rmsd_50": (3.5e-5, "m", "RMSD-50 [mm]", "0.035"),
        "rmsd_all": (4.5e-4, "m", "RMSD-all [mm]", "0.45"),
        "rmsd_all_all_nodes": (5.5e-4, "m", "RMSD-all, all nodes [mm]", "0.55"),
        "rmsd_refined": (6.5e-3, "m", "to finer cells [mm]", "6.5"),
        "of_motion": (0.015, "1", "of the motion", "0.015"),
        "below_data": (0.375, "1", "below the data's error", "0.375"),
        "error_bar": (7.5e-4, "m", "error bar [mm]", "0.75"),
        "covered": (0.875, "1", "covered", "0.875"),
        "unsure": (0.125, "1", "unsure", "0.125"),
    },
    "Errors as published": {
        "rmse_1": (1.5e-5, "m", "RMSE-1 [mm]", "0.015"),
        "rmse_50": (2.5e-5, "m", "RMSE-50 [mm]", "0.025"),
        "rmse_all": (3.5e-5, "m", "RMSE-all [mm]", "0.035"),
        "rmse_1_by_step": (4.5e-5, "m", "RMSE-1, by step [mm]", "0.045"),
        "rmse_50_by_step": (5.5e-5, "m", "RMSE-50, by step [mm]", "0.055"),
        "rmse_all_by_step": (6.5e-5, "m", "RMSE-all, by step [mm]", "0.065"),
        "rmse_1_all_nodes": (7.5e-5, "m", "RMSE-1, all nodes [mm]", "0.075"),
        "rmse_50_all_nodes": (8.5e-5, "m", "RMSE-50, all nodes [mm]", "0.085"),
        "rmse_all_all_nodes": (9.5e-5, "m", "RMSE-all, all nodes [mm]", "0.095"),
        "rmse_1_by_step_all_nodes": (10.5e-5, "m", "RMSE-1, by step, all nodes [mm]", "0.105"),
        "rmse_50_by_step_all_nodes": (11.5e-5, "m", "RMSE-50, by step, all nodes [mm]", "0.115"),
        "rmse_all_by_step_all_nodes": (12.5e-5, "m", "RMSE-all, by step, all nodes [mm]", "0.125"),
    },
    "Held against the equations": {
        "relative_residual": (0.0625, "1", "residual", "0.0625"),
        "largest_penetration": (7.5e-5, "m", "penetration [mm]", "0.075"),
        "reaction_error": (0.28, "1", "reaction error", "0.28"),
        "energy_error": (0.29, "1", "energy error", "0.29"),
        "stress_error": (0.31, "1", "stress error", "0.31"),
        "estimated_error": (8.5e-4, "m", "estimated error [mm]", "0.85"),
        "effectivity": (3.0, "1", "effectivity", "3"),
        "iterations": (4.25, "1", "Newton steps", "4.25"),
    },
    "The deformed mesh": {
        "gf_h": (9.5e-4, "m", "GF_h [mm]", "0.95"),
        "gf_c": (1.05e-7, "m2", "GF_c [mm²]", "0.105"),
        "mc": (0.041, "1", "MC", "0.041"),
        "ar": (0.042, "1", "AR", "0.042"),
        "smallest_det_f": (-0.5, "1", "det F", "-0.5"),
        "smallest_scaled_jacobian": (0.7, "1", "scaled Jacobian", "0.7"),
        "inverted_elements": (2.0, "1", "inverted", "2"),
    },
}


def test_every_figure_stands_in_its_table_under_its_unit():
    assert list(TABLES) == list(WHOLE)
    whole = Row("all", "fe", {key: entry[0] for table in WHOLE.values() for key, entry in table.items()})
    for title, table in WHOLE.items():
        assert list(TABLES[title]) == list(table)
        assert heads(TABLES[title]) == ["predictor", *(head for _, _, head, _ in table.values())]
        assert cells(whole, TABLES[title]) == ["all", *(text for _, _, _, text in table.values())]
    assert {key: column.si for key, column in COLUMNS.items()} == {key: entry[1] for t in WHOLE.values() for key, entry in t.items()}
    assert whole.ms_per_step == 12.5


def test_every_column_says_on_which_nodes_and_over_what():
    for key in ("rmsd_50", "rmsd_1", "rmsd_all", "rmse_1", "rmse_all_by_step", "rmsd_refined", "estimated_error", "relative_residual"):
        assert "<b>free</b>" in COLUMNS[key].meaning
    for key in ("rmsd_all_all_nodes", "rmse_50_all_nodes", "rmse_1_by_step_all_nodes", "gf_h", "gf_c"):
        assert "<b>all</b>" in COLUMNS[key].meaning
    assert "1 to 50" in COLUMNS["rmsd_50"].meaning and "1 to 50" in COLUMNS["rmse_50_by_step"].meaning
    for key, column in COLUMNS.items():
        assert ("root mean square distance" in column.meaning) == (key == "rmsd_1") and ("coordinate" in column.meaning) == ("rmse" in key)
    assert "half the size" in COLUMNS["rmsd_refined"].meaning and "40" in COLUMNS["rmsd_refined"].meaning


def test_a_number_is_shown_with_three_digits_zero_as_zero_and_nan_as_a_dash():
    assert [shown(value) for value in (math.nan, 0.0, -0.0, 1e-9, 0.00012345, 0.5, 12.34, 123.6, 1234.5, -2.5, math.inf)] == [
        "–", "0", "0", "1e-09", "0.000123", "0.5", "12.3", "124", "1.23e+03", "-2.5", "inf"]


def test_what_no_predictor_has_is_no_column_and_what_one_lacks_is_a_dash():
    columns = told(COLUMNS, rows())
    assert list(columns) == ["ms_per_step", "ms_per_step_alone", "rmsd_1", "rmsd_all", "iterations"]
    assert cells(rows()[2], columns) == ["M4GN b, corrected 10-fold", "9", "7.88", "–", "0.05", "1"]  # 0.875 x 9 = 7.875
    assert cells(rows()[5], columns) == ["FE, the reference", "32", "28", "–", "0", "4.25"]
    assert cells(Row("bare", "fe", {}), columns) == ["bare", *"–––––"]
    assert told(COLUMNS, [Row("bare", "fe", {})]) == {}


def test_each_trajectory_has_a_row_of_all_predictors_but_the_reference():
    head, lines = by_case(report(rows=[*rows(), row("without", "fe", 1.0, 1.0)]))
    assert head == ["test trajectory", "M4GN a", "M4GN b", "M4GN b, corrected 10-fold", "nothing moves", "FE, cells twice as large"]
    assert lines == [["0003", "0.2", "0.1", "0.04", "6", "0.5"],
                     ["0007", "0.3", "0.35", "0.05", "7", "0.6"],
                     ["0011", "0.7", "0.15", "0.06", "8", "0.7"]]


def test_the_best_network_is_that_of_the_smallest_error():
    assert best_learned(rows()).name == "M4GN b" == best_learned(rows()[::-1]).name
    assert best_learned(rows()[2:]) is None  # what Newton steps correct is not the network


def test_the_improvement_is_that_of_nothing_moves_over_the_best_network():
    assert improvement(rows()) == pytest.approx(35) == improvement(rows()[::-1])  # 7 mm / 0.2 mm
    assert improvement([row("M4GN", "learned", 1, 0.0), *rows()]) == math.inf
    assert improvement(rows()[2:]) is None
    assert improvement([each for each in rows() if each.name != "nothing moves"]) is None


def test_the_headline_of_three_trajectories():
    assert headline(report()) == (
        "Over whole rollouts of 3 test trajectories, M4GN b puts a free node 0.2 mm from its true place (root mean square). To say "
        "that nothing moves is <b>35 times as far off</b>. M4GN b takes 8 ms a step on this machine, the finite-element solver that "
        "made the truth 32 ms: <b>4 times as fast</b>.")


def test_the_headline_of_a_network_that_is_slower_than_the_solver_and_worse_than_nothing():
    bad = row("M4GN", "learned", 80.0, 1.4e-2)
    said = headline(report(rows=[bad, *rows()[2:]], cases=["0003"]))
    assert said == (
        "Over whole rollouts of 1 test trajectory, M4GN puts a free node 14 mm from its true place (root mean square). To say that "
        "nothing moves is <b>closer, 0.5 times as far off</b>. M4GN takes 80 ms a step on this machine, the finite-element solver "
        "that made the truth 32 ms: <b>the solver is 2.5 times as fast</b>. \"FE, cells twice as large\" is both faster and closer: 2 ms a "
        "step, 0.6 mm.")


def test_at_equal_error_nothing_moves_is_not_called_closer():
    said = headline(report(rows=[row("M4GN", "learned", 32.0, 7e-3), *rows()[3:]]))
    assert "nothing moves is <b>1 times as far off</b>" in said
    assert "<b>the solver is 1 times as fast</b>" in said


def test_the_closest_of_those_that_are_faster_and_closer_is_named():
    network, others = row("M4GN", "learned", 8.0, 2e-4), rows()[3:]

    def named(*more: Row) -> str:
        return headline(report(rows=[network, *others, *more])).partition("ms: <b>4 times as fast</b>.")[2]

    assert named() == ""  # halved cells are faster, not closer; the reference is closer, not faster
    assert named(row("as fast", "fe", 8.0, 1e-4), row("as close", "fe", 4.0, 2e-4), row("slow", "reduced", 9.0, 1e-4)) == ""
    assert named(row("hybrid", "hybrid", 4.0, 1e-4), row("guess", "trivial", 4.0, 1e-4)) == ""
    assert named(row("a", "fe", 1.0, 1.5e-4), row("b", "reduced", 6.0, 5e-5), row("c", "fe", 3.0, 1e-4)) == (
        " \"b\" is both faster and closer: 6 ms a step, 0.05 mm.")


def test_without_a_reference_nothing_is_said_about_speed_and_without_a_network_nothing_at_all():
    assert headline(report(rows=rows()[:5])).endswith("<b>35 times as far off</b>.")
    assert headline(report(rows=rows()[2:])) == "No learned simulator was measured beside \"nothing moves\"."
    assert headline(report(rows=rows()[:3])) == "No learned simulator was measured beside \"nothing moves\"."


def test_far_outside_is_what_lies_beyond_the_alarm_in_any_quantity():
    beyond = {"0003": {"steps": 0.05, "cells": 0.21}, "0007": {"steps": 0.2}, "0011": {}}
    assert far_outside(report(outside=beyond), 0.2) == ["0003"]
    assert far_outside(report(outside=beyond), 0.1) == ["0003", "0007"]
    assert far_outside(report(outside={"0003": {"material law": math.inf}}), 1e9) == ["0003"]
    assert far_outside(report(), 0.2) == []
    assert ALARM == 0.2


def test_marks_of_bold_letters_are_replaced_or_taken_away():
    assert plain("a <b>b</b> c", "**") == "a **b** c" and plain("a <b>b</b> c") == "a b c"


def test_every_kind_of_row_has_a_name():
    assert {each.kind for each in rows()} | {"reduced", "foreign"} == set(KINDS)
