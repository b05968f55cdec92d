"""Quasi-static path following: the equilibria of a body while loads, supports and a rigid obstacle advance.

Scenes with inertia go through time instead (dynamics.py); `solve` follows both.

What balances what stands in balance.py, how one equilibrium is found in newton.py, when small strain is enough in linear.py.
Inertia is left out: the loading is taken to be slow (inertia.py). Each equilibrium starts from a polynomial through the last
states, of the order that would have predicted the last one best. Before anything touches or loads the body nothing is solved.

A path can be kept in a journal (journal.py) and gone on with after a kill, to the same bits as if nothing had happened.

A step without an equilibrium is taken in two halves, down to 2^-HALVINGS of a step; then the body is left to itself (snap.py).
Where it does not come to rest the path ends with a clear failure that keeps what was solved before. A step in which the
obstacle could jump through the body is halved beforehand.

Legend: N nodes, Q contact points, T steps + 1.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.balance import Balance
from physics.journal import Arrays, Journal
from physics.linear import LINEAR_TOLERANCE, choose
from physics.mesh import Mesh, build_mesh
from physics.newton import Newton, NoEquilibrium, State
from physics.quality import smallest_det_f
from physics.scene import Scene
from physics.schema import InputError
from physics.snap import Relaxation

Floats = NDArray[np.float64]

HALVINGS = 6


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
    snap: Floats  # (T,) [m] the farthest that a node moved in this step without equilibria between (snap.py)
    released: Floats  # (T,) [J] by which the potential fell in that motion
    factorisations: int
    halvings: int
    model: dict[str, str]  # what was modelled, and why
    seconds: float
    kinetic_energy: Floats | None = None  # (T,) [J]; None where inertia is left out
    linear_steps: int = 0  # the first ones, which solve linear elasticity
    resumed: int = 0  # steps that an earlier, unfinished run had reached
    failure: str = ""  # empty when every step was reached


class Path:
    """The way through the equilibria of a scene."""

    def __init__(self, scene: Scene, mesh: Mesh, *, method: str | None = None, spread: bool = False) -> None:
        """Args: method, spread: of the linear algebra, as in `factor.solver_for`."""
        self._finite = Balance(scene, mesh, method=method, spread=spread)
        self.linear, self.kinematics = choose(scene, mesh, self._finite)  # as long as small strain is enough, and why it is not
        self.linear_steps = 0
        self.newton = self.linear.newton if self.linear else Newton(self._finite)
        self.balance = self.newton.balance
        contact = self.balance.contact
        self.states = [State(0.0, np.zeros_like(mesh.points), np.zeros(0 if contact is None else len(contact.surface.area)))]
        self.order, self.halvings = 0, 0
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
            if self.linear is not None and self.balance.contact is None:
                state = self.linear.scaled(fraction)
            else:
                state = self.newton.equilibrium(fraction, self._predict(fraction), last)
            if self.linear is None or self.linear.holds(state.u):
                return self._append(state)
        except NoEquilibrium as error:
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
                           f"off by {self.linear.error:.1e} of the largest displacement, {LINEAR_TOLERANCE:g} is allowed")
        self.linear, self.newton, self.balance = None, Newton(self._finite), self._finite

    def frame(self) -> Arrays:
        """What is reported of the last state; each of the arrays is a row of one in `Solution`."""
        state, snap, released = self.states[-1], self.snap, self.released
        self.snap = self.released = 0.0
        self.linear_steps += self.linear is not None and state.fraction > 0
        energy = self.balance.elasticity.energy(state.u) if state.u.any() else 0.0
        found: dict[str, Any] = {
            "displacement": state.u, "reaction": state.reaction, "energy": energy, "penetration": state.penetration,
            "newton_iterations": state.iterations, "relative_residual": state.residual, "snap": snap, "released": released}
        return {name: np.asarray(value) for name, value in found.items()}

    def memory(self) -> Arrays:
        """All that the rest of the path depends on: what `recall` takes."""
        kept = {name: np.array([getattr(state, name) for state in self.states]) for name in ("fraction", "u", "pressure")}
        kept |= {name: np.array(getattr(self, name)) for name in ("order", "halvings", "linear_steps", "kinematics")}
        if self.linear is not None:
            kept |= self.linear.memory()
        return kept | {f"newton_{name}": array for name, array in self.newton.memory().items()}

    def recall(self, memory: Arrays) -> None:
        """Go on as the path whose memory this is would have, to the last bit."""
        self.states = [State(float(fraction), u, pressure)
                       for fraction, u, pressure in zip(memory["fraction"], memory["u"], memory["pressure"], strict=True)]
        self.order, self.halvings, self.linear_steps = (int(memory[name]) for name in ("order", "halvings", "linear_steps"))
        if self.linear is not None and "linear" not in memory:
            self.linear, self.newton, self.balance = None, Newton(self._finite), self._finite
        elif self.linear is not None:
            self.linear.recall(memory)
        self.kinematics = str(memory["kinematics"])
        self.newton.recall({name.removeprefix("newton_"): array for name, array in memory.items() if name.startswith("newton_")})

    def _snap(self, fraction: float, error: NoEquilibrium) -> State:
        """The equilibrium that the body moves to when the path of the last one ends."""
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
        said = {"kinematics": kinematics, "material": f"{self._finite.scene.material.law}; {cells_said(scene)}",
                "contact": contact_said(scene)}
        return said | {"factor": self.newton.factor.name}

    def _predict(self, fraction: float) -> Floats:
        """Extrapolated displacements (N, 3), held components on their prescription."""
        return self.newton.led(extrapolate(self.states[-1 - self.order:], fraction), fraction * self.balance.target)

    def _append(self, state: State) -> State:
        """Keep a state, and choose the order of extrapolation that would have foreseen it best."""
        self.order = best_order(self.states, state)
        self.states = [*self.states[-3:], state]
        return state

    def _advice(self) -> str:
        count = self.balance.scene.steps.count
        if self.balance.contact is None:
            return f"ask for more than {count} steps"
        path = self.balance.contact.obstacle.path
        stride = np.linalg.norm(np.diff(path, axis=0), axis=1).max(initial=0) * max(1, len(path) - 1) / count
        return f"the obstacle moves {stride / self.balance.size:.2g} cell sizes in one step"


def cells_said(scene: Scene) -> str:
    """What a body is meshed with, in words."""
    element = "" if scene.body.element == "standard" else f", {scene.body.element} element"
    return f"{'the cells of the file' if scene.body.shape == 'file' else scene.body.cell + 's'}, of first order{element}"


def contact_said(scene: Scene) -> str:
    """How contact is treated, in words."""
    if scene.obstacle is None:
        return "none: the scene has no obstacle"
    points = "points of the surface facets" if scene.obstacle.contact == "facets" else "surface nodes"
    return f"frictionless at {points}, rigid {scene.obstacle.shape}; nothing is solved before it touches"


def extrapolate(states: list[State], fraction: float) -> Floats:
    """Displacements (N, 3) of the polynomial through some states (Lagrange's form), at another fraction."""
    at = [state.fraction for state in states]
    weights = [np.prod([(fraction - t) / (s - t) for t in at if t != s]) for s in at]
    return sum((weight * state.u for weight, state in zip(weights, states, strict=True)), np.zeros_like(states[0].u))


def best_order(states: list[State], state: State) -> int:
    """The order, up to three, of the polynomial through the last states that would have foreseen the next one best."""
    errors = [np.linalg.norm(extrapolate(states[-1 - order:], state.fraction) - state.u) for order in range(min(4, len(states)))]
    return int(np.argmin(errors))


def solve(scene: Scene, *, mesh: Mesh | None = None, on_step: Callable[[int], None] | None = None,
          journal: str | FilePath | None = None, method: str | None = None, spread: bool = False) -> Solution:
    """Follow the path of a scene from rest through all of its steps: through equilibria, or through time when the scene says so.

    Args:
        mesh: in place of the one that the scene's body describes
        on_step: called with the number of each step that is reached
        journal: a file that keeps the path as it grows; what it holds of an earlier run of the same scene is gone on from, also
            when that run ended in a failure: then the step that failed is tried again. It is left for the caller to delete.
        method: "direct" or "multigrid" instead of the choice by size
        spread: over all processes of an MPI run, which share the linear algebra; every one gets the whole answer

    Returns:
        the path; when a step has no equilibrium that could be found, all steps before it and `failure`

    Raises:
        InputError: the scene has no solution to look for, or the journal is of another scene
        WorkError: another process has the journal open
        OSError: the journal cannot be written
    """
    started, spent = time.perf_counter(), 0.0
    mesh = mesh or build_mesh(scene.body)
    path, frames, failure = _way(scene, mesh, method, spread), [], ""
    kept = None if journal is None else Journal(journal, identity(scene, mesh))
    try:
        if kept is not None and kept.frames:
            frames = [dict(zip(kept.frames, rows, strict=True)) for rows in zip(*kept.frames.values(), strict=True)]
            spent = float(kept.memory["seconds"])
            path.recall(kept.memory)
        resumed = max(0, len(frames) - 1)
        for step in range(len(frames), scene.steps.count + 1):
            try:
                if step:
                    path.advance(step / scene.steps.count)
            except NoEquilibrium as error:
                failure = f"no {'motion' if scene.steps.dynamic else 'equilibrium'} at step {step}: {error}"
                break
            frames.append(path.frame())
            if kept is not None:
                kept.add(frames[-1], path.memory() | {"seconds": np.array(spent + time.perf_counter() - started)})
            if on_step is not None and step:
                on_step(step)
        if kept is not None:
            kept.save()
    finally:
        if kept is not None:
            kept.close()
    rows = {name: np.array([frame[name] for frame in frames]) for name in frames[0]}
    return Solution(
        mesh=mesh, **rows, smallest_det_f=smallest_det_f(mesh.points, rows["displacement"], mesh.cells, mesh.cell),
        factorisations=path.newton.factorisations, halvings=path.halvings, linear_steps=path.linear_steps,
        model=path.model() | snapped(rows["snap"]),
        seconds=spent + time.perf_counter() - started, resumed=resumed, failure=failure)


def _way(scene: Scene, mesh: Mesh, method: str | None, spread: bool) -> Any:
    if not scene.steps.dynamic:
        return Path(scene, mesh, method=method, spread=spread)
    from physics.dynamics import Motion  # which builds on this module

    if spread:
        raise InputError("steps.dynamic = true: motion in time runs as one process")
    return Motion(scene, mesh)


def identity(scene: Scene, mesh: Mesh) -> str:
    """One line that no other scene has, nor this one with another mesh in its file."""
    digest = hashlib.sha256(scene.to_toml().encode())
    for array in (mesh.points, mesh.cells):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def snapped(snap: Floats) -> dict[str, str]:
    """In which steps the body snapped, in words; snap (T,) [m] as in `Solution`."""
    steps = np.flatnonzero(snap)
    if not len(steps):
        return {}
    named = ", ".join(map(str, steps[:5])) + (f" and {len(steps) - 5} more" if len(steps) > 5 else "")
    return {"snaps": f"at step {named} the body moved by up to {snap.max():.3g} m without an equilibrium between, as in a viscous medium"}
