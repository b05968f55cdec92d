"""Nested dissection: its parts worked out by hand on a small grid, its factor against numpy's Cholesky of the same order."""

import numpy as np
import pytest

from physics.linalg.dissection import Panels
from physics.linalg.ordering.nested import LEAF, _cut, dissect, slots
from physics.mesh.build import build_mesh
from tests.scenes import beam


def bar(cells, size=(0.09, 0.02, 0.02), cell="hexahedron"):
    mesh = build_mesh(beam(body={"length": size[0], "width": size[1], "height": size[2], "cells": cells, "cell": cell}).body)
    return mesh.points, mesh.cells.astype(np.int32)


def layers(points, nodes):
    """Numbers of the layers of a bar of 8 cells that some nodes make up."""
    found = np.unique((points[nodes, 0] * 8 / 0.09).round().astype(int))
    assert len(nodes) == 9 * len(found)
    return found.tolist()


def test_a_bar_of_nine_layers_is_taken_apart_as_by_hand():
    """Layers 0 to 8 of 9 nodes, at most 20 uncut. The middle of 81, 40, is nearest to the change at 36: 0-3 | 4-8, and layer 4 separates.
    0-3: of 36 the middle, 18: 0 1 | 2 3, and 2 separates; 5-8: 5 6 | 7 8, and 7 separates. Unknowns are three times the nodes."""
    points, cells = bar([8, 2, 2])
    found = dissect(points, cells)
    assert LEAF == 20
    starts = found.part["first"]
    own = np.split(found.order, starts[1:])
    assert [layers(points, part) for part in own] == [[0, 1], [3], [2], [5, 6], [8], [7], [4]]
    assert found.parent.tolist() == [2, 2, 6, 5, 5, 6, -1]
    s, b = np.array([54, 27, 27, 54, 27, 27, 27]), np.array([27, 54, 27, 54, 27, 27, 0])
    assert found.part["own"].tolist() == s.tolist() and found.part["rest"].tolist() == b.tolist()
    boundary = np.split(found.boundary, found.part["boundary"][1:])
    assert [layers(points, found.order[each]) if len(each) else [] for each in boundary] == [[2], [2, 4], [4], [4, 7], [7], [4], []]
    assert found.numbers == (s * (s + b)).sum() == found.part[-1]["panel"] + 27 * 27
    assert found.operations == pytest.approx((s**3 / 3 + s**2 * b + s * b**2).sum(), rel=1e-12)
    assert [found.children[part[5]:part[6]].tolist() for part in found.part] == [[], [], [0, 1], [], [], [3, 4], [2, 5]]
    # Remainders of 27^2 or 54^2 on a stack; the most, when 3 is kept over 2 and 4 is made over it: 27^2 + 54^2 + 27^2.
    # Before: 27^2 + 54^2 for 0 and 1, and 27^2 made over both for 2.
    assert found.memory == 27**2 + 54**2 + 27**2 + 27**2
    assert sorted(found.place[found.order]) == list(range(81)) and (found.place[found.order] == np.arange(81)).all()
    where = []  # of each boundary in its part's parent: its own nodes, then its boundary's
    for t, each in enumerate(boundary[:-1]):
        parent = found.parent[t]
        theirs = [*range(starts[parent], starts[parent] + found.part[parent]["own"] // 3), *boundary[parent]]
        where += [theirs.index(node) for node in each]
    assert found.at.tolist() == where


@pytest.mark.parametrize("size, axis", [((0.02, 0.09, 0.02), 1), ((0.02, 0.03, 0.09), 2)])
def test_the_cut_is_across_the_longest_extent(size, axis):
    points, cells = bar([4, 4, 4], size)
    (one, two), separator = _cut(np.arange(len(points)), cells, points, np.zeros(len(points), np.int8))
    x = points[:, axis]
    assert np.ptp(x[separator]) < 1e-12 and len(separator) == 25 and x[one].max() < x[separator].min() < x[two].min()
    assert sorted([*one, *two, *separator]) == list(range(125))


def test_the_thinner_of_two_layers_separates_and_nodes_are_cut_between_layers():
    """Pairs of nodes on a line: one of the first half is tied to three of the other, so it alone separates; turned round, likewise."""
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    ties = np.array([[0, 1], [1, 3], [2, 3], [3, 4], [3, 5], [3, 6], [6, 7]], np.int32)
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    (one, two), separator = _cut(np.arange(8), ties, points, np.zeros(8, np.int8))
    assert (one.tolist(), two.tolist(), separator.tolist()) == ([0, 1, 2], [4, 5, 6, 7], [3])
    (one, two), separator = _cut(np.arange(8), 7 - ties, points, np.zeros(8, np.int8))
    assert (one.tolist(), two.tolist(), separator.tolist()) == ([0, 1, 2, 3], [5, 6, 7], [4])
    (one, two), separator = _cut(np.arange(8), ties[[0, 6]], points, np.zeros(8, np.int8))  # nothing crosses
    assert (one.tolist(), two.tolist(), separator.tolist()) == ([0, 1, 2, 3], [4, 5, 6, 7], [])
    # Layers at 3 | 5 of eight, between the quarters: the nearer to the middle, 5; a wobble of 1e-10 of the extent is none.
    for x, left in (([0, 0, 1, 1, 1, 2, 2, 2], 5), ([0, 0, 0, 1, 1, 1, 1, 2], 3), ([0, 0, 1, 1, 1 + 2e-10, 1, 2, 2], 6),
                    ([0, 0, 0, 1, 1, 2, 2, 2], 3)):
        points = np.stack([np.array(x, float), np.arange(8) / 100, np.zeros(8)], axis=1)
        (one, two), separator = _cut(np.arange(8), np.zeros((0, 2), np.int32), points, np.zeros(8, np.int8))
        assert len(separator) == 0 and len(one) == (4 if left == 6 else left)


def random_stiffness(points, cells, held):
    """(3 N, 3 N) positive definite, entries at the nodes of a cell alone, the identity at held unknowns."""
    rng, size = np.random.default_rng(0), 3 * len(points)
    K = np.zeros((size, size))
    for cell in cells:
        at = (3 * cell[:, None] + np.arange(3)).ravel()
        part = rng.normal(size=(len(at), len(at)))
        K[np.ix_(at, at)] += part @ part.T
    K += np.diag(rng.uniform(1, 5, size))
    K[held], K[:, held] = 0, 0
    K[held, held] = 1
    return K


@pytest.fixture(scope="module", params=["bar", "block"])
def case(request):
    """A factor, and numpy's of the same matrix in the order of elimination."""
    points, cells = bar([8, 2, 2]) if request.param == "bar" else bar([4, 3, 5], (0.04, 0.03, 0.05), "prism")
    found = dissect(points, cells)
    held = np.random.default_rng(1).choice(3 * len(points), 7, replace=False)
    K = random_stiffness(points, cells, held)
    at = (3 * found.order[:, None] + np.arange(3)).ravel()
    ordered = K[np.ix_(at, at)]
    panels = Panels(found)
    panels.values[:] = 0.0
    pairs = {(3 * p + i, 3 * q + k) for cell in found.place[cells] for p in cell for q in cell for i in range(3) for k in range(3)}
    rows, columns = np.array(sorted(pair for pair in pairs if pair[0] >= pair[1])).T
    place = slots(found, rows, columns)
    assert len(np.unique(place)) == len(place) and np.array_equal(slots(found, columns, rows), place)
    panels.values[place] = ordered[rows, columns]
    assert panels.factor()
    return found, panels, np.linalg.cholesky(ordered), place, rows, columns


def test_the_factor_is_that_of_numpy(case):
    found, panels, lower, place, rows, columns = case
    assert panels.values[place] == pytest.approx(lower[rows, columns], abs=1e-10 * abs(lower).max())
    # And so all of its panels, with what was filled in: own rows by columns, then those of the boundary.
    for s, b, panel, first, begin, *_ in found.part:
        own = 3 * first + np.arange(s)
        below = [*own, *(3 * found.boundary[begin:begin + b // 3][:, None] + np.arange(3)).ravel()]
        block = panels.values[panel:panel + s * (s + b)].reshape(s, s + b).T
        expected = lower[np.ix_(below, own)]
        keep = np.arange(s + b)[:, None] >= np.arange(s)
        assert block[keep] == pytest.approx(expected[keep], abs=1e-10 * abs(lower).max())
        rest = np.setdiff1d(np.arange(3 * first + s, len(lower)), below)
        assert not abs(lower[np.ix_(rest, own)]).max(initial=0) > 1e-12


@pytest.mark.parametrize("k", [1, 4])
def test_halves_of_a_solution_are_numpys(case, k):
    _, panels, lower, *_ = case
    right = np.random.default_rng(2).normal(size=(len(lower), k))
    x = right.copy()
    panels.forward(x.reshape(-1, 3, k))
    expected = np.linalg.solve(lower, right)
    assert x == pytest.approx(expected, abs=1e-9 * abs(expected).max())
    y = right[:, 0].copy()
    back = np.linalg.solve(lower.T, y)
    assert panels.backward(y) == pytest.approx(back, abs=1e-9 * abs(back).max())


def test_columns_reach_only_the_parts_above(case):
    """Of nodes of three parts, in no order, some of their unknowns held; rows are of these parts and of those that follow them."""
    found, panels, lower, *_ = case
    places = np.array([len(found.order) - 1, 2, int(found.part[2]["first"])])
    unknowns = 3 * places[:, None] + np.arange(3)
    free = np.ones((3, 3), bool)
    free[0, 1] = free[2, 2] = False
    inverse = np.linalg.inv(lower)
    for chosen in ([0, 1, 2], [1], [0], [2, 0]):
        rows, half = panels.columns(places[chosen], free[chosen])
        expected = inverse[:, unknowns[chosen].ravel()] * free[chosen].ravel()
        whole = np.zeros_like(expected)
        whole[rows] = half
        assert whole == pytest.approx(expected, abs=1e-9 * abs(inverse).max())
        reached = set()
        for place in places[chosen]:
            part = next(t for t, of in enumerate(found.part) if of["first"] <= place < of["first"] + of["own"] // 3)
            while part >= 0:
                reached.add(part)
                part = found.parent[part]
        expected = [3 * found.part[t]["first"] + i for t in sorted(reached) for i in range(found.part[t]["own"])]
        assert rows.tolist() == expected


def test_a_matrix_that_is_not_definite_has_no_factor():
    points, cells = bar([8, 2, 2])
    found = dissect(points, cells)
    for place in (0, 60, 3 * 81 - 1):  # in the first part, in a later one, and at the very end
        panels = Panels(found)
        panels.values[:] = 0.0
        at = np.arange(3 * 81)
        diagonal = slots(found, at, at)
        panels.values[diagonal] = 4.0
        assert panels.factor() and panels.values[diagonal] == pytest.approx(2.0)
        panels.values[:] = 0.0
        panels.values[diagonal] = 1.0
        panels.values[diagonal[place]] = -1.0
        assert not panels.factor()
    assert len(panels.values) == found.numbers + 1 and LEAF == 20
