"""Estimates of the state at a pose: their parts against finite elements, their laws, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.sets.generate import trajectory_of
from learning.samples.estimate import estimate, estimator_of
from physics.body.elasticity import Elasticity
from physics.mesh.build import build_mesh
from physics.reduced.elastic import Elastic
from physics.reduced.space import Reduced, derivatives
from physics.scene import Body, Material, read_scene
from physics.schema import InputError
from tests.pressed import SCENE, pressed

FRAMES = np.arange(1, 11)


def beam(cell, law="neo-hookean"):
    mesh = build_mesh(Body(length=0.06, width=0.02, height=0.02, cells=(4, 2, 2), cell=cell))
    held = np.zeros(len(mesh.points), bool)
    held[mesh.places["x-min"]] = True
    return mesh, held, Elastic(mesh, held, Material(young_modulus=7.0, poisson_ratio=0.4, law=law))


def rms(error):
    return float(np.sqrt((np.asarray(error, float) ** 2).sum(axis=-1).mean()))


# elasticity

@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("law", ["neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"])
def test_nodal_forces_are_those_of_the_compiled_forms(cell, law):
    mesh, held, elastic = beam(cell, law)
    u = 1e-3 * np.random.default_rng(0).normal(size=mesh.points.shape)
    fixed = np.repeat(held[:, None], 3, axis=1)
    expected = Elasticity(mesh, Material(young_modulus=1.0, poisson_ratio=0.4, law=law), fixed).force(u)
    expected[held] = 0
    # the same points of integration, but for hexahedra and wild displacements: rounding alone
    assert np.allclose(elastic.internal(u.ravel()).reshape(-1, 3), expected, rtol=0, atol=1e-12 * abs(expected).max() * 1e3)


def test_stiffness_is_the_slope_of_the_forces_at_rest():
    _, _, elastic = beam("prism")
    u = np.random.default_rng(1).normal(size=elastic.size)
    u[elastic.held] = 0
    slope = (elastic.internal(1e-7 * u) - elastic.internal(-1e-7 * u)) / 2e-7
    expected = elastic.stiffness @ u
    expected[elastic.held] = 0
    assert np.allclose(slope, expected, rtol=0, atol=1e-6 * abs(expected).max())  # differences of 1e-7 in double precision
    assert np.allclose(elastic.solve(expected), u, rtol=0, atol=1e-10)


def test_second_and_third_order_complete_saint_venants_force():
    _, _, elastic = beam("prism", "saint-venant-kirchhoff")
    u = 5e-3 * np.random.default_rng(2).normal(size=elastic.size)
    u[elastic.held] = 0
    h = elastic.gradient(u)
    first = elastic.stiffness @ u
    first[elastic.held] = 0
    whole = elastic.internal(u)
    assert np.allclose(first + elastic.second(h, h) + elastic.third(h, h, h), whole, rtol=0, atol=1e-12 * abs(whole).max())


# the small space

@pytest.fixture(scope="module")
def small():
    _, _, elastic = beam("prism", "saint-venant-kirchhoff")
    loads = np.zeros((elastic.size, 3))
    loads[-3:] = np.eye(3)
    return elastic, Reduced(elastic, derivatives(elastic, loads, 5e-3))


def test_the_space_is_orthonormal_in_the_rest_stiffness(small):
    elastic, reduced = small
    assert np.allclose(reduced.space.T @ (elastic.stiffness @ reduced.space), np.eye(reduced.space.shape[1]), atol=1e-8)


def test_the_polynomial_is_the_energy_of_saint_venants_law(small):
    elastic, reduced = small
    q = 1e-3 * np.random.default_rng(0).normal(size=reduced.space.shape[1])
    expected = reduced.space.T @ elastic.internal(reduced.space @ q)
    assert np.allclose(reduced.slope(q), expected, rtol=0, atol=1e-5 * abs(expected).max())  # the strains are kept in float32
    step = 1e-6 * q
    change = reduced.slope(q + step) - reduced.slope(q - step)
    assert np.allclose(reduced.hessian(q) @ (2 * step), change, rtol=0, atol=1e-8 * abs(change).max() + 1e-14)


# estimates

@pytest.fixture(scope="module")
def found():
    return estimate(pressed(), FRAMES)


def test_an_estimate_is_near_the_solution(found):
    truth = pressed()
    error = rms((found.displacement - truth.displacement[FRAMES])[:, truth.free])
    # a tenth of the length deep: what the mesh itself leaves of such a motion is 1 %, and an estimate shall be finer than that
    assert error < 1e-3 * rms(truth.displacement[FRAMES][:, truth.free])


@pytest.mark.parametrize(("heights", "steps"), [
    ((0.0305, 0.027, 0.027, 0.027), 6),  # stands still after it has touched
    ((0.03, 0.03, 0.027), 4),  # waits before it presses
    ((0.031, 0.0295), 1),  # touches in the last step alone
    ((0.03, 0.0295), 1),  # touches at the start
])
def test_an_obstacle_that_stands_still_or_touches_at_an_end(heights, steps):
    path = [[0.08, 0.01, z] for z in heights]
    obstacle = {**SCENE["obstacle"], "axis": [0, 1, 0], "path": path}
    truth = trajectory_of(read_scene({**SCENE, "obstacle": obstacle, "steps": {"count": steps}}))
    error = estimate(truth, np.arange(1, steps + 1)).displacement - truth.displacement[1:]
    assert rms(error[:, truth.free]) < 2e-3 * rms(truth.displacement[1:, truth.free])  # as below, and some of so small a motion is a dent


@pytest.mark.parametrize(("cell", "law", "bound"), [
    ("tetrahedron", "neo-hookean", 1e-3), ("hexahedron", "neo-hookean-log", 1e-3), ("prism", "saint-venant-kirchhoff", 1e-3),
    # the answers to contact forces turn with the body, and the linear law knows no turning: 1.4e-3 were found
    ("prism", "linear", 2e-3)])
def test_other_cells_and_laws(cell, law, bound):
    truth = pressed(0.004, cell, law)
    error = estimate(truth, FRAMES).displacement - truth.displacement[FRAMES]
    assert rms(error[:, truth.free]) < bound * rms(truth.displacement[FRAMES][:, truth.free])


def test_the_obstacle_is_cleared(found):
    truth = pressed()
    estimator = estimator_of(truth)
    for row, frame in enumerate(FRAMES):
        points = estimator.mesh.points + found.displacement[row, truth.body]
        gap = estimator.obstacle.gap(estimator.surface.positions(points), estimator.centres[frame])[0].min()
        assert gap > -1e-3 * estimator.size  # contact is as stiff as the solver's; a step of Newton's is left over


def test_before_it_touches_nothing_moves(found):
    truth = pressed(1e-4)  # the path is half a millimetre of gap and a tenth more: steps 1 to 8 do not touch
    early = estimate(truth, np.arange(1, 9))
    assert not early.displacement[:, truth.free].any() and not early.answer.any()


def test_an_obstacle_that_leaves_lets_the_body_go_back():
    truth = pressed()
    there_and_back = replace(truth, displacement=truth.displacement[[0, 2, 4, 6, 8, 10, 8, 6, 4, 2, 0]])
    found = estimate(there_and_back, np.arange(1, 11)).displacement[:, truth.free]
    # a pose has one state, whichever way it was come to: up to the tolerance of Newton's method, and of what is interpolated
    # between the poses at which the law is evaluated
    assert rms(found[0] - found[8]) < 1e-5 and rms(found[3] - found[5]) < 1e-5
    assert not found[9].any()


def test_free_nodes_are_never_read(found):
    truth = pressed()
    wild = truth.displacement.copy()
    wild[:, truth.free] = np.random.default_rng(0).normal(size=wild[:, truth.free].shape)
    assert np.array_equal(estimate(replace(truth, displacement=wild), FRAMES).displacement[:, truth.free],
                          found.displacement[:, truth.free])


def test_the_order_of_nodes_and_the_place_of_the_scene_play_no_part(found):
    truth = pressed()
    order = np.concatenate([np.random.default_rng(0).permutation(truth.body.sum()), np.arange(truth.body.sum(), len(truth.points))])
    back = np.argsort(order)
    shift = np.array([0.3, -0.2, 0.1])
    moved = replace(truth, points=truth.points[order] + shift, node_kind=truth.node_kind[order], connectivity=back[truth.connectivity],
                    displacement=truth.displacement[:, order], modes=truth.modes[:, order])
    scene = truth.scene
    start, end = (shift + [[0.08, 0.01, 0.0305], [0.08, 0.011, 0.02]]).tolist()
    lines = scene[:scene.index("path = [")] + f"path = [{start}, {end}]\n" + scene[scene.index('contact = "'):]
    again = estimate(replace(moved, scene=lines), FRAMES).displacement[:, back]
    # other orders of sums and another factor: far below Newton's tolerance of 1e-6 of the length
    assert rms((again - found.displacement)[:, truth.free]) < 1e-6


def test_what_it_cannot_do_is_refused():
    truth = pressed()
    with pytest.raises(InputError, match="holds no scene"):
        estimate(replace(truth, scene=""), FRAMES)
    with pytest.raises(InputError, match="no loads"):
        estimate(replace(truth, scene=truth.scene.replace('fixed = "xyz"', 'fixed = "x"')), FRAMES)
