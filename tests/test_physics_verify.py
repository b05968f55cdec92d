"""A prediction held against FE: the truth scores nothing, every kind of error is caught by the figure made for it."""

import numpy as np
import pytest

from physics.equilibrium import TOLERANCE, solve
from physics.verify import verify
from tests.scenes import pressed


@pytest.fixture(scope="module")
def case():
    scene = pressed()
    solution = solve(scene)
    free = np.ones(len(solution.mesh.points), bool)
    free[solution.mesh.places["x-min"]] = False
    return scene, solution, free


def check(case, prediction):
    scene, solution, free = case
    return verify(prediction, solution.displacement, scene=scene, mesh=solution.mesh, free=free)


def test_the_truth_scores_nothing(case):
    fidelity = check(case, case[1].displacement)
    assert fidelity.rmse_1 == fidelity.rmse_50 == fidelity.rmse_all == fidelity.gf_h == fidelity.gf_c == 0
    assert fidelity.mc == fidelity.ar == fidelity.inverted_elements == 0
    assert fidelity.relative_residual < 2 * TOLERANCE  # the checker finds other contact forces, never worse ones than twice
    assert fidelity.largest_penetration < 1e-6


def test_known_noise_is_found(case):
    noise = np.random.default_rng(0).normal(scale=1e-4, size=case[1].displacement.shape)
    fidelity = check(case, case[1].displacement + noise)
    # |error|^2 of three normal components has the mean 3 sigma^2; 20 x 300 nodes leave about 1 % of scatter.
    assert fidelity.rmse_all == pytest.approx(np.sqrt(3) * 1e-4, rel=0.03)
    assert fidelity.relative_residual > 1
    assert fidelity.mc > 0.01


def test_a_delay_by_one_step_is_found(case):
    u = case[1].displacement
    fidelity = check(case, np.concatenate([u[:1], u[:-1]]))
    moved = np.sqrt(np.mean(np.sum(np.diff(u, axis=0)[:, case[2]] ** 2, axis=2)))
    assert fidelity.rmse_all == pytest.approx(moved)
    assert fidelity.largest_penetration > 1e-4  # the obstacle is a step ahead


def test_nothing_moves_is_caught_by_the_obstacle_alone(case):
    fidelity = check(case, np.zeros_like(case[1].displacement))
    assert fidelity.relative_residual < 1e-12  # the rest state is an equilibrium up to rounding, only not this one
    # At the end the axis of the cylinder is inside the rest body, and comes out of its sides: one radius deep.
    assert fidelity.largest_penetration == pytest.approx(0.01, abs=0.0005)


def test_a_node_pulled_through_its_cell_is_counted(case):
    u = case[1].displacement.copy()
    u[7, len(u[7]) // 2] += [0.011, 0.0, 0.0]
    fidelity = check(case, u)
    assert fidelity.inverted_elements > 0 and fidelity.smallest_det_f < 0
    assert fidelity.worst_step == 7
