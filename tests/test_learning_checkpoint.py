"""What a run folder holds comes back number for number, and what is not whole is refused in one line."""

import json
from dataclasses import replace

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from learning.config import TrainConfig
from learning.networks.m4gn import M4GN, M4GNConfig
from learning.networks.stored import put_into
from learning.prediction import checkpoint as module
from learning.prediction.checkpoint import Checkpoint, load_model, read_checkpoint, write_checkpoint
from learning.samples.samples import Normaliser
from physics.schema import InputError, to_table

CONFIG = TrainConfig(segments=7, network=M4GNConfig(hidden=4, message_steps=1, transformer_layers=1, heads=2))


def state(config=CONFIG):
    torch.manual_seed(3)
    optimizer = {0: {"step": torch.tensor(7.0), "exp_avg": torch.randn(2, 3)}, 12: {"exp_avg_sq": torch.randn(4)}}
    normaliser = Normaliser(node=torch.randn(2, 12), mesh_edge=torch.randn(2, 8), contact_edge=torch.randn(2, 4), velocity=torch.randn(1))
    about = {"config": to_table(config), "step": 12, "best_error": None}
    return Checkpoint(about, M4GN(config.network).state_dict(), normaliser, optimizer)


def test_a_state_comes_back_number_for_number(tmp_path):
    asked = state()
    write_checkpoint(tmp_path / "last.safetensors", asked)
    found = read_checkpoint(str(tmp_path / "last.safetensors"))
    assert found.about == {"schema": 1, **asked.about}
    assert found.weights.keys() == asked.weights.keys()
    assert all(torch.equal(value, asked.weights[name]) for name, value in found.weights.items())
    assert all(torch.equal(value, asked.normaliser.tensors()[name]) for name, value in found.normaliser.tensors().items())
    assert found.optimizer.keys() == {0, 12}
    assert {number: set(entry) for number, entry in found.optimizer.items()} == {0: {"step", "exp_avg"}, 12: {"exp_avg_sq"}}
    for number, entry in asked.optimizer.items():
        assert all(torch.equal(found.optimizer[number][name], value) for name, value in entry.items())


def test_a_file_is_numbers_and_json_alone(tmp_path):
    write_checkpoint(tmp_path / "model.safetensors", state())
    with safe_open(tmp_path / "model.safetensors", framework="pt") as file:
        about, names = json.loads(file.metadata()["about"]), set(file.keys())
    assert about["schema"] == 1 and about["config"]["segments"] == 7
    assert {"weights.encode_node.first.weight", "normaliser.velocity", "optimizer.12.exp_avg_sq"} <= names


def test_the_model_of_a_run_is_its_best_network_ready_to_predict(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(module, "keep_freed_memory", lambda: calls.append(1))
    best = state()
    write_checkpoint(tmp_path / "model.safetensors", best)
    last = {name: value + 1 for name, value in best.weights.items()}
    write_checkpoint(tmp_path / "last.safetensors", Checkpoint(best.about, last, best.normaliser, {}))
    model = load_model(tmp_path)
    assert model.config == CONFIG and model.name == str(tmp_path) and not model.network.training and calls == [1]
    assert all(torch.equal(value, best.weights[name]) for name, value in model.network.state_dict().items())
    assert torch.equal(model.normaliser.mesh_edge, best.normaliser.mesh_edge)


def test_what_is_no_checkpoint_of_this_program_is_refused(tmp_path):
    path = tmp_path / "model.safetensors"
    with pytest.raises(InputError, match="no such checkpoint"):
        read_checkpoint(path)
    path.mkdir()
    with pytest.raises(InputError, match="no such checkpoint"):
        read_checkpoint(path)
    path.rmdir()
    save_file({"a": torch.zeros(1)}, path)
    with pytest.raises(InputError, match="checkpoint schema None, this program reads 1$"):
        read_checkpoint(path)
    for about, said in (({"schema": 2}, "checkpoint schema 2, this program reads 1$"),
                        ({"schema": 1}, "not a whole checkpoint: .*normaliser")):
        save_file({"a": torch.zeros(1)}, path, {"about": json.dumps(about)})
        with pytest.raises(InputError, match=said):
            read_checkpoint(path)
    save_file({"a": torch.zeros(1)}, path, {"about": "{"})
    with pytest.raises(InputError, match="not a whole checkpoint"):
        read_checkpoint(path)


def test_scales_of_another_width_are_refused(tmp_path):
    """One column would be spread over all features without a word."""
    scales = state().normaliser
    narrow = replace(scales, node=scales.node[:, :1].clone())
    write_checkpoint(tmp_path / "model.safetensors", replace(state(), normaliser=narrow))
    with pytest.raises(InputError, match=r"normaliser.node has shape \(2, 1\), not \(2, 12\)"):
        read_checkpoint(tmp_path / "model.safetensors")


def test_weights_of_another_network_are_refused_by_name(tmp_path):
    with pytest.raises(InputError) as caught:
        put_into(M4GN(M4GNConfig(hidden=4, message_steps=2, transformer_layers=1, heads=2)), state().weights, "here")
    assert str(caught.value).startswith("here: its weights do not fit its config: Missing key(s)") and "\n" not in str(caught.value)
    write_checkpoint(tmp_path / "model.safetensors", state())
    asked = state()
    asked.about["config"]["segmentz"] = 3
    write_checkpoint(tmp_path / "model.safetensors", asked)
    with pytest.raises(InputError, match=r"model\.safetensors: config.*segments"):
        load_model(tmp_path)
