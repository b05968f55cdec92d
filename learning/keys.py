"""The keys of a training's config, as its dataclass and their docstrings tell them: for `train --help` and for the table of the docs.

    .venv/bin/python -m learning.keys      the table
"""

from __future__ import annotations

import dataclasses
import re
import typing
from dataclasses import MISSING, dataclass
from typing import Any

from learning.config import TrainConfig


@dataclass(frozen=True)
class Key:
    """One key: its name with the tables it stands in, its default and limits in words, and what it is."""

    name: str
    default: str
    limits: str
    meaning: str


def keys(kind: type[Any] = TrainConfig, where: str = "") -> list[Key]:
    """All keys of a config, those of its tables after `TABLE.`."""
    about, found = _about(kind), []
    hints = typing.get_type_hints(kind)
    for field in dataclasses.fields(kind):
        if dataclasses.is_dataclass(hints[field.name]):
            found += keys(typing.cast(type[Any], hints[field.name]), f"{where}{field.name}.")
            continue
        default = "needed" if field.default is MISSING else "none" if field.default is None else _toml(field.default)
        found.append(Key(where + field.name, default, _limits(field.metadata.get("bound")), about.get(field.name, "")))
    return found


def help_text() -> str:
    """The keys for a terminal, a line each."""
    lines = [f"  {key.name:26s} {key.default:14s} {key.meaning} ({key.limits})" for key in keys()]
    return "\n".join(["keys of the config (TOML), their defaults, what they are:", *lines])


def table() -> str:
    """The keys as a table of a page."""
    rows = [f"| `{key.name}` | {key.default} | {key.limits} | {key.meaning} |".replace("  ", " ") for key in keys()]
    return "\n".join(["| key | default | limits | what it is |", "| --- | --- | --- | --- |", *rows])


def _about(kind: type[Any]) -> dict[str, str]:
    """What a docstring says of each key, in lines `name, name: words` that may go on indented."""
    found: dict[str, str] = {}
    for names, words in re.findall(r"^ *(\w+(?:, \w+)*): (.+(?:\n {8,}.+)*)", kind.__doc__ or "", re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return found


def _toml(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)


def _limits(bound: Any) -> str:
    """The bounds of a key in words."""
    if bound is None:
        return "true or false"
    if bound.choice and bound.at_least is None:
        return " or ".join(f'"{choice}"' for choice in bound.choice)
    words = [f"{word} {limit:.10g}" for word, limit in (("above", bound.above), ("below", bound.below), ("from", bound.at_least),
                                                        ("to", bound.at_most)) if limit is not None]
    return " ".join([*words, *([f"{bound.unit}"] if bound.unit else []), *(f'or "{choice}"' for choice in bound.choice)])


if __name__ == "__main__":
    print(table())
