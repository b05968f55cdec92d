"""What the table of cell types says: against VTK, meshio and the cells of side 1."""

import meshio
import numpy as np
import pytest
from vtkmodules.vtkCommonDataModel import vtkHexahedron, vtkQuad, vtkTetra, vtkTriangle, vtkWedge

from physics.mesh.cell import CELLS, OF_MESHIO, OF_VTK
from physics.mesh.mesh import kind_of

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


def test_other_numbers_of_the_kinds():
    assert CELLS["vertex"].dimension == 0 and CELLS["line"].dimension == 1
    assert {name: cell.plural for name, cell in CELLS.items() if cell.dimension >= 2} == {
        "triangle": "triangles", "quadrilateral": "quadrilaterals", "tetrahedron": "tetrahedra", "hexahedron": "hexahedra",
        "prism": "prisms"}
    assert [kind_of(np.zeros((1, n), int)) for n in (2, 3, 4)] == ["line", "triangle", "quadrilateral"]


@pytest.mark.parametrize("name", CELLS)
def test_names_and_numbers_are_those_of_meshio(name):
    cell = CELLS[name]
    assert meshio._vtk_common.meshio_to_vtk_type[cell.meshio] == cell.vtk
    assert meshio._mesh.topological_dimension[cell.meshio] == cell.dimension
    assert meshio._common.num_nodes_per_cell[cell.meshio] == cell.corners
    assert OF_MESHIO[cell.meshio] is cell and OF_VTK.get(cell.vtk) is (cell if cell.dimension > 1 else None)


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
