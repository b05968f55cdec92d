"""The parts of a panel's mesh, beside plain loops, closed forms and what is on paper."""

import re
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.path import Path
from scipy.spatial import Delaunay

from physics.mesh.build import build_mesh
from physics.mesh.shapes import panel
from physics.scene import read_body
from physics.schema import InputError

ANGLE = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.125], [0.25, 0.1875], [0.25, 0.375], [0.0, 0.375]])
HOLE = np.array([0.125, 0.1875, 0.0625])
SIZE, HEIGHT = 0.04, 0.02


def build(scale=1.0, **changes):
    table = {"outline": (scale * ANGLE).tolist(), "holes": [(scale * HOLE).tolist()], "height": scale * HEIGHT, "cell_size": scale * SIZE,
             "layers": 3, "cell": "prism"}
    return build_mesh(read_body({"body": {"shape": "panel"} | table | changes}))


def distance(p, loop):
    """From the sides of a closed line, one after another."""
    found = []
    for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
        share = min(max((p - a) @ (b - a) / ((b - a) @ (b - a)), 0), 1)
        found.append(np.linalg.norm(a + share * (b - a) - p))
    return min(found)


def edge_of(points, loop, hole):
    """Delaunay's triangles whose middle is in the outline and out of the hole."""
    cells = Delaunay(points).simplices.tolist()
    return [cell for cell in cells if loop.contains_point(points[cell].mean(axis=0)) and not hole.contains_point(points[cell].mean(axis=0))]


def test_each_node_is_where_a_plain_version_puts_it():
    """Sides and rim in even parts, a lattice of equilateral triangles 0.7 of their side clear of them, 40 moves, anew after each 8."""
    fixed = []
    for a, b in zip(ANGLE, np.roll(ANGLE, -1, axis=0), strict=True):
        parts = round(np.linalg.norm(b - a) / SIZE)
        fixed += [a + k / parts * (b - a) for k in range(parts)]
    outer, around = len(fixed), round(2 * np.pi * HOLE[2] / SIZE)
    fixed += [HOLE[:2] + HOLE[2] * np.array([np.cos(2 * np.pi * k / around), np.sin(2 * np.pi * k / around)]) for k in range(around)]
    inner, rise = [], SIZE * 3**0.5 / 2
    for j in range(-6, 6):  # 0.375 / 0.0346 is 10, and two more
        for i in range(-7, 7):  # 0.5 / 0.04 is 12, and two more
            p = np.array([0.25 + (i + (j % 2) / 2) * SIZE, 0.1875 + j * rise])
            if Path(ANGLE).contains_point(p) and distance(p, ANGLE) > 0.7 * SIZE and np.linalg.norm(p - HOLE[:2]) > HOLE[2] + 0.7 * SIZE:
                inner.append(p)
    points = np.array(fixed + inner)
    loops = Path(points[:outer]), Path(points[outer:len(fixed)])
    for turn in range(40):
        if turn % 8 == 0:
            cells = edge_of(points, *loops)
            near = {k: {n for cell in cells if k in cell for n in cell} - {k} for k in range(len(points))}
        points[len(fixed):] = [points[sorted(near[k])].mean(axis=0) for k in range(len(fixed), len(points))]
    mesh = build()
    n = len(points)
    assert around == 10 and len(inner) > 40
    for k in range(4):
        assert mesh.points[k * n:(k + 1) * n] == pytest.approx(np.pad(points, ((0, 0), (0, 1)), constant_values=k * HEIGHT / 3), abs=1e-12)
    wanted = {frozenset(cell) for cell in edge_of(points, *loops)}
    assert len(mesh.points) == 4 * n and len(mesh.cells) == 3 * len(wanted)
    for k, layer in enumerate(np.split(mesh.cells, 3)):
        assert {frozenset((row - k * n).tolist()) for row in layer[:, :3]} == wanted and (layer[:, 3:] == layer[:, :3] + n).all()
        a, b, c = (mesh.points[layer[:, i], :2] for i in range(3))
        assert ((b - a)[:, 0] * (c - a)[:, 1] > (b - a)[:, 1] * (c - a)[:, 0]).all()  # counter-clockwise
    assert mesh.places["z-min"].tolist() == list(range(n)) and mesh.places["z-max"].tolist() == list(range(3 * n, 4 * n))
    assert mesh.places["hole-1"].tolist() == [layer * n + k for layer in range(4) for k in range(outer, outer + around)]


def test_a_panel_twice_as_large_has_the_same_mesh_twice_as_large():
    """To the bit, by powers of two: nothing in it has a length of its own."""
    one = build()
    for scale in (2.0**12, 2.0**-12):
        other = build(scale)
        assert np.array_equal(other.points, scale * one.points) and np.array_equal(other.cells, one.cells)


def test_the_area_in_a_line_is_positive_where_it_runs_counter_clockwise():
    loop = np.array([[1.0, 1.0], [5.0, 1.0], [4.0, 3.0], [2.0, 3.0]])  # a trapezium, 4 and 2 wide and 2 high
    assert panel._area(loop) == 6 and panel._area(loop[::-1]) == -6
    assert panel._twice(loop, np.array([[0, 1, 2], [0, 3, 2]])).tolist() == [4 * 2, -2 * 2]


def test_a_side_has_a_node_for_each_size_and_one_at_least_a_hole_eight():
    loop = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 0.4]])
    first, short, last = panel._sides(loop, 1.0)
    assert first.tolist() == [[0, 0], [1, 0], [2, 0]] and short.tolist() == [[3, 0]] and last == pytest.approx(
        np.array([[3, 0.4], [2, 0.4 * 2 / 3], [1, 0.4 / 3]]))
    for size, count in ((1.0, 8), (0.5, 13), (0.7, 9)):  # 2 pi / 1, 2 pi / 0.5 and 2 pi / 0.7 are 6.3, 12.6 and 9.0
        angles = 2 * np.pi * np.arange(count) / count
        assert panel._rim(np.array([2.0, -1.0, 1.0]), size) == pytest.approx(np.array([2 + np.cos(angles), -1 + np.sin(angles)]).T)


def meeting(loop):
    """The first two sides with no end in common that meet: s (b - a) - t (d - c) = c - a with s and t from 0 to 1."""
    n = len(loop)
    sides = list(pairwise([*loop, loop[0]]))
    for i in range(n):
        for j in range(i + 2, n):
            if (i, j) != (0, n - 1):
                (a, b), (c, d) = sides[i], sides[j]
                s, t = np.linalg.solve(np.array([b - a, c - d]).T, c - a)
                if 0 <= s <= 1 and 0 <= t <= 1:
                    return i + 1, j + 1
    return None


def test_sides_that_meet_are_found_in_outlines_at_random():
    draw, kinds = np.random.default_rng(4), set()
    for _ in range(300):
        loop = draw.normal(size=(draw.integers(3, 7), 2))
        wanted = meeting(loop)
        kinds.add(wanted)
        if wanted is None:
            panel._check(loop, np.empty((0, 3)))
        else:
            with pytest.raises(InputError, match="body.outline: its sides {} and {} meet".format(*wanted)):
                panel._check(loop, np.empty((0, 3)))
    assert {None, (1, 3), (1, 5), (2, 4), (2, 6), (3, 5), (4, 6)} <= kinds


@pytest.mark.parametrize("loop, sides", [
    ([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]], (1, 3)), ([[0, 0], [4, 0], [4, 4], [2, 1], [0, 4]], None),
    ([[2, 0], [0, 4], [0, 0], [4, 0], [4, 4]], (1, 3)), ([[0, 0], [2, 2], [4, 0], [4, 4], [2, 2], [0, 4]], (1, 4)),
    ([[0, 0], [9, 0], [9, 4], [6, 4], [6, 1], [3, 1], [3, 4], [0, 4]], None),  # the ends of two arms, on one line, also when turned
    ([[0, 0], [9, 9], [5, 13], [2, 10], [5, 7], [2, 4], [-1, 7], [-4, 4]], None),
    ([[0, 0], [9, 0], [9, 4], [2, 4], [6, 1], [3, 1], [3, 4], [0, 4]], (3, 6)),
    ([[0, 0], [3, 0], [6, 0], [6, 1], [4, 0], [2, 0], [0, 1]], (1, 5))])
def test_a_corner_on_another_side_or_corner_meets_it(loop, sides):
    if sides is None:
        panel._check(np.array(loop, float), np.empty((0, 3)))
    else:
        with pytest.raises(InputError, match="its sides {} and {} meet".format(*sides)):
            panel._check(np.array(loop, float), np.empty((0, 3)))


@pytest.mark.parametrize("holes, words", [
    ([[2, 1, 1]], "holes[0]: does not lie within"), ([[2, 1, 0.999]], None), ([[5, 1, 0.5]], "holes[0]: does not lie within"),
    ([[1, 1, 0.5], [-9, 1, 1]], "holes[1]: does not lie within"),
    ([[1, 1, 0.5], [2, 1, 0.5]], "holes[1]: meets holes[0]"), ([[1, 1, 0.5], [2, 1, 0.499]], None),
    ([[0.5, 0.5, 0.25], [3, 1, 0.5], [3.25, 1.5, 0.25]], "holes[2]: meets holes[1]"), ([[3, 0.5, 0.25], [3, 1.375, 0.5]], None),
    ([[3, 0.5, 0.25], [3, 1.25, 0.5]], "holes[1]: meets holes[0]")])
def test_holes_lie_within_and_apart_and_touch_nothing(holes, words):
    """In a rectangle of 4 by 2."""
    arguments = np.array([[0, 0], [4, 0], [4, 2], [0, 2]], float), np.array(holes, float)
    if words is None:
        panel._check(*arguments)
    else:
        with pytest.raises(InputError, match=re.escape(words)):
            panel._check(*arguments)


def test_what_a_line_goes_round_also_at_the_height_of_its_corners():
    star = np.array([[0, 0], [6, 0], [6, 6], [4, 2], [3, 4], [2, 2], [0, 6]], float)
    p = np.array([(x, y) for x in np.arange(-0.4, 7) for y in (-1, 0.5, 2, 3, 4, 5.5, 6.5)])
    wanted = Path(star).contains_points(p)
    assert panel._inside(p, star).tolist() == wanted.tolist() == panel._inside(p, star[::-1]).tolist() and 8 < wanted.sum() < len(p) - 8
    box = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    assert panel._inside(np.array([[0, 0.5], [0.5, 0], [1, 0.5], [0.5, 1]]), box).tolist() == [True, True, False, False]


def test_the_distance_from_a_line_is_that_from_its_nearest_side():
    for p in np.random.default_rng(5).uniform(-1, 1, size=(20, 2)):
        assert panel._to_sides(p[None], ANGLE) == pytest.approx([distance(p, ANGLE)])


def test_triangles_without_area_and_those_of_holes_are_left_out():
    """Nodes along a straight side, one of them off by a rounding, and a square hole."""
    points = np.array([[0, 0], [1, 1e-14], [2, 0], [4, 0], [4, 4], [0, 4], [1, 1], [3, 1], [3, 3], [1, 3]])
    cells = panel._triangles(points, [points[:6], points[6:]])
    assert panel._twice(points, cells).sum() == pytest.approx(2 * (16 - 4)) and panel._twice(points, cells).min() > 0.1
    assert panel._twice(points, panel._triangles(points, [points[:6]])).sum() == pytest.approx(2 * 16)
    whole = np.array([[-1, -1], [5, -1], [5, 5], [-1, 5]], float)
    for height, count in ((0.5e-11, 4), (1e-11, 5)):  # of the first three nodes; times 2 it is below and above 1e-12 x 4^2
        points = np.array([[0, 0], [1, height], [2, 0], [4, 0], [4, 4], [0, 4]])
        assert len(panel._triangles(points, [whole])) == count


def test_limits_are_reached_before_they_are_passed(monkeypatch):
    mesh = build()
    worst = float(panel.quality(mesh.points[:, :2], mesh.cells[:len(mesh.cells) // 3, :3]).min())
    for name, last, step, words in (("MOST", len(mesh.points), -1, f"{len(mesh.points)} nodes; at most {len(mesh.points) - 1}"),
                                    ("LEAST", worst, np.nextafter(worst, 1) - worst, "cells of 0.04 m do not fit this outline")):
        with monkeypatch.context() as patch:
            patch.setattr(panel, name, last)
            assert np.array_equal(build().cells, mesh.cells)
            patch.setattr(panel, name, last + step)
            with pytest.raises(InputError, match=words):
                build()
    monkeypatch.setattr(panel, "MOST", 168)
    assert len(panel._lattice(ANGLE, HOLE[None], SIZE))
    monkeypatch.setattr(panel, "MOST", 167)
    with pytest.raises(InputError, match="body.cell_size: 168 nodes; at most 167"):
        panel._lattice(ANGLE, HOLE[None], SIZE)


def test_triangles_over_a_side_are_refused_however_good_they_are(monkeypatch):
    """Of a slot so narrow that nodes of one bank, which are not opposite to the other's, come between two of its neighbours."""
    monkeypatch.setattr(panel, "LEAST", 0.0)
    for width in (0.1, 1e-3):
        outline = [[0, 0], [1, 0], [1, 1], [0.5 + width, 1], [0.5 + width, 0.35], [0.5, 0.2], [0.5, 1], [0, 1]]
        if width == 0.1:
            assert len(build(outline=outline, holes=[], cell_size=0.1).cells)
        else:
            with pytest.raises(InputError, match="cells of 0.1 m do not fit this outline and these holes"):
                build(outline=outline, holes=[], cell_size=0.1)
