"""The loop of predictors of poses, from its outside: what a run leaves and gives, what is gone on with, what is refused."""

import json
import math
import tomllib
from dataclasses import replace

import pytest
import torch

from learning.config import BodiesConfig
from learning.networks.stored import read_stored, write_stored
from learning.samples.seen import read_seen
from learning.training import poses as module
from learning.training.poses import doubted, refuse_trained, run
from physics.schema import InputError, to_table

CONFIG = BodiesConfig(steps=10, validate_every=4, batch_size=3, learning_rate=0.01, seed=2)
TOLD = [{"steps": 9.0, "way of the obstacle in one step [m]": 1e-3, "width": 1.0}, {"steps": 8.0, "width": 3.0, "law": "linear"}]


class Learner:
    """Two numbers that are pulled towards drawn ones; validation errors as given, one after the other."""

    poses, fingerprint, data_seconds = 7, "f", 12.5

    def __init__(self, *errors):
        torch.manual_seed(0)
        self.network, self.errors, self.drawn = torch.nn.Linear(1, 1), list(errors), []

    def loss(self, generator, count):
        self.drawn.append((count, torch.rand(1, generator=generator)))
        return sum((p - self.drawn[-1][1]).square().sum() for p in self.network.parameters())

    def judged(self):
        return (self.errors.pop(0), 2.0) if self.errors else (None, math.inf)

    def state(self, bar):
        return {f"weights.{name}": value for name, value in self.network.state_dict().items()} | {"scales.bar": torch.tensor([bar])}


@pytest.fixture
def clock(monkeypatch):
    """Each look at the processor's clock is a quarter of a second later."""
    ticks = iter(range(10**6))
    monkeypatch.setattr(module.time, "process_time", lambda: next(ticks) / 4)


def test_a_run_gives_what_it_did_and_leaves_its_config_and_ranges(tmp_path, clock):
    learner = Learner(3e-3, 2e-3, 4e-3)
    result = run(CONFIG, learner, TOLD, tmp_path / "a" / "run", steps=None, resume=False)
    # a look before the first step, one after each of ten steps and one more after each of three reports, the last of all
    assert result.pop("seconds") == 13 / 4 and result.pop("ms_per_step") == pytest.approx(1e3 * 13 / 4 / 10)
    loss = result.pop("loss")
    assert result == {"run": str(tmp_path / "a" / "run"), "steps": 10, "best_error": 2e-3, "best_step": 8, "last_error": 4e-3,
                      "parameters": 2, "samples": 7}
    lines = [json.loads(line) for line in (tmp_path / "a" / "run" / "curve.jsonl").read_text().splitlines()]
    assert [(line["step"], line["error"]) for line in lines] == [(4, 3e-3), (8, 2e-3), (10, 4e-3)] and lines[-1]["loss"] == loss
    assert tomllib.loads((tmp_path / "a" / "run" / "config.toml").read_text()) == {
        key: value for key, value in to_table(CONFIG).items() if value is not None}
    seen = read_seen(tmp_path / "a" / "run")
    assert (seen.numbers, seen.choices, seen.trajectories) == ({"width": (1.0, 3.0)}, {"law": ("linear",)}, 2)
    about, _ = read_stored(tmp_path / "a" / "run" / "last.safetensors")
    assert (about["fingerprint"], about["trajectories"], about["data_seconds"]) == ("f", 2, 12.5) and "torch" in about["versions"]
    assert {count for count, _ in learner.drawn} == {3}


def test_a_run_in_two_parts_is_one_and_the_second_tells_its_own_speed(tmp_path, clock):
    whole, first, second = Learner(), Learner(), Learner()
    run(CONFIG, whole, TOLD, tmp_path / "whole", steps=None, resume=False)
    found = run(CONFIG, first, TOLD, tmp_path / "halves", steps=4, resume=False)
    assert (found["steps"], found["seconds"]) == (4, 5 / 4)
    found = run(replace(CONFIG, steps=10), second, TOLD, tmp_path / "halves", steps=99, resume=True)
    # the first part's checkpoint tells its seconds before its last look: 4 / 4; then six steps and two reports
    assert (found["steps"], found["seconds"]) == (10, 12 / 4) and found["ms_per_step"] == pytest.approx(1e3 * 2 / 6)
    assert [float(each) for _, each in first.drawn + second.drawn] == [float(each) for _, each in whole.drawn]
    assert all(torch.equal(a, b) for a, b in zip(second.network.parameters(), whole.network.parameters(), strict=True))
    found = run(CONFIG, Learner(), TOLD, tmp_path / "halves", steps=None, resume=True)  # nothing is left to be done
    assert (found["steps"], found["seconds"], found["ms_per_step"]) == (10, 11 / 4, 0.0)


def test_a_run_ends_with_its_seconds_and_goes_on_when_it_is_given_more(tmp_path, clock):
    short = replace(CONFIG, budget_seconds=1.0)
    assert run(short, Learner(), TOLD, tmp_path, steps=None, resume=False)["steps"] == 4  # 1/4 s each
    assert run(replace(short, budget_seconds=1.5), Learner(), TOLD, tmp_path, steps=None, resume=True)["steps"] == 6  # 5/4, then 6/4


def test_what_is_no_whole_run_of_these_data_is_not_gone_on_with(tmp_path):
    with pytest.raises(InputError, match="no such checkpoint"):
        run(CONFIG, Learner(), TOLD, tmp_path / "none", steps=None, resume=True)
    run(CONFIG, Learner(), TOLD, tmp_path, steps=2, resume=False)
    refuse_trained(tmp_path, True)
    refuse_trained(tmp_path / "none", False)
    with pytest.raises(InputError, match="holds a training already: resume it, or choose another folder"):
        refuse_trained(tmp_path, False)
    path = tmp_path / "last.safetensors"
    about, tensors = read_stored(path)
    about.pop("schema")
    for changed, left_out, words in ((about | {"fingerprint": "g"}, "", "was trained on other data"), (about, "generator", "not a whole"),
                                     (about, "weights.bias", "not a whole checkpoint: Error"), (about, "optimizer.0.step", "not a whole"),
                                     (about | {"config": about["config"] | {"seed": 3}}, "", "with another config")):
        write_stored(path, changed, {name: value for name, value in tensors.items() if name != left_out})
        if left_out == "optimizer.0.step":
            write_stored(path, changed, tensors | {"optimizer.x.step": torch.zeros(1)})
        with pytest.raises(InputError, match=words) as caught:
            run(CONFIG, Learner(), TOLD, tmp_path, steps=None, resume=True)
        assert "\n" not in str(caught.value)


def test_doubt_costs_a_hundredth_of_the_mean_square_of_logarithms():
    error, depth, doubt = torch.tensor([1e-3, 0.0]), torch.tensor([1e-2, 1.0]), torch.log(torch.tensor([0.2, 1e-9]))
    assert float(doubted(error, depth, doubt)) == pytest.approx(0.01 * math.log(2) ** 2 / 2, rel=1e-5)


class Bar:
    """Stands in for a progress bar."""

    def __init__(self, **how):
        self.how, self.n, self.shown, self.words = how, 0.0, [], []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def update(self, by):
        self.n += by
        self.shown.append(self.n)

    def set_postfix_str(self, words):
        self.words.append(words)


def test_the_bar_goes_to_a_hundred_and_says_where_the_training_is(tmp_path, monkeypatch):
    bars = []
    monkeypatch.setattr(module, "tqdm", lambda **how: bars.append(Bar(**how)) or bars[-1])
    monkeypatch.setattr(module.time, "process_time", lambda: 0.0)
    result = run(CONFIG, Learner(3e-3), TOLD, tmp_path, steps=None, resume=False)
    bar, = bars
    assert bar.how["total"] == 100 and bar.how["disable"] is None and bar.shown == pytest.approx([40, 80, 100])
    assert bar.words[0].startswith("step 4 loss ") and bar.words[0].endswith(" error 3.00e-03 m")
    assert bar.words[-1] == f"step 10 loss {result['loss']:.3g} error nan m"
