"""The stored energy of a body, W(u) = integral of W(F(u)) over the rest body, with its first two derivatives.

    f(u) = dW/du      internal nodal forces [N]; a body is in equilibrium when they equal the outer ones
    K(u) = d2W/du2    tangent stiffness [N/m]
    M                 mass matrix [kg]

Legend: N nodes.
"""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from physics import fem
from physics.kernel import Kernel
from physics.material import LAWS, lame
from physics.mesh import Mesh
from physics.scene import Material
from physics.schema import InputError

Floats = NDArray[np.float64]


@cache
def kernels(cell: str, law: str) -> tuple[Kernel, Kernel, Kernel]:
    """Energy, forces and stiffness of a type of cell; lambda and mu are the constants."""
    domain, V = fem.symbols(cell)
    u, v, w = ufl.Coefficient(V), ufl.TestFunction(V), ufl.TrialFunction(V)
    lmbda, mu = ufl.Constant(domain), ufl.Constant(domain)
    energy = LAWS[law](ufl.Identity(3) + ufl.grad(u), lmbda, mu) * ufl.dx(metadata=fem.quadrature(cell))
    force = ufl.derivative(energy, u, v)
    nodes = len(fem.FROM_GMSH[cell])
    return Kernel(energy, nodes), Kernel(force, nodes), Kernel(ufl.derivative(force, u, w), nodes)


class Elasticity:
    """Energy, forces and stiffness of a body of one material; `fixed` (N, 3) marks the held components."""

    def __init__(self, mesh: Mesh, material: Material, fixed: NDArray[np.bool_]) -> None:
        if mesh.dimension != 3:
            raise InputError("a plane body has modes, but no finite strains here: give a solid one")
        self.mesh, self.material, self.fixed = mesh, material, fixed
        self.cells = np.ascontiguousarray(mesh.cells[:, fem.FROM_GMSH[mesh.cell]], np.int32)  # (C, n) in dolfinx's order of nodes
        self._points, self._constants = np.ascontiguousarray(mesh.points), np.array(lame(material))
        self._energy, self._force, self._stiffness = kernels(mesh.cell, material.law)
        self._matrix: _Matrix | None = None

    @cached_property
    def space(self) -> fem.Space:
        """dolfinx's numbering of the same body."""
        return fem.Space(self.mesh)

    def energy(self, u: Floats) -> float:
        """Stored energy [J] at displacements (N, 3) [m]; nan where the law has none (a cell turned inside out)."""
        return float(self._energy(self.cells, self._points, u, self._constants, np.empty(len(self.cells))).sum())

    def force(self, u: Floats) -> Floats:
        """Internal nodal forces (N, 3) [N] at displacements (N, 3) [m]."""
        return self._force(self.cells, self._points, u, self._constants, np.zeros_like(self._points))

    def stiffness(self, u: Floats) -> PETSc.Mat:
        """Tangent stiffness at displacements (N, 3) in dolfinx's order, held rows and columns those of the identity.

        The matrix is overwritten by the next call.
        """
        self._matrix = self._matrix or _Matrix(self.space, self.mesh, self.fixed)
        values = self._matrix.values
        values[:] = 0.0
        self.add_stiffness(u, self._matrix.slot, values)
        values[self._matrix.held] = 1.0
        self._matrix.petsc.assemble()
        return self._matrix.petsc

    def add_stiffness(self, u: Floats, slot: NDArray[np.int32], out: Floats) -> None:
        """Add the entries of each cell's tangent stiffness to out[slot], slot (C, (3 n)^2), nodes in the order of `cells`."""
        self._stiffness(self.cells, self._points, u, self._constants, out, slot)

    def mass(self) -> PETSc.Mat:
        """Consistent mass matrix in dolfinx's order, no component held; the caller destroys it."""
        v, w = ufl.TestFunction(self.space.V), ufl.TrialFunction(self.space.V)
        density = self.space.constant(self.material.density)
        dx = ufl.dx(metadata={"quadrature_degree": fem.MASS_DEGREE[self.mesh.cell]})
        form = fem.compile_form(density * ufl.inner(w, v) * dx)
        return fem.assemble_matrix(fem.create_matrix(form), form, [])

    def weight(self, acceleration: Floats) -> Floats:
        """(N, 3) nodal forces [N] of a uniform acceleration (3,) [m/s2]."""
        mass = self.mass()
        right, left = mass.createVecs()
        right.array[:] = self.space.to_dofs(np.broadcast_to(acceleration, self.mesh.points.shape))
        mass.mult(right, left)
        mass.destroy()
        return self.space.from_dofs(left.array)


class _Matrix:
    """A sparse matrix in dolfinx's order whose entries are written from outside.

    petsc: the matrix; values: (entries + 1,) its numbers, and one more where held rows and columns go
    slot: (C, d, d) where each entry of each cell's matrix goes; held: the places of the held diagonal
    """

    def __init__(self, space: fem.Space, mesh: Mesh, fixed: NDArray[np.bool_]) -> None:
        nodes, (cells, n) = len(mesh.points), mesh.cells.shape
        block = (space.dofs[:, 0] // 3)[mesh.cells[:, fem.FROM_GMSH[mesh.cell]]]  # (C, n)
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
        self.slot = np.ascontiguousarray(entry[place.reshape(cells, n, n)].transpose(0, 1, 3, 2, 4).reshape(cells, -1), np.int32)
        self.values = np.zeros(len(indices) + 1)
        self.petsc = PETSc.Mat().createAIJWithArrays(3 * nodes, (indptr, indices, self.values[:-1]), bsize=3, comm=PETSc.COMM_SELF)
