"""A family of scenes: a scene file whose values may be ranges, and whose obstacles may be placed relative to the body.

    length = { uniform = [0.1, 0.12] }                  any number, also inside arrays
    young_modulus = { log-uniform = [1e5, 1e7] }
    cell = { choice = ["prism", "hexahedron"] }         any values, whole arrays and tables too, with ranges of their own

    height = { grid = [0.01, 0.02, 0.04] }              every value in turn, with those of all other grids in every combination

    [obstacle.place]                                    instead of path: from outside onto a face, and on; see place.py
    face = "z-max"
    depth = { uniform = [0.015, 0.03] }

    [[case]]                                            one of these tables is drawn and laid over the rest: for values
    weight = 2                                          that belong together; how often, in proportion (1)
    support = [{ where = "x-min" }]
    obstacle.place.along = 0.9

    [splits]                                            how many trajectories of each kind, unless asked otherwise
    train = 8

A family is data: nothing in it is evaluated. A draw depends on (seed, index, attempt) and on the name of each key, and on
nothing else: not on the order of keys, the number of scenes, or who draws them. Each key's number u in [0, 1) comes from
the raw bits of numpy's Philox, whose stream is the same in every version.

The number of a scene within its split chooses the point of a grid. Where there is one, all its points are what a family makes
unless [splits] says otherwise; a grid stands outside of cases, choices and other grids.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datagen.family.place import placed
from physics.scene import beside, read_any
from physics.schema import InputError, nearest, quantity, read_table, read_toml

LARGEST_SPLIT = 1_000_000  # indices of the next split begin there, so that each can grow by itself
FOLDER = Path(__file__).parents[1] / "families"
SPLITS = ("train", "valid", "test")
RANGES = ("uniform", "log-uniform", "choice", "grid")


@dataclass(frozen=True, kw_only=True)
class Splits:
    """How many trajectories of each kind."""

    train: int = quantity(8, at_least=0, at_most=1_000_000)
    valid: int = quantity(1, at_least=0, at_most=1_000_000)
    test: int = quantity(1, at_least=0, at_most=1_000_000)


@dataclass(frozen=True)
class Family:
    """A family as it stands in its file, in a folder: `table` is what TOML made of `text`, without [splits]."""

    name: str
    text: str
    table: dict[str, Any]
    splits: Splits
    folder: Path = Path()


def load_family(name: str | Path) -> Family:
    """A family from a file, or one of the package's by its short name.

    Raises:
        InputError: there is none, a range is wrong, or a scene drawn from it is
    """
    path = Path(name)
    if path.suffix != ".toml":
        known = {file.stem: file for file in sorted(FOLDER.glob("*.toml"))}
        if str(name) not in known:
            known_words = f"{', '.join(known)}{nearest(str(name), known)}"
            raise InputError(f"no family {str(name)!r}: give a .toml file or one of {known_words}")
        path = known[str(name)]
    table = read_toml(path)
    try:
        whole = Splits(train=min(points(table), LARGEST_SPLIT), valid=0, test=0) if points(table) > 1 else Splits()
        splits = read_table(Splits, table.pop("splits"), "splits") if "splits" in table else whole
        family = Family(str(table.get("name", path.stem)), path.read_text(), table, splits, path.parent)
        draw(family, 0, 0)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return family


def counts(family: Family, *, count: int | None = None, split: str | None = None) -> dict[str, int]:
    """How many trajectories of each split: the family's own numbers, or `count` in the same proportion.

    Args:
        count: of all splits together, or of the one that is given
        split: train, valid or test alone

    Raises:
        InputError: nothing would be made, or there is no such split
    """
    own = {name: getattr(family.splits, name) for name in SPLITS}
    if split is not None:
        if split not in SPLITS:
            raise InputError(f"split = {split!r}: must be one of {', '.join(SPLITS)}{nearest(split, SPLITS)}")
        own = {split: own[split] if count is None else count}
    elif count is not None:
        ends = np.cumsum([0, *own.values()]) / max(1, sum(own.values()))
        own = dict(zip(SPLITS, np.diff(np.floor(ends * count + 0.5).astype(int)).tolist(), strict=True))
    if max(own.values()) > LARGEST_SPLIT:
        raise InputError(f"{max(own.values())} trajectories of one split asked for: must be at most {LARGEST_SPLIT}")
    if min(own.values()) < 0 or not sum(own.values()):
        raise InputError(f"{count if count is not None else sum(own.values())} trajectories asked for: must be at least 1")
    return {name: number for name, number in own.items() if number}


def draw(family: Family, seed: int, index: int, attempt: int = 0) -> Any:
    """The scene of a family, a solid or a flow, with a given seed and index; another attempt is another scene.

    Raises:
        InputError: a range is wrong, or the scene is
    """
    table = drawn(family, seed, index, attempt)
    beside(table, family.folder)
    if isinstance(obstacles := table.get("obstacle"), list):
        table["obstacle"] = [_placed(table, obstacle) for obstacle in obstacles]
    elif obstacles is not None:
        table["obstacle"] = _placed(table, obstacles)
    return read_any(table)


def _placed(table: dict[str, Any], obstacle: Any) -> Any:
    return placed({**table, "obstacle": obstacle}) if isinstance(obstacle, dict) and "place" in obstacle else obstacle


def drawn(family: Family, seed: int, index: int, attempt: int = 0) -> dict[str, Any]:
    """The table of `draw` before it is read: its ranges are numbers, its obstacle still has a place. Raises `InputError`."""
    key = (seed, index, attempt)
    at_point, _ = _on_grid(family.table, index % LARGEST_SPLIT, "")
    table: dict[str, Any] = _drawn(_with_case(at_point, key), "", key)
    return table


def points(value: Any, where: str = "") -> int:
    """In how many points the grids of a family's table meet; 1 without a grid. Raises `InputError`."""
    if isinstance(value, dict) and "grid" in value:
        return len(_grid(value, where))
    if isinstance(value, dict) and set(RANGES) & value.keys():
        return 1
    parts = {str(i): entry for i, entry in enumerate(value)} if isinstance(value, list) else value if isinstance(value, dict) else {}
    return math.prod(points(entry, f"{where}.{name}") for name, entry in parts.items() if where or name != "case")


def _grid(value: dict[str, Any], where: str) -> list[Any]:
    if len(value) > 1 or not isinstance(value["grid"], list) or not value["grid"]:
        raise InputError(f"{where.strip('.')}: a grid is an array of at least one value, {{ grid = [1, 2] }}")
    return value["grid"]


def _on_grid(value: Any, position: int, where: str) -> tuple[Any, int]:
    """A value with each grid replaced by its entry at a position, and what is left of the position for grids that follow."""
    if isinstance(value, dict) and "grid" in value:
        values = _grid(value, where)
        return values[position % len(values)], position // len(values)
    if isinstance(value, list):
        entries = []
        for i, entry in enumerate(value):
            found, position = _on_grid(entry, position, f"{where}[{i}]")
            entries.append(found)
        return entries, position
    if not isinstance(value, dict) or set(RANGES) & value.keys():
        return value, position
    table = dict(value)
    for name in sorted(name for name in value if where or name != "case"):  # by name: the order in the file plays no part
        table[name], position = _on_grid(value[name], position, f"{where}.{name}")
    return table, position


def _with_case(table: dict[str, Any], key: tuple[int, int, int]) -> dict[str, Any]:
    """The table with one of its cases laid over it."""
    table = dict(table)
    cases = table.pop("case", [])
    if not isinstance(cases, list) or not all(isinstance(case, dict) for case in cases):
        raise InputError("case must be an array of tables: [[case]]")
    if not cases:
        return table
    weights = [case.get("weight", 1) for case in cases]
    for i, weight in enumerate(weights):
        if type(weight) not in (int, float) or not (math.isfinite(weight) and weight > 0):
            raise InputError(f"case[{i}].weight = {weight!r}: must be a number above 0")
    ends = np.cumsum(weights) / sum(weights)
    drawn = int(np.searchsorted(ends[:-1], _uniform("case", key), side="right"))
    return merged(table, {name: value for name, value in cases[drawn].items() if name != "weight"})


def merged(below: Any, above: Any) -> Any:
    """A value laid over another: tables are merged key by key, unless one is a range; everything else is replaced."""
    if not (isinstance(below, dict) and isinstance(above, dict)) or set(RANGES) & (below.keys() | above.keys()):
        return above
    return {**below, **{name: merged(below.get(name), value) for name, value in above.items()}}


def _drawn(value: Any, where: str, key: tuple[int, int, int]) -> Any:
    """A value with its ranges replaced by draws."""
    if isinstance(value, list):
        return [_drawn(entry, f"{where}[{i}]", key) for i, entry in enumerate(value)]
    if not isinstance(value, dict):
        return value
    kinds = [name for name in value if name in RANGES]
    if not kinds:
        return {name: _drawn(entry, f"{where}.{name}" if where else name, key) for name, entry in value.items()}
    if len(value) > 1:
        raise InputError(f"{where} = {value}: a range has one key, {', '.join(RANGES)}")
    return _from_range(kinds[0], value[kinds[0]], where, key)


def _from_range(kind: str, given: Any, where: str, key: tuple[int, int, int]) -> Any:
    if kind == "grid":
        raise InputError(f"{where}.grid: a grid stands outside of cases, choices and other grids")
    u = _uniform(where, key)
    if kind == "choice":
        if not isinstance(given, list) or not given:
            raise InputError(f"{where}.choice must be an array of at least one value")
        chosen = int(u * len(given))
        return _drawn(given[chosen], f"{where}.choice[{chosen}]", key)
    if not isinstance(given, list) or len(given) != 2 or any(type(end) not in (int, float) for end in given):
        raise InputError(f"{where}.{kind} must be an array of two numbers")
    low, high = (float(end) for end in given)
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise InputError(f"{where}.{kind} = {given}: must be finite and in rising order")
    if kind == "uniform":
        return low + (high - low) * u
    if low <= 0:
        raise InputError(f"{where}.log-uniform = {given}: must be above 0")
    return low * (high / low) ** u


def _uniform(where: str, key: tuple[int, int, int]) -> float:
    """The number in [0, 1) that belongs to a key of a scene."""
    seed, *place = key
    bits = np.random.Philox(np.random.SeedSequence(seed, spawn_key=(*place, zlib.crc32(where.encode()))))
    return float(int(bits.random_raw()) >> 11) * 2.0**-53
