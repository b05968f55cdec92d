"""A mesh taken apart by nested dissection: an order of elimination in which a stiffness has a factor of little fill.

A separator is a layer of nodes without which the rest falls into two halves that share no cell. Halves are cut again until they
are small; every part is numbered before the separator that cut it off (George, SIAM J. Numer. Anal. 10, 1973). In that order
the factor L of K = L L^T falls into dense columns: those of a part S have entries at S itself and at its boundary B, the later
nodes that its subtree touches. For a solid of N nodes it takes O(N^2) operations and has O(N^(4/3)) numbers.

Legend: N nodes in the order of elimination, P parts, s and b unknowns (3 a node) of S and B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LEAF = 20  # nodes of a part that is not cut any further
# One row of `Dissection.part`: how many unknowns it eliminates and how many its boundary has, where its panel begins, its first
# place, where its boundary begins, its range in `children`, where in the working memory its remainder is made and where it is kept.
COLUMNS = ("own", "rest", "panel", "first", "boundary", "child", "last", "made", "kept")
PART = np.dtype([(name, np.int64) for name in COLUMNS])


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

    @property
    def height(self) -> Integers:
        """(N,) of the panel that the columns of the node at each place stand in."""
        return np.repeat(self.part["own"] + self.part["rest"], self.part["own"] // 3)


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
