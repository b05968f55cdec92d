"""MUMPS's factor of a stiffness that need not be positive definite: a body under pressure may be held by the obstacle alone.

Legend: N nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from physics.linalg.cholesky import NotPositiveDefinite
from physics.linalg.stiffness import Stiffness

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class SparseFactor:
    """An L D L^T factor; `negative` counts the negative entries of D, which are as many as negative eigenvalues."""

    name = "sparse L D L^T (MUMPS)"
    worth = 8
    double = True

    def __init__(self, elasticity: Stiffness) -> None:
        self.elasticity = elasticity
        self.learned: list[Integers] = []
        self._compliance = np.empty((0, 0))
        self._pc = PETSc.PC().create(PETSc.COMM_SELF)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("mumps")
        self._vectors: tuple[PETSc.Vec, PETSc.Vec] | None = None
        self.negative = 0

    def widen(self) -> None:
        """It has them."""

    def update(self, u: Floats) -> None:
        self.learned = []
        matrix = self.elasticity.stiffness(u)
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._pc.setOperators(matrix)
        try:
            self._pc.setUp()
            failed = self._pc.getFactorMatrix().getMumpsInfog(1) < 0
        except PETSc.Error:
            failed = True
        if failed:
            raise NotPositiveDefinite("the stiffness cannot be factored")
        self.negative = int(self._pc.getFactorMatrix().getMumpsInfog(12))  # negative pivots
        self._vectors = self._vectors or matrix.createVecs()

    def solve(self, force: Floats) -> Floats:
        assert self._vectors is not None
        right, left = self._vectors
        right.array[:] = self.elasticity.space.to_dofs(np.where(self.elasticity.fixed, 0.0, force))
        self._pc.apply(right, left)
        return self.elasticity.space.from_dofs(left.array)

    def begin(self, force: Floats) -> Floats:
        return self.solve(force)

    def at(self, begun: Floats, nodes: Integers) -> Floats:
        return begun[nodes]

    def finish(self, begun: Floats, nodes: Integers | None = None, push: Floats | None = None) -> Floats:
        if nodes is None or push is None or not push.any():
            return begun
        force = np.zeros_like(begun)
        force[nodes] = push
        return begun + self.solve(force)

    def learn(self, nodes: Integers) -> None:
        self.learned = [np.union1d(nodes, np.concatenate([*self.learned, nodes]))]
        self._compliance = self._compliance_of(self.learned[0])

    def compliance(self, nodes: Integers) -> Floats:
        if not self.learned or not np.isin(nodes, self.learned[0]).all():
            self.learn(nodes)
        columns = (3 * np.searchsorted(self.learned[0], nodes)[:, None] + np.arange(3)).ravel()
        return self._compliance[np.ix_(columns, columns)]

    def _compliance_of(self, nodes: Integers) -> Floats:
        space, size = self.elasticity.space, self.elasticity.mesh.points.size
        dofs = space.dofs[nodes].ravel()
        right = np.zeros((len(dofs), size))
        right[np.arange(len(dofs)), dofs] = ~self.elasticity.fixed[nodes].ravel()
        shape = [size, len(dofs)]
        # PETSc stores dense matrices by columns: the rows of a C array are the columns of the matrix.
        b = PETSc.Mat().createDense(shape, array=right.T, comm=PETSc.COMM_SELF)
        x = PETSc.Mat().createDense(shape, comm=PETSc.COMM_SELF)
        x.setUp()
        self._pc.getFactorMatrix().matSolve(b, x)
        return x.getDenseArray().T[:, dofs]
