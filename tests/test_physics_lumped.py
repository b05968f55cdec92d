"""Masses of nodes by hand, and a body's stiffness with shares of its nodes on the diagonal, as full matrices."""

from dataclasses import replace

import numpy as np
import pytest

from physics.body.elasticity import Elasticity
from physics.body.lumped import Lumped, node_masses
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.mesh.second import second_order
from physics.scene import Body, Material, Where
from tests import dense

RUBBER = Material(young_modulus=1e3, poisson_ratio=0.3, density=700.0)
# Two tetrahedra of 2 and 4 m3 on a common face of 0, 1, 2.
POINTS = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 1], [0, 0, -2]])
PAIR = Mesh(POINTS, np.array([[0, 1, 2, 3], [0, 2, 1, 4]]), "tetrahedron", {})


def body(mesh, material=RUBBER, fixed=()):
    return Elasticity(mesh, material, np.isin(np.arange(mesh.points.size), fixed).reshape(-1, 3))


def test_a_quarter_of_a_tetrahedron_goes_to_each_corner():
    assert node_masses(body(PAIR))[:, 0] == pytest.approx(700 * np.array([1.5, 1.5, 1.5, 0.5, 1.0]))


@pytest.mark.parametrize("densities", [(700.0, 700.0), (700.0, 100.0)])
def test_of_second_order_a_corner_has_a_thirty_sixth_and_a_middle_four_twenty_sevenths(densities):
    """4 / 36 + 6 x 4 / 27 is one; the lower cell may be of another material."""
    mesh = second_order(PAIR)
    below = replace(RUBBER, density=densities[1], where=Where(box=((-9.0, -9.0, -9.0), (9.0, 9.0, 0.0))))
    found = node_masses(body(mesh, RUBBER if densities[0] == densities[1] else (RUBBER, below)))
    expected = np.zeros(len(mesh.points))
    for cell, mass in zip(mesh.cells, np.array([2.0, 4.0]) * densities, strict=True):
        for k, node in enumerate(cell):
            expected[node] += mass * (1 / 36 if k < 4 else 4 / 27)
    assert found == pytest.approx(expected[:, None]) and found.sum() == pytest.approx(2 * densities[0] + 4 * densities[1])
    assert np.array_equal(mesh.points[mesh.cells[:, :4]], POINTS[PAIR.cells])  # corners first


def test_shares_stand_on_the_diagonal_of_the_scaled_stiffness():
    """s K + c diag(m) of free components; held ones are the identity's. No two shares are alike."""
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(2, 1, 1), cell="prism"))
    one = body(mesh, fixed=(0, 4, 8, 10))
    u = 1e-2 * np.random.default_rng(0).normal(size=mesh.points.shape) * ~one.fixed
    share = np.arange(1.0, 1 + mesh.cells.size).reshape(mesh.cells.shape)
    lumped = Lumped(one, share, scale=0.25)
    plain = dense.stiffness(lumped, u)
    mass = np.zeros(len(mesh.points))
    for cell, own in zip(mesh.cells, share, strict=True):
        mass[cell] += own
    free = np.flatnonzero(~one.fixed.ravel())
    K = dense.stiffness(one, u)
    assert lumped.added == 0 and plain[np.ix_(free, free)] == pytest.approx(0.25 * K[np.ix_(free, free)])
    lumped.added = 30.0
    expected = 0.25 * K + 30 * np.diag(np.repeat(mass, 3))
    expected[~np.isin(np.arange(len(K)), free)] = 0
    expected[:, one.fixed.ravel()] = 0
    np.fill_diagonal(expected, np.where(one.fixed.ravel(), 1.0, expected.diagonal()))
    assert dense.stiffness(lumped, u) == pytest.approx(expected) and Lumped(one, share).scale == 1
    assert lumped.energy(u) == one.energy(u) and np.array_equal(lumped.force(u), one.force(u)) and lumped.space is one.space
    assert (lumped.mesh, lumped.material, lumped.fixed, lumped.cells) == (one.mesh, one.material, one.fixed, one.cells)
    for mine, others in zip(lumped.pairs(np.arange(18)), one.pairs(np.arange(18)), strict=True):
        assert np.array_equal(mine, others)
