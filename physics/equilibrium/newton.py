"""One equilibrium: Newton's method with a tangent that is kept as long as it pays.

The out-of-balance force falls by about the same factor at each step while the stiffness changes little, so one Cholesky factor
serves many equilibria, until it is worn (tangent.py); mixing, which is Anderson acceleration, makes that later (mixing.py). Contact is
part of each step: which points bear, and how much, is found with it, by a primal-dual active set (contact/conditions.py). A factor
that is kept leads to unstable states as well, so from time to time it is looked whether a state is stable (stability.py).

Legend: N nodes, Q contact points, q of them in a zone near the obstacle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physics.contact.touch import Touch, Zone
from physics.equilibrium.balance import GAP_TOLERANCE, Balance
from physics.equilibrium.mixing import Mixing, MixingMemory
from physics.equilibrium.stability import Watch, softest_mode
from physics.equilibrium.state import NoEquilibrium, State
from physics.equilibrium.tangent import TangentMemory, tangent_for
from physics.linalg.multigrid import Felt

Floats = NDArray[np.float64]

TOLERANCE = 1e-6  # residual force over reaction
NEAR, DENSE = 0.25, 0.05  # points nearer than this many cell sizes take part in the complementarity problem; of smooth surfaces
REACH = 2.0  # and up to this many cell sizes away they are looked at
ITERATIONS = 12  # Newton steps before a state is given up


@dataclass(frozen=True)
class ZoneMemory:
    """What a contact zone is made again for: displacements (N, 3), and the obstacle's centre (3,), of several (K, 3)."""

    u: Floats
    centre: Floats


@dataclass(frozen=True)
class NewtonMemory:
    """All that the next equilibrium depends on besides its start."""

    tangent: TangentMemory
    watch: Watch
    zone: ZoneMemory | None
    mixing: MixingMemory | None


class Newton:
    """Equilibria of one scene, each from a start nearby.

    Attributes:
        tangent: the linear algebra, a kept factor or conjugate gradients
        tolerance: of the residual force, over the reaction
        sight: in cell sizes, NEAR or DENSE
        taken: steps so far
    """

    round_obstacle = True  # its curvature is part of the tangent

    def __init__(self, balance: Balance, *, tolerance: float = TOLERANCE) -> None:
        self.balance, self.tolerance = balance, tolerance
        self.tangent = tangent_for(balance)
        self._watch = Watch()
        self._zone: Zone | None = None
        self._mixing = Mixing()
        self._free = np.flatnonzero(~balance.fixed)
        self.sight = NEAR if balance.contact is None or not balance.contact.surface.smooth else DENSE
        self.taken = 0

    @property
    def factorisations(self) -> int:
        """How many factors there were, or set-ups of the multigrid."""
        return self.tangent.made

    def equilibrium(self, fraction: float, start: Floats, last: State) -> State:
        """The equilibrium at a fraction of the loading, from a start (N, 3) and the contact forces of the last one.

        Raises:
            NoEquilibrium: not even a factor made anew at each step leads to one, or to one that is stable
        """
        if not self.tangent.lasting:
            return self._newton(fraction, start, last, renew=True)
        state = self.near(fraction, start, last)
        self._look(state, last)
        return state

    def near(self, fraction: float, start: Floats, last: State) -> State:
        """As `equilibrium`, but an old factor may not show that a state is unstable."""
        if not self.tangent.stale:
            try:
                state = self._newton(fraction, start, last)
                self.tangent.used(state.iterations, fresh=False)
                return state
            except NoEquilibrium:
                pass
        self._refactor(start if last.u.any() else last.u)
        try:
            state = self._newton(fraction, start, last)
        except NoEquilibrium:
            state = self._newton(fraction, start, last, renew=True)
        self.tangent.used(state.iterations, fresh=True)
        return state

    def _look(self, state: State, last: State) -> None:
        """Renew the tangent at a state, when it is time to, to see whether it is stable. Raises `NoEquilibrium`."""
        if state.pressure.any() and not last.pressure.any():  # what was known is of a body that nothing touched
            self._watch = Watch(self._watch.softest)
        self._watch = replace(self._watch, unseen=self._watch.unseen + (state.fraction - last.fraction))
        if self._watch.unseen < self._watch.trusted or self.balance.scene.linear:
            return
        if not self._watch.softest:
            if self.tangent.stale or self.tangent.factored_at.any() or self.balance.pressed is not None:  # else it is that of rest
                self._refactor(np.zeros_like(state.u))
            self._watch = replace(self._watch, softest=self._softest_mode())
        self._refactor(state.u)
        self.tangent.stale = True
        self._check_stable(self._touch(state.fraction, state.u, state.pressure), look=True)
        self.tangent.stale, self._watch = False, self._watch.after(self._softest_mode())

    def _softest_mode(self) -> float:
        return softest_mode(self.tangent.solve, self.balance.fixed)

    def led(self, u: Floats, target: Floats) -> Floats:
        """Displacements (N, 3), to first order, when the held components of u (N, 3) are led to their targets (N, 3).

        Moved alone they would turn the cells beside them inside out. Raises `NoEquilibrium` when the stiffness has no factor.
        """
        way = np.where(self.balance.fixed, target - u, 0.0)
        if abs(way).max() <= GAP_TOLERANCE * self.balance.size:
            return u + way
        short = 1e-4 * self.balance.size / abs(way).max()  # the force against a way so short is linear in it
        if self.tangent.stale:
            self._refactor(u)
        force = self.balance.elasticity.force
        return u + way + self.tangent.solve((force(u) - force(u + short * way)) / short)

    def polished(self, fraction: float, state: State) -> State:
        """The stable equilibrium beside a state, with a new factor at each step. Raises `NoEquilibrium`."""
        found = self._newton(fraction, state.u, state, renew=True)
        self._refactor(found.u)
        self._check_stable(self._touch(fraction, found.u, found.pressure), look=True)
        return found

    def correction(self, fraction: float, u: Floats) -> Floats:
        """One Newton step (N, 3), contact included, from any displacements (N, 3) at a fraction of the loading.

        Raises `NoEquilibrium` when the stiffness there cannot be factored, or offers contact no resistance.
        """
        contact, outer = self.balance.contact, self.balance.apply_loads(fraction)
        self._refactor(u)
        touch = self._touch(fraction, u, np.zeros(0 if contact is None else len(contact.surface.area)))
        return self._step(self.balance.elasticity.force(u) - outer, touch)

    def pressing(self, state: State) -> Felt | None:
        """Contact at the points that press in a state; None when none does."""
        return self._pressed(self._touch(state.fraction, state.u, state.pressure))

    def outdate(self) -> None:
        """Make a new factor for the next equilibrium: the equations are no longer those of the last one."""
        self.tangent.stale = True

    def improve(self, fraction: float, start: Floats, last: State, *, guess: Floats, share: float) -> State:
        """Newton steps from a start (N, 3) until one is at most a share of the way from a guess (N, 3), or to the tolerance.

        The factor is that of a last state, not of a guess, whose noise stiffens and softens cells at random. No residual is found.
        Raises `NoEquilibrium` when the steps grow or are too slow, the state is unstable, or the stiffness allows none.
        """
        if self.tangent.stale or self.balance.turned(last.u, self.tangent.factored_at):
            self._refactor(last.u)
            self._check_stable(self._touch(last.fraction, last.u, last.pressure), look=True)
        u, pressure, size, outer = start, last.pressure, np.inf, self.balance.apply_loads(fraction)
        self._mixing.begin()
        for iteration in range(1, ITERATIONS // 2 + 1):
            touch = self._touch(fraction, u, pressure)
            force = self.balance.elasticity.force(u) - outer
            if iteration > 1 and self._error(self._judge(fraction, u, force, touch, pressure, iteration)) <= 1:
                break
            step = self._step(force, touch)
            moved, pressure = self._mixing.next(u, step, last.pressure if touch is None else self._on_surface(touch, last.pressure))
            before, size, u = size, float(np.linalg.norm(moved - u)), moved
            if not size <= 2 * before:
                raise NoEquilibrium("Newton's steps grow")
            if size <= share * np.linalg.norm(u - guess):
                break
        else:
            raise NoEquilibrium("Newton's steps shrink too slowly")
        if self.tangent.giving:
            self._check_stable(self._touch(fraction, u, pressure))
        return State(fraction, u, pressure, iterations=iteration)

    def memory(self) -> NewtonMemory:
        """What `recall` takes."""
        return NewtonMemory(self.tangent.memory(), self._watch,
                            None if self._zone is None else ZoneMemory(self._zone.made_at, self._zone.made_with),
                            None if self.tangent.stale else self._mixing.memory())

    def recall(self, memory: NewtonMemory) -> None:
        """Go on as the one whose memory this is would have: the same factor is made again, at the cost of one."""
        if memory.zone is not None and self.balance.contact is not None:
            self._zone = self.balance.contact.zone(memory.zone.u, memory.zone.centre, REACH * self.balance.size)
        self.tangent.recall(memory.tangent)
        self._mixing.recall(memory.mixing)
        self._watch = memory.watch

    def _refactor(self, u: Floats) -> None:
        """Renew the tangent at displacements (N, 3). Raises `NoEquilibrium`."""
        self.tangent.renew(u)
        self._mixing.forget()

    def _newton(self, fraction: float, start: Floats, last: State, *, renew: bool = False) -> State:
        """Newton's method with the kept factor, or a new one at each iterate. Raises `NoEquilibrium` when it does not converge."""
        balance = self.balance
        u, outer = start, balance.apply_loads(fraction)
        touch = self._touch(fraction, u, last.pressure)
        force = balance.elasticity.force(u) - outer
        self._mixing.begin()
        previous = np.inf
        for iteration in range(1, ITERATIONS + 1):
            if renew:
                self._refactor(u)
            step = self._step(force, touch)
            u, pressure = self._mixing.next(u, step, last.pressure if touch is None else self._on_surface(touch, last.pressure))
            force = balance.elasticity.force(u) - outer
            touch = self._touch(fraction, u, pressure)
            state = self._judge(fraction, u, force, touch, pressure, iteration)
            error = self._error(state)
            if error <= 1:
                self._check_stable(touch)
                return state
            if not np.isfinite(error) or error > 10 * previous:
                break
            previous = min(error, previous)
        off = f"|R| = {state.residual:.1e} of the reaction, a gap is {state.gap_error:.1e} m off"
        raise NoEquilibrium(off if np.isfinite(error) else "forces are no numbers: a cell turns inside out, or they overflow")

    def _touch(self, fraction: float, u: Floats, pressure: Floats) -> Touch | None:
        """Gaps at displacements (N, 3), with the contact forces (Q,) of before; None without an obstacle."""
        contact = self.balance.contact
        if contact is None:
            return None
        centre = contact.obstacle.position(fraction)
        if self._zone is None or not self._zone.covers(u, centre, self.sight * self.balance.size):
            self._zone = contact.zone(u, centre, REACH * self.balance.size)
        gap, normal = self._zone.gaps(u, centre)
        return Touch(self._zone, u, centre, gap, normal, pressure[self._zone.points])

    def _on_surface(self, touch: Touch, like: Floats) -> Floats:
        """(Q,) the contact forces on the whole surface."""
        pressure = np.zeros_like(like)
        pressure[touch.zone.points] = touch.pressure
        return pressure

    def _step(self, force: Floats, touch: Touch | None) -> Floats:
        """One Newton step (N, 3) from out-of-balance forces (N, 3); the contact forces after it go into `touch`."""
        self.taken += 1
        if touch is None:
            return self.tangent.step(force, self.tolerance, None)
        near = np.flatnonzero((touch.gap < self.sight * self.balance.size) | (touch.pressure > 0))
        felt = touch.felt(near) if len(near) else None
        if felt is not None and not self.round_obstacle:
            felt.bend = felt.bend[:0]
        step = self.tangent.step(force, self.tolerance, felt)
        touch.pressure = np.zeros_like(touch.gap)
        if felt is not None:
            touch.pressure[near] = felt.pressed
        return step

    def _pressed(self, touch: Touch | None) -> Felt | None:
        """Contact at the points that press; None when none does."""
        return None if touch is None or not (touch.pressure > 0).any() else touch.felt(np.flatnonzero(touch.pressure > 0))

    def _check_stable(self, touch: Touch | None, *, look: bool = False) -> None:
        """Raise `NoEquilibrium` at an unstable state; it is looked at on request, or when the last step showed that it may be one."""
        if not (look or self.tangent.giving):
            return
        if not self.tangent.held(self._pressed(touch)):
            raise NoEquilibrium("the body is unstable: it snaps through, buckles or slips off")

    def _error(self, state: State) -> float:
        """Of a state that was judged, over what is allowed."""
        return max(state.residual / self.tolerance, state.gap_error / (GAP_TOLERANCE * self.balance.size))

    def _judge(self, fraction: float, u: Floats, force: Floats, touch: Touch | None, pressure: Floats, iteration: int) -> State:
        """How far displacements (N, 3) with out-of-balance forces (N, 3) and contact forces (Q,) are from equilibrium."""
        balance, gap_error, penetration, scale, reactions = self.balance, 0.0, 0.0, 0.0, np.zeros((0, 3))
        if touch is not None:
            force, gap_error, penetration = touch.zone.judge(force, touch.gap, touch.normal, touch.pressure)
            reactions = -touch.zone.obstacle.sums(touch.pressure, touch.normal)
            reaction, scale = reactions.sum(axis=0), sum(math.hypot(*each) for each in reactions.tolist())
        else:
            reaction = -force[balance.bearing].sum(axis=0)
        scale = scale or float(np.linalg.norm(force[balance.fixed]))
        left = force.take(self._free)
        residual = math.sqrt(left @ left) / max(scale, balance.floor / TOLERANCE)
        return State(fraction, u, pressure, reaction, iteration, residual, gap_error, penetration, reactions)
