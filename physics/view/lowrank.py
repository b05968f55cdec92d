"""A motion kept as a few shapes and how much of each there is in every frame: some hundred times smaller than its frames.

    A[t] = sum_r c[t, r] S[r] + what is left,    A (T, n)

S are the leading right singular vectors of A: no others leave less in the mean square (Eckart and Young, Psychometrika 1936).
They are rounded to 16 bits, and c is fitted to the rounded ones by least squares, one after the other, so that "what is left"
is exactly what a reader of the shapes does not see. Shapes are added until it is small enough.

Legend: T frames, N nodes, k components, n = N k, R shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST = 32767  # of 16 bits


@dataclass(frozen=True)
class LowRank:
    """coefficients (T, R) float32, in the unit of the frames for one step of the shapes (R, n) int16; error: largest left at a node."""

    coefficients: NDArray[np.float32]
    shapes: NDArray[np.int16]
    error: float

    @property
    def frames(self) -> NDArray[np.float64]:
        """(T, n) what a reader sees."""
        return self.coefficients.astype(np.float64) @ self.shapes.astype(np.float64)


def compress(frames: NDArray[np.floating[Any]], tolerance: float, most: int | None = None) -> LowRank:
    """Shapes of frames (T, N, k) that leave no node more than `tolerance` off, as the length of a vector of k components.

    With `most` there are at most so many shapes, whatever they leave; `error` says how much that is.
    """
    count = len(frames)
    left = np.array(frames, np.float64).reshape(count, -1)  # (T, n), a copy: the shapes are taken out of it
    _, over_time = np.linalg.eigh(left @ left.T)  # (T, T): the left singular vectors, the least important first
    coefficients, shapes = np.zeros((0, count), np.float32), np.zeros((0, left.shape[1]), np.int16)
    error = _largest(left, frames.shape[2])
    for vector in over_time.T[::-1][:most]:
        if error <= tolerance:
            break
        shape = vector @ left
        if not (top := abs(shape).max()):
            break
        rounded = np.rint(shape * (LARGEST / top))
        much = (left @ rounded / (rounded @ rounded)).astype(np.float32)
        left -= np.outer(much.astype(np.float64), rounded)
        error = _largest(left, frames.shape[2])
        coefficients, shapes = np.vstack([coefficients, much]), np.vstack([shapes, rounded.astype(np.int16)])
    return LowRank(coefficients.T.copy(), shapes, error)


def _largest(left: NDArray[np.float64], components: int) -> float:
    """The largest length of a vector at any node in any frame."""
    return float(np.sqrt((left.reshape(-1, components) ** 2).sum(axis=1).max(initial=0.0)))
