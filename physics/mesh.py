"""Points and cells of a body, its outer surface, and its named faces.

Cells are listed in gmsh's vertex order with positive volume, which is VTK's order for the cell types used here.
Legend: N nodes, C cells, F facets.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.scene import PLACES, Body

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

VTK_TYPE = {"triangle": 5, "quadrilateral": 9, "tetrahedron": 10, "hexahedron": 12, "prism": 13}

# The facets of each cell, outward by the right-hand rule.
FACETS = {
    "tetrahedron": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "prism": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}
EDGES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "tetrahedron": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    "prism": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
}


@dataclass(frozen=True)
class Mesh:
    """A body's mesh of one cell type.

    points: (N, 3) rest positions [m]
    cells: (C, n) node numbers, n = 4, 6 or 8
    cell: tetrahedron, prism or hexahedron
    places: sorted node numbers of each named face
    """

    points: Floats
    cells: Integers
    cell: str
    places: dict[str, Integers]

    @cached_property
    def surface(self) -> list[Integers]:
        """Outer facets, outward by the right-hand rule: one array (F, 3) of triangles and one (F, 4) of quadrilaterals, if any."""
        surface = []
        for n in (3, 4):
            local = [facet for facet in FACETS[self.cell] if len(facet) == n]
            if not local:
                continue
            facets = np.concatenate([self.cells[:, list(facet)] for facet in local])
            _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
            surface.append(facets[np.sort(first[count == 1])])
        return surface

    @cached_property
    def edges(self) -> Integers:
        """(E, 2) edges of the cells, each once, the smaller node number first."""
        return unique_edges(self.cells, self.cell)

    def facets(self, place: str) -> list[Integers]:
        """The outer facets whose nodes all lie in a named face."""
        inside = np.zeros(len(self.points), bool)
        inside[self.places[place]] = True
        return [facets[inside[facets].all(axis=1)] for facets in self.surface]


def unique_edges(cells: Integers, cell: str) -> Integers:
    """(E, 2) edges of some cells, each once, the smaller node number first."""
    pairs = np.concatenate([cells[:, list(edge)] for edge in EDGES[cell]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def write_mesh(path: str | Path, mesh: Mesh, fields: dict[str, Floats]) -> None:
    """Write a mesh and its nodal fields (N,) or (N, 3) to a file of any kind that meshio knows by its ending."""
    import meshio

    kind = {"prism": "wedge", "tetrahedron": "tetra"}.get(mesh.cell, mesh.cell)
    meshio.Mesh(mesh.points, [(kind, mesh.cells)], point_data=fields).write(path)


def build_mesh(body: Body) -> Mesh:
    """The mesh of a body.

    Prisms have their triangles normal to x. The diagonals of the section alternate like a chess board: were they all
    parallel, a symmetric load would drive the beam sideways. Tetrahedra come from cutting each prism in three.
    """
    nx, ny, nz = body.divisions
    x, y, z = (np.linspace(0.0, side, n + 1) for side, n in zip(body.extent, (nx, ny, nz), strict=True))
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)

    section = np.arange((ny + 1) * (nz + 1)).reshape(ny + 1, nz + 1)
    a, b, c, d = section[:-1, :-1].ravel(), section[1:, :-1].ravel(), section[1:, 1:].ravel(), section[:-1, 1:].ravel()
    layer = np.arange(nx)[:, None, None] * (ny + 1) * (nz + 1)
    above = (ny + 1) * (nz + 1)
    if body.cell == "hexahedron":
        base = np.stack([a, b, c, d], axis=1)
        cells = np.concatenate([base + layer, base + layer + above], axis=2).reshape(-1, 8)
    else:
        even = (np.add.outer(np.arange(ny), np.arange(nz)) % 2 == 0).ravel()[:, None]
        first = np.where(even, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
        second = np.where(even, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
        triangles = np.stack([first, second], axis=1).reshape(-1, 3)
        cells = np.concatenate([triangles + layer, triangles + layer + above], axis=2).reshape(-1, 6)
        if body.cell == "tetrahedron":
            cells = _tetrahedra(cells)

    tolerance = 1e-9 * max(body.extent)
    sides = [(axis, end) for axis, side in enumerate(body.extent) for end in (0.0, side)]
    places = {
        name: np.flatnonzero(abs(points[:, axis] - end) < tolerance)
        for name, (axis, end) in zip(PLACES, sides, strict=True)
    }
    return Mesh(points, cells.astype(np.int64), body.cell, places)


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
