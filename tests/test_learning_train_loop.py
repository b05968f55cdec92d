"""The loop of training against its definition: one step by hand, what a seed does, which network is kept, what the clock says."""

import json
import math
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from datagen.files.trajectory import write_trajectory
from learning.config import TrainConfig
from learning.networks.m4gn import M4GN, M4GNConfig
from learning.prediction.checkpoint import load_model, read_checkpoint
from learning.processes import Processes
from learning.samples.batches import Batches, batch_of
from learning.samples.estimate import Estimate
from learning.samples.samples import build_example, fit_normaliser, sample
from learning.training import run as run_module
from learning.training import train as module
from learning.training.train import learning_rate, progress, take_step, train
from physics.schema import InputError
from tests.synthetic import bending

CONFIG = TrainConfig(segments=3, method="metis", network=M4GNConfig(hidden=4, message_steps=1, transformer_layers=1, heads=2),
                     contact_radius=0.006, batch_size=3, steps=5, learning_rate=1e-2, final_learning_rate=1e-4, validate_every=2,
                     noise=3e-4, clip_norm=0.5, seed=5)
SCENES = (dict(cells=(4, 2, 2), steps=4), dict(cells=(6, 2, 2), steps=4, at=0.08))


@pytest.fixture(scope="module")
def cases():
    return [build_example(bending(**scene), CONFIG) for scene in SCENES]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    for number, scene in enumerate(SCENES):
        write_trajectory(folder / f"{number}.vtkhdf", bending(**scene))
    return sorted(folder.iterdir())


def loss_of(network, normaliser, batch, of=slice(None)):
    """The mean over free nodes and components of all samples, of which those asked for are summed."""
    total, count = torch.zeros(()), 0
    for _, _, asked in batch:
        count += int(asked.sum())
    for graph, target, asked in batch[of]:
        said = network(normaliser.graph(graph))
        for node, axis in torch.nonzero(asked).tolist():
            total = total + (said[node, axis] - target[node, axis] / float(normaliser.velocity)) ** 2
    return total / count


def gradient_of(network, loss):
    return list(torch.autograd.grad(loss, list(network.parameters())))


@pytest.mark.parametrize("clip", [0.5, 1e6])
@pytest.mark.parametrize("rank, count", [(0, 1), (0, 3), (1, 3), (2, 3)])
def test_a_step_follows_the_clipped_gradient_of_the_mean_square_in_units_of_the_scale(cases, clip, rank, count):
    torch.manual_seed(1)
    config, network = replace(CONFIG, clip_norm=clip), M4GN(CONFIG.network)
    normaliser = replace(fit_normaliser(cases, CONFIG), velocity=torch.tensor([4e-4]))
    generator = torch.Generator().manual_seed(2)
    batch = [(*sample(cases[which], frame, CONFIG, generator), cases[which].asked)
             for which, frame in ((0, 3), (1, 2), (1, 0))]
    loss = loss_of(network, normaliser, batch, slice(rank, None, count))
    slope = [count * value for value in gradient_of(network, loss)]  # of which the processes' mean is taken
    norm = math.sqrt(sum(float(value.double().square().sum()) for value in slope))
    assert 1 < norm < 1e5  # the first limit is exceeded, the second is not
    before = [weight.detach().clone() for weight in network.parameters()]
    optimizer = torch.optim.SGD(network.parameters(), lr=1.0)  # the step is the gradient itself
    for weight in network.parameters():
        weight.grad = torch.full_like(weight, 7.0)  # of a step before: forgotten
    processes = SimpleNamespace(rank=rank, count=count, total=lambda value: 100 * value)
    numbers = sum(int(asked.sum()) for _, _, asked in batch)
    told = take_step(network, optimizer, normaliser, config, batch_of(batch[rank::count], numbers=numbers), processes)
    assert told == pytest.approx(100 * float(loss.detach()), rel=1e-5)
    for old, new, value in zip(before, network.parameters(), slope, strict=True):
        # float32 sums in another order
        assert torch.allclose(old - new, value * min(1, clip / norm), rtol=1e-3, atol=1e-4 * min(norm, clip))


def test_a_training_is_its_definition(files, tmp_path):
    """Seed, draws, noise, clipped gradients, the rate at 0, 1/4, 1/2 and 3/4, and Adam by its formula."""
    config = replace(CONFIG, steps=4)
    cases = [build_example(bending(**scene), config) for scene in SCENES]
    torch.manual_seed(5)
    network = M4GN(config.network)
    normaliser = fit_normaliser(cases, config)
    frames = [(which, frame) for which in range(2) for frame in range(4)]
    weights = list(network.parameters())
    first, second, losses = [0.0] * len(weights), [0.0] * len(weights), []
    for step, rate in enumerate((1e-2, 1e-2, 1e-2, 1e-3), start=1):  # the last: half way down from 1e-2 to 1e-4, in the logarithm
        first_dice, *dice = (torch.Generator().manual_seed(int(word)) for word in np.random.SeedSequence((5, step)).generate_state(4))
        picked = [frames[i] for i in torch.randint(8, (3,), generator=first_dice).tolist()]
        batch = [(*sample(cases[which], frame, config, one), cases[which].asked) for (which, frame), one in zip(picked, dice, strict=True)]
        loss = loss_of(network, normaliser, batch)
        losses.append(float(loss.detach()))
        slope = gradient_of(network, loss)
        norm = math.sqrt(sum(float(value.square().sum()) for value in slope))
        assert norm > 0.5
        for i, (weight, value) in enumerate(zip(weights, slope, strict=True)):
            value = 0.5 / norm * value
            first[i] = 0.9 * first[i] + 0.1 * value
            second[i] = 0.999 * second[i] + 0.001 * value**2
            with torch.no_grad():
                weight -= rate * first[i] / (1 - 0.9**step) / ((second[i] / (1 - 0.999**step)).sqrt() + 1e-8)
    told = train(config, files, [], tmp_path)
    state = read_checkpoint(tmp_path / "last.safetensors")
    off = sum(float((state.weights[name] - weight.detach()).square().sum()) for name, weight in network.named_parameters())
    # each of some 600 weights has gone up to 3e-2; where a gradient is rounding alone Adam's step has any sign, and such weights are few
    assert math.sqrt(off) < 1e-4
    assert told["loss"] == pytest.approx(np.mean(losses), rel=1e-4)
    assert told["samples"] == 8 and told["steps"] == 4
    assert told["parameters"] == sum(weight.numel() for weight in weights)


def test_the_rate_is_kept_for_half_and_falls_by_the_logarithm():
    config = replace(CONFIG, learning_rate=1e-2, final_learning_rate=1e-6)
    rates = [learning_rate(config, done) for done in (0, 0.25, 0.5, 0.625, 0.75, 1, 1.3)]
    assert rates == pytest.approx([1e-2, 1e-2, 1e-2, 1e-3, 1e-4, 1e-6, 1e-6])


def test_progress_is_the_further_of_steps_and_seconds():
    config = replace(CONFIG, steps=40)
    assert progress(config, 10, 1e9) == 0.25
    config = replace(config, budget_seconds=20.0)
    assert (progress(config, 10, 4.0), progress(config, 10, 8.0), progress(config, 50, 8.0)) == (0.25, 0.4, 1.25)


# a training whose steps and validations are made up: only the loop itself runs

class Clock:
    """A step takes 2 s (the processor half of that), a validation 0.25 s, and nothing else any time; step k has the loss 10^k and leaves
    k in the last bias."""

    def __init__(self, patch, errors=()):
        self.now, self.step, self.rates, self.errors, self.bars = 1000.0, 0, [], list(errors), []
        patch.setattr(run_module, "time", SimpleNamespace(perf_counter=lambda: self.now, process_time=lambda: self.now / 2))
        patch.setattr(module, "take_step", self.make_step)
        patch.setattr(module, "rollout_error", self.error)
        patch.setattr(module, "tqdm", self.bar)

    def make_step(self, network, optimizer, normaliser, config, batch, group, replays):
        for weight in network.parameters():
            weight.grad = torch.zeros_like(weight)
        optimizer.step()  # which leaves Adam's state behind
        self.now += 2
        self.step += 1
        self.rates.append(optimizer.param_groups[0]["lr"])
        assert len(batch) == 3
        with torch.no_grad():
            network.decode.third.bias[:] = self.step
        return 10.0**self.step

    def error(self, model, case):
        self.now += 0.25
        found = self.errors.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    @contextmanager
    def bar(self, **options):
        bar = SimpleNamespace(n=0.0, said=[])

        def update(more):
            bar.n += more
            bar.said.append(bar.n)

        bar.update, bar.set_postfix_str = update, lambda text, refresh: self.bars.append((bar.said[-1:], text))
        yield bar
        self.shown = bar.said


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def kept(out, name="model"):
    """Which step's network a file holds."""
    return float(read_checkpoint(out / f"{name}.safetensors").weights["decode.third.bias"][0])


def lines(out, key):
    return [line for line in map(json.loads, (out / "curve.jsonl").read_text().splitlines()) if key in line]


def test_the_best_network_is_kept_and_the_last_beside_it(clock, files, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "REPORT_EVERY", 3)
    clock.errors[:] = [3.0, 5.0, 1.0, 2.0, 2.0, 4.0]  # of two trajectories after steps 2, 4 and 5
    told = train(CONFIG, files, files, tmp_path)
    assert kept(tmp_path) == 4 and kept(tmp_path, "last") == 5
    assert float(load_model(tmp_path).network.decode.third.bias.detach()[0]) == 4
    assert (told["best_error"], told["best_step"], told["last_error"], told["steps"]) == (1.5, 4, 3.0, 5)
    assert told["run"] == str(tmp_path)
    assert [(line["step"], line["error"]) for line in lines(tmp_path, "error")] == [(2, 4.0), (4, 1.5), (5, 3.0)]
    # means since the line before: of 10, 100, 1000 and of 10^4, 10^5
    assert [(line["step"], line["loss"]) for line in lines(tmp_path, "loss")] == [(3, 370.0), (5, 55000.0)]
    assert told["loss"] == 55000.0
    # the rate of the step that was made last, at 2/5 and at 4/5 of the way: 10^-2 and, at 0.6 of the decay, 10^-3.2
    assert [line["learning_rate"] for line in lines(tmp_path, "loss")] == pytest.approx([1e-2, 10**-3.2])
    assert clock.rates == pytest.approx([1e-2, 1e-2, 1e-2, 10**-2.4, 10**-3.2])
    # steps of 2 s, with half a second of validation after steps 2 and 4
    assert [line["seconds"] for line in lines(tmp_path, "loss")] == [6.5, 11.0]
    assert [line["seconds"] for line in lines(tmp_path, "error")] == [4.0, 8.5, 11.0]
    assert [line["processor"] for line in lines(tmp_path, "error")] == [2.0, 4.25, 5.5]
    assert told["seconds"] == 11.5 and told["processor"] == 5.75 and told["ms_per_step"] == pytest.approx(2300)
    assert clock.shown == pytest.approx([60, 100])
    assert clock.bars[0][1] == "step 3 loss 370 error 4.00e+00 m"
    about = read_checkpoint(tmp_path / "last.safetensors").about
    assert (about["step"], about["seconds"], about["best_error"], about["best_step"], about["last_error"]) == (5, 11.5, 1.5, 4, 3.0)
    assert set(about["versions"]) == {"python", "torch", "numpy", "scipy", "h5py", "safetensors", "pymetis"}
    assert not read_checkpoint(tmp_path / "model.safetensors").optimizer


def test_without_validation_the_last_network_is_the_best(clock, files, tmp_path):
    told = train(CONFIG, files, [], tmp_path)
    assert kept(tmp_path) == 5
    assert (told["best_error"], told["best_step"], told["last_error"]) == (None, 5, None)
    assert lines(tmp_path, "error") == []


def test_a_rollout_that_blows_up_has_no_error_and_is_never_the_best_but_the_first(clock, files, tmp_path):
    clock.errors[:] = [FloatingPointError(), 7.0, FloatingPointError()]
    told = train(CONFIG, files, files[:1], tmp_path)
    assert kept(tmp_path) == 4
    assert (told["best_error"], told["best_step"], told["last_error"]) == (7.0, 4, None)
    assert [line["error"] for line in lines(tmp_path, "error")] == [None, 7.0, None]
    clock.step, clock.errors[:] = 0, [FloatingPointError()] * 3
    assert train(CONFIG, files, files[:1], tmp_path / "b")["best_step"] == 2
    assert kept(tmp_path / "b") == 2


def test_an_equal_error_does_not_replace_the_best(clock, files, tmp_path):
    clock.errors[:] = [2.0, 2.0, 2.0]
    assert train(CONFIG, files, files[:1], tmp_path)["best_step"] == 2


def test_a_budget_ends_a_training_and_a_resumed_one_has_what_is_left_of_it(clock, files, tmp_path):
    config = replace(CONFIG, steps=1000, budget_seconds=10.0, validate_every=1000)
    told = train(config, files, [], tmp_path, steps=2)
    assert (told["steps"], told["seconds"], told["ms_per_step"]) == (2, 4.0, 2000.0)
    clock.now += 500
    told = train(config, files, [], tmp_path, resume=True)
    assert (told["steps"], told["seconds"]) == (5, 10.0) and told["ms_per_step"] == pytest.approx(2000)
    assert clock.rates == pytest.approx([1e-2, 1e-2, 1e-2, 10**-2.4, 10**-3.2])  # at 0, 2, 4, 6 and 8 s of 10
    assert kept(tmp_path) == 5
    assert train(config, files, [], tmp_path, resume=True)["steps"] == 5 and clock.step == 5  # there is nothing left
    # the end may be moved; the config that is kept is the new one
    told = train(replace(config, budget_seconds=13.0), files, [], tmp_path, resume=True)
    assert (told["steps"], told["seconds"], told["processor"]) == (7, 14.0, 7.0)
    assert read_checkpoint(tmp_path / "last.safetensors").about["config"]["budget_seconds"] == 13.0
    with pytest.raises(InputError, match="another seed .5, not 6"):
        train(replace(config, seed=6), files, [], tmp_path, resume=True)
    with pytest.raises(InputError, match="another network"):
        train(replace(config, network=replace(CONFIG.network, hidden=8)), files, [], tmp_path, resume=True)
    with pytest.raises(InputError, match="other data"):
        train(config, files[::-1], [], tmp_path, resume=True)


def test_steps_ends_a_training_before_its_config_does_and_not_after(clock, files, tmp_path):
    assert train(CONFIG, files, [], tmp_path, steps=3)["steps"] == 3
    assert kept(tmp_path) == kept(tmp_path, "last") == 3
    with pytest.raises(InputError, match="holds a training already"):
        train(CONFIG, files, [], tmp_path)
    assert train(CONFIG, files, [], tmp_path, steps=3, resume=True)["steps"] == 3 and clock.step == 3
    assert train(CONFIG, files, [], tmp_path, steps=99, resume=True)["steps"] == 5


def test_the_loss_that_is_told_is_the_same_with_stops_as_without(files, tmp_path, monkeypatch):
    """Means over steps 1 .. 4 and 5 .. 8, and at the end over 9 and 10, whatever stops lie between."""
    monkeypatch.setattr(module, "REPORT_EVERY", 4)
    config = replace(CONFIG, steps=10, validate_every=3)
    whole = train(config, files, [], tmp_path / "whole")["loss"]
    for stop in (1, 3, 4, 6, 9):
        train(config, files, [], tmp_path / "stopped", steps=stop, resume=True)
    assert train(config, files, [], tmp_path / "stopped", resume=True)["loss"] == whole

    def told(run, steps):
        lines = [json.loads(line) for line in (tmp_path / run / "curve.jsonl").read_text().splitlines()]
        return [line["loss"] for line in lines if line["step"] in steps and "loss" in line]

    assert told("whole", (4, 8, 10)) == told("stopped", (4, 8, 10)) and len(told("stopped", range(11))) == 7


def test_to_resume_what_has_not_begun_is_to_begin(files, tmp_path):
    (tmp_path / "empty").mkdir()
    fresh = train(CONFIG, files, [], tmp_path / "fresh")
    assert train(CONFIG, files, [], tmp_path / "empty", resume=True)["loss"] == fresh["loss"]
    assert train(CONFIG, files, [], tmp_path / "new", resume=True)["steps"] == 5


def test_what_holds_a_network_alone_cannot_be_resumed(clock, files, tmp_path):
    train(CONFIG, files, [], tmp_path)
    (tmp_path / "last.safetensors").write_bytes((tmp_path / "model.safetensors").read_bytes())
    with pytest.raises(InputError, match="no state of a training"):
        train(replace(CONFIG, steps=9), files, [], tmp_path, resume=True)


def test_a_loss_that_is_not_finite_stops_and_leaves_the_last_checkpoint(clock, files, tmp_path, monkeypatch):
    made = clock.make_step
    monkeypatch.setattr(module, "take_step", lambda *given: made(*given) if clock.step < 3 else math.inf)
    with pytest.raises(FloatingPointError, match=r"the loss is inf at step 4, learning rate 0\.004"):  # 10^-2.4
        train(CONFIG, files, [], tmp_path)
    assert kept(tmp_path, "last") == 2 and read_checkpoint(tmp_path / "last.safetensors").about["step"] == 2


def test_another_process_than_the_first_leaves_nothing(clock, files, tmp_path, monkeypatch):
    class Second(Processes):
        first = False

    @contextmanager
    def second(config, device):
        yield Second()

    monkeypatch.setattr(module, "processes", second)
    told = train(CONFIG, files, files, tmp_path)
    assert told["steps"] == 5 and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("wanted", [True, False])
def test_with_estimates_the_network_begins_by_saying_nothing(clock, files, tmp_path, monkeypatch, wanted):
    def guessed(trajectory, frames, *, cache=None):
        answer = np.ones((len(frames), *trajectory.points.shape), np.float32) * frames[:, None, None]
        return Estimate(frames, trajectory.displacement[frames].copy(), answer)

    given = []
    monkeypatch.setattr("learning.samples.samples.estimate", guessed)
    monkeypatch.setattr(Batches, "__getitem__", lambda batches, number: given.append(batches.chance) or [None] * 3)
    monkeypatch.setattr(module, "take_step", lambda *rest: 1.0)
    train(replace(CONFIG, estimate=wanted, scheme="pose"), files, [], tmp_path)
    weights = read_checkpoint(tmp_path / "last.safetensors").weights
    assert all(bool(weights[f"decode.third.{name}"].any()) != wanted for name in ("weight", "bias"))
    assert all(bool(weights[f"decode.second.{name}"].any()) for name in ("weight", "bias"))
    assert (given[0] is not None) == wanted


# seeds

def test_the_seed_of_the_network_and_of_the_draws_both_count(files, tmp_path, monkeypatch):
    def state(seed, name):
        drawn = []
        with monkeypatch.context() as patch:
            patch.setattr(module, "take_step", lambda *rest: drawn.append(rest[4].target) or 1.0)
            train(replace(CONFIG, seed=seed, steps=1), files, [], tmp_path / name)
        return read_checkpoint(tmp_path / name / "last.safetensors").weights, drawn[0]

    (one, drawn), (again, drawn_again), (other, drawn_other) = state(5, "a"), state(5, "b"), state(6, "c")
    for name, value in one.items():
        assert torch.equal(value, again[name])
        assert "norm" in name or not torch.equal(value, other[name])
    torch.manual_seed(6)
    assert all(torch.equal(value, other[name]) for name, value in M4GN(CONFIG.network).state_dict().items())
    assert torch.equal(drawn, drawn_again) and not torch.equal(drawn, drawn_other)
