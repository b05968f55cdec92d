"""A study as one page, report.html: its tables, what the spread allows to say, and the curves of its trainings."""

from __future__ import annotations

import base64
import io
from html import escape
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from learning.study.table import COST, Result, facts
from physics.view import shell
from physics.whole import write_whole

STYLE = "td{text-align:right;white-space:nowrap}th{text-align:left}.wide{overflow-x:auto}"
COLOURS = ("#c8102e", "#1f4e9c", "#0b7a4b", "#c77700", "#7b2d8b", "#14161a", "#7a7d82", "#00889c")


def write_page(out: Path, result: Result) -> None:
    """Write report.html, whole."""
    plan = result.plan
    body = f"<h1>{escape(plan.title)}</h1>" + "".join(f"<p>{escape(text)}</p>" for text in (*plan.about.split("\n\n"), facts(plan)) if text)
    for test in plan.tests:
        said = "".join(f"<li>{escape(line)}</li>" for line in result.apart(test.name))
        body += f"<h2>Tested on: {escape(test.name)}</h2>{_table(result.heads(), result.table(test.name))}<ul>{said}</ul>"
    drawn = base64.b64encode(curves(result)).decode()
    told = "Error in validation, the root mean square distance of whole rollouts, against training steps and against time, and the loss. "
    body += (f'<h2>Curves</h2><figure><img src="data:image/png;base64,{drawn}" alt="{told}" style="max-width:100%">'
             f"<figcaption>{told}A line for each training, a colour for each row.</figcaption></figure>")
    meanings = "".join(f"<dt>{escape(column.head)}</dt><dd>{column.meaning}.</dd>" for column in result.columns.values())
    write_whole(out / "report.html", shell(plan.title, f"{body}<h2>What the columns are</h2><dl>{meanings}</dl>", STYLE).encode())


def _table(head: list[str], lines: list[list[str]]) -> str:
    rows = "".join(f'<tr><th scope="row">{escape(line[0])}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in line[1:])}</tr>'
                   for line in lines)
    return f'<div class="wide"><table><tr>{"".join(f"<th>{escape(cell)}</th>" for cell in head)}</tr>{rows}</table></div>'


def curves(result: Result) -> bytes:
    """The curves of all trainings, as PNG: error in validation against steps and seconds, loss against steps."""
    figure = Figure(figsize=(13, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels, unit = figure.subplots(1, 3), result.columns.get("valid_equal", COST["valid_equal"]).si
    for panel, (across, up) in zip(panels, (("step", "error"), ("seconds", "error"), ("step", "loss")), strict=True):
        for number, (name, runs) in enumerate(result.curves.items()):
            for seed, lines in enumerate(runs):
                points = [(line[across], line[up]) for line in lines if _drawn(line.get(across)) and _drawn(line.get(up))]
                panel.plot(*zip(*points, strict=True), color=COLOURS[number % len(COLOURS)], lw=1.2, marker="." if len(points) < 12 else "",
                           ls=("-", "--", ":", "-.")[number // len(COLOURS) % 4], label=name if not seed else None) if points else None
        panel.set(xlabel={"step": "training steps", "seconds": "seconds of training"}[across],
                  ylabel={"error": f"error in validation [{unit}]", "loss": "loss"}[up])
        if panel.lines:
            panel.set_yscale("log")
        panel.grid(color="#ececec", lw=0.8)
        panel.spines[["top", "right"]].set_visible(False)
    handles, labels = panels[2].get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    image = io.BytesIO()
    figure.savefig(image, dpi=110)
    return image.getvalue()


def _drawn(value: Any) -> bool:
    return isinstance(value, int | float) and value > 0
