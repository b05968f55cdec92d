"""The multifrontal Cholesky factor of a stiffness that is ordered by nested dissection (ordering/nested.py).

Part after part, with F the sum of K's entries and of what its two halves left behind,

    L_SS L_SS^T = F_SS,   L_BS = F_BS L_SS^-T,   left behind: F_BB - L_BS L_BS^T

(Duff and Reid, ACM Trans. Math. Softw. 9, 1983). Right-hand sides that start at a few nodes reach only the parts between these and
the last separator.

Legend: N nodes in the order of elimination, P parts, s and b unknowns (3 a node) of S and B.
"""

from __future__ import annotations

import ctypes
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.linalg.native import blas, compiled, pointer
from physics.linalg.ordering.nested import Dissection

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Numbers = NDArray[Any]  # of single or double precision

# One row of `Shares.task`: the parts from `first` up to `last`, how many tasks it waits for, which one waits for it, and its operations.
TASK = np.dtype([(name, np.int64) for name in ("first", "last", "waits", "next", "work")])
PIECES = 1.5  # subtrees for each thread, at least: more would share the work better, in more memory
ROUTINES = ("potrf", "trsm", "syrk", "gemm", "trsv", "gemv", "sytrf", "sytrs2")

SOURCE = (Path(__file__).parent / "dissection.cpp").read_text()


@dataclass(frozen=True)
class Shares:
    """How several threads share the work of a dissection; with one there is one task.

    task: (T,) of TASK in the order of elimination, subtrees and the parts above them; part: the dissection's, with other places in
    the working memory, of so many numbers; blas: (threads, 6) addresses
    """

    task: NDArray[np.void]
    part: NDArray[np.void]
    memory: int
    blas: NDArray[np.uintp]


def shared(dissection: Dissection, threads: int, *, single: bool = False) -> Shares:
    """Subtrees of at most a share of all operations are one task each, and have a working memory each; every part above is one more."""
    d = dissection
    routines = np.array([[blas(("s" if single else "d") + name, thread) for name in ROUTINES] for thread in range(threads)], np.uintp)
    if threads == 1:
        return Shares(np.array([(0, len(d.part), 0, -1, 0)], TASK), d.part, d.memory, routines)
    s, b = d.part["own"], d.part["rest"]
    total, start = s**3 // 3 + s**2 * b + s * b**2, np.arange(len(s))
    for t, (first, last) in enumerate(zip(d.part["child"], d.part["last"], strict=True)):
        if last > first:
            below = d.children[first:last]
            start[t], total[t] = start[below[0]], total[t] + total[below].sum()
    above = total > total[-1] / (PIECES * threads)
    roots = np.flatnonzero(above | above[d.parent])
    task, part, memory = np.zeros(len(roots), TASK), d.part.copy(), 0
    task["first"], task["last"], task["work"] = np.where(above[roots], roots, start[roots]), roots + 1, total[roots]
    task["next"] = np.where(d.parent[roots] < 0, -1, np.searchsorted(roots, d.parent[roots]))
    task["waits"] = np.bincount(task["next"][task["next"] >= 0], minlength=len(roots))
    for first, last in zip(task["first"], task["last"], strict=True):
        of = slice(first, last)
        base = d.part["kept"][last - 1] if last - first > 1 else d.part["made"][first]
        part["made"][of] += memory - base
        part["kept"][of] = part["kept"][of] + memory - base if last - first > 1 else memory
        memory = int((part["made"] + b**2)[of].max())
    return Shares(task, part, memory, routines)


@functools.cache
def _library(single: bool) -> ctypes.CDLL:
    return compiled(f"typedef {'float' if single else 'double'} Real;\n" + SOURCE)


def factored(dissection: Dissection, values: Numbers, work: Numbers, each: int = 3, shares: Shares | None = None,
             count: tuple[Integers, Floats] | None = None) -> bool:
    """Turn the entries in the panels' `values` into those of the factor, with 3 or 1 unknowns a node; False when there is none.

    Args:
        work: of `memory` numbers, the shares' or where there are none the dissection's
        count: zeros, to become each part's (P,) negative eigenvalues and (P,) by how much it changes the diagonal of later parts;
            parts need not be positive definite then, and `values` become no factor
    """
    d, shares = dissection, shares or shared(dissection, 1)
    tables = [*map(pointer, (shares.part, d.children, d.at, values, work)), *(map(pointer, count) if count else (None, None))]
    return bool(_library(values.dtype == np.float32).factor(ctypes.c_int(each), *_given(shares), *tables))


def _given(shares: Shares) -> tuple[ctypes.c_int64, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p]:
    return ctypes.c_int64(len(shares.task)), pointer(shares.task), ctypes.c_int(len(shares.blas)), pointer(shares.blas)


class Panels:
    """The factor of a stiffness in the order of a dissection; the same bits on any number of threads.

    type: of its numbers, and of what is solved for
    """

    def __init__(self, dissection: Dissection, threads: int = 1, *, single: bool = False) -> None:
        self.dissection, self._shares = dissection, shared(dissection, threads, single=single)
        self.type: Any = np.float32 if single else np.float64
        self.values = np.empty(dissection.numbers + 1, self.type)  # and one number that is not used
        self._work = np.empty(self._shares.memory, self.type)
        self._library, self._given = _library(single), _given(self._shares)
        self._every = np.arange(len(dissection.part))
        self._rows = np.arange(len(dissection.order))

    def factor(self) -> bool:
        """Turn the entries in `values` into those of the factor; False when there is none."""
        return factored(self.dissection, self.values, self._work, shares=self._shares)

    def forward(self, x: Numbers, parts: Integers | None = None, rows: Integers | None = None) -> Numbers:
        """L^-1 x in place, x (N', 3, k); with `parts` closed upwards, the places whose rows (N,) they say are all there is."""
        d, k = self.dissection, x.shape[-1]
        tables = pointer(d.part), pointer(d.boundary)
        if k == 1 and parts is None and len(self._shares.blas) > 1:
            left = np.empty(3 * len(d.boundary), self.type)
            self._library.forward_shared(*self._given, *tables, pointer(self.values), pointer(x), pointer(left))
            return x
        chosen = self._every if parts is None else parts
        scratch = np.empty(int(d.part["rest"].max()) * k, self.type)
        self._library.forward(
            ctypes.c_int64(len(chosen)), pointer(chosen), *tables, pointer(self._rows if rows is None else rows), ctypes.c_int(k),
            pointer(self.values), pointer(x), pointer(scratch), pointer(self._shares.blas))
        return x

    def backward(self, x: Numbers) -> Numbers:
        """L^-T x in place, x (N, 3)."""
        d = self.dissection
        self._library.backward(*self._given, pointer(d.part), pointer(d.boundary), pointer(self.values), pointer(x))
        return x

    def columns(self, places: Integers, free: NDArray[np.bool_]) -> tuple[Integers, Numbers]:
        """L^-1 of unit vectors at the three unknowns of each of the nodes at n places, zero where they are not free (n, 3).

        Returns:
            rows (r,) outside of which it is zero, and the columns (r, 3 n)
        """
        d = self.dissection
        reached = np.zeros(len(d.part), bool)
        front = np.unique(np.searchsorted(d.part["first"], places, side="right") - 1)
        while len(front):  # up to the last separator
            reached[front] = True
            front = np.unique(d.parent[front])
            front = front[front >= 0]
        inside = np.repeat(reached, d.part["own"] // 3)
        row = np.cumsum(inside) - 1
        right = np.zeros((3 * int(inside.sum()), free.size), self.type)
        right[(3 * row[places][:, None] + np.arange(3)).ravel(), np.arange(free.size)] = free.ravel()
        self.forward(right.reshape(-1, 3, free.size), np.flatnonzero(reached), row)
        return (3 * np.flatnonzero(inside)[:, None] + np.arange(3)).ravel(), right
