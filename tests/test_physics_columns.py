"""Columns of the inverse factor: held against numpy's inverses, and which of them are computed, kept and forgotten."""

import numpy as np
import pytest

from physics.linalg.columns import Columns

NODES = 12


class Dense:
    """A lower triangular L of 3 x 12 unknowns; the columns of its inverse, from the first row that is not zero on."""

    def __init__(self):
        rng = np.random.default_rng(0)
        self.lower = np.tril(rng.normal(size=(3 * NODES, 3 * NODES))) + 5 * np.eye(3 * NODES)
        self.inverse = np.linalg.inv(self.lower)
        self.stiffness = self.lower @ self.lower.T
        self.asked = []

    def __call__(self, nodes):
        self.asked.append(nodes.tolist())
        columns = unknowns(nodes)
        return np.arange(columns.min(), 3 * NODES), self.inverse[columns.min():, columns]


def unknowns(nodes):
    return np.array([3 * node + i for node in nodes for i in range(3)])


def test_columns_are_those_asked_for_in_any_order():
    """One after the other, nodes come in below, between and above those that are known; the order asked in is the one answered in."""
    dense = Dense()
    columns, compliance = Columns(dense), np.linalg.inv(dense.stiffness)
    for nodes in ([7, 4], [4, 2, 9, 7], [9, 2], [11, 0, 4, 7]):
        found = columns.of(np.array(nodes))
        assert len(found) == 3 * len(nodes)
        half = np.zeros((3 * NODES, 3 * len(nodes)))
        half[columns.rows] = columns.half[:, found]
        assert half == pytest.approx(dense.inverse[:, unknowns(nodes)], abs=1e-13)
        assert columns.compliance[np.ix_(found, found)] == pytest.approx(compliance[np.ix_(unknowns(nodes), unknowns(nodes))], abs=1e-13)
    # Of each group only those that were not known yet; after all of that 6 nodes are known.
    assert dense.asked == [[7, 4], [2, 9], [11, 0]]
    assert [group.tolist() for group in columns.groups] == dense.asked
    assert len(columns.rows) == 36 and columns.half.shape == (36, 18) and columns.compliance.shape == (18, 18)


def test_nothing_is_known_after_clearing():
    dense = Dense()
    columns = Columns(dense)
    columns.of(np.array([3]))
    columns.clear()
    assert columns.groups == [] and columns.rows.size == columns.half.size == columns.compliance.size == 0
    columns.of(np.array([3]))
    assert dense.asked == [[3], [3]] and len(columns.rows) == 36 - 9


@pytest.mark.parametrize("known, forgotten", [(6, False), (7, True)])
def test_columns_are_forgotten_when_they_are_more_than_three_times_those_in_contact(known, forgotten):
    dense = Dense()
    columns = Columns(dense)
    columns.of(np.arange(known))
    columns.of(np.array([1]))  # all are known: nothing is forgotten, however few are asked for
    assert len(columns.groups) == 1
    found = columns.of(np.array([2, 10]))  # twice three is six
    assert dense.asked[1:] == ([[2, 10]] if forgotten else [[10]])
    assert found.tolist() == ([0, 1, 2, 3, 4, 5] if forgotten else [6, 7, 8, 18, 19, 20])
    assert columns.half.shape[1] == (6 if forgotten else 21)
