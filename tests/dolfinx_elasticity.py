"""Energy, forces and stiffness of a body assembled by dolfinx, cell by cell: what our own loops over cells are held against."""

import logging

import numpy as np
import pytest
import ufl
from dolfinx import fem as dolfinx_fem
from dolfinx.fem import petsc as dolfinx_petsc
from petsc4py import PETSc

from physics import fem
from physics.body.elasticity import Elasticity
from physics.body.kernel import energy_density
from physics.body.material import lame
from physics.mesh.cell import CELLS


def conditions(space, fixed):
    """Dirichlet conditions for `assemble_matrix` from a mask (N, 3) of held components."""
    dofs = np.sort(space.dofs[fixed]).astype(np.int32)
    if not len(dofs):
        return []
    if fixed[fixed.any(axis=1)].all():
        return [dolfinx_fem.dirichletbc(dolfinx_fem.Function(space.V), dofs[::3] // 3)]
    return [dolfinx_fem.dirichletbc(PETSc.ScalarType(0), dofs[dofs % 3 == i], space.V.sub(i)) for i in range(3)]


def assemble_vector(form, out):
    """A compiled form of rank 1 assembled into an array (3 N,) in dolfinx's order."""
    out[:] = 0.0
    dolfinx_fem.assemble_vector(out, form)
    return out


def assemble_matrix(matrix, form, fixed):
    """A compiled form of rank 2 assembled into a matrix; fixed rows and columns become those of the identity."""
    matrix.zeroEntries()
    dolfinx_petsc.assemble_matrix(matrix, form, bcs=fixed)
    matrix.assemble()
    return matrix


class DolfinxElasticity(Elasticity):
    """The same body, assembled by dolfinx cell by cell."""

    def __init__(self, like: Elasticity) -> None:
        self.mesh, self.material, self.fixed = like.mesh, like.material, like.fixed
        self._u = dolfinx_fem.Function(self.space.V)
        v, w = ufl.TestFunction(self.space.V), ufl.TrialFunction(self.space.V)
        lmbda, mu = (self.space.constant(value) for value in lame(self.material))
        d = self.mesh.dimension
        points, weights = CELLS[self.mesh.cell].points[:, :d], CELLS[self.mesh.cell].weights
        logging.getLogger("UFL").setLevel(logging.ERROR)  # it is not sure that arrays can be metadata; FFCx reads them there
        rule = {"quadrature_degree": 2, "quadrature_rule": "custom", "quadrature_points": points, "quadrature_weights": weights}
        slope = ufl.grad(self._u)  # of a plane body, in plane strain, without a column for z
        slope = ufl.as_tensor([[slope[i, j] if j < d else 0.0 for j in range(3)] for i in range(3)])
        W = energy_density(self.material.law, ufl.Identity(3) + slope, lmbda, mu) * ufl.dx(metadata=rule)
        force = ufl.derivative(W, self._u, v)
        self._forms = [fem.compile_form(form) for form in (W, force, ufl.derivative(force, self._u, w))]
        self._conditions, self._tangent = conditions(self.space, self.fixed), dolfinx_petsc.create_matrix(self._forms[2])
        self._vector = np.empty(self.mesh.points.size)

    def energy(self, u):
        self._u.x.array[:] = self.space.to_dofs(u)
        return float(dolfinx_fem.assemble_scalar(self._forms[0]))

    def force(self, u):
        self._u.x.array[:] = self.space.to_dofs(u)
        return self.space.from_dofs(assemble_vector(self._forms[1], self._vector))

    def stiffness(self, u):
        self._u.x.array[:] = self.space.to_dofs(u)
        return assemble_matrix(self._tangent, self._forms[2], self._conditions)


def assert_assembled_as_by_dolfinx(ours, size):
    """Energy, forces and stiffness at random displacements up to a size [m] are what dolfinx assembles, to rounding."""
    theirs = DolfinxElasticity(ours)
    u = np.random.default_rng(3).uniform(-size, size, ours.mesh.points.shape)
    assert ours.energy(u) == pytest.approx(theirs.energy(u), rel=1e-12)
    assert abs(ours.force(u) - theirs.force(u)).max() < 1e-12 * abs(theirs.force(u)).max()
    difference = ours.stiffness(u).copy()
    scale = difference.norm()
    difference.axpy(-1.0, theirs.stiffness(u))
    assert difference.norm() < 1e-12 * scale
