"""What came of a study: means and deviations over seeds, published figures beside them, and which rows can be told apart.

A deviation is the sample's, 1/(n - 1); one seed has none. Two rows are told apart when their means differ by more than two standard
errors of the difference, 2 s sqrt(2 / n), with s^2 the mean of both variances and n seeds of each. What is nearer would take
8 (s / difference)^2 seeds of each.

At equal time: the best error in validation up to the moment at which the first of the rows was done, by the processor seconds of each
training (on a GPU by the clock).
"""

from __future__ import annotations

import csv
import io
import json
import math
import statistics
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from learning.flows.rivals import IDLE
from learning.prediction.rivals import STILL
from learning.study.plan import Plan
from learning.study.work import Training
from physics.fidelity.figures import FIGURES, FLOW, Column, field_columns, shown
from physics.schema import InputError, nearest
from physics.whole import write_whole

ERRORS = {key: FIGURES[key] for key in ("gf_h", "gf_c", "mc", "ar", "rmse_1", "rmse_50", "rmse_all")} | {key: FLOW[key] for key in (
    "velocity_rmse_1", "velocity_rmse_50", "velocity_rmse_all", "pressure_rmse_all", "divergence", "drag_error")}
COST = {
    "valid_equal": Column("valid., equal time", "mm", "m", 1e3, "best error of whole rollouts over the validation trajectories, up to the "
                          "moment at which the quickest row was done"),
    "parameters": Column("parameters", "", "1", 1, "weights of the network"),
    "train_ms": Column("training", "ms/step", "ms", 1, "processor time (on a GPU by the clock) of a step of batch_size frames, without "
                       "validation where that can be told apart"),
    "test_ms": Column("prediction", "ms/step", "ms", 1, "processor time of a rollout's step"),
    "memory": Column("memory", "MB", "B", 1e-6, "what a training step has to hold: weights, gradients, Adam's moments, and what is kept of "
                     "a batch for the backward pass"),
    "hours": Column("hours", "h", "h", 1, "of training, of the processor (on a GPU by the clock)"),
}
FIGURE, OF_FLOWS = "rmse_all", "velocity_rmse_all"  # by which rows are told apart


@dataclass(frozen=True)
class Score:
    """Mean, sample deviation (nan of one) and number of seeds; the published mean and deviation, nan where there is none."""

    mean: float
    deviation: float
    count: int
    published: tuple[float, float] = (math.nan, math.nan)


@dataclass(frozen=True)
class Result:
    """All figures of a study.

    columns: by key
    cells: row -> test -> key
    blown: row -> test -> how many seeds had a rollout that blew up
    curves: row -> of each seed the lines of its training's curve
    """

    plan: Plan
    columns: dict[str, Column]
    cells: dict[str, dict[str, dict[str, Score]]]
    blown: dict[str, dict[str, int]]
    curves: dict[str, list[list[dict[str, Any]]]]

    @property
    def figure(self) -> str:
        """The key of the error by which rows are told apart."""
        return OF_FLOWS if OF_FLOWS in self.columns else FIGURE

    def heads(self) -> list[str]:
        """Of a table's columns."""
        return ["", *(f"{column.head} [{column.unit}]" if column.unit else column.head for column in self.columns.values())]

    def table(self, test: str) -> list[list[str]]:
        """A test's rows under these heads: mean ± deviation, and what was published in brackets."""
        return [[name, *(_told(cells[test].get(key), column) for key, column in self.columns.items())]
                for name, cells in self.cells.items()]

    def lines(self) -> list[str]:
        """For a terminal: the error by which rows are told apart, of each test, and what can be said of it."""
        said, column = [f"{self.plan.title} ({self.plan.size})"], ERRORS[self.figure]
        for test in self.plan.tests:
            said += [f"{column.head} on {test.name} [{column.unit}]:"]
            said += [f"  {name:40s} {_told(cells[test.name].get(self.figure), column)}" for name, cells in self.cells.items()]
            said += [f"  {line}" for line in self.apart(test.name)]
        return said

    def apart(self, test: str) -> list[str]:
        """Whether each row can be told from the best one by its spread, a sentence each."""
        column = ERRORS[self.figure]
        known = {name: cell for name, cells in self.cells.items()
                 if name not in (STILL, IDLE) and (cell := cells[test].get(self.figure)) is not None and not math.isnan(cell.mean)}
        said = [f"{name}: {count} of {self.plan.seeds} trainings led to rollouts that blow up"
                for name, tests in self.blown.items() if (count := tests.get(test, 0))]
        if len(known) < 2:
            return said
        best = min(known, key=lambda name: known[name].mean)
        for name, cell in known.items():
            if name == best:
                continue
            difference = cell.mean - known[best].mean
            words = f"{name} has {shown(column.factor * difference)} {column.unit} more than {best}"
            n, variance = min(cell.count, known[best].count), (cell.deviation**2 + known[best].deviation**2) / 2
            if n < 2:
                said.append(f"{words}; one seed does not say whether that is more than chance.")
            elif difference > 2 * math.sqrt(2 * variance / n):
                said.append(f"{words}: more than two standard errors of {n} seeds each.")
            else:
                needed = math.ceil(8 * variance / difference**2) if difference else math.inf
                said.append(f"{words}, which {n} seeds each cannot tell from chance" + (f"; some {needed} would." if needed < 1e6 else "."))
        return said


def check_published(plan: Plan) -> None:
    """Raises `InputError` for a published figure that no table has."""
    known = (*ERRORS, *COST)
    for row in plan.rows:
        for key in (key for figures in row.published.values() for key in figures):
            if key not in known and not field_columns([key]):
                raise InputError(f"row {row.name!r}: published.{key}: no such figure{nearest(key, known) or ';'} there are "
                                 f"{', '.join(known)}")


def gathered(plan: Plan, jobs: Mapping[tuple[str, int], Training], idle: dict[str, dict[str, Any]]) -> Result:
    """What trainings have left so far."""
    trained: dict[str, list[dict[str, Any]]] = {row.name: [] for row in plan.rows}
    tests: dict[str, dict[str, list[dict[str, Any]]]] = {row.name: {test.name: [] for test in plan.tests} for row in plan.rows}
    curves: dict[str, list[list[dict[str, Any]]]] = {row.name: [] for row in plan.rows}
    for (name, _), job in jobs.items():
        if job.done:
            trained[name].append(json.loads((job.folder / "trained.json").read_text()))
            curves[name].append(job.curve())
            for test, _ in job.tests:
                tests[name][test.name].append(json.loads(job.found(test).read_text()))
    moment = min((statistics.fmean(run["seconds"] for run in runs) for runs in trained.values() if runs), default=math.nan)
    keys = dict.fromkeys(key for of in tests.values() for scores in of.values() for each in scores for key in each)
    flows = any(OF_FLOWS in scores for scores in idle.values())
    columns = ERRORS | field_columns(keys) | COST
    if flows:
        columns["valid_equal"] = replace(COST["valid_equal"], unit="m/s", si="m/s", factor=1)
    cells: dict[str, dict[str, dict[str, Score]]] = {}
    for row in plan.rows:
        cost = {"valid_equal": [_best(curve, moment) for curve in curves[row.name]]}
        cost |= {key: [factor * run[name] for run in trained[row.name]] for key, name, factor in
                 (("parameters", "parameters", 1), ("train_ms", "step_ms", 1), ("memory", "memory", 1), ("hours", "seconds", 1 / 3600))}
        cells[row.name] = {}
        for test in plan.tests:
            found = [scores for scores in tests[row.name][test.name] if scores]
            values = cost | {"test_ms": [_number(scores.get("ms_per_step_alone")) for scores in found]}
            values |= {key: [_number(scores.get(key)) for scores in found] for key in columns if key not in values}
            published = row.published.get(test.name, {})
            cells[row.name][test.name] = {key: _cell(values[key], published.get(key)) for key in columns}
    cells[IDLE if flows else STILL] = {
        test.name: {key: _cell([_number(idle[test.name].get(key))], None) for key in columns if key not in COST} for test in plan.tests}
    blown = {name: {test: sum(not scores for scores in found) for test, found in of.items()} for name, of in tests.items()}
    return Result(plan, {key: column for key, column in columns.items() if _any(cells, key)}, cells, blown, curves)


def _any(cells: dict[str, dict[str, dict[str, Score]]], key: str) -> bool:
    return any(not (math.isnan(cell.mean) and math.isnan(cell.published[0])) for of in cells.values() for each in of.values()
               if (cell := each.get(key)) is not None)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _cell(values: list[float], published: tuple[float, float] | None) -> Score:
    known = [value for value in values if not math.isnan(value)]
    return Score(statistics.fmean(known) if known else math.nan, statistics.stdev(known) if len(known) > 1 else math.nan, len(known),
                published or (math.nan, math.nan))


def _best(curve: list[dict[str, Any]], moment: float) -> float:
    return min((line["error"] for line in curve if line.get("error") is not None and line["seconds"] <= moment), default=math.nan)


def _told(cell: Score | None, column: Column) -> str:
    if cell is None:
        return ""
    spread = "" if math.isnan(cell.deviation) or not cell.deviation else f" ± {column.factor * cell.deviation:.2g}"
    value = f"{cell.mean:.0f}" if column is COST["parameters"] and not math.isnan(cell.mean) else shown(column.factor * cell.mean)
    mean, deviation = cell.published
    if math.isnan(mean):
        return value + spread
    return f"{value}{spread} [{column.factor * mean:.3g}" + ("]" if math.isnan(deviation) else f" ± {column.factor * deviation:.2g}]")


def markdown(result: Result) -> str:
    """table.md."""
    plan, heads = result.plan, result.heads()
    parts = [f"# {plan.title}", "", *([plan.about, ""] if plan.about else []), facts(plan), ""]
    for test in plan.tests:
        lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *result.table(test.name)]
        parts += [f"## Tested on: {test.name}", "", *("| " + " | ".join(line) + " |" for line in lines), "",
                  *(f"- {said}" for said in result.apart(test.name)), ""]
    parts += ["## What the columns are", "", *(f"- **{column.head}**: {_plain(column.meaning)}." for column in result.columns.values()), ""]
    return "\n".join(parts)


def facts(plan: Plan) -> str:
    """What is to be known below a title."""
    made = "; ".join(f"{name}: {data.train} / {data.valid} / {data.test} of {data.family}" for name, (_, data) in plan.sets.items())
    published = f" In brackets what was published ({plan.source})." if plan.source else ""
    return (f"Size {plan.size}: means ± deviations over {plan.seeds} seed{'s' * (plan.seeds > 1)}; training / validation / test "
            f"trajectories, {made}.{published}")


def _plain(text: str) -> str:
    return text.replace("<b>", "**").replace("</b>", "**")


def table_csv(result: Result) -> str:
    """table.csv: one line for each row, test and figure, in SI units."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(["row", "test", "figure", "unit", "mean", "deviation", "seeds", "published", "published deviation"])
    for name, tests in result.cells.items():
        for test, cells in tests.items():
            for key, column in result.columns.items():
                if (cell := cells.get(key)) is not None:
                    numbers = (cell.mean, cell.deviation, float(cell.count), *cell.published)
                    writer.writerow([name, test, key, column.si, *("" if math.isnan(number) else f"{number:.9g}" for number in numbers)])
    return text.getvalue()


def write_tables(out: Path, result: Result) -> None:
    """Write table.md and table.csv, each whole."""
    write_whole(out / "table.md", markdown(result).encode())
    write_whole(out / "table.csv", table_csv(result).encode())
