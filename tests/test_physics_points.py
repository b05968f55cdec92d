"""Points of facets where contact is felt, listed: where they lie, what they count, and which of neighbouring facets are one."""

import numpy as np
import pytest
import scipy.sparse

from physics.contact.points import merged, points_of
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body


def on_its_facets(mesh, divisions):
    """Weights and areas of the points of a mesh's outer facets."""
    return points_of([(mesh.kind_of(facets), facets) for facets in mesh.boundary], mesh.points, mesh.thickness, divisions)


def listed(mesh, divisions, facet):
    """Of one facet (its nodes): (position, area) of its points, rounded, sorted."""
    weights, areas = on_its_facets(mesh, divisions)
    own = np.flatnonzero([set(weights[q].indices[weights[q].data > 1e-12]) <= set(facet) for q in range(len(areas))])
    on = [q for q in own if set(weights[q].indices) == set(facet)]  # not those that other facets have there
    x = weights @ mesh.points
    return sorted((*np.round(x[q], 9) + 0.0, round(areas[q], 9)) for q in on)


TETRAHEDRON = Mesh(np.array([[0.0, 0, 0], [12, 0, 0], [0, 6, 0], [0, 0, 5]]), np.arange(4)[None], "tetrahedron", {})


def test_a_triangle_has_its_corners_by_a_twelfth_and_its_sides_middles_by_a_quarter():
    """Of 36 m2: 3 and 9."""
    assert listed(TETRAHEDRON, 1, [0, 1, 2]) == sorted([
        (0, 0, 0, 3), (12, 0, 0, 3), (0, 6, 0, 3), (6, 0, 0, 9), (6, 3, 0, 9), (0, 3, 0, 9)])


def test_of_four_parts_of_a_triangle_those_at_the_sides_middles_have_three_and_the_one_within_is_upside_down():
    """Each part has 9 m2: 0.75 at a corner, 2.25 in the middle of a side, and both of two parts that share it."""
    found = listed(TETRAHEDRON, 2, [0, 1, 2])
    corners = [(0, 0, 0), (12, 0, 0), (0, 6, 0)]
    halves = [(6, 0, 0), (6, 3, 0), (0, 3, 0)]  # of three parts, the one within among them
    rim = [(3, 0, 0), (9, 0, 0), (9, 1.5, 0), (3, 4.5, 0), (0, 1.5, 0), (0, 4.5, 0)]
    within = [(3, 1.5, 0), (6, 1.5, 0), (3, 3, 0)]
    expected = [(*x, a) for group, a in ((corners, 0.75), (halves, 2.25), (rim, 2.25), (within, 4.5)) for x in group]
    assert found == sorted(expected) and sum(row[3] for row in found) == pytest.approx(36)


def test_a_triangle_in_nine_parts_has_its_area_once():
    """Corners of parts within have six of them; of 16 m2 over four each."""
    found = listed(TETRAHEDRON, 3, [0, 1, 2])
    assert len(found) == 28 and sum(row[3] for row in found) == pytest.approx(36, abs=1e-7)  # 7 + 6 + .. + 1
    area = {tuple(row[:3]): row[3] for row in found}
    for place, parts in (((4, 2, 0), 6 / 12), ((4, 0, 0), 3 / 12), ((0, 0, 0), 1 / 12), ((2, 1, 0), 2 / 4), ((2, 0, 0), 1 / 4)):
        assert area[place] == pytest.approx(4 * parts)


BRICK = Mesh(np.array([[0.0, 0, 0], [6, 0, 0], [6, 3, 0], [0, 3, 0], [0, 0, 1], [6, 0, 1], [6, 3, 1], [0, 3, 1]]), np.arange(8)[None],
             "hexahedron", {})


@pytest.mark.parametrize("divisions", [1, 2])
def test_a_rectangle_has_simpsons_points_each_way(divisions):
    """1, 4, 1 or 1, 4, 2, 4, 1 over 6 or 12 each way, of 18 m2."""
    one = {1: np.array([1, 4, 1]) / 6, 2: np.array([1, 4, 2, 4, 1]) / 12}[divisions]
    at = np.linspace(0, 1, len(one))
    expected = sorted((round(6 * s, 9), round(3 * t, 9), 0.0, round(18 * a * b, 9)) for s, a in zip(at, one, strict=True)
                      for t, b in zip(at, one, strict=True))
    assert listed(BRICK, divisions, [0, 1, 2, 3]) == expected


def test_the_side_of_a_plane_cell_has_simpsons_points_times_the_thickness():
    sheet = Mesh(np.array([[0.0, 0, 0], [4, 3, 0], [-3, 4, 0]]), np.arange(3)[None], "triangle", {}, thickness=0.3)
    assert listed(sheet, 1, [0, 1]) == pytest.approx(np.array([(0, 0, 0, 0.25), (2, 1.5, 0, 1.0), (4, 3, 0, 0.25)]))
    assert listed(sheet, 2, [0, 1]) == pytest.approx(np.array([(0, 0, 0, 0.125), (1, 0.75, 0, 0.5), (2, 1.5, 0, 0.25), (3, 2.25, 0, 0.5),
                                                              (4, 3, 0, 0.125)]))


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_facets_of_second_order_carry_their_area_and_weigh_by_their_own_functions(cell):
    """x^2 over a flat facet is exactly what its functions have at its nodes; at points it is so too."""
    mesh = build_mesh(Body(length=0.4, width=0.3, height=0.2, cells=(2, 1, 1), cell=cell, order=2))
    weights, areas = on_its_facets(mesh, 2)
    assert areas.sum() == pytest.approx(2 * (0.12 + 0.08 + 0.06)) and weights.sum(axis=1) == pytest.approx(1)
    x = weights @ mesh.points
    assert weights @ mesh.points**2 == pytest.approx(x**2, abs=1e-15)
    nodes = np.split(weights.indices, weights.indptr[1:-1])
    top = np.array([(mesh.points[own, 2] > 0.2 - 1e-9).all() for own in nodes])  # of facets all of whose nodes are there
    assert areas[top].sum() == pytest.approx(0.12) and not (abs(weights.data) < 1e-12)[weights.data != 0].any()
    # The square of a coordinate is integrated exactly by Simpson's rule on quadrilaterals; on triangles corners count a bit too much.
    inner = (areas[top] * x[top, 0] ** 2).sum() / 0.12
    assert inner == pytest.approx(0.16 / 3, rel=1e-12 if cell == "hexahedron" else 0.03)


def test_points_with_the_same_nodes_and_weights_are_one():
    """Of six points of four nodes: two at node 1, two in the middle of 0 and 2 to nine digits, one beside it, and one of other nodes."""
    dense = np.array([[0, 1, 0, 0], [0.5, 0, 0.5, 0], [0.5 + 1e-8, 0, 0.5 - 1e-8, 0], [0, 1, 0, 0], [0.5 - 1e-11, 0, 0.5, 0],
                      [0.5, 0, 0, 0.5]])
    stored = scipy.sparse.csr_matrix((dense[:, ::-1].ravel(), (np.repeat(np.arange(6), 4), np.tile([3, 2, 1, 0], 6))), shape=(6, 4))
    weights, area = merged(stored, np.array([1.0, 2, 4, 8, 16, 32]))
    found = {tuple(row): a for row, a in zip(weights.toarray().tolist(), area.tolist(), strict=True)}
    assert found == {(0, 1, 0, 0): 9, (0.5, 0, 0.5, 0): 18, (0.5 + 1e-8, 0, 0.5 - 1e-8, 0): 4, (0.5, 0, 0, 0.5): 32}
    none, nothing = merged(scipy.sparse.csr_matrix((0, 4)), np.zeros(0))
    assert none.shape == (0, 4) and nothing.shape == (0,)
