"""What `fidelity dataset VERB` takes, passes on, says and returns; the work itself is replaced."""

import argparse
from types import SimpleNamespace
from unittest.mock import ANY

import pytest

import datagen.sets.card
import datagen.sets.check
import datagen.sets.deepmind
import datagen.sets.pack
import datagen.sets.statistics
from datagen.verbs import VERBS, add_data_verbs
from physics.schema import WorkError


@pytest.fixture(scope="module")
def parse():
    parser = argparse.ArgumentParser()
    verbs = parser.add_subparsers(dest="verb")

    def verb(name, about, *positional):
        one = verbs.add_parser(name, help=about)
        for word in positional:
            one.add_argument(word)
        return one

    add_data_verbs(verb, lambda text: ("positive", int(text)), lambda text: ("count", int(text)), lambda text: ("seed", int(text)))
    return lambda *words: vars(parser.parse_args(words))


@pytest.mark.parametrize(("words", "options"), [
    (["check", "F"], {"folder": "F", "steps": 5}), (["check", "F", "--steps", "3"], {"folder": "F", "steps": ("positive", 3)}),
    (["stats", "F"], {"folder": "F", "refined": 0, "seed": 0}),
    (["stats", "F", "--refined", "2", "--seed", "7"], {"folder": "F", "refined": ("count", 2), "seed": ("seed", 7)}),
    (["card", "F"], {"folder": "F", "refined": None}), (["card", "F", "--refined", "0"], {"folder": "F", "refined": ("count", 0)}),
    (["pack", "F", "--out", "P"], {"folder": "F", "out": "P", "tolerance": None, "share": None}),
    (["pack", "F", "--out", "P", "--tolerance", "2e-3"], {"folder": "F", "out": "P", "tolerance": 2e-3, "share": None}),
    (["pack", "F", "--out", "P", "--share", "0.1"], {"folder": "F", "out": "P", "tolerance": None, "share": 0.1}),
    (["unpack", "P", "--out", "F"], {"file": "P", "out": "F"}),
    (["import", "F", "--out", "G"], {"folder": "F", "out": "G", "count": None}),
    (["import", "F", "--out", "G", "--count", "4"], {"folder": "F", "out": "G", "count": ("positive", 4)}),
    (["export", "F", "--out", "G"], {"folder": "F", "out": "G", "cells": "tetrahedra"}),
    (["export", "F", "--out", "G", "--cells", "own"], {"folder": "F", "out": "G", "cells": "own"})])
def test_what_each_verb_takes(parse, words, options):
    assert parse(*words) == {"verb": words[0], **options}


@pytest.mark.parametrize("words", [["pack", "F"], ["unpack", "P"], ["import", "F"], ["export", "F"], ["check"],
                                   ["export", "F", "--out", "G", "--cells", "x"]])
def test_what_must_be_given(parse, words):
    with pytest.raises(SystemExit):
        parse(*words)


@pytest.fixture
def verb(monkeypatch):
    """A verb run with options and the function that does its work replaced: what it was given, what was said, what came back."""
    def run(name, where, function, result, **options):
        given, said = [], []

        def work(*arguments, **keywords):
            given.append((*arguments, keywords))
            return result

        monkeypatch.setattr(where, function, work)

        def writable(path, *suffix):
            return f"writable {path}{''.join(suffix)}"

        return VERBS[name](SimpleNamespace(**options), say=said.append, writable=writable), given, said

    return run


def test_the_check_says_every_problem_and_fails_with_their_number(verb):
    assert verb("check", datagen.sets.check, "check", [], folder="F", steps=4) == (
        {"problems": []}, [("F", {"steps": 4, "remark": ANY})], ["F: nothing wrong"])
    for problems, words in ((["a"], "1 problem in F: a"), (["a", "b"], "2 problems in F: a")):
        with pytest.raises(WorkError) as error:
            verb("check", datagen.sets.check, "check", problems, folder="F", steps=4)
        assert str(error.value) == words and error.value.result == {"problems": problems}


def test_the_other_verbs_pass_on_what_they_were_given_and_say_what_came_back(verb, tmp_path):
    assert verb("stats", datagen.sets.statistics, "statistics", {"count": 3}, folder="F", refined=2, seed=7) == (
        {"count": 3}, [("F", {"refined": 2, "seed": 7})], ["count                  3"])
    assert verb("card", datagen.sets.card, "write_card", tmp_path, folder="F", refined=2) == (
        {"out": str(tmp_path)}, [("F", {"refined": 2})], [f"card: {tmp_path}"])
    packed = {"trajectories": 3, "bytes": 2_345_678, "ratio": 45.6, "largest_error": 9.8765e-7}
    assert verb("pack", datagen.sets.pack, "pack", packed, folder="F", out="P", tolerance=0.5, share=0.01) == (
        packed, [("F", "writable P.pack", {"tolerance": 0.5, "share": 0.01})],
        ["3 trajectories, 2.35 MB, 46 times smaller, largest error 9.88e-07 m: writable P.pack"])
    some = {"trajectories": 3}
    assert verb("unpack", datagen.sets.pack, "unpack", some, file="P", out="G") == (some, [("P", "writable G", {})], ["3 trajectories: G"])
    assert verb("import", datagen.sets.deepmind, "import_records", some, folder="F", out="G", count=4) == (
        some, [("F", "writable G", {"count": 4})], ["3 trajectories: G"])
    assert verb("export", datagen.sets.deepmind, "export_records", some, folder="F", out="G", cells="own") == (
        some, [("F", "writable G", {"cells": "own"})], ["3 trajectories: G"])
    assert list(VERBS) == ["check", "stats", "card", "pack", "unpack", "import", "export"]
