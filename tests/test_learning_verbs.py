"""What the command line does with networks: which function gets which option, what is said and what is given back."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import read_trajectory, write_trajectory
from learning import verbs
from learning.config import TrainConfig
from tests.synthetic import bending


class Called:
    """Stands in for a function: keeps what it was given, and gives a result."""

    def __init__(self, result):
        self.result, self.given, self.named = result, (), {}

    def __call__(self, *given, **named):
        self.given, self.named = given, named
        return self.result


def spoken(capsys, *arguments) -> list[str]:
    """The lines of a command that ends well."""
    assert fidelity.main([str(argument) for argument in arguments]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out.splitlines()


def told(capsys, *arguments) -> dict:
    """Its JSON."""
    assert fidelity.main([*(str(argument) for argument in arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys, *arguments) -> str:
    """The only line of a command that ends with status 2."""
    try:
        status = fidelity.main([str(argument) for argument in arguments])
    except SystemExit as stop:
        status = stop.code
    out, err = capsys.readouterr()
    assert status == 2 and out == "" and err.count("\n") == 1 and err.startswith("fidelity: ")
    return err


def test_segment_hands_its_options_on(monkeypatch, capsys, tmp_path):
    called = Called({"segments": 3})
    monkeypatch.setattr("learning.segments.file.segment_file", called)
    assert told(capsys, "segment", "t.vtkhdf") == {"segments": 3}
    assert called.given[:3] == ("t.vtkhdf", 19, None)
    assert called.named == {"method": "slic-mdod-e", "tau": 0.5, "modes": "elastic", "mode_count": 1}
    called.given[3]("a line")
    assert capsys.readouterr().err == "a line\n"  # standard output is the JSON's alone
    spoken(
        capsys,
        "segment",
        "t.vtkhdf",
        "--segments",
        "auto",
        "--method",
        "metis",
        "--tau",
        "0.25",
        "--modes",
        "laplacian",
        "--mode-count",
        "4",
        "--picture",
        tmp_path / "p.png",
    )
    assert called.given[1:3] == ("auto", tmp_path / "p.png")
    assert called.named == {"method": "metis", "tau": 0.25, "modes": "laplacian", "mode_count": 4}
    spoken(capsys, "segment", "t.vtkhdf", "--segments", "1")
    assert called.given[1] == 1
    for wrong in ("0", "many", "-1", "1.5"):
        assert "not a whole number above 0" in refused(capsys, "segment", "t.vtkhdf", "--segments", wrong)
    assert "must end in .png" in refused(capsys, "segment", "t.vtkhdf", "--picture", "p.gif")


RESULT = {"steps": 40, "seconds": 61.7, "loss": 0.123456, "best_error": 2.5e-4}


@pytest.fixture
def training(monkeypatch, tmp_path):
    called = Called(dict(RESULT))
    monkeypatch.setattr("learning.training.train.train", called)
    monkeypatch.setattr("learning.config.load_config", lambda path: f"config of {path}")
    monkeypatch.setattr("datagen.sets.dataset.files", lambda folder, split: [f"{folder}/{split}"])
    called.data, called.out = tmp_path / "data", tmp_path / "run"
    (called.data / "valid").mkdir(parents=True)
    return called


def test_train_takes_both_splits_and_says_the_error_in_mm(training, capsys):
    arguments = ("train", "c.toml", "--data", training.data, "--out", training.out)
    assert spoken(capsys, *arguments) == [
        "40 steps in 62 s, loss 0.1235, best validation error 0.250 mm (RMSD of whole rollouts over 1 validation trajectory, free nodes): "
        f"{training.out}"]
    assert training.given == ("config of c.toml", [f"{training.data}/train"], [f"{training.data}/valid"], training.out)
    assert training.named == {"steps": None, "resume": False, "device": "cpu"}
    assert told(capsys, *arguments, "--steps", "7", "--resume", "--device", "auto") == RESULT
    assert training.named == {"steps": 7, "resume": True, "device": "auto"}


def test_the_seconds_of_a_training_go_before_those_of_its_config(training, capsys, monkeypatch):
    monkeypatch.setattr("learning.config.load_config", lambda path: TrainConfig(budget_seconds=9.0, tau=0.25))
    arguments = ("train", "c.toml", "--data", training.data, "--out", training.out)
    spoken(capsys, *arguments, "--seconds", "2.5")
    assert training.given[0] == TrainConfig(budget_seconds=2.5, tau=0.25)
    spoken(capsys, *arguments)
    assert training.given[0] == TrainConfig(budget_seconds=9.0, tau=0.25)
    for wrong in ("0", "-1", "nan", "inf", "soon"):
        assert "not a number of seconds above 0" in refused(capsys, *arguments, "--seconds", wrong)


def test_train_without_validation_says_no_error(training, capsys):
    (training.data / "valid").rmdir()
    training.result["best_error"] = None
    assert spoken(capsys, "train", "c.toml", "--data", training.data, "--out", training.out) == [
        f"40 steps in 62 s, loss 0.1235: {training.out}"
    ]
    assert training.given[2] == []


def test_train_needs_data_and_a_folder(capsys):
    assert "--data" in refused(capsys, "train", "c.toml", "--out", "o") and "--out" in refused(capsys, "train", "c.toml", "--data", "d")


@pytest.fixture
def predicted(monkeypatch, tmp_path):
    """A trajectory file, and a network whose rollout is off by (3, 0, 4) um at every free node from step 1 on, a metre at held ones."""
    truth = bending(steps=5)
    file = tmp_path / "truth.vtkhdf"
    write_trajectory(file, truth)
    moved = truth.displacement.astype(np.float64)
    moved[0, truth.free] += 1.0  # the rest state is given and does not count
    moved[1:, truth.free] += [3e-6, 0, 4e-6]
    moved[:, ~truth.free] += 1.0
    prediction = replace(truth, displacement=moved.astype(np.float32), extra={"seconds_per_step": 0.25})
    monkeypatch.setattr("learning.prediction.checkpoint.load_model",
                        lambda run, device: f"model of {run}" + f" on {device}" * (device != "cpu"))
    return SimpleNamespace(file=file, truth=truth, out=tmp_path / "p.vtkhdf", prediction=prediction, monkeypatch=monkeypatch)


def test_rollout_writes_the_prediction_and_its_error_over_free_nodes_and_all_steps_but_the_first(predicted, capsys):
    called = Called(predicted.prediction)
    predicted.monkeypatch.setattr("learning.prediction.rollout.rollout", called)
    lines = spoken(capsys, "rollout", "run", predicted.file, "--out", predicted.out)
    assert lines == [f"5 steps, RMSD over all of them 0.005 mm: {predicted.out}"]
    called.result = replace(predicted.prediction, extra={"unsure_frames": 4})
    lines = spoken(capsys, "rollout", "run", predicted.file, "--out", predicted.out)
    assert lines == [f"5 steps, RMSD over all of them 0.005 mm; the predictor is unsure of 4: {predicted.out}"]
    called.result = predicted.prediction
    assert called.given[0] == "model of run" and np.array_equal(called.given[1].displacement, predicted.truth.displacement)
    assert np.array_equal(read_trajectory(predicted.out).displacement, predicted.prediction.displacement)
    result = told(capsys, "rollout", "run", predicted.file, "--out", predicted.out)
    # 5 um; displacements of up to 20 mm are stored in 24 bits, to about 1e-9 m
    assert result == {"steps": 5, "rmsd_all": pytest.approx(5e-6, rel=1e-3), "seconds_per_step": 0.25}


def test_a_corrected_rollout_is_held_against_the_scene(predicted, capsys):
    called = Called((predicted.prediction, "corrector"))
    predicted.monkeypatch.setattr("learning.prediction.surrogates.corrected_rollout", called)
    predicted.monkeypatch.setattr("datagen.files.prediction.read_truth", lambda path: (predicted.truth, "scene", "mesh"))
    result = told(capsys, "rollout", "run", predicted.file, "--out", predicted.out, "--correct", "3")
    assert called.given == ("model of run", predicted.truth, "scene", "mesh", 3) and result["steps"] == 5
    assert read_trajectory(predicted.out).displacement.shape == predicted.truth.displacement.shape


def test_a_rollout_does_not_overwrite_its_trajectory_by_any_name(predicted, capsys):
    before = predicted.file.read_bytes()
    roundabout = predicted.file.parent / "x" / ".." / predicted.file.name
    (predicted.file.parent / "x").mkdir()
    for out in (predicted.file, roundabout):
        assert "is the trajectory itself, which the prediction would overwrite" in refused(
            capsys, "rollout", "run", predicted.file, "--out", out
        )
    assert predicted.file.read_bytes() == before
    predicted.monkeypatch.setattr("learning.prediction.rollout.rollout", Called(predicted.prediction))
    for name in ("a.vtkhdf", "z.vtkhdf"):
        spoken(capsys, "rollout", "run", predicted.file, "--out", predicted.file.with_name(name))
    assert "--out" in refused(capsys, "rollout", "run", predicted.file)
    assert "must end in .vtkhdf" in refused(capsys, "rollout", "run", predicted.file, "--out", "p.vtu")
    assert "not a whole number above 0" in refused(capsys, "rollout", "run", predicted.file, "--out", "p.vtkhdf", "--correct", "0")


def test_evaluate_hands_its_options_on(monkeypatch, capsys, tmp_path):
    called = Called({"summary": "words"})
    monkeypatch.setattr("learning.report.evaluate.evaluate", called)
    monkeypatch.setattr("datagen.sets.dataset.files", lambda folder, split: [folder, split])
    run = tmp_path / "run"
    run.mkdir()
    assert told(capsys, "evaluate", run, "--data", "d") == {"summary": "words"}
    assert called.given == (str(run), ["d", "test"], run / "report")
    assert {key: called.named[key] for key in ("correct", "refined")} == {"correct": 1, "refined": 1}
    called.named["say"]("a line")
    assert capsys.readouterr().err == "a line\n"
    spoken(capsys, "evaluate", run, "--data", "d", "--split", "valid", "--correct", "4", "--refined", "0", "--out", tmp_path / "r")
    assert called.given == (str(run), ["d", "valid"], tmp_path / "r")
    assert {key: called.named[key] for key in ("correct", "refined")} == {"correct": 4, "refined": 0}
    assert "--data" in refused(capsys, "evaluate", run)


def test_pareto_hands_its_options_on(monkeypatch, capsys, tmp_path):
    called = Called({"summary": "words"})
    monkeypatch.setattr("learning.report.compare.compare", called)
    monkeypatch.chdir(tmp_path)
    assert told(capsys, "pareto", "press.toml") == {"summary": "words"}
    assert called.given == ("press.toml", [], Path("pareto"))
    del called.named["say"]
    assert called.named == {"count": 5, "split": "test", "refined": None, "repeats": 3, "predictions": [], "functions": [], "device": "cpu",
                            "only": []}
    spoken(
        capsys,
        "pareto",
        "data",
        "--run",
        "a",
        "b",
        "--run",
        "c",
        "--count",
        "9",
        "--split",
        "train",
        "--refined",
        "0",
        "--repeats",
        "1",
        "--out",
        "x",
    )
    assert called.given == ("data", ["a", "b", "c"], Path("x"))
    called.named["say"]("a line")
    assert capsys.readouterr().out == "a line\n"
    del called.named["say"]
    assert called.named == {"count": 9, "split": "train", "refined": 0, "repeats": 1, "predictions": [], "functions": [], "device": "cpu",
                            "only": []}
    spoken(capsys, "pareto", "press.toml", "--prediction", "f", "--predictor", "m:f", "mine", "--prediction", "g", "n", "2",
           "--only", "trivial, fe")
    assert called.named["predictions"] == [["f"], ["g", "n", "2"]] and called.named["functions"] == [["m:f", "mine"]]
    assert called.named["only"] == ["trivial", "fe"]
    spoken(capsys, "pareto", "press.toml")
    assert called.named["predictions"] == called.named["functions"] == called.named["only"] == []
    assert called.given[1] == []  # what one call was given is no default of the next


@pytest.fixture
def swept(monkeypatch, tmp_path):
    """Four paths: a frame of two is unsure, one of them solved, one not; the largest displacement 2.5 mm. Two more have other states,
    of which nothing is known."""
    rows = SimpleNamespace(state=np.array([0, 1, -1, 0, 2, -2]), unsure=np.array([[0, 0], [1, 0], [0, 1], [0, 0], [0, 0], [0, 0]], bool),
                           largest=np.array([[0, 1e-3], [2e-3, 2.5e-3], [0, 1e-4], [0, 0], [0, 0], [0, 0]]))
    called = Called(SimpleNamespace(rows=rows, varied={"obstacle.radius": 0}, frames=np.array([3, 20]), nodes=np.arange(7)))
    monkeypatch.setattr("learning.prediction.sweep.sweep", lambda *given, journal, **named: journal.touch() or called(
        *given, journal=journal, **named))
    monkeypatch.setattr("learning.prediction.sweep.write_sweep", lambda path, found: path.write_text("written"))
    called.out = tmp_path / "s.h5"
    return called


def test_sweep_hands_its_options_on_and_counts_what_it_found(swept, capsys):
    arguments = ("sweep", "press.toml", "--predictor", "run", "--out", swept.out)
    result = told(capsys, *arguments)
    assert result.pop("seconds") >= 0
    assert result == {"paths": 6, "varied": ["obstacle.radius"], "frames": [3, 20], "nodes": 7, "unsure": 2, "solved": 1, "unsolved": 1,
                      "largest": 2.5e-3}
    assert swept.given == ("press.toml", "run") and swept.named.pop("say") and swept.out.read_text() == "written"
    part = swept.out.with_name("s.h5.part")
    assert swept.named == {"vary": [], "changes": [], "count": None, "seed": 0, "frames": None, "nodes": None, "solve_unsure": False,
                           "journal": part} and not part.exists()
    line, = spoken(capsys, *arguments, "--vary", "a=1:2", "b=3:4", "--vary", "c=5,6", "--set", "d=7", "--count", "9", "--seed", "2",
                   "--frames", "0, 20", "--nodes", "x-max", "--unsure", "solve")
    assert line.startswith("6 paths in ") and line.endswith(
        f" s, largest displacement 2.5 mm; the predictor is unsure of 2, 1 solved by finite elements, 1 without an equilibrium that "
        f"they found: {swept.out}")
    del swept.named["say"]
    assert swept.named == {"vary": ["a=1:2", "b=3:4", "c=5,6"], "changes": ["d=7"], "count": 9, "seed": 2, "frames": [0, 20],
                           "nodes": "x-max", "solve_unsure": True, "journal": part}
    swept.result.rows.state[2] = 0
    assert "without an equilibrium" not in spoken(capsys, *arguments, "--nodes", "7,3")[0] and swept.named["nodes"] == [7, 3]
    spoken(capsys, *arguments, "--nodes", "")
    assert swept.named["nodes"] == ""  # no number, so a place, which there is not
    for wrong in ("7,a", "7,", "1234567890", "7,-1"):
        assert f"--nodes {wrong}: must be whole numbers with commas between" in refused(capsys, *arguments, "--nodes", wrong)
    spoken(capsys, *arguments, "--nodes", "123456789")
    for given, lacks in ((("--predictor", "run"), "--out"), (("--out", swept.out), "--predictor")):
        assert lacks in refused(capsys, "sweep", "press.toml", *given)
    for wrong in (("--unsure", "ask"), ("--count", "0"), ("--seed", "-1"), ("--out", "s.csv")):
        refused(capsys, *arguments, *wrong)


def test_every_verb_says_what_it_does():
    for verb in (verbs.segment, verbs.train, verbs.rollout, verbs.sweep, verbs.evaluate, verbs.pareto):
        assert verb.__doc__.strip().count("\n") == 0 and verb.__doc__.endswith(".")
