"""The keys of a config are told where people look for them: in the help and in the docs, with their own defaults and limits."""

import dataclasses
import tomllib

import fidelity
from learning.config import KINDS, TrainConfig
from learning.keys import at_once, help_text, network_table, others
from learning.networks.kinds import CONFIGS
from physics.keys import keys
from physics.schema import read_table, to_table


def test_every_key_of_a_training_is_explained_and_its_default_is_what_a_config_without_it_has():
    every = keys(TrainConfig)
    assert all(key.meaning and key.limits for key in every)
    written = "\n".join(f"{key.name} = {key.default}" for key in every if key.default != "none")
    assert read_table(TrainConfig, tomllib.loads(written)) == TrainConfig()
    assert {key.name.split(".")[0] for key in every} == {field.name for field in dataclasses.fields(TrainConfig)}
    config = to_table(TrainConfig())
    tables = [config[name] for name in ("network", "inputs", "outputs")]
    assert len(every) == len(config) - 3 + sum(map(len, tables)) + 2  # two are none by default


def test_every_key_of_every_kind_of_network_is_explained_and_in_the_table():
    for kind, config in list(CONFIGS.items())[1:]:
        own = {field.name for field in dataclasses.fields(config)} - {"kind"}
        some = next(found for about, found in others().items() if about.startswith(f"{kind}: "))
        assert {key.name for key in some} == {f"network.{name}" for name in own} and all(key.meaning for key in some)
        assert all(f'| "{kind}" | `network.{name}` |' in network_table() and f"  network.{name} " in help_text() for name in own)
        assert f"  network.kind = {kind}: " in help_text()


def test_every_key_of_a_predictor_of_all_poses_is_explained_once_and_with_its_own_default():
    assert list(at_once()) == ["sections and shapes", "sections", "shapes"]
    assert all(key.meaning and key.limits for some in at_once().values() for key in some)
    for kind, config in KINDS.items():
        written = "\n".join(f"{key.name} = {key.default}" for name, some in at_once().items() if kind in name for key in some
                            if key.default != "none")
        assert read_table(config, tomllib.loads(f'network.kind = "{kind}"\n{written}')) == config()
        assert f"  network.kind = {kind}" in help_text()


def test_the_help_of_train_lists_them(capsys):
    try:
        fidelity.main(["train", "--help"])
    except SystemExit as stop:
        assert stop.code == 0
    told = capsys.readouterr().out
    assert help_text() in told and "  budget_seconds             none           of training" in told and "--seconds" in told
