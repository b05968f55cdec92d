"""Halved cells: they fill what the whole ones fill, none is inside out, and the places are cut with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from physics.mesh.mesh import Mesh
from physics.mesh.quality import cell_volumes, scaled_jacobian
from physics.mesh.refine import halved
from physics.mesh.second import second_order
from physics.mesh.shapes.boxes import box, rectangle
from physics.scene import Body


def solid(cell):
    """A box of 2 x 1 x 3 cells, its inner nodes moved, so that no two cells are alike."""
    mesh = box(Body(length=2.0, width=1.0, height=3.0, cells=(2, 2, 3), cell=cell))
    inner = np.all((mesh.points > 1e-9) & (mesh.points < np.array([2.0, 1.0, 3.0]) - 1e-9), axis=1)
    moved = mesh.points + 0.1 * np.random.default_rng(0).uniform(-1, 1, mesh.points.shape) * inner[:, None]
    return Mesh(moved, mesh.cells, cell, mesh.places)


@pytest.mark.parametrize("cell", ["tetrahedron", "prism", "hexahedron"])
def test_eight_cells_fill_each_solid_one_and_none_is_inside_out(cell):
    mesh = solid(cell)
    fine = halved(mesh)
    whole, parts = cell_volumes(mesh.points, mesh.cells, cell), cell_volumes(fine.points, fine.cells, cell)
    assert len(parts) == 8 * len(whole) and np.array_equal(fine.points[:len(mesh.points)], mesh.points)
    np.testing.assert_allclose(parts.reshape(8, -1).sum(axis=0), whole, rtol=1e-12)  # children of a cell come in the same column
    assert scaled_jacobian(fine.points, fine.cells, cell).min() > 0


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_four_cells_fill_each_plane_one(cell):
    mesh = rectangle(Body(shape="plate", length=2.0, width=1.0, cells=(3, 2), cell=cell))
    fine = halved(mesh)
    x = fine.points[fine.cells][..., :2]
    area = 0.5 * sum(x[:, i - 1, 0] * x[:, i, 1] - x[:, i, 0] * x[:, i - 1, 1] for i in range(x.shape[1]))  # the shoelace formula
    assert len(area) == 4 * len(mesh.cells) and area.min() > 0 and np.isclose(area.sum(), 2.0)


@pytest.mark.parametrize("cell", ["tetrahedron", "prism", "hexahedron"])
def test_the_nodes_are_those_that_a_builder_of_twice_the_cells_makes_and_the_faces_are_whole(cell):
    body = {"length": 2.0, "width": 1.0, "height": 3.0, "cell": cell}
    fine, built = halved(box(Body(cells=(2, 1, 3), **body))), box(Body(cells=(4, 2, 6), **body))
    def order(points):
        return points[np.lexsort(points.round(9).T)]
    np.testing.assert_allclose(order(fine.points), order(built.points), atol=1e-12)
    for name in built.places:
        np.testing.assert_allclose(order(fine.points[fine.places[name]]), order(built.points[built.places[name]]), atol=1e-12)
        corners = [fine.points[facets] for facets in fine.facets(name)]
        area = sum(np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1]) if x.shape[1] == 4
                                  else np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1).sum() / 2 for x in corners)
        assert np.isclose(area, {"x": 3.0, "y": 6.0, "z": 2.0}[name[0]])


def test_what_a_place_is_made_of_is_cut_and_what_is_no_part_of_the_mesh_is_left_out():
    whole = box(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="hexahedron"))
    mesh = Mesh(whole.points, whole.cells, "hexahedron", {"face": np.arange(4, 8), "diagonal": np.array([0, 6]), "body": np.arange(8)},
                {"face": [("quadrilateral", whole.cells[:, [4, 5, 6, 7]])], "diagonal": [("line", whole.cells[:, [0, 6]])],
                 "body": [("hexahedron", whole.cells)]})
    fine = halved(mesh)
    assert len(fine.points) == 27 and len(fine.places["face"]) == 9 and len(fine.places["body"]) == 27
    assert [array.shape for _, array in fine.parts["face"]] == [(4, 4)] and [array.shape for _, array in fine.parts["body"]] == [(8, 8)]
    assert fine.parts["diagonal"][0][1].shape == (0, 2) and len(fine.places["diagonal"]) == 2


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_cells_of_second_order_are_cut_along_their_own_coordinates(cell):
    """Their middles become corners, and eight curved cells fill each curved one."""
    mesh = second_order(solid(cell))
    moved = mesh.points + 0.05 * np.random.default_rng(1).uniform(-1, 1, mesh.points.shape)
    mesh = replace(mesh, points=moved)
    fine = halved(mesh)
    volume, parts = (cell_volumes(of.points, of.cells, of.cell) for of in (mesh, fine))
    assert fine.cell == mesh.cell and len(parts) == 8 * len(volume)
    np.testing.assert_allclose(parts.reshape(8, -1).sum(axis=0), volume, rtol=1e-12)
    distance, _ = cKDTree(fine.points).query(mesh.points)
    assert distance.max() < 1e-12
    for name in mesh.places:
        assert set(cKDTree(fine.points).query(mesh.points[mesh.places[name]])[1]) <= set(fine.places[name].tolist())
        assert len(fine.place(name)) > 3 * len(mesh.place(name))
