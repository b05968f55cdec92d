"""The keys of a training's config, as its dataclass and their docstrings tell them: for `train --help` and for the table of the docs.

    .venv/bin/python -m learning.keys               the table
    .venv/bin/python -m learning.keys networks      that of the kinds of networks beside M4GN
    .venv/bin/python -m learning.keys at-once       that of predictors that know all poses of a path at once
"""

from __future__ import annotations

import sys
from typing import Any

from learning.config import KINDS, PosesConfig, TrainConfig
from learning.networks.kinds import CONFIGS
from physics.keys import HEADS, Key, keys, table


def others() -> dict[str, list[Key]]:
    """The keys of `[network]` for every kind but the first, `kind` itself left out, under what the kind is."""
    return {f"{kind}: {_first(config).split(': ', 1)[1]}": [key for key in keys(config, "network.") if key.name != "network.kind"]
            for kind, config in list(CONFIGS.items())[1:]}


def help_text() -> str:
    """The keys for a terminal, a line each."""
    def lines(some: list[Key]) -> list[str]:
        return [f"  {key.name:26s} {key.default:14s} {key.meaning} ({key.limits})" for key in some]

    rest = [line for kind, some in (others() | at_once()).items() for line in ("", f"  network.kind = {kind}", *lines(some))]
    return "\n".join(["keys of the config (TOML), their defaults, what they are:", *lines(keys(TrainConfig)), *rest])


def config_table() -> str:
    """The keys as a table of a page."""
    return table(key.entries for key in keys(TrainConfig))


def network_table() -> str:
    """Those of the other kinds of networks."""
    return table([(f'"{kind.split(":")[0]}"', *key.entries) for kind, some in others().items() for key in some], ("kind", *HEADS))


def at_once() -> dict[str, list[Key]]:
    """The keys of predictors that know all poses of a path at once, whose configs are of another kind: those of all of them under
    their names, and what each has of its own under its name."""
    every = {kind: keys(config) for kind, config in KINDS.items()}
    shared = keys(PosesConfig)
    return {" and ".join(every): shared} | {kind: [key for key in own if key not in shared and key.name != "network.kind"]
                                            for kind, own in every.items()}


def at_once_table() -> str:
    """These as a table of a page."""
    return table([(kind, *key.entries) for kind, some in at_once().items() for key in some], ("kind", *HEADS))


def _first(kind: type[Any]) -> str:
    """The first sentence of a docstring."""
    return (kind.__doc__ or "").split("\n")[0].split(". ")[0].rstrip(".")


MADE = {"networks": network_table, "at-once": at_once_table}

if __name__ == "__main__":
    print(MADE.get("".join(sys.argv[1:]), config_table)())
