"""Rows of a report made by hand: two networks and their rivals on three trajectories, every figure known."""

import math

from learning.report.table import COLUMNS, Report, Row

CASES = ["0003", "0007", "0011"]


def row(name: str, kind: str, ms: float, error: float, each: tuple[float, ...] = (), **scores: float) -> Row:
    """A predictor of `ms` a step, an eighth of it set-up, and an error [m]; other figures are nan unless they are given."""
    whole = dict.fromkeys(COLUMNS, math.nan) | {"ms_per_step": ms, "ms_per_step_alone": 0.875 * ms, "rmsd_all": error} | scores
    return Row(name, kind, whole, tuple({"rmsd_all": value, "rmsd_refined": math.nan} for value in each))


def rows() -> list[Row]:
    """Of the networks the second is better, and neither the first nor the last row is the best of its kind."""
    return [row("M4GN a", "learned", 5.0, 4e-4, (2e-4, 3e-4, 7e-4), rmsd_1=1e-6),
            row("M4GN b", "learned", 8.0, 2e-4, (1e-4, 3.5e-4, 1.5e-4), rmsd_1=2e-6),
            row("M4GN b, corrected 10-fold", "hybrid", 9.0, 5e-5, (4e-5, 5e-5, 6e-5), iterations=1.0),
            row("nothing moves", "trivial", 0.01, 7e-3, (6e-3, 7e-3, 8e-3), rmsd_1=3e-4),
            row("FE, cells twice as large", "fe", 2.0, 6e-4, (5e-4, 6e-4, 7e-4), iterations=3.5),
            row("FE, the reference", "reference", 32.0, 0.0, (0.0, 0.0, 0.0), iterations=4.25)]


def report(**changes) -> Report:
    """These rows as a report; keyword arguments replace its parts."""
    return Report(**{"title": "Beams", "rows": rows(), "cases": CASES} | changes)
