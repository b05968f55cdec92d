"""The stored energy of a body, W(u) = integral of W(F(u)) over the rest body, with its first two derivatives.

    f(u) = dW/du      internal nodal forces [N]; a body is in equilibrium when they equal the outer ones
    K(u) = d2W/du2    tangent stiffness [N/m]
    M                 mass matrix [kg]

Legend: N nodes.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from physics import fem, threads
from physics.body.element import Samples, node_volumes, samples
from physics.body.kernel import SHARED, Kernel
from physics.body.material import Cells, by_region, cellwise, lame
from physics.linalg.stiffness import Stiffness
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.mesh.second import is_curved
from physics.scene import Materials
from physics.schema import InputError

Floats = NDArray[np.float64]


class Elasticity:
    """Energy, forces and stiffness of a body of one material, or of several by region; `fixed` (N, 3) marks the held components.

    Attributes:
        cells: (C, n) nodes of each cell, 32-bit
    """

    def __init__(self, mesh: Mesh, material: Materials, fixed: NDArray[np.bool_], element: str = "standard") -> None:
        """Args: element of element.py. Raises `InputError` where not every cell has one material."""
        parts = by_region(material, mesh)
        if any(own.orthotropic is not None for own, _ in parts):
            raise InputError("material.orthotropic: has modes at rest, but no law of finite strain here: give an isotropic material")
        self.mesh, self.material, self.fixed, self.element = mesh, material, fixed, element
        sampled = samples(mesh, element)
        self._parts = [(_kernel(own.law, mesh, sampled, cells), lame(own), cells) for own, cells in parts]
        self.cells = np.ascontiguousarray(mesh.cells, np.int32)
        self._energies = [np.empty(len(kernel.cells)) for kernel, _, _ in self._parts]
        self._at = np.empty(0)  # where they are
        self._matrix: Matrix | None = None

    @cached_property
    def space(self) -> fem.Space:
        """dolfinx's numbering of the same body."""
        return fem.Space(self.mesh, components=3)

    def energy(self, u: Floats) -> float:
        """Stored energy [J] at displacements (N, 3) [m]; nan where the law has none (a cell turned inside out).

        It is known where the forces were asked for last.
        """
        if not np.array_equal(u, self._at):
            Elasticity.force(self, u)
        return sum(float(energies.sum()) for energies in self._energies)

    def force(self, u: Floats) -> Floats:
        """Internal nodal forces (N, 3) [N] at displacements (N, 3) [m]."""
        found, self._at = np.zeros(u.shape), u.copy()
        for (kernel, moduli, _), energies in zip(self._parts, self._energies, strict=True):
            kernel.forces(u, moduli, found, energies)
        return found

    def stiffness(self, u: Floats) -> PETSc.Mat:
        """Tangent stiffness at displacements (N, 3) in dolfinx's order, held rows and columns those of the identity.

        The matrix is overwritten by the next call.
        """
        self._matrix = self._matrix or Matrix(self.space, self.mesh, self.fixed)
        return self._matrix.of(self, u)

    def add_stiffness(self, u: Floats, slot: NDArray[np.int32], out: NDArray[Any], *, scale: float = 1.0) -> None:
        """Add the entries of each cell's tangent stiffness to out[slot], slot (C, d (d + 1) / 2), d = 3 n, of `pairs`.

        scale: of the stiffness; all laws are linear in Lame's parameters
        """
        for kernel, (first, second), cells in self._parts:
            kernel.add_stiffness(u, (scale * first, scale * second), slot[cells], out)

    def pairs(self, unknown: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Which entries of a stiffness a cell adds to: rows and columns (C, d (d + 1) / 2), none of them twice.

        Args:
            unknown: (N, 3) the number of each component
        """
        of_cell = unknown[self.cells].reshape(len(self.cells), -1)
        first, second = np.triu_indices(of_cell.shape[1])
        return of_cell[:, first], of_cell[:, second]

    def mass(self) -> PETSc.Mat:
        """Consistent mass matrix in dolfinx's order, no component held; the caller destroys it."""
        v, w = ufl.TestFunction(self.space.V), ufl.TrialFunction(self.space.V)
        density = self.space.number(cellwise(self.material, self.mesh, lambda own: own.density * self.mesh.thickness))
        dx = ufl.dx(metadata={"quadrature_degree": self.space.degrees[1]})
        return fem.matrix(density * ufl.inner(w, v) * dx)

    def weight(self, acceleration: Floats) -> Floats:
        """(N, 3) nodal forces [N] of a uniform acceleration (3,) [m/s2]."""
        if CELLS[self.mesh.cell].middles and is_curved(self.mesh):  # shape functions that the rule of the cells cannot integrate
            mass = self.mass()
            right, left = mass.createVecs()
            right.array[:] = self.space.to_dofs(np.broadcast_to(acceleration, self.mesh.points.shape))
            mass.mult(right, left)
            mass.destroy()
            return self.space.from_dofs(left.array)
        density = cellwise(self.material, self.mesh, lambda own: own.density)
        share = np.reshape(density, (-1, 1)) * node_volumes(self.mesh)
        return np.bincount(self.cells.ravel(), share.ravel(), len(self.mesh.points))[:, None] * acceleration


def _kernel(law: str, mesh: Mesh, sampled: Samples, cells: Cells) -> Kernel:
    own = Samples(sampled.gradients[:, cells], sampled.volumes[:, cells], sampled.parts)
    return Kernel(law, mesh.cells[cells], own, sheet=mesh.sheet, threads=threads.count() if own.volumes.size >= SHARED else 1)


def small_strain_stiffness(space: fem.Space, mesh: Mesh, material: Materials, element: str) -> PETSc.Mat:
    """Stiffness by Hooke's law in a space's order, no component held; the caller destroys it. For one process."""
    matrix = Matrix(space, mesh, np.zeros(mesh.points.shape, bool))
    sampled, rest = samples(mesh, element), np.zeros(mesh.points.shape)
    for own, cells in by_region(material, mesh):
        _kernel("linear", mesh, sampled, cells).add_stiffness(rest, lame(own), matrix.slot[cells], matrix.values)
    return matrix.complete().copy()


class Matrix:
    """A sparse matrix in dolfinx's order whose entries are written from outside.

    petsc: the matrix; values: (entries + 1,) its numbers, and one more where held rows and columns go
    slot: (C, d (d + 1) / 2) where each entry of the upper half of each cell's matrix goes, below the diagonal
    lower, upper: the places of entries below the diagonal, and of their mirror images; held: of the held diagonal
    """

    def __init__(self, space: fem.Space, mesh: Mesh, fixed: NDArray[np.bool_]) -> None:
        nodes, (cells, n) = len(mesh.points), mesh.cells.shape
        block = (space.dofs[:, 0] // 3)[mesh.cells]  # (C, n)
        pairs, place = np.unique(block[:, :, None] * nodes + block[:, None, :], return_inverse=True)
        row, column = np.divmod(pairs, nodes)
        width = np.bincount(row, minlength=nodes)  # neighbours of each node, itself included
        first = np.concatenate([[0], np.cumsum(width)])
        # Entry (i, k) of the block of a pair stands in the i-th of the three rows of its node.
        at = 9 * first[row] + 3 * (np.arange(len(pairs)) - first[row])
        entry = at[:, None, None] + 3 * width[row][:, None, None] * np.arange(3)[:, None] + np.arange(3)  # (pairs, 3, 3)
        indices = np.empty(9 * len(pairs), np.int32)
        indices[entry] = 3 * column[:, None, None] + np.arange(3)
        indptr = np.concatenate([[0], np.cumsum(np.repeat(3 * width, 3))]).astype(np.int32)

        held = np.zeros(3 * nodes, bool)
        held[space.dofs[fixed]] = True
        held_row, held_column = held[3 * row[:, None, None] + np.arange(3)[:, None]], held[indices[entry]]
        self.held = entry[(row == column)[:, None, None] & np.eye(3, dtype=bool) & held_row]
        entry[held_row | held_column] = len(indices)
        mirrored = entry[np.searchsorted(pairs, column * nodes + row)].transpose(0, 2, 1)
        below = 3 * row[:, None, None] + np.arange(3)[:, None] > 3 * column[:, None, None] + np.arange(3)
        self.lower, self.upper = entry[below], mirrored[below]
        lower = np.where(below | (entry == mirrored), entry, mirrored)  # (pairs, 3, 3)
        of_cell = lower[place.reshape(cells, n, n)].transpose(0, 1, 3, 2, 4).reshape(cells, 3 * n, 3 * n)
        self.slot = np.ascontiguousarray(of_cell[:, *np.triu_indices(3 * n)], np.int32)
        self.values = np.zeros(len(indices) + 1)
        self.petsc = PETSc.Mat().createAIJWithArrays(3 * nodes, (indptr, indices, self.values[:-1]), bsize=3, comm=PETSc.COMM_SELF)

    def of(self, body: Stiffness, u: Floats) -> PETSc.Mat:
        """The tangent stiffness of a body at displacements (N, 3)."""
        self.values[:] = 0.0
        body.add_stiffness(u, self.slot, self.values)
        return self.complete()

    def complete(self) -> PETSc.Mat:
        """The matrix, once everything is added to its lower half."""
        self.values[self.upper] = self.values[self.lower]
        self.values[self.held] = 1.0
        self.petsc.assemble()
        return self.petsc
