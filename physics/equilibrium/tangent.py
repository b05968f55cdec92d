"""The linear algebra of Newton's steps: one interface to a factor that is kept and to conjugate gradients, contact included.

A `KeptFactor` never has contact in it, nor the roundness of the obstacle: condensed on its compliance (Schur complement), forces at
the points near the obstacle follow from a small dense problem (contact/touch.py). It is renewed when the steps that it cost more than
a fresh one outweigh making a new one. Where the stiffness K is not positive definite, a factor that bears that takes its place, and
by its negative pivots shows whether contact holds every direction in which the body would give way. `Iterated` has contact in the
matrix (linalg/multigrid.py), is made anew at each iterate, and notices by itself when the stiffness is not positive definite.

Legend: N nodes, q points near the obstacle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physics.contact.conditions import solve_complementarity
from physics.contact.touch import Condensed
from physics.equilibrium.balance import Balance
from physics.equilibrium.state import NoEquilibrium
from physics.linalg.cholesky import NotPositiveDefinite
from physics.linalg.factor import Factor, solver_for
from physics.linalg.indefinite import SparseFactor
from physics.linalg.multigrid import Felt, Multigrid, NotSolved

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class TangentMemory:
    """What a tangent is made again from: its counts, and for a factor still in use where it was made and what it has learned."""

    made: int
    fresh: int = 2
    excess: int = 0
    double: bool = True  # precision of its factor
    factored_at: Floats | None = None
    learned: Integers | None = None  # nodes, group after group
    learned_in: Integers | None = None  # how many in each group


class Tangent(Protocol):
    """What Newton's method asks of the linear algebra.

    Attributes:
        lasting: whether it serves many iterates; else it is made anew at each
        stale: it has to be made anew before it is used; definite: it stands for a positive definite stiffness
        giving: negative eigenvalues of the stiffness, roundness of the obstacle included, at the last step
        factored_at: the displacements (N, 3) that it was made at
        made: how many factors there were, or set-ups of the multigrid
        solver: what has a name in words, and solves
    """

    lasting: bool
    stale: bool
    giving: int
    made: int
    factored_at: Floats

    @property
    def solver(self) -> Factor | Multigrid: ...

    @property
    def definite(self) -> bool: ...

    def renew(self, u: Floats, *, definite: bool = False) -> None:
        """Make it anew at displacements (N, 3), on request only if positive definite. Raises `NoEquilibrium` when that fails."""

    def used(self, iterations: int, *, fresh: bool) -> None:
        """Take note of how many steps an equilibrium took, with a fresh tangent or an old one: `stale` follows from that."""

    def solve(self, force: Floats) -> Floats:
        """K^-1 f for nodal forces (N, 3) [N], without contact. Raises `NoEquilibrium`."""

    def step(self, force: Floats, tolerance: float, felt: Felt | None) -> Floats:
        """One Newton step (N, 3) from forces (N, 3) that are out of balance without contact; contact forces after it go into `felt`.

        Args:
            tolerance: of the out-of-balance force, over the reaction, that is allowed in the end

        Raises:
            NoEquilibrium: the stiffness, or contact, allows none
        """

    def held(self, felt: Felt | None) -> bool:
        """Whether the points in contact hold the body in every direction in which it would give way by itself."""

    def memory(self) -> TangentMemory: ...

    def recall(self, memory: TangentMemory) -> None: ...


def tangent_for(balance: Balance) -> Tangent:
    """What suits the equations of a scene."""
    solver = solver_for(balance.elasticity, method=balance.method, spread=balance.spread)
    return Iterated(solver) if isinstance(solver, Multigrid) else KeptFactor(solver)


class KeptFactor:
    """A factor that is kept as long as it pays.

    solver: the kept factor, or where the stiffness is not positive definite the one that bears that
    """

    lasting = True

    def __init__(self, factor: Factor) -> None:
        self.solver = self._definite = factor
        self._general: SparseFactor | None = None  # for stiffnesses that are not positive definite
        self.made, self.giving, self.stale = 0, 0, True
        self.fresh, self.excess = 2, 0  # steps that a new factor needed, steps beyond them since
        self.factored_at = np.empty(0)

    @property
    def definite(self) -> bool:
        return self.solver is self._definite

    def renew(self, u: Floats, *, definite: bool = False) -> None:
        self.solver, self.stale = self._definite, True
        try:
            try:
                self.solver.update(u)
            except NotPositiveDefinite:
                if definite:
                    raise
                self._general = self._general or SparseFactor(self._definite.elasticity)
                self.solver = self._general
                self.solver.update(u)
        except NotPositiveDefinite as error:
            raise NoEquilibrium(str(error)) from None
        self.made += 1
        self.factored_at, self.stale, self.excess = u, False, 0

    def used(self, iterations: int, *, fresh: bool) -> None:
        if fresh:
            self.fresh = iterations
        else:
            self.excess += max(0, iterations - self.fresh)
            self.stale = self.excess > self.solver.worth

    def solve(self, force: Floats) -> Floats:
        return self.solver.solve(force)

    def step(self, force: Floats, tolerance: float, felt: Felt | None) -> Floats:
        """Contact forces of before stay on: what is solved for is as small as what is out of balance, and so is its rounding."""
        self.giving = self.solver.negative
        if felt is None:
            return self.solver.finish(self.solver.begin(-force))
        contact, before, out = self._condense(felt), felt.pressed, -force
        out[felt.nodes] += (before @ felt.gradient).reshape(-1, 3)
        free = self.solver.begin(out)  # were they to stay
        moved = self.solver.at(free, felt.nodes).ravel()
        turned = contact.turn(felt.bend @ moved)
        gap = felt.gap + felt.gradient @ moved + contact.across.T @ turned - contact.matrix @ before + felt.softness * before
        try:
            felt.pressed = solve_complementarity(contact.matrix, gap, before > 0, definite=not contact.negative)
        except (np.linalg.LinAlgError, RuntimeError):  # the latter when non-negative least squares do not end
            raise NoEquilibrium("the body gives way to contact without resistance") from None
        more = felt.pressed - before
        push = more @ felt.gradient + (turned + contact.turn(contact.across @ more)) @ felt.bend
        return self.solver.finish(free, felt.nodes, push.reshape(-1, 3))

    def _condense(self, felt: Felt) -> Condensed:
        """The body with its obstacle's roundness, as the points feel it."""
        found = Condensed.of(felt, self.solver.compliance(felt.nodes), self.solver.negative)
        self.giving = found.negative
        return found

    def held(self, felt: Felt | None) -> bool:
        """By Sylvester's law of inertia: K' + G^T diag(1/c) G has as many negative eigenvalues as K' has more than
        G K'^-1 G^T + diag(c) does."""
        self.giving, held = self.solver.negative, 0
        if felt is not None:
            held = int((np.linalg.eigvalsh(self._condense(felt).matrix) < 0).sum())
        return held >= self.giving

    def memory(self) -> TangentMemory:
        if self.stale:
            return TangentMemory(self.made, self.fresh, self.excess, self._definite.double)
        groups = self.solver.learned
        learned = (np.concatenate(groups), np.array([len(nodes) for nodes in groups])) if groups else (None, None)
        return TangentMemory(self.made, self.fresh, self.excess, self._definite.double, self.factored_at, *learned)

    def recall(self, memory: TangentMemory) -> None:
        if memory.double:
            self._definite.widen()
        if memory.factored_at is not None:
            self.renew(memory.factored_at)
            if memory.learned is not None and memory.learned_in is not None:
                for nodes in np.split(memory.learned, np.cumsum(memory.learned_in)[:-1]):
                    self.solver.learn(nodes)
        self.made, self.fresh, self.excess = memory.made, memory.fresh, memory.excess


class Iterated:
    """Conjugate gradients with multigrid."""

    lasting, stale, definite, giving = False, True, True, 0

    def __init__(self, solver: Multigrid) -> None:
        self.solver, self.made, self.factored_at = solver, 0, np.empty(0)

    def renew(self, u: Floats, *, definite: bool = False) -> None:
        self.solver.update(u)

    def used(self, iterations: int, *, fresh: bool) -> None:
        pass

    def solve(self, force: Floats) -> Floats:
        return self._asked(lambda: self.solver.solve(force))

    def step(self, force: Floats, tolerance: float, felt: Felt | None) -> Floats:
        return self._asked(lambda: self.solver.step(force, tolerance, felt))

    def _asked(self, run: Callable[[], Floats]) -> Floats:
        try:
            return run()
        except NotSolved as error:
            raise NoEquilibrium(str(error)) from None
        finally:
            self.made = self.solver.set_ups

    def held(self, felt: Felt | None) -> bool:
        return True

    def memory(self) -> TangentMemory:
        return TangentMemory(self.made)

    def recall(self, memory: TangentMemory) -> None:
        self.made = memory.made
