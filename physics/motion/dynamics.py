"""A body in motion: M a + f(u) = b + sum_q p_q n_q, step by step through time.

One step of length h leads from displacement u0 and velocity v0 to u1 and v1:

    M (v1 - v0) / h + f' = b' + sum_q p_q n'_q            f' = integral over 0 <= s <= 1 of f(u0 + s (u1 - u0))
    (u1 - u0) / h = (v0 + v1) / 2                        b' the mean load of the step

f' is the average vector field (Quispel and McLaren, J. Phys. A 41, 2008, 045206): its work f'.(u1 - u0) is the change of the
stored energy whatever the step, as f = dW/du. So without contact the sum of kinetic and stored energy and of the potential of
constant loads stays what it is, but for the error of Gauss's rule with two points (none for laws whose energy is a polynomial
of degree four in u, which linear and Saint-Venant-Kirchhoff are) and the tolerance of the solver. For small motion it is the
trapezoidal rule: second order, a period T comes out longer by the factor 1 + (2 pi h / T)^2 / 12, nothing is damped.

How contact is kept from making energy stands in impact.py. The reaction of a step is its impulse over h.

M is lumped, one mass for each node (body/lumped.py). It has the body's mass and weight.

A step is an equilibrium problem, of a body with K/2 + 2 M / h^2 for a stiffness, and newton.py solves it.

Legend: N nodes, Q contact points.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.body.elasticity import Elasticity
from physics.body.lumped import Lumped, node_masses
from physics.body.schedule import scheduled, share
from physics.equilibrium.balance import Balance, contact_said, material_said
from physics.equilibrium.newton import TOLERANCE, Newton, NewtonMemory
from physics.equilibrium.state import HALVINGS, NoEquilibrium, State, StatesMemory, best_order, polynomial
from physics.journal import Arrays
from physics.mesh.cell import GAUSS
from physics.mesh.mesh import Mesh
from physics.motion.impact import Sweeping, bear
from physics.scene import Scene

Floats = NDArray[np.float64]

OF_STEPS: dict[str, Any] = {"reaction": np.mean, "reactions": np.mean, "newton_iterations": np.sum, "relative_residual": np.max,
                            "penetration": np.max}  # what a frame has of the steps that lead to it
STOP = 10  # steps in which the smallest force that matters would stop the body


class Moving(Lumped):
    """A body within one step of time, whose forces and stiffness are those of the step's equations."""

    def __init__(self, body: Elasticity) -> None:
        self.node_mass = node_masses(body)  # (N, 1) [kg]
        share = (self.node_mass.ravel() / np.bincount(body.cells.ravel()))[body.cells]  # (C, n)
        super().__init__(body, share, scale=0.5)
        self.start = self.velocity = self.outer = np.zeros_like(body.mesh.points)
        self.h = self.factored_h = 0.0  # [s] of this step, and of the one that the stiffness was last asked for in

    def begin(self, u: Floats, velocity: Floats, outer: Floats, h: float) -> None:
        """A step of h [s] from displacements and velocities (N, 3) under mean outer forces (N, 3)."""
        self.start, self.velocity, self.outer, self.h = u, velocity, outer, h
        self.added = 2 / h**2

    def weight(self, acceleration: Floats) -> Floats:
        """(N, 3) [N] of a uniform acceleration (3,) [m/s2], by these masses, so that free nodes fall alike."""
        return np.asarray(self.node_mass * acceleration)

    def add_stiffness(self, u: Floats, slot: NDArray[np.int32], out: NDArray[Any]) -> None:
        self.factored_h = self.h
        super().add_stiffness(u, slot, out)

    def force(self, u: Floats) -> Floats:
        """What is missing to the balance of the step that ends at u (N, 3), contact left out [N]."""
        way = u - self.start
        inner = (self.body.force(self.start + GAUSS[0] * way) + self.body.force(self.start + GAUSS[1] * way)) / 2
        return inner - self.outer + self.node_mass * (2 / self.h**2 * (way - self.h * self.velocity))


@dataclass(frozen=True)
class MotionMemory:
    """All that the rest of a motion depends on; see `Motion`."""

    states: StatesMemory
    velocity: Floats  # (N, 3) [m/s]
    order: int
    halvings: int
    factored_h: float  # [s] of the step that the kept factor was made in
    largest: float  # [N]
    newton: NewtonMemory


class Motion:
    """The way of a scene through time; what `equilibrium.path.LoadPath` is for equilibria."""

    Memory = MotionMemory
    linear_steps = 0

    def __init__(self, scene: Scene, mesh: Mesh, *, tolerance: float = TOLERANCE) -> None:
        rest = Balance(scene, mesh)
        assert scene.steps.duration is not None
        self.duration, self.body, self.fixed = scene.steps.duration, rest.body, rest.fixed
        self.balance = copy.copy(rest)
        self.balance.elasticity = self.moving = Moving(rest.body)
        weight = self.moving.weight
        self.sudden = rest.full([load for load in scene.load if load.sudden], weight)  # (N, 3) [N]
        self.growing = rest.full([load for load in scene.load if not (load.sudden or scheduled(load))], weight)
        self.tabled = [(load, rest.full([load], weight)) for load, _ in rest.tabled]
        self.balance.tabled = []
        self.balance.load = np.zeros_like(rest.load)  # the loads are among the forces of the step
        self.balance.contact = None if rest.contact is None else Sweeping(rest.contact)
        self.newton = Newton(self.balance, tolerance=tolerance)
        self.newton.round_obstacle = False  # mean normals turn less than those at the end
        points = 0 if rest.contact is None else len(rest.contact.surface.area)
        self.states = [State(0.0, np.zeros_like(mesh.points), np.zeros(points))]
        self.velocity = np.where(self.fixed, self.pull(0.0, 1 / scene.steps.count), np.array(scene.steps.velocity or (0.0, 0.0, 0.0)))
        self.order, self.halvings = 0, 0
        self._floor = rest.floor
        acting = (self.sudden, self.growing, *(force for _, force in self.tabled))
        self._largest = max(float(np.linalg.norm(load)) for load in acting)  # [N] force so far, or to come

    def advance(self, fraction: float, depth: int = 0) -> State:
        """The state at a later fraction of the duration, in several steps of time where one is too long. Raises `NoEquilibrium`."""
        last = self.states[-1]
        h = (fraction - last.fraction) * self.duration
        if self._too_far(last.fraction, fraction, h):
            self.advance((last.fraction + fraction) / 2, depth)
            return self.advance(fraction, depth)
        if self._rests(last.u, fraction):
            return self._append(State(fraction, last.u, last.pressure))
        if abs(h - self.moving.factored_h) > 1e-6 * h:  # equal steps differ by rounding
            self.newton.outdate()
        if isinstance(self.balance.contact, Sweeping):
            self.balance.contact.begin(last.u, self.balance.contact.obstacle.position(last.fraction))
        outer = self.sudden + (last.fraction + fraction) / 2 * self.growing
        for load, force in self.tabled:
            outer = outer + (share(load, last.fraction) + share(load, fraction)) / 2 * force
        self.moving.begin(last.u, self.velocity, outer, h)
        momentum = float(np.linalg.norm(self.moving.node_mass * self.velocity))
        self.balance.floor = max(self._floor, TOLERANCE * max(self._largest, momentum / (STOP * h)))
        try:
            state = self.newton.equilibrium(fraction, self._predict(fraction), last)
        except NoEquilibrium as error:
            if depth == HALVINGS:
                raise NoEquilibrium(f"{error} after {HALVINGS} halvings; a step of time is {h * 2**HALVINGS:.2g} s") from None
            self.halvings += 1
            self.advance((last.fraction + fraction) / 2, depth + 1)
            return self.advance(fraction, depth + 1)
        velocity = 2 / h * (state.u - last.u) - self.velocity
        inertia = np.linalg.norm(self.moving.node_mass * (velocity - self.velocity)) / h
        self._largest = max(self._largest, float(inertia), float(np.linalg.norm(state.reaction)))
        state, velocity = self._borne(last.fraction, state, velocity, h)
        self.velocity = np.where(self.fixed, self.pull(last.fraction, fraction), velocity)
        return self._append(state)

    def pull(self, start: float, end: float) -> Floats:
        """(N, 3) [m/s] mean velocity of the held components between two fractions of the duration."""
        if not self.balance.varied:
            return self.balance.target / self.duration
        return (self.balance.moved(end) - self.balance.moved(start)) / ((end - start) * self.duration)

    def _too_far(self, start: float, end: float, h: float) -> bool:
        """Whether obstacle and body could pass through each other in a step of h [s]."""
        contact = self.balance.contact
        if contact is None:
            return False
        safe = min(contact.obstacle.width, float(self.balance.mesh.extent.min())) / 2
        return self.balance.stride(start, end) + float(np.linalg.norm(self.velocity, axis=1).max()) * h / safe > 1

    def _rests(self, u: Floats, fraction: float) -> bool:
        still = not (u.any() or self.velocity.any() or self.sudden.any() or self.growing.any() or self.tabled or self.balance.varied)
        return still and self.balance.rests(fraction)

    def _predict(self, fraction: float) -> Floats:
        """Extrapolated displacements (N, 3), held components on their prescription."""
        if len(self.states) == 1:
            u = self.states[0].u + fraction * self.duration * self.velocity
        else:
            u = polynomial(self.states[-1 - self.order:], fraction)
        return np.where(self.fixed, self.balance.moved(fraction), u)

    def _borne(self, before: float, state: State, velocity: Floats, h: float) -> tuple[State, Floats]:
        """The state and its velocities (N, 3) [m/s] once the points that bear have been stopped (impact.py)."""
        contact = self.balance.contact
        if contact is None or not state.pressure.any():
            return state, velocity
        centre = contact.obstacle.position(state.fraction)
        towards = (centre - contact.obstacle.position(before)) / h
        velocity, force = bear(contact, state.u, velocity, pressure=state.pressure, centre=centre, towards=towards,
                               mobile=np.where(self.fixed, 0.0, 1 / self.moving.node_mass), h=h)
        return replace(state, reaction=state.reaction - sum(force[1:], force[0]), reactions=state.reactions - force), velocity

    def _append(self, state: State) -> State:
        self.order = best_order(self.states, state)
        self.states = [*self.states[-3:], state]
        return state

    @property
    def kinetic_energy(self) -> float:
        """[J]"""
        return float((self.moving.node_mass * self.velocity**2).sum()) / 2

    def model(self) -> dict[str, str]:
        """What is modelled, and why, in words."""
        scene = self.balance.scene
        said = {"kinematics": "small strain, as the linear law has it" if scene.linear else "finite strain: in motion",
                "material": material_said(scene)}
        lasting = "; what a surface layer of nodes loses when it is struck is gone, and contact makes no energy"
        return said | {"contact": contact_said(scene) + lasting * bool(scene.obstacles), "factor": self.newton.tangent.solver.name}

    def frame(self) -> Arrays:
        """What is reported of the last state; each of the arrays is a row of one in `equilibrium.Solution`."""
        state = self.states[-1]
        found: dict[str, Any] = {
            "displacement": state.u, "energy": self.body.energy(state.u) if state.u.any() else 0.0,
            "kinetic_energy": self.kinetic_energy, "snap": 0.0, "released": 0.0, **self._of_step()}
        return {name: np.asarray(value) for name, value in found.items()}

    def frame_after(self, fractions: Iterable[float]) -> Arrays:
        """The frame to which several steps lead, to these fractions of the duration: the last state, the mean force, all the work."""
        parts = []
        for fraction in fractions:
            self.advance(fraction)
            parts.append(self._of_step())
        return self.frame() | {name: np.asarray(OF_STEPS[name]([part[name] for part in parts], axis=0)) for name in parts[0]}

    def _of_step(self) -> dict[str, Any]:
        state = self.states[-1]
        return {"reaction": state.reaction, "penetration": state.penetration, "newton_iterations": state.iterations,
                "relative_residual": state.residual, **state.of_each(len(self.balance.scene.obstacles))}

    def memory(self) -> MotionMemory:
        """What `recall` takes."""
        return MotionMemory(StatesMemory.of(self.states), self.velocity, self.order, self.halvings, self.moving.factored_h, self._largest,
                            self.newton.memory())

    def recall(self, memory: MotionMemory) -> None:
        """Go on as the motion whose memory this is would have, to the last bit."""
        self.states, self.velocity, self.order, self.halvings = memory.states.states(), memory.velocity, memory.order, memory.halvings
        self._largest = memory.largest
        if memory.factored_h:  # the factor is made again as it was made, to the last bit of its step
            self.moving.begin(self.moving.start, self.velocity, self.moving.outer, memory.factored_h)
        self.newton.recall(memory.newton)
