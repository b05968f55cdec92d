"""Cholesky factors of scalar matrices that are sums over the cells of a plane mesh: one unknown a node, several right-hand sides.

The cells are halved again and again, across their longest extent; the nodes that both halves have are a separator. With elements
of order k it holds k nodes for each edge that it runs along, so nothing is cut through. Every half is numbered before its
separator (George, SIAM J. Numer. Anal. 10, 1973), and the factor made by linalg/dissection.py, whose tables these are, with one
unknown a node in place of three. One numbering serves every matrix on the mesh: a factor is only its numbers.

Legend: N unknowns, C cells, n nodes of a cell, P parts, k right-hand sides.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.linalg.dissection import factored
from physics.linalg.native import aligned, compiled, pointer
from physics.linalg.ordering.nested import Dissection, laid_out

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LEAF = 6  # cells of a part that is not cut any further
SOURCE = (Path(__file__).parent / "planar.cpp").read_text()


class NotPositive(ArithmeticError):
    """The matrix has no Cholesky factor."""


class Numbering:
    """The order of elimination of a mesh's unknowns.

    Attributes:
        order: (N,) the node at each place, without those that are held
        numbers: of a factor
        operations: of one factorisation
    """

    def __init__(self, centres: Floats, cells: NDArray[np.int32], held: NDArray[np.bool_]) -> None:
        """Args: centres (C, 2) of the cells; cells (C, n) their nodes; held: True on the nodes whose values are no unknowns."""
        free = np.flatnonzero(~held)
        number = np.full(len(held), -1)
        number[free] = np.arange(len(free))
        self._dissection = d = _dissect(centres, number[cells], len(free))
        self.order, self.numbers, self.operations = free[d.order], d.numbers, d.operations
        place = np.append(d.place, -1)[number[cells]]
        rows, columns = (np.broadcast_to(a, (*cells.shape, cells.shape[1])) for a in (place[:, :, None], place[:, None, :]))
        self._slot = np.where((rows >= columns) & (columns >= 0), _slots(d, rows, columns), d.numbers).ravel()
        self._library = compiled(SOURCE)
        self._most = -(-int((d.part["own"] + d.part["rest"]).max(initial=1)) // 8) * 8
        self._scratch, self._x = aligned(2 * self._most), aligned(2 * len(self.order))
        self._tree = (ctypes.c_int64(len(d.part)), pointer(d.part), pointer(d.boundary))
        self._where = (ctypes.c_int64(len(self.order)), pointer(self.order))
        self._work = (pointer(self._x), pointer(self._scratch), ctypes.c_int64(self._most))

    def factor(self, blocks: Floats) -> PlanarFactor:
        """The factor of the sum of symmetric blocks (C, n, n). Raises `NotPositive`."""
        d = self._dissection
        values, work = aligned(d.numbers + 1), aligned(d.memory)
        values[:] = np.bincount(self._slot, blocks.ravel(), d.numbers + 1)
        if not factored(d, values, work, each=1) or not np.isfinite(values.sum()):
            raise NotPositive(f"a matrix of {len(d.order)} unknowns is not positive definite")
        return PlanarFactor(self, values)

    def solve(self, values: Floats, right: Floats) -> Floats:
        right, found = np.ascontiguousarray(right), np.zeros(right.shape)
        self._library.solve(*self._tree, pointer(values), *self._where, ctypes.c_int64(right.size // len(right)), pointer(right),
                            pointer(found), *self._work)
        return found


class PlanarFactor:
    """A factor that is kept."""

    def __init__(self, numbering: Numbering, values: Floats) -> None:
        self._numbering, self._values = numbering, values

    @property
    def bytes(self) -> int:
        return self._values.nbytes

    def solve(self, right: Floats) -> Floats:
        """K^-1 of a field of right-hand sides (nodes,) or (nodes, 2); zero on the nodes that are held."""
        return self._numbering.solve(self._values, right)


def _dissect(centres: Floats, cells: Integers, count: int) -> Dissection:
    own: list[Integers] = []
    near: list[NDArray[np.int32]] = []
    children: list[list[int]] = []
    seen = np.zeros(count + 1, np.int8)
    taken = np.zeros(count + 1, bool)
    taken[-1] = True

    def visit(inside: Integers) -> int:
        below: list[int] = []
        nodes = np.unique(cells[inside])
        mine = nodes[~taken[nodes]]
        if len(inside) > LEAF:
            halves, mine = _halves(inside)
            taken[mine] = True
            below = [visit(half) for half in halves]
        taken[mine] = True
        near.append(cells[inside].astype(np.int32))
        own.append(mine)
        children.append(below)
        return len(own) - 1

    def _halves(inside: Integers) -> tuple[list[Integers], Integers]:
        x = centres[inside]
        best: tuple[int, list[Integers], Integers] | None = None
        for axis in np.argsort(-np.ptp(x, axis=0)):
            ranked = inside[np.argsort(x[:, axis], kind="stable")]
            for share in (0.5, 0.42, 0.58):
                middle = round(share * len(inside))
                halves = [ranked[:middle], ranked[middle:]]
                seen[cells[halves[0]]] = 1
                second = np.unique(cells[halves[1]])
                shared = second[(seen[second] == 1) & ~taken[second]]
                seen[cells[halves[0]]] = 0
                if best is None or len(shared) < best[0]:
                    best = len(shared), halves, shared
        assert best is not None
        return best[1], best[2]

    visit(np.arange(len(cells)))
    return laid_out(own, near, children, count, each=1)


def _slots(d: Dissection, rows: Integers, columns: Integers) -> Integers:
    """Where entries of a matrix go in the panels: places of nodes of one cell, of which the column comes first."""
    owner = np.append(np.repeat(np.arange(len(d.part)), d.part["own"]), 0)
    number = owner[columns]
    part = d.part[number]
    keys = np.repeat(np.arange(len(d.part)), d.part["rest"]) * len(owner) + d.boundary
    outside = np.searchsorted(keys, number * len(owner) + rows) - part["boundary"] + part["own"]
    local = np.where(owner[rows] == number, rows - part["first"], outside)
    found: Integers = part["panel"] + (columns - part["first"]) * (part["own"] + part["rest"]) + local
    return found
