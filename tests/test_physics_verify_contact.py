"""What the equations say of a frame in contact, worked out on paper: one box under a tilted plane that comes down."""

import numpy as np
import pytest

from physics.fidelity.verify import Checker, verify
from tests.bars import HX, HY, HZ, LAMBDA, MU, ORIGIN, bar

NORMAL = np.array([2, -3, -6]) / 7  # of length 1, out of the obstacle
SUPPORT = [{"where": "z-min"}, {"where": "x-max z-max", "fixed": "x"}]  # two of the four nodes above may not move along x
PULL = np.array([30.0, -20.0, 40.0])  # [Pa] on the upper face at the last step


def box(path, **tables):
    """A box under a half-space whose plane goes through the way-points, given from the corner (0, HY, HZ), the first to be touched."""
    way = [(ORIGIN + [0, HY, HZ] + np.asarray(point)).tolist() for point in path]
    obstacle = {"shape": "half-space", "normal": NORMAL.tolist(), "path": way, "contact": "nodes"}
    scene, mesh, _ = bar(1, **({"support": SUPPORT, "obstacle": obstacle} | tables))
    return scene, mesh, mesh.points[:, 2] > ORIGIN[2] + HZ / 2


def squeezed(mesh, strain):
    """(N, 3) displacements of an even stretch along z, and the (N, 3) internal forces: stress times a quarter of each face."""
    u = strain * (mesh.points - ORIGIN) * [0, 0, 1]
    side = np.sign(mesh.points - ORIGIN - np.array([HX, HY, HZ]) / 2)
    faces = np.array([HY * HZ, HX * HZ, HX * HY]) / 4
    return u, strain * np.array([LAMBDA, LAMBDA, LAMBDA + 2 * MU]) * side * faces


@pytest.mark.parametrize("strain, fraction, touching", [
    (0.0, 0.113, 0), (0.0, 0.12, 1), (-0.05, 0.1, 0), (-0.05, 0.3, 1), (-0.05, 0.6, 3), (-0.2, 1.0, 3), (-0.05, 1.0, 4), (0.3, 0.6, 3)])
def test_contact_takes_from_each_touching_node_what_it_can_by_pushing(strain, fraction, touching):
    """Node by node the push p >= 0 along the normal that leaves least of the force on the components that may move."""
    load = [{"where": "z-max", "traction": PULL.tolist()}]
    # From 5 mm off, in the direction of the normal, to 25 mm inside; x-max lies 11.4 mm, y-min 12.9 mm farther away than the corner.
    # At 0.113 the gap is 1.61 mm, at 0.12 it is 1.4 mm: the limit is 0.05 of 30 mm, the median edge.
    scene, mesh, upper = box([-0.005 * NORMAL, 0.025 * NORMAL], load=load)
    u, force = squeezed(mesh, strain)
    free = np.zeros(mesh.points.shape, bool)
    free[upper] = True
    free[upper & (mesh.points[:, 0] > ORIGIN[0] + HX / 2), 0] = False
    force[upper] -= fraction * PULL * HX * HY / 4
    reaction, touched = np.zeros(3), 0
    for node in np.flatnonzero(upper):
        gap = (mesh.points[node] + u[node] - ORIGIN - [0, HY, HZ] - (-0.005 + 0.03 * fraction) * NORMAL) @ NORMAL
        if gap < 0.05 * HY:  # the middle one of the three edges
            normal = NORMAL * free[node]
            push = max(0.0, force[node] @ normal / (normal @ normal))
            force[node] -= push * NORMAL
            reaction -= push * NORMAL  # the body pushes back
            touched += 1
    frame = Checker(scene, mesh).frame(u, fraction)
    assert touched == touching
    assert frame.residual == pytest.approx(np.linalg.norm(force[free]))
    assert frame.reaction == pytest.approx(reaction, rel=1e-9, abs=1e-12)
    assert frame.energy == pytest.approx((LAMBDA / 2 + MU) * strain**2 * HX * HY * HZ)


def test_the_largest_penetration_may_be_that_of_any_step():
    """The plane goes in along its normal and, in the second path, out: at its deepest in the last of 4 steps, or in the first of 2."""
    free = np.ones(8, bool)
    for path, steps, expected in (([-0.005, 0.002], 4, 2e-3), ([-0.005, 0.003, -0.008], 2, 3e-3), ([-0.005, -0.001], 3, 0.0),
                                  ([-0.005, -0.004, -0.003, 0.006, -0.004], 4, 6e-3)):
        scene, mesh, upper = box([depth * NORMAL for depth in path])
        still = np.zeros((steps + 1, *mesh.points.shape))
        still[0] = -0.02 * NORMAL  # the rest frame is no step
        fidelity = verify(still, still, scene=scene, mesh=mesh, free=free, sample=1)
        assert fidelity.largest_penetration == pytest.approx(expected)
    # Nodes that move towards the plane go as much deeper as the displacement has along the normal; the held ones below do not count.
    scene, mesh, upper = box([-0.005 * NORMAL, 0.002 * NORMAL])
    down = np.where(upper[:, None], [0.0077, 0, 0], -NORMAL)
    assert Checker(scene, mesh).penetration(down, 1.0) == 0  # 2.2 mm of 7.7 along x are along the normal
    assert Checker(scene, mesh).penetration(-down, 1.0) == pytest.approx(4.2e-3)


def test_a_body_without_an_obstacle_is_not_penetrated():
    scene, mesh, _ = bar(1)
    assert Checker(scene, mesh).penetration(np.full(mesh.points.shape, 7.0), 1.0) == 0.0


def test_a_frame_that_is_not_finite_has_no_residual_but_an_answer():
    scene, mesh, upper = box([-0.005 * NORMAL, 0.002 * NORMAL])
    u = np.zeros_like(mesh.points)
    u[np.flatnonzero(upper)[-1]] = np.nan
    frame = Checker(scene, mesh).frame(u, 1.0)
    assert not np.isfinite(frame.residual) and not np.isfinite(frame.energy)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_a_prediction_that_is_not_a_number_does_not_pass_for_one_without_penetration(broken):
    scene, mesh, upper = box([-0.005 * NORMAL, 0.025 * NORMAL])
    u = np.zeros_like(mesh.points)
    checker = Checker(scene, mesh)
    assert checker.penetration(u, 0.5) == pytest.approx(0.01)  # half-way from -5 to 25 mm
    u[np.flatnonzero(upper)[0], 1] = broken
    assert checker.penetration(u, 0.5) == np.inf
