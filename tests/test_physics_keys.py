"""The keys of a file are told where people look for them, with their own defaults and limits."""

import dataclasses

from physics.keys import SCENE, Key, keys, scene_table, table
from physics.schema import quantity
from tests.pages import ROOT


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inner:
    """Something.

    width: how wide
    """

    width: int = quantity(3, at_least=1, at_most=9)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Base:
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Made(Base):
    """More.

    word: what else is said
    path: of points
    """

    word: str = ""
    path: tuple[tuple[float, float], ...] = ()
    pair: tuple[float, float, float] | None = quantity((0.0, 0.5, 1.0), unit="s", above=0, at_least=1e-9, at_most=2e9)
    many: tuple[int, ...] | None = quantity(None, at_least=1)
    number: int | str = quantity(1, at_least=1, at_most=100_000, choice=("auto",))


def test_a_key_has_its_default_its_limits_and_its_line_of_the_docstring():
    assert keys(Base) == [Key("rate", "needed", "above 0 m", "of learning and more of it"),
                          Key("last", "none", "below 2", "of learning and more of it"), Key("word", '"a"', '"a" or "b"', "what is said"),
                          Key("inner.width", "3", "from 1 to 9", "how wide"), Key("flag", "true", "true or false", "")]


def test_a_heir_keeps_what_is_told_of_its_keys_unless_it_tells_more_and_points_and_numbers_are_counted():
    found = {key.name: key for key in keys(Made)}
    assert found["rate"].meaning == "of learning and more of it"
    assert found["word"] == Key("word", '""', "text", "what else is said")
    assert found["path"] == Key("path", "[]", "points of two numbers", "of points")
    assert found["pair"] == Key("pair", "[0.0, 0.5, 1.0]", "three numbers from 1e-09 to 2e9 s", "")
    assert found["many"].limits == "numbers from 1" and found["number"].limits == 'from 1 to 100000 or "auto"'


def test_a_table_has_its_rows_under_its_heads():
    assert table([Key("a", "1", "from 0", "").entries]) == ("| key | default | limits | what it is |\n| --- | --- | --- | --- |\n"
                                                           "| `a` | 1 | from 0 | |")


def test_every_key_of_a_scene_is_explained_and_stands_on_its_page():
    page = (ROOT / "docs" / "scene.md").read_text()
    for name, kind in SCENE.items():
        assert f"python -m physics.keys {name} -->\n{scene_table(name)}\n<!-- end -->" in page
        for key in keys(kind):
            assert key.meaning and key.limits and f"| `{key.name}` | {key.default} | {key.limits} | {key.meaning} |" in scene_table(name)
