"""What the figures of `verify` are called, in which unit they are shown, what each of them is, and how those of several paths gather.

Values are in SI units, under the names of `verify.Fidelity`; people see them under a heading, in the unit that suits them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Column:
    """One figure: its heading, the unit it is shown in and the factor to it from the SI unit, and what it is."""

    head: str
    unit: str
    si: str
    factor: float
    meaning: str


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
FIGURES = ERROR | PHYSICS | MESH
EXTREMES = {"largest_penetration": max, "smallest_det_f": min, "smallest_scaled_jacobian": min, "inverted_elements": max}


def gathered(each: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Means over paths, of extremes the extreme; what only some of them have, over those."""
    found = {}
    for key in each[0]:
        values = [float(figures[key]) for figures in each if not math.isnan(figures[key])]
        together = EXTREMES.get(key, lambda some: sum(some) / len(some))
        found[key] = float(together(values)) if values else math.nan
    return found


def verdict(figures: dict[str, Any], still: dict[str, Any]) -> str:
    """What the figures say of a prediction, in one sentence, beside those of the same body if nothing moved."""
    error, idle = figures["rmse_all"], still["rmse_all"]
    if not idle:
        said = f"The truth does not move; the prediction is {shown(1e3 * error)} mm off"
    elif not error:
        said = "No different from the truth"
    elif error < idle:
        said = f"Better than if nothing moved: {shown(1e3 * error)} mm off, {shown(idle / error)} times closer"
    else:
        said = f"No better than if nothing moved: {shown(1e3 * error)} mm off, {shown(error / idle)} times as far"
    parts = []
    if not math.isnan(figures["relative_residual"]):
        parts.append(f"{shown(100 * figures['relative_residual'])} % of the largest reaction is missing to equilibrium")
    if figures["largest_penetration"] > 0.01 * still["largest_penetration"]:
        parts.append(f"the obstacle is up to {shown(1e3 * figures['largest_penetration'])} mm inside the body")
    if not math.isnan(figures["inverted_elements"]):  # plane cells have none
        inverted = int(figures["inverted_elements"])
        parts.append(f"{inverted or 'no'} cell{'s are' if inverted > 1 else ' is'} turned inside out")
    return f"{'; '.join([said, ', '.join(parts)] if parts else [said])}."


def shown(value: float) -> str:
    """A number with three digits; a dash for what is not one."""
    return "–" if math.isnan(value) else "0" if value == 0 else f"{value:.3g}"
