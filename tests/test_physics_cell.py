"""What the table of cell types says: against VTK, meshio and the cells of side 1."""

from itertools import combinations, product
from math import factorial

import meshio
import numpy as np
import pytest
from vtkmodules.vtkCommonDataModel import (
    vtkBiQuadraticQuad,
    vtkHexahedron,
    vtkQuad,
    vtkQuadraticEdge,
    vtkQuadraticTetra,
    vtkQuadraticTriangle,
    vtkTetra,
    vtkTriangle,
    vtkTriQuadraticHexahedron,
    vtkWedge,
)

from physics.mesh import cell as cell_module
from physics.mesh.cell import CELLS, CURVED_TETRAHEDRON, OF_MESHIO, OF_VTK, SECOND
from physics.mesh.mesh import Mesh
from physics.schema import InputError

VTK = {"triangle": vtkTriangle, "quadrilateral": vtkQuad, "tetrahedron": vtkTetra, "hexahedron": vtkHexahedron, "prism": vtkWedge}
CORNERS = {  # of the cells of side 1
    "triangle": [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
    "quadrilateral": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
    "tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    "prism": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
}


@pytest.mark.parametrize("cell", VTK)
def test_edges_and_facets_are_those_of_vtk_and_facets_look_outward(cell):
    theirs = VTK[cell]()
    assert CELLS[cell].vtk == theirs.GetCellType() and CELLS[cell].dimension == theirs.GetCellDimension()

    def ends(part):
        return frozenset(part.GetPointId(i) for i in range(part.GetNumberOfPoints()))

    for i in range(theirs.GetNumberOfPoints()):
        theirs.GetPointIds().SetId(i, i)
    assert sorted(map(sorted, CELLS[cell].edges)) == sorted(sorted(ends(theirs.GetEdge(i))) for i in range(theirs.GetNumberOfEdges()))
    points = np.array(CORNERS[cell], float)
    if CELLS[cell].dimension == 2:
        assert CELLS[cell].facets == CELLS[cell].edges
        for i, j in CELLS[cell].facets:  # the normal of an edge (dx, dy) run through counter-clockwise is (dy, -dx)
            dx, dy, _ = points[j] - points[i]
            assert (points[i] - points.mean(axis=0)) @ (dy, -dx, 0) > 0
        return
    assert sorted(map(sorted, CELLS[cell].facets)) == sorted(sorted(ends(theirs.GetFace(i))) for i in range(theirs.GetNumberOfFaces()))
    for facet in CELLS[cell].facets:
        around = points[list(facet)]
        for k in range(len(facet)):  # at every corner, so the corners go round and do not cross
            side, before = around[(k + 1) % len(facet)] - around[k], around[k - 1] - around[k]
            assert np.cross(side, before) @ (around[k] - points.mean(axis=0)) > 0


@pytest.mark.parametrize("cell, small", [("triangle6", 4), ("tetrahedron10", 8)])
def test_edges_of_a_simplex_of_second_order_are_those_of_its_small_ones(cell, small):
    """Each by hand: halves, from middle to middle across the corners, and in a tetrahedron once through the octahedron that is left."""
    corner = {"triangle6": [(0, 3, 5), (1, 3, 4), (2, 4, 5), (3, 4, 5)],
              "tetrahedron10": [(0, 4, 6, 7), (1, 4, 5, 8), (2, 5, 6, 9), (3, 7, 8, 9),
                                (4, 9, 5, 6), (4, 9, 6, 7), (4, 9, 7, 8), (4, 9, 8, 5)]}[cell]
    assert len(corner) == small
    assert {frozenset(edge) for edge in CELLS[cell].edges} == {frozenset(pair) for part in corner for pair in combinations(part, 2)}
    assert len(CELLS[cell].edges) == {"triangle6": 9, "tetrahedron10": 25}[cell]


def test_other_numbers_of_the_kinds():
    assert CELLS["vertex"].dimension == 0 and CELLS["line"].dimension == 1
    assert [CELLS["line"].points.shape, CELLS["line"].weights.shape, CELLS["hexahedron"].places.shape] == [(0, 3), (0,), (0, 3)]
    assert {name: cell.plural for name, cell in CELLS.items() if cell.dimension >= 2} == {
        "triangle": "triangles", "quadrilateral": "quadrilaterals", "tetrahedron": "tetrahedra", "hexahedron": "hexahedra",
        "prism": "prisms", "triangle6": "triangles of 6 nodes", "quadrilateral9": "quadrilaterals of 9 nodes",
        "tetrahedron10": "tetrahedra of 10 nodes", "hexahedron27": "hexahedra of 27 nodes"}
    solid, plane = (Mesh(np.zeros((1, 3)), np.zeros((1, 1), int), cell, {}) for cell in ("prism", "triangle"))
    assert [solid.kind_of(np.zeros((1, n), int)) for n in (3, 4, 6, 9)] == ["triangle", "quadrilateral", "triangle6", "quadrilateral9"]
    assert [plane.kind_of(np.zeros((1, n), int)) for n in (2, 3)] == ["line", "line3"]


@pytest.mark.parametrize("name", CELLS)
def test_names_and_numbers_are_those_of_meshio(name):
    cell = CELLS[name]
    assert meshio._vtk_common.meshio_to_vtk_type[cell.meshio] == cell.vtk
    assert meshio._mesh.topological_dimension[cell.meshio] == cell.dimension
    assert meshio._common.num_nodes_per_cell[cell.meshio] == cell.nodes == cell.corners + len(cell.middles)
    assert OF_MESHIO.get(cell.meshio) is (None if cell.middles else cell)  # files are read by their corners
    assert OF_VTK.get(cell.vtk) is (cell if cell.dimension > 1 else None)


SECOND_ORDER = {"line3": vtkQuadraticEdge, "triangle6": vtkQuadraticTriangle, "quadrilateral9": vtkBiQuadraticQuad,
                "tetrahedron10": vtkQuadraticTetra, "hexahedron27": vtkTriQuadraticHexahedron}


@pytest.mark.parametrize("name", SECOND_ORDER)
def test_shape_functions_of_second_order_are_those_of_vtk(name):
    theirs, cell = SECOND_ORDER[name](), CELLS[name]
    places = np.reshape(theirs.GetParametricCoords(), (-1, 3))
    np.testing.assert_array_equal(cell.places, places)
    at = np.random.default_rng(0).uniform(0, 0.3, (5, 3)) * (np.arange(3) < cell.dimension)
    for place in at:
        weights, slopes = np.zeros(cell.nodes), np.zeros(cell.dimension * cell.nodes)
        theirs.InterpolateFunctions(place, weights)
        theirs.InterpolateDerivs(place, slopes)
        values, gradients = cell.shapes(place)
        assert values == pytest.approx(weights, abs=1e-14)
        assert gradients[:, :cell.dimension].T.ravel() == pytest.approx(slopes, abs=1e-13)


@pytest.mark.parametrize("name", ["triangle6", "quadrilateral9", "tetrahedron10", "hexahedron27"])
def test_facets_of_second_order_are_those_of_vtk_and_look_outward(name):
    theirs, cell = SECOND_ORDER[name](), CELLS[name]
    for i in range(theirs.GetNumberOfPoints()):
        theirs.GetPointIds().SetId(i, i)
    there = set()
    for i in range(theirs.GetNumberOfFaces() if cell.dimension == 3 else theirs.GetNumberOfEdges()):
        face = theirs.GetFace(i) if cell.dimension == 3 else theirs.GetEdge(i)  # one object, filled anew
        there.add(frozenset(face.GetPointId(k) for k in range(face.GetNumberOfPoints())))
    assert {frozenset(facet) for facet in cell.facets} == there
    for facet in cell.facets:
        kind = CELLS[Mesh(cell.places, np.array([range(cell.nodes)]), name, {}).kind_of(np.array([facet]))]
        np.testing.assert_allclose(kind.shapes(kind.places)[0] @ cell.places[list(facet)], cell.places[list(facet)], atol=1e-15)
        corners = [cell.places[list(facet)][list(of)].mean(axis=0) for of in kind.middles]
        np.testing.assert_array_equal(corners, cell.places[list(facet)][kind.corners:])
        assert facet[:kind.corners] in CELLS[cell.first].facets


def exact(powers, cell):
    """The integral of r^a s^b t^c over a cell of side 1."""
    if "hexa" in cell or "quadri" in cell or "line" in cell:
        return np.prod([1 / (p + 1) for p in powers])
    return np.prod([factorial(p) for p in powers]) / factorial(sum(powers) + CELLS[cell].dimension)


@pytest.mark.parametrize("name, rule, degree", [
    ("line3", None, 5), ("triangle6", None, 4), ("quadrilateral9", None, 5), ("tetrahedron10", None, 2),
    ("tetrahedron10", CURVED_TETRAHEDRON, 3),
    ("hexahedron27", None, 5)])
def test_rules_of_second_order_are_exact_to_their_degree(name, rule, degree):
    cell = CELLS[name]
    points, weights = rule or (cell.points, cell.weights)
    whole = cell.first in ("tetrahedron", "triangle")
    for powers in product(range(degree + 1), repeat=cell.dimension):
        if not whole or sum(powers) <= degree:
            found = weights @ np.prod(points[:, :cell.dimension] ** powers, axis=1)
            assert found == pytest.approx(exact(powers, name), rel=1e-12)

@pytest.mark.parametrize("name", CORNERS)
def test_mirrored_corners_turn_the_volume_over(name):
    cell, points = CELLS[name], np.array(CORNERS[name], float)
    assert sorted(cell.mirrored) == list(range(cell.corners))
    turned = points[list(cell.mirrored)]

    def size(x):  # of the cell cut at its first corner, three edges there
        at = [b if a == 0 else a for a, b in cell.edges if 0 in (a, b)]
        sides = x[at] - x[0]
        return np.linalg.det(sides[:, :2]) if cell.dimension == 2 else np.linalg.det(sides[np.argsort(at)])

    assert size(turned) * size(points) < 0
    around = {frozenset(edge) for edge in cell.edges}
    assert {frozenset(cell.mirrored[k] for k in edge) for edge in cell.edges} == around  # it is the same cell


@pytest.mark.parametrize("name", [name for name in CORNERS if CELLS[name].dimension == 3])
def test_each_shape_function_is_1_at_its_corner_and_0_at_the_others(name):
    values, _ = CELLS[name].shapes(np.array(CORNERS[name], float))
    np.testing.assert_array_equal(values, np.eye(CELLS[name].corners))
    assert CELLS[name].weights.sum() == pytest.approx({"tetrahedron": 1 / 6, "prism": 1 / 2, "hexahedron": 1}[name], rel=1e-15)


@pytest.mark.parametrize("name, volume", [("triangle", 1 / 2), ("quadrilateral", 1.0), ("tetrahedron", 1 / 6), ("hexahedron", 1.0),
                                          ("prism", 1 / 2)])
def test_points_of_quadrature_integrate_linear_functions_over_the_reference_cell(name, volume):
    """A triangle's or tetrahedron's centre is the mean of its corners; a square's and a cube's is the middle."""
    cell = CELLS[name]
    middle = {"triangle": [1 / 3, 1 / 3, 0], "quadrilateral": [1 / 2, 1 / 2, 0], "tetrahedron": [1 / 4] * 3, "hexahedron": [1 / 2] * 3,
              "prism": [1 / 3, 1 / 3, 1 / 2]}[name]
    assert cell.weights.sum() == pytest.approx(volume)
    assert cell.weights @ cell.points == pytest.approx(volume * np.array(middle))


@pytest.mark.parametrize("name", CORNERS)
def test_shape_functions_of_first_order_are_those_of_vtk(name):
    theirs, cell = VTK[name](), CELLS[name]
    np.testing.assert_array_equal(cell_module.CORNERS[name], np.reshape(theirs.GetParametricCoords(), (-1, 3)))
    at = np.random.default_rng(1).uniform(0, 0.4, (4, 2, 3)) * (1, 1, cell.dimension == 3)
    values, gradients = cell.shapes(at)
    assert values.shape == (4, 2, cell.corners) and gradients.shape == (4, 2, cell.corners, 3)
    for i, j in product(range(4), range(2)):
        weights, slopes = np.zeros(cell.corners), np.zeros(cell.dimension * cell.corners)
        theirs.InterpolateFunctions(at[i, j], weights)
        theirs.InterpolateDerivs(at[i, j], slopes)
        assert values[i, j] == pytest.approx(weights, abs=1e-15)
        assert gradients[i, j, :, :cell.dimension].T.ravel() == pytest.approx(slopes, abs=1e-15)


@pytest.mark.parametrize("name", CELLS)
def test_functions_add_up_to_one_and_those_of_plane_cells_have_no_slope_along_t(name):
    if name in ("vertex", "line"):
        with pytest.raises(InputError, match=f"cell = '{name}': must be one of triangle, quadrilateral, tetrahedron, prism, hexahedron"):
            CELLS[name].shapes([0.0, 0.0, 0.0])
        return
    plane = CELLS[name].dimension < 3
    values, gradients = CELLS[name].shapes([0.2, 0.3, 0.0 if plane else 0.4])
    assert values.sum() == pytest.approx(1) and gradients.sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-14)
    assert gradients[:, 2].any() == (not plane)


@pytest.mark.parametrize("name, across, along, count", [
    ("triangle", 1, 0, 1), ("tetrahedron", 1, 0, 1), ("quadrilateral", 3, 0, 4), ("hexahedron", 3, 0, 8), ("prism", 2, 3, 6)])
def test_rules_of_first_order_are_exact_to_their_degree(name, across, along, count):
    """Of prisms to degree 2 across and 3 along, of quadrilaterals and hexahedra to 3 in each coordinate."""
    cell = CELLS[name]
    assert cell.points.shape == (count, 3) and cell.weights.shape == (count,)
    for a, b, c in product(range(4), repeat=3):
        if name == "prism":
            known, wanted = a + b <= across and c <= along, exact((a, b), "triangle") / (c + 1)
        elif name in ("triangle", "tetrahedron"):
            known, wanted = a + b + c <= across and (c == 0 or name == "tetrahedron"), exact((a, b, c)[:cell.dimension], name)
        else:
            known, wanted = c == 0 or name == "hexahedron", exact((a, b, c)[:cell.dimension], name)
        if known:
            assert cell.weights @ np.prod(cell.points ** (a, b, c), axis=1) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("name, count", [("quadrilateral9", 12), ("hexahedron27", 54)])
def test_edges_of_second_order_lead_from_each_node_to_the_next_half_a_side_away(name, count):
    """The lines of a lattice of 3 x 3 (x 3) nodes."""
    cell = CELLS[name]
    wanted = {frozenset((i, j)) for i, j in product(range(cell.nodes), repeat=2)
              if sorted(np.abs(cell.places[i] - cell.places[j])) == [0, 0, 0.5]}
    assert len(cell.edges) == len(wanted) == count and {frozenset(edge) for edge in cell.edges} == wanted
    assert SECOND[cell.first] == name and cell.corners == CELLS[cell.first].corners and len(cell.facets) == len(CELLS[cell.first].facets)
