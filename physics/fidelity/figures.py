"""What the figures of `verify` are called, in which unit they are shown, what each of them is, and how those of several paths gather.

Values are in SI units, under the names of `verify.Fidelity`; people see them under a heading, in the unit that suits them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
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
    "rmsd_1": Column(
        "RMSD-1", "mm", "m", 1e3,
        "root mean square distance after one step that starts from the true state: root of the mean, over steps and <b>free</b> "
        "nodes, of the squared distance between predicted and true place; then the mean over trajectories. Finite elements start no "
        "step from a given state and have none"),
    "rmsd_50": Column(
        "RMSD-50", "mm", "m", 1e3,
        "the same over steps 1 to 50 of a rollout: from the rest state, each step from the predicted one before; "
        "<b>free</b> nodes"),
    "rmsd_all": Column(
        "RMSD-all", "mm", "m", 1e3, "the same over all steps of the rollout; <b>free</b> nodes. The figure to compare by"),
    "rmsd_all_all_nodes": Column(
        "RMSD-all, all nodes", "mm", "m", 1e3,
        "the same over <b>all</b> nodes of the body; smaller, because held nodes have no error"),
}
_STEPS = {"1": "one step from the true state, all steps", "50": "steps 1 to 50 of a rollout", "all": "all steps of a rollout"}
PUBLISHED = {f"rmse_{key}{how}{nodes}": Column(
    f"RMSE-{key}{', by step' if how else ''}{', all nodes' if nodes else ''}", "mm", "m", 1e3,
    f"{steps}: " + ("the mean over steps and trajectories of each step's root of the mean square" if how else
                    "root of the mean square over all steps and trajectories at once") + " of a <b>coordinate</b>'s error; "
    + ("<b>all</b> nodes of the body" if nodes else "<b>free</b> nodes"))
    for nodes in ("", "_all_nodes") for how in ("", "_by_step") for key, steps in _STEPS.items()}
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
FLOW = {
    "velocity_rmse_1": Column(
        "RMSE-1", "m/s", "m/s", 1, "of a component of the velocity, inside and at the outflow, after one step from the true state; "
        "without such steps after the first one"),
    "velocity_rmse_50": Column("RMSE-50", "m/s", "m/s", 1, "the same over steps 1 to 50 of a rollout"),
    "velocity_rmse_all": Column("RMSE-all", "m/s", "m/s", 1, "the same over all steps. The figure to compare by"),
    "pressure_rmse_50": Column("pressure RMSE-50", "Pa", "Pa", 1, "of the pressure at all nodes, steps 1 to 50 of a rollout"),
    "pressure_rmse_all": Column("pressure RMSE-all", "Pa", "Pa", 1, "the same over all steps"),
    "divergence": Column("divergence", "1/s", "1/s", 1, "root mean square over the domain and the checked frames"),
    "momentum_residual": Column(
        "momentum residual", "", "1", 1, "what is missing in the momentum equation, in its weak norm, over density x speed² x root of the "
        "area; root mean square over the checked frames. Needs no reference"),
    "slip": Column("slip", "m/s", "m/s", 1, "largest difference to the velocity that is given at walls and inlets"),
    "flux_error": Column("flux error", "", "1", 1, "largest of all sections and checked frames, over the largest inflow"),
    "drag_error": Column("drag error", "", "1", 1, "root mean square over the checked frames, over the largest drag"),
    "lift_error": Column("lift error", "", "1", 1, "the same of the lift, over the largest or a hundredth of the drag"),
    "kinetic_energy_error": Column("kinetic energy error", "", "1", 1, "the same, over the largest"),
    "strouhal": Column("Strouhal number", "", "1", 1, "of the lift in the second half; a dash where nothing sheds"),
    "strouhal_error": Column("Strouhal error", "", "1", 1, "over that of the truth"),
    "spectrum_error": Column(
        "spectrum error", "", "1", 1, "of the amplitudes of the velocity across, one, two and four diameters behind the cylinder, over "
        "those of the truth"),
}
FIGURES = ERROR | PUBLISHED | PHYSICS | MESH
FIELD_UNITS = {"stress": "Pa", "von_mises": "Pa", "pressure": "Pa", "velocity": "m/s"}
AT_ONCE = [key for key in (*PUBLISHED, *FLOW) if "rmse_" in key and "by_step" not in key]
EXTREMES = {"largest_penetration": max, "smallest_det_f": min, "smallest_scaled_jacobian": min, "inverted_elements": max, "slip": max,
            "flux_error": max}


def of_field(name: str) -> str:
    """The key of a further field's error."""
    return f"rmse_all:{name}"


def field_columns(keys: Iterable[str]) -> dict[str, Column]:
    """The figures of further fields among some keys."""
    found = {}
    for key in dict.fromkeys(keys):
        if key.startswith(of_field("")):
            name = key.partition(":")[2]
            unit = FIELD_UNITS.get(name, "")
            found[key] = Column(f"RMSE-all of {name}", unit, unit or "1", 1,
                                f"root of the mean square over all steps, numbers and <b>all</b> nodes of the body, of the error of {name}")
    return found


def gathered(each: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Means over paths, of extremes the extreme, of errors as published the root of the mean square, every path with the same weight;
    what only some of them have, over those."""
    found = {}
    for key in each[0]:
        values = [float(figures[key]) for figures in each if not math.isnan(figures[key])]
        together = EXTREMES.get(key, _root_mean_square if key.partition(":")[0] in AT_ONCE else _mean)
        found[key] = float(together(values)) if values else math.nan
    return found


def _mean(some: Sequence[float]) -> float:
    return sum(some) / len(some)


def _root_mean_square(some: Sequence[float]) -> float:
    return math.sqrt(_mean([value * value for value in some]))


def verdict(figures: dict[str, Any], still: dict[str, Any]) -> str:
    """What the figures say of a prediction, in one sentence, beside those of the same body if nothing moved."""
    said = _beside(figures["rmsd_all"], still["rmsd_all"], 1e3, "mm", "move", "moved")
    parts = []
    if not math.isnan(figures["relative_residual"]):
        parts.append(f"{shown(100 * figures['relative_residual'])} % of the largest reaction is missing to equilibrium")
    if figures["largest_penetration"] > 0.01 * still["largest_penetration"]:
        parts.append(f"the obstacle is up to {shown(1e3 * figures['largest_penetration'])} mm inside the body")
    if not math.isnan(figures["inverted_elements"]):  # plane cells have none
        inverted = int(figures["inverted_elements"])
        parts.append(f"{inverted or 'no'} cell{'s are' if inverted > 1 else ' is'} turned inside out")
    return f"{'; '.join([said, ', '.join(parts)] if parts else [said])}."


def verdict_of_flow(figures: dict[str, Any], idle: dict[str, Any]) -> str:
    """What the figures say of a predicted flow, in one sentence, beside those of one that stays as it is shown."""
    said = _beside(figures["velocity_rmse_all"], idle["velocity_rmse_all"], 1.0, "m/s", "change", "changed")
    parts = [f"{name} {shown(100 * figures[key])} % off" for key, name in (("drag_error", "drag"), ("flux_error", "the flux up to"))
             if not math.isnan(figures[key])]
    return f"{'; '.join([said, ', '.join(parts)] if parts else [said])}."


def shown(value: float) -> str:
    """A number with three digits; a dash for what is not one."""
    return "–" if math.isnan(value) else "0" if value == 0 else f"{value:.3g}"


def _beside(error: float, idle: float, factor: float, unit: str, verb: str, past: str) -> str:
    """An error beside that of what never moves, or changes."""
    off = f"{shown(factor * error)} {unit} off"
    if not idle:
        return f"The truth does not {verb}; the prediction is {off}"
    if not error:
        return "No different from the truth"
    if error < idle:
        return f"Better than if nothing {past}: {off}, {shown(idle / error)} times closer"
    return f"No better than if nothing {past}: {off}, {shown(error / idle)} times as far"
