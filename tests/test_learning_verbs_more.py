"""The command line's share of flows, of studies and of error bars: every option handed on, and what is said, on made-up results."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.files.trajectory import write_trajectory
from tests.test_learning_layout import channel
from tests.test_learning_verbs import RESULT, Called, refused, spoken, told


@pytest.fixture
def flows(tmp_path):
    """Seven files of a flow in a split, and its trajectory."""
    truth = channel(frames=5)
    truth.fields["velocity"][0, [1, 2, 4]] = 0  # at rest but at the inflow
    for split in ("test", "train", "valid"):
        (tmp_path / "data" / split).mkdir(parents=True)
    for number in range(7):
        write_trajectory(tmp_path / "data" / "test" / f"{number:04d}.vtkhdf", truth)
    return truth


def named(files):
    return [path.name for path in files]


def test_a_rollout_of_a_flow_is_held_against_its_velocity_from_the_first_frame_that_moves_on(flows, tmp_path, monkeypatch, capsys):
    """Off by (3, 4) m/s at the three nodes that are predicted, by more in the first two frames, which are given, and at others."""
    velocity = flows.fields["velocity"].copy()
    velocity[2:, [1, 2, 4]] += np.float32([3, 4, 0])
    velocity[:2, [1, 2, 4]] += 50
    velocity[:, [0, 3]] += 50
    prediction = replace(flows, fields={"velocity": velocity}, extra={"seconds_per_step": 0.5})
    monkeypatch.setattr("learning.prediction.checkpoint.load_model", lambda run, device: "model")
    monkeypatch.setattr("learning.prediction.rollout.rollout", Called(prediction))
    file, out = tmp_path / "data" / "test" / "0000.vtkhdf", tmp_path / "p.vtkhdf"
    result = told(capsys, "rollout", "run", file, "--out", out)
    # a root of the mean over components: (9 + 16) / 2
    assert result == {"steps": 3, "velocity_rmse_all": pytest.approx(12.5**0.5, rel=1e-6), "seconds_per_step": 0.5}
    assert spoken(capsys, "rollout", "run", file, "--out", out) == [
        f"3 steps, RMSE of the velocity over all of them 3.536 m/s: {out}"]


def test_flows_go_to_a_report_of_their_own(flows, tmp_path, monkeypatch, capsys):
    called = Called({"summary": "words"})
    monkeypatch.setattr("learning.flows.compare.compare_flows", called)
    data, run = tmp_path / "data", tmp_path / "run"
    assert told(capsys, "evaluate", run, "--data", data) == {"summary": "words"}
    assert len(called.given[0]) == 7 and called.given[1:] == ([str(run)], run / "report")
    del called.named["say"]
    assert called.named == {"repeats": 1, "predictions": [], "only": [], "device": "cpu"}
    spoken(capsys, "pareto", data, "--run", "a", "b", "--out", tmp_path / "o", "--prediction", "f", "--only", "learned,, trivial ",
           "--device", "cpu")
    assert named(called.given[0]) == [f"{i:04d}.vtkhdf" for i in (0, 2, 3, 4, 6)]  # five of seven
    assert called.given[1:] == (["a", "b"], tmp_path / "o")
    called.named.pop("say")("a line")
    assert capsys.readouterr().out == "a line\n"
    assert called.named == {"repeats": 3, "predictions": [["f"]], "only": ["learned", "trivial"], "device": "cpu"}
    assert "--predictor m:f mine: is for solids; of flows give --prediction FOLDER" in refused(
        capsys, "pareto", data, "--predictor", "m:f", "mine")
    assert "is for solids" in refused(capsys, "evaluate", run, "--data", data, "--predictor", "m:f")


def test_the_error_of_a_training_on_flows_is_a_velocity(flows, tmp_path, monkeypatch, capsys):
    files = sorted((tmp_path / "data" / "test").iterdir())
    monkeypatch.setattr("learning.training.kinds.train", Called(dict(RESULT)))
    monkeypatch.setattr("learning.config.load_config", lambda path: "config")
    monkeypatch.setattr("datagen.sets.dataset.files", lambda folder, split: files[:2])
    arguments = ("train", "c.toml", "--data", tmp_path / "data", "--out", tmp_path / "run")
    assert spoken(capsys, *arguments) == [
        "40 steps in 62 s, loss 0.1235, best validation error 0.00025 m/s (RMSD of whole rollouts over 2 validation trajectories, "
        f"free nodes): {tmp_path / 'run'}"]
    files[0] = tmp_path / "none.vtkhdf"  # what cannot be read is left to whoever needs it
    assert "0.250 mm" in spoken(capsys, *arguments)[0]


def test_study_hands_its_options_on(tmp_path, monkeypatch, capsys):
    called = Called({"summary": "words"})
    monkeypatch.setattr("learning.study.run.run_study", called)
    assert told(capsys, "study", "seeds", "--out", tmp_path / "s") == {"summary": "words"}
    assert called.given == ("seeds", tmp_path / "s") and callable(called.named.pop("say"))
    assert called.named == {"size": "small", "data": None, "workers": None, "cluster": "", "tls": (), "device": "cpu"}
    spoken(capsys, "study", "seeds", "--out", tmp_path / "s", "--size", "paper", "--data", "d", "--workers", "1", "--cluster", "tcp://h:1",
           "--tls", "ca", "cert", "key", "--device", "auto")
    del called.named["say"]
    assert called.named == {"size": "paper", "data": "d", "workers": 1, "cluster": "tcp://h:1", "tls": ["ca", "cert", "key"],
                            "device": "auto"}
    assert "--out" in refused(capsys, "study", "seeds")
    for wrong in (("--workers", "0"), ("--size", "large"), ("--tls", "ca", "cert")):
        refused(capsys, "study", "seeds", "--out", tmp_path / "s", *wrong)


def test_calibrate_says_what_was_and_what_is(tmp_path, monkeypatch, capsys):
    called = Called({"factor": 2.3456, "before": 1.5, "coverage": 0.9, "trajectories": 12, "error": 1e-4})
    monkeypatch.setattr("learning.training.calibrate.calibrate", called)
    monkeypatch.setattr("datagen.sets.dataset.files", lambda folder, split: [folder, split])
    run = tmp_path / "run"
    run.mkdir()
    assert spoken(capsys, "calibrate", run, "--data", "d") == [
        f"an error bar is 2.35 times the expected error (before: 1.5): within it lie 90 % of the frames of 12 trajectories: {run}"]
    assert called.given == (str(run), ["d", "valid"])
    assert told(capsys, "calibrate", run, "--data", "d", "--split", "test")["trajectories"] == 12
    assert called.given == (str(run), ["d", "test"]) and "--data" in refused(capsys, "calibrate", run)


def test_where_networks_run_is_handed_on_to_every_report(tmp_path, monkeypatch, capsys):
    for verb, where in (("evaluate", "learning.report.evaluate.evaluate"), ("pareto", "learning.report.compare.compare")):
        called = Called({"summary": "words"})
        monkeypatch.setattr(where, called)
        monkeypatch.setattr("datagen.sets.dataset.files", lambda folder, split: [Path("none")])
        spoken(capsys, verb, tmp_path / "run", *(("--data", "d") if verb == "evaluate" else ()), "--device", "cuda:1",
               "--predictor", "m:f", "--prediction", "g", "--out", tmp_path / "o")
        assert (called.named["device"], called.named["functions"], called.named["predictions"]) == ("cuda:1", [["m:f"]], [["g"]])


def test_where_a_set_has_no_test_split_what_it_has_is_taken_and_that_is_said(flows, tmp_path, monkeypatch, capsys):
    called = Called({"summary": "words"})
    monkeypatch.setattr("learning.flows.compare.compare_flows", called)
    data, run = tmp_path / "data", tmp_path / "run"
    (data / "test").rename(data / "train")
    for words in (("pareto", data, "--count", "7", "--out", tmp_path / "o"), ("evaluate", run, "--data", data)):
        assert spoken(capsys, *words)[0] == f"{data} has no test split: these are of train, and a network may have learned from them"
        assert {path.parent.name for path in called.given[0]} == {"train"} and len(called.given[0]) == 7
    assert "test: no trajectory files" in refused(capsys, "pareto", data, "--split", "test")
    shutil.copytree(data / "train", data / "valid", dirs_exist_ok=True)
    assert "of valid" in spoken(capsys, "evaluate", run, "--data", data)[0]
    shutil.copytree(data / "train", data / "test")
    assert "no test split" not in " ".join(spoken(capsys, "evaluate", run, "--data", data))
    assert called.given[0][0].parent.name == "test"
