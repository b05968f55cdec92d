"""Every number of a data set's statistics, worked out on paper for trajectories of five nodes and two steps."""

import dataclasses
import json
import types

import numpy as np
import pytest

from datagen.sets import statistics
from datagen.sets.statistics import lines, of_trajectory, rows_of
from physics.schema import InputError
from tests.five_nodes import UNIT, tiny, write_set
from tests.scenes import beam, pressed


def test_the_numbers_of_one_trajectory_are_those_worked_out_on_paper():
    """Squares of lengths, in units: 25 + 0 + 4 and 169 + 100 + 1 of displacements; 25 + 0 + 4 and 144 + 100 + 1 of changes, the second
    (0, 0, 12), (0, 6, 8), (0, 0, -1); 169 + 100 + 9 of the change of change, (-3, -4, 12), (0, 6, 8), (0, 0, -3)."""
    row = of_trajectory(tiny())
    assert row == pytest.approx({
        "nodes": 8, "obstacle_nodes": 3, "cells": 2, "graph_diameter": 2, "steps": 2, "xy_extent": 0.3 * 0.2,
        "displacement_rms": UNIT * (299 / 6) ** 0.5, "displacement_largest": 13 * UNIT, "change_rms": UNIT * (274 / 6) ** 0.5,
        "change_of_change_rms": UNIT * (278 / 3) ** 0.5,
        "storage_noise": 2**-24 * UNIT * (299 / 9) ** 0.5,  # half a unit in the last place of each component, rest state included
        "reaction_largest": 7, "energy_largest": 0.5, "smallest_det_f": 0.625, "newton_iterations": 3.5, "relative_residual_largest": 1e-3,
        "solver_noise": 1e-3 * UNIT * (299 / 6) ** 0.5, "seconds": 6, "ms_per_step": 3000}, rel=1e-12)


def test_a_packed_trajectory_is_as_blurred_as_its_tolerance():
    packed = of_trajectory(tiny(extra={"tolerance": 1e-3}))
    assert packed["storage_noise"] == pytest.approx(1e-3 * 3**0.5, rel=1e-12) and packed["seconds"] == packed["ms_per_step"] == 0


def test_a_single_step_has_no_change_of_change():
    whole = tiny()
    short = of_trajectory(tiny(displacement=whole.displacement[:2], per_frame={}))
    assert short["change_of_change_rms"] == 0 and short["steps"] == 1 and short["ms_per_step"] == 6000
    assert short["displacement_rms"] == short["change_rms"] == pytest.approx(UNIT * (29 / 3) ** 0.5)
    assert "solver_noise" not in short and "support" not in short


def test_words_come_from_the_scene():
    two = [{"where": "x-min"}, {"where": "x-max"}]
    assert {name: of_trajectory(tiny(scene=pressed(support=two).to_toml()))[name] for name in ("support", "obstacle")} == {
        "support": "x-min and x-max", "obstacle": "cylinder"}
    alone = of_trajectory(tiny(scene=beam(support=[]).to_toml()))
    assert (alone["support"], alone["obstacle"]) == ("none", "none")


@pytest.fixture
def three(tmp_path):
    """Three trajectories, of 6, 12 and 18 s; the last moves twice as far, and two earlier draws in its place failed."""
    first = tiny()
    twice = dataclasses.replace(first, displacement=2 * first.displacement,
                                extra={"seconds": 18.0, "failed_attempts": ["slipped", "stuck"]})
    write_set(tmp_path, {"train/0000.vtkhdf": first, "train/0001.vtkhdf": tiny(extra={"seconds": 12.0}), "test/0000.vtkhdf": twice})
    return tmp_path


def test_the_numbers_of_a_set_are_spread_over_its_trajectories(three):
    """Of 13, 13 and 26: mean 52/3, variance of the sample itself 2/9 of 13^2. Of 6, 12, 18 s: mean 12, variance 24; 36 s are 0.01 h."""
    found = statistics.statistics(three)
    assert found["count"] == 3 and found["split"] == {"test": 1, "train": 2} and "file" not in found and "refined" not in found
    assert found["displacement_largest"] == pytest.approx(
        {"mean": UNIT * 52 / 3, "std": UNIT * 13 * 2**0.5 / 3, "min": UNIT * 13, "max": UNIT * 26}, rel=1e-12)
    assert found["seconds"] == pytest.approx({"mean": 12, "std": 24**0.5, "min": 6, "max": 18}, rel=1e-12)
    assert found["solver_hours"] == pytest.approx(0.01, rel=1e-12)
    assert (found["failed_attempts"], found["reasons"]) == (2, ["slipped", "stuck"])
    size = sum(path.stat().st_size for path in three.rglob("*.vtkhdf"))
    assert found["gigabytes"] == pytest.approx(size / 1e9, rel=1e-12)
    rows = rows_of(three)
    assert [(row["file"], row["split"]) for row in rows] == [
        ("train/0000.vtkhdf", "train"), ("train/0001.vtkhdf", "train"), ("test/0000.vtkhdf", "test")]
    assert rows[2]["megabytes"] == (three / "test/0000.vtkhdf").stat().st_size / 1e6
    rows[0]["nodes"] = 11  # rows that are known already are taken as they are
    assert statistics.statistics(three, rows)["nodes"] == pytest.approx({"mean": 9, "std": 2**0.5, "min": 8, "max": 11})


def test_a_set_without_trajectories_has_no_numbers(tmp_path):
    write_set(tmp_path, {})
    with pytest.raises(InputError, match="no trajectories"):
        rows_of(tmp_path)


# ---- the error of the mesh


@pytest.mark.parametrize(("count", "every"), [(1, 1), (7, 1), (40, 1), (41, 1), (79, 1), (80, 2), (81, 3), (100, 2), (101, 101), (400, 10)])
def test_steps_are_joined_so_that_about_forty_are_left(count, every):
    """The smallest divisor of the number of steps from a fortieth of it (rounded down) on; 101 is a prime."""
    assert statistics._every(beam(steps={"count": count})) == every


def test_the_error_of_the_mesh_is_worked_out_at_free_nodes_of_joined_steps(monkeypatch):
    """80 steps of which every second is compared; node 0 of 3 is held and does not count for the mesh, it does for the solver.

    At frame t node 1 lies (0, 3t, 4t) from rest and the finer mesh says (0, 3t, 4t + 1); node 2 rests and the finer mesh says
    (2, 0, 0), 3 in the last frame: the mean of |off|^2 over 40 frames and two nodes is (40 + 39 * 4 + 9) / 80.
    """
    t = np.arange(81)
    u = np.zeros((81, 3, 3), np.float32)
    u[:, 1, 1], u[:, 1, 2], u[:, 0, 0] = 3 * t, 4 * t, t
    made = tiny(points=np.eye(3), node_kind=np.array([3, 0, 0], np.uint8), displacement=u, scene=beam(steps={"count": 80}).to_toml())
    asked, mesh = [], types.SimpleNamespace(points=np.eye(3))
    monkeypatch.setattr(statistics, "solved_on", lambda scene, trajectory: mesh)

    def solved(scene, every, given, times):
        asked.append((scene.steps.count, every, given is mesh, times))
        again = u[::2].astype(float)
        if times == 1:
            again[5, 0] += (0, 0, 0.25)
            again[6, 1] += (0.1, 0, 0)
            return again, 1.5
        again[:, 0] += 100
        again[1:, 1, 2] += 1
        again[1:, 2, 0] += 2
        again[40, 2, 0] += 1
        again[0, 1] += 50  # the rest state is not compared
        return again, 2.5

    monkeypatch.setattr(statistics, "_solved", solved)
    found = statistics.mesh_error(made)
    assert asked == [(80, 2, True, 1), (80, 2, True, 2)]
    rmse, moved = (205 / 80) ** 0.5, (25 * sum(k * k for k in range(2, 81, 2)) / 80) ** 0.5
    assert found == pytest.approx({"mesh_rmse": rmse, "mesh_largest": 3, "mesh_relative": rmse / moved, "solver_largest": 0.25,
                                   "seconds": 2.5}, rel=1e-12)


def test_a_finer_solution_has_more_cells_and_fewer_steps_and_is_read_at_the_same_nodes(monkeypatch):
    scene = beam(body={"length": 0.06, "width": 0.02, "height": 0.01, "cell_size": 0.005}, steps={"count": 80})
    mesh = types.SimpleNamespace(points=np.array([[0.0, 0.0, 0.0], [0.06, 0.0, 0.01]]))
    asked = []

    def solve(given, *, partial, failure=""):
        asked.append(given)
        nodes = np.array([[0.06, 0.0, 0.01], [0.03, 0.01, 0.0], [0.0, 0.0, 0.0]])
        return types.SimpleNamespace(failure=failure, mesh=types.SimpleNamespace(points=nodes), seconds=4.5,
                                     displacement=np.arange(27.0).reshape(3, 3, 3))

    monkeypatch.setattr(statistics, "solve", solve)
    every, u, seconds = statistics.finer(scene, mesh)
    assert (every, seconds) == (2, 4.5) and np.array_equal(u, np.arange(27.0).reshape(3, 3, 3)[:, [2, 0]])
    assert asked[0].steps.count == 40 and asked[0].body.cells == (24, 8, 4) and asked[0].body.cell_size is None
    assert (asked[0].material, asked[0].support) == (scene.material, scene.support)
    with pytest.raises(AssertionError, match="keep the nodes"):
        statistics.finer(scene, types.SimpleNamespace(points=mesh.points + 2e-9))
    monkeypatch.setattr(statistics, "solve", lambda given, partial: solve(given, partial=partial, failure="stuck"))
    with pytest.raises(RuntimeError, match="the scene with 24 x 8 x 4 cells: stuck"):
        statistics.finer(scene, mesh)
    with pytest.raises(RuntimeError, match="in motion"):
        statistics.finer(dataclasses.replace(scene, steps=dataclasses.replace(scene.steps, dynamic=True)), mesh)


def test_the_sample_is_drawn_by_its_seed_and_kept(three, monkeypatch):
    """One that fails is recorded and another takes its place; what refined.json knows is not solved again."""
    order = np.random.default_rng(5).permutation(3)
    asked = []

    def mesh_error(trajectory):
        asked.append(trajectory.extra["seconds"])
        if len(asked) == 1:
            raise RuntimeError("too coarse")
        return {"mesh_rmse": float(trajectory.extra["seconds"])}

    monkeypatch.setattr(statistics, "mesh_error", mesh_error)
    # The first two differ in their times alone, which no checksum sees: give them other sums.
    manifest = statistics.dataset.read_manifest(three)
    entries = tuple(dataclasses.replace(entry, sha256=str(i)) for i, entry in enumerate(manifest.trajectories))
    statistics.dataset.write_manifest(three, dataclasses.replace(manifest, trajectories=entries))
    seconds = [(6.0, 12.0, 18.0)[i] for i in order]
    found = statistics.statistics(three, refined=1, seed=5)["refined"]
    assert asked == seconds[:2] and found["failures"] == ["too coarse"] and found["count"] == 1
    assert found["mesh_rmse"] == {"mean": seconds[1], "std": 0, "min": seconds[1], "max": seconds[1]}
    assert json.loads((three / "refined.json").read_text()) == {str(order[0]): {"failure": "too coarse"},
                                                                str(order[1]): {"mesh_rmse": seconds[1]}}
    found = statistics.statistics(three, refined=9, seed=5)["refined"]  # more than there are
    assert asked == seconds and found["count"] == 2 and found["failures"] == ["too coarse"]
    assert found["mesh_rmse"]["mean"] == pytest.approx((seconds[1] + seconds[2]) / 2)
    monkeypatch.setattr(statistics, "mesh_error", lambda _: pytest.fail("solved again"))
    assert statistics.statistics(three, refined=1, seed=5)["refined"]["count"] == 1


def test_a_sample_of_failures_has_none(three, monkeypatch):
    def mesh_error(trajectory):
        raise RuntimeError("no way")

    monkeypatch.setattr(statistics, "mesh_error", mesh_error)
    assert statistics.statistics(three, refined=2)["refined"] == {"count": 0, "failures": ["no way"] * 2}  # two of three differ


def test_numbers_are_said_in_lines():
    found = {"count": 3, "seconds": {"mean": 1.23456, "max": 2.0}, "solver_hours": 0.0123456, "reasons": ["x"],
             "refined": {"count": 2, "mesh_rmse": {"mean": 0.5}, "failures": []}}
    assert lines(found) == [
        "count                  3", "seconds                mean 1.235, max 2", "solver_hours           0.012346",
        "refined", "  count                  2", "  mesh_rmse              mean 0.5"]
