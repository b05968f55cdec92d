"""The config of a training: its defaults are the published values, and its limits are reached."""

from dataclasses import replace

import pytest

from learning.config import TrainConfig, load_config
from learning.keys import at_once_table, config_table
from learning.networks.m4gn import M4GNConfig
from physics.schema import InputError, read_table, to_table
from tests.pages import ROOT


def test_the_defaults_are_those_of_the_paper():
    # Lei et al., appendix "Training Details" and "M4GN Configurations": DeformingBeam
    config = to_table(TrainConfig())
    network = dict(kind="m4gn", hidden=128, message_steps=7, transformer_layers=4, heads=8, feed=4, walk=0, precision="float32")
    assert config == dict(
        scheme="step", history=0, estimate=False, segments=19, method="slic-mdod-e", tau=0.5, modes="elastic", mode_count=1, overlap=0,
        network=network, contact_radius=0.002, noise=1e-4, batch_size=8, steps=1_000_000, learning_rate=1e-4, final_learning_rate=1e-6,
        clip_norm=1.0, validate_every=10_000, seed=0,
        bundle=1, pushed=0, outputs={"fields": []},
        inputs={"material": False, "lengths": "m"}) | {key: value for key, value in config.items() if value is None}
    assert TrainConfig().frames is None and TrainConfig().budget_seconds is None


def test_every_key_has_the_default_and_the_limits_that_the_docs_tell():
    page = (ROOT / "docs" / "network.md").read_text()
    assert config_table() in page and at_once_table() in page


@pytest.mark.parametrize("key, low, high", [
    ("history", 0, 1), ("frames", 1, None), ("segments", 1, 100_000), ("mode_count", 1, 100), ("overlap", 0, 1), ("batch_size", 1, 10_000),
    ("steps", 1, None), ("validate_every", 1, None), ("seed", 0, None), ("network.hidden", 1, 4096), ("network.message_steps", 1, 100),
    ("network.transformer_layers", 0, 100), ("network.heads", 1, 256), ("network.walk", 0, 100)])
def test_whole_numbers_have_limits(key, low, high):
    def read(value):
        group, _, name = key.rpartition(".")
        found = read_table(TrainConfig, {group: {name: value}} if group else {name: value})
        return getattr(found.network if group else found, name)

    assert read(low) == low
    for bad in (low - 1, low + 0.5):
        with pytest.raises(InputError, match=key):
            read(bad)
    if high is not None:
        assert read(high) == high
        with pytest.raises(InputError, match=key):
            read(high + 1)


@pytest.mark.parametrize("key, least", [("tau", 0.0), ("noise", 0.0), ("contact_radius", None), ("budget_seconds", None),
                                        ("learning_rate", None), ("final_learning_rate", None), ("clip_norm", None)])
def test_numbers_are_positive_or_at_least_zero(key, least):
    assert getattr(read_table(TrainConfig, {key: 1e-9}), key) == 1e-9
    with pytest.raises(InputError, match=key):
        read_table(TrainConfig, {key: -1e-9})
    if least is None:
        with pytest.raises(InputError, match=key):
            read_table(TrainConfig, {key: 0.0})
    else:
        assert getattr(read_table(TrainConfig, {key: 0.0}), key) == 0


@pytest.mark.parametrize("key, words", [("scheme", ("step", "pose")), ("modes", ("elastic", "laplacian")), ("segments", ("auto",)),
                                        ("method", ("metis", "slic-od", "slic-od-l", "slic-od-e", "slic-md", "slic-mdod-l",
                                                    "slic-mdod-e"))])
def test_words_are_among_the_known(key, words):
    for word in words:
        assert getattr(read_table(TrainConfig, {key: word}), key) == word
    with pytest.raises(InputError, match=key):
        read_table(TrainConfig, {key: words[0] + "x"})


def test_precisions_are_three():
    for word in ("float32", "medium", "bfloat16"):
        assert read_table(M4GNConfig, {"precision": word}).precision == word
    with pytest.raises(InputError, match="precision"):
        read_table(M4GNConfig, {"precision": "float16"})


def test_history_goes_with_steps_that_know_nothing_else():
    plain = TrainConfig(history=1)
    assert replace(plain, history=0, scheme="pose", estimate=True).history == 0
    for changes in ({"scheme": "pose"}, {"estimate": True}, {"scheme": "pose", "estimate": True}):
        with pytest.raises(InputError, match="history = 1"):
            replace(plain, **changes)


def test_a_file_is_read_and_what_is_wrong_with_it_named(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text('segments = 5\n[network]\nhidden = 32\n')
    assert load_config(path) == TrainConfig(segments=5, network=M4GNConfig(hidden=32))
    path.write_text("segmentz = 5\n")
    with pytest.raises(InputError, match=r"c\.toml: .*segments") as caught:
        load_config(path)
    assert "\n" not in str(caught.value)
