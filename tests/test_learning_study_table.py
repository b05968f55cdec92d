"""The table of a study, on trainings made up by hand: every number of its three forms worked out."""

import json
import math
from pathlib import Path

import pytest

from learning.config import TrainConfig
from learning.prediction.rivals import STILL
from learning.study.plan import Data, Line, Plan, Trial
from learning.study.table import (
    COST,
    ERRORS,
    FIGURE,
    Result,
    Score,
    check_published,
    facts,
    gathered,
    markdown,
    table_csv,
    write_tables,
)
from learning.study.work import Training
from physics.fidelity.figures import FIGURES
from physics.schema import InputError

NONE = (math.nan, math.nan)


def plan_of(*rows, tests=("here", "there"), seeds=2, **words):
    """A plan of rows (name, published)."""
    said = {"title": "A study", "about": "", "source": "", "size": "small"} | words
    return Plan(**said, seeds=seeds, rows=tuple(Line(name, TrainConfig(), published) for name, published in rows),
                tests=tuple(Trial(name, "data") for name in tests),
                sets={"data": ({}, Data(family="demo", train=3, valid=2, test=1)), "far": ({}, Data(family="beam-small", test=4))})


def left(folder: Path, plan, row, seed, seconds, curve, *scores, **trained):
    """A training that is done, with scores of every test."""
    tests = tuple((test, folder) for test in plan.tests)
    job = Training(folder / row / str(seed), TrainConfig(), folder, tests)
    (job.folder / "run").mkdir(parents=True)
    took = {"seconds": seconds, "parameters": 1500, "step_ms": 4.0, "memory": 3e6} | trained
    (job.folder / "trained.json").write_text(json.dumps(took))
    (job.folder / "run" / "curve.jsonl").write_text("".join(json.dumps(line) + "\n" for line in curve))
    for test, found in zip(plan.tests, scores, strict=True):
        job.found(test).write_text(json.dumps(found))
    return job


def same(cell, mean, deviation, count, published=NONE):
    assert (cell.mean, cell.deviation, *cell.published) == pytest.approx((mean, deviation, *published), nan_ok=True, rel=1e-12)
    assert cell.count == count


@pytest.fixture
def found(tmp_path):
    """Row a has two seeds and takes 36 s and 72 s, row b two of which one blows up there and none has an error here, c nothing yet."""
    plan = plan_of(("a", {"here": {"mc": (0.5, math.nan), "rmse_all:stress": (7.0, 1.0)}}), ("b", {}), ("c", {"there": {"ar": (0.1, 0.2)}}))
    curve = [{"step": 1, "seconds": 10.0, "error": 4e-3}, {"step": 1, "seconds": 11.0, "loss": 1.0},
             {"step": 2, "seconds": 50.0, "error": None}, {"step": 2, "seconds": 54.0, "error": 3e-3},
             {"step": 3, "seconds": 54.5, "error": 1e-3}]
    jobs = {
        ("a", 0): left(tmp_path, plan, "a", 0, 36.0, curve, {"rmse_all": 1e-3, "mc": None, "ms_per_step_alone": 2.0, "extra": 1.0},
                       {"rmse_all": 3e-3, "mc": 0.25, "rmse_all:stress": 5.0}),
        ("b", 0): left(tmp_path, plan, "b", 0, 100.0, curve[:1], {"rmse_all": None}, {}, step_ms=8.0),
        ("c", 0): Training(tmp_path / "c" / "0", TrainConfig(), tmp_path, tuple((test, tmp_path) for test in plan.tests)),
        ("a", 1): left(tmp_path, plan, "a", 1, 72.0, curve[1:], {"rmse_all": 4e-3, "mc": None, "ms_per_step_alone": 3.0, "extra": 1.0},
                       {"rmse_all": 3e-3, "mc": 0.75, "rmse_all:stress": 9.0}, parameters=1501, memory=5e6),
        ("b", 1): left(tmp_path, plan, "b", 1, 101.0, [], {"rmse_all": None}, {"rmse_all": 8e-3})}
    (tmp_path / "c" / "0").mkdir(parents=True)
    (tmp_path / "c" / "0" / "trained.json").write_text("{}")  # trained, and not tested
    return gathered(plan, jobs, {"here": {"rmse_all": 0.02, "ms_per_step_alone": 9.0, "mc": None}, "there": {"rmse_all": 0.03}})


def test_cells_are_means_and_sample_deviations_over_the_seeds_that_are_done(found):
    here, there = found.cells["a"]["here"], found.cells["a"]["there"]
    same(here["rmse_all"], 2.5e-3, 1.5e-3 * math.sqrt(2), 2)
    same(here["mc"], math.nan, math.nan, 0, (0.5, math.nan))
    same(here["rmse_all:stress"], math.nan, math.nan, 0, (7.0, 1.0))
    same(there["rmse_all"], 3e-3, 0.0, 2)
    same(there["rmse_all:stress"], 7.0, 2 * math.sqrt(2), 2)
    same(here["test_ms"], 2.5, math.sqrt(0.5), 2)
    same(there["test_ms"], math.nan, math.nan, 0)
    for cells in (here, there):  # of the training, whatever it is tested on
        same(cells["parameters"], 1500.5, math.sqrt(0.5), 2)
        same(cells["train_ms"], 4.0, 0.0, 2)
        same(cells["memory"], 4e6, math.sqrt(2) * 1e6, 2)
        same(cells["hours"], 0.015, 0.005 * math.sqrt(2), 2)
    same(found.cells["b"]["there"]["rmse_all"], 8e-3, math.nan, 1)
    same(found.cells["b"]["here"]["train_ms"], 6.0, 2 * math.sqrt(2), 2)
    same(found.cells["c"]["there"]["ar"], math.nan, math.nan, 0, (0.1, 0.2))
    same(found.cells["c"]["there"]["hours"], math.nan, math.nan, 0)


def test_at_equal_time_the_best_validation_counts_up_to_the_moment_at_which_the_quickest_row_is_done(found):
    """Row a takes 54 s in the mean: the validation at 54 s counts, the one at 54.5 s does not; one that is none is no error."""
    same(found.cells["a"]["here"]["valid_equal"], 3e-3, 0.0, 2)
    same(found.cells["b"]["here"]["valid_equal"], 4e-3, math.nan, 1)  # its second seed has none


def test_what_never_moves_has_no_cost(found):
    assert set(found.cells[STILL]["here"]) == set(ERRORS) | {"rmse_all:stress"} == set(found.cells[STILL]["there"])
    same(found.cells[STILL]["here"]["rmse_all"], 0.02, math.nan, 1)
    same(found.cells[STILL]["there"]["rmse_all"], 0.03, math.nan, 1)
    same(found.cells[STILL]["here"]["mc"], math.nan, math.nan, 0)


def test_columns_are_those_in_which_anything_is_known_or_published(found):
    assert list(found.columns) == ["mc", "ar", "rmse_all", "rmse_all:stress", *COST]
    assert found.blown == {"a": {"here": 0, "there": 0}, "b": {"here": 0, "there": 1}, "c": {"here": 0, "there": 0}}
    assert [len(found.curves[name]) for name in "abc"] == [2, 2, 0] and len(found.curves["a"][1]) == 4


def test_a_study_of_which_nothing_is_done_has_a_table(tmp_path):
    plan = plan_of(("a", {}))
    job = Training(tmp_path / "a", TrainConfig(), tmp_path, tuple((test, tmp_path) for test in plan.tests))
    empty = gathered(plan, {("a", 0): job}, {"here": {}, "there": {}})
    assert empty.columns == {} and empty.apart("here") == [] and empty.table("here") == [["a"], [STILL]]


def test_the_table_shows_deviations_and_what_was_published_in_the_unit_of_its_column(found):
    heads = found.heads()
    assert heads == ["", "MC", "AR", "RMSE-all [mm]", "RMSE-all of stress [Pa]", "valid., equal time [mm]", "parameters",
                     "training [ms/step]", "prediction [ms/step]", "memory [MB]", "hours [h]"]
    assert found.table("here") == [
        ["a", "– [0.5]", "–", "2.5 ± 2.1", "– [7 ± 1]", "3", "1500 ± 0.71", "4", "2.5 ± 0.71", "4 ± 1.4", "0.015 ± 0.0071"],
        ["b", "–", "–", "–", "–", "4", "1500", "6 ± 2.8", "–", "3", "0.0279 ± 0.0002"],
        ["c", "–", "–", "–", "–", "–", "–", "–", "–", "–", "–"],
        [STILL, "–", "–", "20", "–", "", "", "", "", "", ""]]
    assert found.table("there")[2][2] == "– [0.1 ± 0.2]" and found.table("there")[0][1] == "0.5 ± 0.35"


def test_a_terminal_is_told_the_error_of_each_row_and_what_it_says(found):
    assert found.lines() == [
        "A study (small)",
        "RMSE-all on here [mm]:",
        f"  {'a':40s} 2.5 ± 2.1", f"  {'b':40s} –", f"  {'c':40s} –", f"  {STILL:40s} 20",
        "RMSE-all on there [mm]:",
        f"  {'a':40s} 3", f"  {'b':40s} 8", f"  {'c':40s} –", f"  {STILL:40s} 30",
        "  b: 1 of 2 trainings led to rollouts that blow up",
        "  b has 5 mm more than a; one seed does not say whether that is more than chance."]


def result(*cells, seeds=2):
    """A result of rows of one figure."""
    plan = plan_of(*((name, {}) for name in "abcd"[:len(cells)]), tests=("t",), seeds=seeds)
    rows = {name: {"t": {FIGURE: cell}} for name, cell in zip("abcd", cells, strict=False)}
    return Result(plan, {FIGURE: FIGURES[FIGURE]}, rows | {STILL: {"t": {FIGURE: Score(0.0, math.nan, 1)}}}, {}, {})


@pytest.mark.parametrize("other, said", [
    # Two standard errors of the difference of means of n = 2 seeds, both variances 1.4^2 mm^2: 2 sqrt(2 * 1.96 / 2) = 2.8 mm
    (Score(3.81e-3, 1.4e-3, 2), "b has 2.81 mm more than a: more than two standard errors of 2 seeds each."),
    (Score(3.79e-3, 1.4e-3, 2), "b has 2.79 mm more than a, which 2 seeds each cannot tell from chance; some 3 would."),
    (Score(2e-3, 1.4e-3, 3), "b has 1 mm more than a, which 2 seeds each cannot tell from chance; some 16 would."),
    (Score(1.5e-3, 2.8e-3, 2), "b has 0.5 mm more than a, which 2 seeds each cannot tell from chance; some 157 would."),
    (Score(1.0041e-3, 1.4e-3, 2), "b has 0.0041 mm more than a, which 2 seeds each cannot tell from chance; some 932779 would."),
    (Score(1.0039e-3, 1.4e-3, 2), "b has 0.0039 mm more than a, which 2 seeds each cannot tell from chance."),
    (Score(1e-3, 0.0, 2), "b has 0 mm more than a, which 2 seeds each cannot tell from chance."),
    (Score(2e-3, math.nan, 1), "b has 1 mm more than a; one seed does not say whether that is more than chance.")])
def test_rows_are_told_apart_by_two_standard_errors(other, said):
    assert result(Score(1e-3, 1.4e-3, 2), other).apart("t") == [said]


def test_every_row_is_held_against_the_best_and_those_without_an_error_against_none():
    first, second, none, best = Score(3e-3, 0.0, 2), Score(4e-3, 0.0, 2), Score(math.nan, math.nan, 0), Score(1e-3, 0.0, 2)
    said = result(first, second, none, best).apart("t")
    assert [line.split(":")[0] for line in said] == ["a has 2 mm more than d", "b has 3 mm more than d"]
    assert result(first, none).apart("t") == []


def test_a_figure_that_no_table_has_is_refused():
    check_published(plan_of(("a", {"here": dict.fromkeys(("mc", "hours", "rmse_all:stress"), (1.0, 1.0))})))
    with pytest.raises(InputError, match=r"^row 'a': published\.rmsd_all: no such figure; .*there are gf_h, .*hours$"):
        check_published(plan_of(("b", {}), ("a", {"there": {"mc": (1.0, 1.0), "rmsd_all": (1.0, 1.0)}})))


def test_the_facts_of_a_study():
    said = ("training / validation / test trajectories, data: 3 / 2 / 1 of demo; far: 0 / 0 / 4 of beam-small.")
    assert facts(plan_of(("a", {}))) == f"Size small: means ± deviations over 2 seeds; {said}"
    assert facts(plan_of(("a", {}), seeds=1, source="X 2020")) == (
        f"Size small: means ± deviations over 1 seed; {said} In brackets what was published (X 2020).")


def test_table_md_and_table_csv(tmp_path):
    """One row with a published figure beside it, and nothing moves; SI units with nine digits in the second."""
    found = result(Score(1e-3 / 3, 2e-3, 2, (0.5e-3, math.nan)), Score(math.nan, math.nan, 0))
    write_tables(tmp_path, found)
    assert (tmp_path / "table.md").read_text() == markdown(found) == "\n".join([
        "# A study", "", facts(found.plan), "", "## Tested on: t", "", "|  | RMSE-all [mm] |", "| --- | ---: |",
        "| a | 0.333 ± 2 [0.5] |", "| b | – |", "| nothing moves | 0 |", "", "", "## What the columns are", "",
        "- **RMSE-all**: all steps of a rollout: root of the mean square over all steps and trajectories at once of a **coordinate**'s "
        "error; **free** nodes.", ""])
    assert (tmp_path / "table.csv").read_bytes().decode().split("\r\n") == table_csv(found).split("\r\n") == [
        "row,test,figure,unit,mean,deviation,seeds,published,published deviation",
        "a,t,rmse_all,m,0.000333333333,0.002,2,0.0005,", "b,t,rmse_all,m,,,0,,", "nothing moves,t,rmse_all,m,0,,1,,", ""]
    told = markdown(Result(plan_of(("a", {}), tests=("t",), about="What for."), found.columns, found.cells, {}, {})).split("\n")
    assert told[:6] == ["# A study", "", "What for.", "", facts(found.plan), ""]
    assert "- b has" not in "\n".join(told)
    apart = markdown(result(Score(1e-3, 0.0, 2), Score(2e-3, 0.0, 2))).split("\n")
    assert apart[11:13] == ["", "- b has 1 mm more than a: more than two standard errors of 2 seeds each."]


def test_a_column_that_a_row_lacks_is_no_line_of_the_csv_and_an_empty_cell(found):
    lines = [line.split(",") for line in table_csv(found).split("\r\n")]
    assert [line[2] for line in lines if line[:2] == [STILL, "here"]] == ["mc", "ar", "rmse_all", "rmse_all:stress"]
    assert ["a", "here", "hours", "h", "0.015", "0.00707106781", "2", "", ""] in lines
    assert ["c", "there", "ar", "1", "", "", "0", "0.1", "0.2"] in lines
