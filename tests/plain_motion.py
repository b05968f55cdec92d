"""Where a body comes to rest that moves in a viscous medium while it is loaded slowly: for scenes in which plain Newton finds nothing.

At each step of the loading the body follows s du/dt = -dV/du down its potential V(u) = W(u) - b.u + sum_q <-g_q>^2 / (2 c_q), by implicit
Euler (one linear problem a step, the whole Hessian of contact by penalty in it), until the force is negligible. A step is taken only
where the potential falls, else a shorter one: so it ends in a minimum of V, never in an unstable state, and where the path of equilibria
ends it goes downhill to the next. It shares energy and points of contact with the solver, and nothing else.
"""

import numpy as np
import scipy.linalg

from physics.equilibrium.balance import Balance
from physics.mesh.build import build_mesh
from tests.plain_newton import contact_force, derivatives, potential, rounding_of

LONGEST = 0.2  # way of a node in one step, in cell sizes: nothing is jumped over


def solve(scene, *, tolerance=1e-8):
    """(T, N, 3) displacements of all steps; the residual is below `tolerance` of the reaction at each."""
    balance, count = Balance(scene, build_mesh(scene.body)), scene.steps.count
    frames = [np.zeros_like(balance.mesh.points)]
    for step in range(1, count + 1):
        frames.append(settle(balance, frames[-1], step / count, tolerance))
    return np.array(frames)


def settle(balance, u, fraction, tolerance=1e-8):
    """Where a body comes to rest from displacements (N, 3), left to itself at a fraction of the loading."""
    space, drag, allowed = balance.elasticity.space, 1e-3 * balance.scene.stiffest * balance.size, rounding_of(balance)
    u = np.where(balance.fixed, fraction * balance.target, u)
    value = potential(balance, u, fraction)
    for _ in range(4000):
        gradient, hessian = derivatives(balance, u, fraction)
        reaction = np.linalg.norm(contact_force(balance, u, fraction).sum(axis=0)) if balance.contact else 0.0
        free = space.to_dofs(np.where(balance.fixed, 0.0, gradient))
        if np.linalg.norm(free) <= max(tolerance * (reaction or np.linalg.norm(gradient[balance.fixed])), balance.floor):
            return u
        dense = hessian.toarray()
        while True:
            try:
                factor = scipy.linalg.cho_factor(dense + drag * np.eye(len(dense)), check_finite=False)
                moved = u - space.from_dofs(scipy.linalg.cho_solve(factor, free))
                after = potential(balance, moved, fraction)
                if abs(moved - u).max() < LONGEST * balance.size and after <= value + allowed:
                    break
            except scipy.linalg.LinAlgError:
                pass
            drag *= 4
        u, value, drag = moved, after, drag / 2
    raise RuntimeError(f"it does not come to rest at {fraction}")


def softest(balance, u, fraction):
    """The smallest eigenvalue [N/m] of the second derivative of V on the free components, by differences of its gradient."""
    free, contact = np.flatnonzero(~balance.fixed.ravel()), balance.contact
    short, rows, touched = 1e-6 * balance.size, [], contact.gaps(u, contact.obstacle.position(fraction))[0] < 0

    def gradient(at):
        gap, normal = contact.gaps(at, contact.obstacle.position(fraction))  # points that touch go on touching
        return (balance.elasticity.force(at) - contact.forces(np.where(touched, -gap, 0) / contact.softness, normal)).ravel()[free]

    for component in free:
        way = np.zeros(u.size)
        way[component] = short
        way = way.reshape(u.shape)
        rows.append((gradient(u + way) - gradient(u - way)) / (2 * short))
    hessian = np.array(rows)
    return float(np.linalg.eigvalsh((hessian + hessian.T) / 2)[0])
