"""Factors of plane bodies and of bodies of second order: against the dense matrix, and what counts as neighbours in their numbering."""

import ctypes

import numpy as np
import pytest
from scipy.linalg import lapack

from physics.equilibrium.balance import Balance
from physics.linalg import cholesky
from physics.linalg.cholesky import BandFactor, DissectionFactor, NotPositiveDefinite, narrowest_order
from physics.linalg.native import pointer
from physics.mesh.build import build_mesh
from physics.scene import read_scene
from tests import dense


def elasticity(**body):
    solid = "height" in body
    return Balance(scene := read_scene({
        "body": {"length": 0.06, "width": 0.02} | body, "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 1},
        "support": [{"where": "x-min", "fixed": "xyz" if solid else "xy"}, {"where": "x-max", "fixed": "y"}],
        "load": [{"acceleration": [0, 1.0, 0]}]}), build_mesh(scene.body)).elasticity


def plate(cell):
    return elasticity(shape="plate", cells=[4, 2], cell=cell)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_plane_body_moves_in_its_plane_as_numpy_says(cell):
    body = plate(cell)
    found = BandFactor(body, *narrowest_order(body))
    rng = np.random.default_rng(0)
    u = np.where(body.fixed, 0, rng.uniform(-2e-4, 2e-4, body.fixed.shape)) * [1, 1, 0]
    found.update(u)
    force, nodes = rng.normal(size=u.shape), np.array([9, 3, 0, 14])
    expected = dense.solved(body, u, force)
    size = abs(expected).max()
    assert not expected[:, 2].any() and found.solve(force) == pytest.approx(expected, abs=1e-9 * size)
    unknown = (3 * nodes[:, None] + np.arange(3)).ravel()
    free = ~body.fixed.ravel()[unknown]
    compliance = np.linalg.inv(dense.stiffness(body, u))[np.ix_(unknown, unknown)] * np.outer(free, free)
    assert found.compliance(nodes).shape == (12, 12) and not found.compliance(nodes)[2::3].any()
    assert found.compliance(nodes) == pytest.approx(compliance, abs=1e-9 * abs(compliance).max())
    push = rng.normal(size=(4, 3))
    both = force.copy()
    both[nodes] += push
    begun = found.begin(force)
    assert found.at(begun, nodes) == pytest.approx(expected[nodes], abs=1e-9 * size)
    assert found.finish(begun, nodes, push) == pytest.approx(dense.solved(body, u, both), abs=1e-9 * size)
    assert found.band == 2 * max(np.ptp(found._unknown[cell, 0] // 2) for cell in body.cells) + 1
    with pytest.raises(NotPositiveDefinite, match="not positive definite"):
        found.update(-1.7 * body.mesh.points * [0, 1, 0])


@pytest.mark.parametrize("body, same_cell", [
    ({"cells": [2, 1, 1], "cell": "hexahedron", "height": 0.02}, False), ({"cells": [2, 1, 1], "cell": "prism", "height": 0.02}, False),
    ({"cells": [2, 1, 1], "cell": "hexahedron", "height": 0.02, "order": 2}, True),
    ({"cells": [1, 1, 1], "cell": "tetrahedron", "height": 0.02, "order": 2}, True)])
def test_neighbours_are_the_ends_of_edges_and_in_cells_of_second_order_all_nodes_of_a_cell(body, same_cell):
    body = elasticity(**body)
    n = len(body.mesh.points)
    found = {(i, j) for i, j in zip(*cholesky._graph(body).nonzero(), strict=True) if i != j}
    pairs = [(i, j) for cell in body.mesh.cells.tolist() for i in cell for j in cell] if same_cell else body.mesh.edges.tolist()
    assert found == {(i, j) for i, j in pairs if i != j} | {(j, i) for i, j in pairs if i != j} and cholesky._graph(body).shape == (n, n)
    place, band = narrowest_order(body)
    assert sorted(place) == list(range(n)) and band == 3 * max(np.ptp(place[cell]) for cell in body.cells) + 2


def test_of_bodies_of_second_order_both_factors_solve_what_numpy_does():
    body = elasticity(cells=[3, 1, 1], cell="tetrahedron", height=0.02, order=2)
    u = np.where(body.fixed, 0, np.random.default_rng(1).uniform(-1e-5, 1e-5, body.fixed.shape))
    force = np.random.default_rng(2).normal(size=u.shape)
    expected = dense.solved(body, u, force)
    for found in (BandFactor(body, *narrowest_order(body)), DissectionFactor(body)):
        found.update(u)
        assert found.solve(force) == pytest.approx(expected, abs=1e-9 * abs(expected).max())


@pytest.mark.parametrize("size, band, rights", [(100, 30, 3), (64, 8, 1), (61, 13, 2), (40, 7, 2), (12, 11, 2), (1, 0, 1)])
def test_a_banded_factor_is_solved_with_as_lapack_does(size, band, rights):
    """Wide and narrow bands, whole blocks of columns and some over; what stands beyond the last row is not looked at."""
    rng = np.random.default_rng(size)
    stored = rng.uniform(-0.1, 0.1, (size, band + 1))  # column after column of the lower band
    stored[:, 0] = rng.uniform(1, 2, size)
    force = rng.normal(size=(rights, size))
    for solve, trans in ((cholesky._library().forward, "N"), (cholesky._library().backward, "T")):
        expected = lapack.dtbtrs(stored.T, force.T, uplo="L", trans=trans)[0].T
        found = force.copy()
        solve(*map(ctypes.c_int64, (size, band)), pointer(stored), ctypes.c_int64(rights), pointer(found))
        assert found == pytest.approx(expected, rel=0, abs=1e-13 * abs(expected).max())
