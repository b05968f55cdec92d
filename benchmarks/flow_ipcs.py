"""The splitting of dolfinx's tutorial on 2D-3, for benchmarks/flow.py: Crank-Nicolson with convection of Adams and Bashforth, then a
pressure correction, by three Krylov solvers (J. S. Dokken, The FEniCSx tutorial, "Flow past a cylinder").

The program is the tutorial's, its velocity of order 2 and pressure of order 1, on our mesh. Its first steps are timed and no more: the
whole path of 12800 steps takes a quarter of an hour.
"""

from __future__ import annotations

import time
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

from physics.mesh.mesh import Mesh

STEP, WARM = 1 / 1600, 20


def tutorial(mesh: Mesh, steps: int) -> dict[str, float]:
    """Vertices, cells, steps and milliseconds of the processor for each 0.01 s, over some steps after the first WARM."""
    domain = dolfinx.mesh.create_mesh(MPI.COMM_SELF, mesh.cells, np.ascontiguousarray(mesh.points[:, :2]),
                                      ufl.Mesh(ufl.VectorElement("Lagrange", ufl.triangle, 1)))
    V, Q = fem.FunctionSpace(domain, ufl.VectorElement("Lagrange", ufl.triangle, 2)), fem.FunctionSpace(domain, ("Lagrange", 1))
    dt, mu, rho = STEP, 0.001, 1.0
    u, v, p, q = ufl.TrialFunction(V), ufl.TestFunction(V), ufl.TrialFunction(Q), ufl.TestFunction(Q)
    u_, u_s, u_n, u_n1, p_, phi, given = (fem.Function(space) for space in (V, V, V, V, Q, Q, V))
    F = rho / dt * ufl.dot(u - u_n, v) * ufl.dx + ufl.inner(ufl.dot(1.5 * u_n - 0.5 * u_n1, 0.5 * ufl.nabla_grad(u + u_n)), v) * ufl.dx
    F += 0.5 * mu * ufl.inner(ufl.grad(u + u_n), ufl.grad(v)) * ufl.dx - ufl.dot(p_, ufl.div(v)) * ufl.dx
    first = (ufl.lhs(F), ufl.rhs(F))
    second = (ufl.dot(ufl.grad(p), ufl.grad(q)) * ufl.dx, -rho / dt * ufl.dot(ufl.div(u_s), q) * ufl.dx)
    third = (rho * ufl.dot(u, v) * ufl.dx, (rho * ufl.dot(u_s, v) - dt * ufl.dot(ufl.nabla_grad(phi), v)) * ufl.dx)

    def edges(where: Any) -> Any:
        return dolfinx.mesh.locate_entities_boundary(domain, 1, where)

    end, start = float(mesh.points[:, 0].max()), float(mesh.points[:, 0].min())
    inlet, outlet = edges(lambda x: np.isclose(x[0], start)), edges(lambda x: np.isclose(x[0], end))
    walls = np.setdiff1d(edges(lambda x: np.full(x.shape[1], True)), np.concatenate([inlet, outlet]))
    still = fem.Function(V)
    of_velocity = [fem.dirichletbc(given, fem.locate_dofs_topological(V, 1, inlet)),
                   fem.dirichletbc(still, fem.locate_dofs_topological(V, 1, walls))]
    of_pressure = [fem.dirichletbc(PETSc.ScalarType(0), fem.locate_dofs_topological(Q, 1, outlet), Q)]
    parts = [_Part(first, of_velocity, u_s, "bcgs", "jacobi"), _Part(second, of_pressure, phi, "minres", "hypre"),
             _Part(third, [], u_, "cg", "sor")]
    clock = 0.0
    for n in range(1, WARM + steps + 1):
        if n == WARM + 1:
            clock = time.process_time()
        speed = 1.5 * np.sin(np.pi * n * dt / 8)
        given.interpolate(lambda x, s=speed: np.stack([4 * s * x[1] * (0.41 - x[1]) / 0.41**2, 0 * x[0]]))
        parts[0].solve(again=True)
        parts[1].solve()
        p_.vector.axpy(1, phi.vector)
        parts[2].solve()
        u_n.vector.copy(u_n1.vector)
        u_.vector.copy(u_n.vector)
    spent = time.process_time() - clock
    assert np.isfinite(u_.x.array).all()
    return {"vertices": len(mesh.points), "cells": len(mesh.cells), "steps": 0.01 / dt, "ms": 1e3 * spent / (steps * dt / 0.01)}


class _Part:
    """One of the three linear problems."""

    def __init__(self, forms: tuple[Any, Any], given: list[Any], into: Any, solver: str, preconditioner: str) -> None:
        self.left, self.right = (fem.form(form) for form in forms)
        self.given, self.into = given, into
        self.matrix = petsc.assemble_matrix(self.left, bcs=given)
        self.matrix.assemble()
        self.vector = petsc.create_vector(self.right)
        self.solver = PETSc.KSP().create(MPI.COMM_SELF)
        self.solver.setOperators(self.matrix)
        self.solver.setType(solver)
        self.solver.getPC().setType(preconditioner)
        if preconditioner == "hypre":
            self.solver.getPC().setHYPREType("boomeramg")

    def solve(self, *, again: bool = False) -> None:
        if again:
            self.matrix.zeroEntries()
            petsc.assemble_matrix(self.matrix, self.left, bcs=self.given)
            self.matrix.assemble()
        with self.vector.localForm() as local:
            local.set(0)
        petsc.assemble_vector(self.vector, self.right)
        petsc.apply_lifting(self.vector, [self.left], [self.given])
        petsc.set_bc(self.vector, self.given)
        self.solver.solve(self.vector, self.into.vector)
        self.into.x.scatter_forward()
