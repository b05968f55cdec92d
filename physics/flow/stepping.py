"""A flow through time, by a splitting of second order with kept factors.

    du/dt + (u . grad) u + grad p - nu lap u = s,   div u = 0        p over the density

With the step dt, a0 = 3 / (2 dt) and phi = 0 at first, a step from t_n is (Guermond, Minev and Shen, Comput. Methods Appl. Mech. Engrg.
195, 2006, sections 3.5 and 4.2: rotational incremental pressure correction by the backward difference of order two)

    (3 u - 4 u_n + u_n-1) / (2 dt) - nu lap u + grad (p_n + 4/3 phi_n - 1/3 phi_n-1) = s - (w . grad) w,   w = 2 u_n - u_n-1
    lap phi = a0 div u
    p = p_n + phi - nu div u

so each component of the velocity and the pressure have symmetric matrices that do not change. phi would be zero at an outflow of the
strong form; here the Laplacian has the weak condition OUTLET / h phi instead, so that what the steps tend to is the flow whose
divergence is zero against every pressure, those of the outflow too. The first step is one backward Euler step, its pressure exact:
conjugate gradients on the Schur complement, with a0 lap^-1 and nu times the identity as preconditioner (Cahouet and Chabard, Int. J.
Numer. Methods Fluids 8, 1988), of which a step's correction is one iteration. When dt changes, u_n-1 is read off the parabola through
the last three velocities.

Legend: N velocity nodes, M pressure nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from physics.flow.conditions import Conditions, OpenEdges
from physics.flow.planar import Numbering, PlanarFactor
from physics.flow.space import FlowSpace

Floats = NDArray[np.float64]

OUTLET = {2: 24.0, 3: 64.0}  # of the penalty at an outflow, by order: twice the smallest that is stable
EXACT = 1e-10  # of the divergence at the start that conjugate gradients leave
MOST = 200  # iterations of conjugate gradients
KEPT = 12  # factors of different steps


@dataclass(frozen=True)
class Memory:
    """All that a step needs; `before` and `earlier` are the velocities one and two steps back, None where there was none."""

    time: float
    u: Floats  # (N, 2) [m/s]
    p: Floats  # (M,) [m2/s2], over the density
    size: float = 0.0  # [s] of the last step
    phi: Floats | None = None
    phi_before: Floats | None = None
    before: Floats | None = None
    earlier: Floats | None = None
    steps: int = 0


class Stepper:
    """The steps of one flow.

    Attributes:
        memory: where it is
        factorisations: of velocity matrices so far
        iterations: of conjugate gradients so far
    """

    def __init__(self, space: FlowSpace, conditions: Conditions, viscosity: float, start: Memory) -> None:
        """Args: viscosity nu [m2/s]; start: a time, a velocity and a pressure, or all that `memory` was."""
        self.space, self.conditions, self.viscosity, self.memory = space, conditions, viscosity, start
        self.factorisations = self.iterations = 0
        nodes, pressures = space.velocity, space.pressure
        held = np.zeros(len(nodes.points), bool)
        held[conditions.fixed] = True
        centres = nodes.points[space.mesh.cells].mean(axis=1)
        self._numbering = Numbering(centres, nodes.cells, held)
        self._open = OpenEdges(space, conditions.open)
        self.enclosed = not len(conditions.open)
        pinned = np.zeros(len(pressures.points), bool)
        pinned[0] = self.enclosed  # a pressure up to a constant
        laplacian = space.stiffness_of_pressure()
        if not self.enclosed:
            owner, local, blocks = self._open.penalty(OUTLET[space.order])
            np.add.at(laplacian, (owner[:, None, None], local[:, :, None], local[:, None, :]), blocks)
        self._laplacian = Numbering(centres, pressures.cells, pinned).factor(laplacian)
        self.pressure_mass = Numbering(centres, pressures.cells, np.zeros(len(pinned), bool)).factor(space.mass_of_pressure())
        self._weights = np.bincount(pressures.cells.ravel(), space.mass_of_pressure().sum(axis=2).ravel(), len(pinned))
        self._mass = space.matrix(space.mass)
        self._to_fixed = [_columns(matrix, conditions.fixed, held) for matrix in (self._mass, space.matrix(space.viscosity))]
        self._factors: dict[float, PlanarFactor] = {}
        self._lifted: tuple[float, Floats, Floats] | None = None

    @property
    def bytes(self) -> int:
        """Of the factors that a step passes through twice."""
        return next(iter(self._factors.values())).bytes + self._laplacian.bytes + self.pressure_mass.bytes

    def advance(self, until: float, steps: int) -> None:
        """Equal steps to a time [s]."""
        size = float(f"{(until - self.memory.time) / steps:.9g}")  # without the rounding of times: the same size has the same factor
        self._resize(size)
        for left in range(steps - 1, -1, -1):
            self._step(until - left * size, size)

    def _resize(self, size: float) -> None:
        """Give the memory the step that it would have with another size."""
        m = self.memory
        if m.before is None or m.phi is None or m.phi_before is None or abs(size - m.size) < 1e-9 * size:
            return
        r = size / m.size
        slope = m.before - m.u
        bend = 0.0 if m.earlier is None else (m.earlier - 2 * m.before + m.u) / 2
        at = [m.u + k * r * slope + (k * r - 1) * k * r * bend for k in (1, 2)]
        self.memory = replace(m, size=size, before=at[0], earlier=None if m.earlier is None else at[1], phi=r * m.phi,
                              phi_before=r * m.phi_before)

    def _step(self, time: float, size: float) -> None:
        m = self.memory
        first = m.before is None
        if m.before is None or m.phi is None or m.phi_before is None:
            a0, wind, history, guess = 1 / size, m.u, m.u / size, m.p
        else:
            a0, wind = 1.5 / size, 2 * m.u - m.before
            history = (2 * m.u - 0.5 * m.before) / size
            guess = m.p + (4 / 3) * m.phi - (1 / 3) * m.phi_before
        if self.conditions.source is not None:
            history = history + self.conditions.source(time)
        factor, given = self.factor(a0), self.conditions.values(time)
        right = self.space.momentum(wind, history, guess) - self._lift(a0, given)
        back = self._open.backflow(wind)
        if back is not None:
            np.add.at(right, self._open.nodes, back)
        u = factor.solve(right)
        u[self.conditions.fixed] = given
        if first:
            u, p = self._exact(factor, a0, u, guess)
            phi = np.zeros_like(p)
        else:
            leak = self.space.divergence(u)
            phi = self._correction(a0, leak)
            p = m.p + phi - self.viscosity * self.pressure_mass.solve(leak)
            if self.enclosed:
                p -= self._weights @ p / self._weights.sum()
        self.memory = Memory(time, u, p, size, phi, phi if m.phi is None else m.phi, m.u, m.before, m.steps + 1)

    def factor(self, a0: float) -> PlanarFactor:
        """Of a0 times the mass and the viscosity."""
        if a0 not in self._factors:
            if len(self._factors) >= KEPT:
                del self._factors[next(iter(self._factors))]
            self._factors[a0] = self._numbering.factor(a0 * self.space.mass + self.viscosity * self.space.viscosity)
            self.factorisations += 1
        return self._factors[a0]

    def _lift(self, a0: float, given: Floats) -> Floats:
        """(N, 2) what the given velocities take from the right-hand side."""
        if self._lifted is None or self._lifted[0] != a0 or not np.array_equal(self._lifted[1], given):
            mass, viscosity = self._to_fixed
            self._lifted = a0, given, a0 * (mass @ given) + self.viscosity * (viscosity @ given)
        return self._lifted[2]

    def _correction(self, a0: float, leak: Floats) -> Floats:
        return self._laplacian.solve(-a0 * leak)

    def _exact(self, factor: PlanarFactor, a0: float, u: Floats, p: Floats) -> tuple[Floats, Floats]:
        """The velocity without divergence and its pressure, from a velocity with a guessed one."""
        none = np.zeros_like(u)
        residual = -self.space.divergence(u)
        target = EXACT * np.linalg.norm(residual)
        direction, power, used = np.zeros_like(p), 1.0, self.iterations
        while np.linalg.norm(residual) > target and self.iterations < used + MOST:
            better = -self._correction(a0, residual) + self.viscosity * self.pressure_mass.solve(residual)
            if self.enclosed:
                better -= self._weights @ better / self._weights.sum()
            old, power = power, float(residual @ better)
            direction = better + (power / old if self.iterations > used else 0.0) * direction
            moved = factor.solve(self.space.momentum(none, none, direction))
            pushed = self.space.divergence(moved)
            share = power / float(direction @ pushed)
            u, p, residual = u + share * moved, p + share * direction, residual - share * pushed
            self.iterations += 1
        return u, p

    def divergence(self) -> float:
        """[1/s] root mean square of the divergence, projected on the pressures."""
        leak = self.space.divergence(self.memory.u)
        return float(np.sqrt(max(0.0, leak @ self.pressure_mass.solve(leak)) / self._weights.sum()))

    def energy(self) -> float:
        """[m4/s2] half the integral of the velocity squared."""
        return float((self.memory.u * (self._mass @ self.memory.u)).sum()) / 2


def _columns(matrix: scipy.sparse.csr_matrix, fixed: NDArray[np.int64], held: NDArray[np.bool_]) -> scipy.sparse.csr_matrix:
    """The columns of given nodes, in the rows of the others."""
    found = matrix[:, fixed].tocoo()
    keep = ~held[found.row]
    return scipy.sparse.csr_matrix((found.data[keep], (found.row[keep], found.col[keep])), found.shape)
