"""Predictors measured on cases: with predictors whose paths and times are known, every figure of a row is worked out on paper."""

import math
import time
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from datagen.files.solved import as_solved
from datagen.sets.generate import trajectory_of
from learning.prediction.predictor import Case, LeftOut, Prediction, Predictor
from learning.prediction.rivals import trivial
from learning.report import measure as module
from learning.report.measure import _doubt, _row, measure
from physics.mesh.build import build_mesh
from tests.scenes import pressed

STEPS = 4
SHIFT = np.array([3e-5, 0.0, 4e-5])  # [m], of length 5e-5


@cache
def cases() -> tuple[Case, Case]:
    """A small pressed beam under two names, the second one with a depth of its own."""
    found = []
    for name, low in (("shallow", 0.0265), ("deep", 0.0225)):
        scene = pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 1, 2]}, steps={"count": STEPS},
                        obstacle={"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.0305], [0.05, 0.01, low]]})
        trajectory = trajectory_of(scene)
        found.append(Case(name, trajectory, as_solved(scene, trajectory, STEPS), build_mesh(scene.body)))
    return found[0], found[1]


def shifted(case: Case, *factors: float) -> np.ndarray:
    """The truth, its free nodes moved in frames 1 .. by so many times SHIFT."""
    path = case.truth.astype(np.float64)
    for t, factor in enumerate(factors, 1):
        path[t, case.free] += factor * SHIFT
    return path


def made(name: str, kind: str = "fe", *, factors: tuple[float, ...] = (0, 0, 0, 0), **more) -> Predictor:
    """A predictor of a shifted truth."""
    return Predictor(name, kind, lambda case: Prediction(path=shifted(case, *factors), **({"seconds": 1.0} | more)))


def run(*predictors: Predictor, of=None, **how):
    return measure(predictors, cases()[:1] if of is None else of, **({"sample": 2} | how))


def test_times_are_those_of_a_step_and_of_the_whole():
    # 2 s of stepping and 0.4 s of set-up over 4 steps: 2.4 s in all, 600 ms a step, 500 without set-up; 18 Newton steps, 4.5 a step
    scores = run(made("a", seconds=2.0, set_up=0.4, iterations=18)).rows[0].scores
    assert [scores[key] for key in ("seconds", "set_up_seconds", "ms_per_step", "ms_per_step_alone", "iterations")] == pytest.approx(
        [2.4, 0.4, 600, 500, 4.5])
    assert math.isnan(run(made("a")).rows[0].scores["iterations"])


def test_processor_time_is_what_counts(monkeypatch):
    """A clock that gains a second at each look: a guess looks before and after, one step of four takes 250 ms."""
    ticks = iter(range(100))
    monkeypatch.setattr(time, "process_time", lambda: float(next(ticks)))
    rows = run(*trivial()).rows
    assert [row.ms_per_step for row in rows] == [250, 250, 250] and [row.scores["set_up_seconds"] for row in rows] == [0, 0, 0]


def timed(times: list[tuple[float, float]]) -> tuple[Predictor, list[int]]:
    """A predictor that takes these seconds and set-ups in turn and is farther off each time; and how often it was asked."""
    calls: list[int] = []

    def predict(case):
        calls.append(len(calls))
        seconds, set_up = times[calls[-1]]
        return Prediction(
            path=shifted(case, *[1.0 + calls[-1]] * 4),
            one_step=shifted(case, 2, 2, 2, 2)[1:],
            seconds=seconds,
            set_up=set_up,
            iterations=8 + calls[-1],
        )

    return Predictor("timed", "fe", predict), calls


def test_repeated_times_are_medians_and_the_rest_is_of_the_first():
    predictor, calls = timed([(0.5, 0.1), (0.1, 0.9), (0.2, 0.02)])
    scores = run(predictor, repeats=3).rows[0].scores
    # the medians of each: 0.2 s and 0.1 s, which no single run had together, nor is either a mean
    assert (scores["seconds"], scores["set_up_seconds"]) == pytest.approx((0.3, 0.1)) and calls == [0, 1, 2]
    assert scores["rmsd_all"] == pytest.approx(5e-5, rel=1e-6) and scores["iterations"] == 2
    assert scores["rmsd_1"] == pytest.approx(1e-4, rel=1e-6)


def test_by_default_each_is_timed_once():
    predictor, calls = timed([(1.0, 0.0)])
    assert run(predictor).rows[0].scores["seconds"] == 1 and calls == [0]


@pytest.mark.parametrize("seconds, asked", [(0.99, 3), (1.0, 1), (1.1, 1)])
def test_what_takes_a_second_is_timed_once(seconds, asked):
    predictor, calls = timed([(seconds, 5.0), (20.0, 5.0), (20.0, 5.0)])
    run(predictor, repeats=3)
    assert len(calls) == asked


def test_errors_are_those_of_verify_and_of_one_step_where_there_is_one():
    # shifts of 0, 1, 2 and 4 times 5e-5 m: root of the mean square 5e-5 sqrt(21 / 4); of single steps 3 times 5e-5
    def predict(case):
        return Prediction(path=shifted(case, 0, 1, 2, 4), one_step=shifted(case, 3, 3, 3, 3)[1:], seconds=1.0)

    both = run(Predictor("with", "learned", predict), made("without", factors=(0, 1, 2, 4))).rows
    share = math.sqrt(cases()[0].free.sum() / len(cases()[0].free))  # over all nodes, of which some are held
    for row in both:
        assert row.scores["rmsd_all"] == pytest.approx(5e-5 * math.sqrt(21 / 4), rel=1e-6)
        assert row.scores["rmsd_all_all_nodes"] == pytest.approx(share * row.scores["rmsd_all"])
        assert "worst_step" not in row.scores and row.scores["smallest_det_f"] > 0
    assert both[0].scores["rmsd_1"] == pytest.approx(1.5e-4, rel=1e-6)
    assert both[0].scores["rmsd_1_all_nodes"] == pytest.approx(share * 1.5e-4, rel=1e-6)
    assert math.isnan(both[1].scores["rmsd_1"]) and math.isnan(both[1].scores["rmsd_1_all_nodes"])
    assert (both[0].name, both[0].kind, both[1].name, both[1].kind) == ("with", "learned", "without", "fe")


def test_the_reference_counts_as_its_file_and_what_it_differs_by_is_kept():
    """Largest component of any difference of any case, here 4e-5 of (3e-5, 0, 4e-5), twice that in the first case alone."""
    def predict(case):
        return Prediction(path=shifted(case, 0, -2 if case.name == "shallow" else 1, 0, 0), seconds=1.0)

    found = run(Predictor("FE", "reference", predict), made("other", factors=(9, 9, 9, 9)), of=cases())
    assert found.rows[0].scores["rmsd_all"] == 0 and found.solved_again == pytest.approx(8e-5, rel=1e-5)
    assert found.frames == []


def test_the_equations_are_checked_at_so_many_frames(monkeypatch):
    given, real = [], module.Reference
    monkeypatch.setattr(module, "Reference", lambda *a, **how: given.append((a, how)) or real(*a, **how))
    case = cases()[0]
    run(made("a", factors=(1, 0, 0, 0)), sample=3)
    (truth, scene, mesh, free, sample), how = given[0]
    assert np.array_equal(truth, case.truth) and scene is case.scene and mesh is case.mesh and np.array_equal(free, case.free)
    assert sample == 3 and how == {"shapes": 3}


def test_the_worst_frame_of_each_network_is_kept():
    found = run(made("a", "learned", factors=(1, 5, 2, 0)), made("b", "hybrid"), made("c", "learned", factors=(0, 0, 0, 1)), of=cases())
    assert [(frame.predictor, frame.case.name, frame.step) for frame in found.frames] == [
        ("a", "shallow", 2), ("c", "shallow", 4), ("a", "deep", 2), ("c", "deep", 4)]
    assert found.frames[2].error == pytest.approx(5e-5 * math.sqrt(30 / 4), rel=1e-5)  # of the whole rollout: 1 + 25 + 4 + 0 over 4
    assert np.array_equal(found.frames[2].displacement, shifted(cases()[1], 1, 5, 2, 0)[2])


def test_the_paths_of_all_are_kept_of_the_trajectory_that_a_network_is_worst_on(monkeypatch):
    """Off by 1 in the first case and 2 in the second, or the other way round; what is not learned does not count."""
    def learned(*factors):
        return Predictor("M4GN", "learned", lambda case: Prediction(
            path=shifted(case, *[factors[case.name == "deep"]] * 4), seconds=1.0))

    rival = Predictor("FE", "fe", lambda case: Prediction(path=shifted(case, *[9 if case.name == "shallow" else 5] * 4), seconds=1.0))
    for factors, number in (((1, 2), 1), ((2, 1), 0)):
        hardest = run(rival, learned(*factors), of=cases()).hardest
        assert hardest.case is cases()[number] and list(hardest.paths) == ["FE", "M4GN"] and hardest.error == pytest.approx(1e-4, rel=1e-5)
        assert hardest.paths["M4GN"].dtype == np.float32
        assert np.array_equal(hardest.paths["M4GN"], shifted(cases()[number], 2, 2, 2, 2).astype(np.float32))
    assert run(rival, of=cases()).hardest.case is cases()[0]  # without a network any counts
    assert run(of=cases()).hardest is None


def test_a_path_beyond_all_numbers_is_the_worst_of_all():
    def predict(case):
        return Prediction(path=shifted(case) * (1e45 if case.name == "deep" else 1.0), seconds=1.0)

    found = run(Predictor("M4GN", "learned", predict), of=cases())
    assert found.hardest.case is cases()[1] and found.hardest.error > 1e40 and np.isinf(found.hardest.paths["M4GN"]).any()


def test_who_cannot_do_one_case_has_no_row_and_a_note_says_why():
    def predict(case):
        if case.name == "deep":
            raise LeftOut("it blows up: nan")
        return Prediction(path=shifted(case), seconds=1.0)

    done: list[int] = []
    found = run(Predictor("M4GN", "learned", predict), made("a"), of=cases(), on_done=lambda: done.append(1))
    assert [row.name for row in found.rows] == ["a"] and len(done) == 4
    assert found.notes == ["M4GN is left out, because in deep it blows up: nan."]


def test_a_finer_solution_has_an_error_of_its_own(monkeypatch):
    """Frames 0, 2 and 4 have one, off the data by 1 and 4 times 5e-5 m; frame 0 is the rest state of all and does not count."""
    case = cases()[0]
    asked = []

    def finer(scene, mesh):
        asked.append((scene, mesh))
        return 2, shifted(case, 0, 1, 0, 4)[::2], 99.0

    monkeypatch.setattr(module, "finer", finer)
    # In frames 2 and 4 the finer solution is 1 and 4 from the data, 0.5 and 5.5 from "near", 0 and 0 from "on", 2.1 and 6 from "far".
    # These are 0.5 and 1.5, 1 and 4, 1.1 and 2 from the data: nearer than the finer solution twice, never (equal does not count), once.
    rows = run(made("near", factors=(7, 0.5, 7, -1.5)), made("on", factors=(7, 1, 7, 4)), made("far", factors=(7, -1.1, 7, -2)),
               Predictor("FE", "reference", lambda c: Prediction(path=shifted(c, 1, 1, 1, 1), seconds=1.0)), refined=[0]).rows
    assert asked == [(case.scene, case.mesh)]
    size = {row.name: row.scores["rmsd_refined"] / 5e-5 for row in rows}
    share = {row.name: row.scores["below_data"] for row in rows}
    assert size == pytest.approx({"near": math.sqrt((0.25 + 30.25) / 2), "on": 0, "far": math.sqrt((2.1**2 + 36) / 2),
                                  "FE": math.sqrt((1 + 16) / 2)}, rel=1e-5, abs=1e-3)
    assert share == {"near": 1, "on": 0, "far": 0.5, "FE": 1}  # of the reference the file counts, which is the data


def test_only_the_cases_asked_for_are_solved_on_finer_cells_and_failures_are_told(monkeypatch):
    names = {id(case.mesh): case.name for case in cases()}

    def finer(scene, mesh):
        if names[id(mesh)] == "shallow":
            raise RuntimeError("its mesh comes from a file")
        return 1, cases()[1].truth.astype(np.float64) + SHIFT, 1.0

    monkeypatch.setattr(module, "finer", finer)
    found = run(made("a"), of=cases(), refined=[0, 1])
    assert found.notes == ["shallow has no finer solution: its mesh comes from a file."]
    assert math.isnan(found.rows[0].each[0]["rmsd_refined"]) and math.isnan(found.rows[0].each[0]["below_data"])
    assert found.rows[0].each[1]["rmsd_refined"] == pytest.approx(5e-5) == found.rows[0].scores["rmsd_refined"]
    found = run(made("a"), of=cases(), refined=[1])
    assert found.notes == [] and math.isnan(found.rows[0].each[0]["rmsd_refined"]) and found.rows[0].each[1]["rmsd_refined"] > 0
    assert math.isnan(run(made("a")).rows[0].scores["rmsd_refined"])


def test_a_distance_by_frame_is_over_free_nodes_alone():
    """Nodes 0 and 2 are free: (3, 4) and (0, 12) apart in one frame, root of the mean of 25 and 144; 0.5 m of node 1 do not count."""
    case = Case("", None, None, None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Case, "free", np.array([True, False, True]))
        a = np.zeros((2, 3, 3), np.float32)
        a[1] = [[3, 0, 4], [0.5, 0, 0], [0, 12, 0]]
        assert module._by_frame(a, np.zeros((2, 3, 3)), case) == pytest.approx([0, math.sqrt(169 / 2)], rel=1e-7)
        assert module._by_frame(a, a, case).dtype == np.float64


EACH = [{"rmsd_all": 1e-3, "largest_penetration": 1e-5, "smallest_det_f": 0.9, "smallest_scaled_jacobian": 0.3, "inverted_elements": 1.0,
         "rmsd_refined": math.nan, "relative_residual": 0.25},
        {"rmsd_all": 3e-3, "largest_penetration": 4e-5, "smallest_det_f": 0.4, "smallest_scaled_jacobian": 0.1, "inverted_elements": 5.0,
         "rmsd_refined": 5e-3, "relative_residual": 0.5},
        {"rmsd_all": 8e-3, "largest_penetration": 2e-5, "smallest_det_f": 0.6, "smallest_scaled_jacobian": 0.2, "inverted_elements": 0.0,
         "rmsd_refined": 7e-3, "relative_residual": 1.5}]


def test_rows_hold_means_and_of_extremes_the_extreme():
    row = _row(Predictor("M4GN", "learned", lambda case: None), EACH)
    # of a mean those count that have a number: (5 + 7) / 2 mm
    assert row.scores == pytest.approx(
        {
            "rmsd_all": 4e-3,
            "largest_penetration": 4e-5,
            "smallest_det_f": 0.4,
            "smallest_scaled_jacobian": 0.1,
            "inverted_elements": 5,
            "rmsd_refined": 6e-3,
            "relative_residual": 0.75,
        }
    )
    assert row.each == tuple(EACH) and (row.name, row.kind) == ("M4GN", "learned")
    assert math.isnan(_row(Predictor("FE", "fe", lambda case: None), [{"rmsd_1": math.nan}]).scores["rmsd_1"])


def test_nothing_is_kept_of_what_was_measured_before():
    first, second = run(made("a", "learned")), run(made("b"))
    assert len(first.frames) == 1 and second.frames == [] and [row.name for row in second.rows] == ["b"] and second.notes == []
    assert second.solved_again == 0


def test_an_error_bar_is_held_against_the_errors_of_the_frames_that_have_one():
    """Of five frames the last three have a bar, of 1, 2 and 6 m, and errors of 3, 2 and 0 m; the rest state is never counted as unsure."""
    truth = np.zeros((5, 2, 3))
    path = truth.copy()
    path[:, 0, 1] = [9, 9, 3, 2, 0]
    one = SimpleNamespace(truth=truth, free=np.array([True, False]))

    def told(bar, unsure):
        return _doubt(Prediction(path=path, seconds=0.0, bar=np.array(bar, float), unsure=np.array(unsure, bool)), one)

    assert told([0, 0, 1, 2, 6], [1, 1, 0, 0, 0]) == {"error_bar": 3.0, "covered": pytest.approx(2 / 3), "unsure": 0.25}
    never = told([0] * 5, [0, 1, 0, 0, 1])
    assert never["unsure"] == 0.5 and np.isnan([never["error_bar"], never["covered"]]).all()
    silent = _doubt(Prediction(path=path, seconds=0.0), one)
    assert list(silent) == ["error_bar", "covered", "unsure"] and np.isnan(list(silent.values())).all()


@pytest.mark.parametrize("kind, wall", [("fe", 3.0), ("foreign", math.nan)])
def test_the_time_by_the_clock_is_the_processors_at_the_ratio_of_both_clocks(monkeypatch, kind, wall):
    """A whole call of 4 s of the processor and 10 s of the clock, of which 1 s of steps and 0.2 s of set-up count: 3 s. What a stranger
    tells of its own time is no time of this clock."""
    clocks = [iter([50.0, 54.0]), iter([70.0, 80.0])]
    monkeypatch.setattr(module, "time", SimpleNamespace(process_time=lambda: next(clocks[0]), perf_counter=lambda: next(clocks[1])))
    found = module._timed(made("a", kind, seconds=1.0, set_up=0.2), cases()[0])
    assert found.wall == pytest.approx(wall, nan_ok=True)


def test_a_call_too_short_for_the_processors_clock_has_no_time_by_the_other(monkeypatch):
    monkeypatch.setattr(module, "time", SimpleNamespace(process_time=lambda: 1.0, perf_counter=time.perf_counter))
    assert math.isnan(module._timed(made("a"), cases()[0]).wall)


def test_an_error_is_told_as_a_share_of_the_motion_and_times_as_milliseconds_a_step(monkeypatch):
    case = cases()[0]
    scores = run(made("a", factors=(2, 2, 2, 2), seconds=1.0, set_up=0.5)).rows[0].scores
    motion = math.sqrt((case.truth[1:, case.free].astype(float) ** 2).sum(axis=2).mean())
    assert scores["of_motion"] == pytest.approx(1e-4 / motion, rel=1e-5)
    assert (scores["ms_per_step"], scores["ms_per_step_alone"]) == pytest.approx((375, 250))
    monkeypatch.setattr(module, "_timed", lambda predictor, case: Prediction(path=case.truth, seconds=0.1, wall=6.0))
    assert run(made("a")).rows[0].scores["wall_ms_per_step"] == pytest.approx(1500)
    still = replace(case, trajectory=replace(case.trajectory, displacement=0 * case.trajectory.displacement))
    assert math.isnan(run(made("a"), of=[still]).rows[0].scores["of_motion"])


def test_medians_are_taken_of_each_clock(monkeypatch):
    walls = iter([0.5, 0.1, 0.2])
    monkeypatch.setattr(module, "_timed", lambda predictor, case: Prediction(path=case.truth, seconds=0.1, wall=next(walls)))
    assert module._repeated(made("a"), cases()[0], 3).wall == 0.2
