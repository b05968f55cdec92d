"""The whole scene on the mesh that was chosen: of a path that is smooth in parts few steps are solved, those between lie on cubic splines.

Where loads, supports and obstacles go on evenly, equilibria are a smooth function of the fraction of the loading. A path may have kinks
where an obstacle turns, where a table has a row, and where an obstacle comes to the body or leaves it. So splines run from kink to kink,
through FEWEST steps of each part at first, the knots. How far they are off is seen when every second knot is left out and held against
the splines through the others: with an error that fell as slowly as k^2 for parts of k steps a quarter of that would be left, which is
what counts. Under an obstacle all of it counts: there paths ripple as one row of points touches after the other, and denser knots may
step over as much. Intervals where it is too much are divided, so that knots gather where the path bends. Where they would be more than
SHARE of the steps all are solved. So they are where a step fails, or the body snaps: splines know nothing of that. A step is begun
between the last ones and what is known ahead: the poses that the search has found, and later the knots there.

Held components stay on their prescription. The residual of a step between is that in the middle of its interval.
Legend: N nodes, K knots, n other steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from physics.accuracy.choose import Choice
from physics.accuracy.estimate import norm
from physics.accuracy.pilot import FEWEST, turns
from physics.body.supports import held
from physics.equilibrium.newton import TOLERANCE
from physics.equilibrium.path import LoadPath
from physics.equilibrium.state import NoEquilibrium, State
from physics.journal import Arrays
from physics.solution import Solution, of_path, solve

Floats = NDArray[np.float64]

BETWEEN = 0.05  # of the error asked
SHARE = 1 / 3  # of the steps: where more have to be solved all are
TRIES, MOST_PARTS = 8, 4  # of an interval at once
SLOWEST = {False: 2, True: 0}  # order with which the error of splines falls at least, without an obstacle and under one
USUAL = {False: 3, True: 1}  # and by which it is foreseen
ROUNDING = 1e-9  # of a step
BEFORE = 4  # states that a step is begun from


def solve_chosen(choice: Choice, *, on_step: Callable[[int], None] | None = None, journal: str | Path | None = None,
                 partial: bool = False, balanced: bool = False, snaps: bool = True) -> Solution:
    """All steps of a scene as it was chosen for an error: solved, or between solved ones (`Solution.knots`).

    Args: as of `solve`; a journal is kept where all steps are solved
        balanced: whether every step is to satisfy the equations, to TOLERANCE at least: then all are solved
    Raises: as `solve`
    """
    if not balanced and SHARE * choice.scene.steps.count >= FEWEST:
        try:
            found = Course(choice, on_step or (lambda step: None)).followed()
        except NoEquilibrium:
            found = None
        if found is not None:
            return found
    tolerance = min(choice.tolerance, TOLERANCE) if balanced else choice.tolerance
    return solve(choice.scene, mesh=choice.mesh, on_step=on_step, journal=journal, partial=partial, tolerance=tolerance,
                 small_strain=choice.small_strain, snaps=snaps)


@dataclass
class Knot:
    """A step that was solved: its state, and what `Solution` says of it."""

    state: State
    row: Arrays
    linear: bool


class Course:
    """The path of a scene through few of its steps, and more where it bends."""

    def __init__(self, choice: Choice, on_step: Callable[[int], None]) -> None:
        self._started, processor = time.perf_counter(), time.process_time()
        self._choice, self._scene, self._count, self._on_step = choice, choice.scene, choice.scene.steps.count, on_step
        self._path = LoadPath(choice.scene, choice.mesh, tolerance=choice.tolerance, small_strain=choice.small_strain, snaps=False)
        self._touched = bool(self._scene.obstacles)
        self._poses, self._knots = choice.states, {0: self._knot()}
        self._kinks = self._parts()
        self._set_up = time.process_time() - processor

    def followed(self) -> Solution | None:
        """The whole path; None where splines through a share of its steps are not close enough. Raises `NoEquilibrium`."""
        wanted = {0} | {round(step) for a, b in pairwise(self._kinks) for step in np.linspace(a, b, min(FEWEST, b - a) + 1)}
        for _ in range(TRIES):
            if len(wanted) - 1 > SHARE * self._count:
                break
            self._solve(sorted(wanted - set(self._knots)))
            wanted |= self._comings()
            off = self._missed()
            allowed = BETWEEN * self._choice.asked
            between = math.sqrt(sum((b - a - 1) * each**2 for (a, b), each in off.items()) / self._count)
            if between <= allowed:
                return self._filled(between)
            for (a, b), each in off.items():
                parts = min(b - a, MOST_PARTS, math.ceil((each / allowed) ** (1 / USUAL[self._touched])))
                wanted |= {round(step) for step in np.linspace(a, b, max(1, parts) + 1)}
        return None

    def _parts(self) -> list[int]:
        """Steps between which the path may be smooth, from the last one at rest on."""
        count, rests = self._count, self._path.balance.rests
        rest = next((step for step in range(count) if not rests((step + 1) / count)), count - 1)
        at = np.array(turns(self._scene)) * count
        kinks = np.concatenate([np.floor(at + ROUNDING), np.ceil(at - ROUNDING)]).astype(int)
        return sorted({rest, *kinks[kinks > rest].tolist()})

    def _comings(self) -> set[int]:
        """All knots, when those are found between which an obstacle comes to the body or leaves it: there its path has a kink."""
        first = None if self._path.balance.loaded else self._kinks[0]  # right after which it is known to be touched
        while True:
            steps = sorted(self._knots)
            turned = [(a, b) for a, b in pairwise(steps) if a != first and self._bears(a) != self._bears(b)]
            if all(b - a == 1 for a, b in turned):
                away = {a if sum(self._bears(a)) < sum(self._bears(b)) else b for a, b in turned}
                self._kinks = sorted({*self._kinks, *(step for step in away if step > self._kinks[0])})
                return set(steps)
            self._solve([(a + b) // 2 for a, b in turned if b - a > 1])

    def _bears(self, step: int) -> tuple[bool, ...]:
        """Which obstacles press at a knot."""
        row = self._knots[step].row
        return tuple(row["reactions"].any(axis=1).tolist()) if "reactions" in row else (bool(row["reaction"].any()) and self._touched,)

    def _solve(self, steps: Sequence[int]) -> None:
        """Make knots of some steps, in their order."""
        for step in steps:
            before = [knot.state for at, knot in sorted(self._knots.items()) if at < step]
            ahead = [knot.state for at, knot in sorted(self._knots.items()) if at > step]
            self._path.states, self._path.ahead = before[-BEFORE:], ahead or self._poses
            self._path.advance(step / self._count)
            if not (ahead or self._path.ahead):  # they led astray
                self._poses = []
            self._knots[step] = self._knot()
            self._on_step(step)

    def _knot(self) -> Knot:
        return Knot(self._path.states[-1], self._path.frame(), self._path.linear is not None)

    def _missed(self) -> dict[tuple[int, int], float]:
        """About how far splines are off in each interval between knots, over the values themselves, in the quantity the error is of."""
        pilots, found, steps = self._choice.pilots, self._solution(), np.array(sorted(self._knots))
        values = pilots.of(self._scene, found, list(range(len(steps))))
        size = norm(values[1:] * np.sqrt(np.diff(steps) / self._count)[:, None, None], pilots.weights)
        off = np.zeros(len(steps))
        for a, b in pairwise(self._kinks):
            own = np.flatnonzero((a <= steps) & (steps <= b))
            for left in (own[1:-1:2], own[2:-1:2]):
                if len(left) and len(own) <= b - a:
                    kept = np.setdiff1d(own, left)
                    led: dict[str, Any] = {}
                    for name in ("displacement", "reaction"):
                        led[name] = (given := getattr(found, name)).copy()
                        led[name][left] = np.tensordot(splines(steps[kept], steps[left]), given[kept], 1)
                    miss = pilots.of(self._scene, replace(found, **led), left.tolist()) - values[left]
                    off[left] = [norm(one[None], pilots.weights) / size / 2**SLOWEST[self._touched] if size > 0 else 0.0 for one in miss]
        return {(int(steps[i]), int(steps[i + 1])): max(off[i], off[i + 1]) for i in range(len(steps) - 1) if steps[i + 1] - steps[i] > 1}

    def _solution(self) -> Solution:
        """The knots alone."""
        path, knots = self._path, [self._knots[step] for step in sorted(self._knots)]
        rows: dict[str, Any] = {name: np.array([knot.row[name] for knot in knots]) for name in knots[0].row}
        return Solution(mesh=self._choice.mesh, **rows, factorisations=path.newton.factorisations, halvings=path.halvings,
                        linear_steps=sum(knot.linear for knot in knots[1:]), model=path.model(),
                        seconds=time.perf_counter() - self._started, set_up=self._set_up)

    def _filled(self, off: float) -> Solution:
        """The knots, and the steps between, which are off by so much."""
        count, balance, found, ends = self._count, self._path.balance, self._solution(), sorted(self._knots)
        to = self._through(ends)
        names = ("displacement", "reaction", "energy", "penetration", *(("reactions",) if found.reactions is not None else ()))
        each: dict[str, Any] = {name: np.tensordot(to, getattr(found, name), 1) for name in names}
        if self._touched:
            each |= self._pressing(found, each, ends)
        u, fixed = each["displacement"], held(self._scene, found.mesh)
        for step in set(range(count + 1)) - set(ends):
            u[step][fixed] = balance.moved(step / count)[fixed]
        linear = max(step for step in ends if self._knots[step].linear or not step)
        residual, iterations, zeros = np.zeros(count + 1), np.zeros(count + 1, np.int64), np.zeros(count + 1)
        residual[ends], iterations[ends] = found.relative_residual, found.newton_iterations
        for a, b in pairwise(ends):
            middle = (a + b + 1) // 2
            left = b <= linear and self._path.linear is None  # its balance is no longer that of small strain
            residual[a + 1:b] = residual[b] if left or b - a == 1 else self._left(u[middle], middle)
        said = f"{len(ends) - 1} of {count} are solved, the others lie on cubic splines through them"
        return of_path(self._scene, replace(
            found, **each, newton_iterations=iterations, relative_residual=residual, snap=zeros, released=zeros, linear_steps=linear,
            knots=tuple(ends), between=off, seconds=time.perf_counter() - self._started, model=found.model | {"steps": said}))

    def _pressing(self, found: Solution, each: dict[str, Any], ends: Sequence[int]) -> dict[str, Any]:
        """Forces of obstacles, none between two knots where one is away, and depths and energies, which are not below zero."""
        known, forces = ((rows["reactions"] if "reactions" in each else rows["reaction"][:, None]) for rows in (vars(found), each))
        for i, (a, b) in enumerate(pairwise(ends)):
            forces[a + 1:b, ~known[i:i + 2].any(axis=(0, 2))] = 0.0
        return {"reaction": forces.sum(axis=1)} | {name: np.maximum(each[name], 0.0) for name in ("energy", "penetration")}

    def _through(self, ends: Sequence[int]) -> Floats:
        """(T, K) what splines from kink to kink make of the values at the knots."""
        to = np.zeros((self._count + 1, len(ends)))
        for a, b in pairwise(self._kinks):
            own = [i for i, step in enumerate(ends) if a <= step <= b]
            to[a:b + 1] = 0.0
            to[np.ix_(range(a, b + 1), own)] = splines(np.array(ends)[own], np.arange(a, b + 1))
        return to

    def _left(self, u: Floats, step: int) -> float:
        """|residual| / |reaction| at displacements (N, 3), as in `Solution`."""
        balance = self._path.balance
        force, reactions = balance.missing(u, step / self._count)
        reaction = float(np.linalg.norm(reactions, axis=1).sum()) or float(np.linalg.norm(force[balance.fixed]))
        return float(np.linalg.norm(force[~balance.fixed])) / max(reaction, balance.floor / TOLERANCE)


def splines(at: NDArray[Any], to: NDArray[Any]) -> Floats:
    """(n, K) what values at some places (K,) make of those at others (n,), by cubic splines through them."""
    return np.asarray(CubicSpline(at, np.eye(len(at)))(to))
