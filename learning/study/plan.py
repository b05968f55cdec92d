"""What a study file asks for: which trainings, on which data, tested on what. A file of learning/studies/, or anybody's own.

    title, about    what is asked, in words; `source`: where published figures come from
    like            another study, whose sizes, base and tests hold where this one has none of its own
    [base]          keys of every training's config
    [[row]]         one line of the table: `name`, `set` (keys of its config), `published` (figure to value or [mean, deviation]
                    in SI units; in a table of a test's name for another than the first)
    [grid]          key with dots to a list of values: every row at every combination of them
    [[test]]        what trained networks are tested on: `name`; a `family` of its own, else the test split of the data; `set`: changes
                    to the config as in segments = 38. Without any: the test split
    [check], [small], [paper]    the sizes:
        seeds       trainings of each row, seeds 0, 1, ...
        data        family, train, valid, test (how many of each), seed, set (keys of the family)
        set         keys of every training's config
        networks    keys of [network] by its kind; `all` for every kind

A training's config is made of base, the size's `set`, the row's `set` and its point of the grid, the later one first; keys of
[network] stand above those of `networks`.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any

import tomli_w

from datagen.family.family import FOLDER as FAMILIES
from datagen.family.family import Family, Splits, draw, load_family, merged
from learning.config import TrainConfig
from physics.schema import InputError, nearest, quantity, read_table, read_toml, shown
from physics.whole import write_whole

FOLDER = Path(__file__).parents[1] / "studies"
SIZES = ("check", "small", "paper")
WORDS = ("title", "about", "source", "like")
TABLES = ("base", "grid", *SIZES)
SHARED = ("base", "test", *SIZES)  # what a study has from the one it is like
Published = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Data:
    """A set to be made: how many trajectories of a family's splits, and the seed of its draws."""

    family: str
    train: int = quantity(0, at_least=0, at_most=100_000)
    valid: int = quantity(0, at_least=0, at_most=100_000)
    test: int = quantity(1, at_least=1, at_most=100_000)
    seed: int = quantity(0, at_least=0)

    @property
    def splits(self) -> dict[str, int]:
        """How many of each."""
        return {name: count for name in ("train", "valid", "test") if (count := getattr(self, name))}


@dataclass(frozen=True)
class Trial:
    """What trained networks are tested on: the name of a set in the study's folder, and changes to the config."""

    name: str
    data: str
    change: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Line:
    """One line of the table: its config but for the seed, and published figures by test and name as (mean, deviation or nan)."""

    name: str
    config: TrainConfig
    published: dict[str, Published]


@dataclass(frozen=True)
class Plan:
    """A study at a size.

    sets: the data by name, each a family's table and what is made of it; the first is what is trained on
    """

    title: str
    about: str
    source: str
    size: str
    seeds: int
    rows: tuple[Line, ...]
    tests: tuple[Trial, ...]
    sets: dict[str, tuple[dict[str, Any], Data]]


def load_plan(path: str | Path, size: str) -> Plan:
    """A study from a file, or one of the package's by its short name. Raises `InputError` in one line when anything about it is wrong."""
    if size not in SIZES:
        raise InputError(f"--size {size}: must be one of {', '.join(SIZES)}")
    file = study_file(path)
    try:
        return _planned(_whole(file), size)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def study_file(name: str | Path) -> Path:
    """The file of a study. Raises `InputError`."""
    if Path(name).suffix == ".toml":
        return Path(name)
    known = {file.stem: file for file in sorted(FOLDER.glob("*.toml"))}
    if str(name) not in known:
        raise InputError(f"no study {str(name)!r}: give a .toml file or one of {', '.join(known)}{nearest(str(name), known)}")
    return known[str(name)]


def family_of(table: dict[str, Any], path: Path) -> Family:
    """The family of a set, written to a file of its own. Raises `InputError`."""
    write_whole(path, tomli_w.dumps(table).encode())
    return load_family(path)


def _whole(file: Path, depth: int = 0) -> dict[str, Any]:
    """A study file with what it has from the one it is like."""
    table = read_toml(file)
    if not (like := table.get("like")):
        return table
    if depth > 3:
        raise InputError(f"like = {shown(like)}: a chain of studies that does not end")
    other = _whole(file.with_name(f"{like}.toml") if file.with_name(f"{like}.toml").exists() else study_file(str(like)), depth + 1)
    shared = {key: other[key] for key in SHARED if key in other}
    both = {key for key in shared if isinstance(shared[key], dict) and isinstance(table.get(key), dict)}
    return shared | table | {key: merged(shared[key], table[key]) for key in both}


def _planned(table: dict[str, Any], size: str) -> Plan:
    _known(table, (*WORDS, *TABLES, "row", "test"), "a study")
    for key in TABLES:
        if not isinstance(table.get(key, {}), dict):
            raise InputError(f"{key} must be a table")
    if size not in table:
        raise InputError(f"{size}: no such size in this study; it has {', '.join(key for key in SIZES if key in table) or 'none'}")
    own = table[size]
    _known(own, ("seeds", "data", "set", "networks"), size)
    seeds = own.get("seeds", 1)
    if type(seeds) is not int or not 1 <= seeds <= 100:
        raise InputError(f"{size}.seeds = {shown(seeds)}: must be a whole number from 1 to 100")
    sets = {"data": _data(own.get("data"), f"{size}.data")}
    if not sets["data"][1].train:
        raise InputError(f"{size}.data.train: must be at least 1, for there is something to train")
    keys = own["data"].get("set", {})
    tests = tuple(_test(each, f"test[{i}]", keys, sets) for i, each in enumerate(_list(table, "test"))) or (Trial("test", "data"),)
    grid = table.get("grid", {})
    if not all(isinstance(values, list) and values for values in grid.values()):
        raise InputError("grid: must be a table of lists of values, keys with dots in quotes")
    rows = [row for i, each in enumerate(_list(table, "row")) for row in _rows(each, f"row[{i}]", table.get("base", {}), own, grid, tests)]
    names = [row.name for row in rows]
    if not rows or len({slug(name) for name in names}) < len(names):
        raise InputError("row: at least one is needed, each with a name of its own")
    title, about, source = (str(table.get(key, "")).strip() for key in WORDS[:3])
    return Plan(title or "a study", about, source, size, seeds, tuple(rows), tests, sets)


def _known(table: dict[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in keys:
            raise InputError(f"{key}: unknown key{nearest(key, keys) or ';'} {where} takes {', '.join(keys)}")


def slug(name: str) -> str:
    """A name as a folder's."""
    return re.sub(r"[^A-Za-z0-9.+-]+", "-", name).strip("-") or "row"


def _list(table: dict[str, Any], key: str) -> list[dict[str, Any]]:
    found = table.get(key, [])
    if not isinstance(found, list) or not all(isinstance(each, dict) and isinstance(each.get("name"), str) for each in found):
        raise InputError(f"{key}: must be tables [[{key}]], each with a name")
    return found


def _data(table: Any, where: str) -> tuple[dict[str, Any], Data]:
    if not isinstance(table, dict):
        raise InputError(f"{where}: missing")
    data = read_table(Data, {key: value for key, value in table.items() if key != "set"}, where)
    path = FAMILIES / f"{data.family}.toml"
    if not path.exists():
        known = [file.stem for file in sorted(FAMILIES.glob("*.toml"))]
        raise InputError(f"{where}.family = {shown(data.family)}: must be one of {', '.join(known)}{nearest(data.family, known)}")
    changed = merged(read_toml(path), table.get("set", {}))
    try:
        draw(Family(data.family, "", {key: value for key, value in changed.items() if key != "splits"}, Splits()), 0, 0)
    except InputError as error:
        raise InputError(f"{where}.set: {error}") from None
    return changed, data


def _test(table: dict[str, Any], where: str, keys: dict[str, Any], sets: dict[str, tuple[dict[str, Any], Data]]) -> Trial:
    """A test; a family of its own joins the sets, changed as the data's is, as many trajectories of it as are tested of the data."""
    _known(table, ("name", "family", "set"), where)
    change = table.get("set", {})
    if "family" not in table:
        return Trial(table["name"], "data", change)
    own, made = _data({"family": table["family"], "set": keys}, where)
    sets[made.family] = own, replace(sets["data"][1], family=made.family, train=0, valid=0)
    return Trial(table["name"], made.family, change)


def _rows(table: dict[str, Any], where: str, base: dict[str, Any], size: dict[str, Any], grid: dict[str, list[Any]],
          tests: tuple[Trial, ...]) -> list[Line]:
    """A row at every point of the grid."""
    _known(table, ("name", "set", "published"), where)
    published = _published(table.get("published", {}), f"{where}.published", tests)
    rows = []
    for values in itertools.product(*grid.values()):
        point: dict[str, Any] = {}
        for key, value in zip(grid, values, strict=True):
            point = merged(point, _nested(key, value))
        keys = reduce(merged, [base, size.get("set", {}), table.get("set", {}), point])
        network, sizes = keys.get("network", {}), size.get("networks", {})
        keys["network"] = reduce(merged, [sizes.get("all", {}), sizes.get(network.get("kind", "m4gn"), {}), network])
        name = ", ".join([table["name"], *(f"{key.split('.')[-1]} {value}" for key, value in zip(grid, values, strict=True))])
        try:
            rows.append(Line(name, read_table(TrainConfig, keys), published))
        except InputError as error:
            raise InputError(f"{where} ({name}): {error}") from None
    return rows


def _nested(key: str, value: Any) -> dict[str, Any]:
    for part in reversed(key.split(".")):
        value = {part: value}
    return dict(value)


def _published(table: Any, where: str, tests: tuple[Trial, ...]) -> dict[str, Published]:
    """Published figures by test; those that stand beside no test's name are of the first one."""
    if not isinstance(table, dict):
        raise InputError(f"{where}: must be a table")
    named = {test.name: table[test.name] for test in tests if isinstance(table.get(test.name), dict)}
    plain = {key: value for key, value in table.items() if key not in named}
    return {name: {key: _pair(value, f"{where}.{key}") for key, value in figures.items()}
            for name, figures in ({tests[0].name: plain} | named).items()}


def _pair(value: Any, where: str) -> tuple[float, float]:
    numbers = value if isinstance(value, list) else [value, float("nan")]
    if len(numbers) != 2 or not all(isinstance(number, int | float) for number in numbers):
        raise InputError(f"{where} = {shown(value)}: must be a number, or a mean and a deviation")
    return float(numbers[0]), float(numbers[1])
