"""How far loads and supports are at a fraction of the steps: along a straight line, or by a table.

A load or a support with a table has, between the rows (steps_i, factor_i), the share of its full value that lies on the straight line
between them; without one the share is the fraction itself. A support may turn its place, too: with the share s, all of its nodes go by

    u(x) = s d + (R(s angle) - 1) (x - c)        R the rotation about an axis through c (Rodrigues' formula)

Legend: N nodes, n of a place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.mesh.mesh import Mesh
from physics.scene import Load, Scene, Support
from physics.schema import InputError

Floats = NDArray[np.float64]


def share(part: Load | Support, fraction: float) -> float:
    """Of the full load or displacement, at a fraction 0 .. 1 of the steps."""
    return fraction if part.steps is None or part.factor is None else float(np.interp(fraction, part.steps, part.factor))


def largest_share(part: Load | Support) -> float:
    """Of the full load or displacement, over all steps, without its sign."""
    return 1.0 if part.factor is None else max(map(abs, part.factor))


def scheduled(part: Load | Support) -> bool:
    """Whether a part does not simply grow with the steps."""
    return part.steps is not None or (isinstance(part, Support) and part.angle is not None)


class Moves:
    """What the supports of a scene prescribe.

    target: (N, 3) displacements [m] at the last step of the components that grow evenly, zero elsewhere
    nodes: (N,) True where a node moves at some step
    varied: whether some move otherwise, by a table or a turn
    """

    def __init__(self, scene: Scene, mesh: Mesh) -> None:
        """Raises `InputError`: two supports give one component of a node different displacements."""
        self.target, self._points = np.zeros_like(mesh.points), mesh.points
        self._others = [(mesh.place(support.where), support) for support in scene.support if scheduled(support) and moves(support)]
        self.varied, self.nodes = bool(self._others), np.zeros(len(mesh.points), bool)
        given: NDArray[np.int64] = np.full(mesh.points.shape, -1)  # the support of each component
        for i, support in enumerate(scene.support):
            nodes = mesh.place(support.where)
            for letter in support.fixed:
                axis = "xyz".index(letter)
                value, others = support.displacement[axis], np.unique(given[nodes, axis])
                for other in others[others >= 0]:
                    if _motion(support, axis) != _motion(scene.support[other], axis):
                        raise InputError(f"support[{i}]: gives the {letter} displacement of nodes at {support.where!r} as {value:g} m"
                                         f"{', by a table or a turn' * scheduled(support)}, another support gives another")
                given[nodes, axis] = i
                if not scheduled(support):
                    self.target[nodes, axis] = value
            self.nodes[nodes] |= moves(support)

    def at(self, fraction: float) -> Floats:
        """(N, 3) displacements [m] at a fraction of the steps, zero on components that are not held."""
        found = fraction * self.target
        for nodes, support in self._others:
            part = share(support, fraction)
            u = np.broadcast_to(part * np.array(support.displacement), (len(nodes), 3))
            if support.angle is not None:
                u = u + turned(self._points[nodes], support, part) - self._points[nodes]
            for letter in support.fixed:
                found[nodes, "xyz".index(letter)] = u[:, "xyz".index(letter)]
        return found


def moves(support: Support) -> bool:
    """Whether a support moves what it holds at all."""
    return any(support.displacement) or bool(support.angle)


def turned(points: Floats, support: Support, part: float) -> Floats:
    """Points (n, 3) turned by a share of a support's angle about its axis through its centre, by default the mean of the points."""
    assert support.angle is not None and support.axis is not None
    axis, angle = np.array(support.axis) / np.linalg.norm(support.axis), np.radians(part * support.angle)
    centre = points.mean(axis=0) if support.centre is None else np.array(support.centre)
    arm = points - centre
    across = np.cross(axis, arm)
    return centre + arm + np.sin(angle) * across + (1 - np.cos(angle)) * np.cross(axis, across)


def _motion(support: Support, axis: int) -> tuple[object, ...]:
    """What has to be the same of two supports that hold one component."""
    if not support.displacement[axis] and not support.angle:
        return (0.0,)
    turn = (support.angle, support.axis, support.centre, support.centre is None and support.where) if support.angle else ()
    return (support.displacement[axis], support.steps, support.factor, turn)
