"""Lowest eigenpairs with a factor: Krylov-Schur on (K - s M)^-1 M with a Cholesky-like (L D L^T) factor of MUMPS.

The shift s is zero when nothing is expected at zero, else a little below it, so that a body free to move has a factor too. A single
Krylov sequence can step over copies of a multiple eigenvalue; so the factor of K - t M, with t in the gap above the last pair,
is made too: by Sylvester's law of inertia its negative pivots count all eigenvalues below t, and missing ones
are looked for in the complement of the found ones.

Where rounding leaves more than is asked for, the pairs are refined in extended precision; the residuals are then those of the refined
pairs, and the vectors that are given out are their roundings.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from slepc4py import SLEPc

from physics.linalg.eigen.pairs import GOAL, Pairs, Problem, largest, residuals_of, taken, which_are_zero

Floats = NDArray[np.float64]
Extended = NDArray[np.longdouble]

TOLERANCE = 1e-11  # of SLEPc; the residuals as defined in pairs.py are then below GOAL
Inverse = tuple[PETSc.Mat, SLEPc.EPS]  # K - s M, and the solver that has its factor


def with_factor(problem: Problem, count: int, unknowns: int) -> Pairs:
    """The `count` lowest pairs of a problem of so many unknowns."""
    K, M = problem.stiffness, problem.mass
    if not problem.free.all() or K.comm.size > 1:
        first = K.getOwnershipRange()[0]
        keep = PETSc.IS().createGeneral((first + np.flatnonzero(problem.free)).astype(np.int32), comm=K.comm)
        K, M = K.createSubMatrix(keep, keep), M.createSubMatrix(keep, keep)
    wanted = min(count + 1, unknowns)
    noise = float(largest(K, M) * np.finfo(float).eps)
    shift = -problem.scale / 10 if problem.zeros else 0.0
    for attempt in range(3):
        try:
            inverse, values, vectors = _shift_invert(K, M, wanted, shift, [])
        except PETSc.Error:
            if shift or attempt == 2:
                raise RuntimeError(f"the stiffness of this mesh cannot be factored at a shift of {shift:.3g}") from None
            shift = -problem.scale / 10  # K is singular: a mechanism that the count of rigid motions does not see
            continue
        if not shift and inverse[1].getST().getKSP().getPC().getFactorMatrix().getMumpsInfog(28):  # null pivots: singular too, and
            for used in reversed(inverse):  # MUMPS goes on to a wrong inverse
                used.destroy()
            shift = -problem.scale / 10
            continue
        is_zero, reference = which_are_zero(values, noise, shift or problem.scale, bool(shift))
        if is_zero.any() and not shift:
            shift = -problem.scale / 10
        elif shift and -shift > 10 * reference:  # the scale was too high, and the shift with it
            shift = -reference / 10
        else:
            break
    values, vectors, beyond, counted = _completed(K, M, inverse, values, vectors, count, shift)
    is_zero, reference = which_are_zero(np.append(values, beyond), noise, shift or problem.scale, bool(shift))
    is_zero = is_zero[:len(values)]
    words = "Krylov-Schur, shift and invert with a factor by MUMPS" + (f", shift {shift:.3g}" if shift else "")
    scales = np.where(is_zero, reference, abs(values))
    residuals = residuals_of(K, M, values, vectors, scales)
    if residuals.max() > GOAL / 2 and K.comm.size == 1:
        values, residuals = _refined(K, M, inverse, values, vectors, scales)
        words += ", refined in extended precision"
    full = np.zeros((len(values), len(problem.free)))
    full[:, problem.free] = [vector.array for vector in vectors]
    for used in (inverse[1], inverse[0], *vectors, *(() if K is problem.stiffness else (K, M))):  # nobody else gives it back soon
        used.destroy()
    return Pairs(values=values, vectors=full, residuals=residuals, zeros=int(is_zero.sum()), beyond=beyond, counted=counted,
                 floor=noise / reference, solver=words)


def _shift_invert(K: PETSc.Mat, M: PETSc.Mat, count: int, shift: float,
                  found: list[PETSc.Vec]) -> tuple[Inverse, Floats, list[PETSc.Vec]]:
    """At least `count` pairs next to the shift, in rising order, M-orthogonal to those found before."""
    shifted = K.copy()
    if shift:
        shifted.axpy(-shift, M, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    solver = SLEPc.EPS().create(K.comm)
    solver.setOperators(shifted, M)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    size = K.getSize()[0]
    # A small basis and no purification (M is definite, so nothing spurious gets in): half the solves of SLEPc's defaults.
    solver.setDimensions(count, min(size, count + 8))
    solver.setPurify(False)
    solver.setTarget(0.0)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTolerances(TOLERANCE, 1000)
    if found:
        solver.setDeflationSpace(found)
    solver.getST().setType(SLEPc.ST.Type.SINVERT)
    ksp = solver.getST().getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType("mumps")
    for control in (13, 24):  # what MUMPS needs to tell an inertia: no distributed root, null pivots detected
        PETSc.Options()[f"{ksp.getOptionsPrefix() or ''}mat_mumps_icntl_{control}"] = 1
    solver.solve()
    if solver.getConverged() < count:
        raise RuntimeError(f"SLEPc found {solver.getConverged()} of {count} pairs after {solver.getIterationNumber()} restarts")
    values, vectors = taken(solver, K, min(solver.getConverged(), count + 8))
    return (shifted, solver), values + shift, vectors


def _completed(K: PETSc.Mat, M: PETSc.Mat, inverse: Inverse, values: Floats, vectors: list[PETSc.Vec], count: int,
               shift: float) -> tuple[Floats, list[PETSc.Vec], float, bool]:
    """The `count` lowest pairs of those found, after a count of all that lie below shows that none is missing."""
    if count == 1 and len(values) > 1:  # one sequence may step over copies, never over the lowest value itself
        return values[:1], vectors[:1], float(values[1]), False
    for _ in range(6):
        gaps = np.diff(values[count - 1:]) / np.maximum(abs(values[count:]), abs(shift))
        if not len(gaps):  # all pairs that there are
            return values, vectors, float("nan"), True
        last = count - 1 + int(np.argmax(gaps))
        between = (values[last] + values[last + 1]) / 2
        if gaps.max() < 1e-7:  # an eigenvalue goes on as far as was looked
            below = len(values)
        else:
            below = _count_below(M, inverse, between - shift)
        if below <= last + 1 and gaps.max() >= 1e-7:
            return values[:count], vectors[:count], float(values[count]), below == last + 1
        missing = max(1, below - last - 1)
        another, more, others = _shift_invert(K, M, missing, shift, vectors)
        for used in reversed(another):
            used.destroy()
        every, both = np.concatenate([values, more]), vectors + others
        order = np.argsort(every, kind="stable")
        values, vectors = every[order], [both[i] for i in order]
    return values[:count], vectors[:count], float(values[count]), False


def _count_below(M: PETSc.Mat, inverse: Inverse, bound: float) -> int:
    """How many eigenvalues of A x = lambda M x lie below a bound: the negative pivots of A - bound M.

    A is changed and changed back, so that MUMPS keeps its ordering.
    """
    A, pc = inverse[0], inverse[1].getST().getKSP().getPC()
    A.axpy(-bound, M, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    pc.setOperators(A)
    pc.setUp()
    negative = int(pc.getFactorMatrix().getInertia()[0])
    A.axpy(bound, M, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    return negative


def _refined(K: PETSc.Mat, M: PETSc.Mat, inverse: Inverse, values: Floats, vectors: list[PETSc.Vec],
             scales: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and residuals (m,) of the pairs in extended precision; the vectors become the roundings of theirs.

    One inverse iteration in the form of a correction, x - (K - s M)^-1 (K x - lambda M x): only the residual in it takes more
    digits than double precision has, so the factor can stay as it is. Along the other pairs, where an inverse iteration would make
    lower ones grow, the correction is x_j (x_j . residual) / (lambda_j - lambda), taken off.
    """
    A, pc = inverse[0], inverse[1].getST().getKSP().getPC()
    pc.setOperators(A)
    pc.setUp()
    stiff, heavy = (_extended(matrix) for matrix in (K, M))
    found = np.array([vector.array for vector in vectors])
    weighted = np.array([heavy(row.astype(np.longdouble)) for row in found], float)
    right, left = K.createVecs()
    refined, residuals = values.copy(), np.empty(len(values))
    for i, vector in enumerate(vectors):
        x = vector.array.astype(np.longdouble)
        for _ in range(4):
            force, inertia = stiff(x), heavy(x)
            refined[i] = value = (x @ force) / (x @ inertia)
            residual = force - value * inertia
            residuals[i] = np.sqrt(residual @ residual) / (scales[i] * np.sqrt(inertia @ inertia))
            if residuals[i] < GOAL / 10:
                break
            right.array[:] = residual
            pc.apply(right, left)
            gap = values - float(value)
            apart = abs(gap) > 1e-6 * scales[i]  # not along itself, nor its equals
            along = np.where(apart, (found @ right.array) / np.where(apart, gap, 1.0), 0.0)
            x = x - (left.array + (along - weighted @ left.array) @ found)
        vector.array[:] = x / np.sqrt(x @ heavy(x))
    return refined, residuals


def _extended(matrix: PETSc.Mat) -> Callable[[Extended], Extended]:
    """Multiplication with a matrix in extended precision."""
    starts, columns, entries = matrix.getValuesCSR()
    wide = entries.astype(np.longdouble)
    return lambda x: np.add.reduceat(wide * x[columns], starts[:-1])
