"""Speed against error: time per step and RMSE over all steps, both logarithmic, every predictor a labelled point."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from learning.table import Row

COLOURS = {"learned": "#c8102e", "hybrid": "#7b2d8b", "trivial": "#7a7d82", "fe": "#1f4e9c", "reference": "#0b7a4b"}
MARKERS = {"learned": "o", "hybrid": "P", "trivial": "D", "fe": "s"}


def front(rows: list[Row]) -> list[Row]:
    """Predictors that no other beats or equals in both time and RMSE-all, the fastest first; the reference has no error."""
    best, lowest = [], math.inf
    for row in sorted(rows, key=lambda row: (row.ms_per_step, row.scores["rmse_all"])):
        if row.scores["rmse_all"] < lowest:
            best.append(row)
            lowest = row.scores["rmse_all"]
    return best


def pareto_picture(path: Path, rows: list[Row]) -> None:
    """Write the picture as PNG. Finite elements on coarser meshes are joined; the reference is a line at its time."""
    figure = Figure(figsize=(9, 5.6), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set(xscale="log", yscale="log", xlabel="wall time per step [ms]", ylabel="RMSE over all steps and free nodes [mm]")
    points = {row.name: (row.ms_per_step, 1e3 * row.scores["rmse_all"]) for row in rows
              if row.kind != "reference" and row.scores["rmse_all"] > 0 and row.ms_per_step > 0}
    best = [points[row.name] for row in front(rows) if row.name in points]
    axes.step([x for x, _ in best], [y for _, y in best], where="post", color="#d9d9d9", lw=6, zorder=1,
              label="front: nothing is both faster and closer")
    ladder = sorted(points[row.name] for row in rows if row.kind == "fe" and row.name in points)
    axes.plot([x for x, _ in ladder], [y for _, y in ladder], color=COLOURS["fe"], lw=1.2, zorder=2)
    trivial = 0  # their labels stand above and below in turn, those of the ladder on its left
    for row in sorted(rows, key=lambda row: row.ms_per_step):
        if row.kind == "reference":
            axes.axvline(row.ms_per_step, color=COLOURS[row.kind], ls="--", lw=1.3,
                         label=f"{row.name}: zero error by definition")
        elif row.name in points:
            axes.scatter(*points[row.name], s=70, color=COLOURS[row.kind], marker=MARKERS[row.kind], zorder=3)
            offset = (-9, -3) if row.kind == "fe" else (0, -17 if trivial % 2 and row.kind == "trivial" else 9)
            axes.annotate(row.name, points[row.name], xytext=offset, textcoords="offset points", fontsize=9,
                          ha="right" if row.kind == "fe" else "center", color=COLOURS[row.kind])
            trivial += row.kind == "trivial"
    axes.margins(x=0.2, y=0.16)
    axes.grid(which="major", color="#ececec", lw=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, 1.1), ncols=2)
    figure.savefig(path)
