"""What unit forces at the nodes in contact do, as far as one half of a solution.

With K = L L^T the compliance of unit forces E at the components of some nodes is Y^T Y, Y = L^-1 E. Y is zero before the first of these
nodes in the order of elimination, or beside the parts above them, so it takes far less than solving with K. It is kept as long as the
factor, and only columns of nodes that come in are computed.

Legend: D components of a node, m known nodes, n asked for, r rows where Y is not zero.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FORGET = 3  # nodes whose columns are kept, over those in contact


class Columns:
    """Y = L^-1 E for unit forces E at the components of some nodes, and their compliance Y^T Y.

    rows: (r,) the unknowns, in the factor's order, outside of which Y is zero; half: (r, D m) Y; compliance: (D m, D m)
    where: the same rows, as a slice where they follow one another
    """

    def __init__(self, compute: Callable[[Integers], tuple[Integers, Floats]], components: int = 3) -> None:
        """Args: compute rows and columns of nodes (n,); components: D."""
        self._compute, self._components = compute, components
        self.clear()

    def clear(self) -> None:
        self.groups: list[Integers] = []
        self._asked: Integers | None = None
        self._answer = np.empty(0, np.int64)
        self.where: Integers | slice = slice(0, 0)
        self.rows, self.half, self.compliance = np.empty(0, np.int64), np.empty((0, 0)), np.empty((0, 0))

    def learn(self, nodes: Integers) -> None:
        rows, half = self._compute(nodes)
        every = np.union1d(self.rows, rows)
        half, known = _spread(rows, half, every), _spread(self.rows, self.half, every)
        cross = known.T @ half
        self.compliance = np.block([[self.compliance, cross], [cross.T, half.T @ half]])
        self.rows, self.half = every, np.concatenate([known, half], axis=1)
        self.where = slice(every[0], every[-1] + 1) if every[-1] - every[0] == len(every) - 1 else every
        self.groups.append(nodes)

    def of(self, nodes: Integers) -> Integers:
        """(D n,) the columns of n nodes; those that are missing are found, and those long out of use forgotten.

        Asked for the same nodes once more it gives the same array, as long as nothing was forgotten.
        """
        if nodes is self._asked or (self._asked is not None and np.array_equal(nodes, self._asked)):
            return self._answer
        place = self._places(nodes)
        if (place < 0).any():
            if sum(map(len, self.groups)) > FORGET * len(nodes):
                self.clear()
                place[:] = -1
            self.learn(nodes[place < 0])
            place = self._places(nodes)
        self._asked, self._answer = nodes, (self._components * place[:, None] + np.arange(self._components)).ravel()
        return self._answer

    def _places(self, nodes: Integers) -> Integers:
        """(n,) of each of n nodes among the known ones, -1 where it is not known."""
        known = np.concatenate([*self.groups, np.empty(0, np.int64)])
        order = np.argsort(known)
        place = np.append(order, -1)[np.searchsorted(known, nodes, sorter=order)]
        return np.where(np.append(known, -1)[place] == nodes, place, -1)


def _spread(rows: Integers, values: Floats, every: Integers) -> Floats:
    """Values at some of the rows, and zeros at the others."""
    if len(rows) == len(every):
        return values
    out = np.zeros((len(every), values.shape[1]))
    out[np.searchsorted(every, rows)] = values
    return out
