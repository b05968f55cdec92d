"""What a report says: predictors and their figures, what each figure is and on which nodes, and the result in words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

KINDS = {"learned": "learned simulator", "hybrid": "learned simulator, each frame corrected by finite elements",
         "trivial": "predictor that knows nothing", "fe": "finite elements, made cheaper", "reduced": "reduced-order model",
         "reference": "finite elements, the reference"}


@dataclass(frozen=True)
class Row:
    """One predictor.

    kind: a key of KINDS
    scores: key of a column -> value in SI units, over all trajectories; nan where there is none
    each: the same for every trajectory
    """

    name: str
    kind: str
    scores: dict[str, float]
    each: tuple[dict[str, float], ...] = ()

    @property
    def ms_per_step(self) -> float:
        return self.scores["ms_per_step"]


@dataclass(frozen=True, kw_only=True)
class Report:
    """All that a report says.

    cases: name of each test trajectory
    pictures: (file name, caption) of each
    outside: test trajectory -> quantity -> how far outside of the training range; None when that is not known
    facts: machine, versions, seed and the like, in words
    notes: limits and what went wrong, a sentence or two each
    """

    title: str
    rows: list[Row]
    cases: list[str]
    pictures: list[tuple[str, str]] = field(default_factory=list)
    outside: dict[str, dict[str, float]] | None = None
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


TIME = {
    "ms_per_step": Column(
        "time", "ms/step", "ms", 1, "processor time on this machine over the number of steps, set-up included"),
    "ms_per_step_alone": Column("time, set-up excluded", "ms/step", "ms", 1, "the same of the steps alone"),
    "seconds": Column("time of a trajectory", "s", "s", 1, "processor time of all steps and the set-up"),
    "set_up_seconds": Column(
        "set-up", "s", "s", 1,
        "what a new scene costs before its first step. Finite elements: mesh, supports, contact surface, storage. Learned "
        "simulator: the elastic mode and the segments made from it. Loading weights and compiled forms is no part of it"),
}
ERROR = {
    "rmse_1": Column(
        "RMSE-1", "mm", "m", 1e3,
        "error after one step that starts from the true state: root of the mean, over steps and <b>free</b> nodes, of the "
        "squared distance between predicted and true place. Finite elements start no step from a given state and have none"),
    "rmse_50": Column(
        "RMSE-50", "mm", "m", 1e3,
        "the same over steps 1 to 50 of a rollout: from the rest state, each step from the predicted one before; "
        "<b>free</b> nodes"),
    "rmse_all": Column(
        "RMSE-all", "mm", "m", 1e3, "the same over all steps of the rollout; <b>free</b> nodes. The figure to compare by"),
    "rmse_all_pooled": Column(
        "RMSE-all, pooled", "mm", "m", 1e3,
        "the same over <b>all</b> nodes of the body; smaller, because held nodes have no error"),
    "rmse_refined": Column(
        "to finer cells", "mm", "m", 1e3,
        "the same against the scene solved on cells of half the size, at about 40 of the frames; <b>free</b> nodes. The "
        "reference's own figure is the error of the data"),
    "below_data": Column(
        "below the data's error", "", "1", 1,
        "share of these frames in which the distance to the data is smaller than that of the data to the finer solution"),
}
DOUBT = {
    "error_bar": Column("error bar", "mm", "m", 1e3, "what the predictor itself says of its error in a frame; <b>free</b> nodes, mean over "
                        "the frames for which it says something"),
    "covered": Column("covered", "", "1", 1, "share of these frames whose error is within the bar"),
    "unsure": Column("unsure", "", "1", 1, "share of all frames of which the predictor says that it does not know"),
}
PHYSICS = {
    "relative_residual": Column(
        "residual", "", "1", 1,
        "force missing to equilibrium on <b>free</b> nodes, over the largest reaction; root mean square over the checked "
        "steps. Needs no reference: it is zero for a solution of the equations"),
    "largest_penetration": Column(
        "penetration", "mm", "m", 1e3, "deepest that the obstacle enters the body, over all steps and trajectories"),
    "reaction_error": Column("reaction error", "", "1", 1, "root mean square over the checked steps, over the largest reaction"),
    "energy_error": Column("energy error", "", "1", 1, "of the stored energy, likewise"),
    "stress_error": Column(
        "stress error", "", "1", 1,
        "of von Mises' stress at the centres of all cells: root mean square over cells and checked steps, over that of the "
        "reference's stress"),
    "estimated_error": Column(
        "estimated error", "mm", "m", 1e3,
        "length of one Newton step from each checked frame, |K⁻¹R|: what the equations alone say about the error; <b>free</b> "
        "nodes, root mean square"),
    "effectivity": Column("effectivity", "", "1", 1, "estimated over true error of the same frames; 1 is perfect"),
    "iterations": Column("Newton steps", "", "1", 1, "for each step of the loading"),
}
MESH = {
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
    "smallest_det_f": Column(
        "det F", "", "1", 1,
        "smallest ratio of deformed to rest volume at any point checked, over all steps and trajectories; zero or less is "
        "impossible"),
    "smallest_scaled_jacobian": Column(
        "scaled Jacobian", "", "1", 1, "smallest over all cells, steps and trajectories: 1 in a perfect cell, 0 in a flat one"),
    "inverted_elements": Column("inverted", "", "1", 1, "most cells that are turned inside out in one frame"),
}
TABLES = {"Time and error": TIME | ERROR | DOUBT, "Held against the equations": PHYSICS, "The deformed mesh": MESH}
COLUMNS = TIME | ERROR | DOUBT | PHYSICS | MESH


def improvement(rows: list[Row]) -> float | None:
    """RMSE-all of "nothing moves" over that of the best learned simulator; None without both."""
    learned = [row.scores["rmse_all"] for row in rows if row.kind == "learned"]
    still = [row.scores["rmse_all"] for row in rows if row.name == "nothing moves"]
    if not (learned and still):
        return None
    return still[0] / min(learned) if min(learned) else math.inf


def best_learned(rows: list[Row]) -> Row | None:
    """The learned simulator with the smallest error over whole rollouts."""
    return min((row for row in rows if row.kind == "learned"), key=lambda row: row.scores["rmse_all"], default=None)


def headline(report: Report) -> str:
    """The result in a few sentences, with <b>."""
    rows = {row.kind: row for row in report.rows}
    better, learned = improvement(report.rows), best_learned(report.rows)
    if better is None or learned is None:
        return "No learned simulator was measured beside \"nothing moves\"."
    n = len(report.cases)
    than = f"{shown(better)} times as far off" if better >= 1 else f"closer, {shown(better)} times as far off"
    said = (f"Over whole rollouts of {n} test {'trajectory' if n == 1 else 'trajectories'}, {learned.name} puts a free node "
            f"{shown(1e3 * learned.scores['rmse_all'])} mm from its true place (root mean square). To say that nothing "
            f"moves is <b>{than}</b>.")
    if "reference" in rows:
        ratio = learned.ms_per_step / rows["reference"].ms_per_step
        speed = f"{shown(1 / ratio)} times as fast" if ratio < 1 else f"the solver is {shown(ratio)} times as fast"
        said += (f" {learned.name} takes {shown(learned.ms_per_step)} ms a step on this machine, the finite-element solver "
                 f"that made the truth {shown(rows['reference'].ms_per_step)} ms: <b>{speed}</b>.")
    cheaper = [row for row in report.rows if row.kind in ("fe", "reduced") and row.ms_per_step < learned.ms_per_step
               and row.scores["rmse_all"] < learned.scores["rmse_all"]]
    if cheaper:
        best = min(cheaper, key=lambda row: row.scores["rmse_all"])
        said += (f" \"{best.name}\" is both faster and closer: {shown(best.ms_per_step)} ms a step, "
                 f"{shown(1e3 * best.scores['rmse_all'])} mm.")
    return said


def far_outside(report: Report, alarm: float) -> list[str]:
    """The test trajectories that lie outside of the training range by more than an alarm's share of its width."""
    return [case for case, beyond in (report.outside or {}).items() if any(value > alarm for value in beyond.values())]


def told(columns: dict[str, Column], rows: list[Row]) -> dict[str, Column]:
    """The columns in which at least one predictor has a number."""
    return {key: column for key, column in columns.items() if any(not math.isnan(row.scores.get(key, math.nan)) for row in rows)}


def heads(columns: dict[str, Column]) -> list[str]:
    """The headings of a table."""
    return ["predictor", *(f"{column.head} [{column.unit}]" if column.unit else column.head for column in columns.values())]


def cells(row: Row, columns: dict[str, Column]) -> list[str]:
    """The row of the table under these headings."""
    return [row.name, *(shown(row.scores.get(key, math.nan) * column.factor) for key, column in columns.items())]


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
