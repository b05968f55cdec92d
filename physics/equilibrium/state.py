"""What an equilibrium is, what is kept of the last ones, and where the next one is looked for: on a polynomial through them.

Legend: N nodes, Q contact points, S states.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.linalg.native import compiled, pointer

Floats = NDArray[np.float64]

HALVINGS = 6  # of a step whose end cannot be reached at once


class NoEquilibrium(RuntimeError):
    """No equilibrium was found; the message says where, how far off, and what was tried; `solution` what was reached before."""

    def __init__(self, message: str, solution: Any = None) -> None:
        super().__init__(message)
        self.solution = solution


@dataclass
class State:
    """One equilibrium: a fraction of the loading, displacements (N, 3) and contact forces (Q,); reactions (K, 3) of each obstacle."""

    fraction: float
    u: Floats
    pressure: Floats
    reaction: Floats = field(default_factory=lambda: np.zeros(3))
    iterations: int = 0
    residual: float = 0.0  # free components, over the reaction
    gap_error: float = 0.0  # [m] how far contact is from its conditions
    penetration: float = 0.0  # [m]
    reactions: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # [N] of the body on each obstacle; none at rest

    def of_each(self, obstacles: int) -> dict[str, Floats]:
        """What there is to report of each of several obstacles; nothing of a single one, whose reaction is that of the state."""
        if obstacles < 2:
            return {}
        return {"reactions": self.reactions if len(self.reactions) else np.zeros((obstacles, 3))}


@dataclass(frozen=True)
class StatesMemory:
    """What the rest of a path depends on of its last states: fractions (S,), displacements (S, N, 3), contact forces (S, Q)."""

    fraction: Floats
    u: Floats
    pressure: Floats

    @classmethod
    def of(cls, states: list[State]) -> StatesMemory:
        return cls(*(np.array([getattr(state, name) for state in states]) for name in ("fraction", "u", "pressure")))

    def states(self) -> list[State]:
        return [State(float(fraction), u, pressure) for fraction, u, pressure in zip(self.fraction, self.u, self.pressure, strict=True)]


def polynomial(states: list[State], fraction: float) -> Floats:
    """Displacements (N, 3) of the polynomial through some states (Lagrange's form), at another fraction."""
    return _through(states, fraction, len(states))[0]


def best_order(states: list[State], state: State) -> int:
    """The order, up to three, of the polynomial through the last states that would have foreseen the next one best."""
    away = (_through(states[-4:], state.fraction, 1) - state.u).reshape(-1, state.u.size)
    return int(np.einsum("si,si->s", away, away).argmin())


def _through(states: list[State], fraction: float, fewest: int) -> Floats:
    """(S - fewest + 1, N, 3) the polynomials through the last n of S states at a fraction, for n from the fewest to S."""
    count, found = len(states), np.empty((len(states) - fewest + 1, *states[0].u.shape))
    at, values = (ctypes.c_double * count)(*(s.fraction for s in states)), (ctypes.c_void_p * count)(*(pointer(s.u).value for s in states))
    _library().through(ctypes.c_int64(count), ctypes.c_int64(fewest), ctypes.c_int64(states[0].u.size), at, values,
                       ctypes.c_double(fraction), pointer(found))
    return found


@cache
def _library() -> ctypes.CDLL:
    return compiled((Path(__file__).parent / "polynomial.cpp").read_text(), rounded=True)
