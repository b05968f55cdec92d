"""The equilibria of a scene by plain full Newton, without any shortcut: what the balance-following solver is held against.

At each step, from the last state: assemble the whole tangent of the potential W(u) - b.u + sum_q <-g_q>^2 / (2 c_q), factor
it, halve the step until the potential falls, and so on until the residual force is negligible. It shares the energy and the
contact points with the solver, but neither its extrapolation, its kept factor, its complementarity problem nor its step
control.
"""

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from physics.equilibrium.balance import Balance
from physics.mesh.build import build_mesh
from physics.mesh.quality import cell_volumes


def solve(scene, *, tolerance=1e-9, elasticity=None, steps=None, soften=1.0, halve=True, mesh=None):
    """(T, N, 3) displacements of all steps, or the first ones; the residual is below `tolerance` of the reaction at each.

    elasticity: makes another assembly of the same body from the solver's own
    soften: makes contact softer by this factor, which Newton's method likes and the penetration does not
    mesh: in place of the scene's own
    halve: False takes every step whole, which soft contact allows
    """
    mesh = mesh or build_mesh(scene.body)
    balance = Balance(scene, mesh)
    if elasticity is not None:
        balance.elasticity = elasticity(balance.elasticity)
    if balance.contact is not None:
        balance.contact.softness = balance.contact.softness * soften
    space, contact = balance.elasticity.space, balance.contact
    rounding = rounding_of(balance)
    u, frames = np.zeros_like(mesh.points), [np.zeros_like(mesh.points)]
    for step in range(1, (steps or scene.steps.count) + 1):
        fraction = step / scene.steps.count
        u = np.where(balance.fixed, fraction * balance.target, u)
        for _ in range(100):
            gradient, hessian = derivatives(balance, u, fraction)
            reaction = np.linalg.norm(contact_force(balance, u, fraction).sum(axis=0)) if contact else 0.0
            scale = reaction or np.linalg.norm(gradient[balance.fixed])
            free = space.to_dofs(np.where(balance.fixed, 0.0, gradient))
            if np.linalg.norm(free) <= max(tolerance * scale, balance.floor):
                break
            direction = space.from_dofs(solve_linear(hessian, -free))
            length, before = 1.0, potential(balance, u, fraction) if halve else 0.0
            enough = before + 1e-9 * abs(before) + rounding
            while halve and not potential(balance, u + length * direction, fraction) <= enough and length > 1e-4:
                length /= 2
            u = u + length * direction
        else:
            raise RuntimeError(f"plain Newton found no equilibrium at step {step}")
        frames.append(u)
    return np.array(frames)


def contact_force(balance, u, fraction):
    gap, normal = balance.contact.gaps(u, balance.contact.obstacle.position(fraction))
    return balance.contact.forces(np.maximum(-gap, 0) / balance.contact.softness, normal)


def potential(balance, u, fraction):
    value = balance.elasticity.energy(u) - fraction * (balance.load * u).sum()
    if balance.contact is not None:
        gap, _ = balance.contact.gaps(u, balance.contact.obstacle.position(fraction))
        value += (np.maximum(-gap, 0) ** 2 / (2 * balance.contact.softness)).sum()
    return value


def rounding_of(balance):
    """[J] below which a fall of the potential cannot be told from none: the energy of a cell is a difference of terms of E V each."""
    mesh = balance.mesh
    return 100 * np.finfo(float).eps * balance.scene.stiffest * cell_volumes(mesh.points, mesh.cells, mesh.cell).sum()


def derivatives(balance, u, fraction):
    """Gradient (N, 3) of the potential and its Hessian (3 N, 3 N) in dolfinx's order."""
    gradient = balance.elasticity.force(u) - fraction * balance.load
    indptr, indices, values = balance.elasticity.stiffness(u).getValuesCSR()
    hessian = scipy.sparse.csr_matrix((values, indices, indptr))
    if balance.contact is not None:
        gradient = gradient - contact_force(balance, u, fraction)
        hessian = hessian + contact_hessian(balance, u, fraction)
    return gradient, hessian


def contact_hessian(balance, u, fraction):
    contact = balance.contact
    gap, normal = contact.gaps(u, contact.obstacle.position(fraction))
    touched = np.flatnonzero(gap < 0)
    weights = contact.surface.weights[touched]
    nodes = np.unique(weights.indices)
    gradient = weights[:, nodes].toarray()[:, :, None] * normal[touched][:, None, :] * ~balance.fixed[nodes]  # held nodes do not move
    gradient = gradient.reshape(len(touched), 3 * len(nodes))  # (q, 3 n)
    # The curvature of the obstacle is left out: it takes away from the stiffness, and the step would no longer lead downhill.
    block = gradient.T @ (gradient / contact.softness[touched, None])
    dofs, size = balance.elasticity.space.dofs[nodes].ravel(), u.size
    rows, columns = np.broadcast_arrays(dofs[:, None], dofs)
    return scipy.sparse.csr_matrix((block.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))


def solve_linear(hessian, right):
    # Held rows and columns are those of the identity.
    matrix = PETSc.Mat().createAIJ(hessian.shape, csr=(hessian.indptr, hessian.indices, hessian.data), comm=PETSc.COMM_SELF)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(matrix)
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    x, b = matrix.createVecs()
    b.array[:] = right
    pc.apply(b, x)
    found = x.array.copy()
    for used in (pc, matrix, x, b):  # petsc4py would keep them, gigabytes after some hundred steps
        used.destroy()
    return found
