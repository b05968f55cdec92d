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

Cells of second order have further nodes behind their corners, in VTK's order: in the middles of edges, and tensor products also in those of
squares and of the cell. With l = (1 - r - s - t, r, s, t) and the quadratic functions of one coordinate that are 1 at 0, 1/2 or 1,

    tetrahedron10, triangle6         corners l_i (2 l_i - 1), middles 4 l_i l_j
    hexahedron27, quadrilateral9     (1 - x)(1 - 2 x), 4 x (1 - x) or x (2 x - 1) of each coordinate x; line3, their edge, of one

A hexahedron of 20 nodes has corners that push the wrong way under an even pressure, and loses an order where it is distorted; so 27. The
rules are exact for degree 2 in a tetrahedron (its strain is linear), degree 4 in a triangle and degree 5 in each coordinate of the others:
in plane cells enough for curved sides too, where gradients and shape functions times det J are of degree 4 in a triangle at most.
Legend: n nodes of a cell, of first order its corners, P points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations, product
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
_SIMPLEX = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
CORNERS: dict[str, Floats] = {  # (n, 3) of each kind
    "triangle": np.array(_SIMPLEX[:3], float), "quadrilateral": np.array(HEXAHEDRON[:4], float),
    "tetrahedron": np.array(_SIMPLEX, float), "hexahedron": np.array(HEXAHEDRON, float),
    "prism": np.array([(r, s, t) for t in (0, 1) for r, s, _ in _SIMPLEX[:3]], float)}


@dataclass(frozen=True, eq=False)
class Cell:
    """One type of cell, or of what cells are bounded by.

    corners: how many; vtk, meshio: its number and its name there
    edges, facets: pairs and rows of corners; facets outward by the right-hand rule (of a plane cell: its edges, counter-clockwise)
    mirrored: the corners in the order that turns a negative volume into a positive one
    shape_functions: of (r, s, t), their values and gradients; cells of a body have them
    points, weights: the rule, (P, 3) and (P,); the weights' sum is the cell's volume or area in its own coordinates
    first, middles: of a cell of second order the one with the same corners, and the corners that each further node lies between
    places: (n, 3) of its nodes, of second order
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
    first: str = ""
    middles: Corners = ()
    places: Floats = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def nodes(self) -> int:
        """How many: the corners, and those of second order."""
        return self.corners + len(self.middles)

    def shapes(self, at: ArrayLike) -> tuple[Floats, Floats]:
        """(..., n) shape functions and (..., n, 3) their gradients at places (..., 3); one of the functions is negative outside."""
        if self.shape_functions is None:
            raise InputError(f"cell = {self.name!r}: must be one of triangle, quadrilateral, tetrahedron, prism, hexahedron")
        places = np.asarray(at, np.float64)
        values, gradients = self.shape_functions(*np.moveaxis(places, -1, 0))
        found, slopes = np.empty((*places.shape[:-1], self.nodes)), np.empty((*places.shape[:-1], self.nodes, 3))
        for i, (value, gradient) in enumerate(zip(values, gradients, strict=True)):
            found[..., i] = value
            for j, slope in enumerate(gradient):
                slopes[..., i, j] = slope
        return found, slopes


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


def _simplex(middles: Corners, r: Floats, s: Floats, t: Floats) -> tuple[list[Any], list[tuple[Any, ...]]]:
    """Of second order; of a triangle t = 0 and the gradients along t do not count."""
    corners = 1 + max(max(pair) for pair in middles)
    l, slope = (1 - r - s - t, r, s, t), [np.eye(3)[i - 1] if i else -np.ones(3) for i in range(4)]
    if corners == 3:
        l, slope = (1 - r - s, r, s, t), [np.array([*each[:2], 0.0]) for each in slope]
    values = [l[i] * (2 * l[i] - 1) for i in range(corners)] + [4 * l[i] * l[j] for i, j in middles]
    gradients = [tuple((4 * l[i] - 1) * d for d in slope[i]) for i in range(corners)]
    return values, gradients + [tuple(4 * (l[i] * e + l[j] * d) for d, e in zip(slope[i], slope[j], strict=True)) for i, j in middles]


def _tensor(places: Floats, r: Floats, s: Floats, t: Floats) -> tuple[list[Any], list[tuple[Any, ...]]]:
    """Of second order, with nodes at places (n, 2 or 3) of coordinates 0, 1/2 and 1."""
    zero, one = np.zeros_like(r), np.ones_like(r)
    lines = [{0.0: ((1 - x) * (1 - 2 * x), 4 * x - 3), 0.5: (4 * x * (1 - x), 4 - 8 * x), 1.0: (x * (2 * x - 1), 4 * x - 1)}
             for x in (r, s, t)]
    values, gradients = [], []
    for place in places.tolist():
        parts = [line[x] for line, x in zip(lines, place, strict=False)] + [(one, zero)] * (3 - len(place))
        (a, da), (b, db), (c, dc) = parts
        values.append(a * b * c)
        gradients.append((da * (b * c), db * (a * c), dc * (a * b)))
    return values, gradients


_FIRST = (
    Cell("vertex", "vertices", 0, 1, 1, "vertex"),
    Cell("line", "lines", 1, 2, 3, "line", edges=((0, 1),)),
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


def _second(name: str, plural: str, vtk: int, meshio: str, middles: Corners, points: Floats, weights: Floats) -> Cell:
    """A cell of second order; its edges are those of the eight (or four) small cells of the first that it can be cut into.

    These are halves, and lead from the middles of squares and of the cell to those of what bounds them, in triangles from middle to
    middle, and once through the inside of a tetrahedron.
    """
    first = next(cell for cell in _FIRST if name.startswith(cell.name))
    at = {frozenset(corners): first.corners + i for i, corners in enumerate(middles)}
    edges = [half for a, b in first.edges for half in ((a, at[frozenset((a, b))]), (at[frozenset((a, b))], b))]
    edges += [(at[frozenset(small)], at[frozenset(large)]) for large in middles for small in middles
              if len(large) == 2 * len(small) and set(small) < set(large)]
    if first.name in ("triangle", "tetrahedron"):
        pairs = list(combinations(middles, 2))
        inner = [pair for pair in pairs if not set(pair[0]) & set(pair[1])][:1]
        edges += [(at[frozenset(one)], at[frozenset(other)]) for one, other in pairs if set(one) & set(other) or (one, other) in inner]
    rims = [(facet, list(zip(facet, facet[1:] + facet[:1], strict=True)) if len(facet) > 2 else [facet]) for facet in first.facets]
    around = [(*facet, *(at[frozenset(pair)] for pair in rim), *(at[frozenset(facet)] for _ in range(len(facet) == 4)))
              for facet, rim in rims]
    simplex = first.name in ("triangle", "tetrahedron")
    corners = CORNERS.get(first.name, np.array(_SIMPLEX[:2], float))  # or those of a line
    places = np.array([corners[list(of)].mean(axis=0) for of in (*((i,) for i in range(first.corners)), *middles)])
    return Cell(name, plural, first.dimension, first.corners, vtk, meshio, tuple(edges), tuple(around),
                shape_functions=partial(_simplex, middles) if simplex else partial(_tensor, places[:, :first.dimension]),
                points=points, weights=weights, first=first.name, middles=middles, places=places)


def _gauss(dimension: int) -> tuple[Floats, Floats]:
    """Three points along each coordinate."""
    x, w = np.array([0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5]), np.array([5, 8, 5]) / 18
    points = np.array([(*place, 0.0, 0.0)[:3] for place in product(x, repeat=dimension)])
    return points, np.array([np.prod(each) for each in product(w, repeat=dimension)])


def _orbits(dimension: int, *orbits: tuple[float, float]) -> tuple[Floats, Floats]:
    """Points that have all barycentric coordinates but one equal to a, with the weight w each, for each (a, w)."""
    points, weights = [], []
    for a, w in orbits:
        for i in range(dimension + 1):
            l = np.full(dimension + 1, a)
            l[i] = 1 - dimension * a
            points.append((*l[1:], 0.0)[:3])
            weights.append(w)
    return np.array(points), np.array(weights)


# Of degree 2: Zienkiewicz and Taylor, The Finite Element Method, table 5.4; of degree 3 (Keast, Comput. Meth. Appl. Mech. Engng 55, 1986,
# 339), for cells with curved sides, over which the integrals of the gradients are of that degree; of degree 4: Strang and Fix, table 4.1.
TETRAHEDRON = _orbits(3, ((5 - 5**0.5) / 20, 1 / 24))
CURVED_TETRAHEDRON = _orbits(3, (0.32816330251638168, 0.13621784253708742 / 6), (0.10804724989842862, 0.11378215746291258 / 6))
_TRIANGLE6 = _orbits(2, (0.44594849091596489, 0.22338158967801147 / 2), (0.09157621350977073, 0.10995174365532187 / 2))
_FACES = ((3, 0, 4, 7), (1, 2, 6, 5), (0, 1, 5, 4), (2, 3, 7, 6), (0, 3, 2, 1), (4, 5, 6, 7))  # of a hexahedron, as VTK counts them
_EDGES = {cell.name: cell.edges for cell in _FIRST}
_SECOND = (
    _second("line3", "lines of 3 nodes", 21, "line3", _EDGES["line"], *_gauss(1)),
    _second("triangle6", "triangles of 6 nodes", 22, "triangle6", _EDGES["triangle"], *_TRIANGLE6),
    _second("quadrilateral9", "quadrilaterals of 9 nodes", 28, "quad9", (*_EDGES["quadrilateral"], (0, 1, 2, 3)), *_gauss(2)),
    _second("tetrahedron10", "tetrahedra of 10 nodes", 24, "tetra10", _EDGES["tetrahedron"], *TETRAHEDRON),
    _second("hexahedron27", "hexahedra of 27 nodes", 29, "hexahedron27", (*_EDGES["hexahedron"], *_FACES, tuple(range(8))), *_gauss(3)),
)
_ALL = (*_FIRST, *_SECOND)
CELLS = {cell.name: cell for cell in _ALL}
SECOND = {cell.first: cell.name for cell in _SECOND}
# What a trajectory is made of.
OF_VTK = {cell.vtk: cell for cell in _ALL if cell.dimension > 1}
OF_MESHIO = {cell.meshio: cell for cell in _FIRST}
