"""The demonstration, whole on a family of three small beams, and what it says of each of its steps, word by word."""

import re
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from datagen.family.family import load_family
from datagen.files.trajectory import read_trajectory
from datagen.sets.dataset import read_manifest
from learning import demo
from learning.config import SlenderConfig, TrainConfig, load_config
from physics.schema import read_table
from tests.chromium import MISSING, PROGRAM, Chromium

FAMILY = """
name = "small"
[body]
length = { uniform = [0.09, 0.1] }
width = 0.02
height = 0.025
cells = [8, 2, 2]
[material]
young_modulus = 1e6
poisson_ratio = 0.4
[[support]]
where = "x-min"
[obstacle]
shape = "cylinder"
radius = 0.01
place = { along = 0.8, gap = 0.001, depth = { uniform = [0.01, 0.012] } }
[steps]
count = 6
[splits]
train = 1
valid = 1
test = 1
"""
SMALL = {"segments": 4, "method": "slic-mdod-e", "contact_radius": 0.012, "noise": 1e-4, "batch_size": 2, "steps": 5000,
         "learning_rate": 3e-3, "final_learning_rate": 1e-4, "validate_every": 100,
         "network": {"hidden": 16, "message_steps": 2, "transformer_layers": 1, "heads": 2}}
FAST = {"frames": 4, "poses": 6, "batch_size": 4, "steps": 30, "network": {"pose_hidden": 8, "hidden": 8}}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The demonstration on the small family: its lines, its result and its folder."""
    folder = tmp_path_factory.mktemp("demo")
    (folder / "small.toml").write_text(FAMILY)
    with pytest.MonkeyPatch.context() as patch:
        asked = []
        patch.setattr(demo, "load_family", lambda name: asked.append(name) or load_family(folder / "small.toml"))
        patch.setattr(demo, "load_config", lambda path: asked.append(path) or (
            read_table(SlenderConfig, FAST) if path == demo.FAST else read_table(TrainConfig, SMALL)))
        lines: list[str] = []
        result = demo.run(folder / "out", say=lines.append, training_steps=40)
    return SimpleNamespace(folder=folder / "out", asked=asked, text="\n".join(lines), result=result)


def test_it_takes_the_family_and_the_config_of_the_package(small):
    assert small.asked == ["demo", demo.CONFIG, demo.FAST] and demo.CONFIG.is_file() and demo.FAST.is_file()
    assert (demo.CONFIG.name, demo.FAST.name) == ("m4gn-small.toml", "sections-small.toml")


def test_modes_are_beside_those_of_beam_theory(small):
    modes = [
        [float(value) for value in line] for line in re.findall(r"mode \d +([\d.]+) Hz +Euler-Bernoulli bending +([\d.]+) Hz", small.text)
    ]
    assert len(modes) == 4
    # a rubber beam of 20 x 25 mm, bent in the plane where it is thinner first; linear prisms are too stiff by their coarse cells
    assert modes[0][1] / modes[1][1] == pytest.approx(20 / 25, abs=1e-3)
    for found, theory in modes[:2]:
        assert 1 < found / theory < 1.6
    assert small.text.index("mode 1") < small.text.index("mode 4") < small.text.index("\n2  Beams")


def test_the_data_are_told_by_their_numbers(small):
    manifest = read_manifest(small.folder / "data")
    count, nodes, ms = re.search(r"(\d+) trajectories of (\d+) nodes on average, ([\d.]+) ms a step", small.text).groups()
    files = [read_trajectory(small.folder / "data" / entry.file) for entry in manifest.trajectories]
    assert (count, int(nodes)) == ("3", round(np.mean([len(file.points) for file in files])))
    assert float(ms) == pytest.approx(1e3 * sum(entry.seconds for entry in manifest.trajectories) / 18, abs=0.051)  # of 3 x 6 steps
    assert [entry.split for entry in manifest.trajectories] == ["train", "valid", "test"]


def test_segments_are_compared_with_those_of_metis(small):
    lines = [line for line in small.text.splitlines() if "conductance" in line]
    assert [line.split()[0] for line in lines] == ["metis", "slic-mdod-e"] and all("edge cut ratio" in line for line in lines)
    assert lines[0].split()[1:] != lines[1].split()[1:]


def test_the_training_is_as_long_as_asked_for_and_its_error_is_in_mm(small):
    assert "trained for 40 steps on 1 trajectories" in small.text and " weights, 40 steps in " in small.text
    assert 0.01 < float(re.search(r"validation error ([\d.]+) mm", small.text)[1]) < 10  # the beams move by 10 mm
    assert (small.folder / "run" / "last.safetensors").is_file()
    assert "leaves over, trained for 30 steps" in small.text and " weights, 30 steps in " in small.text  # of 40 at most
    assert (small.folder / "fast" / "last.safetensors").is_file()


def test_the_report_is_of_the_test_beams_and_holds_every_rival(small):
    assert small.result["cases"] == ["0000"] and small.result["report"] == str(small.folder / "report")
    rows = {row["name"]: row["scores"]["rmsd_all"] for row in small.result["rows"]}
    assert 0 < rows["FE, cells twice as large"] < rows["FE, cells four times as large"] < rows["nothing moves"]
    assert rows["M4GN, corrected 10-fold"] < rows["M4GN"]
    assert 0 < rows["beam sections"] < rows["nothing moves"]  # theory alone knows most of it
    assert f"All of it took {small.result['seconds']:.0f} s. Open {small.folder / 'report' / 'report.html'}" in small.text
    for name in ("report.md", "report.html", "report.json", "table.csv", "pareto.png", "frame_0000.png"):
        assert (small.folder / "report" / name).stat().st_size > 100
    assert "   M4GN  " in small.text  # what evaluate says is set in


def parts(monkeypatch, tmp_path, best: float | None) -> tuple[list[str], dict]:
    """The demonstration with everything heavy replaced by known numbers."""
    said: list[str] = []
    scene = object()
    calls: dict = {}
    entries = [SimpleNamespace(nodes=nodes, seconds=seconds, steps=steps) for nodes, seconds, steps in ((90, 1.0, 10), (101, 3.0, 30))]
    clock = iter([100.0, 142.4])
    replaced = {
        "load_family": lambda name: name,
        "draw": lambda family, seed, index: calls.update(draw=(family, seed, index)) or scene,
        "elastic_modes": lambda of, count: (
            calls.update(modes=(of, count)) or SimpleNamespace(frequencies_hz=[12.5, 20.0], residuals=[2e-9, 4e-10])
        ),
        "euler_bernoulli_hz": lambda of, count: calls.update(theory=(of, count)) or [12.0, 21.25],
        "counts": lambda family: {"train": 2},
        "generate": lambda *given: calls.update(generate=given),
        "read_manifest": lambda data: SimpleNamespace(trajectories=entries),
        "files": lambda data, split: [f"{split}/{i}" for i in range({"train": 3, "valid": 2, "test": 1}[split])],
        "read_trajectory": lambda path: f"trajectory {path}",
        "segments_of": lambda trajectory, config: (trajectory, config.method),
        "segment_quality": lambda trajectory, label: (
            {"conductance": 0.12345, "edge_cut_ratio": 0.5} if label[1] == "metis" else {"silhouette": 1.0}
        ),
        "train": lambda *given, **how: (
            calls.update(train=given, how=how) or {"best_error": best, "parameters": 99, "steps": 7, "seconds": 4.5}
        ),
        "train_sections": lambda *given, **how: (
            calls.update(fast=given, fast_how=how) or {"best_error": 2.5e-5, "parameters": 88, "steps": 6, "seconds": 3.5}
        ),
        "evaluate": lambda *given, beside, say: say("a line") or calls.update(evaluate=(*given, beside)) or {"summary": "words"},
    }
    for name, value in replaced.items():
        monkeypatch.setattr(demo, name, value)
    monkeypatch.setattr(demo.time, "perf_counter", lambda: next(clock))
    calls["result"] = demo.run(tmp_path, say=said.append)
    assert calls["draw"] == ("demo", 0, 0) and calls["modes"] == calls["theory"] == (scene, 4)
    return said, calls


def test_every_line_of_it_on_known_numbers(monkeypatch, tmp_path):
    said, calls = parts(monkeypatch, tmp_path, 1.2345e-3)
    # 4 s for 40 steps are 100 ms a step; (90 + 101) / 2 nodes are 95.5; 142.4 - 100 s
    assert said == [
        "\n1  Elastic modes of the first beam, clamped at one end",
        "   mode 1    12.500 Hz   Euler-Bernoulli bending   12.000 Hz   residual 2e-09",
        "   mode 2    20.000 Hz   Euler-Bernoulli bending   21.250 Hz   residual 4e-10",
        "   (theory knows neither torsion nor shear: from the third on the two part)",
        "\n2  Beams pressed by a rigid cylinder, solved by finite elements",
        f"   2 trajectories of {np.float64(95.5):.0f} nodes on average, 100.0 ms a step: {tmp_path / 'data'}",
        "\n3  Segments: METIS, then refined by the first elastic mode and the distance to the obstacle (slic-mdod-e)",
        "   metis        conductance 0.123, edge cut ratio 0.500",
        "   slic-mdod-e  silhouette 1.000",
        "\n4  M4GN, trained for 3600 steps on 3 trajectories",
        f"   99 weights, 7 steps in 4 s, validation error 1.234 mm: {tmp_path / 'run'}",
        "\n5  Beam theory, and a network for what it leaves over, trained for 1000 steps on the same trajectories",
        f"   88 weights, 6 steps in 4 s, validation error 0.025 mm: {tmp_path / 'fast'}",
        "\n6  Rollouts of the test beams, held against finite elements",
        "   a line",
        f"\nAll of it took 42 s. Open {tmp_path / 'report' / 'report.html'}"]
    assert calls["result"] == {"summary": "words", "seconds": pytest.approx(42.4)}
    assert calls["generate"] == ("demo", {"train": 2}, tmp_path / "data")
    assert calls["train"] == (load_config(demo.CONFIG), ["train/0", "train/1", "train/2"], ["valid/0", "valid/1"], tmp_path / "run")
    assert calls["fast"] == (load_config(demo.FAST), ["train/0", "train/1", "train/2"], ["valid/0", "valid/1"], tmp_path / "fast")
    assert calls["fast_how"] == {"steps": None, "resume": False}
    assert calls["evaluate"] == (tmp_path / "run", ["test/0"], tmp_path / "report", [tmp_path / "fast"])


@pytest.mark.parametrize("kept", [False, True])
def test_a_training_goes_on_only_where_there_is_a_checkpoint(monkeypatch, tmp_path, kept):
    if kept:
        for run in ("run", "fast"):
            (tmp_path / run).mkdir()
            (tmp_path / run / "last.safetensors").touch()
    said, calls = parts(monkeypatch, tmp_path, None)
    assert calls["how"] == {"resume": kept} and calls["fast_how"] == {"steps": None, "resume": kept}
    assert f"validation error none, every rollout blew up: {tmp_path / 'run'}" in said[10]


@pytest.mark.skipif(PROGRAM is None, reason=MISSING)
def test_the_report_is_turned_and_followed_by_hand_in_a_browser(small):
    """Drag, scrub and read pixels back: both bodies turn, and the network's errors are coloured where the truth has none."""
    browser = Chromium()
    try:
        browser.open(small.folder / "report" / "report.html")
        assert not [message for message in browser.said if message["method"] == "Runtime.exceptionThrown"]
        names = browser.run("[...document.querySelectorAll('.left option')].map(option => option.text)")
        assert {"M4GN", "M4GN, corrected 10-fold", "nothing moves", "FE, cells twice as large", "FE, the reference"} <= set(names)
        assert browser.run("document.querySelectorAll('.exhibit option').length") == 2  # the trajectory, and its worst frame
        left, top, width, height = browser.box("canvas")
        pictures = [browser.pixels("canvas")]
        browser.drag((left + width / 4, top + height / 2), (left + width / 4 + 90, top + height / 2 + 50))
        pictures.append(browser.pixels("canvas"))
        browser.run("document.querySelector('.track input').focus()")
        browser.press("Home")
        pictures.append(browser.pixels("canvas"))
        for before, after in pairwise(pictures):
            for half in (slice(None, before.shape[1] // 2), slice(before.shape[1] // 2, None)):
                assert (before[:, half] != after[:, half]).any(axis=2).mean() > 0.01
        said = browser.run("document.querySelector('.said').textContent")
        assert said == "step 0 of 6: largest error 0 mm (M4GN), 0 mm (FE, the reference)"
    finally:
        browser.close()


@pytest.mark.slow
def test_some_hundred_steps_on_the_familys_own_beams_already_beat_that_nothing_moves(tmp_path):
    said: list[str] = []
    result = demo.run(tmp_path / "demo", say=said.append, training_steps=800)
    assert "12 trajectories" in "\n".join(said)
    rows = {row["name"]: row["scores"]["rmsd_all"] for row in result["rows"]}
    assert rows["M4GN"] < rows["nothing moves"] and rows["beam sections"] < 0.05 * rows["nothing moves"]
    assert 0 < rows["FE, cells twice as large"] < rows["FE, cells four times as large"]
