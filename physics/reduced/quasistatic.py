"""A quasi-static state from the obstacle's pose: an estimate of what finite elements would find, for a network to correct.

How a body moves in a small space and yields locally at one pose stands in pose.py. c = Phi^T f(u) - dW/dq, what the body's own law
has beyond the polynomial W, is computed at a few poses of the path and interpolated between them. At some of these poses the
answer of the rest stiffness, turned with the body, to the forces that are left over joins the space. Each pose is solved from the
pose before. Legend: N body nodes, M = 3 N, T frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from physics.contact.conditions import ContactSurface
from physics.contact.obstacles import Rigid
from physics.mesh.mesh import Mesh
from physics.reduced.elastic import Elastic
from physics.reduced.pose import Press
from physics.reduced.space import Reduced, derivatives
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.float64]
KEYS = 12  # poses at which the body's own law is evaluated
ENRICHING = (0.35, 0.7, 1.0)  # where on the touching part of the path the space is enriched
ENRICHMENTS = 2  # rounds of it at most
ENOUGH = 1e-2  # cell sizes: when the answers are smaller, one round is enough
ROUNDS = 2  # evaluations of the body's own law at a pose
STRIDE = 0.2  # cell sizes: from pose to pose where c is computed; longer ones may miss that the body slides off sideways


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
        self.centres = centres
        self._way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])  # (T,) [m] along the path
        rest = self.surface.positions(mesh.points)
        # Where the obstacle overlaps the body at rest. Later on it may be so deep that it no longer does.
        self.overlaps = np.array([self.obstacle.gap(rest, centre)[0].min() < 0 for centre in self.centres])
        if self.overlaps.any():
            self._prepare(mesh, held, scene, rest)

    def _prepare(self, mesh: Mesh, held: NDArray[np.bool_], scene: Scene, rest: Floats) -> None:
        elastic = Elastic(mesh, held, scene.material.law, scene.material.poisson_ratio)
        first = int(self.overlaps.argmax())
        gap, normal = self.obstacle.gap(rest, self.centres[first])
        depth = -min(self.obstacle.gap(rest, self.centres[i])[0].min() for i in np.flatnonzero(self.overlaps))
        loads = _loads(self.surface, rest, rest[gap.argmin()], normal[gap.argmin()], self.size, mesh)
        loads[elastic.held] = 0.0
        self._move_in(Press(mesh, self.size, self.surface, self.obstacle, elastic, Reduced(elastic, derivatives(elastic, loads, depth))))
        last = len(self.centres) - 1
        farthest = first + int(np.linalg.norm(self.centres[first:] - self.centres[first], axis=1).argmax())
        poses = first + np.unique((np.array(ENRICHING) * (farthest - first)).round().astype(int))
        keys = first + np.unique(np.linspace(0, last - first, KEYS + 1).round().astype(int))[min(1, last - first):]
        # where the obstacle stands still nothing changes: of frames at one place the first, and none at the place of the start
        start = self._way[max(first - 1, 0)]
        poses, keys = (frames[np.unique(self._way[frames], return_index=True)[1]] for frames in (poses, keys))
        poses, keys = poses[self._way[poses] > start], keys[self._way[keys] > start]
        if not len(keys):
            return
        left = self._march(poses, poses)
        for _ in range(ENRICHMENTS):
            self._move_in(self._press.within(Reduced(elastic, [*self._press.model.space.T, *left])))
            left = self._march(keys, keys[np.minimum(np.searchsorted(keys, poses), len(keys) - 1)])
            if max((abs(answer).max() for answer in left), default=0.0) < ENOUGH * self.size:
                break

    def _move_in(self, press: Press) -> None:
        """Take another space, of which nothing is known yet."""
        self._press, self._beyond = press, PchipInterpolator([0.0, 1.0], np.zeros((2, press.model.space.shape[1])))

    def _march(self, frames: NDArray[np.int64], kept: NDArray[np.int64]) -> list[Floats]:
        """Solve poses in order with the body's own law and keep c; gives the answers (M,) to what some of them leave over."""
        body, left = self._press, []
        model, state = body.model, body.rest(self.centres[0])
        at, beyond = [self._way[max(int(self.overlaps.argmax()) - 1, 0)]], [np.zeros(model.space.shape[1])]
        last = max(int(self.overlaps.argmax()) - 1, 0)
        for frame in frames.tolist():
            slope = (beyond[-1] - beyond[-2]) / (at[-1] - at[-2]) if len(at) > 1 else np.zeros_like(beyond[0])
            for stop in self._stops(last, frame, STRIDE * self.size):
                c = beyond[-1] + slope * (self._way[stop] - at[-1])
                state = body.advance(self.centres[stop], state, c)
            last = frame
            for _ in range(ROUNDS):
                force = body.elastic.internal(body.displacement(state).ravel())
                if np.isfinite(force).all():  # no cell is inside out
                    c = model.space.T @ force - model.slope(state.q)
                state = body.advance(self.centres[frame], state, c)
            if frame in kept and (over := body.left_over(state)) is not None:
                left.append(over)
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
        body, last = self._press, max(int(self.overlaps.argmax()) - 1, 0)
        rest = state = body.rest(self.centres[0])
        for row, frame in enumerate(frames):
            if frame < self.overlaps.argmax():
                continue
            for stop in self._stops(last, frame, self.size):
                way = min(max(self._way[stop], self._beyond.x[0]), self._beyond.x[-1])
                state = body.advance(self.centres[stop], state, self._beyond(way))
            last = frame
            if not state.pressure.any() and not self.overlaps[frame]:  # nothing holds the body away from rest
                state = replace(rest, centre=self.centres[frame])
                continue
            out[row] = body.displacement(state)
            if (over := body.left_over(state)) is not None:
                answer[row] = over.reshape(-1, 3)
        return out, answer

    def _stops(self, start: int, end: int, stride: float) -> list[int]:
        """Frames between two, the last one included, about a stride [m] apart along the path."""
        count = max(1, int(np.ceil((self._way[end] - self._way[start]) / stride)))
        return np.unique(np.linspace(start, end, count + 1).round().astype(int))[1:].tolist()


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


