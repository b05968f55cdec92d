"""Many obstacles on one body: a scene or a family of which nothing but the obstacle varies.

    obstacle.place.along=0.3:0.9         any number between two
    obstacle.place.face=z-max,z-min      each of some values in turn, with those of all other keys in every combination

What the file itself gives as ranges (family.py) varies too. A draw depends on (seed, index) and the name of each key alone, as in a family.
"""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from datagen.family.family import RANGES, Family, Splits, draw, drawn, points
from datagen.family.place import placed_on
from physics.scene import Scene, beside
from physics.scene.change import change, toml_value
from physics.schema import InputError, read_toml


@dataclass(frozen=True)
class Variation:
    """A family whose ranges all stand in its obstacle; first: its scene number 0; keys: of the ranges, as `--set` takes them."""

    family: Family
    first: Scene
    keys: tuple[str, ...]

    @property
    def points(self) -> int:
        """Of all grids together; 1 where there is none."""
        return points(self.family.table)

    def scene(self, seed: int, index: int) -> tuple[Scene, tuple[float | str, ...]]:
        """What `draw` gives, with the body read once for all, and the value of each key. Raises `InputError`."""
        try:
            table = beside(drawn(self.family, seed, index), self.family.folder)
            scene = replace(self.first, obstacle=placed_on(self.first.body, table["obstacle"]))
        except InputError as error:
            raise InputError(f"number {index}: {error}") from None
        return scene, tuple(_plain(_at(table, key)) for key in self.keys)


def load_variation(scene: str | Path | dict[str, Any], vary: Sequence[str] = (), changes: Sequence[str] = (), *,
                   seed: int = 0) -> Variation:
    """A variation of a scene or a family, in a file or as TOML gives it, some values changed, some varied (see the module).

    Raises:
        InputError: the file or a text is wrong, or something else than the obstacle varies, or nothing does
    """
    path = Path("scene" if isinstance(scene, dict) else scene)
    try:
        table = copy.deepcopy(scene) if isinstance(scene, dict) else read_toml(scene)
        table.pop("splits", None)
        change(table, changes)
        return _of(table, [_range(text) for text in vary], path, seed)
    except InputError as error:
        text = str(error)
        raise InputError(text if isinstance(scene, dict) or text.startswith((str(path), "--")) else f"{path}: {text}") from None


def _of(table: dict[str, Any], vary: list[str], path: Path, seed: int) -> Variation:
    if isinstance(table.get("obstacle"), list):
        raise InputError("one body under many obstacles has one at a time: give [obstacle] in place of [[obstacle]]")
    change(table, vary, "--vary")
    places = list(_ranges(table, ""))
    if table.get("case"):
        raise InputError("one body under many obstacles cannot have cases; --set case=[] takes them away")
    for place in places:
        if not place.startswith("obstacle."):
            raise InputError(f"{place}: is a range, and one body under many obstacles varies in its obstacle alone; "
                             f"--set {place}=VALUE makes it one value")
    if not places:
        raise InputError("nothing varies: give --vary KEY=LOW:HIGH, such as --vary obstacle.radius=0.01:0.02")
    family = Family(str(table.get("name", path.stem)), tomli_w.dumps(table), table, Splits(), path.parent)
    return Variation(family, draw(family, seed, 0), tuple(places))


def _range(text: str) -> str:
    """KEY=LOW:HIGH or KEY=A,B,C as KEY=VALUE with a family's range for a value."""
    key, equals, value = text.partition("=")
    ends = [toml_value(end.strip()) for end in value.split(":")]
    if len(ends) == 2 and all(type(end) in (int, float) and math.isfinite(end) for end in ends):
        if ends[0] > ends[1]:
            raise InputError(f"--vary {text}: must be in rising order")
        return f"{key}={{ uniform = [{ends[0]}, {ends[1]}] }}"
    entries = [toml_value(entry.strip()) for entry in value.split(",")]
    if not equals or len(entries) < 2 or any(entry == "" or type(entry) not in (int, float, str) for entry in entries):
        raise InputError(f"--vary {text}: must be KEY=LOW:HIGH or KEY=A,B, such as obstacle.radius=0.01:0.02")
    return f"{key}={{ grid = {json.dumps(entries)} }}"


def _ranges(value: Any, where: str) -> Iterator[str]:
    """The keys of all ranges in a table, those inside of ranges left out."""
    if isinstance(value, list):
        for i, entry in enumerate(value):
            yield from _ranges(entry, f"{where}[{i}]")
    elif isinstance(value, dict) and set(RANGES) & value.keys():
        yield where
    elif isinstance(value, dict):
        for name, entry in value.items():
            if where or name != "case":
                yield from _ranges(entry, f"{where}.{name}" if where else name)


def _at(table: Any, key: str) -> Any:
    for step in key.replace("[", ".[").split("."):
        table = table[int(step[1:-1])] if step.startswith("[") else table[step]
    return table


def _plain(value: Any) -> float | str:
    return float(value) if type(value) in (int, float) else value if isinstance(value, str) else json.dumps(value)
