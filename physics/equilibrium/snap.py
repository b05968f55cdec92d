"""What a body does when the equilibrium that it was in ends: it snaps through, buckles or slips off its obstacle.

The path of equilibria then has no next one nearby, and what comes is motion. Here the loading stands still while the body moves as
in a viscous medium, so slowly that inertia plays no part,

    s M du/dt = b + sum_q p_q n_q - f(u),      M the volumes that nodes stand for [m3], s the drag [Pa s/m2],

until it rests in a stable equilibrium again, downhill in W - b.u. A step of implicit Euler is one linear problem,
(K + s M / dt) du = out-of-balance force with contact as ever (newton.py); it is made so short that K + s M / dt is positive definite
and that no node moves past the reach of contact at once. As the body comes to rest the steps grow, and end as Newton's.

The state depends on the medium where several are within reach, and is one that the body could take, not the only one.

Legend: N nodes, C cells.
"""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray

from physics.body.lumped import Lumped
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import NEAR, Newton
from physics.equilibrium.state import NoEquilibrium, State
from physics.mesh.quality import cell_volumes

Floats = NDArray[np.float64]

LONGEST = 0.8 * NEAR  # way of a node in one step, in cell sizes, where the obstacle is near: it stays in sight of contact
STEPS = 2000  # and then the body is taken to have no state to rest in
PATIENCE = 5  # steps after one that was too long before longer ones are tried
AT_REST = 0.02  # residual over reaction below which Newton's method may finish


class Relaxation(Newton):
    """The motion of a body in a viscous medium, from one equilibrium to the next."""

    # What a round obstacle takes from the stiffness is left to the next step: so treated, it cannot make a step unstable.
    round_obstacle = False

    def __init__(self, balance: Balance) -> None:
        mesh = balance.mesh
        whole = mesh.thickness * cell_volumes(mesh.points, mesh.cells, mesh.cell)
        volumes = whole / mesh.cells.shape[1]  # (C,) [m3] of each of a cell's nodes
        # The stiffness of a step of implicit Euler is K + s M / dt; what is added is s / dt [Pa/m2], the drag.
        self.body = Lumped(balance.body, np.repeat(volumes[:, None], mesh.cells.shape[1], axis=1))
        immersed = copy.copy(balance)
        immersed.elasticity = self.body
        super().__init__(immersed)
        self.sight = NEAR  # nodes may go that far in a step
        extent = float(np.ptp(balance.mesh.points))
        # The stiffness of the first bending mode over its volume: what is slower than that is not worth waiting for.
        softest = min(material.young_modulus for material in balance.scene.materials)
        self.least = softest * balance.size**2 / extent**4

    def settle(self, fraction: float, last: State, newton: Newton) -> tuple[State, float, float]:
        """The equilibrium in which the body comes to rest when it is left to itself at a fraction of the loading.

        Args:
            last: where it starts; newton: what finds equilibria without drag, and judges whether they are stable

        Returns:
            that state, the farthest that a node moved [m], and by how much the potential W - b.u fell [J]

        Raises:
            NoEquilibrium: it does not come to rest
        """
        balance, drag = self.balance, self.least
        at = np.where(balance.fixed, balance.moved(fraction), last.u)
        outer, pressure = balance.apply_loads(fraction), last.pressure
        before, failures, peak, patience = self._potential(at, fraction), 0, 0.0, 0
        for step in range(1, STEPS + 1):
            made = self._euler(fraction, at, pressure, drag)
            if made is None:
                drag, failures, patience = 2 * drag, failures + 1, PATIENCE
                if failures > 100:
                    raise NoEquilibrium("left to itself the body has nowhere to go")
                continue
            failures = 0
            at, pressure, way, longest = made
            touch = self._touch(fraction, at, pressure)
            state = self._judge(fraction, at, balance.elasticity.force(at) - outer, touch, pressure, step)
            peak, patience = max(peak, state.residual), patience - 1
            if state.residual < min(AT_REST, peak / 10):
                found, peak = self._finish(newton, fraction, state), state.residual
                if found is not None:
                    moved = np.linalg.norm(found.u - last.u, axis=1).max()
                    return found, float(moved), before - self._potential(found.u, fraction)
            if way < longest / 2 and patience <= 0:
                drag /= 2
        raise NoEquilibrium(f"left to itself the body does not come to rest in {STEPS} steps of relaxation")

    def _euler(self, fraction: float, u: Floats, pressure: Floats, drag: float) -> tuple[Floats, Floats, float, float] | None:
        """Displacements, contact forces, the longest way of a node and the longest allowed [m]; None when the step is too long."""
        balance = self.balance
        self.body.added = drag
        touch = self._touch(fraction, u, pressure)
        try:
            self.tangent.renew(u, definite=True)
            move = self._step(balance.elasticity.force(u) - balance.apply_loads(fraction), touch)
        except NoEquilibrium:
            return None
        way = float(np.linalg.norm(move, axis=1).max())
        free = 0.0 if touch is None or (touch.pressure > 0).any() else float(touch.gap.min(initial=balance.size))
        longest = LONGEST * balance.size + max(0.0, free) if touch is not None else balance.size
        if not way <= longest or not np.isfinite(self._potential(u + move, fraction)):
            return None
        return u + move, pressure if touch is None else self._on_surface(touch, pressure), way, longest

    def _finish(self, newton: Newton, fraction: float, state: State) -> State | None:
        """The stable equilibrium beside a state of motion, if there is one nearer than a node moves in one step."""
        try:
            found = newton.polished(fraction, state)
        except NoEquilibrium:
            return None
        near = np.linalg.norm(found.u - state.u, axis=1).max() < LONGEST * self.balance.size
        return found if near else None

    def _potential(self, u: Floats, fraction: float) -> float:
        return self.balance.elasticity.energy(u) - self.balance.work(u, fraction)
