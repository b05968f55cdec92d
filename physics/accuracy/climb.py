"""From the coarsest mesh of a body up to one that keeps an error, in steps that are foreseen.

On the coarsest mesh each direction i is refined alone: what that changes is its share e_i n_i^-p of the error, with the order p that
cells of this order usually have. The next mesh is the one with the fewest nodes whose shares are as small as is needed,

    minimise prod_i n_i^(w_i)   with   sum_i e_i n_i^-p = what is allowed:   e_i n_i^-p / w_i = E for every direction that is refined

(w_i: directions of the body that number i counts along). It is solved, and how far it is from the mesh before says how far the error is
down (estimate.py), by its own order and with all that the directions do to each other. A step is at most FARTHEST times finer. When a
mesh is there that keeps the error, any that was solved keeps it too whose distance from that one, and its error, are below what is
asked together: the cheapest of them is the answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from physics.accuracy.estimate import FIRST, ROUNDING, ErrorEstimate, coarse, distance, estimate, looked, norm
from physics.accuracy.meshes.ladder import MeshFamily, Sizes
from physics.accuracy.pilot import POSE, Floats, Pilot, cost
from physics.equilibrium.state import NoEquilibrium
from physics.schema import InputError

USUAL = {1: 1.5, 2: 2.0}  # order of the error of cells of first and second order, with supports and contact
STRESS = 0.5  # by which that of the stress is lower, as far as two meshes are to be believed
NEAREST, FARTHEST = 1.3, 2.0  # times finer is the next mesh
SHORTER = 1.15  # a step that has too many nodes
AIM = 0.9  # of the target, as numbers of cells are whole
ALONE = 0.5  # power of that by which a direction with a small share is refined with the others, so that it is seen
ALONE_ENOUGH = 0.1  # of the target: an error of the coarsest mesh that needs no other mesh to be believed
NOTHING = 0.01  # of the target: a share that needs no look
PATIENCE = 2  # meshes in succession whose error does not fall regularly, before it is given up that it will
FALLING = 0.7  # times the error of the mesh before: what falls so far is on its way, as on meshes that are much too coarse
LOST = 10  # times the nodes allowed: a way that needs them is given up for one with a smaller error
# Error of second order over that of first on their coarsest meshes, before it is known; and of a plane body under an obstacle.
SMALLER, PRESSED = 0.2, 0.8
LITTLE = 0.67  # of the refinement of another direction
COARSEST = 5  # refinements of a coarsest mesh that cannot hold the scene


class Source(Protocol):
    """What solves a mesh: `Pilots`, or `Frequencies` (frequency.py)."""

    quantity: str
    count: int
    fractions: Floats
    weights: Floats

    def __call__(self, family: MeshFamily, sizes: Sizes) -> Pilot: ...

    def solved(self, order: int) -> list[tuple[Sizes, Pilot]]: ...


@dataclass
class Climb:
    """The way from the coarsest mesh of a family to one that keeps the error.

    target: error; most: nodes of a mesh; sizes: where it is; error, order, how: of that mesh, as in `ErrorEstimate`
    shares: of each direction, in parts of the error; ladder: meshes on the way, each with its error as it was known then
    reached: whether the error is below the target; ended: whether there is nothing more to try; why: it cannot be solved
    checked: the finer mesh that says so
    """

    family: MeshFamily
    pilots: Source
    target: float
    most: int
    sizes: Sizes
    error: float = math.inf
    order: float = 1.0
    how: str = "unknown"
    shares: list[float] = field(default_factory=list)
    ladder: list[tuple[Sizes, float]] = field(default_factory=list)
    reached: bool = False
    ended: bool = False
    checked: Sizes | None = None
    why: NoEquilibrium | InputError | None = None
    _irregular: int = 0
    _again: bool = False
    _alone: list[tuple[float, Floats]] = field(default_factory=list)
    _fine: list[float] = field(default_factory=list)
    _differences: list[float] = field(default_factory=list)

    @property
    def pilot(self) -> Pilot:
        return self.pilots(self.family, self.sizes)

    @property
    def said(self) -> str:
        """How its error is known."""
        falls = f"error falls as h^{self.order:.2g} ({self.how})"
        return falls if self.checked is None else f"held against {self.family.said(self.checked)}, whose {falls}"

    @property
    def parts(self) -> dict[int, ErrorEstimate]:
        """What each direction makes of the error."""
        whole = sum(self.shares)
        return {axis: ErrorEstimate(self.error * (share / whole if whole else 1 / len(self.shares)), self.order, self.how)
                for axis, share in enumerate(self.shares)}

    def nodes(self, sizes: Sizes) -> float:
        """About how many nodes a mesh has: of a box, else by what is known of the coarsest mesh of first order."""
        if self.family.body.shape in ("beam", "plate"):
            return math.prod(self.family.order * n + 1 for n in sizes)
        grown = math.prod((n / n0) ** span for n, n0, span in zip(sizes, self.sizes, self.family.spans, strict=True))
        if self.ladder:
            return self.pilot.nodes * grown
        return grown * sum(self.family.order**self.family.dimension * pilot.nodes for _, pilot in self.pilots.solved(1)[:1])

    def outlook(self, before: float = 0.0) -> float:
        """What the whole scene will cost on the mesh that keeps the error, and what it takes to get there.

        Args: before: the error of the other order on its coarsest mesh, for a way that is not begun
        """
        poses = len(self.pilots.fractions) * POSE[self.family.dimension]
        if not self.ladder:
            d, touches = self.family.dimension, bool(self.family.scene.obstacles)
            need = max(1.0, ((PRESSED if d == 2 and touches else SMALLER) * before / self.target) ** (1 / USUAL[2]))
            grown = need**d
            return (self.pilots.count + (1 + len(self.sizes)) * poses) * cost(grown * self.nodes(self.sizes), self.family)
        need, nodes = self._needed()
        return (self.pilots.count + 2 * poses * (need > 1)) * cost(nodes, self.family)

    @property
    def lost(self) -> bool:
        """Whether the mesh that keeps the error is beyond what may be reached."""
        return bool(self.ladder) and not self.reached and self._needed()[1] > LOST * self.most

    def _needed(self) -> tuple[float, float]:
        """How many times finer the mesh must be that keeps the error, and its nodes."""
        order = USUAL[self.family.order] if self.how == "assumed" else self.order
        need = max(1.0, (self.error / self.target) ** (1 / order))
        return need, self.nodes(self._towards(need))

    def go_on(self) -> None:
        """Solve the next mesh, or the first. A mesh that cannot be solved ends the way."""
        try:
            if not self.ladder:
                self._begin()
            elif not self._next():
                self.ended = True
                return
        except (NoEquilibrium, InputError) as error:
            self.ended, self.why = True, error
            return
        if self.ladder and self.error <= self.target and self.family.scene.obstacles and not self._again:
            self._look_again()
        self.ladder.append((self.sizes, self.error))
        self.reached = self.error <= self.target * (ALONE_ENOUGH if len(self.ladder) == 1 else 1)
        self.ended = self.ended or self.reached or self._irregular >= PATIENCE
        if self.reached:
            self._settle()

    def _begin(self) -> None:
        """Solve the coarsest mesh that can hold the scene: its obstacle and its places by coordinates may be too small for coarser ones.

        Where another order of cells has an equilibrium and this one has none, nothing finer is tried, and nothing with too many nodes.
        """
        refused: list[NoEquilibrium | InputError] = []
        while True:
            try:
                self.pilots(self.family, self.sizes)
                break
            except (InputError, NoEquilibrium) as error:
                refused.append(error)
                if isinstance(error, NoEquilibrium) and (self.pilots.solved(1) or self.pilots.solved(2)):
                    raise
            finer = self.sizes
            for axis in range(len(finer)):
                finer = self.family.after(finer, axis)
            if len(refused) > COARSEST or (self.nodes(finer) or len(self.family.rung(finer)[1].points)) > self.most:
                raise refused[0]
            self.sizes = finer
        self._fine = [1.0]
        try:
            self.error, self.how, self.order = self._look(), "assumed", FIRST[self.pilots.quantity]
        except NoEquilibrium as error:  # beside a mesh that has one: its error stays unknown
            self.shares, self.ended, self.why = [1.0] * len(self.sizes), True, error

    def _look(self) -> float:
        """Refine each direction alone: the shares, and what they add up to with the order of two meshes."""
        usual, first, here = USUAL[self.family.order], FIRST[self.pilots.quantity], self.pilot
        whole = np.zeros_like(here.values)
        for axis, n in enumerate(self.sizes):
            there = self.family.after(self.sizes, axis)
            ratio = n / there[axis]
            finer = self.pilots(self.family, there).values
            self.shares.append(coarse(ratio, distance(here.values, finer, self.pilots.weights), usual))
            self._alone.append((ratio, finer - here.values))
            whole += (finer - here.values) / (1 - ratio**first)
        return distance(here.values, here.values + whole, self.pilots.weights)

    def _look_again(self) -> None:
        """Refine each direction alone that was refined little, once, to see whether it still makes as little of the error.

        What an obstacle does across a body, the coarsest mesh may be too coarse to show.
        """
        self._again = True
        here, times = self.pilot, [n / n0 for n, n0 in zip(self.sizes, self.ladder[0][0], strict=True)]
        for axis in (axis for axis, ratio in enumerate(times) if ratio < LITTLE * max(times)):
            there = self.family.after(self.sizes, axis)
            try:
                finer = self.pilots(self.family, there).values
            except NoEquilibrium:
                continue
            known = self.parts[axis].error
            part = coarse(self.sizes[axis] / there[axis], distance(here.values, finer, self.pilots.weights), USUAL[self.family.order])
            if part > known > 0:
                self.shares[axis] *= part / known
                self.error += part - known

    def _next(self) -> bool:
        """A finer mesh, by as much as the error known asks for or the nodes allow; False where NEAREST is too much."""
        order = USUAL[self.family.order] if self.how == "assumed" else self.order
        need = min(max((self.error / (AIM * self.target)) ** (1 / order), NEAREST), FARTHEST)
        while self.nodes(there := self._towards(need)) > self.most:
            if need <= NEAREST:
                return False
            need = max(need / SHORTER, NEAREST)
        quantity, highest = self.pilots.quantity, self.family.highest
        before = self.pilot
        try:
            after = self.pilots(self.family, there)
        except NoEquilibrium:  # too far from what the mesh before found
            if need <= NEAREST:
                raise
            after = self.pilots(self.family, there := self._towards(max(need**0.5, NEAREST)))
        usual, was = USUAL[self.family.order], sum(self.shares)
        self.shares = [share * (n / m) ** usual for share, n, m in zip(self.shares, self.sizes, there, strict=True)]
        self.sizes = there
        self._fine.append(self._fine[-1] * max((was / max(sum(self.shares), ROUNDING)) ** (1 / usual), 1.01))
        self._differences.append(distance(before.values, after.values, self.pilots.weights))
        times = [m / n for n, m in zip(self.ladder[0][0], there, strict=True)]
        if len(self._differences) == 1:
            size = norm(after.values, self.pilots.weights)
            alone = [(ratio, off / size) for ratio, off in self._alone]
            found = looked(alone, times, self._differences[0], usual - STRESS * (quantity == "stress"), quantity,
                           self.pilots.weights)
        else:
            found = estimate(self._fine, self._differences, highest - (quantity == "stress"), quantity)
        self.error, self.order, self.how = found.error, found.order, found.how
        self._irregular = self._irregular + 1 if self.how == "irregular" and self.error > FALLING * self.ladder[-1][1] else 0
        return True

    def _settle(self) -> None:
        """Step back to the cheapest mesh that keeps the error by its distance from the one that was reached."""
        order, weights, finest, usual = self.family.order, self.pilots.weights, self.pilot, USUAL[self.family.order]
        keep = [(cost(pilot.nodes, self.family), sizes, error) for sizes, pilot in self.pilots.solved(order)
                if (error := distance(pilot.values, finest.values, weights) + self.error) <= self.target]
        best, sizes, error = min(keep, default=(math.inf, self.sizes, self.error))
        if best < cost(finest.nodes, self.family):
            self.shares = [share * (n / m) ** usual for share, n, m in zip(self.shares, self.sizes, sizes, strict=True)]
            self.ladder = [*(rung for rung in self.ladder if self.nodes(rung[0]) < self.nodes(sizes)), (sizes, error)]
            self.checked, self.sizes, self.error = self.sizes, sizes, error

    def _towards(self, need: float) -> Sizes:
        """The mesh with the fewest nodes that is so many times finer than this one in what its shares add up to."""
        usual, spans = USUAL[self.family.order], self.family.spans
        allowed = sum(self.shares) * need**-usual
        level = _level(self.shares, spans, allowed)
        times = [max(1.0, (share / (span * level)) ** (1 / usual)) if level else need
                 for share, span in zip(self.shares, spans, strict=True)]
        small = NOTHING * self.target
        times = [max(ratio, need**ALONE if share > small else 1.0) for ratio, share in zip(times, self.shares, strict=True)]
        there = self.family.finer(self.sizes, times)
        if there == self.sizes:
            there = self.family.after(self.sizes, max(range(len(spans)), key=lambda axis: self.shares[axis] / spans[axis]))
        return there


def _level(shares: Sequence[float], spans: Sequence[int], allowed: float) -> float:
    """E with sum_i min(e_i, w_i E) = allowed, for shares e_i and spans w_i."""
    left = sorted(zip(shares, spans, strict=True), key=lambda one: one[0] / one[1])
    for i, (share, span) in enumerate(left):
        weight = sum(each for _, each in left[i:])
        if share * weight >= allowed * span:  # all from here on are cut
            return allowed / weight
        allowed -= share
    return math.inf if not left else left[-1][0] / left[-1][1]
