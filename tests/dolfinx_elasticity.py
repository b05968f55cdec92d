"""Energy, forces and stiffness of a body assembled by dolfinx, cell by cell: what our own loops over cells are held against."""

import logging

import numpy as np
import ufl
from dolfinx import fem as dolfinx_fem
from petsc4py import PETSc

from physics import fem
from physics.body.elasticity import Elasticity
from physics.body.material import LAWS, lame
from physics.mesh.cell import CELLS


def conditions(space, fixed):
    """Dirichlet conditions for `fem.assemble_matrix` from a mask (N, 3) of held components."""
    dofs = np.sort(space.dofs[fixed]).astype(np.int32)
    if not len(dofs):
        return []
    if fixed[fixed.any(axis=1)].all():
        return [dolfinx_fem.dirichletbc(space.function(), dofs[::3] // 3)]
    return [dolfinx_fem.dirichletbc(PETSc.ScalarType(0), dofs[dofs % 3 == i], space.V.sub(i)) for i in range(3)]


class DolfinxElasticity(Elasticity):
    """The same body, assembled by dolfinx cell by cell."""

    def __init__(self, like: Elasticity) -> None:
        self.mesh, self.material, self.fixed = like.mesh, like.material, like.fixed
        self._u = self.space.function()
        v, w = ufl.TestFunction(self.space.V), ufl.TrialFunction(self.space.V)
        lmbda, mu = (self.space.constant(value) for value in lame(self.material))
        points, weights = CELLS[self.mesh.cell].points, CELLS[self.mesh.cell].weights
        logging.getLogger("UFL").setLevel(logging.ERROR)  # it is not sure that arrays can be metadata; FFCx reads them there
        rule = {"quadrature_degree": 2, "quadrature_rule": "custom", "quadrature_points": points, "quadrature_weights": weights}
        W = LAWS[self.material.law](ufl.Identity(3) + ufl.grad(self._u), lmbda, mu) * ufl.dx(metadata=rule)
        force = ufl.derivative(W, self._u, v)
        self._forms = [fem.compile_form(form) for form in (W, force, ufl.derivative(force, self._u, w))]
        self._conditions, self._tangent = conditions(self.space, self.fixed), fem.create_matrix(self._forms[2])
        self._vector = np.empty(self.mesh.points.size)

    def energy(self, u):
        fem.set_function(self._u, self.space.to_dofs(u))
        return float(dolfinx_fem.assemble_scalar(self._forms[0]))

    def force(self, u):
        fem.set_function(self._u, self.space.to_dofs(u))
        return self.space.from_dofs(fem.assemble_vector(self._forms[1], self._vector))

    def stiffness(self, u):
        fem.set_function(self._u, self.space.to_dofs(u))
        return fem.assemble_matrix(self._tangent, self._forms[2], self._conditions)
