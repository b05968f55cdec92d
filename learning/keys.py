"""The keys of a training's config, as its dataclass and their docstrings tell them: for `train --help` and for the table of the docs.

    .venv/bin/python -m learning.keys               the table
    .venv/bin/python -m learning.keys networks      that of the kinds of networks beside M4GN
"""

from __future__ import annotations

import dataclasses
import re
import sys
import typing
from dataclasses import MISSING, dataclass
from typing import Any

from learning.config import TrainConfig
from learning.networks.kinds import CONFIGS

HEADS = "key", "default", "limits", "what it is"


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
        kinds = [each for each in (hints[field.name], *typing.get_args(hints[field.name])) if dataclasses.is_dataclass(each)]
        if kinds:  # of several, the one that stands for a table without a kind
            found += keys(typing.cast(type[Any], kinds[0]), f"{where}{field.name}.")
            continue
        default = "needed" if field.default is MISSING else "none" if field.default is None else _toml(field.default)
        found.append(Key(where + field.name, default, _limits(field.metadata.get("bound"), field.default), about.get(field.name, "")))
    return found


def others() -> dict[str, list[Key]]:
    """The keys of `[network]` for every kind but the first, `kind` itself left out, under what the kind is."""
    return {f"{kind}: {_first(config).split(': ', 1)[1]}": [key for key in keys(config, "network.") if key.name != "network.kind"]
            for kind, config in list(CONFIGS.items())[1:]}


def help_text() -> str:
    """The keys for a terminal, a line each."""
    def lines(some: list[Key]) -> list[str]:
        return [f"  {key.name:26s} {key.default:14s} {key.meaning} ({key.limits})" for key in some]

    rest = [line for kind, some in others().items() for line in ("", f"  network.kind = {kind}", *lines(some))]
    return "\n".join(["keys of the config (TOML), their defaults, what they are:", *lines(keys()), *rest])


def table() -> str:
    """The keys as a table of a page."""
    return "\n".join([_row(*HEADS), _row(*["---"] * 4), *(_row(*_entries(key)) for key in keys())])


def network_table() -> str:
    """Those of the other kinds of networks."""
    rows = [_row(f'"{kind.split(":")[0]}"', *_entries(key)) for kind, some in others().items() for key in some]
    return "\n".join([_row("kind", *HEADS), _row(*["---"] * 5), *rows])


def _entries(key: Key) -> tuple[str, ...]:
    return f"`{key.name}`", key.default, key.limits, key.meaning


def _row(*entries: str) -> str:
    return f"| {' | '.join(entries)} |".replace("  ", " ")


def _first(kind: type[Any]) -> str:
    """The first sentence of a docstring."""
    return (kind.__doc__ or "").split("\n")[0].split(". ")[0].rstrip(".")


def _about(kind: type[Any]) -> dict[str, str]:
    """What a docstring says of each key, in lines `name, name: words` that may go on indented."""
    found: dict[str, str] = {}
    for names, words in re.findall(r"^ *(\w+(?:, \w+)*): (.+(?:\n {8,}.+)*)", kind.__doc__ or "", re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return found


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)


def _limits(bound: Any, default: Any) -> str:
    """The bounds of a key in words."""
    if bound is None:
        return "true or false"
    if isinstance(default, tuple):
        return "names"
    if bound.choice and bound.at_least is None:
        return " or ".join(f'"{choice}"' for choice in bound.choice)
    words = [f"{word} {limit:.10g}" for word, limit in (("above", bound.above), ("below", bound.below), ("from", bound.at_least),
                                                        ("to", bound.at_most)) if limit is not None]
    return " ".join([*words, *([f"{bound.unit}"] if bound.unit else []), *(f'or "{choice}"' for choice in bound.choice)])


if __name__ == "__main__":
    print(network_table() if sys.argv[1:] == ["networks"] else table())
