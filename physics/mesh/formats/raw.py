"""What a mesh file says, before anybody judges it. Legend: N nodes, C cells of a block, n nodes of each.

A name may stand for several things at once: a group of faces and one of cells may both be number 1. So a group is known by its
dimension as well, and sets of nodes stand apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, OF_MESHIO, Corners
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Where VTK has the nodes of cells of second order behind the corners: on edges, then on faces, then in the middle.
_HEXAHEDRON = CELLS["hexahedron"].edges
VTK_MIDDLES: dict[str, Corners] = {
    "line": ((0, 1),), "triangle": CELLS["triangle"].edges, "tetrahedron": CELLS["tetrahedron"].edges,
    "quadrilateral": (*CELLS["quadrilateral"].edges, (0, 1, 2, 3)),
    "hexahedron": (*_HEXAHEDRON, (0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7), tuple(range(8)))}


@dataclass(frozen=True)
class CellBlock:
    """Cells of one kind.

    nodes: (C, n) numbers of nodes, corners first, in gmsh's order; labels: (C,) what the file calls the cells, if anything
    middles: the corners between which each further node lies; () where they are not known or of no use
    """

    kind: str
    nodes: Integers
    labels: Integers | None = None
    middles: Corners = ()


@dataclass(frozen=True)
class Raw:
    """A mesh file.

    points: (N, 2 or 3) [whatever unit the file has]; labels: (N,) what the file calls the nodes, if anything
    groups: (name, dimension) to pairs of a block's number and which of its cells; node_sets: name to numbers of nodes
    """

    points: Floats
    blocks: list[CellBlock]
    groups: dict[tuple[str, int], list[tuple[int, Integers]]] = field(default_factory=dict)
    node_sets: dict[str, Integers] = field(default_factory=dict)
    labels: Integers | None = None


def block(kind: str, nodes: Integers, labels: Integers | None = None, middles: Corners | None = None) -> CellBlock:
    """A block with as many middles as its cells have further nodes; none if the cells have others. Raises `InputError` for other kinds."""
    if kind not in CELLS:
        raise InputError(f"has cells of kind {kind!r}; known are {', '.join(OF_MESHIO)}")
    extra = nodes.shape[1] - CELLS[kind].corners
    known = VTK_MIDDLES.get(kind, ()) if middles is None else middles
    fits = extra in (len(CELLS[kind].edges), len(known))
    return CellBlock(kind, nodes, labels, tuple(known[:extra]) if extra and fits else ())


def numbered(labels: Integers, asked: Integers) -> Integers:
    """The positions of some labels among those that there are, -1 for one that is not there; the last of equal ones counts."""
    order = np.argsort(labels, kind="stable")
    if not len(order):
        return np.full(asked.shape, -1, np.int64)
    place = np.clip(np.searchsorted(labels, asked, side="right", sorter=order) - 1, 0, len(order) - 1)
    return np.where(labels[order[place]] == asked, order[place], -1)
