"""The channel whose triangles grow away from its hole, beside a plain version of Persson and Strang's springs, node by node."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.spatial import Delaunay

from physics.mesh.build import build_mesh
from physics.mesh.shapes import graded
from physics.scene import read_body
from physics.schema import InputError

LENGTH, HEIGHT, X, Y, RADIUS, COARSE, FINE = 0.7, 0.4, 0.25, 0.22, 0.06, 0.11, 0.04


def body(**changes):
    table = {"length": LENGTH, "height": HEIGHT, "hole_centre": [X, Y], "hole_radius": RADIUS, "cell_size": COARSE, "hole_cell_size": FINE}
    return read_body({"body": {"shape": "channel"} | table | changes})


def size_at(x, y):
    """h of the first lines of the module, a fifth of the way and two and a half cells to a gap; never nothing where hole and wall meet."""
    away, wall = max(np.hypot(x - X, y - Y) - RADIUS, 0), max(min(y, HEIGHT - y), 0)
    return min(COARSE, FINE + 0.2 * away, (away + wall) / 2.5 + 1e-9 * HEIGHT)


def shares(line):
    """Where a line of points is cut so that each part has as much of the integral of 1 / h, which is rounded."""
    lengths = [np.hypot(*np.subtract(b, a)) for a, b in pairwise(line)]
    passed = cumulative_trapezoid([1 / size_at(*p) for p in line], np.cumsum([0, *lengths]), initial=0)
    count = max(1, round(passed[-1]))
    return np.interp([passed[-1] * k / count for k in range(count + 1)], passed, np.linspace(0, 1, len(line)))


def boundary():
    angles = []
    for start in (0, np.pi):
        half = shares([(X + RADIUS * np.cos(start + a), Y + RADIUS * np.sin(start + a)) for a in np.pi * np.linspace(0, 1, 1001)])
        angles += [start + np.pi * share for share in half[:-1]]
    nodes = [(X + RADIUS * np.cos(a), Y + RADIUS * np.sin(a)) for a in angles]
    steps = np.linspace(0, 1, 2001)
    for y in (0, HEIGHT):
        nodes += [(share * LENGTH, y) for share in shares([(s * LENGTH, y) for s in steps])]
    for x in (0, LENGTH):
        nodes += [(x, share * HEIGHT) for share in shares([(x, s * HEIGHT) for s in steps])[1:-1]]
    return nodes, len(angles)


def halton(i, base):
    """The digits of i behind the point, backwards."""
    found, part = 0.0, 1 / base
    while i:
        i, digit = divmod(i, base)
        found, part = found + digit * part, part / base
    return found


def start(fixed):
    """As many nodes as equilateral triangles of the size have, less half of those on the boundary, where Halton's sequence puts them."""
    columns, rows = 8 * 14, 8 * 8  # 0.7 is 1.75 times 0.4
    cells = [((i + 0.5) / columns * LENGTH, (j + 0.5) / rows * HEIGHT) for i in range(columns) for j in range(rows)]
    sizes = [size_at(*p) for p in cells if np.hypot(p[0] - X, p[1] - Y) > RADIUS]
    wanted = round(sum(2 / 3**0.5 / h**2 for h in sizes) * LENGTH * HEIGHT / (columns * rows) - fixed / 2)
    found, i = [], 1
    while len(found) < wanted:
        x, y, chance = halton(i, 2) * LENGTH, halton(i, 3) * HEIGHT, halton(i, 5)
        h, i = size_at(x, y), i + 1
        if chance < (min(sizes) / h)**2 and min(x, y, LENGTH - x, HEIGHT - y, np.hypot(x - X, y - Y) - RADIUS) > h / 2:
            found.append((x, y))
    return found


def outside(points, rim):
    """Delaunay's triangles but those whose corners all lie on the hole."""
    return [tuple(cell) for cell in Delaunay(points).simplices.tolist() if max(cell) >= rim]


def test_each_node_is_where_a_plain_version_puts_it():
    """Persson and Strang's: springs want 1.2 times their size, a fifth of the force moves a node, new triangles after a tenth of h."""
    nodes, rim = boundary()
    count = len(nodes)
    points = np.array(nodes + start(count))
    old = np.full(points.shape, np.inf)
    for _ in range(60):
        h = [size_at(*p) for p in points]
        if any(np.hypot(*(p - q)) > 0.1 * each for p, q, each in zip(points, old, h, strict=True)):
            edges = sorted({tuple(sorted(pair)) for a, b, c in outside(points, rim) for pair in ((a, b), (b, c), (c, a))})
            old = points.copy()
        bars = [points[a] - points[b] for a, b in edges]
        long = [np.hypot(*bar) for bar in bars]
        want = [(h[a] + h[b]) / 2 for a, b in edges]
        scale = 1.2 * (sum(l**2 for l in long) / sum(w**2 for w in want))**0.5
        force = np.zeros(points.shape)
        for (a, b), bar, l, w in zip(edges, bars, long, want, strict=True):
            force[a] += max(scale * w - l, 0) * bar / l
            force[b] -= max(scale * w - l, 0) * bar / l
        for k in range(count, len(points)):  # back from the sides by 0.4 h and from the hole by 0.5 h
            x = np.clip(points[k] + 0.2 * force[k], 0.4 * h[k], [LENGTH - 0.4 * h[k], HEIGHT - 0.4 * h[k]])
            way = x - (X, Y)
            points[k] = (X, Y) + way * max(1, (RADIUS + 0.5 * h[k]) / np.hypot(*way))
    mesh = build_mesh(body())
    assert mesh.points == pytest.approx(np.pad(points, ((0, 0), (0, 1))), abs=1e-9)
    assert {tuple(sorted(cell)) for cell in mesh.cells.tolist()} == {tuple(sorted(cell)) for cell in outside(points, rim)}
    assert mesh.places["hole"].tolist() == list(range(rim))
    on = {"inlet": points[:, 0] == 0, "outlet": points[:, 0] == LENGTH, "walls": (points[:, 1] == 0) | (points[:, 1] == HEIGHT)}
    for name, those in on.items():
        assert mesh.places[name].tolist() == np.flatnonzero(those).tolist()
    for axis, end in (("x-min", "inlet"), ("x-max", "outlet")):
        assert mesh.places[axis].tolist() == mesh.places[end].tolist()
    assert sorted([*mesh.places["y-min"], *mesh.places["y-max"]]) == mesh.places["walls"].tolist()


def test_a_size_is_that_of_the_nearest_of_channel_hole_and_gap():
    """Also outside of the channel and inside of the hole, where distances count as none."""
    sizes = {"cell_size": 0.09, "hole_cell_size": 0.03}
    size = graded._size(body(hole_centre=[0.25, 0.07], **sizes))
    for x, y, wanted in ((0.6, 0.2, 0.09), (0.25, 0.23, 0.03 + 0.2 * 0.1), (0.25, 0.005, 0.01 / 2.5 + 4e-10),
                         (0.25, 0.01, 0.01 / 2.5 + 4e-10), (0.25, 0.02, 0.02 / 2.5 + 4e-10), (0.25, 0.13, 0.03), (0.6, -1.0, 0.09),
                         (0.25, 1.0, 0.09)):
        assert size(np.array([[x, y]])) == pytest.approx([wanted], rel=1e-9)
    size = graded._size(body(hole_centre=[0.25, 0.33], **sizes))
    assert size(np.array([[0.25, 0.395]])) == pytest.approx([0.005 / 2.5 + 4e-10 + 0.005 / 2.5])


def test_a_line_is_cut_into_parts_that_grow_as_the_size_does():
    """Of h = a + b x the integral of 1 / h is ln(1 + b x / a) / b, so the parts grow by one factor."""
    line = np.stack([np.linspace(0, 2, 4001), 0 * np.linspace(0, 2, 4001)], axis=1)
    found = 2 * graded._spaced(lambda x: 0.1 + 0.3 * x[:, 0], line)
    count = round(np.log(7) / 0.3)
    assert count == 6 and found == pytest.approx(0.1 / 0.3 * (7 ** (np.arange(7) / 6) - 1), abs=1e-6)
    assert graded._spaced(lambda x: np.full(len(x), 5.0), line).tolist() == [0, 1]
    assert graded._spaced(lambda x: np.full(len(x), 0.7), line) == pytest.approx(np.arange(4) / 3)


def test_a_hole_has_eight_nodes_at_least():
    """Four in each half, in even parts; where the size says four or more it is the size that places them."""
    centre = np.array([1.0, 2.0])
    for h in (9.0, np.pi / 3, np.pi / 4):
        assert graded._rim(lambda x, h=h: np.full(len(x), h), centre, 1.0) == pytest.approx(np.pi * np.arange(8) / 4)
    four = graded._rim(lambda x: np.pi / 4 * (1 + 0.1 * x[:, 0]) * 0.92, centre, 1.0)
    assert len(four) == 8 and np.diff(four[:5]).max() > 1.1 * np.diff(four[:5]).min() and four[[0, 4]].tolist() == [0, np.pi]


def test_as_many_nodes_as_there_may_be_are_made_and_one_more_is_not(monkeypatch):
    arguments = graded._size(body()), np.array([LENGTH, HEIGHT]), np.array([X, Y]), RADIUS
    wanted = len(graded._inside(*arguments, 40))
    monkeypatch.setattr(graded, "MOST", wanted + 40)
    assert len(graded._inside(*arguments, 40)) == wanted and len(graded._inside(*arguments, 38)) == wanted + 1
    monkeypatch.setattr(graded, "MOST", wanted + 39)
    with pytest.raises(InputError, match=f"body.cell_size: {wanted + 40} nodes; at most {wanted + 39}"):
        graded._inside(*arguments, 40)
    monkeypatch.setattr(graded, "MOST", 10_001)
    assert len(graded._inside(*arguments, 10_000)) == 1  # one at least


def test_cells_of_too_bad_a_shape_are_refused_and_those_of_the_least_are_not(monkeypatch):
    """The quality of a triangle is 2 r / R: of sides 3, 4, 5 it is 2 x 1 / 2.5, of 1, 1, sqrt 2 it is 2 (sqrt 2 - 1)."""
    points = np.array([[0, 0], [4, 0], [0, 3], [0, 4], [2, 12**0.5]])
    assert graded.quality(points, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])) == pytest.approx([0.8, 2 * (2**0.5 - 1), 1])
    mesh = build_mesh(body())
    worst = float(graded.quality(mesh.points[:, :2], mesh.cells).min())
    monkeypatch.setattr(graded, "LEAST", worst)
    assert np.array_equal(build_mesh(body()).cells, mesh.cells)
    monkeypatch.setattr(graded, "LEAST", np.nextafter(worst, 1))
    with pytest.raises(InputError, match="body.hole_cell_size = 0.04: leads to cells that are too flat"):
        build_mesh(body())


def test_triangles_without_area_and_those_within_the_hole_are_left_out():
    """Twice the area of a sliver under a millionth of a millionth of the radius squared; corners on the rim up to a billionth of it."""
    for height, count in ((0.4e-6, 2), (0.6e-6, 3)):  # of the first three nodes; times 2 it is below and above 1e-12 x 1000^2
        points = np.array([[0, 0], [1, height], [2, 0], [0, 2]])
        cells = graded._triangles(points, np.array([1e4, 0.0]), 1e3)
        assert len(cells) == count
        assert graded._triangles(points, np.array([1e4, 0.0]), 0.0).shape == (3, 3)
    around = np.stack([np.cos(np.arange(4) * np.pi / 2), np.sin(np.arange(4) * np.pi / 2)], axis=1)
    for off, count in ((0.5e-9, 0), (2e-9, 1)):
        assert len(graded._triangles(7 + 5 * around * (1 + off * np.array([[1], [0], [0], [0]])), np.array([7.0, 7.0]), 5.0)) == count
