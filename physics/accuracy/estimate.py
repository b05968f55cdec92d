"""How far off is a solution? From what changed when its mesh was refined, by the order that is seen, not the one of theory.

A mesh with n cells along a direction has the error c n^-p. Of three solutions with n_0 < n_1 < n_2 the differences are

    d_01 = c (n_0^-p - n_1^-p),   d_12 = c (n_1^-p - n_2^-p),   so that the error with n_2 is   d_12 q / (1 - q),  q = (n_1 / n_2)^p

with the p that d_01 / d_12 gives (Richardson's extrapolation; Roache, Verification and Validation in Computational Science and
Engineering, 1998, ch. 5). A p above that of smooth solutions is luck and counts as that; below LOWEST, or where d does not fall, the
sequence does not converge regularly and counts with LOWEST. With such a p the two differences say different things of the last mesh:
the larger counts. Two solutions alone count with FIRST.

What directions change on a coarse mesh is added up as fields, as one may make good what another does (Liem, Lu and Shih, The Splitting
Extrapolation Method, 1995). A mesh that is not the finest has the error of that at most, and its distance from it.

Legend: K poses, M points, d components.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Floats = NDArray[np.float64]

LOWEST = {"displacement": 0.8, "reaction": 0.8, "stress": 0.5, "frequency": 0.8}  # orders at clamped edges and rims of contact
FIRST = {"displacement": 1.0, "reaction": 1.0, "stress": 0.7, "frequency": 1.0}
ROUNDING = 1e-9  # differences below it are no errors of a mesh, and of two differences no difference


@dataclass(frozen=True)
class ErrorEstimate:
    """error: relative, of the last mesh; order: that it is reckoned with; how: "seen", "assumed" of two meshes, or "irregular"."""

    error: float
    order: float
    how: str


def distance(values: Floats, finer: Floats, weights: Floats) -> float:
    """|values - finer| / |finer| in the norm over poses and points, for values (K, M, d) and weights (M,); 0 where both are zero."""
    off, size = norm(values - finer, weights), norm(finer, weights)
    return off / size if size > 0 else 0.0 if off == 0 else np.inf


def norm(values: Floats, weights: Floats) -> float:
    """Over poses and points, for values (K, M, d) and weights (M,)."""
    return float(np.sqrt(np.einsum("m,kmd->", weights, values**2)))


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


def estimate(sizes: Sequence[float], differences: Sequence[float], highest: float, quantity: str) -> ErrorEstimate:
    """The error of the last mesh of a sequence.

    Args:
        sizes: how fine each is, rising: cells along a direction, or what they all came to
        differences: between neighbours, one less
        highest: the order of smooth solutions
    """
    last, (before, end) = differences[-1], sizes[-2:]
    if len(differences) < 2 or max(differences[-2:]) < ROUNDING:
        order = FIRST[quantity]
        return ErrorEstimate(_left(last, before / end, order), order, "assumed")
    first, lowest = differences[-2], LOWEST[quantity]
    seen = observed_order((sizes[-3], before, end), (first, last), highest)
    order = max(seen, lowest)
    carried = (before / end) ** order
    error = max(_left(last, before / end, order), _left(first, sizes[-3] / before, order) * carried)
    return ErrorEstimate(error, order, "seen" if seen >= lowest else "irregular")


def looked(alone: Sequence[tuple[float, Floats]], times: Sequence[float], change: float, usual: float, quantity: str,
           weights: Floats) -> ErrorEstimate:
    """The error of a second mesh, from what each direction did on the first: the order is that with which all of it adds up to a change.

    Args:
        alone: of each direction, the ratio n / n' of a mesh refined in it alone, and (K, M, d) its difference from the first mesh
        times: how many times more cells the second mesh has along each
        change: how far the second mesh is from the first; usual: the highest order to believe in

    All lengths are in the same unit, that of the size of the values, say.
    """
    def sized(p: float, share: Callable[[float], float]) -> float:
        """Of the first mesh's error, direction by direction, the shares that so many times more cells leave of each."""
        parts = [off * (share(by) / (1 - ratio**p)) for (ratio, off), by in zip(alone, times, strict=True)]
        return norm(np.sum(parts, axis=0), weights)

    def made(p: float) -> float:
        return sized(p, lambda by: 1 - by**-p)

    lowest = LOWEST[quantity]
    if abs(made(usual) - made(lowest)) <= ROUNDING * change:  # refined in one direction alone: any order has it
        first = FIRST[quantity]
        return ErrorEstimate(sized(first, lambda by: by**-first), first, "assumed")
    if made(usual) >= change:
        seen = usual
    else:
        seen = lowest if made(lowest) <= change else float(brentq(lambda p: made(p) - change, lowest, usual))
    scale = max(1.0, change / max(made(seen), ROUNDING))  # it changed by more than even the lowest order has it
    return ErrorEstimate(sized(seen, lambda by: by**-seen) * scale, seen, "irregular" if scale > 1 and seen == lowest else "seen")


def coarse(ratio: float, difference: float, order: float) -> float:
    """The error of the coarser of two meshes with n and n / ratio cells that differ so much."""
    return difference / (1 - ratio**order)


def _left(difference: float, ratio: float, order: float) -> float:
    """The error of the finer of two meshes that differ so much."""
    return difference * ratio**order / (1 - ratio**order)
