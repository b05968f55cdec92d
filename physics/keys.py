"""The keys of a file, as the dataclass that reads it and its docstring tell them: for tables of the docs and for help.

    .venv/bin/python -m physics.keys body      those of [body]; the other tables of a scene stand in SCENE

A docstring tells of a key in a line `name: words` or `name, name: words`, which may go on indented.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import types
import typing
from dataclasses import MISSING, dataclass
from typing import Any

from physics.scene import body, flow, parts

HEADS = "key", "default", "limits", "what it is"
NUMBERS = {2: "two", 3: "three"}


@dataclass(frozen=True)
class Key:
    """One key: its name with the tables it stands in, its default and limits in words, and what it is."""

    name: str
    default: str
    limits: str
    meaning: str

    @property
    def entries(self) -> tuple[str, ...]:
        """Of a table's row."""
        return f"`{self.name}`", self.default, self.limits, self.meaning


def keys(kind: type[Any], where: str = "") -> list[Key]:
    """All keys of a dataclass, those of the tables within it after `TABLE.`; of several kinds of a table the first, which needs no name."""
    about, found = _about(kind), []
    hints = typing.get_type_hints(kind)
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        kinds = [each for each in (hint, *typing.get_args(hint)) if dataclasses.is_dataclass(each)]
        if kinds and str not in typing.get_args(hint):
            found += keys(typing.cast(type[Any], kinds[0]), f"{where}{field.name}.")
            continue
        default = "needed" if field.default is MISSING else "none" if field.default is None else _toml(field.default)
        found.append(Key(where + field.name, default, _limits(hint, field.metadata.get("bound")), about.get(field.name, "")))
    return found


def table(rows: typing.Iterable[tuple[str, ...]], heads: tuple[str, ...] = HEADS) -> str:
    """Rows of a page under their heads."""
    return "\n".join(_row(*entries) for entries in (heads, ("---",) * len(heads), *rows))


def _row(*entries: str) -> str:
    return f"| {' | '.join(entries)} |".replace("  ", " ")


def _about(kind: type[Any]) -> dict[str, str]:
    found: dict[str, str] = {}
    for one in reversed(kind.__mro__[:-1]):
        for names, words in re.findall(r"^(\w+(?:, \w+)*): (.+(?:\n {4,}.+)*)", inspect.getdoc(one) or "", re.MULTILINE):
            found |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return found


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)


def _limits(hint: Any, bound: Any) -> str:
    """What a value has to be, in words."""
    some = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    form = next((_form(each) for each in some if typing.get_origin(each) is tuple), "")
    if form == "names":
        return f"names: {', '.join(bound.choice)}" if bound and bound.choice else form
    if bound is None:
        return form or ("true or false" if bool in some else "text" if str in some else "")
    if bound.choice and bound.at_least is None:
        return " or ".join(f'"{choice}"' for choice in bound.choice)
    above = bound.above if bound.at_least is None else None
    words = [f"{word} {_number(limit)}" for word, limit in (("above", above), ("below", bound.below), ("from", bound.at_least),
                                                            ("to", bound.at_most)) if limit is not None]
    return " ".join([*([form] if form else []), *words, *([bound.unit] if bound.unit else []),
                     *(f'or "{choice}"' for choice in bound.choice)])


def _number(limit: float) -> str:
    return f"{limit:.10g}" if abs(limit) < 1e7 else f"{limit:g}".replace("e+0", "e").replace("e+", "e")


def _form(hint: Any) -> str:
    """How many numbers, points or names there are."""
    inner = [each for each in typing.get_args(hint) if each is not Ellipsis]
    if inner[0] is str:
        return "names"
    if typing.get_origin(inner[0]) is tuple:
        what = f"points of {_form(inner[0])}"
        return what if Ellipsis in typing.get_args(hint) else f"{NUMBERS[len(inner)]} {what}"
    what = "texts" if inner[0] is str else "numbers"
    return what if Ellipsis in typing.get_args(hint) else f"{NUMBERS[len(inner)]} {what}"


SCENE: dict[str, type[Any]] = {
    "body": body.Body, "material": body.Material, "where": body.Where, "support": parts.Support, "load": parts.Load,
    "obstacle": parts.Obstacle, "steps": parts.Steps, "fluid": flow.Fluid, "inflow": flow.Inflow, "outflow": flow.Outflow,
    "wall": flow.Wall, "force": flow.Force, "flow-steps": flow.FlowSteps}


def scene_table(name: str) -> str:
    """The keys of one table of a scene, solid or flow."""
    return table(key.entries for key in keys(SCENE[name]))


if __name__ == "__main__":
    print(scene_table(sys.argv[1]))
