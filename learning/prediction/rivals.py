"""What a learned simulator has to beat: predictors that know nothing, and the same finite elements made cheaper.

All of them move the free nodes and are given the motion of the held ones; obstacle nodes take no part. Lengths in [m].
The predictors that know nothing are shown the first frames of the truth, as a simulator with a memory would be.
Legend: T frames (the rest state first), N nodes of the body.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learning.prediction.predictor import Case, LeftOut, Prediction, Predictor
from physics.equilibrium.newton import TOLERANCE
from physics.mesh.mesh import Mesh
from physics.mesh.transfer import interpolate
from physics.scene import Scene, Steps
from physics.solution import solve

Floats = NDArray[np.floating[Any]]
REFERENCE = "FE, the reference"
STILL = "nothing moves"


def trivial() -> list[Predictor]:
    """Nothing moves, keep the last velocity, keep the last acceleration."""
    rules = {STILL: nothing_moves, "keep the last velocity": keep_velocity, "quadratic extrapolation": keep_acceleration}

    def predictor(name: str, rule: Callable[..., tuple[Floats, Floats]]) -> Predictor:
        def predict(case: Case) -> Prediction:
            start = time.process_time()
            path, steps = rule(case.truth, case.free)
            first = {field: values[:1] for field, values in case.trajectory.fields.items()} if rule is nothing_moves else {}
            return Prediction(path=path, seconds=time.process_time() - start, one_step=steps, fields=first)

        return Predictor(name, "trivial", predict)

    return [predictor(name, rule) for name, rule in rules.items()]


def nothing_moves(truth: Floats, free: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Free nodes stay where they are: (T, N, 3) from the rest state, and (T - 1, N, 3) one step from each true frame."""
    path, steps = truth.copy(), truth[1:].copy()
    path[:, free] = 0
    steps[:, free] = truth[:-1, free]
    return path, steps


def keep_velocity(truth: Floats, free: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Free nodes go on as they last went: (T, N, 3) rollout and (T - 1, N, 3) one step from each true frame.

    The rollout is shown frames 0 and 1, and no other: u_t = u_1 + (t - 1) (u_1 - u_0). One step from frame t is
    u_t + (u_t - u_(t-1)), and from the rest state, which has no velocity, it is the rest state.
    """
    return _continued(truth, free, 1)


def keep_acceleration(truth: Floats, free: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """The parabola through the last three frames: (T, N, 3) rollout, shown frames 0, 1 and 2, and (T - 1, N, 3) single steps."""
    return _continued(truth, free, 2)


def _continued(truth: Floats, free: NDArray[np.bool_], order: int) -> tuple[Floats, Floats]:
    """The polynomial of an order through the last frames, of a lower order while there are fewer."""
    shares = [np.array([1.0]), np.array([-1.0, 2.0]), np.array([1.0, -3.0, 3.0])]  # of the last frames, the newest last
    path, steps = truth.copy(), truth[1:].copy()
    for t in range(1, len(truth)):
        share = shares[min(order, t - 1)]
        if t > order:
            path[t, free] = np.tensordot(share, path[t - len(share):t, free].astype(np.float64), 1)
        steps[t - 1, free] = np.tensordot(share, truth[t - len(share):t, free].astype(np.float64), 1)
    return path, steps


def elements(name: str, *, halvings: int = 0, fewer: int = 1, tolerance: float = TOLERANCE, law: str | None = None) -> Predictor:
    """Finite elements, cheaper by some of: halved cells, so many times fewer steps, a looser tolerance, another law."""

    def predict(case: Case) -> Prediction:
        scene: Scene | None = case.scene
        for _ in range(halvings):
            scene = coarser(scene) if scene is not None else None
        if scene is None:
            raise LeftOut("the mesh is that of a file, which is not made coarser" if case.scene.body.shape == "file" else
                          "there are no cells left to halve")
        if law is not None:
            if all(material.law == law for material in scene.materials):
                raise LeftOut(f"the material is {law} already")
            scene = scene.under(law)
        count = max(1, round(case.steps / fewer))
        own = case.mesh if scene.body.shape == "file" else None  # a shape's is built, a part of the set-up
        mesh, path, set_up, seconds, iterations = follow(replace(scene, steps=Steps(count=count)), tolerance, own)
        started = time.process_time()
        if count != case.steps:
            path = between(path, case.steps)
        if halvings:
            path = interpolate(mesh, path, case.mesh.points)
        return Prediction(path=path, seconds=seconds + time.process_time() - started, set_up=set_up, iterations=iterations)

    return Predictor(name, "reference" if name == REFERENCE else "fe", predict)


def follow(scene: Scene, tolerance: float = TOLERANCE, mesh: Mesh | None = None) -> tuple[Mesh, Floats, float, float, int]:
    """The solver's path: its mesh (the scene's by default), (T, N, 3), seconds of set-up and of steps, Newton steps. Raises `LeftOut`."""
    started = time.process_time()
    found = solve(scene, mesh=mesh, tolerance=tolerance, partial=True)
    if found.failure:
        raise LeftOut(f"there is {found.failure}")
    seconds = time.process_time() - started - found.set_up
    return found.mesh, found.displacement, found.set_up, seconds, int(found.newton_iterations.sum())


def between(path: Floats, steps: int) -> Floats:
    """(steps + 1, N, 3) the frames of a path (T, N, 3) of fewer steps, straight lines between them."""
    at = np.linspace(0, len(path) - 1, steps + 1)
    before = np.minimum(at.astype(int), len(path) - 2)
    share = (at - before)[:, None, None]
    return (1 - share) * path[before] + share * path[before + 1]


def coarser(scene: Scene) -> Scene | None:
    """The scene with half the cells along each direction, rounded down, at least 2; None when nothing is left to halve."""
    if scene.body.shape in ("file", "channel", "panel"):
        return None
    divisions = tuple(min(n, max(2, n // 2)) for n in scene.body.divisions)
    if divisions == scene.body.divisions:
        return None
    return replace(scene, body=replace(scene.body, cells=divisions, cell_size=None))
