"""Tables of steps: how a load, a support or an obstacle goes along the steps, in the scene itself or in a CSV file beside it.

A scene has `steps`, fractions 0 .. 1, and for each of them a `factor`, or for an obstacle a way-point of its `path`. A file is named
by `table = "load.csv"`: a row for each, the first column a fraction, a time or a number of steps, from 0 on; the last row is the last
step. The other columns are the factor, or x, y and z [m] of the obstacle's centre. One line of names may stand above. What a scene
holds, and writes, are the values: it no longer needs the file.
"""

from __future__ import annotations

import csv
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from physics.schema import InputError

MOST = 100_000  # rows


def with_tables(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A scene's table in which files of steps are replaced by what is in them. Raises `InputError`."""
    found = dict(table)
    for name in ("load", "support", "inflow"):
        if isinstance(table.get(name), list):
            found[name] = [_filled(part, folder, f"{name}[{i}]", ("factor",)) for i, part in enumerate(table[name])]
    obstacle, columns = table.get("obstacle"), ("x", "y", "z")
    if isinstance(obstacle, list):
        found["obstacle"] = [_filled(part, folder, f"obstacle[{i}]", columns) for i, part in enumerate(obstacle)]
    elif obstacle is not None:
        found["obstacle"] = _filled(obstacle, folder, "obstacle", columns)
    return found


def _filled(part: Any, folder: Path, key: str, columns: tuple[str, ...]) -> Any:
    if not isinstance(part, dict) or "table" not in part:
        return part
    values = "path" if len(columns) == 3 else "factor"
    for other in ("steps", values):
        if other in part:
            raise InputError(f"{key}: give either table or {other}")
    if not isinstance(part["table"], str):
        raise InputError(f"{key}.table must be the name of a CSV file")
    rows = read_rows(folder / part["table"], columns)
    steps = [row[0] / rows[-1][0] for row in rows]
    others = [row[1] if len(columns) == 1 else row[1:] for row in rows]
    return {name: value for name, value in part.items() if name != "table"} | {"steps": steps, values: others}


def read_rows(path: Path, columns: tuple[str, ...]) -> list[list[float]]:
    """The rows of a CSV file: step and the columns. Raises `InputError` in one line that names the row."""
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV file: {error}") from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if not any(entry.strip() for entry in line) or line[0].lstrip().startswith("#"):
            continue
        try:
            row = [float(entry) for entry in line]
        except ValueError:
            if rows or number > 1:
                raise InputError(f"{path}, line {number}: {', '.join(line)}: numbers are expected, with commas between them") from None
            continue
        if len(row) != 1 + len(columns) or not all(map(math.isfinite, row)):
            raise InputError(f"{path}, line {number}: {len(columns) + 1} finite numbers are expected: step, {', '.join(columns)}")
        if (row[0] != 0) if not rows else (row[0] <= rows[-1][0]):
            raise InputError(f"{path}, line {number}: the first column must start at 0 and rise; it is {row[0]:g}"
                             f"{f' after {rows[-1][0]:g}' if rows else ''}")
        rows.append(row)
    if not 2 <= len(rows) <= MOST:
        raise InputError(f"{path}: {len(rows)} rows; 2 to {MOST} are expected")
    return rows


def check_steps(steps: tuple[float, ...] | None, values: tuple[Any, ...] | None, key: str, name: str) -> None:
    """A table in a scene: as many values as steps, which rise from 0 to 1. Raises `InputError`."""
    if steps is None:
        if name == "factor" and values is not None:
            raise InputError(f"{key}.factor: needs steps, the fractions 0 .. 1 that it belongs to")
        return
    if values is None or len(values) != len(steps):
        raise InputError(f"{key}.steps: {len(steps)} steps for {0 if values is None else len(values)} values of {name}")
    if len(steps) < 2 or steps[0] != 0 or steps[-1] != 1 or any(a >= b for a, b in pairwise(steps)):
        raise InputError(f"{key}.steps: must rise from 0 to 1")
    if name == "factor" and values[0] != 0:
        raise InputError(f"{key}.factor: must start at 0, for step 0 is the rest state; it is {values[0]:g}")
