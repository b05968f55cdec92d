"""Quasi-static path following: the equilibria of a body while loads, supports and a rigid obstacle advance.

At each step the displacement u solves f(u) = b + sum_q p_q n_q on the free components, with internal forces f = dW/du
(elasticity.py), dead loads b and contact forces p (contact.py). Inertia is left out: the loading is taken to be slow.

One step costs little because little is done twice:
- the start is a polynomial through the last states, of the order that would have predicted the last one best;
- one Cholesky factor of the stiffness serves many steps, until the extra Newton steps that it costs outweigh a new one;
- contact never enters that factor: forces at the touched points follow from a small dense problem on its compliance.
Before anything touches or loads the body nothing is solved.

A step without convergence is tried again with a new factor, then in two halves, down to 2^-HALVINGS of a step; then the
path ends with a clear failure that keeps what was solved before. Legend: N nodes, Q contact points, T steps + 1.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from physics.contact import Contact, ContactSurface, solve_complementarity
from physics.elasticity import Elasticity, Factor
from physics.mesh import Mesh, build_mesh
from physics.obstacle import Rigid
from physics.quality import smallest_det_f
from physics.scene import Scene
from physics.schema import InputError
from physics.supports import held, prescribed, rigid_motions_left, traction_load

Floats = NDArray[np.float64]

TOLERANCE = 1e-6  # residual force over reaction
GAP_TOLERANCE = 1e-6  # error of a gap over the size of a cell
CONTACT_STIFFNESS = 2e4  # k in units of Young's modulus over the size of a cell
NEAR = 0.25  # points nearer than this many cell sizes take part in the complementarity problem
ITERATIONS = 12  # Newton steps before a state is given up
HALVINGS = 6
REFACTOR_COST = 12  # a new factor costs about as much as this many Newton steps with the old one


class NoEquilibrium(RuntimeError):
    """No equilibrium was found; the message says where, how far off, and what was tried."""


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The path of a body; arrays have one row for each of the T frames that were reached, the rest state first."""

    mesh: Mesh
    displacement: Floats  # (T, N, 3) [m]
    reaction: Floats  # (T, 3) [N] force of the body on the obstacle; without one, on the supports that move, or on all
    energy: Floats  # (T,) [J]
    penetration: Floats  # (T,) [m]
    smallest_det_f: Floats  # (T,)
    newton_iterations: NDArray[np.int64]  # (T,)
    relative_residual: Floats  # (T,) |residual| / |reaction|
    factorisations: int
    halvings: int
    model: dict[str, str]  # what was modelled, and why
    seconds: float
    failure: str = ""  # empty when every step was reached


@dataclass
class State:
    """One equilibrium: a fraction of the loading, displacements (N, 3) and contact forces (Q,)."""

    fraction: float
    u: Floats
    pressure: Floats
    reaction: Floats = field(default_factory=lambda: np.zeros(3))
    iterations: int = 0
    residual: float = 0.0
    penetration: float = 0.0


class Path:
    """The equations of a scene and the way through its states."""

    def __init__(self, scene: Scene, mesh: Mesh) -> None:
        self.scene, self.mesh = scene, mesh
        self.fixed, self.target = held(scene, mesh), prescribed(scene, mesh)
        # Without an obstacle the reaction is that on the supports that move, if any does, else on all of them.
        self._bearing = (self.target.any(axis=1) if self.target.any() else self.fixed.any(axis=1)).nonzero()[0]
        self.elasticity = Elasticity(mesh, scene.material, self.fixed)
        self.load = traction_load(scene, mesh)
        for load in scene.load:
            if load.acceleration is not None:
                self.load += self.elasticity.weight(np.array(load.acceleration))
        self.factor = Factor(self.elasticity)
        self.size = cell_size(mesh)
        self.contact: Contact | None = None
        count = 0
        if scene.obstacle is not None:
            surface = ContactSurface(mesh, scene.obstacle.contact, self.fixed.all(axis=1))
            stiffness = CONTACT_STIFFNESS * scene.material.young_modulus / self.size
            self.contact = Contact(surface, Rigid(scene.obstacle), mesh.points, stiffness)
            count = len(surface.area)
        self.states = [State(0.0, np.zeros_like(mesh.points), np.zeros(count))]
        # Below this force rounding in f(u) takes over: eps E h L with the largest extent L.
        self.floor = 1e3 * np.finfo(float).eps * scene.material.young_modulus * self.size * np.ptp(mesh.points)
        self.order, self.excess, self.halvings = 0, 0, 0
        # Responses K^-1 e of the kept factor to unit forces on the nodes that contact has needed so far.
        self._columns = np.empty((0, mesh.points.size))  # (3 n, 3 N)
        self._place = np.full(len(mesh.points), -1)  # (N,) which of them
        self._stale = True
        check_scene(scene, mesh, self)

    def advance(self, fraction: float, depth: int = 0) -> State:
        """The equilibrium at a later fraction of the loading, in two halves where it cannot be had in one."""
        last = self.states[-1]
        if self._idle(fraction):
            state = State(fraction, last.u.copy(), np.zeros_like(last.pressure))
            return self._append(state)
        start = self._predict(fraction)
        try:
            return self._append(self._equilibrium(fraction, start))
        except NoEquilibrium as error:
            if depth == HALVINGS:
                raise NoEquilibrium(f"{error} after {HALVINGS} halvings; {self._advice()}") from None
        self.halvings += 1
        self.advance((last.fraction + fraction) / 2, depth + 1)
        return self.advance(fraction, depth + 1)

    def _idle(self, fraction: float) -> bool:
        """True as long as nothing has moved and nothing touches or loads the body."""
        if self.states[-1].u.any() or self.load.any() or self.target.any():
            return False
        if self.contact is None:
            return True
        gap, _ = self.contact.gaps(self.states[-1].u, self.contact.obstacle.position(fraction))
        return bool(gap.min() >= -GAP_TOLERANCE * self.size)

    def _predict(self, fraction: float) -> Floats:
        """Extrapolated displacements (N, 3), held components on their prescription."""
        u = extrapolate(self.states[-1 - self.order:], fraction)
        return np.where(self.fixed, fraction * self.target, u)

    def _append(self, state: State) -> State:
        """Keep a state, and choose the order of extrapolation that would have foreseen it best."""
        errors = [np.linalg.norm(extrapolate(self.states[-1 - order:], state.fraction) - state.u)
                  for order in range(min(4, len(self.states)))]
        self.order = int(np.argmin(errors))
        self.states = [*self.states[-3:], state]
        return state

    def _equilibrium(self, fraction: float, start: Floats) -> State:
        """Newton's method from a start (N, 3); a new factor when the kept one fails. Raises `NoEquilibrium`."""
        if not self._stale:
            try:
                state = self._newton(fraction, start)
                self.excess += max(0, state.iterations - 2)
                self._stale = self.excess > REFACTOR_COST
                return state
            except NoEquilibrium:
                pass
        last = self.states[-1]
        self._refactor(start if last.u.any() else last.u)
        return self._newton(fraction, start)

    def _refactor(self, u: Floats) -> None:
        try:
            self.factor.update(u)
        except PETSc.Error:
            raise NoEquilibrium("the stiffness cannot be factored") from None
        self._columns = self._columns[:0]
        self._place[:] = -1
        self._stale, self.excess = False, 0

    def _newton(self, fraction: float, start: Floats) -> State:
        """Newton's method with the kept factor. Raises `NoEquilibrium` when it does not converge."""
        u, outer = start, fraction * self.load
        pressure = self.states[-1].pressure
        force = self.elasticity.force(u) - outer
        previous = np.inf
        for iteration in range(1, ITERATIONS + 1):
            step, pressure = self._step(fraction, u, force, pressure)
            u = u + step
            force = self.elasticity.force(u) - outer
            residual, reaction, gap_error, penetration = self._residual(fraction, u, force, pressure)
            if residual <= TOLERANCE and gap_error <= GAP_TOLERANCE * self.size:
                return State(fraction, u, pressure, reaction, iteration, residual, penetration)
            error = max(residual / TOLERANCE, gap_error / (GAP_TOLERANCE * self.size))
            if not np.isfinite(error) or error > 10 * previous:
                break
            previous = min(error, previous)
        raise NoEquilibrium(f"|R| = {residual:.1e} of the reaction")

    def _step(self, fraction: float, u: Floats, force: Floats, pressure: Floats) -> tuple[Floats, Floats]:
        """One Newton step (N, 3) and the contact forces (Q,) after it."""
        if self.contact is None:
            return self.factor.solve(-force), pressure
        gap, normal = self.contact.gaps(u, self.contact.obstacle.position(fraction))
        near = np.flatnonzero((gap < NEAR * self.size) | (pressure > 0))
        if not len(near):
            return self.factor.solve(-force), np.zeros_like(pressure)
        nodes = self.contact.touched_nodes(near)
        rows = self._known(nodes)
        gradient = self.contact.gradient(near, nodes, normal)  # (q, 3 n)
        alone = -(self._columns @ force.ravel())[rows]  # (3 n,) motion of these nodes were there no contact
        local = self._columns[rows][:, (3 * nodes[:, None] + np.arange(3)).ravel()]  # (3 n, 3 n)
        matrix = gradient @ local @ gradient.T
        matrix[np.diag_indices(len(near))] += self.contact.softness[near]
        p = solve_complementarity(matrix, gap[near] + gradient @ alone, pressure[near] > 0)
        pressure = np.zeros_like(pressure)
        pressure[near] = p
        return self.factor.solve(self.contact.forces(pressure, normal) - force), pressure

    def _known(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """(3 n,) where the responses to unit forces on some nodes stand in `_columns`; new ones are computed once a factor."""
        missing = nodes[self._place[nodes] < 0]
        if len(missing):
            self._place[missing] = len(self._columns) // 3 + np.arange(len(missing))
            self._columns = np.concatenate([self._columns, self.factor.compliance(missing).reshape(3 * len(missing), -1)])
        return (3 * self._place[nodes][:, None] + np.arange(3)).ravel()

    def _residual(self, fraction: float, u: Floats, force: Floats, pressure: Floats) -> tuple[float, Floats, float, float]:
        """Residual force over reaction, reaction (3,), largest error of a gap and largest penetration [m]."""
        gap_error = penetration = 0.0
        if self.contact is not None:
            gap, normal = self.contact.gaps(u, self.contact.obstacle.position(fraction))
            force = force - self.contact.forces(pressure, normal)
            touched = gap + self.contact.softness * pressure
            gap_error = float(np.where(pressure > 0, abs(touched), -np.minimum(gap, 0)).max())
            penetration = max(0.0, -float(gap.min()))
            reaction = -(pressure @ normal)
        else:
            reaction = -force[self._bearing].sum(axis=0)
        scale = np.linalg.norm(reaction) if pressure.any() else np.linalg.norm(force[self.fixed])
        residual = float(np.linalg.norm(force[~self.fixed]) / max(float(scale), self.floor / TOLERANCE))
        return residual, reaction, gap_error, penetration

    def _advice(self) -> str:
        count = self.scene.steps.count
        if self.contact is None:
            return f"ask for more than {count} steps"
        path = self.contact.obstacle.path
        stride = np.linalg.norm(np.diff(path, axis=0), axis=1).max(initial=0) * max(1, len(path) - 1) / count
        return f"the obstacle moves {stride / self.size:.2g} cell sizes in one step"


def extrapolate(states: list[State], fraction: float) -> Floats:
    """Displacements (N, 3) of the polynomial through some states (Lagrange's form), at another fraction."""
    at = [state.fraction for state in states]
    weights = [np.prod([(fraction - t) / (s - t) for t in at if t != s]) for s in at]
    return sum((weight * state.u for weight, state in zip(weights, states, strict=True)), np.zeros_like(states[0].u))


def cell_size(mesh: Mesh) -> float:
    """The median length of the mesh's edges [m]."""
    return float(np.median(np.linalg.norm(np.diff(mesh.points[mesh.edges], axis=1), axis=2)))


def check_scene(scene: Scene, mesh: Mesh, path: Path) -> None:
    """Raise `InputError` for a scene that has no solution: a body free to move, an obstacle that starts inside of it."""
    moved = scene.obstacle is not None or path.load.any() or path.target.any()
    free = rigid_motions_left(mesh, path.fixed)
    if moved and free:
        raise InputError(f"support: {free} rigid motion{'s' if free > 1 else ''} of the body left free; fix more components")
    if path.contact is not None:
        gap, _ = path.contact.gaps(np.zeros_like(mesh.points), path.contact.obstacle.position(0.0))
        if gap.min() < -GAP_TOLERANCE * path.size:
            raise InputError(f"obstacle.path: the obstacle starts {-gap.min():.3g} m inside the body; start it outside")


def solve(scene: Scene, *, on_step: Callable[[int], None] | None = None) -> Solution:
    """Follow the path of a scene from rest through all of its steps.

    Args:
        on_step: called with the number of each step that is reached

    Returns:
        the path; when a step has no equilibrium that could be found, all steps before it and `failure`

    Raises:
        InputError: the scene has no solution to look for
    """
    started = time.perf_counter()
    mesh = build_mesh(scene.body)
    path = Path(scene, mesh)
    states, energy, failure = [path.states[0]], [0.0], ""
    for step in range(1, scene.steps.count + 1):
        try:
            state = path.advance(step / scene.steps.count)
        except NoEquilibrium as error:
            failure = f"no equilibrium at step {step}: {error}"
            break
        states.append(state)
        energy.append(path.elasticity.energy(state.u) if state.u.any() else 0.0)
        if on_step is not None:
            on_step(step)
    u = np.array([state.u for state in states])
    return Solution(
        mesh=mesh, displacement=u, reaction=np.array([state.reaction for state in states]), energy=np.array(energy),
        penetration=np.array([state.penetration for state in states]),
        smallest_det_f=smallest_det_f(mesh.points, u, mesh.cells, mesh.cell),
        newton_iterations=np.array([state.iterations for state in states]),
        relative_residual=np.array([state.residual for state in states]), factorisations=path.factor.count,
        halvings=path.halvings, model=model(scene), seconds=time.perf_counter() - started, failure=failure)


def model(scene: Scene) -> dict[str, str]:
    """What is modelled, and why, in words."""
    said = {"kinematics": f"finite strain, {scene.material.law}; {scene.body.cell}s of first order",
            "inertia": "none: quasi-static loading"}
    if scene.obstacle is None:
        said["contact"] = "none: the scene has no obstacle"
    else:
        points = "points of the surface facets" if scene.obstacle.contact == "facets" else "surface nodes"
        said["contact"] = f"frictionless at {points}, rigid {scene.obstacle.shape}; nothing is solved before it touches"
    return said
