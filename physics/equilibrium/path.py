"""Quasi-static path following: the equilibria of a body while loads, supports and a rigid obstacle advance.

What balances what stands in balance.py, how one equilibrium is found in newton.py, when small strain is enough in small_strain.py.
Inertia is left out: the loading is taken to be slow (motion/inertia.py). Each equilibrium has a warm start: a polynomial through the
last states, of the order that would have predicted the last one best. Before anything touches or loads the body nothing is solved.

A step without an equilibrium is taken in two halves, down to 2^-HALVINGS of a step; then the body is left to itself (snap.py).
Where it does not come to rest the path ends with a clear failure that keeps what was solved before. A step in which the
obstacle could jump through the body is halved beforehand.

Legend: N nodes, Q contact points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.equilibrium.balance import Balance, contact_said, could_be_plane, material_said
from physics.equilibrium.newton import TOLERANCE, Newton, NewtonMemory
from physics.equilibrium.small_strain import LINEAR_TOLERANCE, LinearMemory, choose
from physics.equilibrium.snap import Relaxation
from physics.equilibrium.state import HALVINGS, NoEquilibrium, State, StatesMemory, best_order, polynomial
from physics.journal import Arrays
from physics.mesh.mesh import Mesh
from physics.mesh.quality import smallest_det_f
from physics.scene import Scene

Floats = NDArray[np.float64]

BEHIND, AHEAD = 3, 2  # states between which a step is sought, where some are known ahead
PRESSED = 0.8  # det F below which Saint-Venant and Kirchhoff's law may be what gives way: a bar's force falls below a stretch of 0.58


@dataclass(frozen=True)
class PathMemory:
    """All that the rest of a path depends on."""

    states: StatesMemory
    order: int
    halvings: int
    linear_steps: int
    kinematics: str
    linear: LinearMemory | None  # while small strain is enough
    newton: NewtonMemory
    pressed: float | None = None  # fraction of the following pressures that the kept factor was made with


class LoadPath:
    """The way through the equilibria of a scene."""

    Memory = PathMemory

    def __init__(self, scene: Scene, mesh: Mesh, *, tolerance: float = TOLERANCE, method: str | None = None, spread: bool = False,
                 small_strain: float = LINEAR_TOLERANCE, snaps: bool = True, ahead: Sequence[State] = ()) -> None:
        """Args: tolerance: residual over reaction; small_strain: error that it may make; method, spread: as in `factor.solver_for`;
        snaps: whether the path goes on where the body snaps; ahead: states that are known already, in their order, until a step between
        them fails."""
        self._finite = Balance(scene, mesh, method=method, spread=spread)
        self.linear, self.kinematics = choose(scene, mesh, self._finite, small_strain)  # while small strain is enough, and why it is not
        self.linear_steps = 0
        self.newton = self.linear.newton if self.linear else Newton(self._finite)
        self.newton.tolerance = tolerance
        self.balance = self.newton.balance
        contact = self.balance.contact
        self.states = [State(0.0, np.zeros_like(mesh.points), np.zeros(0 if contact is None else len(contact.surface.area)))]
        self.order, self.halvings, self.snaps, self.ahead = 0, 0, snaps, ahead
        self.snap, self.released = 0.0, 0.0  # since the last frame

    def advance(self, fraction: float, depth: int = 0) -> State:
        """The equilibrium at a later fraction of the loading, in two halves where it cannot be had in one."""
        last = self.states[-1]
        if self.balance.stride(last.fraction, fraction) > 1:
            self.advance((last.fraction + fraction) / 2, depth)
            return self.advance(fraction, depth)
        if not last.u.any() and self.balance.rests(fraction):
            return self._append(State(fraction, last.u, last.pressure))
        try:
            if self.linear is not None and self.balance.contact is None and not self.balance.varied:
                state = self.linear.scaled(fraction)
            else:
                state = self.newton.equilibrium(fraction, self._predict(fraction), last)
            if self.linear is None or self.linear.holds(state.u):
                return self._append(state)
        except NoEquilibrium as error:
            if self.ahead and last.u.any():  # what is known ahead may lead astray
                self.ahead = ()
                return self.advance(fraction, depth)
            if depth == HALVINGS and (self.linear is None or self.linear.asked):
                return self._snap(fraction, error)
        if self.linear is not None and not self.linear.asked:
            self._leave_linear()
            return self.advance(fraction, depth)
        self.halvings += 1
        self.advance((last.fraction + fraction) / 2, depth + 1)
        return self.advance(fraction, depth + 1)

    def _leave_linear(self) -> None:
        assert self.linear is not None
        self.kinematics = (f"finite strain after {self.linear_steps} steps of linear elasticity, which in the next one would have been "
                           f"off by {self.linear.error:.1e} of the largest displacement, {self.linear.allowed:g} is allowed")
        self._finite_from_here()

    def _finite_from_here(self) -> None:
        self.linear, self.balance = None, self._finite
        self.newton = Newton(self._finite, tolerance=self.newton.tolerance)

    def frame(self) -> Arrays:
        """What is reported of the last state; each of the arrays is a row of one in `Solution`."""
        state, snap, released = self.states[-1], self.snap, self.released
        self.snap = self.released = 0.0
        self.linear_steps += self.linear is not None and state.fraction > 0
        energy = self.balance.elasticity.energy(state.u) if state.u.any() else 0.0
        found: dict[str, Any] = {
            "displacement": state.u, "reaction": state.reaction, "energy": energy, "penetration": state.penetration,
            "newton_iterations": state.iterations, "relative_residual": state.residual, "snap": snap, "released": released,
            **state.of_each(len(self.balance.scene.obstacles))}
        return {name: np.asarray(value) for name, value in found.items()}

    def memory(self) -> PathMemory:
        """What `recall` takes."""
        return PathMemory(StatesMemory.of(self.states), self.order, self.halvings, self.linear_steps, self.kinematics,
                          None if self.linear is None else self.linear.memory(), self.newton.memory(),
                          None if self.balance.pressed is None else self.balance.pressed.factored)

    def recall(self, memory: PathMemory) -> None:
        """Go on as the path whose memory this is would have, to the last bit."""
        self.states, self.order, self.halvings = memory.states.states(), memory.order, memory.halvings
        self.linear_steps, self.kinematics = memory.linear_steps, memory.kinematics
        if self.linear is not None and memory.linear is None:
            self._finite_from_here()
        elif self.linear is not None and memory.linear is not None:
            self.linear.recall(memory.linear)
        if memory.pressed is not None:
            self.balance.apply_loads(memory.pressed)
        self.newton.recall(memory.newton)

    def _snap(self, fraction: float, error: NoEquilibrium) -> State:
        """The equilibrium that the body moves to when the path of the last one ends."""
        if not self.snaps:
            raise NoEquilibrium(f"{error} after {HALVINGS} halvings; the path ends where the body would snap")
        try:
            state, moved, released = Relaxation(self.balance).settle(fraction, self.states[-1], self.newton)
        except NoEquilibrium as lost:
            raise NoEquilibrium(f"{error} after {HALVINGS} halvings; {lost}; {self._advice()}") from None
        self.snap, self.released = max(self.snap, moved), self.released + released
        self.states, self.order = [state], 0
        return state

    def model(self) -> dict[str, str]:
        """What is modelled, and why, in words."""
        scene, kinematics = self.balance.scene, self.kinematics
        if self.linear is not None:
            kinematics = self.linear.said(self.states[-1].u)
        said = {"kinematics": kinematics, "material": material_said(self._finite.scene), "contact": contact_said(scene)}
        return said | could_be_plane(self.balance) | {"factor": self.newton.tangent.solver.name}

    def _predict(self, fraction: float) -> Floats:
        """Displacements (N, 3) on a polynomial through the last states, and states ahead if any, held components on their prescription."""
        self.balance.apply_loads(fraction)
        ahead = [state for state in self.ahead if state.fraction >= fraction][:AHEAD] if self.states[-1].u.any() else []
        through = [*self.states[-BEHIND:], *ahead] if ahead else self.states[-1 - self.order:]
        return self.newton.led(polynomial(through, fraction), self.balance.moved(fraction))

    def _append(self, state: State) -> State:
        """Keep a state, and choose the order of extrapolation that would have foreseen it best."""
        self.order = best_order(self.states, state)
        self.states = [*self.states[-3:], state]
        return state

    def _advice(self) -> str:
        count, mesh = self.balance.scene.steps.count, self.balance.mesh
        soft = any(material.law == "saint-venant-kirchhoff" for material in self._finite.scene.materials)
        if soft and smallest_det_f(mesh.points, self.states[-1].u, mesh.cells, mesh.cell) < PRESSED:
            return "saint-venant-kirchhoff gives way where it is pressed so hard; a neo-hookean law does not"
        if self.balance.contact is None:
            return f"ask for more than {count} steps"
        stride = max((np.linalg.norm(np.diff(obstacle.path, axis=0), axis=1) / np.diff(obstacle.reached)).max(initial=0)
                     for obstacle in self.balance.contact.obstacle.each) / count
        return f"the obstacle moves {stride / self.balance.size:.2g} cell sizes in one step"
