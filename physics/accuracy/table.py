"""What was chosen for an error that is asked, what each choice makes of the error, and what it costs: one table.

A row is a choice, what was taken, its share of the error (relative) and seconds of the processor of the whole scene. Those of the next
coarser and finer mesh are the pilots', by how much longer the whole scene took than its own pilot.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from physics.accuracy.choose import MOST_NODES, Choice
from physics.accuracy.climb import Climb
from physics.accuracy.estimate import distance, norm
from physics.accuracy.meshes.ladder import Sizes
from physics.accuracy.pilot import Pilot
from physics.equilibrium.state import NoEquilibrium
from physics.mesh.mesh import Floats
from physics.solution import Solution

HEADS = "choice", "taken", "error", "seconds"
BETWEEN = 2  # poses
Row = dict[str, Any]


@dataclass(frozen=True)
class Verdict:
    """asked, estimated: errors of the quantity, relative; reached: whether the one is below the other; remarks: what makes it doubtful."""

    asked: float
    quantity: str
    estimated: float
    reached: bool
    rows: tuple[Row, ...]
    remarks: tuple[str, ...]

    def table(self) -> dict[str, Any]:
        """As a JSON object, and in a trajectory file."""
        return {"asked": self.asked, "quantity": self.quantity, "estimated": self.estimated if math.isfinite(self.estimated) else None,
                "reached": self.reached,
                "rows": list(self.rows), "remarks": list(self.remarks)}

    def not_kept(self) -> str:
        """Why the error asked is not promised."""
        return (f"the error asked, {self.asked:.3g}, is not promised: {self._said()} on the best mesh tried, of at most {MOST_NODES} nodes")

    def _said(self) -> str:
        return f"{self.estimated:.2g} is estimated" if math.isfinite(self.estimated) else "nothing is known of it"

    def lines(self) -> list[str]:
        """For a reader."""
        said = f"error of the {self.quantity}: {self.asked:.3g} asked, {self._said()}, {'kept' if self.reached else 'NOT kept'}"
        cells = [HEADS, *((row["choice"], row["taken"], *(_number(row[head]) for head in HEADS[2:])) for row in self.rows)]
        wide = [max(len(row[i]) for row in cells) for i in range(len(HEADS))]
        lines = ["  ".join(entry.ljust(n) if i < 2 else entry.rjust(n) for i, (entry, n) in enumerate(zip(row, wide, strict=True))).rstrip()
                 for row in cells]
        return [said, *lines, *self.remarks]


def judge(choice: Choice, solution: Solution) -> Verdict:
    """What the whole scene came to, solved as it was chosen."""
    climb, pilots = choice.climb, choice.pilots
    family, frames = climb.family, len(solution.displacement) - 1
    path = _end(pilots.of(choice.scene, solution, [frames])[0], choice.pilot.values, pilots.weights)
    between, said = _between(choice, solution)
    linear = choice.small_strain if solution.linear_steps and not choice.scene.linear else 0.0
    rows = rows_of_mesh(climb)

    def add(name: str, taken: str, error: float | None, seconds: float | None = None) -> None:
        rows.append(row(name, taken, error, seconds))

    add("kinematics", "the linear law, as asked" if choice.scene.linear else
        f"small strain in {solution.linear_steps} of {frames} steps" if solution.linear_steps else "finite strain", linear)
    add("tolerance", f"{choice.tolerance:.0e} of the reaction", choice.loose)
    add("steps", f"{len(solution.knots) - 1} of {frames} are solved, those between lie on cubic splines" if solution.knots else
        f"all {frames} are solved", solution.between)
    add("the path", "its end, against the pilot's", path)
    add("poses between", said, between)
    estimated = climb.error + linear + choice.loose + solution.between + path + between
    reached = bool(climb.reached and estimated <= choice.asked)
    ratio = solution.seconds / choice.pilot.seconds if choice.pilot.seconds else math.nan  # clocks of shared cores may stand still
    add("the whole scene", f"{family.said(climb.sizes)}; {climb.said}", estimated, solution.seconds)
    coarser, finer = _beside(choice)
    for name, mesh in (("next coarser", coarser), ("next finer", finer)):
        if mesh is not None:
            sizes, error, seconds = mesh
            add(name, family.said(sizes), error, None if seconds is None or math.isnan(ratio) else seconds * ratio)
    if choice.other is not None:
        other = choice.other
        sizes, error = other.ladder[-1]
        add("the other order", other.family.said(sizes) + ("" if other.reached else ", given up"), error,
            pilots(other.family, sizes).seconds * ratio)
    add("the search", f"{len(pilots)} solutions at {len(pilots.fractions)} poses", None, pilots.seconds)
    remarks = ("the error does not fall regularly: the larger of two differences is taken",) * (climb.how == "irregular")
    if solution.snap.any():
        remarks += ("the body snaps: where it comes to rest depends on more than the mesh, and the estimate knows nothing of that",)
    return Verdict(choice.asked, choice.quantity, estimated, reached and not solution.snap.any(), tuple(rows), remarks)


def _end(values: Floats, poses: Floats, weights: Floats) -> float:
    """How far the end (M, d) is from that of the pilot, over the largest of its poses (K, M, d): a load may be taken off again."""
    off, size = norm((values - poses[-1])[None], weights), max(norm(pose[None], weights) for pose in poses)
    return off / size if size > 0 else 0.0 if off == 0 else math.inf


def row(name: str, taken: str, error: float | None, seconds: float | None = None) -> Row:
    """One of the table."""
    known = None if error is None or not math.isfinite(error) else error
    return dict(zip(HEADS, (name, taken, known, seconds), strict=True))


def rows_of_mesh(climb: Climb) -> list[Row]:
    """What each direction makes of the error."""
    family, box = climb.family, climb.family.body.shape in ("beam", "plate")
    return [row(f"cells along {family.axes[axis]}" if box else f"cells: {family.axes[axis]}", f"{climb.sizes[axis]}, order {family.order}",
                part.error) for axis, part in sorted(climb.parts.items())]


def _between(choice: Choice, solution: Solution) -> tuple[float, str]:
    """What the mesh makes of the error at poses that no pilot looked at, over that at those which they did; and where.

    The mesh before, or the one that the answer was held against, is solved there from the answer; differences between two meshes stand
    for errors.
    """
    climb, pilots, frames = choice.climb, choice.pilots, len(solution.displacement) - 1
    if pilots.straight:
        return 0.0, "none is looked at: the path goes one way"
    looked = {round(frames * float(fraction)) for fraction in pilots.fractions}
    ends = sorted({0, *looked})
    middles = [(a + b + 1) // 2 for a, b in pairwise(ends) if b - a > 1]
    middles = [middle for middle in middles if middle not in looked][-BETWEEN:]
    family, before = climb.family, climb.ladder[-2][0] if len(climb.ladder) > 1 else climb.checked
    if before is None or not middles:
        return 0.0, "none was looked at"
    fractions = np.array(middles) / frames
    scene, mesh = family.rung(before)
    here = Pilot(solution.mesh, pilots.of(choice.scene, solution, middles), solution.displacement[middles], 0.0)
    started = time.process_time()
    try:
        there = pilots.beside(scene, mesh, pilots.tolerance, here, fractions)
    except (NoEquilibrium, ValueError):
        return 0.0, "another mesh has no equilibrium beside the answer"
    finally:
        pilots.seconds += time.process_time() - started
    size = float(np.sqrt(np.einsum("m,kmd->", pilots.weights, choice.pilot.values**2) / len(pilots.fractions)))
    off = float(np.sqrt(np.einsum("m,kmd->", pilots.weights, (there.values - here.values) ** 2) / len(middles)))
    known = distance(pilots(family, before).values, choice.pilot.values, pilots.weights)
    more = max(0.0, off / size / known - 1) if known > 0 and size > 0 else 0.0
    return climb.error * more * len(middles) / (len(middles) + len(looked)), f"looked at at steps {', '.join(map(str, middles))}"


def _beside(choice: Choice) -> tuple[tuple[Sizes, float, float | None] | None, ...]:
    """The meshes next to the chosen one, each with its error and the seconds of its pilot."""
    climb, pilots = choice.climb, choice.pilots
    coarser = climb.ladder[-2] if len(climb.ladder) > 1 else None
    axis = max(climb.parts, key=lambda one: climb.parts[one].error)
    finer, part = climb.family.after(climb.sizes, axis), climb.parts[axis]
    error = climb.error - part.error * (1 - (climb.sizes[axis] / finer[axis]) ** part.order)
    return (None if coarser is None else (*coarser, pilots(climb.family, coarser[0]).seconds),
            (finer, error, pilots(climb.family, finer).seconds if pilots.knows(climb.family, finer) else None))


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2g}"
