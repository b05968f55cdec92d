"""A quasi-static state from the obstacle's pose: an estimate of what finite elements would find, for a network to correct.

The body moves in a space of some thirty functions (reduced.py) and yields locally as it would at rest, turned with the touched
patch by the rotation R:

    u = Phi q + R (K^-1 - Phi Phi^T) R^T sum_a p_a n_a,    dW/dq + c = Phi^T sum_a p_a n_a,
    gap_a >= 0,  p_a >= 0,  p_a gap_a = 0                  at the points of the surface where contact is felt

p are contact forces along the obstacle's normals n. c = Phi^T f(u) - dW/dq is what the body's own law has beyond the polynomial W;
it is computed at a few poses of the path and interpolated between them. At some of these poses the answer of the rest stiffness,
turned with the body, to the forces that are left over joins the space. Each pose is solved by Newton's method from the pose before.

Legend: N body nodes, M = 3 N, T frames, A points of contact, r size of the space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from physics.contact.conditions import ContactSurface, solve_complementarity
from physics.contact.obstacles import Rigid
from physics.mesh.mesh import Mesh
from physics.reduced.elastic import Elastic
from physics.reduced.space import Reduced, derivatives
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.float64]
KEYS = 12  # poses at which the body's own law is evaluated
ENRICHING = (0.35, 0.7, 1.0)  # where on the touching part of the path the space is enriched
ENRICHMENTS = 2  # rounds of it at most
ENOUGH = 1e-2  # cell sizes: when the answers are smaller, one round is enough
ITERATIONS = 40
LOOSE = 1e-3  # cell sizes: a last step that may be left over where points of contact go in circles
HALVINGS = 6
FRESH = 0.02  # cell sizes: after a larger step second derivatives are computed anew
ROUNDS = 2  # evaluations of the body's own law at a pose
SAMPLE = 50  # components of which one is looked at for convergence
STRIDE = 0.2  # cell sizes: from pose to pose where c is computed; longer ones may miss that the body slides off sideways
REACH = 1.5  # cell sizes: points with a smaller gap are looked at
NEAR = 0.5  # cell sizes: points with a smaller gap take part in contact
DIFFERENCE = 1e-4  # cell sizes
SOFTEST = 1e-6  # smallest curvature of the energy over the largest
TOLERANCE = 1e-6  # of the largest extent: displacement in Newton's last step
STIFFNESS = 2e4  # of contact, in units of Young's modulus over the size of a cell


@dataclass(frozen=True)
class _Pressed:
    """A body under the obstacle at a centre (3,): q (r,), local (N, 3) [m] beyond the small space; pressure (A,), push (M,) of contact."""

    centre: Floats
    q: Floats
    local: Floats
    pressure: Floats
    push: Floats


class Estimator:
    """Estimates for one body and its obstacle, at any pose of a path."""

    def __init__(self, scene: Scene, mesh: Mesh, held: NDArray[np.bool_], centres: Floats) -> None:
        """Args: held (N,) nodes; centres (T, 3) [m] of the obstacle in each frame.

        Raises `InputError` for a scene that is not a body held at whole nodes and pressed by a rigid obstacle alone.
        """
        moved = [support for support in scene.support if any(support.displacement) or set(support.fixed) != set("xyz")]
        if scene.obstacle is None or scene.load or moved or scene.body.element != "standard" or scene.steps.dynamic:
            raise InputError("the network corrects estimates, which know clamped bodies pressed by an obstacle alone: no loads, sliding "
                             "or moving supports, elements other than standard, or inertia; one trained with estimate = false takes such "
                             "scenes")
        self.mesh, self.obstacle = mesh, Rigid(scene.obstacle)
        self.size = float(np.median(np.linalg.norm(np.diff(mesh.points[mesh.edges], axis=1), axis=2)))
        self.surface = ContactSurface(mesh, scene.obstacle.contact, held)
        self._softness = self.size / (STIFFNESS * self.surface.area)
        self._tolerance = TOLERANCE * float(np.ptp(mesh.points, axis=0).max())
        self.centres = centres
        self._way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])  # (T,) [m] along the path
        rest = self.surface.positions(mesh.points)
        # Where the obstacle overlaps the body at rest. Later on it may be so deep that it no longer does.
        self.overlaps = np.array([self.obstacle.gap(rest, centre)[0].min() < 0 for centre in self.centres])
        if self.overlaps.any():
            self._prepare(mesh, held, scene, rest)

    def _prepare(self, mesh: Mesh, held: NDArray[np.bool_], scene: Scene, rest: Floats) -> None:
        self._elastic = Elastic(mesh, held, scene.material.law, scene.material.poisson_ratio)
        first = int(self.overlaps.argmax())
        gap, normal = self.obstacle.gap(rest, self.centres[first])
        depth = -min(self.obstacle.gap(rest, self.centres[i])[0].min() for i in np.flatnonzero(self.overlaps))
        loads = _loads(self.surface, rest, rest[gap.argmin()], normal[gap.argmin()], self.size, mesh)
        loads[self._elastic.held] = 0.0
        vectors = derivatives(self._elastic, loads, depth)
        self._model = Reduced(self._elastic, vectors)
        last = len(self.centres) - 1
        farthest = first + int(np.linalg.norm(self.centres[first:] - self.centres[first], axis=1).argmax())
        poses = first + np.unique((np.array(ENRICHING) * (farthest - first)).round().astype(int))
        keys = first + np.unique(np.linspace(0, last - first, KEYS + 1).round().astype(int))[min(1, last - first):]
        # where the obstacle stands still nothing changes: of frames at one place the first, and none at the place of the start
        start = self._way[max(first - 1, 0)]
        poses, keys = (frames[np.unique(self._way[frames], return_index=True)[1]] for frames in (poses, keys))
        poses, keys = poses[self._way[poses] > start], keys[self._way[keys] > start]
        self._restart()
        if not len(keys):
            return
        left = self._march(poses, poses)
        for _ in range(ENRICHMENTS):
            self._model = Reduced(self._elastic, [*self._model.space.T, *left])
            self._restart()
            left = self._march(keys, keys[np.minimum(np.searchsorted(keys, poses), len(keys) - 1)])
            if max((abs(answer).max() for answer in left), default=0.0) < ENOUGH * self.size:
                break

    def _restart(self) -> None:
        """Forget what was computed with another space."""
        self._known = np.zeros(0, np.int64)  # nodes whose local answers are known
        self._answers = np.zeros((self._elastic.size, 0))  # K^-1 - Phi Phi^T, three columns a node
        self._beyond = PchipInterpolator([0.0, 1.0], np.zeros((2, self._model.space.shape[1])))

    def _march(self, frames: NDArray[np.int64], kept: NDArray[np.int64]) -> list[Floats]:
        """Solve poses in order with the body's own law and keep c; gives the answers (M,) to what some of them leave over."""
        model, state, left = self._model, self._rest(), []
        at, beyond = [self._way[max(int(self.overlaps.argmax()) - 1, 0)]], [np.zeros(model.space.shape[1])]
        last = max(int(self.overlaps.argmax()) - 1, 0)
        for frame in frames.tolist():
            slope = (beyond[-1] - beyond[-2]) / (at[-1] - at[-2]) if len(at) > 1 else np.zeros_like(beyond[0])
            for stop in self._stops(last, frame, STRIDE * self.size):
                c = beyond[-1] + slope * (self._way[stop] - at[-1])
                state = self._advance(self.centres[stop], state, c)
            last = frame
            for _ in range(ROUNDS):
                u = self._displacement(state).ravel()
                force = self._elastic.internal(u)
                if np.isfinite(force).all():  # no cell is inside out
                    c = model.space.T @ force - model.slope(state.q)
                state = self._advance(self.centres[frame], state, c)
            if frame in kept:
                u = self._displacement(state).ravel()
                if np.isfinite(force := self._elastic.internal(u)).all():
                    left.append(self._elastic.answer(u, state.push - force))
            at.append(self._way[frame])
            beyond.append(c)
        self._beyond = PchipInterpolator(at, np.array(beyond))
        return left

    def frames(self, frames: Sequence[int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(F, N, 3) displacements [m] at some frames of the path, in ascending order, and the answers of the rest
        stiffness, turned with the body, to the forces that each of them leaves over (F, N, 3) [m]."""
        shape = (len(frames), *self.mesh.points.shape)
        out, answer = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        if not self.overlaps.any():
            return out, answer
        state, last = self._rest(), max(int(self.overlaps.argmax()) - 1, 0)
        for row, frame in enumerate(frames):
            if frame < self.overlaps.argmax():
                continue
            for stop in self._stops(last, frame, self.size):
                way = min(max(self._way[stop], self._beyond.x[0]), self._beyond.x[-1])
                state = self._advance(self.centres[stop], state, self._beyond(way))
            last = frame
            if not state.pressure.any() and not self.overlaps[frame]:  # nothing holds the body away from rest
                state = replace(self._rest(), centre=self.centres[frame])
                continue
            out[row] = u = self._displacement(state)
            force = self._elastic.internal(u.ravel())
            if np.isfinite(force).all():
                answer[row] = self._elastic.answer(u.ravel(), state.push - force).reshape(-1, 3)
        return out, answer

    def _stops(self, start: int, end: int, stride: float) -> list[int]:
        """Frames between two, the last one included, about a stride [m] apart along the path."""
        count = max(1, int(np.ceil((self._way[end] - self._way[start]) / stride)))
        return np.unique(np.linspace(start, end, count + 1).round().astype(int))[1:].tolist()

    def _rest(self) -> _Pressed:
        size, surface = self._elastic.size, len(self.surface.area)
        return _Pressed(self.centres[0], np.zeros(self._model.space.shape[1]), np.zeros((size // 3, 3)), np.zeros(surface), np.zeros(size))

    def _displacement(self, state: _Pressed) -> Floats:
        return (self._model.space @ state.q).reshape(-1, 3) + state.local

    def _advance(self, centre: Floats, state: _Pressed, c: Floats, depth: int = 0) -> _Pressed:
        """The state at a pose, from one at another pose: in one go, or in two halves where that does not lead there.

        Where 2^-HALVINGS of the way is still too far, the body stays as it is: the forces left over tell how bad the estimate is.
        """
        way = centre - state.centre
        if np.linalg.norm(way) <= self.size and (found := self._newton(centre, state, c)) is not None:
            return found
        if depth == HALVINGS:
            return replace(state, centre=centre)
        state = self._advance(state.centre + way / 2, state, c, depth + 1)
        return self._advance(centre, state, c, depth + 1)

    def _newton(self, centre: Floats, state: _Pressed, c: Floats) -> _Pressed | None:
        """The state at a pose from one nearby; None where Newton's method does not find it."""
        space, rest = self._model.space, self.mesh.points
        gap, _ = self.obstacle.gap(self.surface.weights @ (rest + self._displacement(state)), centre)
        zone = np.flatnonzero((gap < REACH * self.size) | (state.pressure > 0))
        if not len(zone):
            if not state.q.any():
                return replace(state, centre=centre)
            zone = gap.argmin(keepdims=True)
        rows = self.surface.weights[zone]
        nodes = np.unique(rows.indices).astype(np.int64)
        component = (3 * nodes[:, None] + np.arange(3)).ravel()
        weights, softness = rows[:, nodes].toarray(), self._softness[zone]
        zone_space, zone_rest = space[component], rest[nodes]
        q, local, pressure = state.q, state.local[nodes], state.pressure[zone]
        hessian = self._model.hessian(q)
        for _ in range(ITERATIONS):
            moved = zone_rest + (zone_space @ q).reshape(-1, 3)
            turn = _rotation(zone_rest, moved)
            gap, normal = self.obstacle.gap(weights @ (moved + local), centre)
            near = np.flatnonzero((gap < max(NEAR * self.size, 1.001 * gap.min())) | (pressure > 0))
            w, n = weights[near], normal[near]
            held = np.flatnonzero(w.any(axis=0))  # nodes behind the near points
            columns = self._columns(nodes[held])
            answers = self._answers[np.ix_(component, columns)]  # (3 k, 3 h)
            along = (w[:, :, None] * n[:, None, :]).reshape(len(near), -1)  # (a, 3 k) gap by displacement
            turned = (w[:, :, None] * (n @ turn)[:, None, :]).reshape(len(near), -1)
            pushed = turned[:, (3 * held[:, None] + np.arange(3)).ravel()]  # (a, 3 h)
            in_space = along @ zone_space  # (a, r)
            pushing = np.flatnonzero(pressure[near] > 0)
            at = (w[pushing] @ zone_space.reshape(len(nodes), -1)).reshape(len(pushing), 3, len(q))  # (b, 3, r)
            curved = np.einsum("b,bij->bij", pressure[near[pushing]], self._turning(w[pushing] @ (moved + local), centre))
            factor = _factor(hessian - np.einsum("bir,bij,bjs->rs", at, curved, at, optimize=True))
            reply = cho_solve(factor, np.column_stack([in_space.T, self._model.slope(q) + c]), check_finite=False)
            matrix = in_space @ reply[:, :-1] + turned @ answers @ pushed.T
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
                hessian = self._model.hessian(q)
        else:
            if change > LOOSE * self.size:
                return None
        whole, push = np.zeros_like(state.pressure), np.zeros(len(space))
        whole[zone], push[component] = pressure, along.T @ p
        push[self._elastic.held] = 0.0
        return _Pressed(centre, q, (self._answers[:, columns] @ force).reshape(-1, 3) @ turn.T, whole, push)

    def _turning(self, points: Floats, centre: Floats) -> Floats:
        """(b, 3, 3) derivative of the obstacle's normals by the places (b, 3) [m], by central differences."""
        change = DIFFERENCE * self.size * np.eye(3)
        return np.stack([(self.obstacle.gap(points + d, centre)[1] - self.obstacle.gap(points - d, centre)[1]) / (2 * d.max())
                         for d in change], axis=2)

    def _columns(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Where the answers to forces on some nodes stand among the known ones; those not known yet are solved for."""
        new = np.setdiff1d(nodes, self._known)
        if len(new):
            forces = np.zeros((self._elastic.size, 3 * len(new)))
            forces[(3 * new[:, None] + np.arange(3)).ravel(), np.arange(3 * len(new))] = 1.0
            forces[self._elastic.held] = 0.0
            space = self._model.space
            answers = self._elastic.solve(forces) - space @ (space.T @ forces)
            self._known = np.concatenate([self._known, new])
            self._answers = np.concatenate([self._answers, answers], axis=1)
        order = np.argsort(self._known)
        at = order[np.searchsorted(self._known, nodes, sorter=order)]
        return (3 * at[:, None] + np.arange(3)).ravel()


def _factor(hessian: Floats) -> tuple[Floats, bool]:
    """Cholesky's factor of a matrix; what it lacks to being positive definite is added to its diagonal."""
    try:
        return cho_factor(hessian, check_finite=False)
    except LinAlgError:
        lowest, largest = np.linalg.eigvalsh(hessian)[[0, -1]]
        return cho_factor(hessian + (SOFTEST * largest - lowest) * np.eye(len(hessian)), check_finite=False)


def _loads(surface: ContactSurface, rest: Floats, centre: Floats, normal: Floats, size: float, mesh: Mesh) -> Floats:
    """(M, 7) bell-shaped loads on the surface around a point: along the normal, along two tangents, and beside it four times."""
    axis = np.linalg.svd(mesh.points - mesh.points.mean(axis=0), full_matrices=False)[2][0]
    tangent = axis - (axis @ normal) * normal
    if np.linalg.norm(tangent) < 0.1:
        tangent = np.cross(normal, np.eye(3)[abs(normal).argmin()])
    tangent /= np.linalg.norm(tangent)
    across = np.cross(normal, tangent)

    def bell(at: Floats, direction: Floats) -> Floats:
        weight = np.exp(-((rest - at) ** 2).sum(axis=1) / (2 * size**2)) * surface.area
        return (surface.weights.T @ (weight[:, None] / weight.sum() * direction)).ravel()

    middle = bell(centre, normal)
    beside = [(bell(centre + 2 * size * t, normal), bell(centre - 2 * size * t, normal)) for t in (tangent, across)]
    return np.stack([middle, bell(centre, tangent), bell(centre, across), *(a - b for a, b in beside),
                     *(a + b - 2 * middle for a, b in beside)], axis=1)


def _rotation(rest: Floats, now: Floats) -> Floats:
    """The rotation (3, 3) that best takes points (k, 3) to others; the identity where they lie on a line."""
    a, b = rest - rest.mean(axis=0), now - now.mean(axis=0)
    left, stretch, right = np.linalg.svd(b.T @ a)
    if stretch[1] < 1e-6 * stretch[0] or stretch[0] == 0:
        return np.eye(3)
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
