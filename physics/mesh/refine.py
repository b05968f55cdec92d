"""A mesh with every cell cut into cells of half the size, whatever its kind; the places are cut with it.

The new nodes lie in the middle of edges, of quadrilaterals and of hexahedra: each is the mean of the corners of one of them. The cell
at corner c has, in place of each corner d, the middle of what c and d span. Beside these a triangle leaves one in its middle, a
prism two, and a tetrahedron an octahedron, which is cut into four along one diagonal (Bey, Computing 55, 1995).

Legend: N nodes, C cells, k corners of a cell, s corners whose mean is a new node.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from physics.mesh.cell import CELLS, HEXAHEDRON
from physics.mesh.mesh import Integers, Mesh
from physics.mesh.second import corners_only, second_order
from physics.mesh.sound.rows import row_in, unique_rows

Corners = tuple[int, ...]


def _line(c: int, d: int) -> Corners:
    return tuple(sorted({c, d}))


def _grid(places: tuple[Corners, ...]) -> list[list[Corners]]:
    """Of a line, a quadrilateral or a hexahedron with its corners at these places: the nodes of each smaller cell."""
    def between(a: Corners, b: Corners) -> Corners:
        return tuple(i for i, place in enumerate(places) if all(p in (x, y) for p, x, y in zip(place, a, b, strict=True)))

    return [[between(a, b) for b in places] for a in places]


def _prism() -> list[list[Corners]]:
    def across(triangle: Corners, layers: Corners) -> Corners:
        return tuple(3 * layer + corner for layer in layers for corner in triangle)

    return [[across(triangle[d], _line(layer, other)) for other, d in product((0, 1), range(3))]
            for layer in (0, 1) for triangle in CHILDREN["triangle"]]


# Of each kind of cell its smaller ones, and of these the nodes: the corners of the whole whose mean they are.
CHILDREN: dict[str, list[list[Corners]]] = {
    "vertex": [[(0,)]],
    "line": _grid(((0,), (1,))),
    "quadrilateral": _grid(tuple(corner[:2] for corner in HEXAHEDRON[:4])),
    "hexahedron": _grid(HEXAHEDRON),
    "triangle": [[_line(c, d) for d in range(3)] for c in range(3)] + [[(1, 2), (0, 2), (0, 1)]],
    "tetrahedron": [[_line(c, d) for d in range(4)] for c in range(4)] + [
        [(0, 1), (0, 2), (0, 3), (1, 3)], [(0, 1), (1, 2), (0, 2), (1, 3)], [(0, 2), (1, 3), (2, 3), (0, 3)],
        [(0, 2), (1, 2), (2, 3), (1, 3)]],
}
CHILDREN["prism"] = _prism()


def halved(mesh: Mesh) -> Mesh:
    """The mesh on cells of half the size; its first N nodes are those of the mesh, of second order not the first, but among them.

    Curved cells of second order are cut along their own coordinates, so their sides stay where they are.
    """
    if CELLS[mesh.cell].middles:
        return _halved_second(mesh)
    keys: dict[int, Integers] = {}  # (.., s) sorted corners of the new nodes, for each s > 1
    for corners in {corners for child in CHILDREN[mesh.cell] for corners in child if len(corners) > 1}:
        rows = np.sort(mesh.cells[:, list(corners)], axis=1)
        keys[len(corners)] = np.concatenate([keys.get(len(corners), rows[:0]), rows])
    keys = {size: unique_rows(rows) for size, rows in keys.items()}
    first = dict(zip(keys, np.cumsum([len(mesh.points), *(len(rows) for rows in keys.values())]).tolist(), strict=False))

    def numbers(rows: Integers) -> Integers:
        """The node in the middle of each of some corners (n, s); -1 where the mesh has none."""
        size = rows.shape[1]
        if size == 1:
            return rows[:, 0]
        if size not in keys:
            return np.full(len(rows), -1)
        row = row_in(keys[size], np.sort(rows, axis=1))
        return np.where(row < 0, -1, first[size] + row)

    def cut(kind: str, cells: Integers) -> Integers:
        """The smaller cells (n, k) in some cells; those without all their nodes are left out."""
        found = np.concatenate([np.stack([numbers(cells[:, list(corners)]) for corners in child], axis=1) for child in CHILDREN[kind]])
        return found[(found >= 0).all(axis=1)]

    points = np.concatenate([mesh.points, *(mesh.points[rows].mean(axis=1) for rows in keys.values())])
    places, parts = {}, {}
    for name, nodes in mesh.places.items():
        middles = [numbers(rows) for size, rows in mesh.entities(name).items() if size > 1]
        everything = np.concatenate([nodes, *middles])
        places[name] = np.unique(everything[everything >= 0])
        if name in mesh.parts:
            parts[name] = [(kind, cut(kind, cells)) for kind, cells in mesh.parts[name]]
    cells = cut(mesh.cell, mesh.cells)
    assert len(cells) == len(CHILDREN[mesh.cell]) * len(mesh.cells) and cells.shape[1] == CELLS[mesh.cell].corners
    return replace(mesh, points=points, cells=cells, places=places, parts=parts)


def _halved_second(mesh: Mesh) -> Mesh:
    cell = CELLS[mesh.cell]
    finer = halved(corners_only(mesh))  # child after child, of all cells
    fine = second_order(finer)
    points = fine.points.copy()
    for i, child in enumerate(CHILDREN[cell.first]):
        corners = np.array([cell.places[list(of)].mean(axis=0) for of in child])
        at = np.concatenate([corners, *(corners[list(of)].mean(axis=0)[None] for of in cell.middles)])
        own = fine.cells[i * len(mesh.cells):(i + 1) * len(mesh.cells)]
        points[own] = cell.shapes(at)[0] @ mesh.points[mesh.cells]
    return replace(fine, points=points)
