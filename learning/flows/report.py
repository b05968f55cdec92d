"""The report on predicted flows: a page with the table and the picture of speed against error, and a film of the vorticity."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.provenance import machine
from datagen.flow.prediction import FlowTruth
from learning.flows.rivals import IDLE
from learning.report.pareto import pareto_picture
from learning.report.table import KINDS, Row
from physics.fidelity.figures import FLOW, Column, shown
from physics.schema import finite
from physics.view import flow_film, shell
from physics.whole import write_whole

LATE = Column("RMSE-late", "m/s", "m/s", 1, "the same over the second half of the frames, which nobody is shown: the figure in which all "
              "can be compared")
ERRORS = {key: FLOW[key] for key in ("velocity_rmse_1", "velocity_rmse_50", "velocity_rmse_all")} | {"velocity_rmse_late": LATE}
COLUMNS = {"ms_per_step": Column("time", "ms/step", "ms", 1, "processor time over the number of steps, set-up included"),
           **ERRORS, **{key: column for key, column in FLOW.items() if key not in ERRORS}}


@dataclass(frozen=True)
class FlowReport:
    """Predictors and their figures over all flows, the flows' files, what was left out and why, the folders of the trainings."""

    rows: list[Row]
    files: list[str]
    notes: list[str]
    runs: list[str]


def write_flow_report(out: Path, report: FlowReport, truths: list[FlowTruth],
                      worst: dict[str, tuple[int, float, NDArray[np.float64]]]) -> dict[str, Any]:
    """Write report.json, report.html, pareto.png and a film of the flow on which the best learned predictor is worst. Gives the JSON."""
    out.mkdir(parents=True, exist_ok=True)
    content: dict[str, Any] = finite({"summary": headline(report.rows), **asdict(report), "machine": machine(),
                                      "units": {key: column.si for key, column in COLUMNS.items()}})
    write_whole(out / "report.json", json.dumps(content, indent=1).encode())
    pareto_picture(out / "pareto.png", report.rows, error="velocity_rmse_late", factor=1.0,
                   up="RMSE of a component of the velocity in the second half of the frames [m/s]")
    judged = [row for row in report.rows if row.name in worst]
    film = ""
    if judged:
        best = min(judged, key=lambda row: row.scores["velocity_rmse_late"])
        number, error, velocity = worst[best.name]
        film = (f"The vorticity of {report.files[number]}, on which {best.name} is farthest off ({shown(error)} m/s): left the prediction, "
                "right the truth.")
        padded = np.pad(velocity, ((0, 0), (0, 0), (0, 1)))
        flow_film(out / "vorticity.gif", truths[number].trajectory.mesh, padded, truth=truths[number].trajectory.fields["velocity"],
                  names=(best.name, "finite elements"))
    write_whole(out / "report.html", shell("Flows: speed against error", _body(report, film)).encode())
    return content


def headline(rows: list[Row]) -> str:
    """The result in one sentence: the best learned predictor beside a flow that does not change."""
    idle = next((row for row in rows if row.name == IDLE), None)
    judged = [row for row in rows if row.kind in ("learned", "foreign")]
    if idle is None or not judged:
        return "No learned predictor was held against a flow that does not change."
    best = min(judged, key=lambda row: row.scores["velocity_rmse_all"])
    said = []
    for key, words in (("velocity_rmse_50", "over 50 steps"), ("velocity_rmse_all", "over all steps")):
        own, still = best.scores[key], idle.scores[key]
        said.append(f"{words} {shown(own)} m/s, {shown(still / own)} times closer than a flow that does not change" if own < still else
                    f"{words} {shown(own)} m/s, no better than a flow that does not change ({shown(still)})")
    return f"{best.name}: {'; '.join(said)}."


def _body(report: FlowReport, film: str) -> str:
    heads = "".join(f"<th>{escape(c.head)}{f' [{escape(c.unit)}]' if c.unit else ''}</th>" for c in COLUMNS.values())
    lines = "".join(
        f"<tr><th scope=row>{escape(row.name)}</th>" + "".join(f"<td>{shown(row.scores[key])}</td>" for key in COLUMNS) + "</tr>"
        for row in report.rows)
    meanings = "".join(f"<dt>{escape(c.head)}</dt><dd>{escape(c.meaning)}</dd>" for c in COLUMNS.values())
    kinds = "; ".join(f"{escape(row.name)}: {escape(KINDS[row.kind])}" for row in report.rows)
    notes = "".join(f"<li>{escape(note)}</li>" for note in [
        f"{len(report.files)} flows: {', '.join(report.files)}; means over them, of slip and flux the largest.",
        "A rollout begins at the first frame in which the fluid moves. Predictors that repeat or go on with a past are shown the first "
        "half of the frames, and have no other error than that in the second half.",
        "The solver takes steps as long as stability lets it; it is made cheaper by larger cells or lower order, not by longer steps.",
        "The reference is the data's own solver; its figures of the equations are those that storage leaves of a perfect prediction.",
        *report.notes])
    moving = f"<h2>Vorticity</h2><p>{escape(film)}</p><img src=vorticity.gif alt=vorticity>" if film else ""
    return (f"<h1>Flows: speed against error</h1><p class=lead>{escape(headline(report.rows))}</p><img src=pareto.png alt='speed against "
            f"error'><p>{kinds}.</p><table><tr><th></th>{heads}</tr>{lines}</table>{moving}<h2>What is what</h2><dl>{meanings}</dl>"
            f"<h2>Limits</h2><ul>{notes}</ul><p>{escape(machine())}</p>")
