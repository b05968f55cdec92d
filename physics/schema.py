"""A table of values from a stranger's file, read into a frozen dataclass.

The dataclass is the schema: its fields name the keys, its annotations give the types, its defaults are the
defaults, and `quantity(...)` states unit and bounds. Whatever does not fit is refused in one line that names
the place, the value, the limit and, for an unknown key, the nearest known one.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import os
import tomllib
import types
import typing
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")


class InputError(ValueError):
    """Wrong input: one line that says what is wrong, where, and what is allowed."""


class WorkError(RuntimeError):
    """The work failed: how, and what was saved where; `result` is what can be told of it all the same."""

    def __init__(self, message: str, result: dict[str, Any] | None = None) -> None:
        super().__init__(message)
        self.result = result


@dataclass(frozen=True)
class Bound:
    """Unit and limits of one value: `above` and `below` exclude the limit, `at_least` and `at_most` include it."""

    unit: str = ""
    above: float | None = None
    below: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    choice: tuple[str, ...] = ()

    def check(self, value: Any, where: str) -> None:
        """Raise `InputError` when a value, or one entry of a tuple, lies outside of the limits."""
        for entry in value if isinstance(value, tuple) else (value,):
            if isinstance(entry, tuple):
                self.check(entry, where)
                continue
            if isinstance(entry, str):
                if self.choice and entry not in self.choice:
                    raise InputError(f"{where} = {shown(entry)}: must be one of {', '.join(self.choice)}{nearest(entry, self.choice)}")
                continue
            for ok, limit, words in (
                (self.above is None or entry > self.above, self.above, "above"),
                (self.below is None or entry < self.below, self.below, "below"),
                (self.at_least is None or entry >= self.at_least, self.at_least, "at least"),
                (self.at_most is None or entry <= self.at_most, self.at_most, "at most"),
            ):
                if not ok:
                    raise InputError(f"{where} = {shown(entry)}: must be {words} {limit:g}{' ' + self.unit if self.unit else ''}")


def quantity(default: Any = MISSING, *, unit: str = "", above: float | None = None, below: float | None = None,
             at_least: float | None = None, at_most: float | None = None, choice: tuple[str, ...] = ()) -> Any:
    """A dataclass field with a unit and bounds; without a default the key is required."""
    bound = Bound(unit, above, below, at_least, at_most, choice)
    return dataclasses.field(default=default, metadata={"bound": bound})


def missing(path: Path) -> str:
    """Why there is no file to be read at a path; "" when there is one."""
    return "" if path.is_file() else "no such file, but a folder" if path.is_dir() else "no such file"


def read_toml(path: str | Path) -> dict[str, Any]:
    """The table in a TOML file. Raises `InputError` when there is none or when it is not TOML."""
    try:
        return parse_toml(Path(path).read_bytes().decode())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:  # what is no text, no TOML, or no path
        raise InputError(f"{path}: not a TOML file: {error}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The table in a text. Raises `InputError` when it is not TOML."""
    if text.startswith("\ufeff"):
        raise InputError("it begins with a byte-order mark; save it as UTF-8 without one")
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, or a number of thousands of digits
        raise InputError(str(error)) from None
    except RecursionError:
        raise InputError("it is nested too deeply") from None


def read_table(kind: type[T], table: Any, where: str = "") -> T:
    """A frozen dataclass from a table of plain values.

    Args:
        kind: a dataclass whose fields are str, bool, int, float, tuples of them, dataclasses, or one of these | None, or of
            several of these; of several dataclasses the key `kind` says which one
        table: what `tomllib` returned, or a dictionary in which arrays are lists, tuples or arrays of numpy
        where: the place in the file, as it stands in the messages

    Raises:
        InputError: a missing or unknown key, a wrong type, a value that is not finite or out of its bounds
    """
    if not isinstance(table, dict):
        raise InputError(f"{where or 'the file'} must be a table, not {_name(table)}")
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    hints = _hints(kind)  # type: ignore[arg-type]
    for key in table:
        if key not in fields:
            of_shape = getattr(kind, "keys_for", None)
            known = of_shape(table) if of_shape else tuple(fields)
            raise InputError(f"{_at(where, key)}: unknown key{nearest(key, fields) or ';'} {where or 'the file'} takes {', '.join(known)}")
    values = {}
    for name, field in fields.items():
        if name not in table:
            if field.default is MISSING and field.default_factory is MISSING:
                raise InputError(f"{_at(where, name)}: missing")
            continue
        values[name] = _value(hints[name], table[name], _at(where, name))
        if "bound" in field.metadata and values[name] is not None:
            field.metadata["bound"].check(values[name], _at(where, name))
    return kind(**values)


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def to_table(value: Any) -> Any:
    """The plain table of a dataclass, without the keys that are None: what `read_table` reads back."""
    value = _plain(value)
    if dataclasses.is_dataclass(value):
        pairs = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {name: to_table(entry) for name, entry in pairs if entry is not None}
    return [to_table(entry) for entry in value] if isinstance(value, list) else value


def shown(value: Any) -> str:
    """A value of a stranger's file as it stands in a message: a long one is cut."""
    if type(value) is int and abs(value) >= 10**20:
        return f"{'-' if value < 0 else ''}(an integer of {value.bit_length()} bits)"
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]}... ({len(text)} characters)"


def nearest(word: str, known: typing.Iterable[str]) -> str:
    """'; did you mean X?' for the known word nearest to a given one, or nothing."""
    found = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {found[0]!r}?" if found else ""


def _at(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _name(value: Any) -> str:
    names = {dict: "a table", list: "an array", str: "a string", bool: "a boolean", int: "an integer", float: "a number"}
    return names.get(type(value), type(value).__name__)


def _plain(value: Any) -> Any:
    """A number, array, tuple or path of Python, numpy or torch as TOML would give it: a number, list or string."""
    if hasattr(value, "tolist"):  # numbers and arrays of numpy, tensors
        value = value.tolist()
    if isinstance(value, tuple):
        return list(value)
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def _of_kind(kinds: list[Any], table: dict[str, Any], where: str) -> Any:
    """Of dataclasses that have a key `kind` each, the one that a table names; the first where it names none."""
    known: dict[str, Any] = {next(str(field.default) for field in dataclasses.fields(kind) if field.name == "kind"): kind for kind in kinds}
    named = table.get("kind", next(iter(known)))
    if not isinstance(named, str) or named not in known:
        raise InputError(f"{_at(where, 'kind')} = {shown(named)}: must be one of {', '.join(known)}{nearest(str(named), known)}")
    return known[named]


def _value(hint: Any, value: Any, where: str) -> Any:
    """One value converted to an annotated type, or `InputError`."""
    value = _plain(value)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        tables = [a for a in arguments if isinstance(value, dict) and dataclasses.is_dataclass(a)]
        if len(tables) > 1:
            return _value(_of_kind(tables, value, where), value, where)
        alike = (a for a in arguments if a is type(value) or a in tables or (isinstance(value, list) and typing.get_origin(a) is tuple))
        return _value(next(alike, arguments[0]), value, where)
    if dataclasses.is_dataclass(hint):
        return read_table(hint, value, where)  # type: ignore[arg-type]
    if origin is tuple:
        if not isinstance(value, list):
            raise InputError(f"{where} must be an array, not {_name(value)}")
        if arguments[-1] is not Ellipsis and len(value) != len(arguments):
            raise InputError(f"{where} must have {len(arguments)} entries, not {len(value)}")
        return tuple(_value(arguments[0], entry, f"{where}[{i}]") for i, entry in enumerate(value))
    if hint is float and type(value) in (int, float):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise InputError(f"{where} = {shown(value)}: must be finite" + "; the largest number is 1.8e308" * (type(value) is int))
        return number
    if type(value) is not hint:
        wanted = {float: "a number", int: "an integer", str: "a string", bool: "a boolean"}[hint]
        raise InputError(f"{where} must be {wanted}, not {_name(value)}")
    return value


def finite(value: Any) -> Any:
    """The same value with None for numbers that JSON has no word for."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
