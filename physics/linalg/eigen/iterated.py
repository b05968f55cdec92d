"""Lowest eigenpairs where a factor would take too much memory: LOBPCG, a block method, and Davidson's method.

Both are preconditioned with smoothed-aggregation multigrid (GAMG) that is told the near-null space. SLEPc's LOBPCG lets its search
directions become dependent long before residuals of 1e-8 (LAPACK's sygvd fails then); so it goes to 1e-4, and generalised
Davidson, which keeps its basis orthogonal, goes on from there. Held degrees of freedom stay in as unknowns of their own with an
eigenvalue above all others, which keeps the blocks of one node together.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from slepc4py import SLEPc

from physics.linalg.eigen.pairs import GOAL, Pairs, Problem, largest, residuals_of, taken, which_are_zero


def with_multigrid(problem: Problem, count: int, unknowns: int) -> Pairs:
    """The `count` lowest pairs of a problem of so many unknowns."""
    K, M = problem.stiffness.copy(), problem.mass.copy()
    # SLEPc stops at |K x - lambda M x| < tolerance lambda; with a mean diagonal entry of 1 in M that is our residual.
    diagonal = M.getDiagonal()
    unit = diagonal.sum() / diagonal.getSize()
    M.scale(1 / unit)
    noise = float(largest(K, M) * np.finfo(float).eps)
    held = (K.getOwnershipRange()[0] + np.flatnonzero(~problem.free)).astype(np.int32)
    high, low = K.getDiagonal().max()[1], M.getDiagonal().min()[1]
    K.zeroRowsColumns(held, high)
    M.zeroRowsColumns(held, low)
    shift = -problem.scale * unit if problem.zeros else 0.0
    A = K.copy()
    if shift:
        A.axpy(-shift, M, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    basis = []
    for vector in problem.near_null:
        basis.append(K.createVecRight())
        basis[-1].array[:] = np.where(problem.free, vector, 0.0)
    for i, vector in enumerate(basis):
        for other in basis[:i]:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
    A.setNearNullSpace(PETSc.NullSpace().create(vectors=basis, comm=K.comm))
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)

    wanted = min(count + 1, unknowns)
    block = wanted + max(2, wanted // 4)
    last = max(GOAL / 5, 10 * noise / (problem.scale * unit))
    ksp = PETSc.KSP().create(K.comm)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.GAMG)
    try:
        rough = _block(SLEPc.EPS.Type.LOBPCG, A, M, ksp, wanted, block, 1e-4, [])
        start, words = taken(rough, A, rough.getConverged())[1], f"LOBPCG ({rough.getIterationNumber()} iterations of {block}) and "
    except PETSc.Error:
        start, words = [], ""
    solver = _block(SLEPc.EPS.Type.GD, A, M, ksp, wanted, block, last, start)
    if solver.getConverged() < wanted:
        raise RuntimeError(f"SLEPc found {solver.getConverged()} of {wanted} pairs in {solver.getIterationNumber()} iterations")
    values, vectors = taken(solver, A, wanted)
    words += f"Davidson's method ({solver.getIterationNumber()} of 4) with algebraic multigrid"
    values = values + shift
    is_zero, reference = which_are_zero(values, noise, shift or problem.scale * unit, bool(shift))
    residuals = residuals_of(K, M, values, vectors, np.where(is_zero, reference, abs(values)))
    values = values / unit
    full = np.array([np.where(problem.free, vector.array, 0.0) for vector in vectors[:count]]) / np.sqrt(unit)
    for used in (solver, A, K, M, *vectors, *basis):
        used.destroy()
    return Pairs(values=values[:count], vectors=full, residuals=residuals[:count], zeros=int(is_zero[:count].sum()),
                 beyond=float(values[count]) if wanted > count else float("nan"), counted=False, floor=noise / reference,
                 solver=words)


def _block(kind: str, A: PETSc.Mat, M: PETSc.Mat, ksp: PETSc.KSP, wanted: int, block: int, tolerance: float,
           start: list[PETSc.Vec]) -> SLEPc.EPS:
    """At least `wanted` lowest pairs, unless it stops before, by LOBPCG or generalised Davidson with a preconditioner."""
    solver = SLEPc.EPS().create(A.comm)
    solver.setOperators(A, M)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setType(kind)
    solver.setDimensions(wanted, 4 * block)
    if kind == SLEPc.EPS.Type.GD:
        solver.setGDBlockSize(4)
    else:
        solver.setLOBPCGBlockSize(block)
        solver.setLOBPCGLocking(False)
    if start:
        solver.setInitialSpace(start)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
    solver.setTolerances(tolerance, 2000)
    solver.getST().setType(SLEPc.ST.Type.PRECOND)
    solver.getST().setKSP(ksp)
    solver.solve()
    return solver
