"""Contact in one Newton step: what an obstacle is to the body at the points that are near it.

Legend: N nodes, q points of a zone near the obstacle, k of them, n nodes behind those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.contact.conditions import Zone
from physics.linalg.multigrid import Felt

Floats = NDArray[np.float64]


@dataclass
class Touch:
    """Contact at displacements u (N, 3): gaps (q,) [m], normals (q, 3) and forces (q,) [N] at the points of a zone."""

    zone: Zone
    u: Floats
    centre: Floats  # (3,) of the obstacle, of several (K, 3)
    gap: Floats
    normal: Floats
    pressure: Floats

    def rows(self, points: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Of k points of the zone: n nodes of it behind them, G (k, 3 n) their gaps' gradient, and B (b, 3 n) of `Zone.bend`."""
        nodes, pressed = self.zone.behind(points)[0], points[self.pressure[points] > 0]
        return (nodes, self.zone.gradient(points, nodes, self.normal),
                self.zone.bend(pressed, nodes, self.pressure[pressed], self.u, self.centre))

    def felt(self, points: NDArray[np.int64]) -> Felt:
        """Contact at some points of the zone, as the linear algebra takes it."""
        _, gradient, bend = self.rows(points)
        found = Felt(self.zone.behind(points)[1], gradient, bend, self.gap[points], self.zone.softness[points], self.pressure[points])
        obstacle = self.zone.obstacle.among(points)
        if len(obstacle.each) > 1:  # which may press against each other
            found.reaction = float(np.linalg.norm(obstacle.sums(found.pressed, self.normal[points]), axis=1).sum())
        return found


class Condensed:
    """A body of stiffness K' = K - B^T B as k points of contact feel it: B is what a round obstacle takes from it.

    By Woodbury's formula, with the compliance K^-1 of the kept factor, T = 1 - B K^-1 B^T and X = B K^-1 G^T:

    matrix: (k, k) G K'^-1 G^T + diag(c) = G K^-1 G^T + X^T T^-1 X + diag(c)
    across: (b, k) X
    negative: eigenvalues of K' below zero: those of K and those of T
    """

    def __init__(self, matrix: Floats, across: Floats, left: Floats, negative: int) -> None:
        self.across, self.negative = across, negative
        if np.trace(left) < len(left) - 1:  # else no eigenvalue of B K^-1 B^T can reach 1
            self.negative += int((np.linalg.eigvalsh(left) < 0).sum())
        self._inverse = np.linalg.inv(left) if len(left) else left
        self.matrix = matrix + across.T @ self._inverse @ across

    def turn(self, rows: Floats) -> Floats:
        """T^-1 times (b,)."""
        return self._inverse @ rows
