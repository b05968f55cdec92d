"""Meshes of a drawing, each finer one with small cells where the solution on the one before says that they are needed.

How far the stress of a cell is at its corners from what all cells there have in common says what the cell makes of the error,
eta_c ~ h^(p + d/2) for cells of order p (Zienkiewicz and Zhu, Int. J. Numer. Meth. Engng 24, 1987, 337). So many cells are spent best where
each makes as much,

    h_c' = s h_c eta_c^(-1 / (p + d/2)),    sum_c V_c / h_c'^d = the cells wanted  by  s

around supports and obstacles, in corners and thin parts. A cell becomes at most FINER times smaller and COARSER times larger than others in
one step, so that the error falls as fast as in a body without corners only from mesh to mesh. Legend: C cells, N nodes, K poses or modes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physics.body.element import samples
from physics.body.stress import stress_jumps
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.formats.drawing import Cut, Near
from physics.mesh.mesh import Mesh
from physics.scene import Body, Materials

Floats = NDArray[np.float64]

FINER, COARSER = 6.0, 2.5
REGULAR = {2: 4 / 3**0.5, 3: 6 * 2**0.5}  # volume of a cell with even edges: h^d over this
FLOOR = 0.01  # of the mean: below it a cell counts as one that has nothing to jump
SIMPLICES = ("triangle", "tetrahedron")
FOLLOWS = 1.5  # times the cells, where half the size is asked


class Drawing:
    """The meshes of a drawing with cells of one order, by about how many of them are along its longest side.

    longest: side [m]; first: a mesh of it; kind, dimension: of the cells
    """

    def __init__(self, body: Body, order: int, first: Mesh) -> None:
        """Args: first: a mesh of the drawing, for its sides and its kind of cells."""
        self.body, self.longest = replace(body, order=order), float(np.ptp(first.points, axis=0).max())
        self.first, self.kind, self.dimension = first, first.cell, first.dimension
        self._meshes: dict[int, Mesh] = {}
        self._sizes: dict[int, Near] = {}

    def mesh(self, n: int) -> Mesh:
        """Each made once: even, or graded by the finest mesh before it that has been learned from."""
        if n not in self._meshes:
            near = None
            if known := max((m for m in self._sizes if m < n), default=0):
                corners, cells, sizes = self._sizes[known]
                near = corners, cells, sizes * (known / n)
            self._meshes[n] = build_mesh(self.body, Cut(self.longest / n, near=near))
        return self._meshes[n]

    def learn(self, n: int, poses: Iterable[Floats], materials: Materials) -> None:
        """Take displacements (N, 3) of poses or modes on a mesh for what the finer ones should be; each counts as much."""
        began, even = next(iter(self._meshes.items()))  # the mesh that was made first
        self._sizes[n] = proportions(self._meshes[n], poses, materials, len(even.cells) * (n / began) ** self.dimension)

    @property
    def follows(self) -> bool:
        """Whether the cells take sizes that are asked for, and are not in rows and numbers that the drawing prescribes."""
        if self.kind not in SIMPLICES:
            return False
        volume, count = samples(self.first).volumes.sum(), len(self.first.cells)
        size = (REGULAR[self.dimension] * volume / count) ** (1 / self.dimension)
        return len(build_mesh(self.body, Cut(size / 2)).cells) > FOLLOWS * count


def proportions(mesh: Mesh, poses: Iterable[Floats], materials: Materials, many: float) -> Near:
    """Corners and cells of a mesh of simplices, and at each corner the size [m] of which there are so many cells."""
    volumes = samples(mesh).volumes.sum(axis=0)
    d, p = mesh.dimension, 2 if CELLS[mesh.cell].middles else 1
    cells = mesh.cells[:, :CELLS[mesh.cell].corners]
    squares = np.zeros(len(cells))
    for u in poses:
        one = np.nan_to_num(stress_jumps(mesh, u, materials)) ** 2 * volumes
        squares += one / max(one.sum(), np.finfo(float).tiny)
    eta = np.sqrt(squares + FLOOR**2 * squares.mean()) if squares.any() else np.ones(len(cells))
    before = (REGULAR[d] * volumes) ** (1 / d)
    times = eta ** (-1 / (p + d / 2))
    for _ in range(3):  # what is cut off changes the sum
        times *= ((volumes / (before * times) ** d).sum() / (volumes / before**d).sum()) ** (1 / d)
        times = np.clip(times, 1 / FINER, COARSER)
    times *= (len(cells) / many) ** (1 / d)
    count = int(cells.max()) + 1
    at, share, size = cells.ravel(), *(np.repeat(each, cells.shape[1]) for each in (volumes, np.log(before * times)))
    return mesh.points[:count], cells, np.exp(np.bincount(at, share * size, count) / np.bincount(at, share, count))
