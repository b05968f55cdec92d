"""What holds for the energy of any body, whatever its cells, element and law."""

import numpy as np
import pytest


def assert_rigid_motion_stores_nothing(elasticity, scale, length):
    """scale: E V [J]; length: the smallest of the body's cells [m]."""
    points = elasticity.mesh.points
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    u = points @ turn.T + [0.1, 0.2, 0.3] - points
    assert abs(elasticity.energy(u)) < 1e-12 * scale  # rounding of a sum over cells of terms of the size of E V
    assert abs(elasticity.force(u)).max() < 1e-12 * scale / length


def assert_forces_and_stiffness_are_derivatives(elasticity):
    rng = np.random.default_rng(2)
    u, v = rng.uniform(-0.01, 0.01, (2, *elasticity.mesh.points.shape))
    step = 1e-4  # central differences: error of order step^2 = 1e-8, rounding 1e-16 / 1e-4 = 1e-12
    slope = (elasticity.energy(u + step * v) - elasticity.energy(u - step * v)) / (2 * step)
    assert slope == pytest.approx((elasticity.force(u) * v).sum(), rel=1e-6)
    change = (elasticity.force(u + step * v) - elasticity.force(u - step * v)) / (2 * step)
    stiffness = elasticity.stiffness(u)
    right, left = stiffness.createVecs()
    right.array[:] = elasticity.space.to_dofs(v)
    stiffness.mult(right, left)
    assert np.linalg.norm(elasticity.space.from_dofs(left.array) - change) < 1e-6 * np.linalg.norm(change)
    assert stiffness.isSymmetric(1e-12 * stiffness.norm())
