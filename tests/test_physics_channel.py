"""A channel with a round hole: its grids, rings and places, counted on paper and in plain loops."""

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.scene import read_body


def channel(cell="quadrilateral", **changes):
    """2 x 1 m in cells of 0.1 m, a hole of radius 0.1 m at (1, 0.4): the box around it is 1.2 m long, as far as the farther wall."""
    table = {"shape": "channel", "length": 2.0, "height": 1.0, "hole_centre": [1.0, 0.4], "hole_radius": 0.1, "cell_size": 0.1,
             "cell": cell} | changes
    return build_mesh(read_body({"body": table}))


def area(mesh):
    """Of each cell, by its corners (shoelace formula), positive where they go round counter-clockwise."""
    x, y = mesh.points[mesh.cells].transpose(2, 0, 1)[:2]
    return 0.5 * sum(x[:, i - 1] * y[:, i] - x[:, i] * y[:, i - 1] for i in range(x.shape[1]))


def x_of_columns(mesh):
    """The columns of the grids: where nodes lie at y = 0."""
    return np.sort(mesh.points[mesh.places["y-min"], 0])


def in_box(mesh, left, right):
    """Which cells lie between x = left and right."""
    x = mesh.points[mesh.cells][:, :, 0]
    return (x.min(axis=1) > left - 1e-9) & (x.max(axis=1) < right + 1e-9)


def test_before_and_behind_the_box_lies_a_grid_of_squares():
    """The farther wall is 0.6 m from the hole: the box reaches from 0.4 to 1.6 m, before and behind it 4 x 10 squares each."""
    mesh = channel()
    for left, right in ((0.0, 0.4), (1.6, 2.0)):
        squares = mesh.points[mesh.cells[in_box(mesh, left, right)]]
        corner = {tuple(np.round(x.min(axis=0)[:2], 9)) for x in squares}
        assert len(squares) == 40 and corner == {(round(left + 0.1 * i, 9), round(0.1 * j, 9)) for i in range(4) for j in range(10)}
        np.testing.assert_allclose(np.ptp(squares, axis=1), np.broadcast_to([0.1, 0.1, 0], (40, 3)), atol=1e-12)
        np.testing.assert_allclose(squares[:, 1] - squares[:, 0], np.broadcast_to([0.1, 0, 0], (40, 3)), atol=1e-12)
    np.testing.assert_allclose(x_of_columns(mesh), np.linspace(0, 2, 21), atol=1e-12)


def test_the_rings_run_along_rays_and_grow_by_one_ratio_from_the_hole_to_the_box():
    mesh, centre, radius = channel(), np.array([1.0, 0.4]), 0.1
    columns, rows = 12, 10  # 1.2 m and 1 m in cells of 0.1 m
    outer = [(0.4 + 0.1 * i, y) for i in range(columns + 1) for y in (0.0, 1.0)] + [(x, 0.1 * j) for j in range(1, rows) for x in (0.4,
                                                                                                                                   1.6)]
    assert len(outer) == 44
    fine, coarse = 2 * np.pi * radius / 44, 4.4 / 44  # the hole and the box, 4.4 m around it, in 44 parts each
    reach = [np.hypot(x - 1.0, y - 0.4) for x, y in outer]
    depth = np.mean(reach) - radius
    # Rings as thick as fine (coarse / fine)^s, s = 0 .. 1: their mean is (coarse - fine) / ln(coarse / fine).
    count = round(depth * np.log(coarse / fine) / (coarse - fine))
    assert count == 12  # 0.53 m deep, 0.0143 and 0.1 m
    ratio = (coarse / fine) ** (1 / count)
    t = [(ratio**k - 1) / (ratio**count - 1) for k in range(count + 1)]  # the sum of a geometric series
    expected = [centre + (radius + (far - radius) * s) * (np.array(at) - centre) / far for at,
                far in zip(outer, reach, strict=True) for s in t]
    outside = (mesh.points[:, 0] < 0.4 - 1e-9) | (mesh.points[:, 0] > 1.6 + 1e-9)
    found = mesh.points[~outside, :2]
    gaps = np.linalg.norm(found[:, None] - np.array(expected), axis=2)
    assert len(found) == len(expected) == 44 * 13 and gaps.min(axis=0).max() < 1e-12 and gaps.min(axis=1).max() < 1e-12
    assert len(mesh.points) == 44 * 13 + 2 * 4 * 11 and len(mesh.cells) == 44 * 12 + 2 * 40
    assert not mesh.points[:, 2].any() and mesh.points.shape[1] == 3
    on_box = abs(found - [1.0, 0.5]).max(axis=1)
    assert {float(x) for x in mesh.points[mesh.places["y-max"], 1]} == {1.0} and on_box.max() < 0.6 + 1e-9  # to the last bit


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("changes", [{}, {"hole_centre": [0.3, 0.55]}, {"hole_centre": [1.75, 0.5], "hole_radius": 0.2},
                                     {"cell_size": 0.9}, {"hole_radius": 0.39, "cell_size": 0.3}])
def test_cells_go_round_counter_clockwise_and_fill_the_channel_but_for_the_polygon_of_the_hole(cell, changes):
    mesh = channel(cell, **changes)
    radius, corners = changes.get("hole_radius", 0.1), mesh.points[mesh.places["hole"], :2]
    x, y = (corners - changes.get("hole_centre", [1.0, 0.4])).T
    angle = np.sort(np.arctan2(y, x))
    polygon = 0.5 * radius**2 * np.sin(np.diff(np.append(angle, angle[0] + 2 * np.pi))).sum()  # triangles from its centre
    assert area(mesh).min() > 0 and mesh.cell == cell and mesh.cells.shape[1] == {"triangle": 3, "quadrilateral": 4}[cell]
    assert area(mesh).sum() == pytest.approx(2.0 * 1.0 - polygon, rel=1e-12)
    distance = np.linalg.norm(mesh.points[:, None] - mesh.points, axis=2) + np.eye(len(mesh.points))
    assert distance.min() > 1e-3 and len(np.unique(mesh.cells)) == len(mesh.points)  # no node twice, none without a cell


def test_a_grid_narrower_than_half_a_cell_is_left_out():
    """The box reaches half a metre to either side of a hole at mid-height; what is left beside it is 0.04 or 0.06 m of 0.1 m."""
    for beside, there in ((0.04, False), (0.06, True)):
        before = x_of_columns(channel(hole_centre=[0.5 + beside, 0.5]))
        behind = x_of_columns(channel(hole_centre=[1.5 - beside, 0.5]))
        if there:
            expected = [0, *np.linspace(0.06, 1.06, 11), *np.linspace(1.06, 2, 10)[1:]]  # behind: 0.94 m in 9 columns
        else:
            expected = [*np.linspace(0, 1.04, 11), *np.linspace(1.04, 2, 11)[1:]]
        np.testing.assert_allclose(before, expected, atol=1e-12)
        np.testing.assert_allclose(behind, 2 - before[::-1], atol=1e-12)
    # A box that would reach beyond both ends ends there.
    np.testing.assert_allclose(x_of_columns(channel(length=0.9, hole_centre=[0.4, 0.5])), np.linspace(0, 0.9, 10), atol=1e-12)


def test_coarse_channels_have_two_rows_two_columns_and_two_rings_at_least():
    mesh = channel(cell_size=5.0, length=4.0, hole_centre=[2.0, 0.5])  # the box is shorter than a cell, so it takes all of the length
    assert len(mesh.points) == 8 * 5 and len(mesh.cells) == 8 * 4  # 1.56 m ln(1.25 / 0.0785) / (1.25 m - 0.0785 m) = 3.7 rings
    np.testing.assert_allclose(x_of_columns(mesh), [0, 2, 4], atol=1e-12)
    np.testing.assert_allclose(np.sort(mesh.points[mesh.places["x-min"], 1]), [0, 0.5, 1], atol=1e-12)
    narrow = channel(cell_size=0.8, length=4.0, hole_centre=[2.0, 0.5])  # grids of 1.5 m: round(1.875) = 2 columns
    np.testing.assert_allclose(x_of_columns(narrow), [0, 0.75, 1.5, 2, 2.5, 3.25, 4], atol=1e-12)
    one = channel(cell_size=0.8, length=2.0, hole_centre=[1.0, 0.5])  # grids of 0.5 m: one column
    np.testing.assert_allclose(x_of_columns(one), [0, 0.5, 1, 1.5, 2], atol=1e-12)
    wide = channel(hole_radius=0.39, hole_centre=[1.0, 0.5], cell_size=0.5)  # 0.214 m ln(0.5 / 0.306) / (0.5 m - 0.306 m) = 0.54 rings
    assert len(wide.points) == 8 * 3 + 2 * 3


def test_triangles_cut_quadrilaterals_along_the_shorter_diagonal_of_equal_ones_in_turns():
    quadrilaterals, triangles = channel(), channel("triangle")
    assert np.array_equal(quadrilaterals.points, triangles.points)
    expected, kinds = [], set()
    for number, (a, b, c, d) in enumerate(quadrilaterals.cells.tolist()):
        first, second = (np.linalg.norm(quadrilaterals.points[i] - quadrilaterals.points[j]) for i, j in ((a, c), (b, d)))
        kind = "equal" if abs(first - second) < 1e-6 else "first" if first < second else "second"
        kinds.add(kind)
        expected += [(a, b, c), (a, c, d)] if kind == "first" or (kind == "equal" and number % 2 == 0) else [(a, b, d), (b, c, d)]
    assert triangles.cells.tolist() == [list(row) for row in expected] and kinds == {"equal", "first", "second"}


def test_places_of_a_channel_are_its_sides_and_its_hole():
    mesh = channel("triangle")
    x, y, _ = mesh.points.T
    expected = {"x-min": abs(x) < 1e-6, "x-max": abs(x - 2) < 1e-6, "y-min": abs(y) < 1e-6, "y-max": abs(y - 1) < 1e-6,
                "hole": abs(np.hypot(x - 1.0, y - 0.4) - 0.1) < 1e-6}
    expected |= {"inlet": expected["x-min"], "outlet": expected["x-max"], "walls": expected["y-min"] | expected["y-max"]}
    assert {name: nodes.tolist() for name, nodes in mesh.places.items()} == {name: np.flatnonzero(on).tolist() for name,
                                                                             on in expected.items()}
    assert set(read_body({"body": {"shape": "channel"}}).places) == set(expected)
    assert {name: len(nodes) for name, nodes in mesh.places.items()} == {
        "x-min": 11, "x-max": 11, "y-min": 21, "y-max": 21, "hole": 44, "inlet": 11, "outlet": 11, "walls": 42}


def test_left_out_it_is_the_channel_of_flow_around_a_cylinder():
    """1.6 x 0.41 m in triangles of 0.02 m, the hole of radius 0.05 m at (0.2, 0.2)."""
    mesh = build_mesh(read_body({"body": {"shape": "channel"}}))
    assert mesh.cell == "triangle" and mesh.points.max(axis=0).tolist() == [1.6, 0.41, 0.0]
    hole = mesh.points[mesh.places["hole"]]
    np.testing.assert_allclose(np.hypot(hole[:, 0] - 0.2, hole[:, 1] - 0.2), 0.05, rtol=1e-12)
    assert len(mesh.places["outlet"]) == 21 and np.diff(x_of_columns(mesh))[-1] == pytest.approx(0.02, rel=0.02)  # round(20.5) = 20 rows
