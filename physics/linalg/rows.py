"""A process's share of a stiffness: rows, dealt out along the body's longest extent, where each entry of its cells goes in them.

Legend: N nodes, C cells, n nodes of common cells.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from physics.linalg.stiffness import Stiffness

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class MatrixRows:
    """Rows of a matrix of blocks of three that has the sparsity of a body's stiffness.

    Attributes:
        unknown: (N, 3) the number of each component; first, last: nodes whose rows these are, in that order
        share: how many unknowns each process has
        indptr, indices: of the compressed rows, whose values have one place more, for what belongs to none
        held: places of the diagonal entries of held components
    """

    def __init__(self, elasticity: Stiffness, comm: MPI.Comm) -> None:
        self.elasticity, self.comm = elasticity, comm
        points = elasticity.mesh.points
        self._place = np.empty(len(points), np.int64)
        self._place[np.lexsort(points.round(12)[:, np.argsort(np.ptp(points, axis=0))].T)] = np.arange(len(points))
        self.unknown = 3 * self._place[:, None] + np.arange(3)
        ends = np.arange(comm.size + 1) * len(points) // comm.size
        self.first, self.last = (int(end) for end in ends[comm.rank:comm.rank + 2])
        self.share = 3 * np.diff(ends)
        self._lay_out()

    def stiffness(self, u: Floats) -> Floats:
        """The values at displacements (N, 3)."""
        values = np.zeros(len(self.indices) + 1)
        for slot in self._slots:
            self.elasticity.add_stiffness(u, slot, values)
        return values

    def mine(self, field: Floats) -> Floats:
        """This process's part of a field (N, 3), zero on held components."""
        ordered = np.empty(field.size)
        ordered[self.unknown] = np.where(self.elasticity.fixed, 0.0, field)
        return ordered[3 * self.first:3 * self.last]

    def whole(self, mine: Floats) -> Floats:
        """The field (N, 3) that the processes have parts of."""
        ordered = np.empty(self.unknown.size)
        self.comm.Allgatherv(mine, (ordered, self.share))
        return ordered[self.unknown]

    def _lay_out(self) -> None:
        """The sparsity, and where each entry of each cell of this process goes."""
        nodes, block = len(self._place), self._place[self.elasticity.cells]  # (C, n)
        own = np.repeat(((block >= self.first) & (block < self.last))[:, :, None], block.shape[1], axis=2)
        key = block[:, :, None] * nodes + block[:, None, :]
        self._pairs, inverse = np.unique(key[own], return_inverse=True)
        row, column = np.divmod(self._pairs, nodes)
        row -= self.first
        width = np.bincount(row, minlength=self.last - self.first)
        first = np.concatenate([[0], np.cumsum(width)])
        # Entry (i, k) of the block of a pair stands in the i-th of the three rows of its node.
        self._at, self._width = 9 * first[row] + 3 * (np.arange(len(row)) - first[row]), 3 * width[row]
        entry = self._at[:, None, None] + self._width[:, None, None] * np.arange(3)[:, None] + np.arange(3)
        self.indices = np.empty(9 * len(row), np.int32)
        self.indices[entry] = 3 * column[:, None, None] + np.arange(3)
        self.indptr = np.concatenate([[0], np.cumsum(np.repeat(3 * width, 3))]).astype(np.int32)
        held = np.zeros(3 * nodes, bool)
        held[self.unknown[self.elasticity.fixed]] = True
        mine = np.flatnonzero(held[3 * self.first:3 * self.last])
        diagonal = np.searchsorted(self._pairs, (mine // 3 + self.first) * (nodes + 1))
        self.held = self._at[diagonal] + (self._width[diagonal] + 1) * (mine % 3)
        pair = np.full(own.shape, -1)
        pair[own] = inverse.ravel()
        upper = self.elasticity.pairs(self.unknown)
        self._slots = []
        # The upper half of each cell's matrix is added twice, once to the entry and once to its mirror image.
        for mirror in (False, True):
            slot = np.full(upper[0].shape, len(self.indices), np.int32)
            for j, (p, q) in enumerate(zip(*np.triu_indices(3 * block.shape[1]), strict=True)):
                (a, i), (b, k) = (divmod(q, 3), divmod(p, 3)) if mirror else (divmod(p, 3), divmod(q, 3))
                used = (pair[:, a, b] >= 0) & ~held[upper[0][:, j]] & ~held[upper[1][:, j]]
                if not (mirror and p == q):
                    at = pair[used, a, b]
                    slot[used, j] = self._at[at] + self._width[at] * i + k
            self._slots.append(slot)

    def _blocks(self, nodes: Integers) -> tuple[Integers, Integers, Integers]:
        """Which pairs (k,), (k,) of n nodes have entries in this process's rows, and where these are (k, 3, 3)."""
        place = self._place[nodes]
        rows = np.flatnonzero((place >= self.first) & (place < self.last))
        key = place[rows][:, None] * len(self._place) + place
        pair = np.minimum(np.searchsorted(self._pairs, key), len(self._pairs) - 1)
        a, b = np.nonzero(self._pairs[pair] == key)
        pair = pair[a, b]
        return rows[a], b, self._at[pair][:, None, None] + self._width[pair][:, None, None] * np.arange(3)[:, None] + np.arange(3)

    def add(self, nodes: Integers, block: Floats, values: Floats) -> None:
        """Add a matrix (3 n, 3 n) that couples n nodes of common cells to the rows of this process."""
        a, b, at = self._blocks(nodes)
        fixed = self.elasticity.fixed[nodes]
        at[fixed[a][:, :, None] | fixed[b][:, None, :]] = len(values) - 1
        values[at] += block.reshape(len(nodes), 3, len(nodes), 3)[a, :, b]

    def dense(self, nodes: Integers, values: Floats) -> Floats:
        """(3 n, 3 n) the rows and columns of n nodes."""
        dense = np.zeros((len(nodes), 3, len(nodes), 3))
        a, b, at = self._blocks(nodes)
        dense[a, :, b] = values[at]
        self.comm.Allreduce(MPI.IN_PLACE, dense)
        return dense.reshape(3 * len(nodes), 3 * len(nodes))
