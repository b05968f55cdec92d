"""Mesh quality against closed forms, scipy and VTK."""

import numpy as np
import pytest
from scipy.spatial.distance import directed_hausdorff
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid
from vtkmodules.vtkFiltersVerdict import vtkCellQuality

from physics.mesh import quality
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.scene import Body
from physics.schema import InputError

SOLID = ("prism", "tetrahedron", "hexahedron")


def beam(cell: str, cells=(6, 3, 3)) -> Mesh:
    return build_mesh(Body(length=0.06, width=0.03, height=0.03, cells=cells, cell=cell))


def shaken(mesh: Mesh, share: float = 0.15, seed: int = 0) -> np.ndarray:
    """Points with the inner nodes moved by a share of the cell size: the box stays what it was."""
    inner = np.ones(len(mesh.points), bool)
    inner[np.concatenate(list(mesh.places.values()))] = False
    return mesh.points + 0.01 * share * np.random.default_rng(seed).uniform(-1, 1, mesh.points.shape) * inner[:, None]


def by_vtk(points: np.ndarray, cells: np.ndarray, cell: str, measure: str) -> np.ndarray:
    grid, nodes, array = vtkUnstructuredGrid(), vtkPoints(), vtkCellArray()
    nodes.SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=True))
    array.SetData(numpy_to_vtkIdTypeArray(np.arange(len(cells) + 1) * cells.shape[1], deep=True),
                  numpy_to_vtkIdTypeArray(cells.ravel(), deep=True))
    grid.SetPoints(nodes)
    grid.SetCells(CELLS[cell].vtk, array)
    judge = vtkCellQuality()
    judge.SetInputData(grid)
    getattr(judge, f"SetQualityMeasureTo{measure}")()
    judge.Update()
    return vtk_to_numpy(judge.GetOutput().GetCellData().GetArray("CellQuality"))


def regular(cell: str) -> np.ndarray:
    """The ideal cell with edges of length 1."""
    triangle = np.array([(0, 0, 0), (1, 0, 0), (0.5, 3**0.5 / 2, 0)])
    if cell == "triangle":
        return triangle
    if cell == "tetrahedron":
        return np.concatenate([triangle, [(0.5, 3**0.5 / 6, (2 / 3) ** 0.5)]])
    if cell == "prism":
        return np.concatenate([triangle, triangle + (0, 0, 1)])
    square = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    return square if cell == "quadrilateral" else np.concatenate([square, square + (0, 0, 1)])


def test_rmse_is_the_mean_length_of_the_error_over_the_chosen_nodes():
    reference = np.zeros((5, 4, 3), np.float32)
    prediction = reference + np.array([3e-20, 4e-20, 0], np.float32)
    assert quality.rmsd(prediction, reference) == pytest.approx(5e-20, rel=1e-6)  # float32 data
    prediction[:, 0] = 7
    assert quality.rmsd(prediction, reference, np.array([False, True, True, True])) == pytest.approx(5e-20, rel=1e-6)
    assert quality.rmsd(prediction, reference, np.array([0])) == pytest.approx(7 * 3**0.5)


def test_distances_of_node_sets_equal_those_of_scipy():
    rng = np.random.default_rng(1)
    a, b = rng.random((200, 3)), rng.random((150, 3))
    largest, mean_square = quality.set_distances(a, b)
    assert largest == pytest.approx(max(directed_hausdorff(a, b)[0], directed_hausdorff(b, a)[0]), rel=1e-14)
    gaps = np.linalg.norm(a[:, None] - b, axis=2)  # all pairs
    expected = np.mean(gaps.min(axis=0) ** 2) + np.mean(gaps.min(axis=1) ** 2)
    assert mean_square == pytest.approx(expected, rel=1e-13)
    assert quality.set_distances(a, a) == (0, 0)
    a[0, 0] = np.nan
    assert quality.set_distances(a, b) == (np.inf, np.inf)


@pytest.mark.parametrize("cell", SOLID)
def test_volumes_fill_the_box_however_the_inner_nodes_lie(cell):
    mesh = beam(cell)
    volumes = quality.cell_volumes(shaken(mesh), mesh.cells, cell)
    assert volumes.min() > 0 and np.ptp(volumes) > 0.1 * volumes.mean()
    assert volumes.sum() == pytest.approx(0.06 * 0.03 * 0.03, rel=1e-13)  # exact integration: rounding only


@pytest.mark.parametrize("cell", SOLID)
def test_volumes_equal_those_of_vtk_on_cells_with_plane_sides(cell):
    mesh = beam(cell)  # with curved sides VTK's volumes are not those of the isoparametric map
    points = mesh.points @ np.array([[1.1, 0.2, 0], [0.1, 0.9, 0.3], [0, 0.1, 1.2]])
    expected = by_vtk(points, mesh.cells, cell, "Volume")
    np.testing.assert_allclose(quality.cell_volumes(points, mesh.cells, cell), expected, rtol=1e-12)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_scaled_jacobian_of_plane_cells_equals_vtk_and_is_one_for_regular_ones(cell):
    ideal = regular(cell)
    points = np.concatenate([ideal + 0.2 * np.random.default_rng(i).uniform(-1, 1, ideal.shape) * (1, 1, 0) for i in range(9)])
    cells = np.arange(len(points)).reshape(9, -1)
    assert quality.scaled_jacobian(points, cells, cell) == pytest.approx(by_vtk(points, cells, cell, "ScaledJacobian"), rel=1e-12)
    assert quality.scaled_jacobian(ideal, np.arange(len(ideal))[None], cell) == pytest.approx(1, rel=1e-14)


@pytest.mark.parametrize("cell", SOLID)
def test_scaled_jacobian_equals_vtk(cell):
    mesh = beam(cell)
    points = shaken(mesh)
    expected = by_vtk(points, mesh.cells, cell, "ScaledJacobian")
    np.testing.assert_allclose(quality.scaled_jacobian(points, mesh.cells, cell), expected, rtol=1e-12)
    ideal = regular(cell)
    assert quality.scaled_jacobian(ideal, np.arange(len(ideal))[None], cell) == pytest.approx(1, rel=1e-14)


@pytest.mark.parametrize("cell", SOLID)
def test_det_f_of_a_uniform_stretch_is_the_product_of_the_stretches_on_distorted_cells(cell):
    mesh = beam(cell)
    rest = shaken(mesh)
    stretch = np.array([1.3, 0.8, 0.7])
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    displacement = np.stack([rest * stretch @ rotation.T - rest, np.zeros_like(rest), 0 * rest + 0.5])
    found = quality.det_f(rest, displacement, mesh.cells, cell)
    np.testing.assert_allclose(found, np.array([1.3 * 0.8 * 0.7, 1, 1])[:, None] * np.ones(len(mesh.cells)), rtol=1e-12)
    np.testing.assert_allclose(quality.smallest_det_f(rest, displacement, mesh.cells, cell), found.min(axis=1))


def test_det_f_of_bending_and_of_a_single_bad_corner():
    mesh = beam("prism")
    x, _, z = mesh.points.T
    bent = np.zeros((*mesh.points.shape,))
    bent[:, 0] = -4.0 * x * z  # F_11 = 1 - 4 z, all other entries of the diagonal 1, nothing below it
    at_top = 1 - 4.0 * 0.03
    assert quality.smallest_det_f(mesh.points, bent, mesh.cells, "prism") == pytest.approx(at_top, rel=1e-12)
    corner = np.flatnonzero((mesh.points == mesh.points.max(axis=0)).all(axis=1))
    pushed = np.zeros_like(mesh.points)
    pushed[corner] = (-0.02, 0, 0)  # twice the length of a cell: the edge along x is turned round
    found = quality.det_f(mesh.points, pushed, mesh.cells, "prism")
    touching = np.isin(mesh.cells, corner).any(axis=1)
    assert (found[touching] < 0).all() and (found[~touching] == 1).all()


@pytest.mark.parametrize("cell", SOLID)
def test_mirrored_and_broken_cells_have_no_positive_det_f(cell):
    mesh = beam(cell)
    mirror = mesh.points * (-2, 0, 0)
    broken = np.zeros_like(mesh.points)
    broken[mesh.cells[0, 0]] = np.nan
    found = quality.det_f(mesh.points, np.stack([mirror, 0 * mirror, broken]), mesh.cells, cell)
    assert np.count_nonzero(~(found > 0), axis=-1).tolist() == [len(mesh.cells), 0, np.isin(mesh.cells, mesh.cells[0, 0]).any(axis=1).sum()]
    assert (quality.cell_volumes(mesh.points + mirror, mesh.cells, cell) < 0).all()
    with pytest.raises(InputError, match="inverted in the rest state"):
        quality.det_f(mesh.points + mirror, mirror, mesh.cells, cell)


def test_mesh_continuity_of_a_row_of_hexahedra_is_known_by_hand():
    mesh = beam("hexahedron", (4, 1, 1))
    points = mesh.points.copy()
    points[:, 0] = np.array([0, 1, 3, 6, 10])[np.round(points[:, 0] / 0.015).astype(int)]  # lengths 1, 2, 3, 4
    # Neighbours of the four cells: {2}, {1, 3}, {2, 4}, {3}.
    assert quality.mesh_continuity(points, mesh.cells, "hexahedron") == pytest.approx((1 + 3 + 2 + 1) / 4, rel=1e-14)
    assert quality.mesh_continuity(np.stack([points, mesh.points]), mesh.cells, "hexahedron") == pytest.approx([1.75, 1], rel=1e-14)
    alone = build_mesh(Body(length=1, width=1, height=1, cells=(1, 1, 1), cell="hexahedron"))
    assert quality.mesh_continuity(alone.points, alone.cells, "hexahedron") == 1


@pytest.mark.parametrize("cell", SOLID)
def test_mesh_continuity_equals_a_plain_loop(cell):
    mesh = beam(cell, (3, 2, 2))
    points = shaken(mesh, 0.3)
    volume = quality.cell_volumes(points, mesh.cells, cell)
    shared = [[len(set(a) & set(b)) for b in mesh.cells.tolist()] for a in mesh.cells.tolist()]
    beside = [[j for j, n in enumerate(row) if 3 <= n < mesh.cells.shape[1]] for row in shared]
    expected = np.mean([volume[j].max() / volume[j].min() for j in beside])
    assert quality.mesh_continuity(points, mesh.cells, cell) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(("cell", "value"), [("triangle", 3**-0.5), ("tetrahedron", 6**0.5 * (6 * 2**0.5) ** (1 / 3)),
                                             ("prism", 1), ("hexahedron", 1)])
def test_aspect_ratio_of_the_ideal_cell_and_of_a_stretched_one(cell, value):
    points = regular(cell)
    cells = np.arange(len(points))[None]
    assert quality.aspect_ratio(7 * points, cells, cell) == pytest.approx(value, rel=1e-14)
    if cell == "triangle":
        return
    longest = (1 / 3 + 64 * 2 / 3) ** 0.5 if cell == "tetrahedron" else 8  # longest edge once z is stretched eight times
    long = points * (1, 1, 8)
    assert quality.aspect_ratio(long, cells, cell) == pytest.approx(value * longest / 2, rel=1e-14)
    assert quality.aspect_ratio(np.stack([long, points]), cells, cell)[:, 0] == pytest.approx([value * longest / 2, value], rel=1e-14)


def test_every_metric_is_zero_for_the_truth_and_none_depends_on_the_frame_of_reference():
    mesh = beam("prism")
    truth = shaken(mesh, 0.2)
    rotation = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    turned = truth @ rotation.T + 5
    for metric in (quality.mesh_continuity, quality.aspect_ratio, quality.scaled_jacobian, quality.cell_volumes):
        # 5 m of translation of a cell of 1 cm: 1e-16 * 5 / 0.01, amplified by some tens
        np.testing.assert_allclose(metric(turned, mesh.cells, "prism"), metric(truth, mesh.cells, "prism"), rtol=1e-11)
