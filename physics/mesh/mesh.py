"""Points and cells of a body, its outer surface, and its named places.

Cells are listed in gmsh's vertex order with positive volume, which is VTK's order for the cell types used here; further nodes of cells
of second order stand behind their corners, as in VTK. Plane bodies lie in z = 0. Legend: N nodes, C cells, F facets, k nodes of one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS
from physics.mesh.places import inside, nodes_at
from physics.mesh.sound.fit import piece_of
from physics.mesh.sound.rows import keyed, rows_in, unique_rows
from physics.scene import Where
from physics.schema import InputError, nearest

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

QUARTERS = {6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)), 9: ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))}
Parts = list[tuple[str, Integers]]  # kinds (keys of DIMENSION) with their node numbers (.., k)
Entities = dict[int, Integers]  # (.., k) for each number of corners k, each row sorted


@dataclass(frozen=True)
class Mesh:
    """A body's mesh of one cell type.

    points: (N, 3) rest positions [m]
    cells: (C, k) node numbers
    cell: triangle, quadrilateral, tetrahedron, prism or hexahedron; of second order one of `SECOND` in cell.py
    places: sorted node numbers of each named place
    parts: what each place of a file is made of; without it a place is made of the outer facets between its nodes
    remarks: what was found odd when the mesh was read, a line each
    mixed: names that stand for several groups, with what these are called
    middles: of a mesh of first order where the middle nodes of curved cells lie; see sound/curved.py and second.py
    thickness: of a plane body [m]; sheet: whether that may change, with no stress across it, or cannot, with no strain
    """

    points: Floats
    cells: Integers
    cell: str
    places: dict[str, Integers]
    parts: dict[str, Parts] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    mixed: dict[str, tuple[str, ...]] = field(default_factory=dict)
    middles: dict[int, tuple[Integers, Floats]] = field(default_factory=dict)
    thickness: float = 1.0
    sheet: bool = False

    def __repr__(self) -> str:
        names = f", places {', '.join(self.places)}" if self.places else ""
        return f"Mesh({len(self.points)} nodes, {len(self.cells)} {self.cell} cells{names})"

    @property
    def dimension(self) -> int:
        """3 for a solid body, 2 for a plane one."""
        return CELLS[self.cell].dimension

    @property
    def extent(self) -> Floats:
        """(D,) how large the body is along x, y and, unless it is plane, z [m]."""
        return np.ptp(self.points, axis=0)[:self.dimension]

    def kind_of(self, facets: Integers) -> str:
        """The kind of facets (F, k) of this body: three nodes are a triangle, or of a plane body a line with its middle."""
        return next(name for name, cell in CELLS.items() if (cell.dimension, cell.nodes) == (self.dimension - 1, facets.shape[1]))

    @cached_property
    def boundary(self) -> list[Integers]:
        """Outer facets, outward by the right-hand rule: one array (F, k) for each number of corners k, if there are any."""
        return self._facets(lambda count: count == 1)

    @cached_property
    def inner(self) -> list[Integers]:
        """Facets that two cells share, each once, in the same arrays as the outer ones."""
        return self._facets(lambda count: count > 1)

    def _facets(self, chosen: Callable[[Integers], NDArray[np.bool_]]) -> list[Integers]:
        found = []
        for n in (2, 3, 4, 6, 9):
            local = [facet for facet in CELLS[self.cell].facets if len(facet) == n]
            if not local:
                continue
            facets = np.concatenate([self.cells[:, list(facet)] for facet in local])
            _, first, count = np.unique(keyed(np.sort(facets, axis=1)), return_index=True, return_counts=True)
            found.append(facets[np.sort(first[chosen(count)])])
        return found

    @property
    def surface(self) -> list[Integers]:
        """What can be seen: the outer facets of a solid body, (F, 3) triangles and (F, 4) quadrilaterals; of a plane one all cells.

        Of second order these are four for each facet, or plane cell, between all of its nodes.
        """
        return [np.concatenate([facets[:, list(part)] for part in QUARTERS[facets.shape[1]]]) if facets.shape[1] in QUARTERS else facets
                for facets in (self.boundary if self.dimension == 3 else [self.cells])]

    @cached_property
    def edges(self) -> Integers:
        """(E, 2) edges of the cells, each once, the smaller node number first."""
        return unique_edges(self.cells, self.cell)

    def place(self, where: str | Where) -> Integers:
        """The sorted nodes of a place, or what several places with blanks between them have in common. Raises `InputError`."""
        if isinstance(where, Where):
            return nodes_at(self.points, where)
        if where in self.places:
            return self.places[where]
        names = where.split()
        for name in names if len(names) > 1 and where not in self.mixed else [where]:
            if name in self.mixed:
                raise InputError(f"{name!r} stands for several places of the mesh: write {' or '.join(map(repr, self.mixed[name]))}")
            if name not in self.places:
                known = ", ".join(self.places) or "none at all, so say where it lies: { near = [..], within = .. }, plane or box"
                said = next((f"; {remark}" for remark in self.remarks if repr(name) in remark), nearest(name, self.places))
                raise InputError(f"no place named {name!r} in the mesh: there are {known}{said}")
        common = self.places[names[0]]
        for name in names[1:]:
            common = np.intersect1d(common, self.places[name])
        if not len(common):
            raise InputError(f"the places {where!r} have no node in common")
        return common

    def facets(self, where: str | Where) -> list[Integers]:
        """The facets that a place is made of, those of the boundary outward: an array (F, k) for each number of corners k.

        Of a file's groups of facets these are outer and inner ones, of several regions those between them; of a region, of sets of
        nodes and of the places of a shape the outer ones whose corners all lie there. There may be none: an edge has none.
        """
        known = self.entities(where)
        names = [] if isinstance(where, Where) else [where] if where in self.places else where.split()
        dimensions = {CELLS[kind].dimension for name in names for kind, _ in self.parts.get(name, ())}
        chosen_ones = self.dimension - 1 in dimensions or (len(names) > 1 and dimensions == {self.dimension})
        pools = [self.boundary] + [self.inner] * chosen_ones
        chosen = [[facets[rows_in(facets, known.get(facets.shape[1], facets[:0]))] for facets in pool] for pool in pools]
        return [np.concatenate(parts) for parts in zip(*chosen, strict=True)]

    def region(self, where: str | Where) -> NDArray[np.bool_]:
        """(C,) the cells that a place of a file is made of, or whose centres lie at one by coordinates. Raises `InputError`: none do."""
        if isinstance(where, Where):
            found = inside(self.points[self.cells].mean(axis=1), where)
        else:
            found = rows_in(self.cells, self.entities(where).get(self.cells.shape[1], self.cells[:0]))
        if not found.any():
            raise InputError(f"no cell {'has its centre there' if isinstance(where, Where) else 'is made of it: it is no region'}")
        return found

    def entities(self, where: str | Where) -> Entities:
        """The vertices, edges, faces and cells that a place is made of; see `place` for where."""
        nodes = self.place(where)
        if isinstance(where, str) and where in self.parts:
            return closure(self.parts[where])
        if isinstance(where, str) and where not in self.places:
            first, *others = (self.entities(name) for name in where.split())
            for other in others:
                first = {k: rows[rows_in(rows, other[k])] for k, rows in first.items() if k in other}
            return first
        inside = np.zeros(len(self.points), bool)
        inside[nodes] = True
        outer: Parts = [(self.kind_of(facets), facets[inside[facets].any(axis=1)]) for facets in self.boundary]
        between = {k: rows[inside[rows].all(axis=1)] for k, rows in closure(outer).items()}
        return between | {1: nodes[:, None]}


def closure(parts: Parts) -> Entities:
    """All vertices, edges and faces of some cells of any kinds, and the cells themselves, each once."""
    found: dict[int, list[Integers]] = {}
    for kind, cells in parts:
        found.setdefault(1, []).append(cells.reshape(-1, 1))
        for local in {*CELLS[kind].edges, *CELLS[kind].facets, tuple(range(cells.shape[1]))}:
            found.setdefault(len(local), []).append(cells[:, list(local)])
    return {k: unique_rows(np.sort(np.concatenate(rows), axis=1)) for k, rows in found.items()}


def pieces(mesh: Mesh) -> list[Integers]:
    """The nodes of each piece of a mesh that hangs together; one array of all of them in the usual case."""
    label = piece_of(len(mesh.points), mesh.cells)
    return [np.flatnonzero(label == i) for i in range(int(label.max()) + 1)]


def unique_edges(cells: Integers, cell: str) -> Integers:
    """(E, 2) edges of some cells, each once, the smaller node number first."""
    pairs = np.concatenate([cells[:, list(edge)] for edge in CELLS[cell].edges])
    return unique_rows(np.sort(pairs, axis=1))
