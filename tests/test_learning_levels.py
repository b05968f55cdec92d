"""Bi-stride levels: who is kept, who is joined, what is handed on."""

import numpy as np
import pytest

from learning.graphs.levels import hierarchy, lifted
from learning.segments.clusters import ranks


def both(*edges):
    pairs = np.array(sorted({pair for a, b in edges for pair in ((a, b), (b, a))}, key=lambda pair: pair[::-1])).T
    return pairs.reshape(2, -1).astype(np.int64)


def line(count, first=0):
    return [(first + i, first + i + 1) for i in range(count - 1)]


def levels_of(pair, points, count=1):
    points = np.asarray(points, float)
    return hierarchy(pair, points, ranks(points), count)


def test_a_line_of_seven_keeps_every_other_node_and_joins_them():
    """From the middle, 3, hops are 3 2 1 0 1 2 3: three even ones, four odd ones."""
    pair, points = both(*line(7)), [[i, 0, 0] for i in range(7)]
    first, second = levels_of(pair, points, 2)
    assert len(first.kept) == 3 and first.pair.tolist() == both((0, 1), (1, 2)).tolist()
    assert first.kept.tolist() == [1, 3, 5] and first.give.tolist() == [[0, 2, 2, 4, 4, 6], [0, 0, 1, 1, 2, 2]]
    # the next level's hops from its middle are 1 0 1: one even one, two odd ones
    assert second.kept.tolist() == [1] and second.pair.shape == (2, 0)


def test_what_is_pooled_is_a_weighted_mean_of_the_neighbours():
    """Node 1 hears 0, of one neighbour, and 2, of two: weights 1 and 1/2. On the next level w is 3/2, 1, 3/2 and degrees 1, 2, 1."""
    pair, points = both(*line(7)), [[i, 0, 0] for i in range(7)]
    first, second = levels_of(pair, points, 2)
    assert first.weight == pytest.approx([2 / 3, 1 / 3, 1 / 2, 1 / 2, 1 / 3, 2 / 3])
    assert second.give.tolist() == [[0, 2], [0, 0]] and second.weight == pytest.approx([1 / 2, 1 / 2])
    # a tie of the other kind: a star whose arms differ; w of the hub's neighbours is 1 each
    star = levels_of(both((0, 1), (0, 2), (0, 3)), [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0]])[0]
    assert len(star.kept) == 1 and star.give.tolist() == [[1, 2, 3], [0, 0, 0]] and star.weight == pytest.approx([1 / 3] * 3)


def test_weights_go_on_from_level_to_level():
    """w of a kept node is what its neighbours gave: here 1 + 1/2 = 3/2, and 1/2 + 1/2 = 1, which the next level divides by degrees."""
    pair, points = both(*line(15)), [[i, 0, 0] for i in range(15)]
    first, second, _ = levels_of(pair, points, 3)
    assert first.kept.tolist() == [1, 3, 5, 7, 9, 11, 13] and second.kept.tolist() == [1, 3, 5]
    # second level, kept node 1 of the first: neighbours 0 (w 3/2, degree 1) and 2 (w 1, degree 2)
    entries = {(int(a), int(b)): float(weight) for (a, b), weight in zip(second.give.T, second.weight, strict=True)}
    assert entries[0, 0] == pytest.approx(1.5 / (1.5 + 0.5)) and entries[2, 0] == pytest.approx(0.5 / 2)


def test_every_part_is_pooled_on_its_own_and_a_lone_node_stays_as_it_is():
    pair = both(*line(3), *line(5, first=3))
    points = [[i, 0, 0] for i in range(3)] + [[i, 9, 0] for i in range(5)] + [[0, 0, 7]]
    first, second = levels_of(pair, points, 2)
    # 0 1 2 keeps its middle; 3 .. 7 has hops 2 1 0 1 2 and keeps its two odd ones; 8 is alone
    assert first.kept.tolist() == [1, 4, 6, 8] and first.pair.tolist() == both((1, 2)).tolist()
    assert first.give.T.tolist()[-1] == [8, 3] and first.weight[-1] == 1
    assert len(second.kept) == 3 and second.pair.shape == (2, 0)
    for level in (first, second):
        total = np.bincount(level.give[1], weights=level.weight)
        assert total == pytest.approx(np.ones(len(total)))  # a mean


def test_a_tie_of_even_and_odd_keeps_the_even_ones():
    # 0 - 1 - 2 - 3, the middle is 1 or 2, both as near: the first along x; hops from 1 are 1 0 1 2
    level = levels_of(both(*line(4)), [[i, 0, 0] for i in range(4)])[0]
    assert level.kept.tolist() == [1, 3] and level.give.tolist() == [[0, 2, 2], [0, 0, 1]]


def test_numbers_of_nodes_have_no_say():
    generator = np.random.default_rng(0)
    points = generator.normal(size=(40, 3))
    near = np.linalg.norm(points[:, None] - points, axis=2) < 0.9
    edges = [(i, j) for i, j in zip(*np.nonzero(np.triu(near, 1)), strict=True)]
    order = generator.permutation(40)
    place = np.argsort(order)
    plain = levels_of(both(*edges), points, 3)
    other = levels_of(both(*[(place[i], place[j]) for i, j in edges]), points[order], 3)
    ours, theirs = np.arange(40), order  # the original number of each node of a level
    for a, b in zip(plain, other, strict=True):
        of_a, of_b = ({(int(names[i]), float(round(w, 5))) for i, w in zip(level.give[0], level.weight, strict=True)}
                      for level, names in ((a, ours), (b, theirs)))
        assert of_a == of_b
        ours, theirs = ours[a.kept], theirs[b.kept]
        assert {(int(ours[s]), int(ours[r])) for s, r in a.pair.T} == {(int(theirs[s]), int(theirs[r])) for s, r in b.pair.T}


def test_contact_is_felt_where_a_neighbour_feels_it():
    """Two lines of five, 0 .. 4 and 5 .. 9, of which 0 and 9 touch. Kept are 1, 3 and 6, 8: of them 1 and 8 feel it, by 0 and 9."""
    pair = both(*line(5), *line(5, first=5))
    points = [[i, 0, 0] for i in range(5)] + [[-5 + i, 1, 0] for i in range(5)]
    levels = levels_of(pair, points, 2)
    contact = both((0, 9))
    first, second = lifted(contact, 10, levels)
    assert first.tolist() == both((0, 3)).tolist()
    # next, of 0 - 1 the even one next to the middle along x is kept, and of 2 - 3: 0 feels it itself, 2 by its neighbour 3
    assert second.tolist() == both((0, 1)).tolist()
    none = lifted(np.empty((2, 0), np.int64), 10, levels)
    assert [each.shape for each in none] == [(2, 0), (2, 0)]
