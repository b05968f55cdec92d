"""What a learned simulator of flows has to beat: predictors that know nothing of the equations, and the same solver on larger cells.

"Nothing changes" is shown one frame, the first in which the fluid moves. The others need a past, and are shown every frame of the first
half: "the last period again" repeats the lag in frames after which the flow looked most like itself, and the dynamic mode decomposition
fits x(t + 1) = A x(t) to what it is shown (Schmid, J. Fluid Mech. 656, 2010). With X = U S V' of all frames but the last, X+ of all
but the first, A has the matrix U' X+ V S^-1 in the basis U of the largest singular values; eigenvalues outside of the unit circle, which
would grow without end, are drawn back onto it. All of them are given the velocity where it is prescribed.

Legend: T frames, S nodes, r modes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datagen.flow.prediction import FlowTruth
from datagen.flow.refined import carried, coarser
from learning.prediction.predictor import LeftOut
from physics.fidelity.carried import reader
from physics.fidelity.flow import nothing_changes
from physics.flow.solution import solve_flow

Floats = NDArray[np.float64]
REFERENCE = "FE, the reference"
IDLE = "nothing changes"
MODES, SMALLEST = 40, 1e-5  # of a dynamic mode decomposition: at most, and of the largest singular value
SHORTEST = 6  # frames of a period


@dataclass(frozen=True, kw_only=True)
class FlowPath:
    """What one predictor says about one flow, and what that cost.

    velocity: (T, S, 2) [m/s]; pressure: (T, S) [Pa], None where it is not predicted
    one_step: (T - 1 - first, S, 2) velocities one step from each true frame; None when it starts from none
    seconds: processor time of all steps; set_up: before the first one
    shown: the last frame of the truth that it has seen
    """

    velocity: Floats
    pressure: Floats | None = None
    one_step: Floats | None = None
    seconds: float
    set_up: float = 0.0
    shown: int


@dataclass(frozen=True)
class FlowPredictor:
    """A name, one of report.table.KINDS, and a function that predicts a flow or raises `LeftOut`."""

    name: str
    kind: str
    predict: Callable[[FlowTruth], FlowPath]


def trivial() -> list[FlowPredictor]:
    """Nothing changes, the last period again, dynamic mode decomposition."""
    return [FlowPredictor(IDLE, "trivial", stays), FlowPredictor("the last period again", "trivial", again),
            FlowPredictor("dynamic mode decomposition", "trivial", decomposed)]


def stays(truth: FlowTruth) -> FlowPath:
    """The flow as it is shown, for ever."""
    start, of, first = time.process_time(), truth.reference, truth.first
    pressure = None if of.pressure is None else nothing_changes(of.pressure, first, np.ones(of.pressure.shape[1], bool))
    steps = of.velocity[first + 1:].copy()
    steps[:, of.predicted] = of.velocity[first:-1, of.predicted]
    path = nothing_changes(of.velocity, first, of.predicted)
    return FlowPath(velocity=path, pressure=pressure, one_step=steps, seconds=time.process_time() - start, shown=first)


def again(truth: FlowTruth) -> FlowPath:
    """The last period of the first half again and again."""
    start, (x, last) = time.process_time(), _shown(truth)
    lag = period(x)
    source = last - lag + 1 + np.arange(len(truth.reference.velocity) - last - 1) % lag
    return _gone_on(truth, last, lambda field: field[source], start)


def decomposed(truth: FlowTruth) -> FlowPath:
    """The linear map that the first half looks like, gone on with."""
    start, (x, last) = time.process_time(), _shown(truth)
    future = dynamic_modes(x, len(truth.reference.velocity) - last - 1)
    nodes = truth.reference.velocity.shape[1]
    velocity = future[:, :2 * nodes].reshape(-1, nodes, 2)
    pressure = None if truth.reference.pressure is None else future[:, 2 * nodes:]
    return _gone_on(truth, last, lambda field: velocity if field.ndim == 3 else pressure, start)


def _shown(truth: FlowTruth) -> tuple[Floats, int]:
    """(frames, 2 S or 3 S) what the first half of the frames is, from the first that moves on, and the last of them. Raises `LeftOut`."""
    of = truth.reference
    last = len(of.velocity) // 2
    if last - truth.first < 2 * SHORTEST:
        raise LeftOut(f"the first half has {last - truth.first + 1} frames, of which nothing is learned")
    rows = [of.velocity[truth.first:last + 1].reshape(last + 1 - truth.first, -1)]
    return np.concatenate(rows if of.pressure is None else [*rows, of.pressure[truth.first:last + 1]], axis=1), last


def _gone_on(truth: FlowTruth, last: int, future: Callable[[Floats], Floats | None], start: float) -> FlowPath:
    """The truth up to a frame and then something else, where it is not given."""
    of, found = truth.reference, []
    for field in (of.velocity, of.pressure):
        path = None if field is None else field.copy()
        if path is not None and field is not None:
            chosen = of.predicted if field.ndim == 3 else slice(None)
            said = future(field)
            assert said is not None
            path[last + 1:, chosen] = said[:, chosen]
        found.append(path)
    assert found[0] is not None
    return FlowPath(velocity=found[0], pressure=found[1], seconds=time.process_time() - start, shown=last)


def period(x: Floats) -> int:
    """The number of frames after which states (T, n) in the second half of the frames were most like those before, SHORTEST at least."""
    frames = len(x)
    gram = x @ x.T
    size = np.diag(gram)
    late = np.arange(frames // 2, frames)
    lags = np.arange(SHORTEST, frames // 2 + 1)
    off = [float((size[late] + size[late - lag] - 2 * gram[late, late - lag]).mean()) for lag in lags]
    return int(lags[np.argmin(off)])


def dynamic_modes(x: Floats, steps: int) -> Floats:
    """(steps, n) what follows states (T, n) by the linear map that led from each to the next."""
    left, size, right = np.linalg.svd(x[:-1].T, full_matrices=False)
    rank = max(1, min(MODES, int((size > SMALLEST * size[0]).sum())))
    left, size, right = left[:, :rank], size[:rank], right[:rank]
    values, vectors = np.linalg.eig(left.T @ x[1:].T @ (right.T / size))
    values = values / np.maximum(1.0, abs(values))
    share = np.linalg.lstsq(vectors, (left.T @ x[-1]).astype(complex), rcond=None)[0]
    powers = values[None] ** np.arange(1, steps + 1)[:, None]  # (steps, r)
    found: Floats = ((powers * share) @ vectors.T).real @ left.T
    return found


def elements(name: str, *, larger: float = 1.0, order: int | None = None) -> FlowPredictor:
    """The solver on cells so many times as large, or of another order; on the cells of the data it is the reference."""

    def predict(truth: FlowTruth) -> FlowPath:
        scene = truth.scene
        if scene is None:
            raise LeftOut("there is no scene, and so there are no equations")
        if scene.body.shape == "file":
            raise LeftOut("the mesh is that of a file, which is not made coarser")
        other = coarser(scene, larger)
        other = other if order is None else replace(other, fluid=replace(other.fluid, order=order))
        start = time.process_time()
        found = solve_flow(other, partial=True)
        if found.failure:
            raise LeftOut(f"there is {found.failure}")
        velocity, pressure = found.velocity[..., :2].astype(np.float64), found.pressure[..., 0].astype(np.float64)
        if other != scene:
            carry = reader(other, truth.reference.mesh.points[:, :2])
            velocity, pressure = carried(carry, velocity), carried(carry, pressure)
            given = ~truth.reference.predicted
            velocity[:, given] = truth.reference.velocity[:, given]
        return FlowPath(velocity=velocity, pressure=pressure, seconds=time.process_time() - start - found.set_up, set_up=found.set_up,
                        shown=0)

    return FlowPredictor(name, "reference" if name == REFERENCE else "fe", predict)
