"""What is run once on a borrowed GPU, on the processor: it says what it measured, ends in time, and sees a difference of both places."""

import json
import math
import weakref

import pytest
import torch

from benchmarks import gpu
from benchmarks.rivals import SMALL
from learning.networks.kinds import CONFIGS, build
from learning.prediction.checkpoint import load_model

CPU = torch.device("cpu")


@pytest.fixture
def tiny(monkeypatch):
    for name, value in {"TRAINING_BATCH": 2, "BATCHES": (1, 2), "FRAMES": 3, "LAPS": 1, "VALIDATED": 1, "CHECKPOINTS": 1,
                        "PRECISIONS": ("float32", "bfloat16")}.items():
        monkeypatch.setattr(gpu, name, value)
    monkeypatch.setitem(gpu.SHARES, "data", 0)  # one beam


def test_a_run_writes_what_it_measured_and_a_network_that_predicts(tiny, tmp_path, capsys):
    out = tmp_path / "out"
    assert gpu.main([str(out), "--minutes", "9", "--device", "cpu", "--size", "small", "--only", "m4gn", "gcn", "--steps", "2"]) == 0
    found = json.loads((out / "gpu.json").read_text())
    rows = [(row["network"], row["precision"]) for row in found["kinds"]]
    assert rows == [("M4GN", "float32"), ("GCN", "float32"), ("M4GN", "bfloat16")]
    for row, kind in zip(found["kinds"], ("m4gn", "gcn", "m4gn"), strict=True):
        assert row["weights"] == sum(weight.numel() for weight in build(CONFIGS[kind](**SMALL[kind])).parameters())
        assert row["apart"] == 0 and row["memory [MB]"] is None and row["graph [ms]"] > 0
        assert row["step [ms]"] > row["prediction, 1 [ms a frame]"] > 0 and row["prediction, 2 [ms a frame]"] > 0
    assert found["left_out"] == [] and found["alike"] and found["seconds"]["all"] < 540
    told = found["training"]
    assert told["steps"] == 2 and told["apart"] == 0 and math.isfinite(told["last_error"]) and told["curve"][-1]["step"] == 2
    assert load_model(out / "run").config.network == CONFIGS["m4gn"](**SMALL["m4gn"])
    assert capsys.readouterr().out == (out / "gpu.md").read_text() and len((out / "gpu.md").read_text().splitlines()) == 2 + len(rows)


def test_what_the_time_does_not_reach_is_said(tiny, tmp_path, capsys):
    out = tmp_path / "out"
    assert gpu.main([str(out), "--minutes", "0.0001", "--device", "cpu", "--only", "mgn"]) == 1
    found = json.loads((out / "gpu.json").read_text())
    assert found["left_out"] == ["mgn: no time was left", "training: M4GN was not asked for, or had no time"] and found["kinds"] == []
    assert not found["alike"] and "left out: mgn" in capsys.readouterr().err


def test_a_difference_of_both_places_is_that_of_free_nodes_over_the_step():
    here = torch.tensor([[3.0, 4.0], [0.0, 5.0], [1.0, 1.0]])  # root mean square of the first two: 50^0.5 / 2
    free = torch.tensor([True, True, False])
    there = here + torch.tensor([[0.0, 1e-3], [5e-4, 0.0], [9.0, 9.0]])
    assert gpu.apart(here, there, free) == pytest.approx(1e-3 * 2 / 50**0.5, rel=1e-3)
    assert gpu.apart(here, torch.full_like(here, torch.nan), free) == math.inf


@pytest.mark.parametrize("fits, said", [(8, 4.0), (3, "out of memory; 2 fits"), (0, "out of memory, with a single sample too")])
def test_a_batch_that_memory_does_not_hold_is_told_with_one_that_it_does(fits, said):
    made, still_there = [], []

    def run(size):
        still_there.extend(each() is not None for each in made)
        filling = torch.zeros(size)
        made.append(weakref.ref(filling))
        if size > fits:
            raise torch.OutOfMemoryError("out of memory")
        return 4.0

    assert gpu.held(run, 8, CPU) == said
    assert not any(still_there)


@pytest.mark.parametrize("words, said", [
    (["--data", "README.md"], "not a whole packed data set"), (["--data", "nowhere"], "not a whole packed data set"),
    (["--minutes", "0"], "must both be above 0"), (["--device", "gpu"], "must be auto, cpu, cuda")])
def test_what_cannot_be_run_is_refused_in_one_line(words, said, tmp_path, capsys):
    assert gpu.main([str(tmp_path / "out"), "--device", "cpu", *words]) == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) == 1 and said in error[0]


def test_a_folder_that_is_there_is_left_alone(tmp_path, capsys):
    assert gpu.main([str(tmp_path), "--device", "cpu"]) == 2
    assert "is there already" in capsys.readouterr().err and list(tmp_path.iterdir()) == []
