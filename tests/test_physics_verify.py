"""A prediction held against FE: the truth scores nothing, every kind of error is caught by the figure made for it."""

from dataclasses import replace

import numpy as np
import pytest

from physics.equilibrium.newton import TOLERANCE
from physics.fidelity.verify import Checker, verify
from physics.solution import solve
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
    assert fidelity.rmsd_1 == fidelity.rmsd_50 == fidelity.rmsd_all == fidelity.gf_h == fidelity.gf_c == 0
    assert fidelity.mc == fidelity.ar == fidelity.inverted_elements == 0
    assert fidelity.relative_residual < 2 * TOLERANCE  # the checker finds other contact forces, never worse ones than twice
    assert fidelity.largest_penetration < 1e-6


def test_known_noise_is_found(case):
    noise = np.random.default_rng(0).normal(scale=1e-4, size=case[1].displacement.shape)
    fidelity = check(case, case[1].displacement + noise)
    # |error|^2 of three normal components has the mean 3 sigma^2; 20 x 300 nodes leave about 1 % of scatter.
    assert fidelity.rmsd_all == pytest.approx(np.sqrt(3) * 1e-4, rel=0.03)
    assert fidelity.relative_residual > 1
    assert fidelity.mc > 0.01


def test_a_delay_by_one_step_is_found(case):
    u = case[1].displacement
    fidelity = check(case, np.concatenate([u[:1], u[:-1]]))
    moved = np.sqrt(np.mean(np.sum(np.diff(u, axis=0)[:, case[2]] ** 2, axis=2)))
    assert fidelity.rmsd_all == pytest.approx(moved)
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
    assert fidelity.energy_error == fidelity.estimated_error == np.inf  # the law has no energy there


def test_estimated_error_is_about_the_error_of_a_small_disturbance(case):
    """Every step is bent a little along a smooth field: one Newton step leads back to the equilibrium."""
    _, solution, free = case
    x = solution.mesh.points
    bent = np.zeros_like(x)
    bent[:, 1] = 1e-4 * (x[:, 0] / 0.06) ** 2  # sideways, where no contact holds the beam
    fidelity = check(case, solution.displacement + np.where(free[:, None], bent, 0) * (np.arange(21) > 0)[:, None, None])
    # Newton's method is quadratic: a disturbance of 1e-4 of a beam of 2e-2 leaves a few per cent of itself.
    assert fidelity.estimated_error == pytest.approx(fidelity.rmsd_all, rel=0.1)


def test_truth_has_no_estimated_error_nor_one_of_energy_and_reaction(case):
    fidelity = check(case, case[1].displacement)
    assert fidelity.energy_error == fidelity.reaction_error == 0
    assert fidelity.estimated_error < 1e-5 * abs(case[1].displacement).max()


def test_another_material_is_found_by_energy_reaction_and_residual(case):
    scene, solution, free = case
    softer = replace(scene, material=replace(scene.material, young_modulus=0.5e6))
    fidelity = verify(solution.displacement, solution.displacement, scene=scene, mesh=solution.mesh, free=free)
    other = verify(solve(softer).displacement, solution.displacement, scene=scene, mesh=solution.mesh, free=free)
    # Pressed by the same path, a body of any stiffness has the same shape: only a force would tell, and the file has none.
    assert other.rmsd_all < 1e-5 and fidelity.rmsd_all == 0
    law = replace(scene, material=replace(scene.material, poisson_ratio=0.2))
    assert verify(solve(law).displacement, solution.displacement, scene=scene, mesh=solution.mesh, free=free).relative_residual > 0.01


def test_enough_correction_is_the_finite_element_solution(case):
    """From a beam bent a millimetre too far, touching nothing, Newton steps lead to the equilibrium of that step."""
    scene, solution, _ = case
    checker, truth = Checker(scene, solution.mesh), solution.displacement[-1]
    u = truth - np.array([0, 0, 1e-3]) * (solution.mesh.points[:, :1] / 0.06) ** 2
    errors = []
    for _ in range(6):
        u = u + checker.correction(u, 1.0)
        errors.append(abs(u - truth).max())
    assert errors[0] < 0.2e-3 and errors[-1] < 1e-5 * abs(truth).max()


def test_one_node_out_of_place_is_found_by_the_largest_distance_not_by_the_mean(case):
    _, solution, free = case
    u, step = solution.displacement.copy(), 12
    inner = np.flatnonzero(np.all(abs(solution.mesh.points - [0.03, 0.01, 0.01]) < 1e-9, axis=1))[0]
    u[step, inner] += [0, 1e-3, 0]  # a fifth of a cell
    fidelity, truth = check(case, u), check(case, solution.displacement)
    # One of some 300 nodes in one of 20 frames: the mean forgets it, the largest distance has it whole, once in 20 frames.
    assert fidelity.rmsd_all == pytest.approx(1e-3 / np.sqrt(20 * free.sum()))
    assert fidelity.gf_h == pytest.approx(1e-3 / 20)
    assert fidelity.worst_step == step
    assert fidelity.relative_residual > 0.1 and fidelity.stress_error > 0.05
    assert fidelity.smallest_scaled_jacobian < 0.95 * truth.smallest_scaled_jacobian
    assert fidelity.inverted_elements == 0


def test_a_mirrored_motion_is_found_by_obstacle_and_residual_not_by_its_energy(case):
    _, solution, _ = case
    mesh, flip = solution.mesh, np.array([1, 1, -1])
    image = (mesh.points - [0, 0, 0.02]) * flip
    partner = np.argmin(np.linalg.norm(mesh.points[:, None] - image, axis=2), axis=1)
    assert abs(mesh.points[partner] - (mesh.points * flip + [0, 0, 0.02])).max() < 1e-12
    fidelity = check(case, solution.displacement[:, partner] * flip)
    # The cells are cut by diagonals, so the mirror image has not quite the same energy.
    assert fidelity.energy_error < 0.01
    assert fidelity.largest_penetration > 5e-3  # bent up, into the cylinder that comes down
    assert fidelity.relative_residual > 0.1
    assert fidelity.rmsd_all > np.sqrt(np.mean(np.sum(solution.displacement[1:] ** 2, axis=2)))


def test_another_poisson_ratio_is_found_by_residual_stress_and_estimate(case):
    """A prediction of the same body in another material, held against its own scene: the estimate knows the error unseen."""
    scene = case[0]
    other = solve(replace(scene, material=replace(scene.material, poisson_ratio=0.3)))
    fidelity = check(case, other.displacement)
    assert fidelity.relative_residual > 0.1 and fidelity.stress_error > 0.05
    assert fidelity.effectivity == pytest.approx(1, abs=0.2)  # Newton's step from 3 % of strain away


def test_the_truth_has_no_stress_error_and_the_ideal_figures_of_its_mesh(case):
    fidelity = check(case, case[1].displacement)
    assert fidelity.stress_error == 0 and np.isnan(fidelity.effectivity)
    assert 0 < fidelity.smallest_scaled_jacobian < 1 and 0 < fidelity.smallest_det_f < 1.1
