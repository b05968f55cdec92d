"""Contact of a body in motion, so that it never makes energy.

A step of length h leads from positions x0 to x1 of the points of contact, all seen from the obstacle. At its end
p >= 0, g(x1) + c p >= 0, complementary (contact/conditions.py). Two things keep the energy from growing.

1. Forces act along a mean normal n' with n'.(x1 - x0) = g(x1) - g(x0): the normal in the middle of the way plus what is missing
   to that along the way (Gonzalez, J. Nonlinear Sci. 6, 1996, 449: discrete gradients). Their work in the step is then
   p (g(x1) - g(x0)) <= 0: some when contact begins, none while it lasts, however the points slide over a round obstacle. A
   normal at the end of the step would do work on points that slide.

2. Left so, points that were struck would swing from step to step. So the impulses pi of those that bear are found anew, as in a
   perfectly plastic impact of their nodes (Moreau): pi >= 0, rate of the gap r >= 0, pi r = 0. With G of the normals at the
   end and d = h p - pi, velocities change from v to v' = v - M^-1 G^T d, and the kinetic energy by
   - h p.r - d.G M^-1 G^T d / 2 <= 0. What is lost is the motion, normal to the obstacle, of one layer of nodes: the less, the
   finer the mesh.

Both hold up to the energy c p^2 / 2 in the softness of contact. Legend: N nodes, Q points, q of them in a zone or bearing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.contact.conditions import solve_complementarity
from physics.contact.touch import Contact, Zone

Floats = NDArray[np.float64]


class Sweeping(Contact):
    """Contact within a step of time, with mean normals; `begin` says where the step starts."""

    def __init__(self, contact: Contact) -> None:
        self.surface, self.obstacle, self.rest, self.softness = contact.surface, contact.obstacle, contact.rest, contact.softness
        self.u, self.centre = np.zeros_like(contact.rest), contact.obstacle.position(0.0)

    def begin(self, u: Floats, centre: Floats) -> None:
        """A step from displacements (N, 3) and a centre (3,) of the obstacle, of several (K, 3)."""
        self.u, self.centre = u, centre

    def zone(self, u: Floats, centre: Floats, reach: float) -> Zone:
        return _SweptZone(self, u, centre, reach)


class _SweptZone(Zone):
    def __init__(self, contact: Sweeping, u: Floats, centre: Floats, reach: float) -> None:
        super().__init__(contact, u, centre, reach)
        self._sweep = contact

    def gaps(self, u: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Gaps (q,) [m] at displacements (N, 3), and the mean normals (q, 3) of the way to there."""
        obstacle, nowhere = self.obstacle, np.zeros_like(centre)
        before = obstacle.offset(self.positions(self._sweep.u), self._sweep.centre)
        after = obstacle.offset(self.positions(u), centre)
        gap, last = obstacle.gap(after, nowhere)
        gap_before, _ = obstacle.gap(before, nowhere)
        middle = obstacle.gap((before + after) / 2, nowhere)[1]
        way = after - before
        length = (way * way).sum(axis=1)
        still = length < (1e-9 * np.abs(self._rest).max(initial=1e-300)) ** 2  # no way that could be measured
        missing = gap - gap_before - (middle * way).sum(axis=1)
        mean = middle + np.where(still, 0.0, missing / np.where(still, 1.0, length))[:, None] * way
        return gap, np.where(still[:, None], last, mean)


def bear(contact: Contact, u: Floats, velocity: Floats, *, pressure: Floats, centre: Floats, towards: Floats,
         mobile: Floats, h: float) -> tuple[Floats, Floats]:
    """Velocities (N, 3) [m/s] after the plastic impact of the points that bear, and the forces (K, 3) [N] on the body that this adds,
    one of each obstacle.

    Args:
        u: displacements (N, 3) at the end of the step; velocity: (N, 3) there, before the impact
        pressure: (Q,) contact forces of the step [N]; h: its length [s]
        centre: (3,) of the obstacle; towards: (3,) its velocity [m/s]; of several (K, 3)
        mobile: (N, 3) inverse masses of the nodes [1/kg], zero for held components
    """
    bearing = np.flatnonzero(pressure > 0)
    rows = contact.surface.weights[bearing]
    nodes = np.unique(rows.indices)
    weights = rows[:, nodes].toarray()  # (q, n)
    obstacle = contact.obstacle.among(bearing)
    normal = obstacle.gap(weights @ (contact.rest + u)[nodes], centre)[1]
    gradient = (weights[:, :, None] * normal[:, None, :]).reshape(len(bearing), -1)  # (q, 3 n)
    inverse, push = mobile[nodes].ravel(), h * pressure[bearing]
    matrix = gradient * inverse @ gradient.T + np.diag(2 / h**2 * contact.softness[bearing])
    loose = velocity[nodes].ravel() - inverse * (gradient.T @ push)
    impulse = solve_complementarity(matrix, gradient @ loose - obstacle.along(normal, towards), np.ones(len(bearing), bool))  # [N s]
    after = velocity.copy()
    after[nodes] = (loose + inverse * (gradient.T @ impulse)).reshape(-1, 3)
    return after, obstacle.sums(impulse - push, normal) / h
