"""Several rigid obstacles, felt as one: each by its own points of the body's surface, one set of points after the other.

A point that can touch two obstacles stands there twice, with two gaps and two forces. `Rigids` is to all points what `Rigid` is where
there is one obstacle; what speaks of a part of the points takes `among` them.

Legend: K obstacles, Q points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physics.contact.obstacles import Rigid

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Rigids:
    """Obstacles, and the number (Q,) of the one that each point may touch; centres are (K, 3)."""

    def __init__(self, each: Sequence[Rigid], of: Integers) -> None:
        self.each, self._of, self.width = tuple(each), of, min(rigid.width for rigid in each)

    def among(self, points: Integers) -> Rigids:
        """The same for some of the points."""
        return Rigids(self.each, self._of[points])

    def position(self, fraction: float) -> Floats:
        """(K, 3) centres [m] at a fraction 0 .. 1 of the steps."""
        return np.array([rigid.position(fraction) for rigid in self.each])

    def offset(self, points: Floats, centre: Floats) -> Floats:
        """(Q, 3) points seen from the centre of their obstacle."""
        return points - centre[self._of]

    def gap(self, points: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Signed distances (Q,) [m] and normals (Q, 3) of points (Q, 3)."""
        gap, normal = np.empty(len(points)), np.empty((len(points), 3))
        for k, rigid in enumerate(self.each):
            own = self._of == k
            gap[own], normal[own] = rigid.gap(points[own], centre[k])
        return gap, normal

    def bend(self, points: Floats, centre: Floats) -> Floats:
        """(Q, 2, 3) what `Rigid.bend` gives."""
        found = np.empty((len(points), 2, 3))
        for k, rigid in enumerate(self.each):
            found[self._of == k] = rigid.bend(points[self._of == k], centre[k])
        return found

    def along(self, normal: Floats, vector: Floats) -> Floats:
        """(Q,) parts of the vectors (K, 3) of the obstacles along normals (Q, 3)."""
        return np.asarray((normal * vector[self._of]).sum(axis=1))

    def sums(self, force: Floats, normal: Floats) -> Floats:
        """(K, 3) of each obstacle the sum of forces (Q,) along normals (Q, 3)."""
        return np.array([force[self._of == k] @ normal[self._of == k] for k in range(len(self.each))])
