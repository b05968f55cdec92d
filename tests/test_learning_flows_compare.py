"""Networks of flows: where they begin, what they see, and everything that predicts a flow in one report."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import fidelity
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.flow.figures import predicted_nodes
from datagen.flow.prediction import read_flow_truth
from datagen.flow.trajectory import flow_trajectory
from learning.config import Outputs, TrainConfig
from learning.flows.compare import compare_flows, learned
from learning.flows.report import headline
from learning.networks.m4gn import M4GNConfig
from learning.prediction.checkpoint import load_model
from learning.prediction.rollout import rollout
from learning.report.table import Row
from learning.samples.samples import all_frames, load_examples
from learning.training.train import train
from physics.flow.solution import solve_flow
from physics.schema import InputError
from tests.five_nodes import tiny
from tests.flows import channel_flow

CONFIG = TrainConfig(segments=6, modes="laplacian", mode_count=2, tau=1.0, overlap=1, noise=0.01, batch_size=1, steps=2,
                     outputs=Outputs(fields=("pressure",)), learning_rate=1e-3,
                     network=M4GNConfig(hidden=8, message_steps=2, transformer_layers=1, heads=2, walk=4))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two flows that start at once, as a data set without a manifest, and a network that has seen two batches of the first."""
    folder = tmp_path_factory.mktemp("flows")
    for name, speed in (("train", 0.3), ("test", 0.4)):
        (folder / name).mkdir()
        scene = channel_flow(inflow=[{"speed": speed}], steps={"count": 28, "duration": 0.28})
        write_trajectory(folder / name / "0000.vtkhdf", flow_trajectory(scene, solve_flow(scene)))
    train(CONFIG, [folder / "train" / "0000.vtkhdf"], [folder / "test" / "0000.vtkhdf"], folder / "run")
    return folder


def test_what_is_learned_from_begins_after_the_first_frame_that_moves(folder):
    """Of 29 frames, the fluid at rest in the first, 27 steps from true frames 1 to 27; with frames = 5 as many, to 6, .. and 28."""
    for frames, first, last, count in ((None, 1, 27, 27), (5, 5, 27, 5)):
        examples = load_examples([folder / "train" / "0000.vtkhdf"], replace(CONFIG, frames=frames))
        found = all_frames(examples)[:, 1]
        assert (found.min(), found.max(), len(found)) == (first, last, count)
        assert examples[0].layout.flow and examples[0].layout.widths.outputs == 3


def test_a_rollout_begins_at_the_first_frame_that_moves_and_knows_nothing_of_later_ones(folder):
    truth, model = read_trajectory(folder / "test" / "0000.vtkhdf"), load_model(folder / "run")
    inside = predicted_nodes(truth)
    found = rollout(model, truth)
    np.testing.assert_array_equal(found.fields["velocity"][:2], truth.fields["velocity"][:2])
    np.testing.assert_array_equal(found.fields["velocity"][:, ~inside], truth.fields["velocity"][:, ~inside])
    assert found.extra["step_seconds"] == truth.extra["step_seconds"]
    assert found.fields["pressure"][2:].any()
    velocity = truth.fields["velocity"].copy()
    velocity[2:, inside, :2] = 9.0
    blind = rollout(model, replace(truth, fields={"velocity": velocity, "pressure": 0 * truth.fields["pressure"]}))
    np.testing.assert_array_equal(found.fields["velocity"], blind.fields["velocity"])
    single = learned(model, "M4GN").predict(read_flow_truth(folder / "test" / "0000.vtkhdf"))
    assert single.one_step.shape == (27, len(truth.points), 2) and single.shown == 1
    np.testing.assert_allclose(single.one_step[0], single.velocity[2], atol=1e-6)


def test_a_network_of_flows_refuses_a_solid(folder):
    with pytest.raises(InputError, match="it is no flow"):
        rollout(load_model(folder / "run"), tiny())


def test_everything_that_predicts_a_flow_stands_in_one_report(folder, tmp_path):
    said = []
    found = compare_flows([folder / "test" / "0000.vtkhdf"], [folder / "run"], tmp_path / "report", say=said.append)
    rows = {row["name"]: row["scores"] for row in found["rows"]}
    assert list(rows) == ["M4GN", "M4GN, divergence taken out", "nothing changes", "the last period again", "dynamic mode decomposition",
                          "FE, cells 1.5 times as large", "FE, cells twice as large", "FE, cells three times as large",
                          "FE, velocity of order 2", "FE, the reference"]
    truth = read_flow_truth(folder / "test" / "0000.vtkhdf").reference
    step = np.diff(truth.velocity[1:, truth.predicted], axis=0)
    assert rows["nothing changes"]["velocity_rmse_1"] == pytest.approx(np.sqrt((step**2).mean()))
    late = truth.velocity[15:, truth.predicted] - truth.velocity[1, truth.predicted]
    assert rows["nothing changes"]["velocity_rmse_late"] == pytest.approx(np.sqrt((late**2).mean()))
    assert rows["FE, the reference"]["velocity_rmse_all"] == 0 < rows["FE, the reference"]["momentum_residual"]
    assert rows["the last period again"]["velocity_rmse_all"] is None and rows["the last period again"]["velocity_rmse_late"] > 0
    assert rows["FE, cells 1.5 times as large"]["velocity_rmse_late"] < rows["FE, cells three times as large"]["velocity_rmse_late"]
    assert rows["M4GN, divergence taken out"]["divergence"] < 1e-3 * rows["M4GN"]["divergence"]
    assert rows["M4GN, divergence taken out"]["flux_error"] < 0.2 * rows["M4GN"]["flux_error"]
    assert found["summary"].startswith("M4GN: over 50 steps")
    assert said[1].startswith("M4GN") and len(said) == 12
    assert json.loads((tmp_path / "report" / "report.json").read_text())["rows"] == found["rows"]
    assert Image.open(tmp_path / "report" / "pareto.png").size[0] > 800
    assert Image.open(tmp_path / "report" / "vorticity.gif").n_frames == 29
    page = (tmp_path / "report" / "report.html").read_text()
    assert "momentum residual" in page and "vorticity.gif" in page
    alone = compare_flows([folder / "test" / "0000.vtkhdf"], [], tmp_path / "other", only=["trivial"])
    assert [row["name"] for row in alone["rows"]][-1] == "FE, the reference" and len(alone["rows"]) == 4


def test_the_headline_says_how_many_times_closer_and_when_it_is_not():
    def row(name, kind, some, every):
        return Row(name, kind, {"velocity_rmse_50": some, "velocity_rmse_all": every})

    idle = row("nothing changes", "trivial", 0.2, 0.4)
    assert headline([row("net", "learned", 0.05, 0.5), idle]) == (
        "net: over 50 steps 0.05 m/s, 4 times closer than a flow that does not change; over all steps 0.5 m/s, no better than a flow that "
        "does not change (0.4).")
    assert headline([idle]) == "No learned predictor was held against a flow that does not change."


def test_the_chain_runs_from_the_command_line(folder, tmp_path, capsys):
    truth = str(folder / "test" / "0000.vtkhdf")
    assert fidelity.main(["rollout", str(folder / "run"), truth, "--out", str(tmp_path / "p.vtkhdf"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["steps"] == 27
    assert fidelity.main(["verify", str(tmp_path / "p.vtkhdf"), "--reference", truth, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["velocity_rmse_all"] == pytest.approx(told["velocity_rmse_all"], rel=1e-5)
    assert fidelity.main(["evaluate", str(folder / "run"), "--data", str(folder), "--out", str(tmp_path / "report"), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["rows"][0]["scores"]
    assert shown["velocity_rmse_all"] == pytest.approx(told["velocity_rmse_all"], rel=1e-5)


@pytest.mark.parametrize(("arguments", "line"), [
    (["rollout", "RUN", "TRUTH", "--out", "p.vtkhdf", "--correct", "1"], "TRUTH: a flow, and this is for solids"),
    (["pareto", "DATA", "--predictor", "a:b"], "--predictor a:b: is for solids; of flows give --prediction FOLDER"),
    (["pareto", "DATA", "--only", "learnt"], "--only learnt: must be some of"),
    (["pareto", "DATA", "--run", "assets/m4gn-beam"], "assets/m4gn-beam: has not learned flows"),
    (["rollout", "assets/m4gn-beam", "TRUTH", "--out", "p.vtkhdf"], "a flow, where the network has learned how solids move"),
    (["rollout", "assets/m4gn-fast", "TRUTH", "--out", "p.vtkhdf"], "a flow, where the network has learned how solids move"),
    (["segment", "TRUTH"], "the trajectory carries no modes"),
    (["view", "TRUTH", "--out", "v.html"], "--out v.html: a page is for solids; of a flow there is a picture, .png, and a film, .gif")])
def test_what_a_verb_does_not_do_with_a_flow_it_says_in_a_line(folder, arguments, line, capsys):
    names = {"RUN": str(folder / "run"), "TRUTH": str(folder / "test" / "0000.vtkhdf"), "DATA": str(folder)}
    assert fidelity.main([names.get(word, word) for word in arguments]) == 2
    said = capsys.readouterr().err
    for word, path in names.items():
        line = line.replace(word, path)
    assert line in said and said.count("\n") == 1
