"""Newton steps of bodies too large for a factor, by conjugate gradients with algebraic multigrid, on one process or several.

With contact forces p_q = -(g_q + G_q s) / c_q of the points A in contact, a Newton step s from out-of-balance forces r solves

    (K + G_A^T diag(1/c_A) G_A) s = -r - G_A^T diag(1/c_A) g_A

and A is the set of the points where p_q > 0, found by solving again until it stays (the primal-dual active set of contact.py). Points of
contact couple nodes of one facet only, so the sum has the sparsity of K. It is assembled anew at every step, for that costs little beside
a solution. The preconditioner is smoothed aggregation (GAMG) for K alone, told the rigid motions that K hardly resists and set up again
when the iterations it needs grow, between exact solutions at the nodes in contact.

Every process holds the whole body and all displacements; rows of the matrices and of the vectors are dealt out along the body's
longest extent, so processes share the solution. Legend: N nodes, C cells, q points near the obstacle, n nodes behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

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
    from the stiffness, B^T B with B (b, 3 n), by their components; gaps (q,) [m], softness (q,) [m/N] and forces (q,) [N]."""

    nodes: Integers
    gradient: Floats
    bend: Floats
    gap: Floats
    softness: Floats
    pressed: Floats


class Multigrid:
    """The linear algebra of a large body.

    Attributes:
        name: what it is, and why; negative: eigenvalues below zero, of which conjugate gradients bear none
        worth, learned: as of a factor; there is nothing to keep
        iterations: of all solutions so far; set_ups: of the preconditioner
    """

    negative = 0
    worth = 0
    learned: tuple[Integers, ...] = ()

    def __init__(self, elasticity: Stiffness, *, why: str, spread: bool = False) -> None:
        """Args: why this and no factor, in words; spread: over all processes of an MPI run."""
        self.elasticity, self.comm = elasticity, MPI.COMM_WORLD if spread else MPI.COMM_SELF
        self.name = f"none: conjugate gradients with algebraic multigrid{f' on {self.comm.size} processes' * (self.comm.size > 1)}, {why}"
        self.iterations, self.set_ups, self._fresh, self._worn = 0, 0, 0, True
        points = elasticity.mesh.points
        self._place = np.empty(len(points), np.int64)
        self._place[np.lexsort(points.round(12)[:, np.argsort(np.ptp(points, axis=0))].T)] = np.arange(len(points))
        self._unknown = 3 * self._place[:, None] + np.arange(3)  # (N, 3)
        ends = np.arange(self.comm.size + 1) * len(points) // self.comm.size
        self._first, self._last = (int(end) for end in ends[self.comm.rank:self.comm.rank + 2])
        self._share = 3 * np.diff(ends)
        self._lay_out()
        self._set_matrices()

    def update(self, u: Floats) -> None:
        """Assemble the stiffness at displacements (N, 3)."""
        self._stiffness[:] = 0.0
        for slot in self._slots:
            self.elasticity.add_stiffness(u, slot, self._stiffness)

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
        known, reaction = force.copy(), float(np.linalg.norm(push.sum(axis=0)))
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
        values = self._stiffness.copy()
        self._add(nodes, contact, values)
        values[self._held] = self._typical
        self._matrix.setValuesCSR(self._indptr, self._indices, values[:-1])
        self._matrix.assemble()
        self._preconditioner.press(self._unknown[nodes].ravel(), self._dense(nodes, values))
        ordered = np.empty(right.size)
        ordered[self._unknown] = np.where(self.elasticity.fixed, 0.0, right)
        b = self._matrix.createVecRight()
        b.array[:] = ordered[3 * self._first:3 * self._last]
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
                self.comm.Allgatherv(left.array, (ordered, self._share))
                return ordered[self._unknown]
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

    def _set_up(self) -> None:
        """The multigrid of the stiffness as it is now, without contact."""
        values = self._stiffness.copy()
        values[self._held] = self._typical
        self._alone.setValuesCSR(self._indptr, self._indices, values[:-1])
        self._alone.assemble()
        self._multigrid.setOperators(self._alone)
        try:
            self._multigrid.setUp()
        except PETSc.Error:
            raise NotSolved("the multigrid of the stiffness cannot be set up") from None
        self.set_ups += 1

    def _lay_out(self) -> None:
        """The sparsity of this process's rows, and where each entry of each of its cells goes; one place more is for the rest."""
        nodes, block = len(self._place), self._place[self.elasticity.cells]  # (C, n)
        own = np.repeat(((block >= self._first) & (block < self._last))[:, :, None], block.shape[1], axis=2)
        key = block[:, :, None] * nodes + block[:, None, :]
        self._pairs, inverse = np.unique(key[own], return_inverse=True)
        row, column = np.divmod(self._pairs, nodes)
        row -= self._first
        width = np.bincount(row, minlength=self._last - self._first)
        first = np.concatenate([[0], np.cumsum(width)])
        # Entry (i, k) of the block of a pair stands in the i-th of the three rows of its node.
        self._at, self._width = 9 * first[row] + 3 * (np.arange(len(row)) - first[row]), 3 * width[row]
        entry = self._at[:, None, None] + self._width[:, None, None] * np.arange(3)[:, None] + np.arange(3)
        self._indices = np.empty(9 * len(row), np.int32)
        self._indices[entry] = 3 * column[:, None, None] + np.arange(3)
        self._indptr = np.concatenate([[0], np.cumsum(np.repeat(3 * width, 3))]).astype(np.int32)
        self._stiffness = np.zeros(len(self._indices) + 1)
        held = np.zeros(3 * nodes, bool)
        held[self._unknown[self.elasticity.fixed]] = True
        mine = np.flatnonzero(held[3 * self._first:3 * self._last])
        diagonal = np.searchsorted(self._pairs, (mine // 3 + self._first) * (nodes + 1))
        self._held = self._at[diagonal] + (self._width[diagonal] + 1) * (mine % 3)
        pair = np.full(own.shape, -1)
        pair[own] = inverse.ravel()
        upper = self.elasticity.pairs(self._unknown)
        self._slots = []
        # The upper half of each cell's matrix is added twice, once to the entry and once to its mirror image.
        for mirror in (False, True):
            slot = np.full(upper[0].shape, len(self._indices), np.int32)
            for j, (p, q) in enumerate(zip(*np.triu_indices(3 * block.shape[1]), strict=True)):
                (a, i), (b, k) = (divmod(q, 3), divmod(p, 3)) if mirror else (divmod(p, 3), divmod(q, 3))
                used = (pair[:, a, b] >= 0) & ~held[upper[0][:, j]] & ~held[upper[1][:, j]]
                if not (mirror and p == q):
                    at = pair[used, a, b]
                    slot[used, j] = self._at[at] + self._width[at] * i + k
            self._slots.append(slot)

    def _blocks(self, nodes: Integers) -> tuple[Integers, Integers, Integers]:
        """Which pairs (k,), (k,) of n nodes have entries in this process's rows, and where these are (k, 3, 3)."""
        place = self._place[nodes]
        rows = np.flatnonzero((place >= self._first) & (place < self._last))
        key = place[rows][:, None] * len(self._place) + place
        pair = np.minimum(np.searchsorted(self._pairs, key), len(self._pairs) - 1)
        a, b = np.nonzero(self._pairs[pair] == key)
        pair = pair[a, b]
        return rows[a], b, self._at[pair][:, None, None] + self._width[pair][:, None, None] * np.arange(3)[:, None] + np.arange(3)

    def _add(self, nodes: Integers, block: Floats, values: Floats) -> None:
        """Add a matrix (3 n, 3 n) that couples n nodes of common cells to the rows of this process."""
        a, b, at = self._blocks(nodes)
        fixed = self.elasticity.fixed[nodes]
        at[fixed[a][:, :, None] | fixed[b][:, None, :]] = len(values) - 1
        values[at] += block.reshape(len(nodes), 3, len(nodes), 3)[a, :, b]

    def _dense(self, nodes: Integers, values: Floats) -> Floats:
        """(3 n, 3 n) the rows and columns of n nodes."""
        dense = np.zeros((len(nodes), 3, len(nodes), 3))
        a, b, at = self._blocks(nodes)
        dense[a, :, b] = values[at]
        self.comm.Allreduce(MPI.IN_PLACE, dense)
        return dense.reshape(3 * len(nodes), 3 * len(nodes))

    def _set_matrices(self) -> None:
        """The matrices of the stiffness with contact and without, and the multigrid for the latter."""
        size = (3 * (self._last - self._first), self._unknown.size)
        matrices = []
        for _ in range(2):
            matrices.append(PETSc.Mat().create(self.comm))
            matrices[-1].setSizes((size, size), bsize=3)
            matrices[-1].setType("aij")
            matrices[-1].setPreallocationCSR((self._indptr, self._indices))
            matrices[-1].setOption(PETSc.Mat.Option.SPD, True)
        self._matrix, self._alone = matrices
        x = self.elasticity.mesh.points - self.elasticity.mesh.points.mean(axis=0)
        # Of the order of the other diagonal entries: E times the size of a cell.
        self._typical = self.elasticity.material.young_modulus * float(np.cbrt(np.prod(np.ptp(x, axis=0)) / len(x)))
        basis: list[PETSc.Vec] = []
        for motion in [np.broadcast_to(axis, x.shape) for axis in np.eye(3)] + [np.cross(axis, x) for axis in np.eye(3)]:
            ordered = np.empty(motion.size)
            ordered[self._unknown] = np.where(self.elasticity.fixed, 0.0, motion)
            vector = self._matrix.createVecRight()
            vector.array[:] = ordered[3 * self._first:3 * self._last]
            for other in basis:
                vector.axpy(-vector.dot(other), other)
            if vector.normalize() > 0:
                basis.append(vector)
        self._alone.setNearNullSpace(PETSc.NullSpace().create(vectors=basis, comm=self.comm))
        self._multigrid = PETSc.PC().create(self.comm)
        self._multigrid.setType(PETSc.PC.Type.GAMG)
        self._multigrid.setFromOptions()  # without which its defaults are not set
        self._preconditioner = _WithContact(self._matrix, self._multigrid, self.comm, self._first)


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
