"""The lowest pairs of K x = lambda M x, K symmetric and at least semi-definite, M positive definite, by SLEPc.

Held degrees of freedom are taken out, so they never show up as pairs. Two ways, chosen by the number of unknowns n:

direct      Krylov-Schur on (K - s M)^-1 M with a Cholesky-like (LDL^T) factor of MUMPS. The shift s is zero when nothing is
            expected at zero, else a little below it, so that a body free to move has a factor too. A single Krylov sequence
            can step over copies of a multiple eigenvalue; so the factor of K - t M, with t in the gap above the last pair,
            is made too: by Sylvester's law of inertia its negative pivots count all eigenvalues below t, and missing ones
            are looked for in the complement of the found ones.
multigrid   LOBPCG, a block method, preconditioned with smoothed-aggregation multigrid (GAMG) that is told the near-null
            space; for n where a factor would take too much memory. SLEPc's LOBPCG lets its search directions become
            dependent long before residuals of 1e-8 (LAPACK's sygvd fails then); so it goes to 1e-4, and generalised
            Davidson, which keeps its basis orthogonal, goes on from there with the same preconditioner. Held ones stay in as
            unknowns of their own with an eigenvalue above all others, which keeps the blocks of one node together.

Residuals are |K x - lambda M x| / |lambda M x| in the Euclidean norm of the free components; for pairs at zero lambda in the
denominator is the lowest one found that is not zero, or -s when there is none. Rounding x to double precision alone leaves
about eps lambda_max / lambda, with lambda_max that of the mesh (`floor`): more than 1e-8 for thin bodies on fine meshes. There
the direct way refines the pairs in extended precision; the residuals are then those of the refined pairs, and the vectors
that are given out are their roundings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from slepc4py import SLEPc

Floats = NDArray[np.float64]
Extended = NDArray[np.longdouble]

DIRECT = {2: 1_000_000, 3: 150_000}  # unknowns up to which a factor is made, by the dimension of the body
TOLERANCE = 1e-11  # of SLEPc; the residuals as defined above are then below GOAL
GOAL = 1e-8
Inverse = tuple[PETSc.Mat, SLEPc.EPS]  # K - s M, and the solver that has its factor


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One eigenproblem; K and M may be spread over processes.

    stiffness, mass: of the same sparsity
    free: (n_local,) True on this process's degrees of freedom that are not held
    zeros: how many eigenvalues are expected to be zero
    scale: the order of magnitude of the lowest eigenvalue above zero
    dimension: of the body, 2 or 3
    near_null: (k, n_local) what K hardly resists, for multigrid
    """

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    free: NDArray[np.bool_]
    zeros: int
    scale: float
    dimension: int
    near_null: Floats


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


def lowest_pairs(problem: Problem, count: int, *, method: str | None = None) -> Pairs:
    """The `count` lowest pairs; `method` "direct" or "multigrid" overrides the choice by size.

    Raises:
        RuntimeError: fewer pairs were found than asked for, or fewer zeros than must be there
    """
    unknowns, limit = _total(problem), DIRECT[problem.dimension]
    method = method or ("direct" if unknowns <= limit else "multigrid")
    why = f"{unknowns} unknowns in {problem.dimension}-D, {'at most' if unknowns <= limit else 'more than'} {limit}"
    pairs = _direct(problem, count, unknowns) if method == "direct" else _multigrid(problem, count, unknowns)
    if pairs.zeros < min(problem.zeros, count):
        raise RuntimeError(f"{pairs.zeros} zero eigenvalues found where the supports leave {problem.zeros}: "
                           f"the lowest are {', '.join(f'{value:.3g}' for value in pairs.values[:8])}")
    return replace(pairs, solver=f"{pairs.solver} ({why})")


def _direct(problem: Problem, count: int, unknowns: int) -> Pairs:
    K, M = problem.stiffness, problem.mass
    if not problem.free.all() or K.comm.size > 1:
        first = K.getOwnershipRange()[0]
        keep = PETSc.IS().createGeneral((first + np.flatnonzero(problem.free)).astype(np.int32), comm=K.comm)
        K, M = K.createSubMatrix(keep, keep), M.createSubMatrix(keep, keep)
    wanted = min(count + 1, unknowns)
    noise = float(_largest(K, M) * np.finfo(float).eps)
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
        is_zero, reference = _zeros(values, noise, shift or problem.scale, bool(shift))
        if is_zero.any() and not shift:
            shift = -problem.scale / 10
        elif shift and -shift > 10 * reference:  # the scale was too high, and the shift with it
            shift = -reference / 10
        else:
            break
    values, vectors, beyond, counted = _completed(K, M, inverse, values, vectors, count, shift)
    is_zero, reference = _zeros(np.append(values, beyond), noise, shift or problem.scale, bool(shift))
    is_zero = is_zero[:len(values)]
    words = "Krylov-Schur, shift and invert with a factor by MUMPS" + (f", shift {shift:.3g}" if shift else "")
    scales = np.where(is_zero, reference, abs(values))
    residuals = _residuals(K, M, values, vectors, scales)
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
    values, vectors = _taken(solver, K, min(solver.getConverged(), count + 8))
    return (shifted, solver), values + shift, vectors


def _taken(solver: SLEPc.EPS, K: PETSc.Mat, count: int) -> tuple[Floats, list[PETSc.Vec]]:
    values, vectors = np.empty(count), []
    for i in range(count):
        vectors.append(K.createVecRight())
        values[i] = solver.getEigenpair(i, vectors[-1]).real
    order = np.argsort(values, kind="stable")
    return values[order], [vectors[i] for i in order]


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


def _multigrid(problem: Problem, count: int, unknowns: int) -> Pairs:
    K, M = problem.stiffness.copy(), problem.mass.copy()
    # SLEPc stops at |K x - lambda M x| < tolerance lambda; with a mean diagonal entry of 1 in M that is our residual.
    diagonal = M.getDiagonal()
    unit = diagonal.sum() / diagonal.getSize()
    M.scale(1 / unit)
    noise = float(_largest(K, M) * np.finfo(float).eps)
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
        start, words = _taken(rough, A, rough.getConverged())[1], f"LOBPCG ({rough.getIterationNumber()} iterations of {block}) and "
    except PETSc.Error:
        start, words = [], ""
    solver = _block(SLEPc.EPS.Type.GD, A, M, ksp, wanted, block, last, start)
    if solver.getConverged() < wanted:
        raise RuntimeError(f"SLEPc found {solver.getConverged()} of {wanted} pairs in {solver.getIterationNumber()} iterations")
    values, vectors = _taken(solver, A, wanted)
    words += f"Davidson's method ({solver.getIterationNumber()} of 4) with algebraic multigrid"
    values = values + shift
    is_zero, reference = _zeros(values, noise, shift or problem.scale * unit, bool(shift))
    residuals = _residuals(K, M, values, vectors, np.where(is_zero, reference, abs(values)))
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


def _zeros(values: Floats, noise: float, scale: float, shifted: bool) -> tuple[NDArray[np.bool_], float]:
    """(m,) which of the eigenvalues are zero but for rounding, and the lowest other one (without any: the scale)."""
    is_zero = ~(abs(values) > max(10 * noise, 1e-8 * abs(scale) if shifted else 0.0))
    others = values[~is_zero]
    return is_zero, float(others.min()) if len(others) else abs(scale)


def _residuals(K: PETSc.Mat, M: PETSc.Mat, values: Floats, vectors: list[PETSc.Vec], scales: Floats) -> Floats:
    """(m,) |K x - lambda M x| / (scale |M x|)."""
    force, inertia = K.createVecRight(), K.createVecRight()
    residuals = np.empty(len(values))
    for i, vector in enumerate(vectors):
        K.mult(vector, force)
        M.mult(vector, inertia)
        force.axpy(-values[i], inertia)
        residuals[i] = force.norm() / (scales[i] * inertia.norm())
    return residuals


def _largest(K: PETSc.Mat, M: PETSc.Mat) -> float:
    """The order of magnitude of the largest eigenvalue: that of the largest ratio of diagonal entries."""
    ratio = K.getDiagonal()
    ratio.pointwiseDivide(ratio, M.getDiagonal())
    return float(ratio.max()[1])


def _total(problem: Problem) -> int:
    vector = problem.stiffness.createVecRight()
    vector.array[:] = problem.free
    return round(vector.sum())


def clusters(values: Floats, zeros: int = 0, *, gap: float = 0.02) -> tuple[range, ...]:
    """The runs of eigenvalues (m,) that lie nearer together than a relative gap; the first `zeros` ones are one run."""
    starts = [i for i in range(len(values)) if i == 0 or i == zeros or (i > zeros and values[i] - values[i - 1] > gap * values[i])]
    return tuple(range(*ends) for ends in zip(starts, [*starts[1:], len(values)], strict=True))
