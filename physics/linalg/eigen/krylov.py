"""The largest eigenpairs of A^-1 M by block Lanczos: A^-1 M x = theta x, A and M symmetric and positive definite.

From a random block V_1 of p vectors each step makes one more, as all vectors here M-orthonormal (V^T M V = 1):

    A^-1 M V_j = V H + V_(j+1) R,   H = V^T M A^-1 M V,   H y = theta y,   x = V y

A step passes through the factor once for p vectors, which takes little longer than for one; and a block finds all copies of an
eigenvalue of up to p. What is missing is |A^-1 M x - theta x|_M = |R y_j|, y_j the last p numbers of y. One more A^-1 M on x costs
nothing, as V H y + V_(j+1) R y_j is just that (Nour-Omid, Parlett, Ericsson, Jensen, Math. Comp. 48, 1987): so corrected, A x - M x / theta
is M times what was missing, instead of A times it, which is larger by the ratio of the mesh's eigenvalues.

A full basis shrinks to the pairs found so far and goes on (thick restart: Wu and Simon, SIAM J. Matrix Anal. 22, 2000).

Legend: n unknowns, p vectors of a block, m of the basis.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Map = Callable[[Floats], Floats]

ROUGH = 1e-6  # theta is then good to 1e-12, unless another one is very near
LOST = 3e-8  # a direction so much shorter than the longest is lost in the rounding of their squares
SQUARE = 1e-12  # how far from 1 the squares of orthonormal vectors may be
MOST = 100  # steps, and one more for each pair


def largest_pairs(inverse: Map, mass: Map, start: Floats, *, wanted: int, good: int, tolerance: float, room: int,
                  known: tuple[Floats, Floats] | None = None) -> tuple[Floats, Floats, int]:
    """theta (k,), falling, x (k, n), M-orthonormal, and how many steps it took; k is at least `wanted`.

    Args:
        inverse, mass: A^-1 and M times (n, p), in new memory
        start: (n, p)
        tolerance: of what is missing, over theta, for the first `good`; for the rest it is ROUGH
        room: vectors of the basis from which on it shrinks
        known: theta and x of pairs found before, which stay in the basis

    Raises:
        ArithmeticError: it does not come to an end
    """
    n, p = start.shape
    basis, weighted, H = np.empty((room + p, n)), np.empty((room + p, n)), np.zeros((room + p, room + p))  # V^T, (M V)^T
    m = 0
    if known is not None:
        m = len(known[0])
        basis[:m], weighted[:m], H[:m, :m] = known[1], mass(known[1].T).T, np.diag(known[0])
        start = start - basis[:m].T @ (weighted[:m] @ start)
    block, heavy, _ = _orthonormal(start, mass, basis[:m], weighted[:m])
    for step in range(1, wanted + MOST):
        old, m = m, m + block.shape[1]
        basis[old:m], weighted[old:m] = block.T, heavy.T
        new = inverse(heavy)
        H[:m, old:m] = weighted[:m] @ new
        H[old:m, :m] = H[:m, old:m].T
        new -= basis[:m].T @ H[:m, old:m]
        block, heavy, R = _orthonormal(new, mass, basis[:m], weighted[:m])
        theta, y = (np.ascontiguousarray(part[..., ::-1]) for part in scipy.linalg.eigh(H[:m, :m]))
        last = R @ y[old:m] / theta  # (p', m)
        missing = np.linalg.norm(last, axis=0)
        enough = m >= wanted and missing[:good].max() <= tolerance and missing[:wanted].max() <= ROUGH
        if enough or not block.shape[1]:
            k = max(min(wanted, m), int(np.argmax(np.append(missing > ROUGH, True))))
            return theta[:k], y[:, :k].T @ basis[:m] + last[:, :k].T @ block.T, step
        if m + p > room:
            k = min(old, wanted + 2 * p)
            for vectors in (basis, weighted):
                vectors[:k] = y[:, :k].T @ vectors[:m]
            H[:k, :k] = np.diag(theta[:k])
            m = k
    raise ArithmeticError(f"block Lanczos found no {good} pairs in {step} steps")


def _orthonormal(new: Floats, mass: Map, basis: Floats, weighted: Floats) -> tuple[Floats, Floats, Floats]:
    """Q (n, p'), M Q and R (p', p), new = Q R: Q M-orthonormal and M-orthogonal to the basis, as new is but for rounding.

    With new^T M new = R^T R, and once more for the rounding that a short or ill-conditioned block makes large.
    """
    R = np.eye(new.shape[1])
    for turn in range(4):
        if turn:
            new -= basis.T @ (weighted @ new)
        heavy = mass(new)
        square, axes = scipy.linalg.eigh(new.T @ heavy)
        if turn and abs(square - 1).max() < SQUARE:
            break
        kept = square > max(LOST**2 * square[-1], np.finfo(float).tiny)
        scale, axes = np.sqrt(square[kept]), axes[:, kept]
        new, R = new @ (axes / scale), (scale[:, None] * axes.T) @ R
        if not kept.any():
            break
    else:
        heavy = mass(new)
    return new, heavy, R
