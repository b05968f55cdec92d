"""Cholesky factors K = L L^T of a positive definite stiffness, assembled in place.

A beam whose nodes are numbered along its axis has a stiffness of narrow band b: LAPACK's banded Cholesky then needs n b^2
operations and each solve passes twice through n b numbers. Where the band is wider the factor is that of a nested dissection
(dissection.py).

Contact asks what unit forces E at some nodes do. With Y = L^-1 E (columns.py), which is kept as long as the factor, one solve with
contact forces in it is one with L and one with L^T:

    L y = f,   displacements at the nodes Y^T y,   L^T u = y + Y p

Legend: N nodes, D components of each that are unknown, n = D N unknowns, C cells.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.sparse.csgraph import reverse_cuthill_mckee

from physics import threads
from physics.linalg.columns import Columns
from physics.linalg.dissection import Panels
from physics.linalg.native import compiled, pointer
from physics.linalg.ordering.nested import Dissection, dissect, slots
from physics.linalg.stiffness import Stiffness
from physics.mesh.cell import CELLS

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
MOST_NUMBERS = 500_000_000  # in a factor: 4 GB
WIDEST_BAND = 200  # past this nested dissection in single precision is faster: for beams of some 3 k nodes
OPERATIONS = 30  # for each number of a factor that a Newton step has time for
SHARED = 4_000_000  # numbers of a dissected factor from which on several threads share the work, where they are allowed: some 4 k nodes
SOFTEST = 2 * float(np.finfo(np.float32).eps)  # stiffness of the softest motion over the largest of a component, for single precision


class NotPositiveDefinite(ArithmeticError):
    """The stiffness has no Cholesky factor: the state is unstable, or not a state at all."""


def narrowest_order(elasticity: Stiffness) -> tuple[Integers, int]:
    """(N,) the place of each node in the numbering of narrowest band, and the half bandwidth b of the unknowns.

    Tried are the mesh's own numbering, along its longest extent, and reverse Cuthill-McKee's.
    """
    mesh = elasticity.mesh
    count, cells = len(mesh.points), elasticity.cells
    extent = np.ptp(mesh.points, axis=0)
    along = np.lexsort(mesh.points.round(12)[:, np.argsort(extent)].T)
    candidates = [np.arange(count), along, reverse_cuthill_mckee(_graph(elasticity), symmetric_mode=True)]
    places = []
    for sequence in candidates:
        place = np.empty(count, np.int64)
        place[sequence] = np.arange(count)
        places.append(place)
    D = mesh.dimension
    bands = [int(D * np.ptp(place[cells], axis=1).max() + D - 1) for place in places]
    best = int(np.argmin(bands))
    return places[best], bands[best]


def _graph(elasticity: Stiffness) -> scipy.sparse.csr_matrix:
    """(N, N) which nodes are neighbours: by edges, in cells of second order by cells."""
    mesh, cells = elasticity.mesh, elasticity.cells
    if CELLS[mesh.cell].middles:
        touches = scipy.sparse.csr_matrix((np.ones(cells.size), cells.ravel(), cells.shape[1] * np.arange(len(cells) + 1)),
                                          shape=(len(cells), len(mesh.points)))
        return (touches.T @ touches).tocsr()
    ends = np.concatenate([mesh.edges, mesh.edges[:, ::-1]]).T
    return scipy.sparse.csr_matrix((np.ones(2 * len(mesh.edges)), (ends[0], ends[1])), shape=(len(mesh.points),) * 2)


class _Cholesky:
    """What all factors L L^T have in common."""

    name = ""
    negative = 0
    double = True

    def __init__(self, elasticity: Stiffness, place: Integers, worth: float, components: int = 3) -> None:
        """Args: place (N,) of each node in the order of elimination; components: D, of which those beyond are held everywhere."""
        self.elasticity, self.worth, self._components = elasticity, max(8, round(worth)), components
        self._unknown = components * place[:, None] + np.arange(components)  # (N, D)
        self._component = np.argsort(place)[:, None] * 3 + np.arange(components)  # (N, D) of a field (N, 3), in the order of elimination
        self._columns = Columns(self._halves, components)
        self._known: tuple[Integers, Floats] | None = None  # columns, and their compliance

    def _forward(self, y: Floats) -> Floats:
        """L^-1 y in place, y (D N,)."""
        raise NotImplementedError

    def _backward(self, y: Floats) -> Floats:
        """L^-T y in place, y (D N,)."""
        raise NotImplementedError

    def _halves(self, nodes: Integers) -> tuple[Integers, Floats]:
        """L^-1 of unit forces on n nodes: rows (r,) outside of which it is zero, and (r, D n)."""
        raise NotImplementedError

    def _whole(self, values: Floats) -> Floats:
        """(..., 3) from values of the unknown components (..., D)."""
        beyond = 3 - self._components
        return np.concatenate([values, np.zeros((*values.shape[:-1], beyond))], axis=-1) if beyond else values

    def widen(self) -> None:
        """Have numbers of double precision from the next update on."""

    @property
    def learned(self) -> list[Integers]:
        return self._columns.groups

    def learn(self, nodes: Integers) -> None:
        self._columns.learn(nodes)

    def compliance(self, nodes: Integers) -> Floats:
        columns, D, n = self._columns.of(nodes), self._components, len(nodes)
        if self._known is None or columns is not self._known[0]:
            found = self._columns.compliance[np.ix_(columns, columns)]
            if D < 3:
                found = self._whole(self._whole(found.reshape(n, D, n, D)).swapaxes(1, 3)).swapaxes(1, 3).reshape(3 * n, 3 * n)
            self._known = columns, found
        return self._known[1]

    def begin(self, force: Floats) -> Floats:
        return self._forward(np.where(self.elasticity.fixed, 0.0, force).take(self._component).ravel())

    def at(self, begun: Floats, nodes: Integers) -> Floats:
        columns = self._columns.of(nodes)
        return self._whole((self._columns.half.T @ begun[self._columns.where])[columns].reshape(-1, self._components))

    def finish(self, begun: Floats, nodes: Integers | None = None, push: Floats | None = None) -> Floats:
        y = begun.copy()
        if nodes is not None and push is not None and push.any():
            columns = self._columns.of(nodes)
            forces = np.zeros(self._columns.half.shape[1])
            forces[columns] = push[:, :self._components].ravel()
            y[self._columns.where] += self._columns.half @ forces
        return self._whole(self._backward(y).take(self._unknown))

    def solve(self, force: Floats) -> Floats:
        return self._whole(self._backward(self.begin(force)).take(self._unknown))


class BandFactor(_Cholesky):
    """LAPACK's banded Cholesky factor, assembled in place, and solved with by blocks of columns (band.cpp)."""

    def __init__(self, elasticity: Stiffness, place: Integers, band: int) -> None:
        super().__init__(elasticity, place, band / OPERATIONS, elasticity.mesh.dimension)
        self.band, self.name = band, f"banded Cholesky (LAPACK): a half-bandwidth of {band}, at most {WIDEST_BAND}"
        size, components = self._unknown.size, self._components
        row, column = elasticity.pairs(np.pad(self._unknown, ((0, 0), (0, 3 - components)), constant_values=size))
        # Column after column of the lower band; what is held goes to one last place.
        slot = np.minimum(row, column) * (band + 1) + abs(row - column)
        held = np.ones(size + 1, bool)  # the last is for components beyond
        held[self._unknown] = elasticity.fixed[:, :components]
        slot[held[row] | held[column]] = size * (band + 1)
        self._slot = np.ascontiguousarray(slot, np.int32)
        self._held = np.flatnonzero(held[:-1]) * (band + 1)
        self._storage = np.empty(size * (band + 1) + 1)

    def update(self, u: Floats) -> None:
        self._columns.clear()
        self._storage[:] = 0.0
        self.elasticity.add_stiffness(u, self._slot, self._storage)
        self._storage[self._held] = 1.0
        matrix = self._storage[:-1].reshape(-1, self.band + 1).T  # (b + 1, n)
        _, info = lapack.dpbtrf(matrix, lower=1, overwrite_ab=1)
        if info or not np.isfinite(self._storage[:-1:self.band + 1]).all():  # what is no number reaches the diagonal
            raise NotPositiveDefinite(f"the stiffness is not positive definite at unknown {info}")

    def _forward(self, y: Floats) -> Floats:
        return self._solved(_library().forward, y)

    def _backward(self, y: Floats) -> Floats:
        return self._solved(_library().backward, y)

    def _solved(self, solve: Callable[..., None], y: Floats, start: int = 0) -> Floats:
        """Right sides (m, n) in place, of the unknowns from one on."""
        solve(ctypes.c_int64(y.shape[-1]), ctypes.c_int64(self.band), pointer(self._storage[start * (self.band + 1):]),
              ctypes.c_int64(y.size // y.shape[-1]), pointer(y))
        return y

    def _halves(self, nodes: Integers) -> tuple[Integers, Floats]:
        unknown = self._unknown[nodes].ravel()
        start = int(unknown.min())
        right = np.zeros((len(unknown), self._unknown.size - start))
        right[np.arange(len(unknown)), unknown - start] = ~self.elasticity.fixed[nodes, :self._components].ravel()
        return np.arange(start, self._unknown.size), self._solved(_library().forward, right, start).T


def _slots_of_cells(dissection: Dissection, elasticity: Stiffness) -> NDArray[np.int32]:
    """(C, d (d + 1) / 2) where each entry of each cell goes in the panels, in the order of `Stiffness.pairs`; what is held goes behind."""
    cells, free = elasticity.cells, ~elasticity.fixed
    place, n = dissection.place[cells], cells.shape[1]
    first, second = np.triu_indices(n)  # nodes of a cell
    turned = place[:, first] > place[:, second]
    early = np.minimum(place[:, first], place[:, second])
    begin = slots(dissection, 3 * np.maximum(place[:, first], place[:, second]), 3 * early)
    height = dissection.height[early]
    pair = np.zeros((n, n), np.int64)
    pair[first, second] = np.arange(len(first))
    rows, columns = np.triu_indices(3 * n)  # components of these nodes
    found = np.empty((len(cells), len(rows)), np.int32)
    for i, j in product(range(3), repeat=2):
        entries = np.flatnonzero((rows % 3 == i) & (columns % 3 == j))
        of = pair[rows[entries] // 3, columns[entries] // 3]
        inside = free[cells[:, first[of]], i] & free[cells[:, second[of]], j]
        within = np.where(turned[:, of], j * height[:, of] + i, i * height[:, of] + j)
        found[:, entries] = np.where(inside, begin[:, of] + within, dissection.numbers)
    return found


class DissectionFactor(_Cholesky):
    """The multifrontal Cholesky factor of a nested dissection, assembled in place.

    In single precision it takes half the memory and time. What it solves is then off by about the share of the stiffest motion's rounding
    in the softest motion's stiffness, in which Newton's method, whose forces are in double precision, is not hindered. Where that share may
    not be small, and where there is no factor, it is made anew in double precision, and stays so.
    """

    def __init__(self, elasticity: Stiffness, dissection: Dissection | None = None, *, single: bool = False) -> None:
        """Args: dissection of the mesh, if there is one already; single: begin in single precision."""
        self._dissection = dissection or dissect(elasticity.mesh.points, elasticity.cells)
        numbers = self._dissection.numbers
        super().__init__(elasticity, self._dissection.place, self._dissection.operations / numbers / OPERATIONS)
        free = np.zeros(self._unknown.size, bool)
        free[self._unknown] = ~elasticity.fixed
        self._slot = _slots_of_cells(self._dissection, elasticity)
        self._free, every = free, np.arange(len(free))
        self._diagonal = slots(self._dissection, every, every)
        self._make(single)

    def _make(self, single: bool) -> None:
        numbers = self._dissection.numbers
        self.double, size = not single, 4e-9 if single else 8e-9
        self._panels = Panels(self._dissection, threads.count() if numbers >= SHARED else 1, single=single)
        self.name = (f"sparse Cholesky by nested dissection: {size * numbers:.2g} GB{' in single precision' if single else ''}, "
                     f"at most {8e-9 * MOST_NUMBERS:.2g} GB")

    def widen(self) -> None:
        if not self.double:
            self._make(single=False)

    def update(self, u: Floats) -> None:
        self._columns.clear()
        values = self._panels.values
        values[:] = 0.0
        self.elasticity.add_stiffness(u, self._slot, values)
        values[-1] = 0.0
        stiffest = float(values[self._diagonal].max())
        values[self._diagonal[~self._free]] = 1.0
        made = self._panels.factor()
        if self.double and not made:
            raise NotPositiveDefinite("the stiffness is not positive definite")
        if not self.double and not (made and self._softest() > SOFTEST * stiffest):
            self.widen()
            self.update(u)

    def _softest(self) -> float:
        """The stiffness of about the softest motion [N/m], by inverse iteration."""
        mode = np.where(self._free, np.cos(np.arange(self._free.size)), 0.0)
        for _ in range(3):  # other motions are some times stiffer, and need not be gone
            mode = self._backward(self._forward(mode / np.linalg.norm(mode)))
        return 1 / float(np.linalg.norm(mode))

    def _forward(self, y: Floats) -> Floats:
        x = np.asarray(y, self._panels.values.dtype)
        self._panels.forward(x.reshape(-1, 3, 1))
        return np.asarray(x, np.float64)

    def _backward(self, y: Floats) -> Floats:
        return np.asarray(self._panels.backward(np.asarray(y, self._panels.values.dtype)), np.float64)

    def _halves(self, nodes: Integers) -> tuple[Integers, Floats]:
        rows, half = self._panels.columns(self._dissection.place[nodes], ~self.elasticity.fixed[nodes])
        return rows, np.asarray(half, np.float64)


@cache
def _library() -> ctypes.CDLL:
    return compiled((Path(__file__).parent / "band.cpp").read_text())
