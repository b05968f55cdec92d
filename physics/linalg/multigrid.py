"""Newton steps of bodies too large for a factor, by conjugate gradients with algebraic multigrid, on one process or several.

With contact forces p_q = -(g_q + G_q s) / c_q of the points A in contact, a Newton step s from out-of-balance forces r solves

    (K + G_A^T diag(1/c_A) G_A) s = -r - G_A^T diag(1/c_A) g_A

and A is the set of the points where p_q > 0, found by solving again until it stays (a primal-dual active set, as in
contact/conditions.py). Points of contact couple nodes of one facet only, so the sum has the sparsity of K. It is assembled anew at
every step, for that costs little beside a solution. The preconditioner is smoothed aggregation (GAMG) for K alone, told the rigid
motions that K hardly resists and set up again when the iterations it needs grow, between exact solutions at the nodes in contact.

Every process holds the whole body and all displacements; rows of the matrices and of the vectors are dealt out (rows.py), so
processes share the solution. Legend: N nodes, q points near the obstacle, n nodes behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from physics.linalg.rows import MatrixRows
from physics.linalg.stiffness import Stiffness

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FORCING = 1e-3  # residual of a solution over the out-of-balance force
ENOUGH = 0.2  # and over what is allowed in the end; the larger of the two is gone to
EXACT = 1e-10  # residual over the right-hand side, below which none is asked for
ITERATIONS = 1000
SETS = 30  # of points in contact that are tried
WORN = 1.5  # iterations over those of a new preconditioner that make it be set up again


class NotSolved(ArithmeticError):
    """Conjugate gradients came to no solution: the stiffness is not positive definite, or far too ill-conditioned."""


@dataclass
class Felt:
    """Contact as q points near the obstacle feel it: n nodes (n,) behind them, the gap's gradient (q, 3 n) and what a round obstacle takes
    from the stiffness, B^T B with B (b, 3 n), by their components; gaps (q,) [m], softness (q,) [m/N] and forces (q,) [N]; of several
    obstacles the sum of the reactions' sizes [N], for the reactions themselves may cancel."""

    nodes: Integers
    gradient: Floats
    bend: Floats
    gap: Floats
    softness: Floats
    pressed: Floats
    reaction: float | None = None


class Multigrid:
    """The linear algebra of a large body.

    Attributes:
        name: what it is, and why
        iterations: of all solutions so far; set_ups: of the preconditioner
    """

    def __init__(self, elasticity: Stiffness, *, why: str, spread: bool = False) -> None:
        """Args: why this and no factor, in words; spread: over all processes of an MPI run."""
        self.elasticity, self.comm = elasticity, MPI.COMM_WORLD if spread else MPI.COMM_SELF
        self.name = f"none: conjugate gradients with algebraic multigrid{f' on {self.comm.size} processes' * (self.comm.size > 1)}, {why}"
        self.iterations, self.set_ups, self._fresh, self._worn = 0, 0, 0, True
        self._rows = MatrixRows(elasticity, self.comm)
        self._stiffness = np.zeros(len(self._rows.indices) + 1)
        self._set_matrices()

    def update(self, u: Floats) -> None:
        """Assemble the stiffness at displacements (N, 3)."""
        self._stiffness = self._rows.stiffness(u)

    def solve(self, force: Floats) -> Floats:
        """K^-1 f for nodal forces (N, 3) [N]: displacements (N, 3) [m], zero on held components. Raises `NotSolved`."""
        return self._solve(force, np.empty(0, np.int64), np.empty((0, 0)), 0.0)

    def step(self, force: Floats, tolerance: float, felt: Felt | None = None) -> Floats:
        """One Newton step (N, 3) from forces (N, 3) that are out of balance without contact; contact forces after it go into `felt`.

        Args:
            tolerance: of the out-of-balance force, over the reaction, that is allowed in the end

        Raises:
            NotSolved: no solution, or no set of points in contact, was found
        """
        free = ~self.elasticity.fixed
        if felt is None or not len(felt.gap):
            return self._solve(-force, np.empty(0, np.int64), np.empty((0, 0)), FORCING * float(np.linalg.norm(force[free])))
        nodes, pressed = felt.nodes, felt.pressed
        push = (pressed @ felt.gradient).reshape(-1, 3)
        known, reaction = force.copy(), float(np.linalg.norm(push.sum(axis=0))) if felt.reaction is None else felt.reaction
        known[nodes] -= push
        target = max(FORCING * float(np.linalg.norm(known[free])), ENOUGH * tolerance * reaction) if reaction else 0.0
        active = pressed > 0 if reaction else felt.gap < 0
        for _ in range(SETS):
            stiff = active / felt.softness
            right = -force
            right[nodes] -= ((stiff * felt.gap) @ felt.gradient).reshape(-1, 3)
            block = felt.gradient.T @ (stiff[:, None] * felt.gradient) - felt.bend.T @ felt.bend
            moved = self._solve(right, nodes, block, target)
            gap = felt.gap + felt.gradient @ moved[nodes].ravel()
            if ((gap < 0) == active).all():
                felt.pressed = np.where(active, -gap / felt.softness, 0.0)
                return moved
            active = gap < 0
        raise NotSolved(f"no set of points in contact was found in {SETS} attempts")

    def _solve(self, right: Floats, nodes: Integers, contact: Floats, target: float) -> Floats:
        """(N, 3) with the stiffness, and that of contact (3 n, 3 n) on n nodes added, to a residual [N] or to `EXACT`."""
        rows, values = self._rows, self._stiffness.copy()
        rows.add(nodes, contact, values)
        self._fill(self._matrix, values)
        self._preconditioner.press(rows.unknown[nodes].ravel(), rows.dense(nodes, values))
        b = self._matrix.createVecRight()
        b.array[:] = rows.mine(right)
        target = max(target, EXACT * b.norm())
        for worn in dict.fromkeys((self._worn, True)):
            if worn:
                self._set_up()
            taken, left = self._conjugate_gradients(b, target)
            self.iterations += taken
            if worn:
                self._fresh = taken
            self._worn = left is None or taken > WORN * self._fresh + 5
            if left is not None:
                return rows.whole(left.array)
        raise NotSolved(f"conjugate gradients came to no solution in {taken} iterations")

    def _conjugate_gradients(self, right: PETSc.Vec, target: float) -> tuple[int, PETSc.Vec | None]:
        """How many iterations were taken, and the solution to a residual [N]; None when there is none after all of them.

        Raises:
            NotSolved: the matrix, or its preconditioner, is not positive definite
        """
        solution, residual = right.duplicate(), right.copy()
        solution.set(0.0)
        better, image = right.duplicate(), right.duplicate()
        self._preconditioner.apply(residual, better)
        direction, product = better.copy(), residual.dot(better)
        for iteration in range(ITERATIONS + 1):
            if residual.norm() <= target:
                return iteration, solution
            self._matrix.mult(direction, image)
            curvature = direction.dot(image)
            if not (curvature > 0 and product > 0):
                raise NotSolved("the stiffness is not positive definite: the body gives way, or its mesh is far too distorted")
            solution.axpy(product / curvature, direction)
            residual.axpy(-product / curvature, image)
            self._preconditioner.apply(residual, better)
            before, product = product, residual.dot(better)
            direction.aypx(product / before, better)
        return ITERATIONS, None

    def _fill(self, matrix: PETSc.Mat, values: Floats) -> None:
        values[self._rows.held] = self._typical
        matrix.setValuesCSR(self._rows.indptr, self._rows.indices, values[:-1])
        matrix.assemble()

    def _set_up(self) -> None:
        """The multigrid of the stiffness as it is now, without contact."""
        self._fill(self._alone, self._stiffness.copy())
        self._multigrid.setOperators(self._alone)
        try:
            self._multigrid.setUp()
        except PETSc.Error:
            raise NotSolved("the multigrid of the stiffness cannot be set up") from None
        self.set_ups += 1

    def _set_matrices(self) -> None:
        """The matrices of the stiffness with contact and without, and the multigrid for the latter."""
        rows = self._rows
        size = (3 * (rows.last - rows.first), rows.unknown.size)
        matrices = []
        for _ in range(2):
            matrices.append(PETSc.Mat().create(self.comm))
            matrices[-1].setSizes((size, size), bsize=3)
            matrices[-1].setType("aij")
            matrices[-1].setPreallocationCSR((rows.indptr, rows.indices))
            matrices[-1].setOption(PETSc.Mat.Option.SPD, True)
        self._matrix, self._alone = matrices
        mesh = self.elasticity.mesh
        x = mesh.points - mesh.points.mean(axis=0)
        given = self.elasticity.material
        stiffest = max(own.young_modulus for own in (given if isinstance(given, tuple) else (given,)))
        # Of the order of the other diagonal entries: E times the size of a cell.
        self._typical = stiffest * float((np.prod(mesh.extent) / len(x)) ** (1 / mesh.dimension))
        basis: list[PETSc.Vec] = []
        for motion in [np.broadcast_to(axis, x.shape) for axis in np.eye(3)] + [np.cross(axis, x) for axis in np.eye(3)]:
            vector = self._matrix.createVecRight()
            vector.array[:] = rows.mine(motion)
            for other in basis:
                vector.axpy(-vector.dot(other), other)
            if vector.normalize() > 0:
                basis.append(vector)
        self._alone.setNearNullSpace(PETSc.NullSpace().create(vectors=basis, comm=self.comm))
        self._multigrid = PETSc.PC().create(self.comm)
        self._multigrid.setType(PETSc.PC.Type.GAMG)
        self._multigrid.setFromOptions()  # without which its defaults are not set
        self._preconditioner = _WithContact(self._matrix, self._multigrid, self.comm, rows.first)


class _WithContact:
    """The multigrid M of the body alone between two exact solutions at the nodes in contact, so that their stiffness, which is
    thousands of times that of the body, leaves no error: B = P + (1 - P A) M (1 - A P), P = A_cc^-1 at these nodes."""

    def __init__(self, matrix: PETSc.Mat, multigrid: PETSc.PC, comm: MPI.Comm, first: int) -> None:
        self._matrix, self._multigrid, self._comm, self._first = matrix, multigrid, comm, first
        self._residual, self._correction = matrix.createVecs()

    def press(self, unknowns: Integers, block: Floats) -> None:
        """The rows and columns (k, k) of k unknowns in contact. Raises `NotSolved` when they are not positive definite."""
        size, first = self._residual.getLocalSize(), 3 * self._first
        self._mine = np.flatnonzero((unknowns >= first) & (unknowns < first + size))
        self._local, self._count = unknowns[self._mine] - first, len(unknowns)
        try:
            self._factor = scipy.linalg.cho_factor(block) if len(block) else None
        except np.linalg.LinAlgError:
            raise NotSolved("the stiffness at the nodes in contact is not positive definite") from None

    def apply(self, right: PETSc.Vec, out: PETSc.Vec) -> None:
        """out = B right."""
        if self._factor is None:
            self._multigrid.apply(right, out)
            return
        out.set(0.0)
        self._solve_contact(right, out)
        self._matrix.mult(out, self._residual)
        self._residual.aypx(-1.0, right)
        self._multigrid.apply(self._residual, self._correction)
        out.axpy(1.0, self._correction)
        self._matrix.mult(out, self._residual)
        self._residual.aypx(-1.0, right)
        self._solve_contact(self._residual, out)

    def _solve_contact(self, right: PETSc.Vec, out: PETSc.Vec) -> None:
        """out += P right."""
        at_contact = np.zeros(self._count)
        at_contact[self._mine] = right.array_r[self._local]
        self._comm.Allreduce(MPI.IN_PLACE, at_contact)
        out.array[self._local] += scipy.linalg.cho_solve(self._factor, at_contact)[self._mine]
