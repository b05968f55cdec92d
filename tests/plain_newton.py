"""The equilibria of a scene by plain full Newton, without any shortcut: what the path-following solver is held against.

At each step, from the last state: assemble the whole tangent of the potential W(u) - b.u + sum_q <-g_q>^2 / (2 c_q), factor
it, halve the step until the potential falls, and so on until the residual force is negligible. It shares the energy and the
contact points with the solver, but neither its extrapolation, its kept factor, its complementarity problem nor its step
control.
"""

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from physics.equilibrium import Path
from physics.mesh import build_mesh


def solve(scene, *, tolerance=1e-9):
    """(T, N, 3) displacements of all steps; the residual is below `tolerance` of the reaction at every one."""
    mesh = build_mesh(scene.body)
    path = Path(scene, mesh)
    space, contact, fixed = path.elasticity.space, path.contact, space_mask(path)
    u, frames = np.zeros_like(mesh.points), [np.zeros_like(mesh.points)]
    for step in range(1, scene.steps.count + 1):
        fraction = step / scene.steps.count
        u = np.where(path.fixed, fraction * path.target, u)
        for _ in range(100):
            gradient, hessian = derivatives(path, u, fraction)
            reaction = np.linalg.norm(contact_force(path, u, fraction).sum(axis=0)) if contact else 0.0
            scale = reaction or np.linalg.norm(gradient[path.fixed])
            free = space.to_dofs(np.where(path.fixed, 0.0, gradient))
            if np.linalg.norm(free) <= max(tolerance * scale, path.floor):
                break
            direction = space.from_dofs(solve_linear(hessian, -free, fixed))
            length, before = 1.0, potential(path, u, fraction)
            # A fall below the rounding of the potential, eps (|W| + |b.u|), cannot be told from none.
            while not potential(path, u + length * direction, fraction) <= before + 1e-9 * abs(before) and length > 1e-4:
                length /= 2
            u = u + length * direction
        else:
            raise RuntimeError(f"plain Newton found no equilibrium at step {step}")
        frames.append(u)
    return np.array(frames)


def space_mask(path):
    """(3 N,) True on held degrees of freedom."""
    return path.elasticity.space.to_dofs(path.fixed.astype(float)) > 0


def contact_force(path, u, fraction):
    gap, normal = path.contact.gaps(u, path.contact.obstacle.position(fraction))
    return path.contact.forces(np.maximum(-gap, 0) / path.contact.softness, normal)


def potential(path, u, fraction):
    value = path.elasticity.energy(u) - fraction * (path.load * u).sum()
    if path.contact is not None:
        gap, _ = path.contact.gaps(u, path.contact.obstacle.position(fraction))
        value += (np.maximum(-gap, 0) ** 2 / (2 * path.contact.softness)).sum()
    return value


def derivatives(path, u, fraction):
    """Gradient (N, 3) of the potential and its Hessian (3 N, 3 N) in dolfinx's order."""
    gradient = path.elasticity.force(u) - fraction * path.load
    indptr, indices, values = path.elasticity.stiffness(u).getValuesCSR()
    hessian = scipy.sparse.csr_matrix((values, indices, indptr))
    if path.contact is not None:
        gradient = gradient - contact_force(path, u, fraction)
        hessian = hessian + contact_hessian(path, u, fraction)
    return gradient, hessian


def contact_hessian(path, u, fraction):
    contact = path.contact
    gap, normal = contact.gaps(u, contact.obstacle.position(fraction))
    touched = np.flatnonzero(gap < 0)
    # The curvature of the obstacle is left out: it takes away from the stiffness, and the step would no longer lead downhill.
    block = np.einsum("qi,qj->qij", normal[touched], normal[touched]) / contact.softness[touched, None, None]
    weights = scipy.sparse.kron(contact.surface.weights[touched], scipy.sparse.identity(3), format="csr")
    by_node = weights.T @ scipy.sparse.block_diag(list(block) or [np.zeros((0, 0))]) @ weights
    order = path.elasticity.space.dofs.ravel()
    to_dofs = scipy.sparse.csr_matrix((np.ones(len(order)), (order, np.arange(len(order)))))
    return to_dofs @ by_node @ to_dofs.T


def solve_linear(hessian, right, fixed):
    keep = scipy.sparse.diags((~fixed).astype(float))
    hessian = (keep @ hessian @ keep + scipy.sparse.diags(fixed.astype(float))).tocsr()
    matrix = PETSc.Mat().createAIJ(hessian.shape, csr=(hessian.indptr, hessian.indices, hessian.data), comm=PETSc.COMM_SELF)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(matrix)
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    x, b = matrix.createVecs()
    b.array[:] = right
    pc.apply(b, x)
    return x.array.copy()
