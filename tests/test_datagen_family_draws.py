"""Draws by numpy's own generator, key by key, and counts of splits by hand."""

import zlib

import numpy as np
import pytest

from datagen.family.family import LARGEST_SPLIT, SPLITS, Family, Splits, counts, draw, load_family, merged
from datagen.sets.generate import jobs_of
from physics.schema import InputError, read_table

TABLE = {"body": {"length": 0.5, "width": 0.3, "height": 0.2, "cells": [2, 2, 2]}, "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}}


def u(name, seed, index, attempt=0):
    """`Generator.random` is the upper 53 bits of a raw number of 64 over 2^53; a stream for each key of a scene."""
    seeds = np.random.SeedSequence(seed, spawn_key=(index, attempt, zlib.crc32(name.encode())))
    return np.random.Generator(np.random.Philox(seeds)).random()


def family(**table):
    return Family("x", "", TABLE | table, Splits())


KEYS = [(0, 0, 0), (0, 1, 0), (7, 0, 0), (7, 3, 2), (1, 2_000_001, 4)]


@pytest.mark.parametrize("key", KEYS)
def test_every_key_is_drawn_by_its_own_name(key):
    one = family(
        body=TABLE["body"] | {"length": {"uniform": [0.2, 0.9]}, "cells": [{"choice": [2, 3, 4, 5, 6]}, 2, {"choice": [1, 7]}]},
        material={"young_modulus": {"log-uniform": [10, 1e7]}, "poisson_ratio": {"uniform": [-0.5, 0.25]}},
        support=[{"where": "x-min"}, {"choice": [{"where": "x-max", "displacement": [{"uniform": [1, 2]}, 0, 0]},
                                                 {"where": "y-max", "displacement": [0, {"uniform": [-3, -1]}, 0]},
                                                 {"where": "z-max", "displacement": [0, 0, 5]}]}])
    scene = draw(one, *key)
    assert scene.body.length == pytest.approx(0.2 + 0.7 * u("body.length", *key), rel=1e-15)
    assert scene.body.cells == ([2, 3, 4, 5, 6][int(5 * u("body.cells[0]", *key))], 2, [1, 7][int(2 * u("body.cells[2]", *key))])
    assert scene.material.young_modulus == pytest.approx(10 ** (1 + 6 * u("material.young_modulus", *key)), rel=1e-13)
    assert scene.material.poisson_ratio == pytest.approx(-0.5 + 0.75 * u("material.poisson_ratio", *key), rel=1e-14)
    chosen = int(3 * u("support[1]", *key))
    moved = {0: (1 + u("support[1].choice[0].displacement[0]", *key), 0, 0),
             1: (0, -3 + 2 * u("support[1].choice[1].displacement[1]", *key), 0), 2: (0, 0, 5)}[chosen]
    assert scene.support[1].where == ("x-max", "y-max", "z-max")[chosen]
    assert scene.support[1].displacement == pytest.approx(moved, rel=1e-14)


def test_cases_are_drawn_in_proportion_to_their_weights():
    """Weights 1.5, 1 (left out) and 2.5: u from 0 to 0.3, from 0.3 to 0.5, and the rest, for forty scenes."""
    one = family(case=[{"weight": 1.5, "name": "a"}, {"name": "b"}, {"weight": 2.5, "name": "c"}])
    names = [draw(one, 2, index).name for index in range(40)]
    assert names == ["a" if u("case", 2, i) < 0.3 else "b" if u("case", 2, i) < 0.5 else "c" for i in range(40)]
    assert set(names) == {"a", "b", "c"}
    assert draw(family(case=[{"name": "only"}]), 0, 0).name == "only" and draw(family(case=[]), 0, 0).name == "scene"


def test_a_case_replaces_values_and_joins_tables_but_never_ranges():
    def of(below, above):
        return draw(family(body=TABLE["body"] | {"length": below}, case=[{"body": {"length": above}}]), 0, 0).body.length

    assert of({"uniform": [0.1, 0.2]}, 0.7) == 0.7
    assert 0.3 <= of(0.7, {"uniform": [0.3, 0.4]}) < 0.4
    assert of({"uniform": [0.1, 0.2]}, {"choice": [0.7]}) == 0.7 and 0.3 <= of({"choice": [0.7]}, {"log-uniform": [0.3, 0.4]}) < 0.4
    whole = draw(family(case=[{"body": {"choice": [TABLE["body"] | {"height": 0.9}]}}]), 0, 0)
    assert whole.body.height == 0.9
    joined = draw(family(body={"width": 0.3, "cells": [2, 2, 2]}, case=[{"body": {"length": 0.4, "height": 0.6}}]), 0, 0)
    assert joined.body.extent == (0.4, 0.3, 0.6)


@pytest.mark.parametrize("case", [{"weight": 1}, ["x"], [{"weight": 0}], [{"weight": -1}], [{"weight": float("inf")}], [{"weight": True}],
                                  [{"weight": float("nan")}], [{}, {"weight": "2"}]])
def test_wrong_cases_are_refused(case):
    with pytest.raises(InputError, match="case"):
        draw(family(case=case), 0, 0)


@pytest.mark.parametrize(("given", "value"), [
    ({"uniform": [0.25, 0.25]}, 0.25), ({"log-uniform": [0.25, 0.25]}, 0.25), ({"choice": [0.25]}, 0.25), ({"uniform": [1, 1]}, 1.0),
    ({"log-uniform": [1e-8, 1e-8]}, 1e-8)])
def test_ranges_of_one_value_are_that_value(given, value):
    assert draw(family(body=TABLE["body"] | {"length": given}), 0, 0).body.length == value


@pytest.mark.parametrize("given", [
    {"uniform": [1, 0.5]}, {"uniform": [1, 2, 3]}, {"uniform": [1]}, {"uniform": 1}, {"uniform": [True, 2]}, {"uniform": ["1", 2]},
    {"uniform": [1, float("inf")]}, {"uniform": [float("-inf"), 1]}, {"uniform": [float("nan"), 1]}, {"log-uniform": [0, 1]},
    {"log-uniform": [-1, 1]}, {"choice": []}, {"choice": 3}, {"choice": {"a": 1}}, {"uniform": [1, 2], "choice": [1]},
    {"uniform": [1, 2], "x": 1}])
def test_wrong_ranges_are_refused(given):
    with pytest.raises(InputError, match=r"body\.length"):
        draw(family(body=TABLE["body"] | {"length": given}), 0, 0)


# ---- splits


def test_every_split_and_index_and_seed_has_a_scene_of_its_own_that_repeats(tmp_path):
    one = family(body=TABLE["body"] | {"length": {"uniform": [0.1, 0.9]}})
    wanted = {"train": 3, "valid": 2, "test": 2}
    jobs = jobs_of(one, wanted, tmp_path, 4)
    assert [(job.file, job.seed, job.index, job.out) for job in jobs] == [(file, 4, index, tmp_path) for file, index in (
        ("train/0000.vtkhdf", 0), ("train/0001.vtkhdf", 1), ("train/0002.vtkhdf", 2), ("valid/0000.vtkhdf", 1_000_000),
        ("valid/0001.vtkhdf", 1_000_001), ("test/0000.vtkhdf", 2_000_000), ("test/0001.vtkhdf", 2_000_001))]
    lengths = [draw(one, seed, job.index, attempt).body.length for job in jobs for seed in (4, 5) for attempt in (0, 1)]
    assert len(set(lengths)) == 7 * 2 * 2  # no scene of one split, seed or attempt in another
    assert lengths == [draw(one, seed, job.index, attempt).body.length for job in jobs for seed in (4, 5) for attempt in (0, 1)]
    assert [job.index for job in jobs_of(one, {"test": 1}, tmp_path, 0)] == [2_000_000]  # wherever it stands
    with pytest.raises(InputError, match="seed = -1"):
        jobs_of(one, wanted, tmp_path, -1)


def of(train, valid, test):
    return Family("x", "", TABLE, Splits(train=train, valid=valid, test=test))


@pytest.mark.parametrize(("own", "count", "expected"), [
    # ends at 355, 395 and 455 of 455: 7.80, 8.68 and 10 of 10, rounded to the nearest
    ((355, 40, 60), 10, {"train": 8, "valid": 1, "test": 1}), ((355, 40, 60), 4, {"train": 3, "test": 1}),
    ((355, 40, 60), 1, {"train": 1}), ((8, 1, 1), 5, {"train": 4, "valid": 1}),  # ends at 4, 4.5 and 5: a half goes up
    ((1, 1, 0), 1, {"train": 1}), ((1, 1, 0), 5, {"train": 3, "valid": 2}), ((0, 0, 1), 4, {"test": 4}), ((0, 3, 0), 2, {"valid": 2}),
    ((8, 1, 1), None, {"train": 8, "valid": 1, "test": 1}), ((2, 0, 1), None, {"train": 2, "test": 1}), ((0, 1, 0), None, {"valid": 1})])
def test_counts_of_splits_end_where_the_familys_own_would_rounded_to_the_nearest(own, count, expected):
    assert counts(of(*own), count=count) == expected


def test_counts_of_one_split():
    assert counts(of(3, 0, 1), split="train") == {"train": 3} and counts(of(3, 0, 1), split="valid", count=2) == {"valid": 2}
    for wrong in ({"split": "valid"}, {"split": "valid", "count": 0}, {"split": "train", "count": -1}, {"count": 0}, {"count": -1}):
        with pytest.raises(InputError, match=f"{wrong.get('count', 0)} trajectories asked for: must be at least 1"):
            counts(of(3, 0, 1), **wrong)
    with pytest.raises(InputError, match="0 trajectories asked for"):
        counts(of(0, 0, 0))


def test_a_split_is_no_larger_than_the_distance_to_the_next():
    assert LARGEST_SPLIT == 1_000_000 and counts(of(1, 0, 0), count=1_000_000) == {"train": 1_000_000}
    with pytest.raises(InputError, match="1000001 trajectories of one split"):
        counts(of(1, 0, 0), count=1_000_001)
    for name in SPLITS:
        assert getattr(read_table(Splits, {name: 0}), name) == 0 and getattr(read_table(Splits, {name: 1_000_000}), name) == 1_000_000
        for wrong in (-1, 1_000_001):
            with pytest.raises(InputError, match=name):
                read_table(Splits, {name: wrong})


def test_a_family_file_names_itself_and_may_leave_out_its_splits(tmp_path):
    text = "[body]\nlength = 0.5\nwidth = 0.3\nheight = 0.2\ncells = [2, 2, 2]\n[material]\nyoung_modulus = 1e6\npoisson_ratio = 0.3\n"
    (tmp_path / "bare.toml").write_text(text)
    bare = load_family(tmp_path / "bare.toml")
    assert (bare.name, bare.text, "splits" in bare.table) == ("bare", text, False)
    assert counts(bare) == {"train": 8, "valid": 1, "test": 1}
    (tmp_path / "bare.toml").write_text('name = "other"\n' + text + "[splits]\ntest = 4\n")
    named = load_family(tmp_path / "bare.toml")
    assert named.name == "other" and counts(named) == {"train": 8, "valid": 1, "test": 4} and "splits" not in named.table


def test_a_family_may_ask_for_an_error_in_place_of_a_mesh_and_is_refused_with_both():
    sides = {"length": 0.5, "width": 0.3, "height": 0.2}
    scene = draw(family(body=sides, steps={"error": {"choice": [0.01]}, "quantity": "reaction"}), 0, 0)
    assert (scene.steps.error, scene.steps.quantity, scene.body.cells) == (0.01, "reaction", None)
    with pytest.raises(InputError, match="^body.cells: steps.error decides"):
        draw(family(body=sides | {"cells": [2, 2, 2]}, steps={"error": 0.01}), 0, 0)


def test_tables_lie_one_over_the_other_those_in_them_too_but_a_range_is_replaced():
    below = {"a": 1, "b": {"c": 1, "d": {"e": 1}}, "f": {"g": 1}, "h": {"uniform": [0, 1]}}
    assert merged(below, {"b": {"d": {"h": 2}}, "f": 3, "h": {"choice": [5]}, "i": {"j": 4}}) == {
        "a": 1, "b": {"c": 1, "d": {"e": 1, "h": 2}}, "f": 3, "h": {"choice": [5]}, "i": {"j": 4}}
    assert merged(below, {"a": {"k": 5}})["a"] == {"k": 5}
    assert below == {"a": 1, "b": {"c": 1, "d": {"e": 1}}, "f": {"g": 1}, "h": {"uniform": [0, 1]}}
