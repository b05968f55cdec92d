"""How far off is a solution? From what changes when its mesh is refined, by the order that is seen, not the one of theory.

A mesh with n cells along a direction has the error c n^-p. Of three solutions with n_0 < n_1 < n_2 the differences are

    d_01 = c (n_0^-p - n_1^-p),   d_12 = c (n_1^-p - n_2^-p),   so that the error with n_1 is   d_12 / (1 - (n_1 / n_2)^p)

with the p that d_01 / d_12 gives (Richardson's extrapolation; Roache, Verification and Validation in Computational Science and
Engineering, 1998, ch. 5). A p above that of smooth solutions is luck and counts as that; below LOWEST, or where d does not fall, the
sequence does not converge regularly: then the larger of both differences counts, with LOWEST. Two solutions alone count with FIRST.

Legend: K poses, M points, d components.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Floats = NDArray[np.float64]

LOWEST = {"displacement": 0.8, "reaction": 0.8, "stress": 0.5}  # orders at clamped edges and rims of contact
FIRST = {"displacement": 1.0, "reaction": 1.0, "stress": 0.7}
ROUNDING = 1e-9  # differences below it are no errors of a mesh


@dataclass(frozen=True)
class Estimate:
    """error: relative, of the last mesh but one; order: that it is reckoned with; how: "seen", "assumed" of two meshes, or "irregular"."""

    error: float
    order: float
    how: str


def distance(values: Floats, finer: Floats, weights: Floats) -> float:
    """|values - finer| / |finer| in the norm over poses and points, for values (K, M, d) and weights (M,); 0 where both are zero."""
    off, size = (float(np.sqrt(np.einsum("m,kmd->", weights, part**2))) for part in (values - finer, finer))
    return off / size if size > 0 else 0.0 if off == 0 else np.inf


def observed_order(sizes: tuple[float, float, float], differences: tuple[float, float], highest: float) -> float:
    """The order p of three meshes with so many cells along a direction; 0 where they do not converge, at most `highest`."""
    (coarse, middle, fine), (first, second) = sizes, differences
    if not (np.isfinite(first) and second < first):
        return 0.0

    def miss(p: float) -> float:
        return float(first * (middle**-p - fine**-p) - second * (coarse**-p - middle**-p))

    low = 1e-3
    if miss(highest) >= 0:  # the differences fall faster than theory lets them
        return highest
    return float(brentq(miss, low, highest)) if miss(low) > 0 else 0.0


def estimate(sizes: list[int], differences: list[float], highest: float, quantity: str) -> Estimate:
    """The error of the last mesh but one of a sequence.

    Args:
        sizes: cells along a direction, rising; differences: between neighbours, one less
        highest: the order of smooth solutions
    """
    last, ratio = differences[-1], sizes[-2] / sizes[-1]
    if len(differences) < 2 or max(differences[-2:]) < ROUNDING:
        order = FIRST[quantity]
        return Estimate(last / (1 - ratio**order), order, "assumed")
    order = observed_order((sizes[-3], sizes[-2], sizes[-1]), (differences[-2], last), highest)
    if order >= LOWEST[quantity]:
        return Estimate(last / (1 - ratio**order), order, "seen")
    order = LOWEST[quantity]
    return Estimate(max(differences[-2:]) / (1 - ratio**order), order, "irregular")
