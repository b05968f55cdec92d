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
