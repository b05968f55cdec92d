"""Everything that depends on the type of a cell: its names in other programs, its corners, edges and facets, its shape functions, its rule.

Corners are in gmsh's order, which is VTK's for these cells; in this order a cell of the rest body has positive volume. A cell's own
coordinates (r, s, t) go from 0 to 1; a plane cell has t = 0. The shape functions are products of linear functions,

    triangle      1 - r - s, r, s
    quadrilateral (1 - r, r) x (1 - s, s)                         around it, not row by row
    tetrahedron   1 - r - s - t, r, s, t
    prism         (1 - r - s, r, s) x (1 - t, t)
    hexahedron    (1 - r, r) x (1 - s, s) x (1 - t, t)           around each square, not row by row

and the rule of integration is exact for polynomials of degree 1 in triangles and tetrahedra, where strain is constant, and of degree 2
across and 3 along the lines of the others. With one point, a prism would let motions without energy through.
Legend: n corners of a cell, P points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics.schema import InputError

Floats = NDArray[np.float64]
Corners = tuple[tuple[int, ...], ...]
ShapeFunctions = Callable[[Floats, Floats, Floats], tuple[list[Any], list[tuple[Any, ...]]]]

GAUSS = (0.5 - 12**-0.5, 0.5 + 12**-0.5)  # two points on [0, 1], each of weight 1/2
TRIANGLE = ((1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))  # three points, each of weight 1/6
HEXAHEDRON = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))  # its corners' coordinates


@dataclass(frozen=True, eq=False)
class Cell:
    """One type of cell, or of what cells are bounded by.

    corners: how many; vtk, meshio: its number and its name there
    edges, facets: pairs and rows of corners; facets outward by the right-hand rule (of a plane cell: its edges, counter-clockwise)
    mirrored: the corners in the order that turns a negative volume into a positive one
    shape_functions: of (r, s, t), their values and gradients; cells of a body have them
    points, weights: the rule, (P, 3) and (P,); the weights' sum is the cell's volume or area in its own coordinates
    """

    name: str
    plural: str
    dimension: int
    corners: int
    vtk: int
    meshio: str
    edges: Corners = ()
    facets: Corners = ()
    mirrored: tuple[int, ...] = ()
    shape_functions: ShapeFunctions | None = None
    points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    weights: Floats = field(default_factory=lambda: np.empty(0))

    def shapes(self, at: ArrayLike) -> tuple[Floats, Floats]:
        """(..., n) shape functions and (..., n, 3) their gradients at places (..., 3); one of the functions is negative outside."""
        if self.shape_functions is None:
            raise InputError(f"cell = {self.name!r}: must be one of triangle, quadrilateral, tetrahedron, prism, hexahedron")
        values, gradients = self.shape_functions(*np.moveaxis(np.asarray(at, np.float64), -1, 0))
        return np.stack(values, axis=-1), np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in gradients], axis=-2)


def _triangle(r: Floats, s: Floats, t: Floats) -> tuple[list[Any], list[tuple[Any, ...]]]:
    zero, one = np.zeros_like(r), np.ones_like(r)
    return [1 - r - s, r, s], [(-one, -one, zero), (one, zero, zero), (zero, one, zero)]


def _quadrilateral(r: Floats, s: Floats, t: Floats) -> tuple[list[Any], list[tuple[Any, ...]]]:
    zero = np.zeros_like(r)
    return [(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s], [(s - 1, r - 1, zero), (1 - s, -r, zero), (s, r, zero), (-s, 1 - r, zero)]


def _tetrahedron(r: Floats, s: Floats, t: Floats) -> tuple[list[Any], list[tuple[Any, ...]]]:
    zero, one = np.zeros_like(r), np.ones_like(r)
    return [1 - r - s - t, r, s, t], [(-one, -one, -one), (one, zero, zero), (zero, one, zero), (zero, zero, one)]


def _prism(r: Floats, s: Floats, t: Floats) -> tuple[list[Any], list[tuple[Any, ...]]]:
    zero = np.zeros_like(r)
    return ([(1 - r - s) * (1 - t), r * (1 - t), s * (1 - t), (1 - r - s) * t, r * t, s * t],
            [(t - 1, t - 1, r + s - 1), (1 - t, zero, -r), (zero, 1 - t, -s), (-t, -t, 1 - r - s), (t, zero, r), (zero, t, s)])


def _hexahedron(r: Floats, s: Floats, t: Floats) -> tuple[list[Any], list[tuple[Any, ...]]]:
    values, gradients = [], []
    for corner in HEXAHEDRON:  # x or 1 - x of each coordinate, and their slopes
        (a, da), (b, db), (c, dc) = ((x, 1.0) if upper else (1 - x, -1.0) for x, upper in zip((r, s, t), corner, strict=True))
        values.append(a * b * c)
        gradients.append((da * (b * c), db * (a * c), dc * (a * b)))
    return values, gradients


_ALL = (
    Cell("vertex", "vertices", 0, 1, 1, "vertex"),
    Cell("line", "lines", 1, 2, 3, "line"),
    Cell("triangle", "triangles", 2, 3, 5, "triangle", edges=((0, 1), (1, 2), (2, 0)), facets=((0, 1), (1, 2), (2, 0)), mirrored=(0, 2, 1),
         shape_functions=_triangle, points=np.array([(1 / 3, 1 / 3, 0.0)]), weights=np.array([1 / 2])),
    Cell("quadrilateral", "quadrilaterals", 2, 4, 9, "quad", edges=((0, 1), (1, 2), (2, 3), (3, 0)),
         facets=((0, 1), (1, 2), (2, 3), (3, 0)), mirrored=(0, 3, 2, 1), shape_functions=_quadrilateral,
         points=np.array([(r, s, 0.0) for r, s in product(GAUSS, repeat=2)]), weights=np.full(4, 1 / 4)),
    Cell("tetrahedron", "tetrahedra", 3, 4, 10, "tetra", edges=((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
         facets=((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)), mirrored=(0, 2, 1, 3), shape_functions=_tetrahedron,
         points=np.full((1, 3), 0.25), weights=np.array([1 / 6])),
    Cell("hexahedron", "hexahedra", 3, 8, 12, "hexahedron",
         edges=((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
         facets=((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)), mirrored=(0, 3, 2, 1, 4, 7, 6, 5),
         shape_functions=_hexahedron,
         points=np.array(list(product(GAUSS, repeat=3))), weights=np.full(8, 1 / 8)),
    Cell("prism", "prisms", 3, 6, 13, "wedge", edges=((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
         facets=((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)), mirrored=(0, 2, 1, 3, 5, 4),
         shape_functions=_prism,
         points=np.array([(r, s, t) for t in GAUSS for r, s in TRIANGLE]), weights=np.full(6, 1 / 12)),
)
CELLS = {cell.name: cell for cell in _ALL}
OF_VTK = {cell.vtk: cell for cell in _ALL if cell.dimension >= 2}  # what a trajectory is made of
OF_MESHIO = {cell.meshio: cell for cell in _ALL}
