"""A body in a small space: energies of one deformation throughout in closed form, and vectors that follow a path of equilibria."""

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.reduced import space as module
from physics.reduced.elastic import Elastic
from physics.reduced.space import Reduced, derivatives
from physics.scene import Body, Material

NU = 0.3
LAMBDA, MU = 0.3 / (1.3 * 0.4), 1 / 2.6  # of Young's modulus 1
SIDES = (0.06, 0.02, 0.03)
GRADIENTS = np.random.default_rng(4).normal(size=(3, 3, 3))


@pytest.fixture(scope="module")
def elastic():
    mesh = build_mesh(Body(length=SIDES[0], width=SIDES[1], height=SIDES[2], cells=(3, 1, 1), cell="prism"))
    held = np.zeros(len(mesh.points), bool)
    held[mesh.places["x-min"]] = True
    found = Elastic(mesh, held, Material(young_modulus=7.0, poisson_ratio=NU, law="saint-venant-kirchhoff"))
    found.points = mesh.points
    return found


def energy(h):
    """Of Saint Venant-Kirchhoff's law, of the whole body of one gradient, which may be complex."""
    e = (h + h.T + h.T @ h) / 2
    return (LAMBDA / 2 * np.trace(e) ** 2 + MU * (e * e).sum()) * np.prod(SIDES)


def homogeneous(elastic, gradients):
    return [(elastic.points @ h.T).ravel() for h in gradients]


@pytest.mark.parametrize("points", [4000, 12, 20])  # of 36 points of integration
def test_the_polynomial_is_the_energy_of_one_deformation_throughout(elastic, points, monkeypatch):
    monkeypatch.setattr(module, "POINTS", points)
    reduced = Reduced(elastic, homogeneous(elastic, GRADIENTS))
    assert len(elastic.weights) == 36 and abs(len(reduced._points) - min(points, 36)) <= 1
    r = reduced.space.shape[1]
    assert r == 3
    basis = [np.linalg.lstsq(elastic.points, column.reshape(-1, 3), rcond=None)[0].T for column in reduced.space.T]

    def whole(q):
        return energy(sum(value * h for value, h in zip(q, basis, strict=True)))

    q = np.array([2e-3, -3e-3, 1e-3])  # of vectors whose gradients are near 100: strains of a tenth
    assert 0.05 < abs(sum(value * h for value, h in zip(q, basis, strict=True))).max() < 1
    slope = np.array([whole(q + 1e-30j * unit).imag / 1e-30 for unit in np.eye(3)])
    # the strains are kept in float32
    np.testing.assert_allclose(reduced.slope(q), slope, atol=2e-6 * abs(slope).max())
    step = 1e-7
    hessian = np.array([[(whole(q + 1e-30j * a + step * b).imag - whole(q + 1e-30j * a - step * b).imag) / (2e-30 * step)
                         for a in np.eye(3)] for b in np.eye(3)])
    np.testing.assert_allclose(reduced.hessian(q), hessian, atol=2e-6 * abs(hessian).max())
    assert np.array_equal(reduced.slope(np.zeros(3)), np.zeros(3))
    np.testing.assert_allclose(reduced.hessian(np.zeros(3)), np.eye(3), atol=2e-6)


def test_few_points_stand_for_all_in_the_energy_of_everything_that_the_space_can_do():
    """Phi is orthonormal in K, so that second derivatives at rest are the identity if all points count."""
    mesh = build_mesh(Body(length=0.24, width=0.02, height=0.03, cells=(40, 4, 6), cell="prism"))
    held = np.zeros(len(mesh.points), bool)
    held[mesh.places["x-min"]] = True
    elastic = Elastic(mesh, held, Material(young_modulus=7.0, poisson_ratio=0.4))
    force = np.zeros((elastic.size, 4))
    for column, (x, y, z) in enumerate(((0.2, 0.01, 0.03), (0.2, 0.02, 0.01), (0.2, 0.0, 0.01), (0.21, 0.01, 0.03))):
        node = int(np.linalg.norm(mesh.points - [x, y, z], axis=1).argmin())
        force[3 * node:3 * node + 3, column] = [0.1, (-1) ** column, -1]
    reduced = Reduced(elastic, derivatives(elastic, force, 0.05))
    assert len(elastic.weights) > 10 * module.POINTS and abs(len(reduced._points) - module.POINTS) < 10
    energies = np.linalg.eigvalsh(reduced.hessian(np.zeros(reduced.space.shape[1])))
    assert 0.85 < energies[0] and energies[-1] < 1.15  # points drawn by how much they count are off by about sqrt(r / POINTS) = 0.12
    # W is a sum of squares, of strains at the same points throughout: none together have a negative energy, but for float32's rounding
    norm = np.sqrt(np.diag(reduced._gram))
    assert np.linalg.eigvalsh(reduced._gram / np.outer(norm, norm))[0] > -1e-5
    again = Reduced(elastic, derivatives(elastic, force, 0.05))
    assert np.array_equal(again._gram, reduced._gram)


def test_vectors_that_add_nothing_are_left_out(elastic):
    first, second, third = homogeneous(elastic, GRADIENTS)
    small = 1e-8 * second
    reduced = Reduced(elastic, [first, small, 0 * third, first + small, -5 * third])
    assert reduced.space.shape == (elastic.size, 3)
    gram = reduced.space.T @ (elastic.stiffness @ reduced.space)
    np.testing.assert_allclose(gram, np.eye(3), atol=1e-6)
    for vector in (second, third):  # in the space, whatever their lengths were
        rest = vector - reduced.space @ (reduced.space.T @ (elastic.stiffness @ vector))
        assert np.linalg.norm(rest) < 1e-5 * np.linalg.norm(vector)


def test_what_is_independent_by_little_is_kept_and_by_less_is_not(elastic):
    first, second, _ = homogeneous(elastic, GRADIENTS)
    # of two normed vectors at a small angle a the energies are 2 and a^2 / 2: limit 1e-9 of the larger, so an angle of 6e-5
    stiffness = elastic.stiffness
    first = first / np.sqrt(first @ stiffness @ first)
    second = second - first * (first @ stiffness @ second)
    second = second / np.sqrt(second @ stiffness @ second)
    assert [Reduced(elastic, [first, first + angle * second]).space.shape[1] for angle in (9e-5, 4e-5)] == [2, 1]


def loads(elastic):
    """Two at the free end, and a third one in the middle, none along an axis of the body."""
    found = np.zeros((elastic.size, 3))
    end, middle = np.flatnonzero(elastic.points[:, 0] > 0.059), np.flatnonzero(abs(elastic.points[:, 0] - 0.04) < 1e-3)
    for column, (nodes, force) in enumerate(((end[:2], [0.1, 0.3, -1]), (end, [0.2, 1, 0.5]), (middle, [-0.3, 0.5, 1]))):
        for node in nodes:
            found[3 * node:3 * node + 3, column] = force
    return found


def test_vectors_are_derivatives_of_equilibria_under_the_loads(elastic):
    """With loads s l_0 + t l_j, u = s u_0 + t u_j + s^2 u_00 + 2 s t u_0j + t^2 u_jj + s^3 w_0 / 3 + s^2 t w_j + .. balances them but
    for terms of fourth order, and of third order in t."""
    force, scale = loads(elastic), 2e-3
    vectors = derivatives(elastic, force, scale)
    assert len(vectors) == 3 + 5 + 3
    first, mixed, own, third = vectors[:3], vectors[3:6], [vectors[3], *vectors[6:8]], vectors[8:]
    pull = []
    for column, u in zip(force.T, first, strict=True):
        assert abs(u).max() == pytest.approx(scale)
        answer = elastic.solve(column)
        np.testing.assert_allclose(u, answer * scale / abs(answer).max(), atol=1e-12 * scale)
        pull.append(column * scale / abs(answer).max())

    def left(s, t, j):
        u = s * first[0] + t * first[j] + s**2 * mixed[0] + 2 * s * t * mixed[j] + t**2 * own[j] + s**3 / 3 * third[0] + s**2 * t * third[j]
        return elastic.internal(u) - s * pull[0] - t * pull[j]

    def size(force):
        return np.sqrt(force @ elastic.solve(force))

    # along the main load alone: what is left falls by 2^4 when the load is halved
    assert size(left(0.5, 0, 1)) / size(left(0.25, 0, 1)) == pytest.approx(16, rel=0.1)
    for j in (1, 2):
        def slope(s, j=j):
            return (left(s, 1e-4, j) - left(s, -1e-4, j)) / 2e-4

        def bend(s, j=j):
            return left(s, 1e-2, j) + left(s, -1e-2, j) - 2 * left(s, 0, j)

        assert size(slope(0.5)) / size(slope(0.25)) == pytest.approx(8, rel=0.1)  # of order s^3
        # of order s t^2, and none of t^2 alone: proportional to s, but for a t^4 of 1e-4 of it
        assert size(bend(0.5)) / size(bend(0.25)) == pytest.approx(2, rel=0.2)
