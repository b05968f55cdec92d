"""Cholesky factors of the tangent stiffness, kept for as many solves as they are worth.

A beam whose nodes are numbered along its axis has a stiffness of narrow band b: LAPACK's banded Cholesky then needs n b^2
operations and each solve passes twice through n b numbers, less than any general sparse method, whose ordering has to
find out what the numbering says. Where the band is wide, or the stiffness is not positive definite (a body under pressure
may be held by the obstacle alone), MUMPS takes over.

Legend: N nodes, n = 3 N unknowns, C cells.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import lapack
from scipy.sparse.csgraph import reverse_cuthill_mckee

from physics.elasticity import Elasticity

Floats = NDArray[np.float64]
WIDEST_BAND = 800  # past this the general method is faster: for beams between 15 k and 35 k nodes
LARGEST_BAND = 250_000_000  # numbers in it: 2 GB


class NotPositiveDefinite(ArithmeticError):
    """The stiffness has no Cholesky factor: the state is unstable, or not a state at all."""


class Factor(Protocol):
    """What both kinds of factors do; held components are zero in every solution."""

    name: str
    negative: int  # eigenvalues of the factored stiffness below zero

    def update(self, u: Floats) -> None:
        """Factor the stiffness at displacements (N, 3). Raises `NotPositiveDefinite` when that fails."""

    def solve(self, force: Floats) -> Floats:
        """K^-1 f for nodal forces (N, 3) [N]: displacements (N, 3) [m]."""

    def compliance(self, nodes: NDArray[np.int64]) -> Floats:
        """(3 n, 3 n) displacements of n nodes under unit forces on their components; zero for held ones."""


def factor_for(elasticity: Elasticity) -> Factor:
    """The factor that suits a body: banded when its nodes can be numbered so that the band is narrow."""
    order, band = narrowest_order(elasticity)
    narrow = band <= WIDEST_BAND and band * elasticity.mesh.points.size <= LARGEST_BAND
    return BandFactor(elasticity, order, band) if narrow else SparseFactor(elasticity)


def narrowest_order(elasticity: Elasticity) -> tuple[NDArray[np.int64], int]:
    """(N,) the place of each node in the numbering of narrowest band, and the half bandwidth b of the unknowns.

    Tried are the mesh's own numbering, along its longest extent, and reverse Cuthill-McKee's.
    """
    mesh = elasticity.mesh
    count, cells = len(mesh.points), elasticity.cells
    extent = np.ptp(mesh.points, axis=0)
    along = np.lexsort(mesh.points.round(12)[:, np.argsort(extent)].T)
    ends = mesh.edges.T
    graph = scipy.sparse.csr_matrix((np.ones(len(mesh.edges)), (ends[0], ends[1])), shape=(count, count))
    candidates = [np.arange(count), along, reverse_cuthill_mckee(graph + graph.T, symmetric_mode=True)]
    places = []
    for sequence in candidates:
        place = np.empty(count, np.int64)
        place[sequence] = np.arange(count)
        places.append(place)
    bands = [int(3 * np.ptp(place[cells], axis=1).max() + 2) for place in places]
    best = int(np.argmin(bands))
    return places[best], bands[best]


class BandFactor:
    """LAPACK's banded Cholesky factor, assembled in place."""

    name = "banded Cholesky (LAPACK)"
    negative = 0

    def __init__(self, elasticity: Elasticity, place: NDArray[np.int64], band: int) -> None:
        self.elasticity, self.band = elasticity, band
        size = elasticity.mesh.points.size
        self._unknown = 3 * place[:, None] + np.arange(3)  # (N, 3)
        row, column = elasticity.pairs(self._unknown)
        # Column after column of the lower band; what is held goes to one last place.
        slot = np.minimum(row, column) * (band + 1) + abs(row - column)
        held = np.zeros(size, bool)
        held[self._unknown[elasticity.fixed]] = True
        slot[held[row] | held[column]] = size * (band + 1)
        self._slot = np.ascontiguousarray(slot, np.int32)
        self._held = np.flatnonzero(held) * (band + 1)
        self._storage = np.empty(size * (band + 1) + 1)
        self._factor: Floats | None = None

    def update(self, u: Floats) -> None:
        self._storage[:] = 0.0
        self.elasticity.add_stiffness(u, self._slot, self._storage)
        self._storage[self._held] = 1.0
        matrix = self._storage[:-1].reshape(-1, self.band + 1).T  # (b + 1, n)
        self._factor, info = lapack.dpbtrf(matrix, lower=1, overwrite_ab=1)
        if info or not np.isfinite(self._storage).all():
            raise NotPositiveDefinite(f"the stiffness is not positive definite at unknown {info}")

    def solve(self, force: Floats) -> Floats:
        right = np.empty(force.size)
        right[self._unknown] = np.where(self.elasticity.fixed, 0.0, force)
        return lapack.dpbtrs(self._factor, right, lower=1, overwrite_b=1)[0].ravel()[self._unknown]

    def compliance(self, nodes: NDArray[np.int64]) -> Floats:
        # With K = L L^T it is Y^T Y, Y = L^-1 E, and Y is zero before the first of the unknowns.
        unknown = self._unknown[nodes].ravel()
        start = int(unknown.min())
        right = np.zeros((self._unknown.size - start, len(unknown)), order="F")
        right[unknown - start, np.arange(len(unknown))] = ~self.elasticity.fixed[nodes].ravel()
        assert self._factor is not None
        half = lapack.dtbtrs(self._factor[:, start:], right, uplo="L", overwrite_b=1)[0]
        return half.T @ half


class SparseFactor:
    """MUMPS's L D L^T factor, which also takes stiffnesses that are not positive definite."""

    name = "sparse L D L^T (MUMPS)"

    def __init__(self, elasticity: Elasticity) -> None:
        self.elasticity = elasticity
        self._pc = PETSc.PC().create(PETSc.COMM_SELF)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("mumps")
        self._vectors: tuple[PETSc.Vec, PETSc.Vec] | None = None
        self.negative = 0

    def update(self, u: Floats) -> None:
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

    def compliance(self, nodes: NDArray[np.int64]) -> Floats:
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
