"""Quasi-static states along an obstacle's path: what finite elements would find, about; for a network to correct.

How a body moves in a small space and yields locally at one pose stands in pose.py. The path is followed through a few poses, closer
where contact begins. Between two of them another is solved, and more where it is not what those around it foretell: where points of
the surface begin or cease to touch. What lies between the poses is interpolated. c = Phi^T f(u) - dW/dq, what the body's own law has
beyond the polynomial W, is taken from the poses around and put right at each. Before, the space is enriched: at some poses the
answers of the rest stiffness, turned with the body, to the forces that are left over join it. A pose to which Newton's method does
not lead in small steps either is lost: it is left out, and `lost` names it.
Legend: N body nodes, M = 3 N, T frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator, PchipInterpolator

from physics.contact.conditions import ContactSurface, cell_size
from physics.contact.obstacles import Rigid
from physics.mesh.mesh import Mesh
from physics.reduced.elastic import Elastic
from physics.reduced.pose import PoseState, Press
from physics.reduced.space import Reduced, derivatives
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.float64]
POSES, GRADED = 6, 1.6  # first poses along a part of the path, the k-th of n at (k / n)^GRADED of it
STRIDE = 0.5  # cell sizes: the farthest that two poses lie apart; further, and the body may slide off sideways unseen
STRAIGHT = 0.99  # cosine of the angle between two steps from which on the path has no corner
ENRICHING = (0.35, 0.7, 1.0)  # where on the touching part of the path the space is enriched
ENRICHMENTS = 2  # rounds of it at most
ENOUGH = 1e-2  # cell sizes: when the answers are smaller, one round is enough
HALVINGS = 3  # between two of the first poses at most
CLOSE = 1.5e-4  # cell sizes: how far a pose may lie, in the root mean square, from what those around it foretell
ROUNDS = 6  # solutions at a pose at most
MIXED = 4  # of the last of them are mixed
EXACT = 1e-4  # of a cell, or of a smaller displacement: what may be left undone of the body's own law in the small space


@dataclass(frozen=True)
class Solved:
    """A state at one pose; beyond (r,): c there; left (M,): the forces that the state leaves over."""

    state: PoseState
    beyond: Floats
    left: Floats


class Estimator:
    """Estimates for one body and its obstacle, at any pose of a path."""

    def __init__(self, scene: Scene, mesh: Mesh, held: NDArray[np.bool_], centres: Floats, *, rough: bool = False) -> None:
        """Args: held (N,) nodes; centres (T, 3) [m] of the obstacle in each frame; rough: the first poses alone, in the space as it is.

        Raises `InputError` for a scene that is not a body held at whole nodes and pressed by a rigid obstacle alone.
        """
        moved = [support for support in scene.support if any(support.displacement) or set(support.fixed) != set("xyz")]
        if len(scene.obstacles) > 1 or len(scene.materials) > 1:
            raise InputError("the reduced-order model knows one obstacle and one material; a network that does not correct it, trained "
                             "with estimate = false, takes scenes of several")
        if scene.body.plane == "stress":
            raise InputError("the reduced-order model knows no plane stress; a network that does not correct it takes such scenes")
        if not scene.obstacles or scene.load or moved or scene.steps.dynamic:
            raise InputError("the reduced-order model knows clamped bodies pressed by an obstacle alone: no loads, sliding or moving "
                             "supports, or inertia; a network that does not correct it, trained with estimate = false, takes such scenes")
        (obstacle,), (material,) = scene.obstacles, scene.materials
        self.mesh, self.obstacle = mesh, Rigid(obstacle)
        self.size = cell_size(mesh)
        self.surface = ContactSurface(mesh, obstacle.contact, held)
        self.centres = centres
        self._way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])  # (T,) [m] along the path
        rest = self.surface.positions(mesh.points)
        # Where the obstacle overlaps the body at rest. Later on it may be so deep that it no longer does.
        clearance = self._clearance(rest)
        self.overlaps = clearance < 0
        self.lost: list[int] = []  # frames of poses to which no state was found
        self._parts: list[Akima1DInterpolator | PchipInterpolator] = []  # of what `frames` gives, by the way
        self._known: dict[int, Floats] = {}  # what it gives at the poses themselves
        if self.overlaps.any():
            self._prepare(Elastic(mesh, held, material, scene.body.element), rest, -clearance.min(), rough)

    def _clearance(self, rest: Floats) -> Floats:
        """(T,) [m] the smallest gap of points at rest (Q, 3) in each frame. A gap changes by no more than the obstacle moves."""
        found, near, start = np.empty(len(self.centres)), rest, np.full(3, np.inf)
        for frame, centre in enumerate(self.centres):
            if np.linalg.norm(centre - start) > self.size:
                start, (gap, _) = centre, self.obstacle.gap(rest, centre)
                near = rest[gap < gap.min() + 2.001 * self.size]
            found[frame] = self.obstacle.gap(near, centre)[0].min()
        return found

    def _prepare(self, elastic: Elastic, rest: Floats, depth: float, rough: bool) -> None:
        first = int(self.overlaps.argmax())
        gap, normal = self.obstacle.gap(rest, self.centres[first])
        loads = _loads(self.surface, rest, rest[gap.argmin()], normal[gap.argmin()], self.size, self.mesh)
        loads[elastic.held] = 0.0
        press = Press(self.mesh, self.size, self.surface, self.obstacle, elastic, Reduced(elastic, derivatives(elastic, loads, depth)))
        parts = self._pieces(max(first - 1, 0))
        if not parts:  # the obstacle stands still
            return
        poses = np.unique(np.concatenate(parts))
        ahead = np.linalg.norm(self.centres[poses] - self.centres[poses[0]], axis=1)
        ahead = ahead[:ahead.argmax() + 1]  # the way there, not back
        enriching = poses[np.unique([abs(ahead - share * ahead[-1]).argmin() for share in ENRICHING])]
        frames, rounds, halvings = (poses, 0, 0) if rough else (enriching, ENRICHMENTS, HALVINGS)
        for enriched in range(rounds + 1):
            found = self._follow(press, frames)
            if enriched == rounds:
                break
            answers = _answers(press, [found[frame] for frame in enriching.tolist() if frame in found])
            if enriched and abs(answers).max(initial=0.0) < ENOUGH * self.size:
                break
            press, frames = press.within(Reduced(elastic, [*press.model.space.T, *answers])), poses
        self.lost = [frame for frame in poses.tolist() if frame not in found]
        for part in parts:
            for one, other in pairwise([frame for frame in part.tolist() if frame in found]):
                self._refine(press, one, other, part, found, halvings)
        answers = _answers(press, list(found.values())).reshape(len(found), -1, 3)
        self._known = {frame: np.array([press.displacement(one.state), answer])
                       for (frame, one), answer in zip(found.items(), answers, strict=True)}
        for part in parts:
            part = np.array([frame for frame in sorted(found) if part[0] <= frame <= part[-1]])
            if len(part) < 2:
                continue
            smooth = Akima1DInterpolator if len(part) > 2 else PchipInterpolator  # two poses have a straight line between them
            self._parts.append(smooth(self._way[part], np.array([self._known[frame] for frame in part.tolist()])))

    def _pieces(self, start: int) -> list[NDArray[np.int64]]:
        """Frames of the first poses after one, for each part of the path: between its corners, and where overlap begins or ends."""
        steps = np.diff(self.centres, axis=0)
        moving = np.flatnonzero(steps.any(axis=1))
        ways = steps[moving] / np.linalg.norm(steps[moving], axis=1, keepdims=True)
        corners = moving[1:][(ways[1:] * ways[:-1]).sum(axis=1) < STRAIGHT]
        changes = np.flatnonzero(np.diff(self.overlaps))
        ends = np.unique([start, *corners, *changes, *changes + 1, len(steps)])
        parts = (self._poses(one, other) for one, other in pairwise(ends[ends >= start].tolist()))
        return [part for part in parts if len(part) > 1]

    def _poses(self, start: int, end: int) -> NDArray[np.int64]:
        """Frames from one to another, of frames at one place the first."""
        way = self._way[start:end + 1] - self._way[start]
        count = max(POSES, int(np.ceil(GRADED * way[-1] / (STRIDE * self.size))))
        share = np.linspace(0, 1, count + 1) ** GRADED
        return start + np.unique(np.searchsorted(way, way[-1] * (share if self.overlaps[end] else 1 - share[::-1])))

    def _refine(self, press: Press, one: int, other: int, part: NDArray[np.int64], found: dict[int, Solved],
                halvings: int) -> None:
        """Solve a pose between two of a part, and more where it is not what those around it foretell."""
        half = (self._way[one] + self._way[other]) / 2 - 1e-6 * self.size  # on even steps the frame in the middle, whatever is rounded
        middle = one + int(np.searchsorted(self._way[one:other + 1], half))
        if not halvings or not one < middle < other:
            return
        guess = self._foretold([frame for frame in sorted(found) if part[0] <= frame <= part[-1]], found, middle)
        if (solved := self._solved(press, self.centres[middle], guess, found[one])) is None:
            return
        found[middle] = solved
        off = press.displacement(guess.state) - press.displacement(found[middle].state)
        if np.sqrt((off**2).sum(axis=1).mean()) > CLOSE * self.size:
            self._refine(press, one, middle, part, found, halvings - 1)
            self._refine(press, middle, other, part, found, halvings - 1)

    def _foretold(self, known: list[int], found: dict[int, Solved], frame: int) -> Solved:
        """What the polynomial through the nearest of some poses gives for another."""
        at = int(np.searchsorted(known, frame))
        near = known[max(0, min(at - 2, len(known) - 4)):][:4]
        x, ways = self._way[frame], self._way[near]
        shares = [float(np.prod([(x - b) / (a - b) for b in ways if b != a])) for a in ways]
        return _sum(shares, [found[other] for other in near])

    def _follow(self, press: Press, frames: NDArray[np.int64]) -> dict[int, Solved]:
        """Solve poses in order, each from the last two; one to which no state is found is left out."""
        start = max(int(self.overlaps.argmax()) - 1, 0)
        still = np.zeros(press.model.space.shape[1]), np.zeros(self.mesh.points.size)
        last = before = rest = Solved(press.rest(self.centres[start]), *still)
        found = {}
        for frame in frames.tolist():
            centre = self.centres[frame]
            if self.overlaps[frame] or last.state.pressure.any():
                step = last.state.centre - before.state.centre
                share = float((centre - last.state.centre) @ step / (step @ step)) if step.any() else 0.0
                solved = self._solved(press, centre, _sum([1 + share, -share], [last, before]), last)
                if solved is None:
                    continue
                last, before = solved, last
            if not last.state.pressure.any() and not self.overlaps[frame]:  # nothing holds the body away from rest
                last = before = replace(rest, state=replace(rest.state, centre=centre))
            found[frame] = last
        return found

    def _solved(self, press: Press, centre: Floats, guess: Solved, near: Solved) -> Solved | None:
        """A pose, from a guess or, where that does not lead there, from another pose; None where neither does, or a cell is inside out."""
        c, beyond, off = guess.beyond, [], []  # c as it was taken, as it then was, and what that was off
        state = press.newton(centre, guess.state, c) or press.advance(centre, near.state, c)
        if state is None:
            return None
        while True:
            u = press.displacement(state).ravel()
            force = press.elastic.internal(u)
            if not np.isfinite(force).all():
                return None
            beyond.append(press.model.space.T @ force - press.model.slope(state.q))
            off.append(beyond[-1] - c)
            if len(off) == ROUNDS or abs(press.model.space @ off[-1]).max() < EXACT * min(self.size, abs(u).max()):
                break
            c = _mixed(beyond, off)
            if (closer := press.newton(centre, state, c)) is None:
                break
            state = closer
        return Solved(state, beyond[-1], state.push - force)

    def frames(self, frames: Sequence[int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(F, N, 3) displacements [m] at some frames of the path, and the answers of the rest stiffness, turned with the body, to
        the forces that each of them leaves over (F, N, 3) [m]."""
        found = np.zeros((2, len(frames), *self.mesh.points.shape), np.float32)
        starts = [part.x[0] for part in self._parts]
        for row, frame in enumerate(frames):
            way = self._way[frame]
            number = int(np.searchsorted(starts, way, side="right")) - 1
            if frame in self._known:
                found[:, row] = self._known[frame]
            elif number >= 0:
                found[:, row] = self._parts[number](min(way, self._parts[number].x[-1]))
        return found[0], found[1]


def _answers(press: Press, solved: list[Solved]) -> Floats:
    """(k, M) [m] what the rest stiffness, turned with the body, answers to the forces that k poses leave over."""
    if not solved:
        return np.zeros((0, press.elastic.size))
    moved = np.array([press.displacement(one.state).ravel() for one in solved])
    return press.elastic.answers(moved, np.array([one.left for one in solved]))


def _mixed(beyond: list[Floats], off: list[Floats]) -> Floats:
    """c to be taken next: the sum of the last ones, shares one in total, that is off the least (Anderson 1965)."""
    last = slice(-MIXED, None)
    shares, *_ = np.linalg.lstsq(np.diff(off[last], axis=0).T, off[-1], rcond=1e-6)
    return np.asarray(beyond[-1] - shares @ np.diff(beyond[last], axis=0))


def _sum(shares: list[float], solved: list[Solved]) -> Solved:
    """The sum of some poses, each times a share; the obstacle is where it is in the first, and nothing pulls."""
    def added(values: Iterable[Floats]) -> Floats:
        return np.asarray(sum(share * value for share, value in zip(shares, values, strict=True)))

    states = [one.state for one in solved]
    state = replace(states[0], q=added(one.q for one in states), local=added(one.local for one in states),
                    pressure=np.maximum(added(one.pressure for one in states), 0))
    return Solved(state, added(one.beyond for one in solved), solved[0].left)


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


