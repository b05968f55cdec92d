"""A training between two of its steps: what it begins with, what is kept of it, and what it may go on from."""

import json
from dataclasses import replace

import pytest
import torch

from learning.config import TrainConfig
from learning.networks.m4gn import M4GN, M4GNConfig
from learning.prediction.checkpoint import read_checkpoint
from learning.samples.samples import build_example, fit_normaliser
from learning.training.run import About, fingerprint, set_up
from physics.schema import InputError, to_table
from tests.synthetic import bending

CPU = torch.device("cpu")
CONFIG = TrainConfig(segments=4, network=M4GNConfig(hidden=16, message_steps=1, transformer_layers=1, heads=4), contact_radius=0.006,
                     steps=6, learning_rate=2e-3, seed=5)


@pytest.fixture(scope="module")
def examples():
    return [build_example(bending(cells=(4, 2, 2), steps=4), CONFIG)]


def weights(run):
    return {name: value.clone() for name, value in run.model.network.state_dict().items()}


def test_a_new_run_has_the_weights_and_the_rate_of_its_config(examples, tmp_path):
    run = set_up(CONFIG, examples, tmp_path, resume=False, device=CPU)
    torch.manual_seed(5)
    plain = M4GN(CONFIG.network).state_dict()
    assert weights(run).keys() == plain.keys() and all(torch.equal(value, plain[name]) for name, value in weights(run).items())
    other = set_up(replace(CONFIG, seed=6), examples, tmp_path, resume=False, device=CPU)
    assert any(not torch.equal(value, plain[name]) for name, value in weights(other).items())
    assert run.optimizer.defaults["fused"] and isinstance(run.optimizer, torch.optim.Adam)
    assert [group["lr"] for group in run.optimizer.param_groups] == [2e-3]
    assert {id(p) for group in run.optimizer.param_groups for p in group["params"]} == {id(p) for p in run.model.network.parameters()}
    expected = fit_normaliser(examples, CONFIG).tensors()
    assert all(torch.equal(table, expected[name]) for name, table in run.model.normaliser.tensors().items())
    about = run.about
    assert (about.step, about.seconds, about.loss, about.losses, about.best_error, about.best_step, about.last_error) == (
        0, 0.0, None, [], None, None, None)
    assert about.config == to_table(CONFIG) and about.fingerprint == fingerprint(examples)
    assert {"python", "torch", "numpy", "scipy", "h5py", "safetensors", "pymetis"} == set(about.versions)
    assert (run.out, run.model.config, run.model.name) == (tmp_path, CONFIG, str(tmp_path))


def test_a_network_that_corrects_an_estimate_begins_with_it_as_it_is(examples, tmp_path):
    for estimate in (False, True):
        last = set_up(replace(CONFIG, estimate=estimate), examples, tmp_path, resume=False, device=CPU).model.network.decode.third
        assert bool(last.weight.any()) is not estimate and bool(last.bias.any()) is not estimate


def stepped(run):
    """Two steps of Adam on a made-up loss."""
    for _ in range(2):
        dice = torch.Generator().manual_seed(run.about.step)
        run.optimizer.zero_grad()
        sum((p * torch.rand(p.shape, generator=dice)).sum() for p in run.model.network.parameters()).backward()
        run.optimizer.step()
        run.about.step += 1


def test_what_goes_on_from_a_whole_checkpoint_ends_where_the_run_itself_does(examples, tmp_path):
    run = set_up(CONFIG, examples, tmp_path, resume=False, device=CPU)
    stepped(run)
    run.about.seconds, run.about.loss, run.about.best_error, run.about.best_step, run.about.losses = 2.5, 0.125, 1e-3, 1, [3.0, 4.0]
    run.keep("last", whole=True)
    run.keep("model")
    again = set_up(CONFIG, examples, tmp_path, resume=True, device=CPU)
    assert again.about == run.about and again.model.name == str(tmp_path)
    for one in (run, again):
        stepped(one)
    assert all(torch.equal(value, weights(again)[name]) for name, value in weights(run).items()) and again.about.step == 4
    kept = read_checkpoint(tmp_path / "model.safetensors")
    assert not kept.optimizer
    (tmp_path / "last.safetensors").write_bytes((tmp_path / "model.safetensors").read_bytes())
    with pytest.raises(InputError, match="holds a network but no state of a training: it cannot be resumed"):
        set_up(CONFIG, examples, tmp_path, resume=True, device=CPU)


def test_only_the_end_of_a_run_may_be_moved(examples, tmp_path):
    run = set_up(CONFIG, examples, tmp_path, resume=False, device=CPU)
    stepped(run)
    run.keep("last", whole=True)
    moved = replace(CONFIG, steps=60, budget_seconds=9.0)
    assert set_up(moved, examples, tmp_path, resume=True, device=CPU).about.config == to_table(moved)
    for change, words in (({"seed": 6}, r"trained with another seed \(5, not 6\)"),
                          ({"noise": 2e-4}, r"another noise \(0.0001, not 0.0002\)"),
                          ({"clip_norm": 2.0, "tau": 0.75}, r"another clip_norm \(1.0, not 2.0\)")):
        with pytest.raises(InputError, match=words):
            set_up(replace(CONFIG, **change), examples, tmp_path, resume=True, device=CPU)
    other = [build_example(bending(cells=(4, 2, 2), steps=4, travel=0.015), CONFIG)]
    with pytest.raises(InputError, match="was trained on other data: it cannot be resumed with these files"):
        set_up(CONFIG, other, tmp_path, resume=True, device=CPU)


def test_a_checkpoint_of_an_earlier_version_lacks_keys_and_has_their_defaults(examples, tmp_path, monkeypatch):
    run = set_up(CONFIG, examples, tmp_path, resume=False, device=CPU)
    stepped(run)
    table = {key: value for key, value in run.about.config.items() if key != "clip_norm"}
    run.about = About(**(vars(run.about) | {"config": table}))
    run.keep("last", whole=True)
    assert "clip_norm" not in json.loads(json.dumps(read_checkpoint(tmp_path / "last.safetensors").about["config"]))
    assert set_up(CONFIG, examples, tmp_path, resume=True, device=CPU).about.config["clip_norm"] == 1.0
    with pytest.raises(InputError, match=r"another clip_norm \(1.0, not 3.0\)"):
        set_up(replace(CONFIG, clip_norm=3.0), examples, tmp_path, resume=True, device=CPU)
