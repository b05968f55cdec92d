"""The keys of a config are told where people look for them: in the help and in the docs, with their own defaults and limits."""

import dataclasses
import tomllib

import fidelity
from learning.config import TrainConfig
from learning.keys import Key, help_text, keys, network_table, others, table
from learning.networks.kinds import CONFIGS
from physics.schema import quantity, read_table, to_table
from tests.pages import ROOT


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inner:
    """Something.

    width: how wide
    """

    width: int = quantity(3, at_least=1, at_most=9)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Made:
    """Nothing of note: but words.

    rate, last: of learning
        and more of it
    word: what is said
    """

    rate: float = quantity(unit="m", above=0)
    last: float | None = quantity(None, below=2)
    word: str = quantity("a", choice=("a", "b"))
    inner: Inner = dataclasses.field(default_factory=Inner)
    flag: bool = True


def test_a_key_has_its_default_its_limits_and_its_line_of_the_docstring():
    assert keys(Made) == [Key("rate", "needed", "above 0 m", "of learning and more of it"),
                          Key("last", "none", "below 2", "of learning and more of it"), Key("word", '"a"', '"a" or "b"', "what is said"),
                          Key("inner.width", "3", "from 1 to 9", "how wide"), Key("flag", "true", "true or false", "")]


def test_every_key_of_a_training_is_explained_and_its_default_is_what_a_config_without_it_has():
    every = keys()
    assert all(key.meaning and key.limits for key in every)
    written = "\n".join(f"{key.name} = {key.default}" for key in every if key.default != "none")
    assert read_table(TrainConfig, tomllib.loads(written)) == TrainConfig()
    assert {key.name.split(".")[0] for key in every} == {field.name for field in dataclasses.fields(TrainConfig)}
    config = to_table(TrainConfig())
    assert len(every) == len(config) - 2 + len(config["network"]) + len(config["outputs"]) + 2  # two are none by default


def test_the_table_of_the_docs_is_the_one_that_is_made():
    page = (ROOT / "docs" / "network.md").read_text()
    assert table() in page and network_table() in page


def test_every_key_of_every_kind_of_network_is_explained_and_in_the_table():
    for kind, config in list(CONFIGS.items())[1:]:
        own = {field.name for field in dataclasses.fields(config)} - {"kind"}
        some = next(found for about, found in others().items() if about.startswith(f"{kind}: "))
        assert {key.name for key in some} == {f"network.{name}" for name in own} and all(key.meaning for key in some)
        assert all(f'| "{kind}" | `network.{name}` |' in network_table() and f"  network.{name} " in help_text() for name in own)
        assert f"  network.kind = {kind}: " in help_text()


def test_the_help_of_train_lists_them(capsys):
    try:
        fidelity.main(["train", "--help"])
    except SystemExit as stop:
        assert stop.code == 0
    told = capsys.readouterr().out
    assert help_text() in told and "  budget_seconds             none           of training" in told and "--seconds" in told
