"""Files of predicted flows held against their truths, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.flow.figures import predicted_nodes, resting
from datagen.flow.prediction import flow_lines, read_flow_truth, verify_files
from datagen.flow.trajectory import flow_trajectory
from physics.flow.solution import solve_flow
from physics.schema import InputError
from tests.five_nodes import tiny
from tests.flows import channel_flow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flows")
    (folder / "truth").mkdir()
    (folder / "mine").mkdir()
    scene = channel_flow(inflow=[{"speed": 0.3}], steps={"count": 8, "duration": 0.1})
    truth = flow_trajectory(scene, solve_flow(scene))
    write_trajectory(folder / "truth" / "a.vtkhdf", truth)
    write_trajectory(folder / "truth" / "b.vtkhdf", truth)
    return folder


def faster(truth, share, **changes):
    velocity = truth.fields["velocity"].copy()
    velocity[2:, predicted_nodes(truth)] *= np.float32(1 + share)
    return replace(truth, fields={**truth.fields, "velocity": velocity}, **changes)


def test_an_impulsive_start_is_shown_and_a_slow_one_too():
    """At rest but for the inlet in frame 0; with a ramp as well, and not when the first frame is left out."""
    scene = channel_flow(inflow=[{"speed": 0.3}], steps={"count": 3, "duration": 0.03})
    truth = flow_trajectory(scene, solve_flow(scene))
    assert resting(truth) == 1
    assert resting(replace(truth, fields={"velocity": truth.fields["velocity"][1:]}, displacement=truth.displacement[1:])) == 0


def test_a_prediction_is_held_beside_one_that_does_not_change_and_beside_the_data(folder, tmp_path):
    truth = read_trajectory(folder / "truth" / "a.vtkhdf")
    write_trajectory(tmp_path / "mine.vtkhdf", faster(truth, 0.01))
    found = verify_files(tmp_path / "mine.vtkhdf", folder / "truth" / "a.vtkhdf", tmp_path / "report")
    inside = truth.fields["velocity"][2:, predicted_nodes(truth), :2].astype(float)
    assert found["velocity_rmse_all"] == pytest.approx(0.01 * np.sqrt((inside**2).mean()), rel=1e-4)
    assert found["data"]["velocity_rmse_all"] == 0 < found["nothing_changes"]["velocity_rmse_all"]
    assert 0 < found["data"]["momentum_residual"] < found["momentum_residual"]
    assert json.loads((tmp_path / "report" / "verify.json").read_text())["worst_step"] == found["worst_step"]
    assert Image.open(tmp_path / "report" / "worst.png").size[0] > 800
    said = flow_lines(found)
    assert "nothing changes" in said[0] and said[3].startswith("RMSE-all [m/s]")
    assert len(said[3].split()) == 5


def test_folders_are_compared_file_by_file_and_gathered(folder, tmp_path):
    """Errors of 1 and 7 parts: together the root of the mean square, 5."""
    truth = read_trajectory(folder / "truth" / "a.vtkhdf")
    for name, share in (("a", 0.01), ("b", 0.07)):
        write_trajectory(folder / "mine" / f"{name}.vtkhdf", faster(truth, share))
    found = verify_files(folder / "mine", folder / "truth")
    assert found["velocity_rmse_all"] == pytest.approx(5 * found["files"]["a"]["velocity_rmse_all"], rel=1e-3)
    assert found["flux_error"] == found["files"]["b"]["flux_error"]


def test_what_cannot_be_held_against_a_flow_is_refused_in_a_line(folder, tmp_path):
    path, file = folder / "truth" / "a.vtkhdf", tmp_path / "mine.vtkhdf"
    truth = read_trajectory(path)
    wrong = truth.fields["velocity"].copy()
    wrong[3, 5, 0] = np.nan
    for change, said in (({"fields": {"pressure": truth.fields["pressure"]}}, "has no velocity"),
                         ({"fields": {**truth.fields, "velocity": wrong}}, "its velocity is not finite at frame 3"),
                         ({"points": truth.points + [1e-3, 0, 0]}, "its mesh or number of frames is not that of")):
        write_trajectory(file, replace(truth, **change))
        with pytest.raises(InputError, match=said):
            verify_files(file, path)
    write_trajectory(file, replace(truth, points=truth.points + [1e-3, 0, 0]))
    with pytest.raises(InputError, match="its mesh is not the one that its scene builds"):
        read_flow_truth(file)
    write_trajectory(file, tiny())
    with pytest.raises(InputError, match="no flow"):
        read_flow_truth(file)
    still = channel_flow(steps={"stationary": True})
    write_trajectory(file, flow_trajectory(still, solve_flow(still)))
    with pytest.raises(InputError, match="a stationary flow, so there is no step to predict"):
        read_flow_truth(file)


def test_a_flow_without_a_scene_has_errors_and_no_equations(folder, tmp_path):
    truth = replace(read_trajectory(folder / "truth" / "a.vtkhdf"), scene="")
    write_trajectory(tmp_path / "truth.vtkhdf", truth)
    write_trajectory(tmp_path / "mine.vtkhdf", faster(truth, 0.01))
    found = verify_files(tmp_path / "mine.vtkhdf", tmp_path / "truth.vtkhdf")
    assert found["velocity_rmse_all"] > 0 and np.isnan(found["divergence"])
    assert found["verdict"].endswith("times closer.")
