"""Where the Newton steps of a predicted frame begin.

A prediction that is off by a smooth 1e-5 m stretches a slender body along its axis, and a Newton step turns that false stress into
a bend many times as large. What frames before were corrected by, and to, is known. So there are three places to begin at:

    guess           the prediction itself
    carried         the prediction, moved as the last one was by its correction
    extrapolated    the polynomial through the last corrected states, of the order that would have foreseen the last one best

in the order in which they would have been near to the last state. Legend: N nodes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physics.equilibrium.state import State, best_order, polynomial

Floats = NDArray[np.float64]

GROWTH = 1.2  # a prediction's error seldom grows by more from one frame to the next


class Starts:
    """What is known of the frames before.

    states: the last corrected ones
    off: how far predictions are from their states, as a norm over all nodes [m]; after one frame that is far off it grows only by GROWTH
    """

    def __init__(self, rest: State) -> None:
        self.states, self.off = [rest], np.inf
        self._order, self._moved = 0, np.zeros_like(rest.u)
        self._miss = {"guess": 0.0, "carried": np.inf, "extrapolated": 1.0}  # [m] of each, at the last frame

    def ranked(self, fraction: float, guess: Floats) -> list[Floats]:
        """Displacements (N, 3) to begin at, the likeliest first, for a guess (N, 3); the guess is one of them, as the same object."""
        found = self._places(fraction, guess)
        return [found[name] for name in sorted(found, key=lambda name: self._miss[name])]

    def add(self, state: State, guess: Floats) -> None:
        """Take note of a state that a guess (N, 3) was corrected to."""
        self._miss = {name: _distance(place, state.u) for name, place in self._places(state.fraction, guess).items()}
        self._order = best_order(self.states, state)
        self._moved, self.off = state.u - guess, min(self._miss["guess"], GROWTH * self.off)
        self.states = [*self.states[-3:], state]

    def rested(self, fraction: float, guess: Floats) -> None:
        """Take note of a guess (N, 3) of a body that nothing touches."""
        self.states = [replace(self.states[-1], fraction=fraction)]
        self._miss |= {"guess": _distance(guess, self.states[-1].u), "extrapolated": 0.0}

    def _places(self, fraction: float, guess: Floats) -> dict[str, Floats]:
        return {"guess": guess, "carried": guess + self._moved, "extrapolated": polynomial(self.states[-1 - self._order:], fraction)}


def _distance(a: Floats, b: Floats) -> float:
    found = float(np.linalg.norm(a - b))
    return found if np.isfinite(found) else np.inf
