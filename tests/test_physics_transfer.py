"""Carrying displacements between meshes: exact for what the shape functions span."""

from dataclasses import replace

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.mesh.transfer import interpolate
from physics.scene import Body


def beam(cell: str, cells: tuple[int, int, int]) -> Mesh:
    return build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=cells, cell=cell))


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
def test_interpolation_is_exact_for_linear_fields_and_at_the_nodes(cell):
    coarse, fine = beam(cell, (4, 2, 2)), beam(cell, (11, 5, 7))
    inner = ((coarse.points > 1e-9) & (coarse.points < np.array([0.1, 0.02, 0.03]) - 1e-9)).all(axis=1)
    rng = np.random.default_rng(0)
    coarse.points[inner] += 0.002 * rng.uniform(-1, 1, (inner.sum(), 3))  # cells that are no parallelepipeds
    gradient = rng.normal(size=(5, 3, 3))
    linear = np.einsum("tij,nj->tni", gradient, coarse.points) + 1
    expected = np.einsum("tij,nj->tni", gradient, fine.points) + 1
    # Newton's iteration ends at rounding, in lengths of 1e-2 m and gradients of some units.
    np.testing.assert_allclose(interpolate(coarse, linear, fine.points), expected, atol=1e-13)
    anything = rng.normal(size=(2, *coarse.points.shape))  # would show a wrong cell, which linear fields do not
    np.testing.assert_allclose(interpolate(coarse, anything, coarse.points), anything, atol=1e-12)
    with pytest.raises(ValueError, match="1 of 2 points lie outside"):
        interpolate(coarse, linear, np.array([[0.05, 0.01, 0.01], [0.05, 0.01, 0.031]]))


def test_points_in_long_cells_beside_short_ones_are_found():
    """Graded to four faces: among the cells whose centres are nearest may be none that holds a point."""
    mesh = build_mesh(Body(length=0.04, width=0.24, height=0.01, cells=(4, 5, 4), cell="tetrahedron",
                           graded=("x-min", "y-min", "y-max", "z-min", "z-max")))
    points = np.random.default_rng(3).uniform(0, 1, (5000, 3)) * [0.04, 0.24, 0.01]
    np.testing.assert_allclose(interpolate(mesh, mesh.points[None], points)[0], points, atol=1e-13)


def test_interpolation_within_a_prism_is_linear_along_it_and_across_it():
    mesh = beam("prism", (1, 1, 1))
    field = np.zeros((1, len(mesh.points), 3))
    field[0, :, 0] = mesh.points[:, 0] * mesh.points[:, 1]  # in the span of the prism's shape functions
    points = np.random.default_rng(1).uniform(0, 1, (50, 3)) * [0.1, 0.02, 0.03]
    np.testing.assert_allclose(interpolate(mesh, field, points)[0, :, 0], points[:, 0] * points[:, 1], atol=1e-16)


CORNERS = {"tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
           "prism": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
           "hexahedron": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]}


@pytest.mark.parametrize("cell", CORNERS)
def test_shape_functions_are_one_at_their_own_corner_and_their_gradients_are_their_slopes(cell):
    corners = np.array(CORNERS[cell], float)
    np.testing.assert_allclose(CELLS[cell].shapes(corners)[0], np.eye(len(corners)), atol=1e-15)
    r, s, t = at = np.array([0.2, 0.3, 0.4])
    expected = {"tetrahedron": [1 - r - s - t, r, s, t],
                "prism": [(1 - r - s) * (1 - t), r * (1 - t), s * (1 - t), (1 - r - s) * t, r * t, s * t],
                "hexahedron": [(r if x else 1 - r) * (s if y else 1 - s) * (t if z else 1 - t) for x, y, z in CORNERS[cell]]}[cell]
    values, gradients = CELLS[cell].shapes(at)
    np.testing.assert_allclose(values, expected, rtol=1e-14)
    for k in range(3):  # at most linear in each coordinate, so a difference over any distance is the slope
        step = 0.1 * np.eye(3)[k]
        np.testing.assert_allclose(gradients[:, k], (CELLS[cell].shapes(at + step)[0] - CELLS[cell].shapes(at - step)[0]) / 0.2, atol=1e-14)
    values, gradients = CELLS[cell].shapes(np.broadcast_to(at, (2, 5, 3)))
    assert values.shape == (2, 5, len(corners)) and gradients.shape == (2, 5, len(corners), 3)


@pytest.mark.parametrize("cell", CORNERS)
def test_places_in_a_distorted_cell_are_found(cell):
    """Any place in the cell's coordinates goes to a point and from there to the same mean of the nodes' displacements."""
    rng = np.random.default_rng(4)
    corners = np.array(CORNERS[cell]) + rng.uniform(-0.15, 0.15, (len(CORNERS[cell]), 3))
    weights = CELLS[cell].shapes(rng.uniform(0, 0.33, (40, 3)))[0]
    points = (weights @ corners) * [0.01, 1.0, 3.0] + [5, -2, 0]  # a flat cell far from the origin
    displacement = rng.normal(size=(2, len(corners), 3))
    mesh = Mesh(corners * [0.01, 1.0, 3.0] + [5, -2, 0], np.arange(len(corners))[None], cell, {})
    found = interpolate(mesh, displacement, points)
    np.testing.assert_allclose(found, np.einsum("mn,tnd->tmd", weights, displacement), atol=1e-9)  # of some units; x has 13 digits of 0.01


@pytest.mark.parametrize("cell", CORNERS)
@pytest.mark.parametrize("side", [-1, 1])
def test_a_point_is_outside_from_a_millionth_of_the_cell_on(cell, side):
    """Half a millionth is rounding, two are not, and one per cent is outside by far; cells of 0.025, 0.01 and 0.015 m."""
    mesh, size = beam(cell, (4, 2, 2)), np.array([0.025, 0.01, 0.015])
    for axis, end in enumerate((0.1, 0.02, 0.03)):
        point = np.array([[0.055, 0.007, 0.011]])
        for far, outside in ((0.5e-6, False), (2.5e-6, True), (1e-2, True), (1.0, True)):
            point[0, axis] = (end if side == 1 else 0.0) + side * far * size[axis]
            if outside:
                with pytest.raises(ValueError, match="^1 of 1 points lie outside of the mesh to interpolate from$"):
                    interpolate(mesh, mesh.points[None], point)
            else:
                np.testing.assert_allclose(interpolate(mesh, mesh.points[None], point)[0], point, atol=1e-12)


def test_a_point_is_sought_in_more_cells_than_the_one_with_the_nearest_centre():
    """A long cell beside short ones: near its end the centres of twelve others are nearer, by whole cells' sizes."""
    mesh = beam("hexahedron", (13, 1, 1))
    columns = np.concatenate([np.arange(13) * 0.1, [13.0]])  # twelve of 0.1 and one of 11.8
    mesh.points[:, 0] = columns[np.round(mesh.points[:, 0] / (0.1 / 13)).astype(int)]
    values = (mesh.points[:, :1] > 12) * np.ones(3)
    for few in (None, 1, 4):
        found = interpolate(mesh, values[None], np.array([[1.3, 0.011, 0.002], [0.75, 0.011, 0.002], [12.41, 0.011, 0.002]]), few=few)
        np.testing.assert_allclose(found[0], np.array([[0.1 / 11.8], [0], [11.21 / 11.8]]) * np.ones(3), atol=1e-9)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_interpolation_of_second_order_is_exact_for_quadratic_fields(cell):
    mesh, rng = build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=(4, 2, 2), cell=cell, order=2)), np.random.default_rng(0)
    points = rng.uniform(0, 1, (50, 3)) * [0.1, 0.02, 0.03]
    factors = rng.normal(size=(10, 3))

    def field(x):
        return np.column_stack([np.ones(len(x)), x, x**2, x * np.roll(x, 1, axis=1)])[None] @ factors

    np.testing.assert_allclose(interpolate(mesh, field(mesh.points), points), field(points), atol=1e-13)
    curved = mesh.points + 1e-3 * np.sin(50 * mesh.points[:, [1, 2, 0]])
    anything = rng.normal(size=(2, *curved.shape))
    np.testing.assert_allclose(interpolate(replace(mesh, points=curved), anything, curved), anything, atol=1e-10)
