"""Rivals that are right where they must be, and the whole report of a small network."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.files.inputs import predicted
from datagen.files.trajectory import write_trajectory
from datagen.sets.generate import trajectory_of
from learning.config import TrainConfig
from learning.networks.m4gn import M4GNConfig
from learning.prediction.rivals import REFERENCE, between, coarser, keep_acceleration, keep_velocity, nothing_moves
from learning.report.evaluate import evaluate
from learning.training.train import train
from physics.mesh.quality import rmsd
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
    assert rmsd(path, truth, FREE) == pytest.approx(np.sqrt(np.mean(np.sum(truth[:, FREE] ** 2, axis=2))))
    assert rmsd(steps, truth[1:], FREE) == pytest.approx(np.sqrt((14 + 1.25) / 2))
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


def small_config() -> TrainConfig:
    network = M4GNConfig(hidden=16, message_steps=1, transformer_layers=1, heads=2)
    return TrainConfig(segments=4, network=network, contact_radius=0.006, batch_size=2, steps=3)


def test_evaluate_writes_the_whole_folder(tmp_path):
    file = tmp_path / "beam.vtkhdf"
    trajectory = trajectory_of(pressed())
    write_trajectory(file, trajectory)
    train(small_config(), [file], [file], tmp_path / "run")
    (tmp_path / "mine").mkdir()
    short = np.where(trajectory.free[:, None], np.float32(0.9) * trajectory.displacement, trajectory.displacement)
    write_trajectory(tmp_path / "mine" / "beam.vtkhdf", predicted(trajectory, short[:, trajectory.body]))
    said: list[str] = []
    result = evaluate(tmp_path / "run", [file], tmp_path / "report", predictions=[[str(tmp_path / "mine"), "a tenth short", "2"]],
                      say=said.append)
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert names == {"report.html", "report.md", "report.json", "table.csv", "pareto.png", "frame_beam.png"}
    rows = {row["name"]: row["scores"] for row in result["rows"]}
    coarse = ["FE, cells twice as large", "FE, cells four times as large"]
    assert list(rows) == ["a tenth short", "M4GN", "M4GN, corrected 10-fold", "nothing moves", "keep the last velocity",
                          "quadratic extrapolation", *coarse, REFERENCE]
    assert rows[REFERENCE]["rmsd_all"] == 0
    # A file of another program: a tenth of the motion is missing, in the time that was given.
    assert rows["a tenth short"]["rmsd_all"] == pytest.approx(0.1 * rows["nothing moves"]["rmsd_all"], rel=1e-4)
    assert rows["a tenth short"]["ms_per_step"] == pytest.approx(2)
    assert "a tenth short" in (tmp_path / "report" / "report.md").read_text()
    assert rows[REFERENCE]["relative_residual"] < 1e-3  # of the 32-bit numbers in the file
    errors = [rows[name]["rmsd_all"] for name in (*coarse, "nothing moves")]
    assert 0 < errors[0] < errors[1] < errors[2]
    assert rows["keep the last velocity"]["rmsd_1"] < rows["nothing moves"]["rmsd_1"]
    # A prediction that is the data has the data's own error to the finer solution.
    assert 0 < rows[REFERENCE]["rmsd_refined"] < rows["FE, cells twice as large"]["rmsd_refined"]
    assert rows[REFERENCE]["below_data"] == 1 and rows["nothing moves"]["below_data"] < 0.2
    assert all(row["seconds"] == pytest.approx(0.02 * row["ms_per_step"]) for row in rows.values())
    assert rows["M4GN"]["set_up_seconds"] > 0 and rows["M4GN, corrected 10-fold"]["iterations"] <= 2
    assert rows["M4GN, corrected 10-fold"]["rmsd_all"] < 0.1 * rows["M4GN"]["rmsd_all"]  # as its name says
    assert result["outside"] == {"beam": {}} and result["far_outside"] == []
    assert result["report"] == str(tmp_path / "report")
    assert any("RMSD-all" in line for line in said)
    json.dumps(result, allow_nan=False)


def test_what_cannot_be_the_truth_is_refused(tmp_path):
    with pytest.raises(InputError, match="no trajectories"):
        evaluate(tmp_path, [], tmp_path / "report")
    with pytest.raises(InputError, match="no such checkpoint"):
        evaluate(tmp_path, [Path("t.vtkhdf")], tmp_path / "report")
