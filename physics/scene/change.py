"""Values of a scene's table changed from outside, one at a time: `obstacle.radius=0.012`, `support[0].where="x-max"`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from physics.schema import InputError

PLACE = re.compile(r"[A-Za-z_][\w-]*(\[\d+\])*(\.[A-Za-z_][\w-]*(\[\d+\])*)*")


def change(table: dict[str, Any], changes: Sequence[str]) -> None:
    """Put values into a table as `tomllib` gives it; what cannot be read as a TOML value is taken as a string.

    Raises:
        InputError: not of the form KEY=VALUE, or the key leads nowhere. Whether the scene takes it is found when it is read.
    """
    for text in changes:
        place, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not PLACE.fullmatch(place):
            raise InputError(f"--set {text}: must be KEY=VALUE, such as obstacle.radius=0.012")
        steps = [int(number) if number else key for key, number in re.findall(r"([A-Za-z_][\w-]*)|\[(\d+)\]", place)]
        at: Any = table
        for step, following in pairwise(steps):
            if isinstance(step, str) and isinstance(at, dict) and isinstance(following, str):
                at.setdefault(step, {})
            at = _entry(at, step, text)
        if isinstance(at, dict) and isinstance(steps[-1], str):
            at[steps[-1]] = _value(value)
        else:
            _entry(at, steps[-1], text)
            at[steps[-1]] = _value(value)


def _entry(table: Any, step: str | int, text: str) -> Any:
    if isinstance(step, str):
        if isinstance(table, dict) and step in table:
            return table[step]
        raise InputError(f"--set {text}: there is no {step} there")
    if isinstance(table, list) and step < len(table):
        return table[step]
    raise InputError(f"--set {text}: there is no entry [{step}] there")


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
