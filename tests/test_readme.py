"""What README.md and docs/ show is run as it stands there: the scene, the commands on it, the Python.

`./run demo` is run by test_learning_demo.py, films and the verbs on folders of data by test_cli.py; test_docs.py parses their commands.
"""

import io
import json
import shlex
import sys
from contextlib import redirect_stdout

import h5py
import pytest

import fidelity
from datagen import read_trajectory
from tests.pages import ROOT, blocks, commands

README = ROOT / "README.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """press.toml as it stands in README.md, its solution by the command below it, and a trained run."""
    folder = tmp_path_factory.mktemp("readme")
    scene, = blocks(README, "toml")
    (folder / "press.toml").write_text(scene)
    (folder / "run").symlink_to(ROOT / "assets" / "m4gn-beam")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run(command_of("simulate"))
    return folder


def command_of(verb: str) -> list[str]:
    """The words after `./run fidelity` of the first command of README.md with a verb."""
    return next(words[2:] for words in map(shlex.split, commands(README)) if words[:3] == ["./run", "fidelity", verb])


def run(words: list[str]) -> None:
    assert fidelity.main(words) == 0, words


def python(text: str) -> str:
    """What a block of Python prints."""
    with redirect_stdout(io.StringIO()) as printed:
        exec(compile(text, "README", "exec"), {"__name__": "__main__"})
    return printed.getvalue()


def test_the_scene_is_solved_to_its_last_step(folder):
    trajectory = read_trajectory(folder / "press.vtkhdf")
    assert trajectory.complete and len(trajectory.displacement) == 61
    assert 0.015 < abs(trajectory.displacement[-1, trajectory.body, 2]).max() < 0.04  # the cylinder goes 19.5 mm down onto the beam


def test_a_scene_and_python_take_ten_lines(folder):
    scene, python = blocks(README, "toml")[0], blocks(README, "python")[0]
    assert all(8 <= sum(1 for line in text.splitlines() if line.strip()) <= 10 for text in (scene, python))


@pytest.mark.parametrize("verb", ("modes", "segment", "verify"))
def test_the_verbs_of_the_readme_run_on_its_scene(folder, monkeypatch, verb):
    monkeypatch.chdir(folder)
    if verb == "verify":
        run(command_of("rollout"))
    run(command_of(verb))
    if "--out" in command_of(verb):
        assert (folder / command_of(verb)[-1]).stat().st_size > 1000


def test_the_predictor_of_the_readme_is_sure_of_the_paths_of_its_sweep(folder, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "assets").symlink_to(ROOT / "assets")
    run(command_of("sweep"))
    with h5py.File(folder / "s.h5") as file:
        assert file["unsure"].shape == (10_000, 1) and file["unsure"][:].mean() < 0.01


def test_the_python_of_the_readme_says_how_far_off_a_prediction_is(folder, monkeypatch):
    monkeypatch.chdir(folder)
    error, residual, penetration = map(float, python(blocks(README, "python")[0]).split())
    assert 1e-5 < error < 1e-3 and residual > 1e-3  # [m] a hundredth of the motion
    assert 0 < penetration < 1e-3


def test_a_predictor_of_ones_own_is_verified_and_becomes_a_row_of_the_report(folder, monkeypatch):
    page = ROOT / "docs" / "report.md"
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", list(sys.path))
    model, files = blocks(page, "python")
    (folder / "mymodule.py").write_text(model)
    python(files)
    called = [words[2:] for words in map(shlex.split, commands(page)) if words[1:2] == ["fidelity"]]
    run(next(words for words in called if words[0] == "verify"))
    assert (folder / "report" / "worst.png").stat().st_size > 1000
    errors = []
    for words in (words for words in called if words[0] == "pareto"):
        run([*words, "--only", "trivial", "--refined", "0", "--repeats", "1"])
        errors.append({row["name"]: row["scores"] for row in json.loads((folder / "pareto" / "report.json").read_text())["rows"]})
    assert [next(iter(rows)) for rows in errors] == ["my model"] * 2 and errors[1]["my model"]["ms_per_step"] == pytest.approx(2.5)
    assert errors[1]["my model"]["rmsd_all"] == pytest.approx(0.01 * errors[1]["nothing moves"]["rmsd_all"], rel=1e-4)
    assert errors[0]["my model"]["rmsd_all"] < errors[0]["nothing moves"]["rmsd_all"]


def test_the_python_of_the_page_on_python_runs(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert "[" in python(blocks(ROOT / "docs" / "python.md", "python")[0])
