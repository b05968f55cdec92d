"""Predictions led back to equilibrium: each frame followed by Newton steps, contact included.

A guess u of the equilibrium at a fraction of the loading becomes u + K^-1 (b + contact - f(u)), `count` times, with one
factor of K kept over the frames for as long as it serves (newton.py). Without a count the steps go on until the solver's own
tolerance: what comes out then is its solution, whatever the guess was, unless that lay nearer to another equilibrium.

Legend: N nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.state import State
from physics.mesh.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.float64]


class Corrector:
    """Takes guesses one frame after the other, along the path.

    Attributes:
        iterations: Newton steps so far; factorisations: factors so far
    """

    def __init__(self, scene: Scene, mesh: Mesh, *, count: int | None = 1) -> None:
        """Args: count Newton steps for each frame, at most; None: to the solver's tolerance."""
        self.balance, self.count = Balance(scene, mesh), count
        self.newton = Newton(self.balance)
        contact = self.balance.contact
        self._last = State(0.0, np.zeros_like(mesh.points), np.zeros(0 if contact is None else len(contact.surface.area)))
        self.iterations = 0

    def __call__(self, u: Floats, fraction: float) -> Floats:
        """Displacements (N, 3) after the steps; held components are put on their prescription.

        Raises:
            NoEquilibrium: no step can be made from there, or no equilibrium is reached from it
        """
        start = np.where(self.balance.fixed, self.balance.moved(fraction), np.asarray(u, np.float64))
        if not self._last.u.any() and self.balance.rests(fraction):  # before anything touches the rest state is the solution
            return np.zeros_like(start)
        if self.count is None:
            state = self.newton.equilibrium(fraction, start, self._last)
        else:
            state = self.newton.improve(fraction, start, self._last, count=self.count)
        self._last = state
        self.iterations += state.iterations
        return state.u

    @property
    def factorisations(self) -> int:
        return self.newton.factorisations
