"""One equilibrium: Newton's method with a factor that is kept as long as it pays.

The out-of-balance force falls by about the same factor at each step while the stiffness changes little, so one Cholesky
factor (factor.py) serves many equilibria, until the steps that it costs more than a fresh one outweigh making a new one;
mixing (mixing.py) makes that later.
Contact never enters that factor, nor does the roundness of the obstacle: forces at the points near it follow from a small dense
problem on its compliance (contact.py, touch.py). A body that the obstacle alone keeps from giving way has an indefinite
stiffness; its factor then shows, by its negative pivots, whether contact holds every direction in which the body would give way.

Legend: N nodes, Q contact points, q of them in a zone near the obstacle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.contact.conditions import Zone, solve_complementarity
from physics.contact.touch import Condensed, Touch
from physics.equilibrium.balance import GAP_TOLERANCE, Balance
from physics.equilibrium.mixing import Mixing
from physics.linalg.factor import Factor, NotPositiveDefinite, SparseFactor, solver_for
from physics.linalg.multigrid import Felt, Multigrid, NotSolved

Floats = NDArray[np.float64]

TOLERANCE = 1e-6  # residual force over reaction
NEAR = 0.25  # points nearer than this many cell sizes take part in the complementarity problem
REACH = 2.0  # and up to this many cell sizes away they are looked at
LOSS, SELDOM = 0.3, 0.05  # when the next look at stability comes: loss of the softest mode's stiffness, share of the loading
ITERATIONS = 12  # Newton steps before a state is given up
TURNED = 0.035  # of the body's smallest extent that a node may move before the factor that corrects predictions is made anew


class NoEquilibrium(RuntimeError):
    """No equilibrium was found; the message says where, how far off, and what was tried."""


@dataclass
class State:
    """One equilibrium: a fraction of the loading, displacements (N, 3) and contact forces (Q,)."""

    fraction: float
    u: Floats
    pressure: Floats
    reaction: Floats = field(default_factory=lambda: np.zeros(3))
    iterations: int = 0
    residual: float = 0.0  # free components, over the reaction
    gap_error: float = 0.0  # [m] how far contact is from its conditions
    penetration: float = 0.0  # [m]


class Newton:
    """Equilibria of one scene, each from a start nearby.

    Attributes:
        factor: the kept one, or what stands in for it; factorisations: how many there were, or set-ups of the multigrid
        tolerance: of the residual force, over the reaction
    """

    round_obstacle = True  # its curvature is part of the tangent

    def __init__(self, balance: Balance, *, tolerance: float = TOLERANCE) -> None:
        self.balance, self.tolerance = balance, tolerance
        self.factor: Factor | Multigrid = solver_for(balance.elasticity, method=balance.method, spread=balance.spread)
        self.factorisations = 0
        self._definite = self.factor
        self._general: SparseFactor | None = None  # for states whose stiffness is not positive definite
        self._fresh, self._excess, self._stale = 2, 0, True  # steps a new factor needed, steps beyond them since, worn out
        self._factored_at = np.empty(0)  # displacements (N, 3) of the kept factor
        self._giving = 0  # negative eigenvalues of K' at the last step
        self._softest, self._unseen, self._trusted = 0.0, 0.0, 0.0  # of `_watch`
        self._zone: Zone | None = None
        self._mixing = Mixing()

    def equilibrium(self, fraction: float, start: Floats, last: State) -> State:
        """The equilibrium at a fraction of the loading, from a start (N, 3) and the contact forces of the last one.

        Raises:
            NoEquilibrium: not even a factor made anew at each step leads to one, or to one that is stable
        """
        if isinstance(self.factor, Multigrid):  # which takes the stiffness of each iterate, and notices when it is not definite
            return self._newton(fraction, start, last, renew=True)
        state = self._near(fraction, start, last)
        self._watch(state, fraction - last.fraction)
        return state

    def _near(self, fraction: float, start: Floats, last: State) -> State:
        """As `equilibrium`, but an old factor may not show that a state is unstable."""
        if not self._stale:
            try:
                state = self._newton(fraction, start, last)
                self._excess += max(0, state.iterations - self._fresh)
                self._stale = self._excess > self.factor.worth
                return state
            except NoEquilibrium:
                pass
        self._refactor(start if last.u.any() else last.u)
        try:
            state = self._newton(fraction, start, last)
        except NoEquilibrium:
            state = self._newton(fraction, start, last, renew=True)
        self._fresh = state.iterations
        return state

    def _watch(self, state: State, stride: float) -> None:
        """Factor the stiffness at a state anew, when it is time to, to see whether it is stable. Raises `NoEquilibrium`.

        An old factor leads to unstable states as well. The next look comes before the softest mode, whose stiffness is followed
        from look to look, would have lost LOSS of it, after at most twice as much of the loading as from the last look to this
        one, and SELDOM of it at most.
        """
        self._unseen += stride
        if self._unseen < self._trusted or self.balance.scene.material.law == "linear":
            return
        if not self._softest:
            self._refactor(np.zeros_like(state.u))
            self._softest = self._softest_mode()
        self._refactor(state.u)
        self._stale, self._giving = True, 1
        self._check_stable(self._touch(state.fraction, state.u, state.pressure))
        self._stale, softest = False, self._softest_mode()
        loss = max(0.0, self._softest - softest) / softest / self._unseen  # of stiffness, for each part of the loading
        self._trusted = min(LOSS / max(loss, LOSS), 2 * self._unseen, SELDOM)
        self._softest, self._unseen = softest, 0.0

    def _softest_mode(self) -> float:
        """The stiffness of about the softest motion (N, 3) under forces that are its own multiple, by the factor [N/m]."""
        mode = np.where(self.balance.fixed, 0.0, np.cos(np.arange(self.balance.fixed.size).reshape(-1, 3)))
        for _ in range(3):  # inverse iteration; other modes are some times stiffer, and need not be gone
            mode = self.factor.solve(mode / np.linalg.norm(mode))
        return 1 / float(np.linalg.norm(mode))

    def led(self, u: Floats, target: Floats) -> Floats:
        """Displacements (N, 3), to first order, when the held components of u (N, 3) are led to their targets (N, 3).

        Moved alone they would turn the cells beside them inside out. Raises `NoEquilibrium` when the stiffness has no factor.
        """
        way = np.where(self.balance.fixed, target - u, 0.0)
        if abs(way).max() <= GAP_TOLERANCE * self.balance.size:
            return u + way
        short = 1e-4 * self.balance.size / abs(way).max()  # the force against a way so short is linear in it
        force = self.balance.elasticity.force
        if self._stale:
            self._refactor(u)
        return u + way + self.factor.solve((force(u) - force(u + short * way)) / short)

    def polished(self, fraction: float, state: State) -> State:
        """The stable equilibrium beside a state, with a new factor at each step. Raises `NoEquilibrium`."""
        found = self._newton(fraction, state.u, state, renew=True)
        self._refactor(found.u)
        self._giving = 1  # look again
        self._check_stable(self._touch(fraction, found.u, found.pressure))
        return found

    def correction(self, fraction: float, u: Floats) -> Floats:
        """One Newton step (N, 3), contact included, from any displacements (N, 3) at a fraction of the loading.

        Raises:
            NoEquilibrium: the stiffness there cannot be factored, or offers contact no resistance
        """
        contact = self.balance.contact
        self._refactor(u)
        touch = self._touch(fraction, u, np.zeros(0 if contact is None else len(contact.surface.area)))
        return self._step(self.balance.elasticity.force(u) - fraction * self.balance.load, touch)

    def outdate(self) -> None:
        """Make a new factor for the next equilibrium: the equations are no longer those of the last one."""
        self._stale = True

    def improve(self, fraction: float, start: Floats, last: State, *, count: int) -> State:
        """At most `count` Newton steps from a start (N, 3), contact included; fewer when they reach an equilibrium.

        The factor is that of an earlier state, kept until some node has moved by TURNED of the body's smallest extent h: where
        the end of a slender body has moved by d across it, a step along its soft directions is off by a share of the order of
        10 (d/h)^2, because the axial stiffness E h^2 / L has turned by 1.5 d/L against the bending stiffness E h^4 / (4 L^3).

        Raises:
            NoEquilibrium: the stiffness cannot be factored, or offers contact no resistance
        """
        balance, outer, state = self.balance, fraction * self.balance.load, last
        limit = TURNED * float(np.ptp(balance.mesh.points, axis=0).min())
        # Corrected by a single step, the last state may be farther from equilibrium than this guess, and so on from frame to frame;
        # corrected by more it is smoother than any guess, whose noise stiffens and softens cells at random.
        best = start if count == 1 else last.u
        if self._stale or np.sqrt(((best - self._factored_at) ** 2).sum(axis=1).max()) > limit:
            self._refactor(best)
            if self.factor is not self._definite:  # a guess so bad that the body would buckle
                self._refactor(last.u)
        u, pressure = start, last.pressure
        touch = self._touch(fraction, u, pressure)
        force = balance.elasticity.force(u) - outer
        for iteration in range(1, count + 1):
            u = u + self._step(force, touch)
            force = balance.elasticity.force(u) - outer
            pressure = last.pressure if touch is None else self._on_surface(touch, last.pressure)
            touch = self._touch(fraction, u, pressure)
            state = self._judge(fraction, u, force, touch, pressure, iteration)
            if max(state.residual / self.tolerance, state.gap_error / (GAP_TOLERANCE * balance.size)) <= 1:
                break
        return state

    def memory(self) -> dict[str, NDArray[Any]]:
        """All that the next equilibrium depends on besides its start: what `recall` takes."""
        kept = {"counts": np.array([self.factorisations, self._fresh, self._excess]),
                "watch": np.array([self._softest, self._unseen, self._trusted])}
        if self._zone is not None:
            kept |= {"zone": self._zone.made_at, "zone_centre": self._zone.made_with}
        if not self._stale:
            kept["factored_at"] = self._factored_at
            if self.factor.learned:
                kept["learned"] = np.concatenate(self.factor.learned)
                kept["learned_in"] = np.array([len(nodes) for nodes in self.factor.learned])
            if self._mixing.differences:
                for i, name in enumerate("usp"):
                    kept[f"mixing_{name}"] = np.array([difference[i] for difference in self._mixing.differences])
        return kept

    def recall(self, memory: dict[str, NDArray[Any]]) -> None:
        """Go on as the one whose memory this is would have: the same factor is made again, at the cost of one."""
        if "zone" in memory and self.balance.contact is not None:
            self._zone = self.balance.contact.zone(memory["zone"], memory["zone_centre"], REACH * self.balance.size)
        if "factored_at" in memory:
            self._refactor(memory["factored_at"])
            if "learned" in memory and not isinstance(self.factor, Multigrid):
                for nodes in np.split(memory["learned"], np.cumsum(memory["learned_in"])[:-1]):
                    self.factor.learn(nodes)
            if "mixing_u" in memory:
                self._mixing.differences = list(zip(*(memory[f"mixing_{name}"] for name in "usp"), strict=True))
        self.factorisations, self._fresh, self._excess = (int(count) for count in memory["counts"])
        self._softest, self._unseen, self._trusted = (float(value) for value in memory["watch"])

    def _refactor(self, u: Floats) -> None:
        """Factor the stiffness at displacements (N, 3); where it is not positive definite, by the method that bears it."""
        if isinstance(self._definite, Multigrid):
            self._definite.update(u)
            self._mixing.forget()
            return
        self.factor, self._stale = self._definite, True
        try:
            self.factor.update(u)
        except NotPositiveDefinite:
            self._general = self._general or SparseFactor(self.balance.elasticity)
            self.factor = self._general
            try:
                self.factor.update(u)
            except NotPositiveDefinite as error:
                raise NoEquilibrium(str(error)) from None
        self.factorisations += 1
        self._factored_at = u
        self._mixing.forget()
        self._stale, self._excess = False, 0

    def _newton(self, fraction: float, start: Floats, last: State, *, renew: bool = False) -> State:
        """Newton's method with the kept factor, or a new one at each iterate. Raises `NoEquilibrium` when it does not converge."""
        balance = self.balance
        u, outer = start, fraction * balance.load
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
            error = max(state.residual / self.tolerance, state.gap_error / (GAP_TOLERANCE * balance.size))
            if error <= 1:
                self._check_stable(touch)
                return state
            if not np.isfinite(error) or error > 10 * previous:
                break
            previous = min(error, previous)
        raise NoEquilibrium(f"|R| = {state.residual:.1e} of the reaction, a gap is {state.gap_error:.1e} m off")

    def _touch(self, fraction: float, u: Floats, pressure: Floats) -> Touch | None:
        """Gaps at displacements (N, 3), with the contact forces (Q,) of before; None without an obstacle."""
        contact = self.balance.contact
        if contact is None:
            return None
        centre = contact.obstacle.position(fraction)
        if self._zone is None or not self._zone.covers(u, centre, NEAR * self.balance.size):
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
        if isinstance(self.factor, Multigrid):
            return self._solved(self.factor, force, touch)
        self._giving = self.factor.negative
        free = self.factor.begin(-force)  # were there no contact
        if touch is None:
            return self.factor.finish(free)
        near = np.flatnonzero((touch.gap < NEAR * self.balance.size) | (touch.pressure > 0))
        if not len(near):
            touch.pressure = np.zeros_like(touch.gap)
            return self.factor.finish(free)
        zone, touched = touch.zone, touch.pressure[near] > 0
        nodes, gradient, bend = touch.rows(near)
        bend = bend if self.round_obstacle else bend[:0]
        contact = self._condense(touch, near, nodes, gradient, bend)
        moved = self.factor.at(free, zone.nodes[nodes]).ravel()
        turned = contact.turn(bend @ moved)
        gap = touch.gap[near] + gradient @ moved + contact.across.T @ turned
        try:
            pressure = solve_complementarity(contact.matrix, gap, touched, definite=not contact.negative)
        except (np.linalg.LinAlgError, RuntimeError):  # the latter when non-negative least squares do not end
            raise NoEquilibrium("the body gives way to contact without resistance") from None
        touch.pressure = np.zeros_like(touch.gap)
        touch.pressure[near] = pressure
        push = pressure @ gradient + (turned + contact.turn(contact.across @ pressure)) @ bend
        return self.factor.finish(free, zone.nodes[nodes], push.reshape(-1, 3))

    def _solved(self, solver: Multigrid, force: Floats, touch: Touch | None) -> Floats:
        """The same by iteration, contact in the matrix."""
        try:
            if touch is None:
                return solver.step(force, self.tolerance)
            near = np.flatnonzero((touch.gap < NEAR * self.balance.size) | (touch.pressure > 0))
            nodes, gradient, bend = touch.rows(near)
            bend = bend if self.round_obstacle else bend[:0]
            felt = Felt(touch.zone.nodes[nodes], gradient, bend, touch.gap[near], touch.zone.softness[near], touch.pressure[near])
            step = solver.step(force, self.tolerance, felt)
        except NotSolved as error:
            raise NoEquilibrium(str(error)) from None
        touch.pressure = np.zeros_like(touch.gap)
        touch.pressure[near] = felt.pressed
        self.factorisations = solver.set_ups
        return step

    def _condense(self, touch: Touch, points: NDArray[np.int64], nodes: NDArray[np.int64], gradient: Floats, bend: Floats) -> Condensed:
        """The body with its obstacle's roundness, as k points of a zone feel it; gradient and bend are those of `Touch.rows`."""
        assert not isinstance(self.factor, Multigrid)
        compliance, k = self.factor.compliance(touch.zone.nodes[nodes]), len(points)
        rows = np.concatenate([gradient, bend])
        felt = rows @ compliance @ rows.T
        found = Condensed(felt[:k, :k] + np.diag(touch.zone.softness[points]), felt[k:, :k], np.eye(len(bend)) - felt[k:, k:],
                           self.factor.negative)
        self._giving = found.negative
        return found

    def _check_stable(self, touch: Touch | None) -> None:
        """Raise `NoEquilibrium` at a state that the factor shows to be unstable.

        By Sylvester's law of inertia K' + G^T diag(1/c) G has as many negative eigenvalues as K' has more than
        G K'^-1 G^T + diag(c) does: contact must hold the body in every direction in which it would give way by itself.
        """
        if not self._giving or isinstance(self.factor, Multigrid):  # conjugate gradients find out by themselves
            return
        self._giving = self.factor.negative
        points = np.zeros(0, np.int64) if touch is None else np.flatnonzero(touch.pressure > 0)
        held = 0
        if touch is not None and len(points):
            contact = self._condense(touch, points, *touch.rows(points))
            held = int((np.linalg.eigvalsh(contact.matrix) < 0).sum())
        if held < self._giving:
            raise NoEquilibrium("the body is unstable: it snaps through, buckles or slips off")

    def _judge(self, fraction: float, u: Floats, force: Floats, touch: Touch | None, pressure: Floats, iteration: int) -> State:
        """How far displacements (N, 3) with out-of-balance forces (N, 3) and contact forces (Q,) are from equilibrium."""
        balance, gap_error, penetration, scale = self.balance, 0.0, 0.0, 0.0
        if touch is not None:
            force = force.copy()
            force[touch.zone.nodes] -= touch.zone.forces(touch.pressure, touch.normal)
            error = np.where(touch.pressure > 0, abs(touch.gap + touch.zone.softness * touch.pressure), -np.minimum(touch.gap, 0))
            gap_error, penetration = float(error.max(initial=0)), max(0.0, -float(touch.gap.min(initial=0)))
            reaction = -(touch.pressure @ touch.normal)
            scale = float(np.linalg.norm(reaction))
        else:
            reaction = -force[balance.bearing].sum(axis=0)
        scale = scale or float(np.linalg.norm(force[balance.fixed]))
        residual = float(np.linalg.norm(force[~balance.fixed])) / max(scale, balance.floor / TOLERANCE)
        return State(fraction, u, pressure, reaction, iteration, residual, gap_error, penetration)
