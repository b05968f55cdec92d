"""A = K - s M in the order of a nested dissection: its factor, for blocks of vectors, and how many eigenvalues lie below a bound.

With A = L L^T (linalg/dissection.py) one pass through L and one through L^T solve for eight right-hand sides in little more time than for
one: what takes the time is to read the factor. Block Lanczos (krylov.py) makes use of that.

By Haynsworth's law (Linear Algebra Appl. 1, 1968) the negative eigenvalues of K - t M are those of F_SS of all parts together, where F_SS
is what a part has come to when its turn comes; by Sylvester's they are as many as eigenvalues of the pair below t. A part that is not
positive definite gets L D L^T with pivots from itself alone. If it is nearly singular it makes later parts large, and rounding with them;
then there is no count.

Legend: N nodes, n = 3 N components, P parts, B blocks of entries on and below the diagonal, p right-hand sides.
"""

from __future__ import annotations

import ctypes

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from physics import threads
from physics.linalg.cholesky import SHARED, NotPositiveDefinite
from physics.linalg.dissection import Panels, factored
from physics.linalg.eigen.krylov import largest_pairs
from physics.linalg.eigen.pairs import EPS, GOAL, Known, Problem
from physics.linalg.native import pointer
from physics.linalg.ordering.nested import dissect, slots

Floats = NDArray[np.float64]
WIDTH = 8  # vectors of a block: what solve_block in dissection.cpp takes
WORTH = 12  # unknowns for each vector of the basis from which on it is faster than SLEPc with MUMPS


class Dissected(Panels):
    """Factors of a matrix whose entries are put into `values` anew for each."""

    def solve(self, x: Floats) -> Floats:
        """(L L^T)^-1 x in place, x (n, WIDTH) in the order of elimination."""
        d = self.dissection
        room = np.empty((int((d.part["own"] + d.part["rest"]).max()), WIDTH))
        self._library.solve_block(ctypes.c_int64(len(d.part)), pointer(d.part), pointer(d.boundary),
                                  pointer(self.values), pointer(x), pointer(room))
        return x

    def inertia(self) -> tuple[int, float]:
        """How many eigenvalues of the matrix are negative, and by how much its diagonal changed at most; `values` are no factor.

        Raises:
            ArithmeticError: a part is singular
        """
        parts = len(self.dissection.part)
        negative, grown = np.zeros(parts, np.int64), np.zeros(parts)
        if not factored(self.dissection, self.values, self._work, shares=self._shares, count=(negative, grown)):
            raise ArithmeticError("a part of the matrix is singular")
        return int(negative.sum()), float(grown.max())


class BlockLanczos:
    """The pairs of a problem with a graph. Held components stay in, as rows of the identity."""

    name = "block Lanczos, shift and invert with a factor by nested dissection"

    def __init__(self, problem: Problem) -> None:
        """Raises `ValueError` where an entry couples nodes that have no cell in common."""
        assert problem.graph is not None
        points, cells = problem.graph
        self.free = problem.free
        self.kept = np.ones_like(problem.free)
        n = len(problem.free)
        d = dissect(points, cells)
        self._panels = Dissected(d, threads.count() if d.numbers >= SHARED else 1)
        self._unknown = (3 * d.place[:, None] + np.arange(3)).ravel()  # (n,) of each component, in the order of elimination
        self._order = np.argsort(self._unknown)
        self._stiffness, mass = (scipy.sparse.csr_matrix(matrix.getValuesCSR()[::-1], shape=(n, n))
                                 for matrix in (problem.stiffness, problem.mass))
        blocks, heavy = self._stiffness.tobsr((3, 3)), mass.tobsr((3, 3))
        row, column = np.repeat(d.place, np.diff(blocks.indptr)), d.place[blocks.indices]
        lower = row >= column
        row, column = row[lower], column[lower]
        self._stiff, self._heavy = blocks.data[lower], heavy.data[lower]  # (B, 3, 3)
        height = d.height[column]
        down, across = np.arange(3)[:, None], np.arange(3)
        inside = self.free[self._order].reshape(-1, 3)
        used = inside[row][:, :, None] & inside[column][:, None, :] & ((row > column)[:, None, None] | (down >= across))
        self._slot = np.where(used, slots(d, 3 * row, 3 * column)[:, None, None] + height[:, None, None] * across + down, d.numbers)
        held = np.flatnonzero(~inside)
        self._held = slots(d, held, held)
        mass.eliminate_zeros()  # what one component has of another
        self._mass = mass
        diagonals = self._stiffness.diagonal()[self.free], mass.diagonal()[self.free]
        self.largest, self._lightest = float((diagonals[0] / diagonals[1]).max()), float(diagonals[1].min())
        self._shift = np.nan  # of the factor that there is

    def factor(self, shift: float) -> None:
        """Have the factor of K - shift M."""
        if shift != self._shift:
            self._fill(shift)
            if not self._panels.factor():
                raise NotPositiveDefinite("the stiffness is not positive definite")
            self._shift = shift

    def lowest(self, wanted: int, good: int, shift: float, known: Known | None = None) -> Known:
        """At least `wanted` pairs next above the shift, the first `good` of them to the end, and those known before.

        Raises:
            ArithmeticError: K - shift M is not positive definite
        """
        self.factor(shift)
        more = 0 if known is None else len(known[0])
        wanted, good = wanted + more, good + more
        start = np.random.default_rng(more).normal(size=(len(self.free), WIDTH)) * self.free[:, None]
        theta, x, _ = largest_pairs(
            self._inverse, self._weigh, start, wanted=wanted, good=good, tolerance=GOAL / 5, room=room(wanted),
            known=None if known is None else (1 / (known[0] - shift), known[1]))
        return shift + 1 / theta, x

    def below(self, bound: float, distance: float) -> int:
        """How many eigenvalues lie below a bound, from which the next one is at least so far away.

        Raises:
            ArithmeticError: rounding may hide it
        """
        self._fill(bound)
        negative, grown = self._panels.inertia()
        if 100 * EPS * grown > distance * self._lightest:
            raise ArithmeticError("a part of the matrix is nearly singular")
        return negative

    def solve(self, right: Floats, shift: float) -> Floats:
        """(K - shift M)^-1 of vectors (k, n)."""
        self.factor(shift)
        blocks = (right[first:first + WIDTH] * self.free for first in range(0, len(right), WIDTH))
        return np.concatenate([self._inverse(block.T).T for block in blocks])

    def residuals(self, values: Floats, vectors: Floats, scales: Floats) -> Floats:
        """(m,) as pairs.py has them."""
        inertia = self._weigh(vectors.T)
        left = (self._stiffness @ vectors.T) * self.free[:, None] - values * inertia
        return np.linalg.norm(left, axis=0) / (scales * np.linalg.norm(inertia, axis=0))

    def _fill(self, shift: float) -> None:
        values = self._panels.values
        values[:] = 0.0
        values[self._slot] = self._stiff - shift * self._heavy if shift else self._stiff
        values[self._held] = 1.0
        self._shift = np.nan

    def _inverse(self, x: Floats) -> Floats:
        full = np.zeros((len(x), WIDTH))
        full[:, :x.shape[1]] = x[self._order]
        return self._panels.solve(full)[self._unknown, :x.shape[1]]

    def _weigh(self, x: Floats) -> Floats:
        product: Floats = self._mass @ x
        product *= self.free[:, None]
        return product


def room(wanted: int) -> int:
    """Vectors of the basis for so many pairs."""
    return 2 * wanted + 8 * WIDTH


def fits(problem: Problem, count: int, unknowns: int) -> bool:
    """Whether so many pairs of so many unknowns are found by this."""
    return problem.graph is not None and unknowns >= WORTH * room(count)
