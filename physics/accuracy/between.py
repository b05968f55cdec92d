"""The whole scene on the mesh that was chosen: of a smooth path few steps are solved, those between lie on cubic splines through them.

Where nothing touches the body, and loads and supports grow evenly, equilibria are a smooth function of the fraction of the loading.
Splines through every k-th step and the rest state are off by about k^4 times what they would be through all. How far is seen when every
second of the solved steps is left out and held against the splines through the others: with an error that fell as slowly as k^2 a
quarter of that would be left, which is what counts. Where it is too much more steps are solved, and where that is not enough all. So
they are where a step fails, or the body snaps: splines know nothing of that. A step is begun between the last ones and the poses ahead
that the search has found.

Held components stay on their prescription. The residual of a step between is that in the middle of its interval, where it is largest.
Legend: N nodes, K solved steps and the rest state, n other steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from physics.accuracy.choose import Choice
from physics.accuracy.estimate import norm
from physics.body.supports import held
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import TOLERANCE
from physics.scene import Scene
from physics.solution import Solution, of_path, solve

Floats = NDArray[np.float64]

BETWEEN = 0.05  # of the error asked
FEWEST = 8  # steps that are solved
SHARE = 1 / 3  # of the steps: where more have to be solved all are
TRIES = 2
SLOWEST = 2  # order with which the error of splines falls at least
USUAL = 3  # and by which it is foreseen


def solve_chosen(choice: Choice, *, on_step: Callable[[int], None] | None = None, journal: str | Path | None = None,
                 partial: bool = False, balanced: bool = False, snaps: bool = True) -> Solution:
    """All steps of a scene as it was chosen for an error: solved, or between solved ones (`Solution.every`).

    Args: as of `solve`; a journal is kept where all steps are solved
        balanced: whether every step is to satisfy the equations, to TOLERANCE at least: then all are solved
    Raises: as `solve`
    """
    scene, count = choice.scene, choice.scene.steps.count
    tolerance = min(choice.tolerance, TOLERANCE) if balanced else choice.tolerance
    how: dict[str, Any] = {"mesh": choice.mesh, "tolerance": tolerance, "small_strain": choice.small_strain, "snaps": snaps}
    solved = _divisor(count, FEWEST) if smooth(scene) and not balanced else None
    for _ in range(TRIES):
        if solved is None:
            break
        every = count // solved

        def reached(step: int, every: int = every) -> None:
            if on_step is not None:
                on_step(step * every)

        fewer = replace(scene, steps=replace(scene.steps, count=solved))
        found = solve(fewer, on_step=reached, partial=True, look=False, ahead=choice.states, **how | {"snaps": False})
        if found.failure:
            break
        off = missed(choice, found, 1)
        if off <= BETWEEN * choice.asked:
            return _filled(scene, found, every)
        solved = _divisor(count, solved * max(1.5, (off / (BETWEEN * choice.asked)) ** (1 / USUAL)))
    return solve(scene, on_step=on_step, journal=journal, partial=partial, **how)


def smooth(scene: Scene) -> bool:
    """Whether nothing that the scene says makes a kink in its path: no obstacle, and no table."""
    return not scene.obstacles and all(load.steps is None for load in scene.load) and all(
        support.steps is None for support in scene.support)


def missed(choice: Choice, solution: Solution, every: int) -> float:
    """About how far splines through every so manyth frame are off, over the values themselves, in the quantity that the error is of."""
    frames = np.arange(0, len(solution.displacement), every)
    kept = np.unique([*range(0, len(frames), 2), len(frames) - 1])
    left = np.setdiff1d(np.arange(len(frames)), kept)
    to, led = splines(kept, left), {}
    for name in ("displacement", "reaction"):
        led[name] = (given := getattr(solution, name)).copy()
        led[name][frames[left]] = np.tensordot(to, given[frames[kept]], 1)
    values, weights = choice.pilots.of(choice.scene, solution, frames.tolist()), choice.pilots.weights
    off = choice.pilots.of(choice.scene, replace(solution, **led), frames[left].tolist()) - values[left]
    size = norm(values[1:], weights) / (len(frames) - 1) ** 0.5
    return norm(off, weights) / len(left) ** 0.5 / size / 2**SLOWEST if size > 0 else 0.0


def splines(at: NDArray[Any], to: NDArray[Any]) -> Floats:
    """(n, K) what values at some places (K,) make of those at others (n,), by cubic splines through them."""
    return np.asarray(CubicSpline(at, np.eye(len(at)))(to))


def _divisor(count: int, least: float) -> int | None:
    """The smallest number of steps, at least so many, into which all can be grouped evenly; None where that is too large a share."""
    return next((n for n in range(FEWEST, int(SHARE * count) + 1) if n >= least and count % n == 0), None)


def _filled(scene: Scene, solution: Solution, every: int) -> Solution:
    """A solution in large steps, with the steps between."""
    started = time.perf_counter()
    count, nodes = scene.steps.count, solution.mesh.points.shape
    frames, ends = np.arange(count + 1), np.arange(0, count + 1, every)
    to = splines(ends, frames)
    u = (to @ solution.displacement.reshape(len(ends), -1)).reshape(-1, *nodes)
    u[ends] = solution.displacement
    balance = Balance(scene, solution.mesh)
    fixed = held(scene, solution.mesh)
    if balance.moves.varied:
        for frame in frames:
            u[frame][fixed] = balance.moved(frame / count)[fixed]
    else:
        u[:, fixed] = frames[:, None] / count * balance.target[fixed]
    each = {name: to @ getattr(solution, name) for name in ("reaction", "energy")}
    residual = np.append(solution.relative_residual[0], solution.relative_residual[1:].repeat(every))
    linear = solution.linear_steps * every
    for start in ends[:-1].tolist():
        if start >= linear:
            middle = start + (every + 1) // 2
            residual[start + 1:start + every] = _left(balance, u[middle], middle / count)
    iterations = np.zeros(count + 1, np.int64)
    iterations[ends] = solution.newton_iterations
    zeros = np.zeros(count + 1)
    return of_path(scene, replace(
        solution, displacement=u, **each, penetration=zeros, newton_iterations=iterations, relative_residual=residual, snap=zeros,
        released=zeros, linear_steps=linear, every=every, seconds=solution.seconds + time.perf_counter() - started,
        model=solution.model | {"steps": f"{count // every} of {count} are solved, the others lie on cubic splines through them"}))


def _left(balance: Balance, u: Floats, fraction: float) -> float:
    """|residual| / |reaction| at displacements (N, 3), as in `Solution`."""
    force = balance.elasticity.force(u) - balance.apply_loads(fraction)
    reaction = max(float(np.linalg.norm(force[balance.fixed])), balance.floor / TOLERANCE)
    return float(np.linalg.norm(force[~balance.fixed])) / reaction
