"""Tables into dataclasses: every kind of value, every bound from both sides, and the words of every refusal."""

from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
import pytest

from physics.scene import Body, Material, Scene, read_scene
from physics.schema import Bound, InputError, WorkError, missing, nearest, quantity, read_table, read_toml, to_table


@dataclass(frozen=True, kw_only=True)
class Inner:
    word: str = "a"
    number: float = quantity(unit="m", above=1, at_most=3)


@dataclass(frozen=True, kw_only=True)
class Outer:
    inner: Inner
    count: int = quantity(7, at_least=2, below=9)
    flag: bool = False
    size: tuple[float, float] | None = quantity(None, unit="s", above=0)
    many: tuple[int, ...] = ()
    path: tuple[tuple[float, float], ...] = quantity((), unit="m", at_least=-1)
    kind: str | None = quantity(None, choice=("first", "second"))
    either: float | str | None = None
    inners: tuple[Inner, ...] = field(default_factory=tuple)


def read(**table):
    return read_table(Outer, {"inner": {"number": 2}} | table)


def refused(words, **table):
    with pytest.raises(InputError) as caught:
        read(**table)
    assert str(caught.value) == words


def test_what_is_left_out_has_its_default_and_what_is_given_its_type():
    assert read() == Outer(inner=Inner(word="a", number=2.0), count=7, flag=False, size=None, many=(), path=(), kind=None, either=None,
                           inners=())
    full = read(count=8, flag=True, size=[1, 2.5], many=[3, 4, 5], path=[[0, -1], [2, 3]], kind="second", either="text",
                inners=[{"number": 1.5}, {"number": 3, "word": "b"}])
    assert full == Outer(inner=Inner(number=2.0), count=8, flag=True, size=(1.0, 2.5), many=(3, 4, 5), path=((0.0, -1.0), (2.0, 3.0)),
                         kind="second", either="text", inners=(Inner(number=1.5), Inner(word="b", number=3.0)))
    assert type(full.inner.number) is float and type(full.size[0]) is float and type(full.path[0][0]) is float
    assert read(either=2.5).either == 2.5 and read(either=2).either == 2.0


def test_every_bound_from_both_sides():
    assert read_table(Inner, {"number": 3}).number == 3 and read_table(Inner, {"number": 1.001}).number == 1.001
    refused("inner.number = 1.0: must be above 1 m", inner={"number": 1})
    refused("inner.number = 3.001: must be at most 3 m", inner={"number": 3.001})
    assert read(count=2).count == 2 and read(count=8).count == 8
    refused("count = 1: must be at least 2", count=1)
    refused("count = 9: must be below 9", count=9)
    refused("size = 0.0: must be above 0 s", size=[1.0, 0.0])
    refused("path = -1.5: must be at least -1 m", path=[[0, 0], [1, -1.5]])
    refused("kind = 'secnd': must be one of first, second; did you mean 'second'?", kind="secnd")
    for bound, inside, outside in ((Bound(above=1), 1.1, 1), (Bound(below=1), 0.9, 1), (Bound(at_least=1), 1, 0.9),
                                   (Bound(at_most=1), 1, 1.1)):
        bound.check(inside, "x")
        bound.check((inside, (inside, inside)), "x")
        for value in (outside, (inside, outside), (inside, (inside, outside)), ((inside,), outside)):
            with pytest.raises(InputError, match="^x = "):
                bound.check(value, "x")
    Bound().check(-1e300, "x")
    Bound().check("anything", "x")
    Bound(above=0).check("a word", "x")
    with pytest.raises(InputError, match="x = 'c': must be one of a, b$"):
        Bound(choice=("a", "b")).check(("a", "b", "c"), "x")


def test_every_refusal_says_where_and_what():
    with pytest.raises(InputError, match="^inner: missing$"):
        read_table(Outer, {})
    refused("inner.number: missing", inner={})
    refused("inner.nmber: unknown key; did you mean 'number'? inner takes word, number", inner={"nmber": 1})
    refused("qqqq: unknown key; the file takes " + ", ".join(field.name for field in fields(Outer)), qqqq=1)
    refused("inner must be a table, not a number", inner=1.5)
    with pytest.raises(InputError, match="^the file must be a table, not an array$"):
        read_table(Outer, [])
    refused("count must be an integer, not a number", count=2.0)
    refused("count must be an integer, not a boolean", count=True)
    refused("flag must be a boolean, not an integer", flag=1)
    refused("inner.word must be a string, not an integer", inner={"number": 2, "word": 1})
    refused("inner.number must be a number, not a boolean", inner={"number": True})
    refused("inner.number must be a number, not a string", inner={"number": "2"})
    refused("inner.number must be a number, not a table", inner={"number": {}})
    for value in ("nan", "inf", "-inf"):
        refused(f"inner.number = {value}: must be finite", inner={"number": float(value)})
    refused("size must be an array, not a number", size=1.0)
    refused("size must have 2 entries, not 3", size=[1, 2, 3])
    refused("size must have 2 entries, not 1", size=[1])
    refused("size[1] must be a number, not a string", size=[1, "2"])
    refused("path[1] must have 2 entries, not 1", path=[[1, 2], [3]])
    refused("path[1][0] must be a number, not a boolean", path=[[1, 2], [True, 3]])
    refused("inners[1].number: missing", inners=[{"number": 2}, {}])
    refused("inners must be an array, not a table", inners={"number": 2})
    refused("either must be a number, not a boolean", either=True)


def test_a_table_of_a_dataclass_is_read_back():
    outer = read(size=[1, 2], inners=[{"number": 2.5}], path=[[1, 2]])
    assert to_table(outer) == {"inner": {"word": "a", "number": 2.0}, "count": 7, "flag": False, "size": [1.0, 2.0], "many": [],
                               "path": [[1.0, 2.0]], "inners": [{"word": "a", "number": 2.5}]}  # without kind and either, which are None
    assert read_table(Outer, to_table(outer)) == outer


def test_files_are_read_as_toml_in_utf_8(tmp_path):
    (tmp_path / "a.toml").write_bytes('name = "Größe"\n[t]\nx = 1\n'.encode())
    assert read_toml(tmp_path / "a.toml") == {"name": "Größe", "t": {"x": 1}}
    for content in (b"x = ", "name = \"Größe\"".encode("latin-1")):
        (tmp_path / "b.toml").write_bytes(content)
        with pytest.raises(InputError, match=r"b.toml: not a TOML file: "):
            read_toml(tmp_path / "b.toml")
    with pytest.raises(InputError, match=r"none.toml: No such file or directory$"):
        read_toml(tmp_path / "none.toml")


def test_the_nearest_word_and_what_an_error_carries():
    assert nearest("lenght", ["width", "length"]) == "; did you mean 'length'?" and nearest("zzz", ["width"]) == ""
    assert nearest("widht", iter(["width"])) == "; did you mean 'width'?"
    assert WorkError("no").result is None and WorkError("no", {"a": 1}).result == {"a": 1} and str(WorkError("no")) == "no"
    assert isinstance(InputError("x"), ValueError)


def test_numbers_arrays_tuples_and_paths_are_taken_wherever_a_file_has_numbers_and_lists():
    """As people write them in Python: numpy's numbers and arrays, tuples, a path; the scene is the one of plain lists."""
    table = {"body": {"length": np.float64(0.06), "width": np.float32(0.25), "height": np.array(0.02), "cells": np.array([12, 4, 4])},
             "material": {"young_modulus": np.int64(1000000), "poisson_ratio": np.float64(0.4)},
             "support": ({"where": "x-min", "displacement": (0, np.float64(0.5), 0.0)},),
             "obstacle": {"shape": "cylinder", "radius": np.float64(0.01), "path": np.array([[0.05, 0.01, 0.03], [0.05, 0.01, 0.02]])},
             "steps": {"count": np.int32(7), "dynamic": np.bool_(True), "duration": np.float64(2.0)}}
    plain = {"body": {"length": 0.06, "width": 0.25, "height": 0.02, "cells": [12, 4, 4]},
             "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
             "support": [{"where": "x-min", "displacement": [0.0, 0.5, 0.0]}],
             "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.03], [0.05, 0.01, 0.02]]},
             "steps": {"count": 7, "dynamic": True, "duration": 2.0}}
    scene = read_scene(table)
    assert scene == read_scene(plain) and scene.to_toml() == read_scene(plain).to_toml()
    assert type(scene.obstacle.radius) is float and type(scene.steps.count) is int and type(scene.obstacle.path[0][0]) is float
    assert read_scene({**plain, "body": {"shape": "file", "path": Path("a") / "b.msh"}}).body.path == "a/b.msh"
    for key, value, words in (("count", np.float64(7.0), "must be an integer, not a number"), ("count", 0, "at least 1"),
                              ("duration", np.array([1.0, 2.0]), "must be a number, not an array"),
                              ("duration", np.float64("nan"), "must be finite")):
        with pytest.raises(InputError, match=rf"steps\.{key}.* {words}"):
            read_scene({**plain, "steps": {**plain["steps"], key: value}})


def test_numbers_of_numpy_in_a_dataclass_are_written_as_plain_ones():
    body = Body(length=np.float64(0.06), width=0.02, height=0.02, cells=np.array([12, 4, 4]))
    scene = Scene(body=body, material=Material(young_modulus=np.float32(2.0), poisson_ratio=0.25))
    assert Scene.from_toml(scene.to_toml()).body == Body(length=0.06, width=0.02, height=0.02, cells=(12, 4, 4))
    assert "np." not in scene.to_toml() and "young_modulus = 2.0" in scene.to_toml()


def test_what_is_missing_is_told_from_what_is_a_folder(tmp_path):
    (tmp_path / "there").write_text("")
    assert missing(tmp_path / "there") == "" and missing(tmp_path / "none") == "no such file"
    assert missing(tmp_path) == "no such file, but a folder"
