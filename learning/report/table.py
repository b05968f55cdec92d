"""What a report says: predictors and their figures, what each figure is and on which nodes, and the result in words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from learning.prediction.rivals import STILL
from physics.fidelity import figures
from physics.fidelity.figures import Column, shown

KINDS = {"learned": "learned simulator", "foreign": "brought along by a user",
         "hybrid": "learned simulator, each frame corrected by finite elements",
         "trivial": "predictor that knows nothing", "fe": "finite elements, made cheaper", "reduced": "reduced-order model",
         "reference": "finite elements, the reference"}
JUDGED = ("learned", "foreign")  # what a report is about; the rest stands beside it


@dataclass(frozen=True)
class Row:
    """One predictor.

    kind: a key of KINDS
    scores: key of a column -> value in SI units, over all trajectories; nan where there is none
    each: the same for every trajectory
    about: in what it differs from others of its kind, in words
    """

    name: str
    kind: str
    scores: dict[str, float]
    each: tuple[dict[str, float], ...] = ()
    about: str = ""

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


TIME = {
    "ms_per_step": Column(
        "time", "ms/step", "ms", 1, "processor time on this machine over the number of steps, set-up included"),
    "ms_per_step_alone": Column("time, set-up excluded", "ms/step", "ms", 1, "the same of the steps alone"),
    "wall_ms_per_step": Column("by the clock", "ms/step", "ms", 1, "the first by the clock on the wall: longer where the machine is busy "
                               "with other work"),
    "seconds": Column("time of a trajectory", "s", "s", 1, "processor time of all steps and the set-up"),
    "set_up_seconds": Column(
        "set-up", "s", "s", 1,
        "what a new scene costs before its first step. Finite elements: mesh, supports, contact surface, storage. Learned "
        "simulator: the elastic mode and the segments made from it. Loading weights and compiled forms is no part of it"),
    "paid_back": Column(
        "paid back after", "scenes", "1", 1,
        "so many scenes solved by the reference take longer than as many predicted ones by the time of the training and of its data, "
        "as the run tells them"),
}
ERROR = figures.ERROR | {
    "rmsd_refined": Column(
        "to finer cells", "mm", "m", 1e3,
        "the same against the scene solved on cells of half the size, at about 40 of the frames; <b>free</b> nodes. The "
        "reference's own figure is the error of the data"),
    "of_motion": Column("of the motion", "", "1", 1, "RMSE-all over the root mean square displacement of the same nodes and steps"),
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
PHYSICS = figures.PHYSICS | {
    "iterations": Column("Newton steps", "", "1", 1, "for each step of the loading"),
}
TABLES = {"Time and error": TIME | ERROR | DOUBT, "Errors as published": figures.PUBLISHED, "Held against the equations": PHYSICS,
          "The deformed mesh": figures.MESH}
COLUMNS = TIME | ERROR | DOUBT | figures.PUBLISHED | PHYSICS | figures.MESH


def tables_of(rows: list[Row]) -> dict[str, dict[str, Column]]:
    """The tables of a report, with one of further fields where a learned predictor tells any."""
    found = figures.field_columns(key for row in rows if row.kind in JUDGED for key in row.scores)
    return TABLES | ({"Further fields": found} if found else {})


def improvement(rows: list[Row]) -> float | None:
    """RMSD-all of "nothing moves" over that of the best learned simulator or predictor brought along; None without both."""
    learned = [row.scores["rmsd_all"] for row in rows if row.kind in JUDGED]
    still = [row.scores["rmsd_all"] for row in rows if row.name == STILL]
    if not (learned and still):
        return None
    return still[0] / min(learned) if min(learned) else math.inf


def best_learned(rows: list[Row]) -> Row | None:
    """The learned simulator, or predictor brought along, with the smallest error over whole rollouts."""
    return min((row for row in rows if row.kind in JUDGED), key=lambda row: row.scores["rmsd_all"], default=None)


def headline(report: Report) -> str:
    """The result in a few sentences, with <b>."""
    rows = {row.kind: row for row in report.rows}
    better, learned = improvement(report.rows), best_learned(report.rows)
    if better is None or learned is None:
        return "No learned simulator was measured beside \"nothing moves\"."
    n = len(report.cases)
    than = f"{shown(better)} times as far off" if better >= 1 else f"closer, {shown(better)} times as far off"
    said = (f"Over whole rollouts of {n} test {'trajectory' if n == 1 else 'trajectories'}, {learned.name} puts a free node "
            f"{shown(1e3 * learned.scores['rmsd_all'])} mm from its true place (root mean square). To say that nothing "
            f"moves is <b>{than}</b>.")
    if "reference" in rows and not math.isnan(learned.ms_per_step):
        ratio = learned.ms_per_step / rows["reference"].ms_per_step
        speed = f"{shown(1 / ratio)} times as fast" if ratio < 1 else f"the solver is {shown(ratio)} times as fast"
        said += (f" {learned.name} takes {shown(learned.ms_per_step)} ms a step on this machine, the finite-element solver "
                 f"that made the truth {shown(rows['reference'].ms_per_step)} ms: <b>{speed}</b>.")
    cheaper = [row for row in report.rows if row.kind in ("fe", "reduced") and row.ms_per_step < learned.ms_per_step
               and row.scores["rmsd_all"] < learned.scores["rmsd_all"]]
    if cheaper:
        best = min(cheaper, key=lambda row: row.scores["rmsd_all"])
        said += (f" \"{best.name}\" is both faster and closer: {shown(best.ms_per_step)} ms a step, "
                 f"{shown(1e3 * best.scores['rmsd_all'])} mm.")
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
    name = f"{row.name} ({row.about})" if row.about else row.name
    return [name, *(shown(row.scores.get(key, math.nan) * column.factor) for key, column in columns.items())]


def by_case(report: Report) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of RMSD-all [mm] of every predictor in every trajectory."""
    rows = [row for row in report.rows if row.each and row.kind != "reference"]
    lines = [[case, *(shown(1e3 * row.each[i]["rmsd_all"]) for row in rows)] for i, case in enumerate(report.cases)]
    return ["test trajectory", *(row.name for row in rows)], lines


def plain(text: str, mark: str = "") -> str:
    """The text with its <b> and </b> replaced."""
    return text.replace("<b>", mark).replace("</b>", mark)
