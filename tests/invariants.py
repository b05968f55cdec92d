"""What holds for any body, whatever its cells, element and law."""

import numpy as np
import pytest

from physics.body.supports import nodal_areas
from physics.mesh.cell import CELLS
from physics.mesh.quality import det_f, smallest_det_f


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


def assert_det_f_sees_a_fold(mesh, gradient):
    """A cell of second order whose first middle node moves along its side: past the quarter point the map folds at the corner it nears."""
    cell, u = CELLS[mesh.cell], np.zeros_like(mesh.points)
    middle = mesh.cells[0, cell.corners]
    a, b = (mesh.points[mesh.cells[0, i]] for i in cell.middles[0])
    u[middle] = 0.3 * (b - a)
    assert smallest_det_f(mesh.points, u, mesh.cells, mesh.cell) < 0
    u[middle] = 0.2 * (b - a)
    assert 0 < smallest_det_f(mesh.points, u, mesh.cells, mesh.cell) < 1
    affine = det_f(mesh.points, mesh.points @ gradient.T, mesh.cells, mesh.cell)
    assert affine == pytest.approx(np.linalg.det(np.eye(3) + gradient), rel=1e-12)


def assert_swings_with_period(solution, place, traction, period, *, within):
    """Two periods of fifty steps each under a sudden traction [Pa] along an axis: as 1 - cos, its energy the work of the load."""
    end = (solution.displacement[:, solution.mesh.place(place)] @ np.abs(traction)).mean(axis=1)
    at = np.linspace(0, 2 * period, 101)

    def left(share):
        both = np.column_stack([np.ones_like(at), np.cos(2 * np.pi * share / period * at)])
        return np.linalg.norm(end - both @ np.linalg.lstsq(both, end, rcond=None)[0])

    assert min(np.linspace(0.95, 1.05, 401), key=left) == pytest.approx(1.0, abs=within)  # the mass is lumped
    work = (solution.displacement * (nodal_areas(solution.mesh, place)[:, None] * traction)).sum(axis=(1, 2))
    assert abs(solution.energy + solution.kinetic_energy - work).max() < 1e-4 * solution.energy.max()
