"""Where networks run: what is asked for is there or refused, everything goes along, and both places say the same."""

import weakref
from dataclasses import fields, is_dataclass, replace

import pytest
import torch

import learning.training.train as module
from datagen.files.trajectory import write_trajectory
from learning.devices import device_of
from learning.graphs.graph import join
from learning.prediction.checkpoint import Model, load_model, read_checkpoint
from learning.prediction.rollout import rollout
from learning.samples.samples import build_example, fit_normaliser
from learning.training.train import train
from physics.schema import InputError
from tests.networks import SMALL, graph, made, training
from tests.synthetic import bending

gpu = [pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no GPU here")]


@pytest.fixture
def file(tmp_path):
    write_trajectory(tmp_path / "a.vtkhdf", bending(steps=4))
    return tmp_path / "a.vtkhdf"


def tensors(value):
    """All tensors in a graph."""
    if isinstance(value, torch.Tensor):
        return [value]
    parts = value if isinstance(value, tuple) else [getattr(value, each.name) for each in fields(value)] if is_dataclass(value) else []
    return [tensor for part in parts for tensor in tensors(part)]


@pytest.mark.parametrize("count, words, expected", [
    (0, "auto", "cpu"), (0, "cpu", "cpu"), (2, "auto", "cuda:0"), (2, "cuda", "cuda:0"), (2, "cuda:1", "cuda:1"), (2, "cpu", "cpu")])
def test_a_word_is_a_device(count, words, expected, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    assert str(device_of(words)) == expected


def test_each_process_of_a_machine_takes_its_own(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    for rank, expected in (("1", "cuda:1"), ("2", "cuda:0")):
        monkeypatch.setenv("LOCAL_RANK", rank)
        assert str(device_of("auto")) == expected and str(device_of("cuda:0")) == "cuda:0"


@pytest.mark.parametrize("count, word, said", [
    (0, "cuda", "sees no GPU; --device cpu does without"), (0, "cuda:1", "sees no GPU"), (1, "cuda:1", "there is one GPU, numbered from 0"),
    (1, "gpu", "must be auto, cpu, cuda or cuda:0"), (0, "cuda:x", "must be auto"), (2, "cuda:2", "there are 2 GPUs"),
    (2, "", "must be auto")])
def test_what_is_not_there_is_refused_in_one_line(count, word, said, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    with pytest.raises(InputError, match=said) as caught:
        device_of(word)
    assert "\n" not in str(caught.value)


def test_a_graph_goes_over_with_all_that_it_has():
    case = join([graph(SMALL["bsms"]), graph(SMALL["bsms"])])
    there = case.to(torch.device("meta"))
    assert all(tensor.is_meta for tensor in tensors(there)) and there.count == 2 and there.levels[0].nodes == case.levels[0].nodes
    assert [tensor.shape for tensor in tensors(there)] == [tensor.shape for tensor in tensors(case)] and len(tensors(there)) > 15
    assert case.to(torch.device("cpu")) is case


@pytest.mark.parametrize("fits, said", [(3, "the memory of cpu does not hold it; 2 fits"), (0, "does not hold a single sample")])
def test_a_batch_that_does_not_fit_is_refused_with_one_that_does(fits, said, file, tmp_path, monkeypatch):
    whole = module.take_step

    def step(learner, optimizer, normaliser, config, batch, group, replays=None):
        if len(batch) > fits:
            raise torch.OutOfMemoryError("out of memory")
        return whole(learner, optimizer, normaliser, config, batch, group, replays)

    monkeypatch.setattr(module, "take_step", step)
    with pytest.raises(InputError, match=f"batch_size = 8: .*{said}"):
        train(training(SMALL["mgn"], batch_size=8, steps=2), [file], [], tmp_path / "run")


def test_what_a_batch_too_large_has_made_is_let_go_before_a_smaller_one_is_tried(file, tmp_path, monkeypatch):
    made, still_there = [], []

    def step(learner, optimizer, normaliser, config, batch, group, replays=None):
        still_there.extend(each() is not None for each in made)
        filling = torch.zeros(3)
        made.append(weakref.ref(filling))
        raise torch.OutOfMemoryError("out of memory")

    monkeypatch.setattr(module, "take_step", step)
    with pytest.raises(InputError, match="not hold a single sample"):
        train(training(SMALL["mgn"], batch_size=4, steps=2), [file], [], tmp_path / "run")
    assert still_there == [False] * 3  # by batches of 2 (one) and of 1 (two)


def test_a_run_asks_for_its_device_before_any_work(file, tmp_path):
    config = training(SMALL["mgn"], batch_size=2, steps=2)
    with pytest.raises(InputError, match="--device nowhere"):
        train(config, [tmp_path / "missing"], [], tmp_path / "run", device="nowhere")
    train(config, [file], [], tmp_path / "run", device="cpu")
    with pytest.raises(InputError, match="--device nowhere"):
        load_model(tmp_path / "run", "nowhere")


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=gpu) for kind in SMALL])
def test_both_places_predict_the_same(kind):
    config, trajectory = training(SMALL[kind]), bending()
    scales = fit_normaliser([build_example(trajectory, config)], config)
    here = rollout(Model(config, made(SMALL[kind]), scales, "here"), trajectory).displacement
    there = rollout(Model(config, made(SMALL[kind]), scales, "there").to(torch.device("cuda")), trajectory).displacement
    steps = abs(here[1:] - here[:-1])[:, trajectory.free].mean()
    assert abs(there - here).max() < 1e-3 * len(here) * steps  # 1e-4 of a step each, gathered over ten


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=gpu) for kind in SMALL])
def test_a_training_on_a_gpu_is_read_and_gone_on_with_on_the_processor(kind, file, tmp_path):
    config = training(SMALL[kind], batch_size=2, steps=4, validate_every=2)
    train(config, [file], [file], tmp_path / "run", steps=2, device="cuda")
    train(config, [file], [file], tmp_path / "run", resume=True, device="cpu")
    assert read_checkpoint(tmp_path / "run" / "last.safetensors").about["step"] == 4
    train(replace(config, steps=6), [file], [file], tmp_path / "run", resume=True, device="cuda")
    assert torch.isfinite(torch.from_numpy(rollout(load_model(tmp_path / "run", "cuda"), bending()).displacement)).all()
