"""Points and cells of a body, its outer surface, and its named places; boxes of any cell.

Cells are listed in gmsh's vertex order with positive volume, which is VTK's order for the cell types used here. Plane
bodies lie in z = 0. Legend: N nodes, C cells, F facets, k corners.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from physics.scene import PLACES, PLANE_CELLS, Body
from physics.schema import InputError, nearest

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

VTK_TYPE = {"triangle": 5, "quadrilateral": 9, "tetrahedron": 10, "hexahedron": 12, "prism": 13}
DIMENSION = {"vertex": 0, "line": 1, "triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3, "prism": 3}
PLURAL = {"triangle": "triangles", "quadrilateral": "quadrilaterals", "tetrahedron": "tetrahedra", "hexahedron": "hexahedra",
          "prism": "prisms"}

# The facets of each cell, outward by the right-hand rule (of a plane cell: its edges, counter-clockwise).
FACETS = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetrahedron": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "prism": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}
EDGES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetrahedron": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    "prism": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
}
Parts = list[tuple[str, Integers]]  # kinds (keys of DIMENSION) with their node numbers (.., k)
Entities = dict[int, Integers]  # (.., k) for each number of corners k, each row sorted


@dataclass(frozen=True)
class Mesh:
    """A body's mesh of one cell type.

    points: (N, 3) rest positions [m]
    cells: (C, k) node numbers
    cell: triangle, quadrilateral, tetrahedron, prism or hexahedron
    places: sorted node numbers of each named place
    parts: what each place of a file is made of; without it a place is made of the outer facets between its nodes
    remarks: what was found odd when the mesh was read, a line each
    """

    points: Floats
    cells: Integers
    cell: str
    places: dict[str, Integers]
    parts: dict[str, Parts] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def dimension(self) -> int:
        """3 for a solid body, 2 for a plane one."""
        return DIMENSION[self.cell]

    @cached_property
    def boundary(self) -> list[Integers]:
        """Outer facets, outward by the right-hand rule: one array (F, k) for each number of corners k, if there are any."""
        boundary = []
        for n in (2, 3, 4):
            local = [facet for facet in FACETS[self.cell] if len(facet) == n]
            if not local:
                continue
            facets = np.concatenate([self.cells[:, list(facet)] for facet in local])
            _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
            boundary.append(facets[np.sort(first[count == 1])])
        return boundary

    @property
    def surface(self) -> list[Integers]:
        """What can be seen: the outer facets of a solid body, (F, 3) triangles and (F, 4) quadrilaterals; of a plane one all cells."""
        return self.boundary if self.dimension == 3 else [self.cells]

    @cached_property
    def edges(self) -> Integers:
        """(E, 2) edges of the cells, each once, the smaller node number first."""
        return unique_edges(self.cells, self.cell)

    def place(self, where: str) -> Integers:
        """The sorted nodes of a place, or what several places with blanks between them have in common. Raises `InputError`."""
        if where in self.places:
            return self.places[where]
        names = where.split()
        for name in names if len(names) > 1 else [where]:
            if name not in self.places:
                known = ", ".join(self.places) or "none at all"
                raise InputError(f"no place named {name!r} in the mesh: there are {known}{nearest(name, self.places)}")
        common = self.places[names[0]]
        for name in names[1:]:
            common = np.intersect1d(common, self.places[name])
        if not len(common):
            raise InputError(f"the places {where!r} have no node in common")
        return common

    def facets(self, place: str) -> list[Integers]:
        """The outer facets in a named place: those of a file's group, or those whose nodes all lie in a shape's face."""
        if place in self.parts:
            known = closure(self.parts[place])
            return [facets[rows_in(facets, known.get(facets.shape[1], facets[:0]))] for facets in self.boundary]
        inside = np.zeros(len(self.points), bool)
        inside[self.place(place)] = True
        return [facets[inside[facets].all(axis=1)] for facets in self.boundary]

    def entities(self, where: str) -> Entities:
        """The vertices, edges, faces and cells that a place is made of; see `place` for where."""
        nodes = self.place(where)
        if where in self.parts:
            return closure(self.parts[where])
        if where not in self.places:
            first, *others = (self.entities(name) for name in where.split())
            for other in others:
                first = {k: rows[rows_in(rows, other[k])] for k, rows in first.items() if k in other}
            return first
        inside = np.zeros(len(self.points), bool)
        inside[nodes] = True
        outer: Parts = [(kind_of(facets), facets) for facets in self.boundary]
        between = {k: rows[inside[rows].all(axis=1)] for k, rows in closure(outer).items()}
        return between | {1: nodes[:, None]}


def kind_of(facets: Integers) -> str:
    """The kind of facets (F, k)."""
    return {2: "line", 3: "triangle", 4: "quadrilateral"}[facets.shape[1]]


def closure(parts: Parts) -> Entities:
    """All vertices, edges and faces of some cells of any kinds, and the cells themselves, each once."""
    found: dict[int, list[Integers]] = {}
    for kind, cells in parts:
        found.setdefault(1, []).append(cells.reshape(-1, 1))
        for local in {*EDGES.get(kind, ()), *FACETS.get(kind, ()), tuple(range(cells.shape[1]))}:
            found.setdefault(len(local), []).append(cells[:, list(local)])
    return {k: np.unique(np.sort(np.concatenate(rows), axis=1), axis=0) for k, rows in found.items()}


def rows_in(rows: Integers, table: Integers) -> NDArray[np.bool_]:
    """For each row of node numbers (n, k) whether the table (m, k) has it, in any order of the numbers."""
    both = np.sort(np.concatenate([rows, table]), axis=1)
    key, base = both[:, 0], int(both.max(initial=0)) + 1
    for column in both.T[1:]:
        _, key = np.unique(key * base + column, return_inverse=True)
    return np.isin(key[:len(rows)], key[len(rows):])


def pieces(mesh: Mesh) -> list[Integers]:
    """The nodes of each piece of a mesh that hangs together; one array of all of them in the usual case."""
    n = len(mesh.points)
    links = np.stack([np.repeat(mesh.cells[:, 0], mesh.cells.shape[1] - 1), mesh.cells[:, 1:].ravel()])
    graph = scipy.sparse.coo_matrix((np.ones(links.shape[1], np.int8), links), shape=(n, n))
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return [np.arange(n)] if count == 1 else [np.flatnonzero(label == i) for i in range(count)]


def unique_edges(cells: Integers, cell: str) -> Integers:
    """(E, 2) edges of some cells, each once, the smaller node number first."""
    pairs = np.concatenate([cells[:, list(edge)] for edge in EDGES[cell]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def write_mesh(path: str | Path, mesh: Mesh, fields: dict[str, Floats]) -> None:
    """Write a mesh and its nodal fields (N,) or (N, 3) to a file of any kind that meshio knows by its ending; its folder is made."""
    import meshio

    Path(path).parent.mkdir(parents=True, exist_ok=True)
    kind = {"prism": "wedge", "tetrahedron": "tetra", "quadrilateral": "quad"}.get(mesh.cell, mesh.cell)
    meshio.Mesh(mesh.points, [(kind, mesh.cells)], point_data=fields).write(path)


def build_mesh(body: Body) -> Mesh:
    """The mesh of a body, built or read. Raises `InputError` when a file is not what it should be."""
    if body.shape == "file":
        from physics.meshfile import read_mesh  # both build upon this module

        assert body.path is not None
        return read_mesh(body.path, order=body.order)
    if body.shape == "channel":
        from physics.channel import channel

        return channel(body)
    if body.cell in PLANE_CELLS:
        return _rectangle(body)
    return _box(body)


def _box(body: Body) -> Mesh:
    """A box of solid cells.

    Prisms of a beam have their triangles normal to x, those of a plate normal to z. The diagonals alternate like a chess
    board: were they all parallel, a symmetric load would drive a beam sideways. Tetrahedra come from cutting each prism in
    three.
    """
    turn = 1 if body.shape == "plate" else 0  # how often the axes (x, y, z) go round to bring the layers' normal first
    extent, divisions = np.roll(body.extent, turn), np.roll(body.divisions, turn)
    nx, ny, nz = (int(n) for n in divisions)
    x, y, z = (np.linspace(0.0, side, n + 1) for side, n in zip(extent, (nx, ny, nz), strict=True))
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)

    a, b, c, d = _squares(ny, nz)
    layer = np.arange(nx)[:, None, None] * (ny + 1) * (nz + 1)
    above = (ny + 1) * (nz + 1)
    if body.cell == "hexahedron":
        base = np.stack([a, b, c, d], axis=1)
        cells = np.concatenate([base + layer, base + layer + above], axis=2).reshape(-1, 8)
    else:
        triangles = _halves(a, b, c, d, ny, nz)
        cells = np.concatenate([triangles + layer, triangles + layer + above], axis=2).reshape(-1, 6)
        if body.cell == "tetrahedron":
            cells = _tetrahedra(cells)
    points = np.roll(points, -turn, axis=1)
    return Mesh(points, cells.astype(np.int64), body.cell, faces(points, body.extent))


def _rectangle(body: Body) -> Mesh:
    """A plane rectangle of triangles, their diagonals alternating, or of quadrilaterals."""
    nx, ny = body.divisions
    x, y = (np.linspace(0.0, side, n + 1) for side, n in zip(body.extent[:2], (nx, ny), strict=True))
    points = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    corners = _squares(nx, ny)
    cells = np.stack(corners, axis=1) if body.cell == "quadrilateral" else _halves(*corners, nx, ny)
    return Mesh(points, cells.astype(np.int64), body.cell, faces(points, body.extent))


def faces(points: Floats, extent: tuple[float, float, float]) -> dict[str, Integers]:
    """The nodes on the faces of a box of that extent from the origin; of a plane one on its sides."""
    tolerance = 1e-9 * max(extent)
    sides = [(axis, end) for axis, side in enumerate(extent) for end in (0.0, side) if side]
    near = [np.flatnonzero(abs(points[:, axis] - end) < tolerance) for axis, end in sides]
    return dict(zip(PLACES, near, strict=False))


def _squares(m: int, n: int) -> tuple[Integers, Integers, Integers, Integers]:
    """The corners of the squares of a grid of m x n, (m n,) each, going round; nodes are numbered along the second axis."""
    node = np.arange((m + 1) * (n + 1)).reshape(m + 1, n + 1)
    return node[:-1, :-1].ravel(), node[1:, :-1].ravel(), node[1:, 1:].ravel(), node[:-1, 1:].ravel()


def _halves(a: Integers, b: Integers, c: Integers, d: Integers, m: int, n: int) -> Integers:
    """(2 m n, 3) two triangles of each square, cut by alternating diagonals."""
    even = (np.add.outer(np.arange(m), np.arange(n)) % 2 == 0).ravel()[:, None]
    first = np.where(even, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(even, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return np.stack([first, second], axis=1).reshape(-1, 3)


def _tetrahedra(prisms: Integers) -> Integers:
    """Three tetrahedra for each prism; the diagonals of shared quadrilaterals start at the smaller node number, so they match."""
    # Turn every prism so that its smallest node comes first: the base is then cut from vertex 0 on both of its sides.
    turned = np.stack([np.roll(np.arange(3), -k) for k in range(3)])
    lowest = np.argmin(prisms[:, :3], axis=1)
    order = np.concatenate([turned[lowest], turned[lowest] + 3], axis=1)
    p = np.take_along_axis(prisms, order, axis=1)
    rising = (p[:, 1] < p[:, 2])[:, None]
    cut = np.where(rising[:, :, None], _pick(p, ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3))),
                   _pick(p, ((0, 1, 2, 4), (0, 4, 2, 5), (0, 4, 5, 3))))
    return cut.reshape(-1, 4)


def _pick(prisms: Integers, vertices: tuple[tuple[int, ...], ...]) -> Integers:
    return prisms[:, np.array(vertices)]
