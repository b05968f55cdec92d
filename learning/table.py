"""What a report says: predictors and their figures, what each figure is and on which nodes, and the result in words."""


from __future__ import annotations

import math
from dataclasses import dataclass, field

KINDS = {"learned": "learned simulator", "hybrid": "learned simulator, each frame corrected by finite elements",
         "trivial": "predictor that knows nothing",
         "fe": "finite elements on a coarser mesh", "reference": "finite elements, the reference"}


@dataclass(frozen=True)
class Row:
    """One predictor.

    kind: learned, hybrid, trivial, fe or reference
    ms_per_step: wall time [ms]
    scores: key of a column -> value in SI units, over all trajectories; nan where there is none
    each: the same for every trajectory
    """

    name: str
    kind: str
    ms_per_step: float
    scores: dict[str, float]
    each: tuple[dict[str, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Report:
    """All that a report says.

    cases: name of each test trajectory
    pictures: (file name, caption) of each
    facts: machine, versions, seed and the like, in words
    notes: limits and what went wrong, a sentence or two each
    """

    title: str
    rows: list[Row]
    cases: list[str]
    pictures: list[tuple[str, str]] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Column:
    """One figure: its heading, the unit it is shown in and the factor to it from the SI unit, and what it is."""

    head: str
    unit: str
    si: str
    factor: float
    meaning: str


COLUMNS = {
    "rmse_1": Column(
        "RMSE-1", "mm", "m", 1e3,
        "error after one step that starts from the true state: root of the mean, over steps and <b>free</b> nodes, of the "
        "squared distance between predicted and true place. Finite elements start no step from a given state and have none"),
    "rmse_50": Column(
        "RMSE-50", "mm", "m", 1e3,
        "the same over steps 1 to 50 of a rollout: from the rest state, each step from the predicted one before; "
        "<b>free</b> nodes"),
    "rmse_all": Column(
        "RMSE-all", "mm", "m", 1e3,
        "the same over all steps of the rollout; <b>free</b> nodes. The figure to compare by"),
    "rmse_all_pooled": Column(
        "RMSE-all, pooled", "mm", "m", 1e3,
        "the same over <b>all</b> nodes of the body; smaller, because held nodes have no error"),
    "gf_h": Column(
        "GF_h", "mm", "m", 1e3,
        "Hausdorff distance of the predicted and the true set of nodes; <b>all</b> nodes of the body, mean over steps"),
    "gf_c": Column(
        "GF_c", "mm²", "m2", 1e6,
        "Chamfer distance of the two sets: mean squared distance to the nearest node, both ways; <b>all</b> nodes of the "
        "body, mean over steps"),
    "mc": Column(
        "MC", "", "1", 1,
        "error of mesh continuity, the mean over cells of largest over smallest volume among neighbours; all cells, "
        "mean over steps"),
    "ar": Column("AR", "", "1", 1, "mean over all cells of the error of the aspect ratio, mean over steps"),
    "relative_residual": Column(
        "residual", "", "1", 1,
        "force missing to equilibrium on <b>free</b> nodes, over the largest reaction; root mean square over the checked "
        "steps. Needs no reference: it is zero for a solution of the equations"),
    "largest_penetration": Column(
        "penetration", "mm", "m", 1e3, "deepest that the obstacle enters the body, over all steps and trajectories"),
    "smallest_det_f": Column(
        "det F", "", "1", 1,
        "smallest ratio of deformed to rest volume at any point checked, over all steps and trajectories; zero or less is "
        "impossible"),
    "inverted_elements": Column("inverted", "", "1", 1, "most cells that are turned inside out in one frame"),
}
TIME = ("wall time for one step on this machine. Finite elements: the whole solution with its set-up, over the number of "
        "steps. Learned simulator: the rollout; cutting the mesh into segments, done once for a mesh, is not counted")


def improvement(rows: list[Row]) -> float | None:
    """RMSE-all of "nothing moves" over that of the learned simulator; None without both."""
    learned = [row.scores["rmse_all"] for row in rows if row.kind == "learned"]
    still = [row.scores["rmse_all"] for row in rows if row.name == "nothing moves"]
    if not (learned and still):
        return None
    return still[0] / learned[0] if learned[0] else math.inf


def headline(report: Report) -> str:
    """The result in one or two sentences, with <b>."""
    rows = {row.kind: row for row in report.rows}
    better = improvement(report.rows)
    if better is None:
        return "No learned simulator was measured beside \"nothing moves\"."
    learned = rows["learned"]
    n = len(report.cases)
    than = f"{shown(better)} times as far off" if better > 1 else f"closer, {shown(better)} times as far off"
    said = (f"Over whole rollouts of {n} test {'trajectory' if n == 1 else 'trajectories'}, {learned.name} puts a free node "
            f"{shown(1e3 * learned.scores['rmse_all'])} mm from its true place (root mean square). To say that nothing "
            f"moves is <b>{than}</b>.")
    if "reference" in rows:
        ratio = learned.ms_per_step / rows["reference"].ms_per_step
        speed = f"{shown(1 / ratio)} times as fast" if ratio < 1 else f"the solver is {shown(ratio)} times as fast"
        said += (f" {learned.name} takes {shown(learned.ms_per_step)} ms a step on this machine, the finite-element solver "
                 f"that made the truth {shown(rows['reference'].ms_per_step)} ms: <b>{speed}</b>.")
    return said


def heads() -> list[str]:
    """The headings of the table."""
    named = [f"{column.head} [{column.unit}]" if column.unit else column.head for column in COLUMNS.values()]
    return ["predictor", "time [ms/step]", *named]


def cells(row: Row) -> list[str]:
    """The row of the table under these headings."""
    values = [row.scores.get(key, math.nan) * column.factor for key, column in COLUMNS.items()]
    return [row.name, shown(row.ms_per_step), *(shown(value) for value in values)]


def by_case(report: Report) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of RMSE-all [mm] of every predictor in every trajectory."""
    rows = [row for row in report.rows if row.each and row.kind != "reference"]
    lines = [[case, *(shown(1e3 * row.each[i]["rmse_all"]) for row in rows)] for i, case in enumerate(report.cases)]
    return ["test trajectory", *(row.name for row in rows)], lines


def shown(value: float) -> str:
    """A number with three digits; a dash for what is not one."""
    return "–" if math.isnan(value) else "0" if value == 0 else f"{value:.3g}"


def plain(text: str, mark: str = "") -> str:
    """The text with its <b> and </b> replaced."""
    return text.replace("<b>", mark).replace("</b>", mark)
