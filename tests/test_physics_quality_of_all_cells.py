"""Measures of quality of every kind of cell, away from the origin: areas, ratios and determinants by formulas, neighbours by sets."""

from dataclasses import replace

import numpy as np
import pytest

from physics.mesh import quality
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS, CORNERS
from physics.scene import Body

AWAY = np.array([3.0, -2.0, 5.0])
SOLID, PLANE = ("prism", "tetrahedron", "hexahedron"), ("triangle", "quadrilateral")


def mesh_of(cell, order=1):
    if cell in PLANE:
        return build_mesh(Body(shape="plate", length=3.0, width=2.0, cells=(3, 2), cell=cell))
    return build_mesh(Body(length=3.0, width=2.0, height=1.0, cells=(3, 2, 1), cell=cell, order=order))


def test_areas_of_plane_cells_in_space():
    """A trapezium of parallel sides 4 and 2, 3 high, and the triangle without its last corner, tilted by a right angle."""
    trapezium = np.array([[0, 0, 0], [4, 0, 0], [3, 3, 0], [1, 3, 0]], float)
    for turned in (trapezium, trapezium[:, [2, 0, 1]], trapezium[::-1]):
        assert quality.cell_volumes(turned + AWAY, np.array([[0, 1, 2, 3]]), "quadrilateral") == pytest.approx([9])
    assert quality.cell_volumes(trapezium + AWAY, np.array([[0, 1, 2], [3, 0, 1], [1, 2, 3]]), "triangle") == pytest.approx([6, 6, 3])
    assert quality.aspect_ratio(trapezium + AWAY, np.array([[0, 1, 2, 3]]), "quadrilateral") == pytest.approx([4 / 3])


@pytest.mark.parametrize("cell", CORNERS)
def test_det_f_of_an_even_stretch_is_its_determinant_and_of_a_bent_cell_the_least(cell):
    """x grows by x y / 2 beside y = 0 .. 1, so det F = 1 + y / 2, and by -x y / 2: least where y is 1."""
    d = CELLS[cell].dimension
    x = CORNERS[cell] + AWAY * ([1, 1, 0] if d == 2 else 1)
    cells = np.arange(len(x))[None]
    stretch = np.array([[0.5, 0.2, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 0.25 * (d == 3)]])
    assert quality.det_f(x, x @ stretch, cells, cell) == pytest.approx([(1.5 * 2.0 - 0.02) * (1.25 if d == 3 else 1)])
    if cell in ("quadrilateral", "hexahedron"):
        for share, least in ((0.5, 1.0), (-0.5, 0.5)):
            bent = share * CORNERS[cell][:, :1] * CORNERS[cell][:, 1:2] * [1, 0, 0]
            assert quality.det_f(x, np.stack([bent, 0 * bent]), cells, cell) == pytest.approx(np.array([[least], [1.0]]))


@pytest.mark.parametrize("cell, volume, least", [("tetrahedron10", 1 / 6 - 4 * 0.16 / 120, 1 - 0.16), ("hexahedron27", 1 - 0.16, 1 - 0.64)])
def test_second_order_cells_are_looked_at_their_nodes_and_points(cell, volume, least):
    """X = x + a y^2, Y = y + a x^2 has det J = 1 - 4 a^2 x y; the integral of x y is 1/120 over the tetrahedron, 1/4 over the cube."""
    x = CELLS[cell].places
    bent = 0.4 * np.stack([x[:, 1]**2, x[:, 0]**2, 0 * x[:, 0]], axis=1)
    cells = np.arange(len(x))[None]
    assert quality.cell_volumes(x + bent + AWAY, cells, cell) == pytest.approx([volume], rel=1e-12)
    assert quality.det_f(x + AWAY, bent, cells, cell) == pytest.approx([least], rel=1e-12)
    centre = CELLS[cell].shapes(np.full(3, 1 / 4 if cell == "tetrahedron10" else 1 / 2))[1]
    assert quality.centre_gradients(cell) == pytest.approx(centre, abs=1e-14)


@pytest.mark.parametrize("cell, order", [(cell, 1) for cell in SOLID + PLANE] + [("tetrahedron", 2), ("hexahedron", 2)])
def test_continuity_is_that_of_neighbours_found_by_sets(cell, order):
    """Of second order, whose corners are moved and whose middles go with them, it is that of the corners."""
    mesh = mesh_of(cell, order)
    first = mesh_of(cell)
    draw = np.random.default_rng(0)
    frames = first.points + 0.1 * draw.uniform(-1, 1, (2, *first.points.shape)) * ([1, 1, 0] if cell in PLANE else 1)
    facets = [[frozenset(row[i] for i in facet) for facet in CELLS[cell].facets] for row in first.cells.tolist()]
    wanted, shapes = [], []
    for x in frames:
        size = quality.cell_volumes(x, first.cells, cell)
        near = [[size[j] for j in range(len(facets)) if j != i and set(facets[i]) & set(facets[j])] for i in range(len(facets))]
        wanted.append(np.mean([max(of) / min(of) for of in near]))
        shapes.append(quality.aspect_ratio(x, first.cells, cell))
    moved = frames if order == 1 else np.concatenate([frames, np.zeros((2, len(mesh.points) - len(first.points), 3))], axis=1)
    assert quality.mesh_continuity(moved, mesh.cells, mesh.cell) == pytest.approx(np.array(wanted), rel=1e-12)
    assert quality.aspect_ratio(moved, mesh.cells, mesh.cell) == pytest.approx(np.array(shapes), rel=1e-12)
    assert quality.mesh_continuity(moved[0], mesh.cells[:1], mesh.cell) == 1.0  # a lone cell


@pytest.mark.parametrize("cell", CORNERS)
def test_the_scaled_jacobian_is_the_least_corners_over_its_edges_and_that_of_the_ideal_cell(cell):
    d = CELLS[cell].dimension
    x = CORNERS[cell] @ np.array([[2.0, 0.3, 0.1 * (d == 3)], [0.4, 1.5, -0.2 * (d == 3)], [0.1, 0.25, 3.0]]) + AWAY
    ideal = {"triangle": 3**0.5 / 2, "quadrilateral": 1, "tetrahedron": 2**-0.5, "prism": 3**0.5 / 2, "hexahedron": 1}[cell]
    corners = []
    for i in range(len(x)):
        ends = [a + b - i for a, b in CELLS[cell].edges if i in (a, b)]
        edges = (x[ends] - x[i])[:, :d]
        corners.append(abs(np.linalg.det(edges)) / np.linalg.norm(edges, axis=1).prod())
    found = quality.scaled_jacobian(np.stack([x, x * [1, -1, 1]]), np.arange(len(x))[None], cell)
    assert found == pytest.approx(np.array([[min(corners) / ideal], [-max(corners) / ideal]]), rel=1e-12)


def test_cells_with_flat_corners_are_judged_by_the_others():
    """The corner (1, 1) of a square drawn to (1/2, 1/2), where its two sides form one line: no ratio there, and the rest has one."""
    x = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0, 1, 0]]) + AWAY * [1, 1, 0]
    cells = np.array([[0, 1, 2, 3]])
    assert quality.det_f(x, 0.5 * x, cells, "quadrilateral") == pytest.approx([2.25])
    assert replace(mesh_of("quadrilateral"), points=x, cells=cells).dimension == 2
