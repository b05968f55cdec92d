"""Where networks run: what is asked for is there or refused, everything goes along, and both places say the same."""

import warnings
import weakref
from contextlib import contextmanager, nullcontext
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

import learning.training.train as module
from datagen.files.trajectory import write_trajectory
from learning.devices import Replays, device_of
from learning.graphs.graph import join
from learning.networks.blocks import told_by_sizes
from learning.networks.kinds import build
from learning.prediction.checkpoint import Model, load_model, read_checkpoint
from learning.prediction.rollout import rollout
from learning.processes import Processes
from learning.samples.batches import Batches
from learning.samples.samples import build_example, fit_normaliser
from learning.training.run import set_up
from learning.training.train import descend, take_step, train
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


# replayed: by CUDA graphs where a GPU is, elsewhere by stand-ins that do again what was recorded, with what then lies in the same places

@pytest.fixture
def cuda(monkeypatch):
    class Recording:
        replays = None

        def pool(self):
            return "pool"

        def replay(self):
            places, told = next((places, told) for graph, places, told in self.replays.recorded.values() if graph is self)
            told.copy_(self.replays.run(tuple(places)))

    pools = []

    @contextmanager
    def graph(recording, *, pool, stream, capture_error_mode):
        assert capture_error_mode == "thread_local"
        pools.append(pool)
        yield

    stream = SimpleNamespace(wait_stream=lambda other: None)
    for name, value in {"Stream": lambda device: stream, "current_stream": lambda device: stream, "stream": nullcontext, "graph": graph,
                        "CUDAGraph": Recording}.items():
        monkeypatch.setattr(torch.cuda, name, value)
    return SimpleNamespace(Recording=Recording, pools=pools)


def test_what_was_recorded_is_replayed_with_what_is_given_then(cuda):
    run, given = [], [(torch.full((count,), float(value)), torch.tensor(2.0)) for value, count in ((1, 3), (2, 3), (3, 4), (4, 3), (5, 4))]

    def told(value):
        run.append(value)
        return value[0].sum() * value[1]

    cuda.Recording.replays = replays = Replays(told, torch.device("cpu"))
    assert [float(replays(value)) for value in given] == [6, 12, 24, 24, 40]
    assert len(replays.recorded) == 2 and cuda.pools == [None, "pool"]
    assert [float(value[0][0]) for value in given] == [1, 2, 3, 4, 5]  # what is given is left alone
    first, again = run[0], run[2]
    assert first[0].data_ptr() != given[0][0].data_ptr() and again[0].data_ptr() == first[0].data_ptr()


def test_numbers_beside_tensors_are_recorded_with_them(cuda):
    def told(value):
        return value[0].sum() * value[1]

    cuda.Recording.replays = replays = Replays(told, torch.device("cpu"))
    for number in (2, 3):
        replays((torch.ones(3), number))
    assert [sizes[1] for sizes in replays.recorded] == [2, 3]


def test_what_cannot_be_recorded_is_done_as_it_is_and_said_once(cuda, monkeypatch):
    @contextmanager
    def graph(*given, **rest):
        yield
        raise RuntimeError("operation not permitted when stream is capturing\nand more")

    monkeypatch.setattr(torch.cuda, "graph", graph)
    replays = Replays(lambda value: 2 * value[0], torch.device("cpu"))
    with pytest.warns(UserWarning, match="no CUDA graph: operation not permitted when stream is capturing; kernels are started"):
        assert float(replays((torch.tensor(3.0),))) == 6
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert float(replays((torch.tensor(4.0),))) == 8


RECORDED = [pytest.param(kind, marks=gpu) for kind in SMALL if told_by_sizes(made(SMALL[kind]))]


@pytest.mark.parametrize("kind", RECORDED)
@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_replayed_steps_are_those_that_are_done_kernel_by_kernel(kind, precision):
    config = training(replace(SMALL[kind], precision=precision), batch_size=2, noise=1e-4)
    examples, ends = [build_example(bending(cells=(cells, 2, 2)), config) for cells in (4, 7)], []
    for replayed in (False, True):
        run = set_up(config, examples, Path(), resume=False, device=torch.device("cuda"))
        learn = partial(descend, run.model.network, run.optimizer, run.model.normaliser, config)
        replays, batches = Replays(learn, run.model.device) if replayed else None, Batches(examples, config, fill=True)
        for step in range(12):
            run.set_rate(1e-3 / (1 + step))  # which a recording has to read anew
            take_step(run.model.network, run.optimizer, run.model.normaliser, config, batches[step % 5], Processes(), replays)
        ends.append([weight.detach().cpu() for weight in run.model.network.parameters()])
        assert replays is None or (1 <= len(replays.recorded) <= 4 and not replays.failed)
    torch.manual_seed(config.seed)
    for start, one, other in zip(build(config.network).parameters(), *ends, strict=True):
        assert (one - other).norm() <= (1e-2 if precision == "float32" else 0.1) * (one - start).norm()  # sums in another order


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
