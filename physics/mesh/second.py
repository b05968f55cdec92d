"""A mesh of first order made one of second order, whose cells have nodes in the middles of their edges too, and back.

The corners come first, as the mesh of first order numbers them. A middle node lies where a file had it (sound/curved.py), else in the
middle of a straight edge. What was made of triangles is made of such with six nodes, what was made of lines of such with three.

Legend: N nodes, C cells, n nodes of a cell, k corners of an entity.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, SECOND
from physics.mesh.mesh import Integers, Mesh, Parts
from physics.mesh.sound.curved import complete, table
from physics.mesh.sound.rows import keyed, row_in

Floats = NDArray[np.float64]

# Small tetrahedra of one of ten nodes: one at each corner, four about the line between the middles of two opposite edges.
EIGHT = ((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3), (4, 5, 6, 9), (4, 6, 7, 9), (4, 7, 8, 9), (4, 8, 5, 9))
STRAIGHT = 1e-9  # of an edge's length: what rounding leaves


def second_order(mesh: Mesh) -> Mesh:
    """The mesh with cells of second order, its places with the middles of what they are made of."""
    cell = CELLS[SECOND[mesh.cell]]
    middles = complete(mesh.points, mesh.cells, mesh.cell, mesh.middles)
    points, inside = table(mesh.points, mesh.cells, middles, list(cell.middles))
    first = dict(zip(middles, np.cumsum([len(mesh.points), *(len(at) for _, at in middles.values())]).tolist(), strict=False))

    def number(rows: Integers) -> Integers:
        """The node in the middle of each of some entities (m, k); -1 where there is none."""
        if rows.shape[1] not in middles:
            return np.full(len(rows), -1)
        row = row_in(middles[rows.shape[1]][0], np.sort(rows, axis=1))
        return np.where(row < 0, -1, first[rows.shape[1]] + row)

    def made_of(kind: str, rows: Integers) -> tuple[str, Integers]:
        if kind not in SECOND:
            return kind, rows
        more = [number(rows[:, list(local)]) for local in CELLS[SECOND[kind]].middles]
        # What is no side of a cell keeps a row, of its first corner again, so that it is still noticed.
        return SECOND[kind], np.concatenate([rows, *(np.where(column < 0, rows[:, 0], column)[:, None] for column in more)], axis=1)

    places: dict[str, Integers] = {}
    parts: dict[str, Parts] = {}
    for name, nodes in mesh.places.items():
        everything = np.concatenate([nodes, *(number(rows) for k, rows in mesh.entities(name).items() if k > 1)])
        places[name] = np.unique(everything[everything >= 0])
        if name in mesh.parts:
            parts[name] = [made_of(*part) for part in mesh.parts[name]]
    return replace(mesh, points=points, cells=np.concatenate([mesh.cells, inside], axis=1), cell=cell.name, places=places, parts=parts,
                   middles={})


def corners_only(mesh: Mesh) -> Mesh:
    """The mesh of first order behind one of second order, with straight sides; its nodes are the first ones of that."""
    cell = CELLS[mesh.cell]
    cells = mesh.cells[:, :cell.corners]
    count = int(cells.max()) + 1
    parts = {name: [(CELLS[kind].first or kind, rows[:, :CELLS[kind].corners]) for kind, rows in made] for name, made in mesh.parts.items()}
    places = {name: nodes[nodes < count] for name, nodes in mesh.places.items()}
    return replace(mesh, points=mesh.points[:count], cells=cells, cell=cell.first, places=places, parts=parts)


def cut_into_eight(cells: Integers) -> Integers:
    """(8 C, 4) tetrahedra of four nodes in place of each of C of ten nodes, eight in a row for each; edges match from cell to cell."""
    return cells[:, EIGHT].reshape(-1, 4)


def further(mesh: Mesh, between: list[tuple[int, ...]]) -> tuple[Floats, Integers]:
    """Points (N, 3), and for each cell (C, m) which of them lies between each of some lists of its corners."""
    cell = CELLS[mesh.cell]
    if not cell.middles:
        return table(mesh.points, mesh.cells, mesh.middles, between)
    column = {frozenset(local): cell.corners + i for i, local in enumerate(cell.middles)}
    return mesh.points, mesh.cells[:, [column[frozenset(local)] for local in between]]


def middle_nodes(mesh: Mesh, corners: Integers) -> Integers:
    """The node between each of some corners (m, k) of a cell; -1 where there is none, as on cells of first order."""
    columns = [(i, local) for i, local in enumerate(CELLS[mesh.cell].middles) if len(local) == corners.shape[1]]
    if not columns:
        return np.full(len(corners), -1)
    known = np.concatenate([np.sort(mesh.cells[:, list(local)], axis=1) for _, local in columns])
    node = np.concatenate([mesh.cells[:, CELLS[mesh.cell].corners + i] for i, _ in columns])
    first = np.unique(keyed(known), return_index=True)[1]
    row = row_in(known[first], np.sort(corners, axis=1))
    return np.where(row < 0, -1, node[first[row]])


def off_straight(mesh: Mesh) -> Floats:
    """(C,) how far the middles of each cell of second order lie from those of straight sides, over the cell's size."""
    cell = CELLS[mesh.cell]
    x = mesh.points[mesh.cells]
    straight = np.stack([x[:, list(corners)].mean(axis=1) for corners in cell.middles], axis=1)
    return np.asarray(abs(x[:, cell.corners:] - straight).max(axis=(1, 2)) / np.ptp(x, axis=1).max(axis=1))


def is_curved(mesh: Mesh) -> bool:
    """Whether some side is curved, by more than rounding."""
    return bool((off_straight(mesh) > STRAIGHT).any()) if CELLS[mesh.cell].middles else bool(mesh.middles)
