"""Rows of node numbers: against sets and sorted lists of Python."""

import numpy as np
import pytest

from physics.mesh.sound.rows import keyed, row_in, rows_in, unique_rows


@pytest.mark.parametrize(("k", "base"), [(1, 9), (2, 5), (4, 3), (4, 60_000), (9, 1000), (27, 40)])
def test_keys_are_equal_and_ordered_as_the_rows_are(k, base):
    """Also where the product of the numbers has no place in 64 bits: 60 000^4 is 0.7 2^64, 1000^9 and 40^27 are far beyond."""
    draw = np.random.default_rng(k)
    rows = draw.integers(0, base, (60, k))
    rows[20:40] = rows[:20]
    rows[40:50, :-1] = rows[:10, :-1]  # alike but for the last number
    rows[50:, 1:] = rows[:10, 1:]  # and but for the first
    rows[0, -1] = base - 1
    key = keyed(rows).tolist()
    assert sorted(range(60), key=key.__getitem__) == sorted(range(60), key=rows.tolist().__getitem__)
    assert [key.index(one) for one in key] == [rows.tolist().index(row) for row in rows.tolist()]
    assert unique_rows(rows).tolist() == sorted(map(list, {tuple(row) for row in rows.tolist()}))
    assert unique_rows(rows[:0]).shape == (0, k)


def test_rows_are_found_in_any_order_of_their_numbers():
    rng = np.random.default_rng(0)
    for k in (1, 2, 3, 4):
        rows, table = (np.stack([rng.permutation(6)[:k] for _ in range(n)]) for n in (40, 12))
        known = {frozenset(row) for row in table.tolist()}
        assert rows_in(rows, table).tolist() == [frozenset(row) in known for row in rows.tolist()]
    assert rows_in(rows, table[:0]).tolist() == [False] * 40 and rows_in(rows[:0], table).tolist() == []
    assert rows_in(np.array([[0, 3], [1, 0]]), np.array([[1, 0]])).tolist() == [False, True]  # 0 * base + 3 = 1 * base + 0 if base were 3


def test_rows_are_found_where_they_stand_in_a_table():
    table = np.array([[4, 7], [0, 3], [5, 6]])
    assert row_in(table, np.array([[5, 6], [0, 4], [4, 7], [0, 3], [9, 9], [5, 6]])).tolist() == [2, -1, 0, 1, -1, 2]
    assert row_in(table, np.empty((0, 2), int)).tolist() == [] and row_in(np.empty((0, 2), int), table).tolist() == [-1] * 3
