"""Newton steps with a kept factor, corrected by what the last ones left behind.

A factor that has grown old makes steps s(u) that are wrong in a few directions only, the softest ones, and by about the same share
each time. So from the last m differences of displacements and of steps, U = [u_i - u_(i-1)] and S = [s_i - s_(i-1)], the next
displacements are

    u + s - (U + S) c,    c = argmin |s - S c|

(Anderson, J. ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011). Differences are kept over several equilibria, until the
factor is made anew; contact forces are mixed like the displacements, and stay non-negative.

Legend: N nodes, Q contact points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

WINDOW = 3  # differences that are kept; more gain nothing


@dataclass(frozen=True)
class MixingMemory:
    """Differences of the last m steps: of displacements (m, N, 3), steps (m, N, 3) and contact forces (m, Q)."""

    u: Floats
    step: Floats
    pressure: Floats


class Mixing:
    """The last steps, and what follows from them for the next one."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start anew, with another factor."""
        self.differences: list[tuple[Floats, Floats, Floats]] = []
        self.begin()

    def begin(self) -> None:
        """Start another equilibrium with the same factor."""
        self._last: tuple[Floats, Floats, Floats] | None = None

    def memory(self) -> MixingMemory | None:
        return MixingMemory(*map(np.array, zip(*self.differences, strict=True))) if self.differences else None

    def recall(self, memory: MixingMemory | None) -> None:
        """Go on with the factor as the one whose memory this is."""
        self.forget()
        if memory is not None:
            self.differences = list(zip(memory.u, memory.step, memory.pressure, strict=True))

    def next(self, u: Floats, step: Floats, pressure: Floats) -> tuple[Floats, Floats]:
        """Displacements (N, 3) and contact forces (Q,) after a step (N, 3) from u (N, 3) that found the forces (Q,)."""
        if self._last is not None:
            du, ds, dp = u - self._last[0], step - self._last[1], pressure - self._last[2]
            if np.isfinite(ds).all() and ds.any():
                self.differences = [*self.differences, (du, ds, dp)][-WINDOW:]
        self._last = u, step, pressure
        u = u + step
        if not self.differences or not np.isfinite(step).all():
            return u, pressure
        S = np.array([ds.ravel() for _, ds, _ in self.differences])  # (m, 3 N)
        size = np.sqrt((S * S).sum(axis=1))
        # Scaled to a unit diagonal; directions that rounding alone tells apart are left out.
        c = np.linalg.lstsq((S @ S.T) / np.outer(size, size), (S @ step.ravel()) / size, rcond=1e-8)[0] / size
        for share, (du, ds, dp) in zip(c, self.differences, strict=True):
            u, pressure = u - share * (du + ds), pressure - share * dp
        return u, np.maximum(pressure, 0.0)
