"""Lowest eigenpairs with a factor of K - s M: pairs of (K - s M)^-1 M by a Krylov method, and a count that none is missing.

The shift s is zero when nothing is expected at zero, else a little below it, so that a body free to move has a factor too. A
Krylov sequence can step over copies of a multiple eigenvalue; so K - t M, with t in the gap above the last pair, is
factored too: by Sylvester's law of inertia its negative pivots count all eigenvalues below t, and missing ones
are looked for in the complement of the found ones.

A solid of one process gets the own factor and block Lanczos (dissected.py). All else gets MUMPS's and SLEPc's (mumps.py), also what the
own factor cannot do: a stiffness that is not positive definite, or that couples nodes without a common cell.

Where rounding leaves more than is asked for, the pairs are refined in extended precision; the residuals are then those of the refined
pairs, and the vectors that are given out are their roundings.

Legend: m pairs, n unknowns of an inverse on this process.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray
from petsc4py import PETSc

from physics.linalg.eigen.dissected import BlockLanczos, fits
from physics.linalg.eigen.mumps import KrylovSchur
from physics.linalg.eigen.pairs import EPS, GOAL, Pairs, Problem, which_are_zero

Floats = NDArray[np.float64]
Inverse = BlockLanczos | KrylovSchur

SEARCHES = 6  # for pairs that are missing


def with_factor(problem: Problem, count: int, unknowns: int) -> Pairs:
    """The `count` lowest pairs of a problem of so many unknowns."""
    if fits(problem, count + 1, unknowns):
        try:
            return _lowest(BlockLanczos(problem), problem, count, unknowns)
        except (ArithmeticError, ValueError, RuntimeError):
            pass  # MUMPS may
    inverse = KrylovSchur(problem)
    try:
        return _lowest(inverse, problem, count, unknowns)
    finally:
        inverse.destroy()


def _lowest(inverse: Inverse, problem: Problem, count: int, unknowns: int) -> Pairs:
    noise = inverse.largest * EPS
    shift = -problem.scale / 10 if problem.zeros else 0.0
    for attempt in range(3):
        try:
            values, vectors = inverse.lowest(min(count + 1, unknowns), min(count, unknowns), shift)
        except ArithmeticError:
            if shift or attempt == 2:
                raise RuntimeError(f"the stiffness of this mesh cannot be factored at a shift of {shift:.3g}") from None
            shift = -problem.scale / 10  # K is singular: a mechanism that the count of rigid motions does not see
            continue
        is_zero, reference = which_are_zero(values, noise, shift or problem.scale, bool(shift))
        if is_zero.any() and not shift:
            shift = -problem.scale / 10
        elif shift and -shift > 10 * reference:  # the scale was too high, and the shift with it
            shift = -reference / 10
        else:
            break
    for search in range(SEARCHES + 1):
        is_zero, reference = which_are_zero(values, noise, shift or problem.scale, bool(shift))
        scales = np.where(is_zero, reference, abs(values))[:count]
        residuals = inverse.residuals(values[:count], vectors[:count], scales)
        if refined := residuals.max() > GOAL / 2 and problem.stiffness.comm.size == 1:
            values[:count], residuals = _refined(problem, inverse, shift, values[:count], vectors[:count], scales)
        missing, counted = _missing(inverse, values, count, shift)
        if not missing or search == SEARCHES:
            break
        values, vectors = inverse.lowest(missing, missing, shift, (values, vectors))
    words = inverse.name + (f", shift {shift:.3g}" if shift else "") + (", refined in extended precision" if refined else "")
    full = np.zeros((count, len(problem.free)))
    full[:, inverse.kept] = vectors[:count]
    return Pairs(values=values[:count], vectors=full, residuals=residuals, zeros=int(is_zero[:count].sum()),
                 beyond=float(values[count]) if len(values) > count else float("nan"), counted=counted, floor=noise / reference,
                 solver=words)


def _missing(inverse: Inverse, values: Floats, count: int, shift: float) -> tuple[int, bool]:
    """How many pairs should be looked for, as more lie below the gap above the `count` lowest than were found; and whether that is sure."""
    if count == 1 and len(values) > 1:  # one sequence may step over copies, never over the lowest value itself
        return 0, False
    gaps = np.diff(values[count - 1:]) / np.maximum(abs(values[count:]), abs(shift))
    if not len(gaps):  # all pairs that there are
        return 0, True
    last = count - 1 + int(np.argmax(gaps))
    if gaps.max() < 1e-7:  # an eigenvalue goes on as far as was looked
        return max(1, len(values) - last - 1), False
    below = inverse.below((values[last] + values[last + 1]) / 2, (values[last + 1] - values[last]) / 2)
    return max(0, below - last - 1), below == last + 1


def _refined(problem: Problem, inverse: Inverse, shift: float, values: Floats, vectors: Floats, scales: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and residuals (m,) of the pairs in extended precision; the vectors (m, n) become the roundings of theirs.

    One inverse iteration in the form of a correction, x - (K - s M)^-1 (K x - lambda M x): only the residual in it takes more
    digits than double precision has, so the factor can stay as it is. Along the other pairs, where an inverse iteration would make
    lower ones grow, the correction is x_j (x_j . residual) / (lambda_j - lambda), taken off.
    """
    free, kept = problem.free[:, None], inverse.kept
    stiff, heavy = (_extended(matrix) for matrix in (problem.stiffness, problem.mass))
    found = np.zeros((len(problem.free), len(values)))  # (N, m) of all components
    found[kept] = vectors.T
    weighted = (heavy @ found.astype(np.longdouble)).astype(float)
    x = found.astype(np.longdouble)
    for _ in range(4):
        force, inertia = (stiff @ x) * free, (heavy @ x) * free
        _, turn = scipy.linalg.eigh((x.T @ force).astype(float), (x.T @ inertia).astype(float))  # equals are mixed as they like
        x, force, inertia = x @ turn, force @ turn, inertia @ turn
        refined = (x * force).sum(axis=0) / (x * inertia).sum(axis=0)
        residual = force - refined * inertia
        residuals = np.sqrt((residual**2).sum(axis=0) / (inertia**2).sum(axis=0)) / scales
        far = np.flatnonzero(residuals >= GOAL / 10)
        if not len(far):
            break
        right, left = residual[:, far].astype(float), np.zeros((len(x), len(far)))
        left[kept] = inverse.solve(np.ascontiguousarray(right[kept].T), shift).T
        gap = values[:, None] - refined[far].astype(float)  # (m, m')
        apart = abs(gap) > 1e-6 * scales[far]  # not along itself, nor its equals
        along = np.where(apart, (found.T @ right) / np.where(apart, gap, 1.0), 0.0)
        x[:, far] -= left + found @ (along - weighted.T @ left)
    vectors[:] = (x / np.sqrt((x * (heavy @ x)).sum(axis=0)))[kept].T
    return refined.astype(float), residuals.astype(float)


def _extended(matrix: PETSc.Mat) -> scipy.sparse.csr_matrix:
    """A matrix in extended precision, without what rounding makes of its symmetry."""
    starts, columns, entries = matrix.getValuesCSR()
    wide = scipy.sparse.csr_matrix((entries.astype(np.longdouble), columns, starts), shape=matrix.getSize())
    wide.eliminate_zeros()
    return ((wide + wide.T) / 2).tocsr()
