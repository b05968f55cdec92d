"""A family of scenes: a scene file whose values may be ranges, and whose obstacle may be placed relative to the body.

    length = { uniform = [0.1, 0.12] }                  any number, also inside arrays
    young_modulus = { log-uniform = [1e5, 1e7] }
    cell = { choice = ["prism", "hexahedron"] }         any values, arrays and tables too

    [obstacle.place]                                    instead of path: straight down onto a face, and on
    face = "z-max"
    along = 0.8                                         see `Place`
    gap = 0.001
    depth = { uniform = [0.015, 0.03] }

    [splits]                                            how many trajectories of each kind, unless asked otherwise
    train = 8

A family is data: nothing in it is evaluated. A draw depends on (seed, index, attempt) and on the name of each key, and on
nothing else: not on the order of keys, the number of scenes, or who draws them. Each key's number u in [0, 1) comes from
the raw bits of numpy's Philox, whose stream is the same in every version.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from physics.scene import PLACES, Body, Obstacle, Scene, read_scene
from physics.schema import InputError, nearest, quantity, read_table, read_toml

FOLDER = Path(__file__).parent / "families"
SPLITS = ("train", "valid", "test")
RANGES = ("uniform", "log-uniform", "choice")


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a round obstacle meets a face of the body: it comes along the face's normal and goes on into the body.

    `along` and `across` are fractions of the face's two sides, in the order x, y, z: on z-max along x and across y.
    """

    face: str = quantity("z-max", choice=PLACES)
    along: float = quantity(0.5, at_least=0, at_most=1)
    across: float = quantity(0.5, at_least=0, at_most=1)
    gap: float = quantity(0.0, unit="m", at_least=0)  # between surface and face at step 0
    depth: float = quantity(unit="m", above=0)  # of the last step, beyond first touch


@dataclass(frozen=True, kw_only=True)
class Splits:
    """How many trajectories of each kind."""

    train: int = quantity(8, at_least=0, at_most=1_000_000)
    valid: int = quantity(1, at_least=0, at_most=1_000_000)
    test: int = quantity(1, at_least=0, at_most=1_000_000)


@dataclass(frozen=True)
class Family:
    """A family as it stands in its file: `table` is what TOML made of `text`, without [splits]."""

    name: str
    text: str
    table: dict[str, Any]
    splits: Splits


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
        splits = read_table(Splits, table.pop("splits", {}), "splits")
        family = Family(str(table.get("name", path.stem)), path.read_text(), table, splits)
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
    if min(own.values()) < 0 or not sum(own.values()):
        raise InputError(f"{count if count is not None else sum(own.values())} trajectories asked for: must be at least 1")
    return {name: number for name, number in own.items() if number}


def draw(family: Family, seed: int, index: int, attempt: int = 0) -> Scene:
    """The scene of a family with a given seed and index; another attempt is another scene.

    Raises:
        InputError: a range is wrong, or the scene is
    """
    table = _drawn(family.table, "", (seed, index, attempt))
    obstacle = table.get("obstacle")
    if isinstance(obstacle, dict) and "place" in obstacle:
        if "path" in obstacle:
            raise InputError("obstacle: give either path or place")
        place = read_table(Place, obstacle.pop("place"), "obstacle.place")
        # Read and check all but the path, which needs the body's extent and the obstacle's radius.
        scene = read_scene({**table, "obstacle": {**obstacle, "path": [[0.0, 0.0, 0.0]]}})
        assert scene.obstacle is not None
        obstacle["path"] = _path(place, scene.body, scene.obstacle)
    return read_scene(table)


def _path(place: Place, body: Body, obstacle: Obstacle) -> list[list[float]]:
    """Two way-points of the centre, from `gap` before the face to `depth` behind first touch."""
    normal, outward = divmod(PLACES.index(place.face), 2)
    if obstacle.shape == "cylinder" and abs(obstacle.axis[normal]) > 1e-9 * math.hypot(*obstacle.axis):
        raise InputError(f"obstacle.axis = {list(obstacle.axis)}: must be parallel to obstacle.place's face {place.face}")
    first, second = (k for k in range(3) if k != normal)
    centre = [0.0, 0.0, 0.0]
    centre[first], centre[second] = place.along * body.extent[first], place.across * body.extent[second]
    path = []
    for distance in (obstacle.radius + place.gap, obstacle.radius - place.depth):
        centre[normal] = body.extent[normal] + distance if outward else -distance
        path.append(list(centre))
    return path


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
    return _from_range(kinds[0], value[kinds[0]], where, _uniform(where, key))


def _from_range(kind: str, given: Any, where: str, u: float) -> Any:
    if kind == "choice":
        if not isinstance(given, list) or not given:
            raise InputError(f"{where}.choice must be an array of at least one value")
        return given[int(u * len(given))]
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
