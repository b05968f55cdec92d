"""The stored energy of a body, W(u) = integral of W(F(u)) over the rest body, with its first two derivatives.

    f(u) = dW/du      internal nodal forces [N]; a body is in equilibrium when they equal the outer ones
    K(u) = d2W/du2    tangent stiffness [N/m]
    M                 mass matrix [kg]

Legend: N nodes.
"""

from __future__ import annotations

import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from physics import fem
from physics.material import LAWS, lame
from physics.mesh import Mesh
from physics.scene import Material

Floats = NDArray[np.float64]


class Elasticity:
    """Energy, forces and stiffness of a body of one material; `fixed` (N, 3) marks the held components."""

    def __init__(self, mesh: Mesh, material: Material, fixed: NDArray[np.bool_]) -> None:
        self.mesh, self.material, self.fixed = mesh, material, fixed
        self.space = fem.Space(mesh)
        self._u = self.space.function()
        v, w = ufl.TestFunction(self.space.V), ufl.TrialFunction(self.space.V)
        lmbda, mu = (self.space.constant(value) for value in lame(material))
        F = ufl.Identity(3) + ufl.grad(self._u)
        dx = ufl.dx(metadata={"quadrature_degree": fem.QUADRATURE_DEGREE[mesh.cell]})
        energy = LAWS[material.law](F, lmbda, mu) * dx
        force = ufl.derivative(energy, self._u, v)
        self._energy, self._force = fem.compile_form(energy), fem.compile_form(force)
        self._stiffness = fem.compile_form(ufl.derivative(force, self._u, w))
        self._conditions = fem.fix(self.space, fixed)
        self._matrix: PETSc.Mat | None = None
        self._work = np.empty(3 * len(mesh.points))

    def energy(self, u: Floats) -> float:
        """Stored energy [J] at displacements (N, 3) [m]; nan where the law has none (a cell turned inside out)."""
        self._at(u)
        return fem.assemble_scalar(self._energy)

    def force(self, u: Floats) -> Floats:
        """Internal nodal forces (N, 3) [N] at displacements (N, 3) [m]."""
        self._at(u)
        return self.space.from_dofs(fem.assemble_vector(self._force, self._work))

    def stiffness(self, u: Floats) -> PETSc.Mat:
        """Tangent stiffness at displacements (N, 3) in dolfinx's order, held rows and columns those of the identity.

        The matrix is overwritten by the next call.
        """
        self._at(u)
        if self._matrix is None:
            self._matrix = fem.create_matrix(self._stiffness)
        return fem.assemble_matrix(self._matrix, self._stiffness, self._conditions)

    def mass(self) -> PETSc.Mat:
        """Consistent mass matrix in dolfinx's order, no component held."""
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
        return self.space.from_dofs(left.array)

    def _at(self, u: Floats) -> None:
        fem.set_function(self._u, self.space.to_dofs(u))


class Factor:
    """A Cholesky factor of the tangent stiffness at one state, kept for as many solves as it is worth.

    Held components are zero in every solution.
    """

    def __init__(self, elasticity: Elasticity) -> None:
        self.elasticity = elasticity
        self._pc = PETSc.PC().create(PETSc.COMM_SELF)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("mumps")
        self._vectors: tuple[PETSc.Vec, PETSc.Vec] | None = None
        self.count = 0

    def update(self, u: Floats) -> None:
        """Factor the stiffness at displacements (N, 3). Raises `PETSc.Error` when it cannot be factored."""
        matrix = self.elasticity.stiffness(u)
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._pc.setOperators(matrix)
        self._pc.setUp()
        self._vectors = self._vectors or matrix.createVecs()
        self.count += 1

    def solve(self, force: Floats) -> Floats:
        """K^-1 f for nodal forces (N, 3) [N]: displacements (N, 3) [m]."""
        assert self._vectors is not None
        right, left = self._vectors
        right.array[:] = self.elasticity.space.to_dofs(np.where(self.elasticity.fixed, 0.0, force))
        self._pc.apply(right, left)
        return self.elasticity.space.from_dofs(left.array)

    def compliance(self, nodes: NDArray[np.int64]) -> Floats:
        """(3 n, N, 3) displacements under a unit force on each component of n nodes; zero for held components."""
        space, size = self.elasticity.space, 3 * len(self.elasticity.mesh.points)
        dofs = space.dofs[nodes].ravel()
        right = np.zeros((len(dofs), size))
        right[np.arange(len(dofs)), dofs] = ~self.elasticity.fixed[nodes].ravel()
        shape = [size, len(dofs)]
        # PETSc stores dense matrices by columns: the rows of a C array are the columns of the matrix.
        b = PETSc.Mat().createDense(shape, array=right.T, comm=PETSc.COMM_SELF)
        x = PETSc.Mat().createDense(shape, comm=PETSc.COMM_SELF)
        x.setUp()
        self._pc.getFactorMatrix().matSolve(b, x)
        return x.getDenseArray().T[:, space.dofs]
