"""A reduced-order model: the equilibria of a scene sought among a few dozen shapes of its body.

    u = s w + V q,     V^T (f(u) - s b - sum_p p n) = 0,     gap(u) + c p >= 0,  p >= 0,  p (gap + c p) = 0

s is the fraction of the loading, w the motion under prescribed displacements. V spans, all for the rest state:
- the lowest elastic modes, phi_i;
- their static derivatives theta_ij = -K^-1 d2f[phi_i, phi_j], by which bending shortens a beam (Idelsohn and Cardona, Comput.
  Methods Appl. Mech. Eng. 49, 1985), and of the first few the third order in the same way, by which it goes on turning;
- the responses K^-1 n to unit forces on the nodes around the place that the obstacle touches first, and to the loads.
Nothing is trained: all of it follows from the scene. Forces are those of the whole mesh, so that a step costs about as much as
the assembly of one; what is saved is the factorisation and the steps. Contact is solved like newton.py does, on the compliance
of the shapes.

Legend: N nodes, r shapes, T steps + 1, k contact points near the obstacle.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from physics.contact.conditions import Zone, solve_complementarity
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import NEAR, REACH
from physics.equilibrium.state import HALVINGS, NoEquilibrium
from physics.linalg.factor import factor_for
from physics.mesh.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.float64]

MODES, CUBED, AROUND = 6, 3, 1.5  # modes; of these taken to third order; cell sizes around the first touch
KEPT = 1e-6  # shapes that add less than this share to the span are dropped
ITERATIONS, SLOW = 30, 10  # Newton steps before giving up, and before the stiffness is made anew
WORTH = 20  # Newton steps beyond two an equilibrium, after which a new stiffness pays: it costs a force for each shape
SETTLED = 2e-4  # of a cell: a change of displacement that ends the iteration


class Reduced:
    """The equations of a scene in a small space.

    Attributes:
        shapes: (3 N, r) V, orthonormal; iterations: Newton steps so far
    """

    def __init__(self, scene: Scene, mesh: Mesh) -> None:
        self.balance = balance = Balance(scene, mesh)
        self._stiffness = factor_for(balance.elasticity)
        self._stiffness.update(np.zeros_like(mesh.points))
        self._free = ~balance.fixed
        self._moved = np.zeros_like(mesh.points)  # w
        if balance.target.any():
            step = 1e-3 * np.ptp(mesh.points, axis=0).min() / abs(balance.target).max()
            pull = (balance.elasticity.force(step * balance.target) - balance.elasticity.force(-step * balance.target)) / (2 * step)
            self._moved = np.where(balance.fixed, balance.target, self._stiffness.solve(-pull))
        modes = self._modes(MODES)
        second = self._derivatives(modes)
        third = [self._odd(mode) for mode in modes[:CUBED]]
        # By linear elasticity there is no second or third order: what would be rounding is left out.
        floor = 1e-9 * max(abs(mode).max() for mode in modes)
        self.shapes = _span([shape for shape in (*modes, *second, *third, *self._responses()) if abs(shape).max() > floor])
        self.shapes[~self._free.ravel()] = 0.0  # to the last bit
        self.iterations = 0
        self._inverse: Floats | None = None
        self._excess = 0  # Newton steps beyond two an equilibrium with the kept stiffness
        self._zone: Zone | None = None
        self._renew(np.zeros(self.shapes.shape[1]), 0.0)

    def path(self, steps: int) -> Floats:
        """(T, N, 3) displacements over the whole loading, in equal steps. Raises `NoEquilibrium`."""
        states = [np.zeros(self.shapes.shape[1])]
        for step in range(1, steps + 1):
            rests = not states[-1].any() and self.balance.rests(step / steps)
            # Straight on from the last two: the parabola of the last three gained nothing where contact slides.
            start = 2 * states[-1] - states[-2] if step > 1 else states[-1]
            states.append(states[-1] if rests else self._advance(start, states[-1], (step - 1) / steps, step / steps))
        return np.array([self._displacement(q, step / steps) for step, q in enumerate(states)])

    def _advance(self, start: Floats, last: Floats, before: float, fraction: float, depth: int = 0) -> Floats:
        """(r,) the equilibrium after a last one, in two halves where it cannot be had in one."""
        try:
            return self._equilibrium(start, fraction)
        except NoEquilibrium:
            if depth == HALVINGS:
                raise
        self._renew(last, before)
        middle = self._advance(last, last, before, (before + fraction) / 2, depth + 1)
        return self._advance(2 * middle - last, middle, (before + fraction) / 2, fraction, depth + 1)

    def _equilibrium(self, q: Floats, fraction: float) -> Floats:
        for iteration in range(1, ITERATIONS + 1):
            self._excess += iteration > 2
            if iteration % SLOW == 0 or self._excess > WORTH:
                self._renew(q, fraction)
            change = self._step(q, fraction)
            q = q + change
            self.iterations += 1
            size = float(abs(self.shapes @ change).max())
            if size <= SETTLED * self.balance.size:
                return q
            if not np.isfinite(size):
                break
        raise NoEquilibrium(f"the reduced model does not settle at {100 * fraction:.3g} % of the loading")

    def _step(self, q: Floats, fraction: float) -> Floats:
        """(r,) one Newton step with the kept reduced stiffness, contact included."""
        assert self._inverse is not None
        balance, u = self.balance, self._displacement(q, fraction)
        change = -self._inverse @ (self._forces(u) - fraction * (self.shapes.T @ balance.load.ravel()))
        if balance.contact is None:
            return change
        centre = balance.contact.obstacle.position(fraction)
        if self._zone is None or not self._zone.covers(u, centre, NEAR * balance.size):
            self._zone = balance.contact.zone(u, centre, REACH * balance.size)
        gap, normal = self._zone.gaps(u, centre)
        near = np.flatnonzero(gap < NEAR * balance.size)
        if not len(near):
            return change
        nodes = np.flatnonzero(self._zone.weights[near].any(axis=0))
        rows = (3 * self._zone.nodes[nodes][:, None] + np.arange(3)).ravel()
        lift = self._zone.gradient(near, nodes, normal) @ self.shapes[rows]  # (k, r)
        matrix = lift @ self._inverse @ lift.T
        matrix[np.diag_indices(len(near))] += self._zone.softness[near]
        try:
            p = solve_complementarity(matrix, gap[near] + lift @ change, gap[near] < 0)
        except (np.linalg.LinAlgError, RuntimeError):
            raise NoEquilibrium("the points in contact could not be found") from None
        return change + self._inverse @ (lift.T @ p)

    def _displacement(self, q: Floats, fraction: float) -> Floats:
        return fraction * self._moved + (self.shapes @ q).reshape(-1, 3)

    def _forces(self, u: Floats) -> Floats:
        return self.shapes.T @ self.balance.elasticity.force(u).ravel()

    def _renew(self, q: Floats, fraction: float) -> None:
        """The inverse (r, r) of the reduced tangent stiffness, by differences of the forces along each shape."""
        u, step = self._displacement(q, fraction), 1e-5 * self.balance.size
        forces = np.array([self._forces(u), *(self._forces(u + step * shape.reshape(-1, 3)) for shape in self.shapes.T)])
        if not np.isfinite(forces).all():
            raise NoEquilibrium(f"the reduced model turns a cell inside out at {100 * fraction:.3g} % of the loading")
        stiffness = (forces[1:] - forces[0]) / step
        self._inverse, self._excess = scipy.linalg.inv((stiffness + stiffness.T) / 2), 0

    def _modes(self, count: int) -> list[Floats]:
        """The lowest elastic modes (N, 3), by subspace iteration with nodal volumes as masses."""
        mesh = self.balance.mesh
        mass = np.bincount(mesh.cells.ravel(), minlength=len(mesh.points)).astype(float)[:, None]  # equal cells: their number
        block = np.random.default_rng(0).normal(size=(2 * count, *mesh.points.shape)) * self._free
        for _ in range(8):
            block = np.array([self._stiffness.solve(mass * shape) for shape in block])
            flat = block.reshape(len(block), -1) * np.sqrt(np.broadcast_to(mass, mesh.points.shape)).ravel()
            _, _, rows = np.linalg.svd(flat, full_matrices=False)  # the stiffest direction last
            block = (rows / np.sqrt(np.broadcast_to(mass, mesh.points.shape)).ravel()).reshape(block.shape)
        return [self._sized(np.where(self._free, shape, 0.0)) for shape in block[:count]]

    def _sized(self, shape: Floats) -> Floats:
        """The shape scaled to a thousandth of the body's smallest extent: small strains, far from rounding."""
        return shape * (1e-3 * np.ptp(self.balance.mesh.points, axis=0).min() / abs(shape).max())

    def _derivatives(self, modes: list[Floats]) -> list[Floats]:
        """theta_ij for i <= j, from d2f[a, b] = (e(a + b) - e(a - b)) / 4 with the even part e(v) = f(v) + f(-v)."""
        def even(v: Floats) -> Floats:
            return self.balance.elasticity.force(v) + self.balance.elasticity.force(-v)

        return [self._stiffness.solve(even(a - b) - even(a + b) if i != j else -even(a))
                for i, a in enumerate(modes) for j, b in enumerate(modes[:i + 1])]

    def _odd(self, mode: Floats) -> Floats:
        """The third-order response to a mode that goes on by itself: what is left of the odd part of f on the second order."""
        force, large = self.balance.elasticity.force, 30 * mode
        curved = large + 0.5 * self._stiffness.solve(-(force(large) + force(-large)))
        back = -large + 0.5 * self._stiffness.solve(-(force(large) + force(-large)))
        return self._stiffness.solve(-(force(curved) - force(back)) / 2) + large

    def _responses(self) -> list[Floats]:
        """K^-1 f for the loads and for unit forces on the nodes around the first touch, along the normal there."""
        balance, found = self.balance, []
        if balance.load.any():
            found.append(self._sized(self._stiffness.solve(balance.load)))
        if balance.contact is None:
            return found
        points, surface = balance.mesh.points, np.unique(balance.contact.surface.weights.indices)
        obstacle = balance.contact.obstacle
        for fraction in np.linspace(0, 1, 201):
            gap, normal = obstacle.gap(points[surface], obstacle.position(fraction))
            if gap.min() <= 0:
                break
        # At a distance d along the surface from where it touches, a round obstacle of radius R is off by d^2 / 2R.
        close = gap - gap.min() < (AROUND * balance.size) ** 2 / obstacle.width
        for node in surface[close]:
            force = np.zeros_like(points)
            force[node] = normal[np.argmin(gap)]
            found.append(self._sized(self._stiffness.solve(force)))
        return found


def _span(shapes: list[Floats]) -> Floats:
    """(3 N, r) an orthonormal basis of the shapes, each counted alike."""
    flat = np.array([shape.ravel() / np.linalg.norm(shape) for shape in shapes]).T
    left, size, _ = np.linalg.svd(flat, full_matrices=False)
    return np.ascontiguousarray(left[:, size > KEPT * size[0]])
