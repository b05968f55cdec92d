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

from physics.contact import Contact, ContactSurface, Zone, solve_complementarity
from physics.elasticity import Elasticity
from physics.factor import NotPositiveDefinite, factor_for
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
REACH = 2.0  # and up to this many cell sizes away they are looked at
ITERATIONS = 12  # Newton steps before a state is given up
HALVINGS = 6
REFACTOR_COST = 8  # a new factor costs about as much as this many Newton steps with the old one


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
    residual: float = 0.0  # free components, over the reaction
    gap_error: float = 0.0  # [m] how far contact is from its conditions
    penetration: float = 0.0  # [m]


@dataclass
class Touch:
    """Contact at one state: gaps (q,) [m], normals (q, 3) and forces (q,) [N] at the points of a zone."""

    zone: Zone
    gap: Floats
    normal: Floats
    pressure: Floats


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
        self.factor = factor_for(self.elasticity)
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
        self.fresh = 2  # Newton steps that a new factor needed
        self.factorisations = 0
        self._zone: Zone | None = None
        self._compliance: tuple[NDArray[np.int64], Floats] | None = None
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
                self.excess += max(0, state.iterations - self.fresh)
                self._stale = self.excess > REFACTOR_COST
                return state
            except NoEquilibrium:
                pass
        self._refactor(start if self.states[-1].u.any() else self.states[-1].u)
        state = self._newton(fraction, start)
        self.fresh = state.iterations
        return state

    def _refactor(self, u: Floats) -> None:
        try:
            self.factor.update(u)
        except NotPositiveDefinite as error:
            raise NoEquilibrium(str(error)) from None
        self.factorisations += 1
        self._compliance = None
        self._stale, self.excess = False, 0

    def _newton(self, fraction: float, start: Floats) -> State:
        """Newton's method with the kept factor. Raises `NoEquilibrium` when it does not converge."""
        u, outer = start, fraction * self.load
        touch = self._touch(fraction, u)
        force = self.elasticity.force(u) - outer
        previous = np.inf
        for iteration in range(1, ITERATIONS + 1):
            u = u + self._step(force, touch)
            force = self.elasticity.force(u) - outer
            if touch is not None:
                touch = self._touch(fraction, u, touch)
            state = self._judge(fraction, u, force, touch, iteration)
            error = max(state.residual / TOLERANCE, state.gap_error / (GAP_TOLERANCE * self.size))
            if error <= 1:
                return state
            if not np.isfinite(error) or error > 10 * previous:
                break
            previous = min(error, previous)
        raise NoEquilibrium(f"|R| = {state.residual:.1e} of the reaction, a gap is {state.gap_error:.1e} m off")

    def _touch(self, fraction: float, u: Floats, before: Touch | None = None) -> Touch | None:
        """Gaps at displacements (N, 3), with the contact forces of before, or of the last state; None without an obstacle."""
        if self.contact is None:
            return None
        centre = self.contact.obstacle.position(fraction)
        zone = before.zone if before is not None else self._zone
        pressure = before.pressure if before is not None else self.states[-1].pressure
        if zone is None or not zone.covers(u, centre, NEAR * self.size):
            if before is not None:  # forces go from zone to zone by way of the whole surface
                pressure = np.zeros_like(self.states[-1].pressure)
                pressure[zone.points] = before.pressure
            zone = self._zone = self.contact.zone(u, centre, REACH * self.size)
            pressure = pressure[zone.points]
        elif before is None:
            pressure = pressure[zone.points]
        gap, normal = zone.gaps(u, centre)
        return Touch(zone, gap, normal, pressure)

    def _step(self, force: Floats, touch: Touch | None) -> Floats:
        """One Newton step (N, 3) from out-of-balance forces (N, 3); the contact forces after it go into `touch`."""
        step = self.factor.solve(-force)  # were there no contact
        if touch is None:
            return step
        near = np.flatnonzero((touch.gap < NEAR * self.size) | (touch.pressure > 0))
        touched, touch.pressure = touch.pressure[near] > 0, np.zeros_like(touch.gap)
        if not len(near):
            return step
        zone = touch.zone
        nodes = np.flatnonzero(zone.weights[near].any(axis=0))
        gradient = zone.gradient(near, nodes, touch.normal)  # (k, 3 n)
        matrix = gradient @ self._compliance_of(zone.nodes[nodes]) @ gradient.T
        matrix[np.diag_indices(len(near))] += zone.softness[near]
        gap = touch.gap[near] + gradient @ step[zone.nodes[nodes]].ravel()
        try:
            touch.pressure[near] = solve_complementarity(matrix, gap, touched)
        except np.linalg.LinAlgError:
            raise NoEquilibrium("the body gives way to contact without resistance") from None
        if not touch.pressure.any():
            return step
        push = np.zeros_like(force)
        push[zone.nodes] = zone.forces(touch.pressure, touch.normal)
        return step + self.factor.solve(push)

    def _compliance_of(self, nodes: NDArray[np.int64]) -> Floats:
        """(3 n, 3 n) of the kept factor, from what is known of it, or computed for these nodes and those known before."""
        if self._compliance is None or not np.isin(nodes, self._compliance[0], assume_unique=True).all():
            known = nodes if self._compliance is None else np.union1d(nodes, self._compliance[0])
            self._compliance = known, self.factor.compliance(known)
        known, compliance = self._compliance
        rows = (3 * np.searchsorted(known, nodes)[:, None] + np.arange(3)).ravel()
        return compliance[np.ix_(rows, rows)]

    def _judge(self, fraction: float, u: Floats, force: Floats, touch: Touch | None, iteration: int) -> State:
        """How far displacements (N, 3) with out-of-balance forces (N, 3) and contact are from equilibrium."""
        pressure, reaction = self.states[0].pressure, np.zeros(3)
        gap_error = penetration = scale = 0.0
        if touch is not None:
            force = force.copy()
            force[touch.zone.nodes] -= touch.zone.forces(touch.pressure, touch.normal)
            error = np.where(touch.pressure > 0, abs(touch.gap + touch.zone.softness * touch.pressure), -np.minimum(touch.gap, 0))
            gap_error, penetration = float(error.max(initial=0)), max(0.0, -float(touch.gap.min(initial=0)))
            reaction = -(touch.pressure @ touch.normal)
            scale = float(np.linalg.norm(reaction))
            pressure = np.zeros_like(pressure)
            pressure[touch.zone.points] = touch.pressure
        else:
            reaction = -force[self._bearing].sum(axis=0)
        scale = scale or float(np.linalg.norm(force[self.fixed]))
        residual = float(np.linalg.norm(force[~self.fixed])) / max(scale, self.floor / TOLERANCE)
        return State(fraction, u, pressure, reaction, iteration, residual, gap_error, penetration)

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
        relative_residual=np.array([state.residual for state in states]), factorisations=path.factorisations,
        halvings=path.halvings, model=model(scene), seconds=time.perf_counter() - started, failure=failure)


def model(scene: Scene) -> dict[str, str]:
    """What is modelled, and why, in words."""
    cells = "the cells of the file" if scene.body.shape == "file" else f"{scene.body.cell}s"
    said = {"kinematics": f"finite strain, {scene.material.law}; {cells}, of first order",
            "inertia": "none: quasi-static loading"}
    if scene.obstacle is None:
        said["contact"] = "none: the scene has no obstacle"
    else:
        points = "points of the surface facets" if scene.obstacle.contact == "facets" else "surface nodes"
        said["contact"] = f"frictionless at {points}, rigid {scene.obstacle.shape}; nothing is solved before it touches"
    return said
