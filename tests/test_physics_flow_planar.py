"""Cholesky factors by cells of a plane mesh, against SciPy's sparse solver."""

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

from physics.flow.planar import NotPositive, Numbering
from physics.flow.space import FlowSpace
from tests.flows import rectangle


def assembled(cells, blocks, count):
    rows, columns = (np.broadcast_to(a, blocks.shape).ravel() for a in (cells[:, :, None], cells[:, None, :]))
    return scipy.sparse.csc_matrix((blocks.ravel(), (rows, columns)), (count, count))


@pytest.mark.parametrize("order", (2, 3))
@pytest.mark.parametrize("held_share", (0.0, 0.2, 1.0))
def test_a_factor_solves_what_scipy_solves(order, held_share):
    space = FlowSpace(rectangle(9, seed=3), order)
    nodes, random = space.velocity, np.random.default_rng(1)
    held = random.uniform(size=len(nodes.points)) < held_share
    blocks = 5 * space.mass + 0.1 * space.viscosity
    factor = Numbering(nodes.points[nodes.cells[:, :3]].mean(axis=1), nodes.cells, held).factor(blocks)
    free = ~held
    for shape in ((len(held), 2), (len(held),)):
        right = random.normal(size=shape)
        found = factor.solve(right)
        assert not found[held].any()
        if free.any():
            matrix = assembled(nodes.cells, blocks, len(held))[free][:, free]
            wanted = scipy.sparse.linalg.spsolve(matrix.tocsc(), right[free])
            np.testing.assert_allclose(found[free], wanted, rtol=0, atol=1e-11 * abs(wanted).max())


def test_a_factor_grows_no_faster_than_n_log_n():
    """George's count for a grid; in the order of a band it would be n^1.5, 4.0 / 1.4 times as much more from one mesh to the other."""
    shares = []
    for side in (8, 32):
        space = FlowSpace(rectangle(side), 2)
        count = len(space.velocity.points)
        numbering = Numbering(space.velocity.points[space.mesh.cells].mean(axis=1), space.velocity.cells, np.zeros(count, bool))
        assert sorted(numbering.order) == list(range(count))
        shares.append(numbering.numbers / (count * np.log2(count)))
    assert shares[1] < 1.4 * shares[0]


def test_a_matrix_that_is_not_positive_definite_has_no_factor():
    space = FlowSpace(rectangle(3), 2)
    numbering = Numbering(space.velocity.points[space.mesh.cells].mean(axis=1), space.velocity.cells, np.zeros(49, bool))
    with pytest.raises(NotPositive, match="49 unknowns is not positive definite"):
        numbering.factor(space.mass - space.viscosity)


def groups(sizes, axis=0, width=3):
    """Centres and nodes of cells in groups along a line, `width` nodes that all of a group have, and one that it shares with the next."""
    cells, free = [], iter(range(10**6))
    for size in sizes:
        common = [next(free) for _ in range(width)]
        cells += [[*common, next(free)] for _ in range(size)]
    last = 0
    for size in sizes[:-1]:  # the first cell of the next group has the last node of this one
        last += size
        cells[last][width] = cells[last - 1][width]
    centres = np.zeros((len(cells), 2))
    centres[:, axis] = np.arange(len(cells))
    nodes = np.unique(cells)
    return centres, np.searchsorted(nodes, cells).astype(np.int32), len(nodes)


def separators(centres, cells, count):
    """How many nodes each part has of its own, the whole last; the factor is right whatever they are."""
    numbering = Numbering(centres, cells, np.zeros(count, bool))
    blocks = np.broadcast_to(np.eye(cells.shape[1]) + 0.1, (len(cells), cells.shape[1], cells.shape[1])).copy()
    right = np.arange(count, dtype=float)
    wanted = np.linalg.solve(assembled(cells, blocks, count).toarray(), right)
    np.testing.assert_allclose(numbering.factor(blocks).solve(right), wanted, rtol=1e-9, atol=1e-9)
    return numbering._dissection.part["own"].tolist()


@pytest.mark.parametrize("sizes", [(25, 25), (21, 29), (29, 21)])
@pytest.mark.parametrize("axis", (0, 1))
def test_cells_are_halved_where_the_fewest_nodes_are_shared_in_the_middle_or_a_little_beside(sizes, axis):
    """At 21, 25 or 29 of 50 cells one node holds both groups together; anywhere else it would be the three of a group."""
    assert separators(*groups(sizes, axis))[-1] == 1
    assert separators(*groups((15, 35), axis))[-1] == 3


def test_of_two_directions_the_better_one_is_taken():
    """Side by side along the shorter extent lie two groups that share nothing, along the longer one their cells are mixed."""
    centres, cells, count = groups((10, 10))
    centres = np.stack([centres[:, 0] // 10, 3.0 * (centres[:, 0] % 10)], axis=1)
    assert separators(centres, cells, count)[-1] == 1


@pytest.mark.parametrize("cells, parts", [(6, 1), (7, 3), (12, 3), (13, 5), (14, 7)])
def test_six_cells_are_cut_no_further(cells, parts):
    assert len(separators(*groups((cells,)))) == parts


def test_a_factor_is_as_large_as_its_numbers():
    space = FlowSpace(rectangle(3), 2)
    numbering = Numbering(space.velocity.points[space.mesh.cells].mean(axis=1), space.velocity.cells, np.zeros(49, bool))
    assert 0 <= numbering.factor(space.mass + space.viscosity).bytes - 8 * numbering.numbers <= 64
