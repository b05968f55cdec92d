"""A body with a lumped mass, or any other share of its nodes, added to its stiffness: what a step of time makes of it.

    K'(u) = s K(u) + c diag(m)        s, c: of the step; m_a = sum over cells of the cell's share for its node a

A step through time has the masses for m (motion/dynamics.py), one through a viscous medium the volumes (equilibrium/snap.py).
Legend: N nodes, C cells of n nodes.

The mass of a node is the sum of its row of the consistent mass matrix. In a tetrahedron of second order that is below zero at corners, and
zero in a triangle, so there each node has its share of the diagonal (Hinton, Rock and Zienkiewicz, Earthquake Engng Struct. Dyn. 4, 1976,
245): of the mass of a tetrahedron 1/36 at a corner and 4/27 in a middle, of that of a triangle 1/19 and 16/57.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from physics import fem
from physics.body.elasticity import Elasticity, Matrix
from physics.body.material import cellwise
from physics.mesh.quality import cell_volumes

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DIAGONAL = {"tetrahedron10": np.repeat([1 / 36, 4 / 27], [4, 6]), "triangle6": np.repeat([1 / 19, 16 / 57], 3)}


def node_masses(body: Elasticity) -> Floats:
    """(N, 1) [kg] lumped masses of a body, which add up to its mass."""
    mesh = body.mesh
    if mesh.cell not in DIAGONAL:
        return body.weight(np.ones(3))[:, :1]
    volume = cell_volumes(mesh.points, mesh.cells, mesh.cell) * (mesh.thickness if mesh.dimension == 2 else 1.0)
    share = (volume * cellwise(body.material, mesh, lambda own: own.density))[:, None] * DIAGONAL[mesh.cell]
    return np.bincount(mesh.cells.ravel(), share.ravel(), len(mesh.points)).astype(np.float64)[:, None]


class Lumped:
    """The same body, its stiffness scaled by `scale` and the shares (C, n) times `added` put on the diagonal."""

    def __init__(self, body: Elasticity, share: Floats, *, scale: float = 1.0) -> None:
        self.body, self.share, self.scale, self.added = body, share, scale, 0.0
        self.mesh, self.material, self.fixed, self.cells = body.mesh, body.material, body.fixed, body.cells
        first, second = np.triu_indices(3 * self.cells.shape[1])
        self._diagonal = np.flatnonzero(first == second)  # among the pairs of unknowns of a cell
        self._matrix: Matrix | None = None

    @property
    def space(self) -> fem.Space:
        return self.body.space

    def energy(self, u: Floats) -> float:
        """Stored energy [J] of the body at displacements (N, 3) [m]."""
        return self.body.energy(u)

    def force(self, u: Floats) -> Floats:
        """Internal nodal forces (N, 3) [N] of the body at displacements (N, 3) [m]."""
        return self.body.force(u)

    def pairs(self, unknown: Integers) -> tuple[Integers, Integers]:
        return self.body.pairs(unknown)

    def add_stiffness(self, u: Floats, slot: NDArray[np.int32], out: NDArray[Any]) -> None:
        self.body.add_stiffness(u, slot, out, scale=self.scale)
        np.add.at(out, slot[:, self._diagonal], self.added * np.repeat(self.share, 3, axis=1))

    def stiffness(self, u: Floats) -> PETSc.Mat:
        self._matrix = self._matrix or Matrix(self.space, self.mesh, self.fixed)
        return self._matrix.of(self, u)
