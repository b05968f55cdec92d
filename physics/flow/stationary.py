"""A stationary flow, by Newton's method.

    (w . grad w + (div w) w / 2, v) + nu (grad w, grad v) - (p, div v) = (s, v) + backflow,   (q, div w) = 0

Stokes flow comes first, then steps of Picard, whose convection has the last velocity, and then Newton's. Where that does not
converge the viscosity is taken larger and brought down, each flow beginning at the last. The matrix is neither symmetric nor definite:
a sparse LU factor of SuperLU's, of minimum degree on A + A^T.

A stationary flow need not be one that is seen: past the onset of shedding it is unstable.

Legend: N velocity nodes, M pressure nodes, C cells, n nodes of a cell, m of its pressure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from physics.flow.conditions import Conditions, OpenEdges
from physics.flow.space import SKEW, FlowSpace

Floats = NDArray[np.float64]

PICARD, NEWTON = 4, 20  # steps at most
TOLERANCE = 1e-11  # of the residual, over that of the flow at rest but for the boundary
PIVOT = 0.1  # of the largest entry of a column, that the diagonal keeps its place at: a third of the factor's numbers
EASIER, MOST = 4.0, 6  # the factor of the viscosity, and how often it is taken


class NoStationaryFlow(RuntimeError):
    """Newton's method did not converge."""


@dataclass(frozen=True)
class Stationary:
    """A flow and how it was found: velocity (N, 2) [m/s], pressure (M,) [m2/s2], linear solves, the last relative residual."""

    u: Floats
    p: Floats
    iterations: int
    residual: float


class Equations:
    """The stationary equations on a space, with their boundary."""

    def __init__(self, space: FlowSpace, conditions: Conditions) -> None:
        self.space, self.conditions = space, conditions
        self.nodes, self.pressures = len(space.velocity.points), len(space.pressure.points)
        v, q = space.velocity.cells.astype(np.int64), space.pressure.cells.astype(np.int64)
        both = np.stack([2 * v, 2 * v + 1], axis=2).reshape(len(v), -1)  # x and y of each node
        self._unknowns = np.concatenate([both, 2 * self.nodes + q], axis=1)  # (C, 2 n + m)
        n, m = v.shape[1], q.shape[1]
        blocks = np.zeros((len(v), 2 * n + m, 2 * n + m))
        divergence = space.divergence_blocks().reshape(len(v), m, 2 * n)
        blocks[:, 2 * n:, :2 * n] = -divergence
        blocks[:, :2 * n, 2 * n:] = -divergence.transpose(0, 2, 1)
        self._still = blocks
        self._viscosity = np.einsum("cij,de->cidje", space.viscosity, np.eye(2)).reshape(len(v), 2 * n, 2 * n)
        held = np.concatenate([2 * conditions.fixed, 2 * conditions.fixed + 1])
        self.free = np.ones(2 * self.nodes + self.pressures, bool)
        self.free[held] = False
        if not len(conditions.open):
            self.free[2 * self.nodes] = False  # one pressure
        self._open = OpenEdges(space, conditions.open)
        source = None if conditions.source is None else conditions.source(0.0)
        self._source = np.zeros((self.nodes, 2)) if source is None else source
        self._matrix = space.matrix(space.viscosity)

    def residual(self, x: Floats, viscosity: float, *, still: bool = False) -> Floats:
        """(2 N + M,) of the equations, zero where nothing is free; `still` without convection."""
        u, p = x[:2 * self.nodes].reshape(-1, 2), x[2 * self.nodes:]
        wind = np.zeros_like(u) if still else u
        force = self.space.momentum(wind, self._source, p) - viscosity * (self._matrix @ u)
        back = self._open.backflow(wind)
        if back is not None:
            np.add.at(force, self._open.nodes, back)
        return np.where(self.free, np.concatenate([-force.ravel(), -self.space.divergence(u)]), 0.0)

    def step(self, x: Floats, residual: Floats, viscosity: float, newton: bool) -> Floats:
        """The correction of an iterate."""
        blocks = self._still.copy()
        n = 2 * self.space.velocity.cells.shape[1]
        u = x[:2 * self.nodes].reshape(-1, 2)[self.space.velocity.cells]  # (C, n, 2)
        blocks[:, :n, :n] += viscosity * self._viscosity + _convection(self.space, u, newton)
        rows, columns = (np.broadcast_to(a, blocks.shape) for a in (self._unknowns[:, :, None], self._unknowns[:, None, :]))
        number = np.cumsum(self.free) - 1
        keep = self.free[rows] & self.free[columns]
        size = int(self.free.sum())
        matrix = scipy.sparse.csc_matrix((blocks[keep], (number[rows[keep]], number[columns[keep]])), (size, size))
        found = np.zeros_like(x)
        factor = scipy.sparse.linalg.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT)
        found[self.free] = factor.solve(-residual[self.free])
        return found


def _convection(space: FlowSpace, u: Floats, newton: bool) -> Floats:
    """(C, 2 n, 2 n) the derivative of (u . grad u + SKEW div u u, v); without `newton` only by the velocity that is carried."""
    values = space.values
    at = np.einsum("pi,cid->pcd", values, u)
    slopes = space.gradients  # times the weight
    along = np.einsum("pcjd,pcd->pcj", slopes, at)
    gradient = np.einsum("pcjd,cje->pced", slopes, u)  # d u_e / d x_d, times the weight
    spread = np.einsum("pcdd->pc", gradient)
    same = np.einsum("pi,pcj->cij", values, along, optimize=True)
    same += SKEW * np.einsum("pi,pj,pc->cij", values, values, spread, optimize=True)
    found = np.einsum("cij,de->cidje", same, np.eye(2))
    if newton:
        found += np.einsum("pi,pj,pced->ciejd", values, values, gradient, optimize=True)
        found += SKEW * np.einsum("pi,pcjd,pce->ciejd", values, slopes, at, optimize=True)
    cells, n = found.shape[:2]
    return found.reshape(cells, 2 * n, 2 * n)


def stationary(space: FlowSpace, conditions: Conditions, viscosity: float) -> Stationary:
    """The flow that does not change, with the velocities that are given at t = 0. Raises `NoStationaryFlow`."""
    equations = Equations(space, conditions)
    x = np.zeros(2 * equations.nodes + equations.pressures)
    x[:2 * equations.nodes].reshape(-1, 2)[conditions.fixed] = conditions.values(0.0)
    scale = float(np.linalg.norm(equations.residual(x, viscosity))) or 1.0
    x = x + equations.step(np.zeros_like(x), equations.residual(x, viscosity, still=True), viscosity, False)
    count, at, reached, trials = 1, viscosity, x, 0
    while True:
        found, used, residual = _at(equations, reached, at, scale)
        count += used
        if found is not None and at == viscosity:
            u, p = found[:2 * equations.nodes].reshape(-1, 2), found[2 * equations.nodes:]
            if not len(conditions.open):
                weights = np.bincount(space.pressure.cells.ravel(), space.mass_of_pressure().sum(axis=2).ravel(), len(p))
                p = p - weights @ p / weights.sum()
            return Stationary(u, p, count, residual)
        trials += 1
        if trials > 2 * MOST:
            raise NoStationaryFlow(f"no stationary flow: the residual is {residual:.2g} of that at the start after {count} linear solves, "
                                   f"at {at / viscosity:.3g} times the viscosity; take smaller cells, or follow it through time")
        if found is None:
            at *= EASIER
        else:
            reached, at = found, max(viscosity, at / np.sqrt(EASIER))


def _at(equations: Equations, x: Floats, viscosity: float, scale: float) -> tuple[Floats | None, int, float]:
    """The flow at one viscosity, how many solves it took, and the residual; None where it does not converge."""
    residual = equations.residual(x, viscosity)
    size, used = float(np.linalg.norm(residual)) / scale, 0
    for k in range(PICARD + NEWTON):
        if size <= TOLERANCE:
            return x, used, size
        x = x + equations.step(x, residual, viscosity, k >= PICARD or size < 1e-3)
        used += 1
        residual = equations.residual(x, viscosity)
        before, size = size, float(np.linalg.norm(residual)) / scale
        if not size < 1e6 or (k > PICARD and size > 0.9 * before and size < 100 * TOLERANCE):
            return (x, used, size) if size < 100 * TOLERANCE else (None, used, size)
    return None, used, size
