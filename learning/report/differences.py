"""Several predictors that were trained: in what they differ, and whether the difference of their errors means anything.

The spread of a difference is judged on the same trajectories: d_i = error of one - error of the other on trajectory i, n of them,
mean d and sample deviation s. What lies within two standard errors, 2 s / sqrt(n), could as well be zero.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Any

from learning.report.table import JUDGED, Row, best_learned, shown


def differing(tables: dict[str, dict[str, Any]]) -> dict[str, str]:
    """For each of several tables of values, the entries in which they are not all alike, in words; empty for one table."""
    flat = {name: _flat(table) for name, table in tables.items()}
    keys = dict.fromkeys(key for table in flat.values() for key in table)
    apart = [key for key in keys if any(table.get(key) != next(iter(flat.values())).get(key) for table in flat.values())]
    return {name: ", ".join(f"{key} {_word(table.get(key))}" for key in apart) for name, table in flat.items()}


def _flat(table: dict[str, Any], where: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in table.items():
        found |= _flat(value, f"{where}{key}.") if isinstance(value, dict) else {where + key: value}
    return found


def _word(value: Any) -> str:
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def spread_said(rows: Sequence[Row], *, chance: bool = False) -> list[str]:
    """How far the judged predictors are from the best of them, and whether that is within its spread: a sentence each.

    chance: they differ in their seeds alone
    """
    best = best_learned(list(rows))
    said = []
    for row in rows:
        if best is None or row.kind not in JUDGED or row is best:
            continue
        apart = [one["rmsd_all"] - other["rmsd_all"] for one, other in zip(row.each, best.each, strict=True)]
        far = f"{row.name} is {shown(1e3 * statistics.fmean(apart))} mm farther off than {best.name} (RMSD-all)"
        if len(apart) < 2:
            said.append(f"{far}; one trajectory does not say whether that is more than chance.")
            continue
        spread = 2 * statistics.stdev(apart) / math.sqrt(len(apart))
        within = abs(statistics.fmean(apart)) <= spread
        said.append(f"{far}, on {len(apart)} trajectories; the spread of that mean is {shown(1e3 * spread)} mm (two standard errors): the "
                    f"difference is {'within the spread, either may be the better one' if within else 'beyond the spread'}."
                    + (" They differ in nothing but their seed: so much does chance make of a training." if chance else ""))
    return said
