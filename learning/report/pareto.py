"""Speed against error: time per step and RMSD over whole rollouts, both logarithmic, every predictor a labelled point."""

from __future__ import annotations

import math
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from learning.report.table import Row
from physics.whole import write_whole

COLOURS = {"learned": "#c8102e", "foreign": "#14161a", "trivial": "#7a7d82", "fe": "#1f4e9c", "hybrid": "#7b2d8b", "reduced": "#c77700",
           "reference": "#0b7a4b"}
MARKERS = {"learned": "o", "foreign": "X", "hybrid": "P", "trivial": "D", "fe": "s", "reduced": "^", "reference": "*"}
# Where a label may stand, the nearest places first: its offset from the point in points, and which of its corners is put there.
PLACES = [((x * far, y * far), {-1: "right", 0: "center", 1: "left"}[x], {-1: "top", 0: "center", 1: "bottom"}[y])
          for far, (x, y) in product((8, 14, 24, 38, *range(54, 500, 16)),
                                     ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 0), (-1, 0), (0, 1), (0, -1)))]
ACROSS, UP = {"left": 0.0, "center": 0.5, "right": 1.0}, {"bottom": 0.0, "center": 0.5, "top": 1.0}  # share of the box before it
TIME = "processor time per step [ms], set-up included (end of the bar: excluded)"
LONGEST = 48  # letters of a label
FEWEST = 4  # trajectories of which a spread is shown
GROWTHS = 8  # of the picture's height, by a quarter each: then there is room for some hundred labels


def measure_of(rows: list[Row]) -> str:
    """The error that all rows have in all trajectories: to the solution on finer cells where there is one, else to the data."""
    every = [each.get("rmsd_refined", math.nan) for row in rows for each in (row.scores, *row.each)]
    return "rmsd_all" if not every or any(map(math.isnan, every)) else "rmsd_refined"


def front(rows: list[Row], error: str = "rmsd_all") -> list[Row]:
    """Predictors that no other beats or equals in both time and error, the fastest first."""
    best, lowest = [], math.inf
    for row in sorted((row for row in rows if not math.isnan(row.ms_per_step)), key=lambda row: (row.ms_per_step, row.scores[error])):
        if row.scores[error] < lowest:
            best.append(row)
            lowest = row.scores[error]
    return best


def pareto_picture(path: Path, rows: list[Row], *, across: str = TIME, up: str = "", error: str = "", factor: float = 1e3) -> None:
    """Write the picture as PNG. A point is a mean over the trajectories; a bar leads from it to its time without set-up, and a thin cross
    has the medians and quartiles of the trajectories. What the axes say is `across` and `up`, by default of whole rollouts.

    Against the data the reference has no error and is a line at its time; against finer cells it is a point like all others,
    and a line shows its error: what lies on that line knows the body as well as the data do.

    error: the score that is shown, times a factor; by default that of `measure_of` in millimetres
    """
    error = error or measure_of(rows)
    figure = Figure(figsize=(10, 6.2), dpi=110, facecolor="white", layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    to = "the scene on cells of half the size" if error == "rmsd_refined" else "the data"
    axes.set(xscale="log", yscale="log", xlabel=across, ylabel=up or f"RMSD to {to}, whole rollouts, free nodes [mm]")
    _spread(axes, rows, error, factor)
    points = {row.name: (row.ms_per_step, factor * row.scores[error]) for row in rows if row.scores[error] > 0 and row.ms_per_step > 0}
    best = [points[row.name] for row in front(rows, error) if row.name in points]
    axes.step([x for x, _ in best], [y for _, y in best], where="post", color="#dcdcdc", lw=6, zorder=1,
              label="front: nothing is both faster and closer")
    learned = [points[row.name] for row in front([row for row in rows if row.kind == "learned"], error) if row.name in points]
    if len(learned) > 1 and learned != best:
        axes.step([x for x, _ in learned], [y for _, y in learned], where="post", color=COLOURS["learned"], lw=1.8, alpha=0.4, zorder=1.5,
                  label="front of what is learned")
    for row in rows:
        colour = COLOURS[row.kind]
        if row.name in points:
            x, y = points[row.name]
            axes.plot([row.scores.get("ms_per_step_alone", x), x], [y, y], color=colour, lw=1.4, alpha=0.6, zorder=2)
            axes.scatter(x, y, s=120 if row.kind == "reference" else 62, color=colour, marker=MARKERS[row.kind], zorder=3)
            if row.kind == "reference":
                axes.axhline(y, color=colour, ls=":", lw=1.2, label="error of the data")
        elif math.isnan(row.ms_per_step) and row.scores[error] > 0:
            axes.axhline(factor * row.scores[error], color=colour, ls="-.", lw=1.2, label=f"{row.name}: its time is not known")
        elif row.kind == "reference":
            axes.axvline(row.ms_per_step, color=colour, ls="--", lw=1.3, label=f"{row.name}: zero error by definition")
    axes.margins(x=0.16, y=0.14)
    axes.grid(which="major", color="#ececec", lw=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, 1.09), ncols=2)
    canvas.draw()
    labels = [(row.name if len(row.name) <= LONGEST else row.name[:LONGEST - 1] + "…", points[row.name], COLOURS[row.kind])
              for row in rows if row.name in points]
    for _ in range(GROWTHS):
        if _label(axes, labels):
            break
        for note in list(axes.texts):
            note.remove()
        figure.set_figheight(1.25 * figure.get_figheight())
        canvas.draw()
    else:
        _label(axes, labels)
    picture = BytesIO()
    figure.savefig(picture, format="png")
    write_whole(path, picture.getvalue())


def _spread(axes: Any, rows: list[Row], error: str, factor: float) -> None:
    """Between the quartiles of the trajectories a bar in time and one in error, which cross where their medians are; of a few it says
    nothing."""
    for row in rows:
        each = np.array([(one.get("ms_per_step", math.nan), factor * one.get(error, math.nan)) for one in row.each])
        if len(each) < FEWEST or not np.isfinite(each).all() or not (each > 0).all():
            continue
        (low, bottom), (x, y), (high, top) = np.quantile(each, [0.25, 0.5, 0.75], axis=0)
        for across, up in (([low, high], [y, y]), ([x, x], [bottom, top])):
            axes.plot(across, up, color=COLOURS[row.kind], lw=1.0, zorder=2, marker="|" if across[0] != across[1] else "_", ms=5)


def _label(axes: Any, labels: list[tuple[str, tuple[float, float], str]]) -> bool:
    """Put each label at the first place where it covers no other label, no point and no edge of the picture.

    Where there is none it goes where it covers the least; gives whether that was never so.
    """
    renderer, inside, dot = axes.figure.canvas.get_renderer(), axes.get_window_extent().padded(2), axes.figure.dpi / 72
    spots = [axes.transData.transform(point) for _, point, _ in labels]
    taken, free = [inside.from_extents(x - 8, y - 8, x + 8, y + 8) for x, y in spots], True
    for number, (text, point, colour) in enumerate(labels):
        # A label must not stand nearer to another point than to its own.
        near = [box.padded(7) if other != number and other < len(labels) else box for other, box in enumerate(taken)]
        note = axes.text(*point, text, fontsize=8.5)
        size = np.array(note.get_window_extent(renderer).size)
        note.remove()
        fewest, best, where = math.inf, PLACES[0], inside
        for place in PLACES:
            low = spots[number] + dot * np.array(place[0]) - size * [ACROSS[place[1]], UP[place[2]]]
            box = inside.from_bounds(*low, *size)
            covered = sum(box.overlaps(other) for other in near) + (not (inside.x0 <= box.x0 and box.x1 <= inside.x1
                                                                          and inside.y0 <= box.y0 and box.y1 <= inside.y1))
            if covered < fewest:
                fewest, best, where = covered, place, box
            if not covered:
                break
        offset, across, up = best
        axes.annotate(text, point, xytext=offset, textcoords="offset points", fontsize=8.5, ha=across, va=up, color=colour,
                      arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.5} if max(map(abs, offset)) > 8 else None)
        taken.append(where.padded(2))
        free = free and not fewest
    return free
