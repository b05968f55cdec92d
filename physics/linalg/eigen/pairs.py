"""What an eigenproblem is, what its lowest pairs are, and how good they are.

Held degrees of freedom are taken out, so they never show up as pairs. Residuals are |K x - lambda M x| / |lambda M x| in the Euclidean
norm of the free components; for pairs at zero lambda in the denominator is the lowest one found that is not zero, or -s, s the
shift, when there is none. Rounding x to double precision alone leaves about eps lambda_max / lambda, with lambda_max that of the
mesh (`floor`): more than 1e-8 for thin bodies on fine meshes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from slepc4py import SLEPc

Floats = NDArray[np.float64]

Known = tuple[Floats, Floats]  # eigenvalues (m,), in rising order, and vectors (m, n)

EPS = float(np.finfo(float).eps)
GOAL = 1e-8
GAP = 0.02  # relative, of one value to the next


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One eigenproblem; K and M may be spread over processes.

    stiffness, mass: of the same sparsity
    free: (n_local,) True on this process's degrees of freedom that are not held
    zeros: how many eigenvalues are expected to be zero
    scale: the order of magnitude of the lowest eigenvalue above zero
    dimension: of the body, 2 or 3
    near_null: (k, n_local) what K hardly resists, for multigrid
    graph: of three components at each of N nodes of a solid that one process has: where the nodes are (N, 3), and those of each cell (C, n)
    """

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    free: NDArray[np.bool_]
    zeros: int
    scale: float
    dimension: int
    near_null: Floats
    graph: tuple[Floats, NDArray[np.int32]] | None = None


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """The lowest pairs in rising order.

    values: (m,)
    vectors: (m, n_local) M-orthonormal, zero on held degrees of freedom
    residuals: (m,)
    zeros: how many of all eigenvalues are zero
    beyond: the next eigenvalue after the last one here; nan when it is not known
    counted: whether the number of eigenvalues below was confirmed by the inertia of a factor
    floor: what rounding leaves of the residual of the lowest pair above zero
    solver: how they were found, and why so
    """

    values: Floats
    vectors: Floats
    residuals: Floats
    zeros: int
    beyond: float
    counted: bool
    floor: float
    solver: str


def taken(solver: SLEPc.EPS, K: PETSc.Mat, count: int) -> tuple[Floats, list[PETSc.Vec]]:
    values, vectors = np.empty(count), []
    for i in range(count):
        vectors.append(K.createVecRight())
        values[i] = solver.getEigenpair(i, vectors[-1]).real
    order = np.argsort(values, kind="stable")
    return values[order], [vectors[i] for i in order]


def which_are_zero(values: Floats, noise: float, scale: float, shifted: bool) -> tuple[NDArray[np.bool_], float]:
    """(m,) which of the eigenvalues are zero but for rounding, and the lowest other one (without any: the scale)."""
    is_zero = ~(abs(values) > max(10 * noise, 1e-8 * abs(scale) if shifted else 0.0))
    others = values[~is_zero]
    return is_zero, float(others.min()) if len(others) else abs(scale)


def residuals_of(K: PETSc.Mat, M: PETSc.Mat, values: Floats, vectors: list[PETSc.Vec], scales: Floats) -> Floats:
    """(m,) |K x - lambda M x| / (scale |M x|)."""
    force, inertia = K.createVecRight(), K.createVecRight()
    residuals = np.empty(len(values))
    for i, vector in enumerate(vectors):
        K.mult(vector, force)
        M.mult(vector, inertia)
        force.axpy(-values[i], inertia)
        residuals[i] = force.norm() / (scales[i] * inertia.norm())
    return residuals


def largest(K: PETSc.Mat, M: PETSc.Mat) -> float:
    """The order of magnitude of the largest eigenvalue: that of the largest ratio of diagonal entries."""
    ratio = K.getDiagonal()
    ratio.pointwiseDivide(ratio, M.getDiagonal())
    return float(ratio.max()[1])


def clusters(values: Floats, zeros: int = 0) -> tuple[range, ...]:
    """The runs of eigenvalues (m,) that lie nearer together than GAP; the first `zeros` ones are one run."""
    starts = [i for i in range(len(values)) if i == 0 or i == zeros or (i > zeros and values[i] - values[i - 1] > GAP * values[i])]
    return tuple(range(*ends) for ends in zip(starts, [*starts[1:], len(values)], strict=True))
