"""The exact distance to triangles, held against a literal loop, winding numbers, and values worked out on paper."""

import numpy as np
import pytest

from physics.contact.closed import Closed
from physics.scene.surface import sound, winding
from tests.tools import ball, brick, spanner

SHAPES = {"ball": ball(1.0, 0.5), "brick": brick((1.0, 0.6, 0.3), 0.0, 9.0), "spanner": spanner()}


def closed(name):
    points, triangles, _ = sound(*SHAPES[name])
    return Closed(points, triangles), points, triangles


def from_triangle(x, a, b, c):
    """The nearest point of a triangle, corner by corner, edge by edge, and face (Ericson, Real-Time Collision Detection, 5.1.5)."""
    ab, ac, ap = b - a, c - a, x - a
    d1, d2 = ab @ ap, ac @ ap
    if d1 <= 0 and d2 <= 0:
        return a
    d3, d4 = ab @ (x - b), ac @ (x - b)
    if d3 >= 0 and d4 <= d3:
        return b
    if d1 * d4 - d3 * d2 <= 0 and d1 >= 0 and d3 <= 0:
        return a + d1 / (d1 - d3) * ab
    d5, d6 = ab @ (x - c), ac @ (x - c)
    if d6 >= 0 and d5 <= d6:
        return c
    vb, va, vc = d5 * d2 - d1 * d6, d3 * d6 - d5 * d4, d1 * d4 - d3 * d2
    if vb <= 0 and d2 >= 0 and d6 <= 0:
        return a + d2 / (d2 - d6) * ac
    if va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        return b + (d4 - d3) / (d4 - d3 + d5 - d6) * (c - b)
    return a + vb / (va + vb + vc) * ab + vc / (va + vb + vc) * ac


@pytest.mark.parametrize("name", SHAPES)
def test_distance_and_side_are_those_of_a_literal_loop_and_of_winding_numbers(name):
    surface, points, triangles = closed(name)
    low, high = points.min(axis=0), points.max(axis=0)
    places = low + (high - low) * np.random.default_rng(0).uniform(-0.3, 1.3, size=(300, 3))
    distance, nearest = surface.distance(places)
    each = [min((from_triangle(x, *points[t]) for t in triangles), key=lambda q, x=x: np.linalg.norm(x - q)) for x in places]
    literal = np.linalg.norm(places - each, axis=1)
    assert abs(distance) == pytest.approx(literal, abs=1e-12 * np.ptp(points))
    assert np.linalg.norm(places - nearest, axis=1) == pytest.approx(literal, abs=1e-12 * np.ptp(points))
    inside = winding(places, points, triangles) > 0.5
    assert 20 < inside.sum() < 280 and np.array_equal(distance < 0, inside)


def test_beside_edges_and_corners_the_side_is_told_by_all_triangles_there():
    """At a corner of a tetrahedron whose faces are steep, the face that comes first would say inside."""
    points = np.array([[0, 0, 0], [3, 0.2, 0], [3, -0.2, 0.0], [3, 0, 0.3]], float)
    points, triangles, _ = sound(points, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    surface = Closed(points, triangles)
    rng = np.random.default_rng(1)
    before = np.column_stack([-rng.uniform(0.01, 1, 200), rng.normal(size=(200, 2))])
    distance, nearest = surface.distance(before)
    assert (distance > 0).all() and (np.linalg.norm(nearest, axis=1) < 1e-15).sum() > 50
    assert (winding(before, points, triangles) < 0.5).all()


def test_on_the_surface_the_distance_is_nothing():
    surface, points, triangles = closed("spanner")
    edges = points[triangles] / 2 + points[np.roll(triangles, 1, axis=1)] / 2
    for places in (points, edges.reshape(-1, 3), points[triangles].mean(axis=1)):
        assert abs(surface.distance(places)[0]).max() < 1e-13


def test_distance_worked_out_on_paper():
    surface, _, _ = closed("brick")
    places = [[4, 0.1, 0.1], [0.2, 0.3, -0.5], [1 + 3, 0.6 + 4, 0], [-1 - 1, 0.6 + 2, -0.3 - 2], [0.1, 0.2, 0.1], [0.95, 0.1, 0.0],
              [-0.3, -0.58, 0.2]]
    assert surface.distance(np.array(places))[0] == pytest.approx([3, 0.2, 5, 3, -0.2, -0.05, -0.02], abs=1e-15)


@pytest.mark.parametrize("name", SHAPES)
def test_cubes_of_nodes_are_their_distances_one_by_one(name):
    surface, points, _ = closed(name)
    spacing = float(np.ptp(points, axis=0).min()) / 7
    low = points.mean(axis=0) + np.array([[0, 0, 0], [0.5, 0.3, 0.1], [-3.0, 2.0, 2.0]]) * np.ptp(points, axis=0)
    steps = np.stack(np.meshgrid(*3 * [np.arange(4)], indexing="ij"), axis=-1)
    nodes = low[:, None, None, None] + spacing * steps
    one_by_one = surface.distance(nodes.reshape(-1, 3))[0].reshape(3, 4, 4, 4)
    assert surface.cubes(low, spacing, 4) == pytest.approx(one_by_one, abs=1e-12 * np.ptp(points))


def test_few_large_triangles_beside_many_small_ones_change_nothing():
    """A brick with finely rounded edges has both; far from the middle of a large one its part of the tree is near."""
    points, triangles, _ = sound(*brick((1.0, 0.6, 0.3), 0.02, 9.0))
    apart = np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2).max(axis=1)
    assert apart.max() > 1
    fine, split, _ = sound(*ball(0.1, 0.02))
    both, triangles = np.concatenate([points, fine + [2, 0, 0]]), np.concatenate([triangles, split + len(points)])
    surface, places = Closed(both, triangles), np.random.default_rng(2).uniform(-1.5, 1.5, size=(200, 3))
    alone, other = Closed(points, triangles[:len(apart)]), Closed(fine + [2, 0, 0], split)
    assert surface.distance(places)[0] == pytest.approx(np.minimum(alone.distance(places)[0], other.distance(places)[0]), abs=1e-13)


def test_thickness_is_the_shortest_way_through():
    assert closed("brick")[0].thickness() == pytest.approx(0.6)
    assert closed("spanner")[0].thickness() == pytest.approx(6.0)  # its height; the prongs of the jaw are 6 wide as well
    points, triangles, _ = sound(*spanner(height=9.0))
    assert 5.5 < Closed(points, triangles).thickness() <= 6.5  # now the prongs, up to 6 mm wide
    assert closed("ball")[0].thickness() == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("items", [100_000, 400])
def test_a_large_triangle_has_the_middles_of_its_equal_parts_in_the_search_tree(items, monkeypatch):
    """A ball of triangles of 0.1 and a tetrahedron with edges of 1 or more: of n^2 parts of a side over n the middles, listed.

    A part's side is the median of all, or, of so many items, twice the side of a square that has the area over their number.
    """
    monkeypatch.setattr("physics.contact.closed.ITEMS", items)
    fine, small, _ = sound(*ball(0.3, 0.1))
    points = np.concatenate([fine, [[2.0, 0, 0], [3, 0, 0], [2, 1, 0], [2, 0, 1.5]]])
    triangles = np.concatenate([small, len(fine) + np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])])
    surface = Closed(points, triangles)
    corner = points[triangles]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum() / 2
    side = np.median(longest) if items > 400 else 2 * np.sqrt(area / 400)
    assert side >= np.median(longest) and longest[-4:].min() > 5 * side
    part = 0.0
    for k, (three, length) in enumerate(zip(corner, longest, strict=True)):
        n = int(np.ceil(length / side - 1e-9))
        a, b, c = three / n
        middles = [(i + 1 / 3) * a + (j + 1 / 3) * b + (n - i - j - 2 / 3) * c for i in range(n) for j in range(n - i)]
        middles += [(i + 2 / 3) * a + (j + 2 / 3) * b + (n - i - j - 4 / 3) * c for i in range(n - 1) for j in range(n - 1 - i)]
        found = surface._tree.data[surface._owner == k]
        assert len(found) == n * n and abs(found[:, None] - middles).max(axis=2).min(axis=1).max() < 1e-12
        part = max(part, length / n)
    # From the middle of a triangle no corner is further than two thirds of its longest median, which is shorter than its longest side.
    assert 2 / 3 * part <= surface._part == pytest.approx(2 / 3 * part, rel=2e-9)
