"""Sample points on paper: where they lie, what they weigh, and what the mean and the reduced gradients are."""

from itertools import product

import numpy as np
import pytest

from physics.body.element import FOUR, MID_HEIGHT, samples
from physics.mesh.cell import CELLS, GAUSS, HEXAHEDRON
from physics.mesh.mesh import Mesh
from physics.schema import InputError

BOX = np.array([2.0, 3.0, 5.0])  # sides of the box that the cells are cut from; it stands away from the origin
UNIT = {"tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
        "prism": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
        "hexahedron": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]}


def one(cell, moved=0.0):
    points = np.array(UNIT[cell]) * BOX + [7, -1, 2] + moved
    return Mesh(points, np.arange(len(points))[None], cell, {})


def shape(cell, at):
    """The shape functions as textbooks give them."""
    r, s, t = at
    if cell == "tetrahedron":
        return np.array([1 - r - s - t, r, s, t])
    if cell == "prism":
        return np.array([(1 - r - s) * (1 - t), r * (1 - t), s * (1 - t), (1 - r - s) * t, r * t, s * t])
    return np.array([(r if x else 1 - r) * (s if y else 1 - s) * (t if z else 1 - t) for x, y, z in UNIT[cell]])


def gradients_at(cell, at, step=0.125):
    """(n, 3) by differences, exact as the functions are linear in each coordinate."""
    return np.stack([(shape(cell, at + step * e) - shape(cell, at - step * e)) / (2 * step) for e in np.eye(3)], axis=1)


@pytest.mark.parametrize("cell", UNIT)
def test_gradients_are_the_slopes_of_the_shape_functions(cell):
    at = np.array([(0.1, 0.2, 0.3), (0.3, 0.05, 0.6)])
    np.testing.assert_allclose(CELLS[cell].shapes(at)[1], [gradients_at(cell, point) for point in at], atol=1e-14)
    assert [list(corner) for corner in HEXAHEDRON] == [list(corner) for corner in UNIT["hexahedron"]]
    with pytest.raises(InputError, match="cell = 'line': must be one of triangle, quadrilateral, tetrahedron, prism, hexahedron"):
        CELLS["line"].shapes(at)


@pytest.mark.parametrize("cell, volume, powers", [("tetrahedron", 1 / 6, 1), ("prism", 1 / 2, 2), ("hexahedron", 1, 3)])
def test_rules_integrate_polynomials(cell, volume, powers):
    """Tetrahedron: degree 1; prism: 2 across and 3 along; hexahedron: 3 in each. Over the unit cells, by the beta function."""
    points, weights = CELLS[cell].points, CELLS[cell].weights
    assert weights.sum() == pytest.approx(volume, rel=1e-15) and np.ptp(weights) == 0
    fact = [1, 1, 2, 6, 24, 120, 720, 5040, 40320]
    for a, b, c in product(range(4), repeat=3):
        if cell == "tetrahedron":
            exact, known = fact[a] * fact[b] * fact[c] / fact[3] / np.prod(range(4, 4 + a + b + c)), a + b + c <= 1
        elif cell == "prism":
            exact, known = fact[a] * fact[b] / fact[a + b + 2] / (c + 1), a + b <= 2
        else:
            exact, known = 1 / (a + 1) / (b + 1) / (c + 1), True
        if known:
            assert (weights * points[:, 0] ** a * points[:, 1] ** b * points[:, 2] ** c).sum() == pytest.approx(exact, rel=1e-14)
    assert pytest.approx((0.5 - 3**-0.5 / 2, 0.5 + 3**-0.5 / 2)) == GAUSS
    places, weights = MID_HEIGHT
    assert (places[:, 2] == 0.5).all() and weights.sum() == pytest.approx(0.5) and len(places) == 3
    assert (weights * places[:, 0] * places[:, 1]).sum() == pytest.approx(1 / 24)
    assert (weights * places[:, 1] ** 2).sum() == pytest.approx(1 / 12)


@pytest.mark.parametrize("cell, share", [("tetrahedron", 1 / 6), ("prism", 1 / 2), ("hexahedron", 1)])
def test_samples_of_a_straight_cell(cell, share):
    """Gradients in metres are those in the cell's coordinates over the sides; each point has its weight of the volume 30."""
    found = samples(one(cell))
    points, weights = CELLS[cell].points, CELLS[cell].weights
    np.testing.assert_allclose(found.gradients[:, 0], [gradients_at(cell, point) / BOX for point in points], atol=1e-14)
    np.testing.assert_allclose(found.volumes[:, 0], 30 * weights, rtol=1e-13)
    assert found.volumes.sum() == pytest.approx(30 * share, rel=1e-13)
    assert np.array_equal(found.parts, np.ones((len(points), 2))) and found.gradients.shape == (len(points), 1, len(UNIT[cell]), 3)


def test_gradients_in_a_sheared_cell():
    """x = r + s / 2 and so on: grad_x N = J^-T grad_r N, which a transpose forgotten would not give."""
    J = np.array([(2.0, 0.5, 0.0), (0.0, 3.0, 0.25), (1.0, 0.0, 5.0)])
    mesh = Mesh(np.array(UNIT["tetrahedron"]) @ J.T, np.arange(4)[None], "tetrahedron", {})
    found = samples(mesh)
    np.testing.assert_allclose(found.gradients[0, 0], gradients_at("tetrahedron", [0.25] * 3) @ np.linalg.inv(J), atol=1e-14)
    assert found.volumes[0, 0] == pytest.approx(np.linalg.det(J) / 6, rel=1e-14)


@pytest.mark.parametrize("cell", ["prism", "hexahedron"])
def test_mean_dilatation_samples_mu_everywhere_and_lambda_once(cell):
    rng = np.random.default_rng(0)
    mesh = one(cell, rng.uniform(-0.3, 0.3, (len(UNIT[cell]), 3)))
    found, plain = samples(mesh, "mean-dilatation"), samples(mesh)
    assert found.parts.tolist() == [[0, 1]] * len(plain.volumes) + [[1, 0]]
    assert np.array_equal(found.gradients[:-1], plain.gradients) and np.array_equal(found.volumes[:-1], plain.volumes)
    volume = plain.volumes.sum()
    assert found.volumes[-1, 0] == pytest.approx(volume, rel=1e-14)
    mean = sum(v * g for v, g in zip(plain.volumes[:, 0], plain.gradients[:, 0], strict=True)) / volume
    np.testing.assert_allclose(found.gradients[-1, 0], mean, atol=1e-14)


def test_reduced_samples_mu_at_three_points_at_mid_height():
    """On a prism whose top is three times as large as its bottom, so that the mean lies above mid-height."""
    mesh = one("prism")
    mesh.points[3:, :2] = (mesh.points[3:, :2] - [7, -1]) * 3**0.5 + [7, -1]
    found, fine = samples(mesh, "reduced"), samples(mesh)
    assert found.parts.tolist() == [[0, 1]] * 3 + [[1, 0]]
    volume = fine.volumes.sum()
    np.testing.assert_allclose(found.volumes[:, 0], [volume / 3] * 3 + [volume], rtol=1e-13)
    mean = (fine.volumes[:, 0, None, None] * fine.gradients[:, 0]).sum(axis=0) / volume
    np.testing.assert_allclose(found.gradients[-1, 0], mean, atol=1e-14)
    # The gradients at mid-height, all moved by one constant, so that their mean is that of the whole cell.
    middle = []
    for at in ((1 / 6, 1 / 6, 0.5), (2 / 3, 1 / 6, 0.5), (1 / 6, 2 / 3, 0.5)):
        local = gradients_at("prism", np.array(at))
        middle.append(local @ np.linalg.inv(mesh.points.T @ local))
    moved = found.gradients[:3, 0] - middle
    np.testing.assert_allclose(moved, np.broadcast_to(mean - np.mean(middle, axis=0), moved.shape), atol=1e-14)
    assert abs(moved).max() > 1e-3  # there is something to move here


@pytest.mark.parametrize("cell, element, words", [("tetrahedron", "reduced", "tetrahedra"), ("hexahedron", "reduced", "hexahedra"),
                                                  ("tetrahedron", "mean-dilatation", "tetrahedra")])
def test_elements_that_are_not_for_these_cells_are_refused(cell, element, words):
    with pytest.raises(InputError, match=f'body.element = .{element}.: not for {words}; leave it out'):
        samples(one(cell), element)


def test_four_points_have_all_mean_values_up_to_degree_2_on_a_cube():
    for powers in product(range(3), repeat=3):
        if sum(powers) <= 2:
            assert np.prod(FOUR**powers, axis=1).mean() == pytest.approx(np.prod([1 / (p + 1) for p in powers]), abs=1e-15)


def test_dilatation_of_second_order_is_linear_in_a_cell_and_known_at_four_points():
    """In a brick: the square of x has the slope 2 x at each of the points of a quarter of the volume, where lambda alone counts."""
    places = CELLS["hexahedron27"].places
    brick = Mesh(places * BOX + [7, -1, 2], np.arange(27)[None], "hexahedron27", {})
    found = samples(brick, "mean-dilatation")
    assert found.parts.tolist() == [[0.0, 1.0]] * 27 + [[1.0, 0.0]] * 4
    assert found.volumes[27:, 0] == pytest.approx([30 / 4] * 4) and found.volumes[:27].sum() == pytest.approx(30)
    slope = np.einsum("qni,n->qi", found.gradients[27:, 0], brick.points[:, 0] ** 2)
    assert slope == pytest.approx(np.outer(2 * (FOUR[:, 0] * 2 + 7), [1, 0, 0]), abs=1e-9)
    skew = Mesh(places * BOX * (1 + 0.2 * places[:, ::-1]), np.arange(27)[None], "hexahedron27", {})
    of = samples(skew, "mean-dilatation")
    centre = (of.volumes[:27] * CELLS["hexahedron27"].points).sum(axis=0)
    assert of.volumes[27:].sum() == pytest.approx(of.volumes[:27].sum()) and (of.volumes[27:] * FOUR).sum(axis=0) == pytest.approx(centre)
