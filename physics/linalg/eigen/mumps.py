"""The pairs next to a shift s by SLEPc's Krylov-Schur on (K - s M)^-1 M, with a Cholesky-like (L D L^T) factor of MUMPS.

For any symmetric K, on any number of processes. Legend: m pairs, n free components of this process.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from slepc4py import SLEPc

from physics.linalg.eigen.pairs import Known, Problem, largest, residuals_of, taken

Floats = NDArray[np.float64]

TOLERANCE = 1e-11  # of SLEPc; the residuals as defined in pairs.py are then below GOAL


class KrylovSchur:
    """The pairs of a problem; held components are taken out."""

    name = "Krylov-Schur, shift and invert with a factor by MUMPS"

    def __init__(self, problem: Problem) -> None:
        K, M = problem.stiffness, problem.mass
        self.kept = problem.free
        self._own = not problem.free.all() or K.comm.size > 1
        if self._own:
            first = K.getOwnershipRange()[0]
            keep = PETSc.IS().createGeneral((first + np.flatnonzero(problem.free)).astype(np.int32), comm=K.comm)
            K, M = K.createSubMatrix(keep, keep), M.createSubMatrix(keep, keep)
        self._K, self._M = K, M
        self.largest = largest(K, M)
        self._solver: SLEPc.EPS | None = None
        self._shifted: PETSc.Mat | None = None  # K - s M
        self._at = np.nan  # of the factor that there is

    def lowest(self, wanted: int, good: int, shift: float, known: Known | None = None) -> Known:
        """At least `wanted` pairs next to the shift, and those known before.

        Raises:
            ArithmeticError: K - shift M has no factor
            RuntimeError: SLEPc found fewer
        """
        self._release()
        self._shifted = self._K.copy()
        if shift:
            self._shifted.axpy(-shift, self._M, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._solver = solver = SLEPc.EPS().create(self._K.comm)
        solver.setOperators(self._shifted, self._M)
        solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        # A small basis and no purification (M is definite, so nothing spurious gets in): half the solves of SLEPc's defaults.
        solver.setDimensions(wanted, min(self._K.getSize()[0], wanted + 8))
        solver.setPurify(False)
        solver.setTarget(0.0)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        solver.setTolerances(TOLERANCE, 1000)
        vectors = [] if known is None else [self._vector(row) for row in known[1]]
        if vectors:
            solver.setDeflationSpace(vectors)
        solver.getST().setType(SLEPc.ST.Type.SINVERT)
        ksp = solver.getST().getKSP()
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
        ksp.getPC().setFactorSolverType("mumps")
        for control in (13, 24):  # what MUMPS needs to tell an inertia: no distributed root, null pivots detected
            PETSc.Options()[f"{ksp.getOptionsPrefix() or ''}mat_mumps_icntl_{control}"] = 1
        try:
            solver.solve()
        except PETSc.Error:
            raise ArithmeticError(f"no factor at a shift of {shift:.3g}") from None
        self._at = shift
        if not shift and self._pc.getFactorMatrix().getMumpsInfog(28):  # null pivots, and MUMPS goes on to a wrong inverse
            raise ArithmeticError("the stiffness is singular")
        if solver.getConverged() < wanted:
            raise RuntimeError(f"SLEPc found {solver.getConverged()} of {wanted} pairs after {solver.getIterationNumber()} restarts")
        values, found = taken(solver, self._K, min(solver.getConverged(), wanted + 8))
        values, rows = values + shift, np.array([vector.array for vector in found])
        for vector in (*found, *vectors):
            vector.destroy()
        if known is None:
            return values, rows
        values, rows = np.concatenate([known[0], values]), np.concatenate([known[1], rows])
        order = np.argsort(values, kind="stable")
        return values[order], rows[order]

    def below(self, bound: float, distance: float) -> int:
        """How many eigenvalues lie below a bound: the negative pivots of K - bound M. MUMPS keeps its ordering."""
        self._factor(bound)
        return int(self._pc.getFactorMatrix().getInertia()[0])

    def solve(self, right: Floats, shift: float) -> Floats:
        """(K - shift M)^-1 of vectors (k, n)."""
        self._factor(shift)
        left = np.empty_like(right)
        for row, out in zip(right, left, strict=True):
            given, found = self._vector(row), self._K.createVecRight()
            self._pc.apply(given, found)
            out[:] = found.array
            for vector in (given, found):
                vector.destroy()
        return left

    def residuals(self, values: Floats, vectors: Floats, scales: Floats) -> Floats:
        """(m,) as pairs.py has them."""
        rows = [self._vector(row) for row in vectors]
        residuals = residuals_of(self._K, self._M, values, rows, scales)
        for row in rows:
            row.destroy()
        return residuals

    def destroy(self) -> None:
        """Give back what Python would not give back soon."""
        self._release()
        for matrix in (self._K, self._M) if self._own else ():
            matrix.destroy()

    @property
    def _pc(self) -> PETSc.PC:
        assert self._solver is not None
        return self._solver.getST().getKSP().getPC()

    def _factor(self, shift: float) -> None:
        assert self._shifted is not None
        if shift != self._at:
            self._shifted.axpy(self._at - shift, self._M, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            self._pc.setOperators(self._shifted)
            self._pc.setUp()
            self._at = shift

    def _release(self) -> None:
        for used in (self._solver, self._shifted):
            if used is not None:
                used.destroy()
        self._solver = self._shifted = None

    def _vector(self, values: Floats) -> PETSc.Vec:
        vector = self._K.createVecRight()
        vector.array[:] = values
        return vector
