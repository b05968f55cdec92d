"""Newton steps of bodies too large for a factor, by conjugate gradients with algebraic multigrid, on one process or several.

With contact forces p_q = -(g_q + G_q s) / c_q of the points A in contact, a Newton step s from out-of-balance forces r solves

    (K + G_A^T diag(1/c_A) G_A) s = -r - G_A^T diag(1/c_A) g_A

and A is the set of the points where p_q > 0, found by solving again until it stays (the primal-dual active set of contact.py). Points of
contact couple nodes of one facet only, so the sum has the sparsity of K. It is assembled anew at every step, for that costs little beside
a solution; smoothed aggregation (GAMG), told the rigid motions that K hardly resists, is set up again when the iterations it needs grow.

Every process holds the whole body and all displacements; rows of the matrix and of the vectors are dealt out along the body's
longest extent, so processes share assembly and solution. Legend: N nodes, C cells, q points near the obstacle, n nodes behind them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from physics.elasticity import Elasticity

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FORCING = 1e-3  # residual of a solution over the out-of-balance force
ENOUGH = 2e-7  # residual over the reaction below which no more is asked for
EXACT = 1e-10  # residual over the right-hand side where nothing else is known
ITERATIONS = 1000
SETS = 30  # of points in contact that are tried
WORN = 1.5  # iterations over those of a new preconditioner that make it be set up again


class NotSolved(ArithmeticError):
    """Conjugate gradients came to no solution: the stiffness is not positive definite, or far too ill-conditioned."""


class Multigrid:
    """The linear algebra of a large body.

    Attributes:
        name: what it is, and why; negative: eigenvalues below zero, of which conjugate gradients bear none
        iterations: of all solutions so far; set_ups: of the preconditioner
    """

    negative = 0

    def __init__(self, elasticity: Elasticity, *, why: str, spread: bool = False) -> None:
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
        touching = ((self._place[elasticity.cells] >= self._first) & (self._place[elasticity.cells] < self._last)).any(axis=1)
        mine = replace(elasticity.mesh, cells=elasticity.mesh.cells[touching])
        self._part = Elasticity(mine, elasticity.material, elasticity.fixed, elasticity.element)
        self._lay_out()
        self._ksp = self._solver()

    def update(self, u: Floats) -> None:
        """Assemble the stiffness at displacements (N, 3)."""
        self._stiffness[:] = 0.0
        for slot in self._slots:
            self._part.add_stiffness(u, slot, self._stiffness)

    def solve(self, force: Floats) -> Floats:
        """K^-1 f for nodal forces (N, 3) [N]: displacements (N, 3) [m], zero on held components. Raises `NotSolved`."""
        empty = np.empty(0, np.int64)
        return self._solve(force, empty, np.empty((0, 0)), 0.0)

    def step(self, force: Floats, pressed: Floats, nodes: Integers, gradient: Floats, gap: Floats, softness: Floats) -> tuple[Floats, Floats]:
        """One Newton step, and the contact forces after it.

        Args:
            force: (N, 3) out of balance without contact
            pressed: (q,) contact forces of before; gap (q,) [m], its gradient (q, 3 n) by the components of n nodes, softness (q,) [m/N]

        Returns:
            (N, 3) and (q,)

        Raises:
            NotSolved: no solution, or no set of points in contact, was found
        """
        known, free = force.copy(), ~self.elasticity.fixed
        known[nodes] -= (pressed @ gradient).reshape(-1, 3)
        reaction = float(np.linalg.norm((pressed @ gradient).reshape(-1, 3).sum(axis=0)))
        target = max(FORCING * float(np.linalg.norm(known[free])), ENOUGH * reaction) if reaction else 0.0
        active = pressed > 0 if pressed.any() else gap < 0
        for _ in range(SETS):
            stiff = active / softness
            right = -force
            right[nodes] -= ((stiff * gap) @ gradient).reshape(-1, 3)
            moved = self._solve(right, nodes, gradient.T @ (stiff[:, None] * gradient), target)
            following = gap + gradient @ moved[nodes].ravel() < 0
            if (following == active).all():
                return moved, np.where(active, -(gap + gradient @ moved[nodes].ravel()) / softness, 0.0)
            active = following
        raise NotSolved(f"no set of points in contact was found in {SETS} attempts")

    def _solve(self, right: Floats, nodes: Integers, contact: Floats, target: float) -> Floats:
        """(N, 3) with the stiffness, and that of contact (3 n, 3 n) on n nodes added, to a residual [N] or to `EXACT`."""
        values = self._stiffness.copy()
        self._add(nodes, contact, values)
        values[self._held] = self._typical
        self._matrix.setValuesCSR(self._indptr, self._indices, values[:-1])
        self._matrix.assemble()
        ordered = np.empty(right.size)
        ordered[self._unknown] = np.where(self.elasticity.fixed, 0.0, right)
        left, b = self._matrix.createVecs()
        b.array[:] = ordered[3 * self._first:3 * self._last]
        if not b.norm():
            return np.zeros_like(right)
        ksp = self._ksp
        ksp.setTolerances(rtol=EXACT, atol=target, max_it=ITERATIONS)
        for worn in (self._worn, True):
            ksp.getPC().setReusePreconditioner(not worn)
            ksp.setOperators(self._matrix)
            try:
                ksp.solve(b, left)
            except PETSc.Error:
                raise NotSolved("the multigrid of the stiffness cannot be set up") from None
            self.iterations += ksp.getIterationNumber()
            if worn:
                self._fresh, self.set_ups = ksp.getIterationNumber(), self.set_ups + 1
            self._worn = ksp.getIterationNumber() > WORN * self._fresh + 5
            if ksp.getConvergedReason() > 0:
                self._matrix.comm.tompi4py().Allgatherv(left.array, (ordered, self._share))
                return ordered[self._unknown]
            if worn:
                break
        self._worn = True
        raise NotSolved(f"conjugate gradients came to no solution (reason {ksp.getConvergedReason()})")

    def _lay_out(self) -> None:
        """The sparsity of this process's rows, and where each entry of each of its cells goes; one place more is for the rest."""
        nodes, block = len(self._place), self._place[self._part.cells]  # (C, n)
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
        upper = self._part.pairs(self._unknown)
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

    def _add(self, nodes: Integers, block: Floats, values: Floats) -> None:
        """Add a matrix (3 n, 3 n) that couples n nodes of common cells to the rows of this process."""
        if not len(nodes):
            return
        place = self._place[nodes]
        mine = (place >= self._first) & (place < self._last)
        blocks = block.reshape(len(nodes), 3, len(nodes), 3).transpose(0, 2, 1, 3)
        a, b = np.nonzero(blocks.any(axis=(2, 3)) & mine[:, None])
        pair = np.searchsorted(self._pairs, place[a] * len(self._place) + place[b])
        at = self._at[pair][:, None, None] + self._width[pair][:, None, None] * np.arange(3)[:, None] + np.arange(3)
        fixed = self.elasticity.fixed[nodes]
        values[np.where(fixed[a][:, :, None] | fixed[b][:, None, :], len(values) - 1, at)] += blocks[a, b]

    def _solver(self) -> PETSc.KSP:
        size = (3 * (self._last - self._first), self._unknown.size)
        self._matrix = PETSc.Mat().create(self.comm)
        self._matrix.setSizes((size, size), bsize=3)
        self._matrix.setType("aij")
        self._matrix.setPreallocationCSR((self._indptr, self._indices))
        self._matrix.setOption(PETSc.Mat.Option.SPD, True)
        self.update(np.zeros(self.elasticity.fixed.shape))
        self._typical = float(self.elasticity.material.young_modulus) * float(np.cbrt(np.prod(np.ptp(self.elasticity.mesh.points, axis=0)) / len(self._place)))
        x = self.elasticity.mesh.points - self.elasticity.mesh.points.mean(axis=0)
        motions = [np.broadcast_to(axis, x.shape) for axis in np.eye(3)] + [np.cross(axis, x) for axis in np.eye(3)]
        basis: list[PETSc.Vec] = []
        for motion in motions:
            ordered = np.empty(motion.size)
            ordered[self._unknown] = np.where(self.elasticity.fixed, 0.0, motion)
            vector = self._matrix.createVecRight()
            vector.array[:] = ordered[3 * self._first:3 * self._last]
            for other in basis:
                vector.axpy(-vector.dot(other), other)
            if vector.normalize() > 0:
                basis.append(vector)
        self._matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=basis, comm=self.comm))
        ksp = PETSc.KSP().create(self.comm)
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.getPC().setType(PETSc.PC.Type.GAMG)
        ksp.setOperators(self._matrix)
        return ksp
