"""Where the next state of a path is looked for: on a polynomial through the last ones. Legend: N nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.equilibrium.newton import State

Floats = NDArray[np.float64]

HALVINGS = 6  # of a step whose end cannot be reached at once


def extrapolate(states: list[State], fraction: float) -> Floats:
    """Displacements (N, 3) of the polynomial through some states (Lagrange's form), at another fraction."""
    at = [state.fraction for state in states]
    weights = [np.prod([(fraction - t) / (s - t) for t in at if t != s]) for s in at]
    return sum((weight * state.u for weight, state in zip(weights, states, strict=True)), np.zeros_like(states[0].u))


def best_order(states: list[State], state: State) -> int:
    """The order, up to three, of the polynomial through the last states that would have foreseen the next one best."""
    errors = [np.linalg.norm(extrapolate(states[-1 - order:], state.fraction) - state.u) for order in range(min(4, len(states)))]
    return int(np.argmin(errors))
