"""A mesh taken apart by nested dissection, and the Cholesky factor of a stiffness that is ordered so.

A separator is a layer of nodes without which the rest falls into two halves that share no cell. Halves are cut again until they
are small; every part is numbered before the separator that cut it off (George, SIAM J. Numer. Anal. 10, 1973). In that order
the factor L of K = L L^T falls into dense columns: those of a part S have entries at S itself and at its boundary B, the later
nodes that its subtree touches. Part after part, with F the sum of K's entries and of what its two halves left behind,

    L_SS L_SS^T = F_SS,   L_BS = F_BS L_SS^-T,   left behind: F_BB - L_BS L_BS^T

(the multifrontal method: Duff and Reid, ACM Trans. Math. Softw. 9, 1983). For a solid of N nodes that takes O(N^2) operations and
O(N^(4/3)) numbers. Right-hand sides that start at a few nodes reach only the parts between these and the last separator.

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

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Numbers = NDArray[Any]  # of single or double precision

LEAF = 20  # nodes of a part that is not cut any further
# One row of `Dissection.part`: how many unknowns it eliminates and how many its boundary has, where its panel begins, its first
# place, where its boundary begins, its range in `children`, where in the working memory its remainder is made and where it is kept.
COLUMNS = ("own", "rest", "panel", "first", "boundary", "child", "last", "made", "kept")
PART = np.dtype([(name, np.int64) for name in COLUMNS])
# One row of `Shares.task`: the parts from `first` up to `last`, how many tasks it waits for, which one waits for it, and its operations.
TASK = np.dtype([(name, np.int64) for name in ("first", "last", "waits", "next", "work")])
PIECES = 1.5  # subtrees for each thread, at least: more would share the work better, in more memory
ROUTINES = ("potrf", "trsm", "syrk", "gemm", "trsv", "gemv", "sytrf", "sytrs2")

SOURCE = (Path(__file__).parent / "dissection.cpp").read_text()


@dataclass(frozen=True)
class Dissection:
    """The parts of a mesh in the order of elimination.

    order: (N,) our node at each place; place: (N,) the place of each of our nodes
    part: (P,) of PART
    children: parts that each part is the sum of; parent: (P,) -1 for the last
    boundary: places of the boundary nodes of all parts; at: where each of them stands in the part's parent (its S, then its B)
    numbers: of all panels; memory: working memory; operations: of one factorisation
    """

    order: Integers
    place: Integers
    part: NDArray[np.void]
    children: Integers
    parent: Integers
    boundary: NDArray[np.int32]
    at: NDArray[np.int32]
    numbers: int
    memory: int
    operations: float


def dissect(points: Floats, cells: NDArray[np.int32]) -> Dissection:
    """Cut the nodes at points (N, 3), of which those of a cell (C, n) belong together, into parts."""
    nodes = len(points)
    side = np.zeros(nodes, np.int8)
    own: list[Integers] = []
    near: list[NDArray[np.int32]] = []  # cells that touch each part
    children: list[list[int]] = []

    def visit(inside: Integers, around: NDArray[np.int32]) -> int:
        below: list[int] = []
        if len(inside) > LEAF:
            halves, inside = _cut(inside, around, points, side)
            for half in halves:
                if len(half):
                    side[half] = 1
                    touching = around[side[around].any(axis=1)]
                    side[half] = 0
                    below.append(visit(half, touching))
        side[inside] = 1
        near.append(around[side[around].any(axis=1)])
        side[inside] = 0
        own.append(inside)
        children.append(below)
        return len(own) - 1

    visit(np.arange(nodes), cells)
    return laid_out(own, near, children, nodes)


def _cut(nodes: Integers, cells: NDArray[np.int32], points: Floats, side: NDArray[np.int8]) -> tuple[list[Integers], Integers]:
    """Two halves of some nodes, across their longest extent, and the separator between them."""
    x = points[nodes]
    axes = np.argsort(np.ptp(x, axis=0))
    ranked = nodes[np.lexsort(x[:, axes].round(12).T)]
    along = points[ranked, axes[-1]]
    middle, quarter = len(ranked) // 2, len(ranked) // 4
    steps = middle - quarter + 1 + np.flatnonzero(np.diff(along[middle - quarter:middle + quarter]) > 1e-9 * np.ptp(along))
    if len(steps):  # between two layers rather than through one
        middle = int(steps[np.argmin(abs(steps - middle))])
    halves = [ranked[:middle], ranked[middle:]]
    side[halves[0]], side[halves[1]] = 1, 2
    sides = side[cells]
    crossing = cells[(sides == 1).any(axis=1) & (sides == 2).any(axis=1)]
    layers = [np.unique(crossing[side[crossing] == k]).astype(np.int64) for k in (1, 2)]
    side[nodes] = 0
    thin = int(len(layers[1]) <= len(layers[0]))
    side[layers[thin]] = 1
    halves[thin] = halves[thin][side[halves[thin]] == 0]
    side[layers[thin]] = 0
    return halves, layers[thin]


def laid_out(own: list[Integers], near: list[NDArray[np.int32]], children: list[list[int]], nodes: int, each: int = 3) -> Dissection:
    """Where everything of the parts stands in memory, with `each` unknowns a node; a node -1 is none."""
    order = np.concatenate(own)
    place = np.full(nodes + 1, -1)
    place[order] = np.arange(nodes)
    first = np.concatenate([[0], np.cumsum([len(part) for part in own])])
    parent = np.full(len(own), -1)
    boundaries: list[Integers] = []
    for t, below in enumerate(children):
        parent[below] = t
        reached = np.unique(np.concatenate([place[near[t]].ravel(), *(boundaries[c] for c in below)]))
        boundaries.append(reached[reached >= first[t + 1]])
    at = []
    for t, boundary in enumerate(boundaries):
        if parent[t] >= 0:
            start, end = first[parent[t]:parent[t] + 2]
            at.append(np.where(boundary < end, boundary - start, end - start + np.searchsorted(boundaries[parent[t]], boundary)))
    s, b = float(each) * np.diff(first), float(each) * np.array([len(boundary) for boundary in boundaries])
    panel = np.concatenate([[0.0], np.cumsum(s * (s + b))])
    begin = np.concatenate([[0], np.cumsum(b // each)])
    count = np.array([len(below) for below in children])
    last = np.cumsum(count)
    made, kept, top, memory = np.zeros(len(own)), np.zeros(len(own)), 0.0, 0.0
    for t, below in enumerate(children):
        made[t] = top
        memory = max(memory, top + b[t] ** 2)
        kept[t] = kept[below[0]] if below else top
        top = kept[t] + b[t] ** 2
    part = np.empty(len(own), PART)
    for name, column in zip(COLUMNS, (s, b, panel[:-1], first[:-1], begin[:-1], last - count, last, made, kept), strict=True):
        part[name] = column
    return Dissection(
        order=order, place=place[:-1], part=part, parent=parent,
        children=np.array([c for below in children for c in below], np.int64),
        boundary=np.concatenate(boundaries).astype(np.int32), at=np.concatenate([*at, []]).astype(np.int32),
        numbers=int(panel[-1]), memory=int(memory), operations=float((s**3 / 3 + s**2 * b + s * b**2).sum()))


def slots(dissection: Dissection, rows: Integers, columns: Integers) -> Integers:
    """Where entries of a matrix go in the panels: row and column are unknowns in the order of elimination, of nodes of one cell."""
    d = dissection
    late, early = np.maximum(rows, columns), np.minimum(rows, columns)
    row, column = late // 3, early // 3
    owner = np.repeat(np.arange(len(d.part)), d.part["own"] // 3)  # (N,)
    number = owner[column]
    part = d.part[number]
    keys = np.repeat(np.arange(len(d.part)), d.part["rest"] // 3) * len(owner) + d.boundary
    key = number * len(owner) + row
    found = np.searchsorted(keys, key)
    inside = owner[row] == number
    if not (inside | (np.append(keys, -1)[found] == key)).all():
        raise ValueError("an entry of nodes that have no cell in common")
    local = np.where(inside, row - part["first"], found - part["boundary"] + part["own"] // 3)
    return part["panel"] + (early - 3 * part["first"]) * (part["own"] + part["rest"]) + 3 * local + late % 3


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
