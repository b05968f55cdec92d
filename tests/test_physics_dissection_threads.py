"""A dissected factor shared by threads: tasks worked out by hand, the bits of one thread, SciPy's solution, and no factor where none is."""

import numpy as np
import pytest
import scipy.linalg

from physics.linalg import dissection
from physics.linalg.dissection import Panels, shared
from physics.linalg.ordering.nested import dissect, slots
from tests.test_physics_dissection import bar, random_stiffness


def tasks(found, threads):
    return [tuple(int(row[name]) for name in ("first", "last", "waits", "next", "work")) for row in shared(found, threads).task]


def test_a_bar_of_seven_parts_is_shared_as_by_hand(monkeypatch):
    """Parts of s = 54 27 27 54 27 27 27 and b = 27 54 27 54 27 27 0 take s^3/3 + s^2 b + s b^2 operations, 807003 with all below the last.
    At most a third of them, 269001, go to a thread at once: parts 2, 3, 5 and 6 have more below them, so every part is a task."""
    found = dissect(*bar([8, 2, 2]))
    assert tasks(found, 1) == [(0, 7, 0, -1, 0)] and shared(found, 1).memory == found.memory
    assert tasks(found, 2) == [(0, 1, 0, 2, 170586), (1, 2, 0, 2, 124659), (2, 3, 2, 6, 341172), (3, 4, 0, 5, 367416),
                               (4, 5, 0, 5, 45927), (5, 6, 2, 6, 459270), (6, 7, 2, -1, 807003)]
    apart = shared(found, 2)
    sizes = np.array([27, 54, 27, 54, 27, 27, 0]) ** 2  # of what each leaves behind: all at once
    assert apart.memory == sizes.sum() and apart.part["made"].tolist() == apart.part["kept"].tolist() == [0, *np.cumsum(sizes)[:-1]]
    # At most five sixths: each half is one task, on a stack of its own as in one thread, 27^2 + 54^2 + 27^2; the last part stands above.
    monkeypatch.setattr(dissection, "PIECES", 0.6)
    apart, stack = shared(found, 2), 27**2 + 54**2 + 27**2
    assert tasks(found, 2) == [(0, 3, 0, 2, 341172), (3, 6, 0, 2, 459270), (6, 7, 2, -1, 807003)] and apart.memory == 2 * stack
    assert apart.part["made"].tolist() == [0, 27**2, stack - 27**2, stack, stack + 54**2, stack + 54**2 + 27**2, 2 * stack]
    assert apart.part["kept"].tolist() == [0, 27**2, 0, stack, stack + 54**2, stack, 2 * stack]


@pytest.fixture(scope="module", params=[([8, 2, 2], (0.09, 0.02, 0.02)), ([12, 6, 5], (0.06, 0.03, 0.025))], ids=["bar", "block"])
def case(request):
    """The dissection of a body, a matrix in its order, and its entries in the panels."""
    points, cells = bar(*request.param)
    found = dissect(points, cells)
    at = (3 * found.order[:, None] + np.arange(3)).ravel()
    ordered = random_stiffness(points, cells, [5, 40])[np.ix_(at, at)]
    rows, columns = np.nonzero(np.tril(ordered))
    return found, ordered, slots(found, rows, columns), ordered[rows, columns]


@pytest.mark.parametrize("threads", [2, 3, 5])
def test_every_number_of_threads_gives_the_bits_of_one_and_scipys_solution(case, threads):
    found, ordered, place, entries = case
    right = np.random.default_rng(0).normal(size=len(ordered))
    expected = scipy.linalg.solve(ordered, right, assume_a="pos")
    kept = []
    for panels in (Panels(found), Panels(found, threads)):
        assert len(panels._shares.blas) == (threads if kept else 1)
        for _ in range(20 if kept else 1):  # in whatever order the threads come by
            panels.values[:] = 0.0
            panels.values[place] = entries
            assert panels.factor()
            y = right.copy()
            panels.forward(y.reshape(-1, 3, 1))
            x = panels.backward(y.copy())
            kept.append((panels.values[:-1].tobytes(), y.tobytes(), x.tobytes()))
        assert x == pytest.approx(expected, abs=1e-9 * abs(expected).max())
    assert all(each == kept[0] for each in kept[1:])


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("wrong", [-1.0, np.nan, np.inf])
def test_a_matrix_that_is_not_definite_has_no_factor_on_any_number_of_threads(threads, wrong):
    found = dissect(*bar([8, 2, 2]))
    panels, at = Panels(found, threads), np.arange(3 * 81)
    diagonal = slots(found, at, at)
    for place in (0, 60, 130, 3 * 81 - 1):  # in either half, where both meet, at the very end
        for bad in (True, False):
            panels.values[:] = 0.0
            panels.values[diagonal] = 4.0
            if bad:
                panels.values[diagonal[place]] = wrong
            assert panels.factor() is not bad


def test_a_number_that_is_none_beside_the_diagonal_leaves_no_factor():
    """LAPACK passes it on; it gets to the diagonal of its row."""
    found = dissect(*bar([8, 2, 2]))
    for threads in (1, 2):
        panels, at = Panels(found, threads), np.arange(3 * 81)
        for wrong, good in ((np.nan, False), (np.inf, False), (0.5, True)):
            panels.values[:] = 0.0
            panels.values[slots(found, at, at)] = 4.0
            panels.values[slots(found, np.array([3 * 81 - 2]), np.array([3 * 81 - 5]))] = wrong
            assert panels.factor() is good
