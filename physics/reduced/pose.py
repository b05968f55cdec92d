"""A body pressed by a rigid obstacle, at one pose of it: where it moves in a small space and yields locally.

The body moves in a space of some thirty functions (space.py) and yields locally as it would at rest, turned with the touched
patch by the rotation R:

    u = Phi q + R (K^-1 - Phi Phi^T) R^T sum_a p_a n_a,    dW/dq + c = Phi^T sum_a p_a n_a,
    gap_a >= 0,  p_a >= 0,  p_a gap_a = 0                  at the points of the surface where contact is felt

p are contact forces along the obstacle's normals n; c is what the body's own law has beyond the polynomial W. Newton's method
leads from a pose to one nearby. Legend: N body nodes, M = 3 N, A points of contact, r size of the space.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from physics.contact.conditions import CONTACT_STIFFNESS, ContactSurface, solve_complementarity
from physics.contact.obstacles import Rigid
from physics.mesh.mesh import Mesh
from physics.reduced.elastic import Elastic, components
from physics.reduced.space import Reduced

Floats = NDArray[np.float64]
ITERATIONS = 40
LOOSE = 1e-3  # cell sizes: a last step that may be left over where points of contact go in circles
HALVINGS = 4
FRESH = 0.02  # cell sizes: after a longer way second derivatives are computed anew
SAMPLE = 50  # components of which one is looked at for convergence
REACH = 1.5  # cell sizes: points with a smaller gap are looked at
NEAR = 0.5  # cell sizes: points with a smaller gap take part in contact
SOFTEST = 1e-6  # smallest curvature of the energy over the largest
TOLERANCE = 1e-5  # of the largest extent: displacement in Newton's last step


@dataclass(frozen=True)
class PoseState:
    """The body as it is pressed: centre (3,) of the obstacle; q (r,) in the small space; local (N, 3) what that cannot do [m];
    pressure (A,) and push (M,) contact forces."""

    centre: Floats
    q: Floats
    local: Floats
    pressure: Floats
    push: Floats


class Press:
    """A body in one small space, and the obstacle that presses it."""

    def __init__(self, mesh: Mesh, size: float, surface: ContactSurface, obstacle: Rigid, elastic: Elastic, model: Reduced) -> None:
        """Args: size of a cell [m]; surface where contact is felt; model: the small space."""
        self.mesh, self.size, self.surface, self.obstacle, self.elastic, self.model = mesh, size, surface, obstacle, elastic, model
        self._softness = size / (CONTACT_STIFFNESS * surface.hardness * surface.area)
        self._bent: tuple[Floats, Floats] | None = None  # q, and the second derivatives there
        self._tolerance = TOLERANCE * float(np.ptp(mesh.points, axis=0).max())

    def within(self, model: Reduced) -> Press:
        """The same in another space."""
        return Press(self.mesh, self.size, self.surface, self.obstacle, self.elastic, model)

    def rest(self, centre: Floats) -> PoseState:
        """Nothing moved and nothing pressed, the obstacle at a place."""
        size, surface = self.elastic.size, len(self.surface.area)
        return PoseState(centre, np.zeros(self.model.space.shape[1]), np.zeros((size // 3, 3)), np.zeros(surface), np.zeros(size))

    def displacement(self, state: PoseState) -> Floats:
        """(N, 3) [m]"""
        return (self.model.space @ state.q).reshape(-1, 3) + state.local

    def advance(self, centre: Floats, state: PoseState, c: Floats, depth: int = 0) -> PoseState | None:
        """The state at a pose, from one at another pose: in one go, or in two halves where that does not lead there.

        None where it does not lead there either in parts of a cell's size over 2^HALVINGS.
        """
        way = centre - state.centre
        if np.linalg.norm(way) <= self.size:
            if (found := self.newton(centre, state, c)) is not None:
                return found
            if depth == HALVINGS:
                return None
            depth += 1
        middle = self.advance(state.centre + way / 2, state, c, depth)
        return None if middle is None else self.advance(centre, middle, c, depth)

    def newton(self, centre: Floats, state: PoseState, c: Floats) -> PoseState | None:
        """The state at a pose from one nearby; None where Newton's method does not find it."""
        space, rest = self.model.space, self.mesh.points
        gap, _ = self.obstacle.gap(self.surface.weights @ (rest + self.displacement(state)), centre)
        zone = np.flatnonzero((gap < REACH * self.size) | (state.pressure > 0))
        if not len(zone):
            if not state.q.any():
                return replace(state, centre=centre)
            zone = gap.argmin(keepdims=True)
        rows = self.surface.weights[zone]
        nodes, place = np.unique(rows.indices.astype(np.int64), return_inverse=True)
        component = components(nodes)
        weights, softness = np.zeros((len(zone), len(nodes))), self._softness[zone]
        weights[np.repeat(np.arange(len(zone)), np.diff(rows.indptr)), place] = rows.data
        zone_space, zone_rest = space[component], rest[nodes]
        q, local, pressure = state.q, state.local[nodes], state.pressure[zone]
        hessian, held = self._hessian(q), np.zeros(0, np.int64)
        for _ in range(ITERATIONS):
            moved = zone_rest + (zone_space @ q).reshape(-1, 3)
            turn = _rotation(zone_rest, moved)
            gap, normal = self.obstacle.gap(weights @ (moved + local), centre)
            near = np.flatnonzero((gap < max(NEAR * self.size, 1.001 * gap.min())) | (pressure > 0))
            w, n = weights[near], normal[near]
            if not np.array_equal(behind := np.flatnonzero(w.any(axis=0)), held):  # nodes behind the near points
                held, pushable = behind, components(nodes[behind])
                columns = self.elastic.learn(nodes[held])  # (3 h,)
                answers = self.elastic.columns[np.ix_(columns, component)].T - zone_space @ space[pushable].T  # (3 k, 3 h)
            along = (w[:, :, None] * n[:, None, :]).reshape(len(near), -1)  # (a, 3 k) gap by displacement
            pushed = (w[:, held, None] * (n @ turn)[:, None, :]).reshape(len(near), -1)  # (a, 3 h)
            in_space = along @ zone_space  # (a, r)
            pushing = np.flatnonzero(pressure[near] > 0)
            at = (w[pushing] @ zone_space.reshape(len(nodes), -1)).reshape(len(pushing), 3, len(q))  # (b, 3, r)
            bent = self.obstacle.bend(w[pushing] @ (moved + local), centre) * np.sqrt(pressure[near[pushing]])[:, None, None]
            bent = (bent @ at).reshape(-1, len(q))  # (2 b, r)
            factor = _factor(hessian - bent.T @ bent)
            reply = cho_solve(factor, np.column_stack([in_space.T, self.model.slope(q) + c]), check_finite=False)
            matrix = in_space @ reply[:, :-1] + pushed @ answers[components(held)] @ pushed.T
            matrix = (matrix + matrix.T) / 2 + np.diag(softness[near])
            free = gap[near] - along @ local.ravel() - in_space @ reply[:, -1]
            p = solve_complementarity(matrix, free, pressure[near] > 0)
            step = reply[:, :-1] @ p - reply[:, -1]
            before, force = local, pushed.T @ p
            q, local = q + step, (answers @ force).reshape(-1, 3) @ turn.T
            pressure = np.zeros(len(zone))
            pressure[near] = p
            change = max(abs(zone_space @ step).max(), abs(local - before).max(), abs(space[::SAMPLE] @ step).max())
            if not change < self.size:
                return None
            if change < self._tolerance:
                break
            if change > FRESH * self.size:
                hessian = self._hessian(q)
        else:
            if change > LOOSE * self.size:
                return None
        whole, push = np.zeros_like(state.pressure), np.zeros(len(space))
        whole[zone], push[component] = pressure, along.T @ p
        push[self.elastic.held] = 0.0
        pulled = np.flatnonzero(force)
        local = force[pulled] @ self.elastic.columns[columns[pulled]] - space @ (force @ space[pushable])
        return PoseState(centre, q, local.reshape(-1, 3) @ turn.T, whole, push)

    def _hessian(self, q: Floats) -> Floats:
        """Second derivatives (r, r) of the polynomial at q, or at the last place that they were asked for if that is near."""
        if self._bent is None or abs(self.model.space[::SAMPLE] @ (q - self._bent[0])).max() > FRESH * self.size:
            self._bent = q, self.model.hessian(q)
        return self._bent[1]


def _factor(hessian: Floats) -> tuple[Floats, bool]:
    """Cholesky's factor of a matrix; what it lacks to being positive definite is added to its diagonal."""
    try:
        return cho_factor(hessian, check_finite=False)
    except LinAlgError:
        lowest, largest = np.linalg.eigvalsh(hessian)[[0, -1]]
        return cho_factor(hessian + (SOFTEST * largest - lowest) * np.eye(len(hessian)), check_finite=False)


def _rotation(rest: Floats, now: Floats) -> Floats:
    """The rotation (3, 3) that best takes points (k, 3) to others; the identity where they lie on a line."""
    left, stretch, right = np.linalg.svd(now.T @ (rest - rest.mean(axis=0)))
    if stretch[1] < 1e-6 * stretch[0] or stretch[0] == 0:
        return np.eye(3)
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
