"""What the shapes of a reduced model are, by dense matrices of a tiny body; and its equilibria by a literal minimum in their span."""

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from physics.equilibrium.state import NoEquilibrium
from physics.mesh.build import build_mesh
from physics.reduced import model as reduced
from physics.reduced.model import Reduced
from physics.solution import solve
from tests.scenes import beam

SMALL = {"length": 0.06, "width": 0.02, "height": 0.015, "cells": [3, 1, 1], "cell": "hexahedron"}
LINEAR = {"young_modulus": 1e6, "poisson_ratio": 0.3, "law": "linear"}
HELD = [{"where": "x-min"}, {"where": "x-max z-min", "fixed": "z", "displacement": [0, 0, -0.003]}]
LOAD = [{"where": "x-max", "traction": [900.0, 300.0, -200.0]}]


def dense(model):
    """Stiffness of the rest state on the free components, (3 N, 3 N) in the order of the nodes, zero elsewhere."""
    balance = model.balance
    matrix, dofs = balance.elasticity.stiffness(np.zeros_like(balance.mesh.points))[:, :], balance.elasticity.space.dofs.ravel()
    free = ~balance.fixed.ravel()
    return np.where(np.outer(free, free), matrix[np.ix_(dofs, dofs)], 0.0), free


@pytest.fixture(scope="module")
def model():
    scene = beam(body=SMALL, support=HELD, load=LOAD)
    return Reduced(scene, build_mesh(scene.body))


def inside(model, field):
    """The share of a field (3 N,) that the shapes do not span."""
    return np.linalg.norm(field - model.shapes @ (model.shapes.T @ field)) / np.linalg.norm(field)


def test_modes_are_the_lowest_of_stiffness_and_cells_around_each_node(model):
    K, free = dense(model)
    mass = np.repeat(np.bincount(model.balance.mesh.cells.ravel()), 3).astype(float)[free]
    _, vectors = scipy.linalg.eigh(K[np.ix_(free, free)], np.diag(mass))
    found = model._modes(4)
    assert len(found) == 4
    exact = np.zeros((len(free), 4))
    exact[free] = vectors[:, :4]
    for i, mode in enumerate(found):
        assert abs(mode).max() == pytest.approx(1e-3 * 0.015)
        flat = mode.ravel() / abs(mode).max()
        column = exact[:, i] / exact[np.argmax(abs(flat)), i] * flat[np.argmax(abs(flat))]
        np.testing.assert_allclose(flat, column, atol=2e-3)  # eight turns of subspace iteration
        assert inside(model, exact[:, i]) < 1e-2


def test_second_order_shapes_are_responses_to_the_second_derivative_of_the_forces(model):
    """theta_ij = -K^-1 d2f[a, b], the derivative by differences twice as long as the mode and half as long."""
    K, free = dense(model)
    force = model.balance.elasticity.force
    modes = model._modes(3)
    found = model._derivatives(modes)
    assert len(found) == 6
    pairs = [(i, j) for i in range(3) for j in range(i + 1)]
    for (i, j), theta in zip(pairs, found, strict=True):
        a, b = modes[i], modes[j]
        mixed = (force(a + b) - force(a - b) - force(b - a) + force(-a - b)).ravel() / 4  # d2f[a, b] to fourth order
        exact = np.zeros(len(free))
        exact[free] = np.linalg.solve(K[np.ix_(free, free)], -mixed[free])
        # Scaled as they come: -4 d2f[a, b] for two modes, and -e(a), which is d2f[a, a], for one.
        factor = 4 if i != j else 1
        assert np.linalg.norm(theta.ravel() - factor * exact) < 1e-2 * factor * np.linalg.norm(exact)


def test_responses_are_static_solutions_and_lie_in_the_span(model):
    K, free = dense(model)
    solution = np.zeros(len(free))
    solution[free] = np.linalg.solve(K[np.ix_(free, free)], model.balance.load.ravel()[free])
    (response,) = model._responses()
    np.testing.assert_allclose(response.ravel(), 1.5e-5 * solution / abs(solution).max(), atol=1e-10)
    assert inside(model, solution) < 1e-6
    count = model.shapes.shape[1]
    np.testing.assert_allclose(model.shapes.T @ model.shapes, np.eye(count), atol=1e-10)
    assert not model.shapes[~free].any()
    moved = np.zeros(len(free))  # the motion under prescribed displacements leaves free components without force
    target = model.balance.target.ravel()
    whole = (model.balance.elasticity.force(1e-6 * model._moved / 3e-3) / 1e-6 * 3e-3).ravel()
    assert np.linalg.norm(whole[free]) < 1e-3 * np.linalg.norm(whole[~free])
    assert np.array_equal(np.where(free, moved, model._moved.ravel())[~free], target[~free])


def test_equilibria_are_minima_of_the_energy_in_the_span(model):
    balance, steps = model.balance, 4
    path = model.path(steps)
    assert path.shape == (steps + 1, *balance.mesh.points.shape) and not path[0].any()
    for step in (1, 4):
        fraction = step / steps
        np.testing.assert_allclose(path[step][balance.fixed], fraction * balance.target[balance.fixed], atol=1e-15)
        missing = balance.elasticity.force(path[step]) - fraction * balance.load
        reaction = np.linalg.norm(missing[balance.fixed])
        assert np.linalg.norm(model.shapes.T @ missing.ravel()) < 5e-3 * reaction  # a change of 2e-4 of a cell ends it
        rest = path[step] - fraction * model._moved
        assert inside(model, rest.ravel()) < 1e-9
    assert steps <= model.iterations < 12 * steps


def test_the_stiffness_of_the_span_is_that_of_the_body(model):
    K, _ = dense(model)
    model._renew(np.zeros(model.shapes.shape[1]), 0.0)
    exact = model.shapes.T @ K @ model.shapes
    np.testing.assert_allclose(model._inverse @ exact, np.eye(len(exact)), atol=0.02)  # differences of 1e-5 of a cell, one-sided


def test_a_tiny_body_with_all_shapes_is_the_whole_model(monkeypatch):
    """More modes than the body has components, under a plane that pushes it down: nothing is left out."""
    monkeypatch.setattr(reduced, "MODES", 12)
    obstacle = {"shape": "sphere", "radius": 0.02, "path": [[0.05, 0.012, 0.0355], [0.05, 0.012, 0.0315]]}
    scene = beam(body={**SMALL, "cells": [2, 1, 1]}, obstacle=obstacle, steps={"count": 8})
    solution = solve(scene)
    model = Reduced(scene, solution.mesh)
    assert model.shapes.shape[1] == 24  # 12 nodes, 4 of them held
    found = model.path(8)
    # Both end at a small change: 2e-4 of a cell of 15 mm here, before the last step.
    assert abs(found - solution.displacement).max() < 3e-6
    assert not found[0].any() and not found[1].any()  # the gap is an eighth of the way
    rested = Reduced(scene, solution.mesh)
    assert not rested.path(8)[1].any() and rested.iterations == model.iterations


def test_a_span_counts_shapes_alike_and_drops_what_adds_nothing():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 4, 3))
    basis = reduced._span([1e-9 * a, 1e6 * b, a + 3 * b, a + 1e-9 * rng.normal(size=(4, 3))])
    assert basis.shape == (12, 2)
    np.testing.assert_allclose(basis.T @ basis, np.eye(2), atol=1e-12)
    for shape in (a, b):
        flat = shape.ravel()
        np.testing.assert_allclose(basis @ (basis.T @ flat), flat, atol=1e-7)


def test_what_cannot_settle_is_halved_and_then_given_up(model, monkeypatch):
    asked = []

    def fail(q, fraction):
        asked.append(fraction)
        raise NoEquilibrium("never")

    monkeypatch.setattr(model, "_equilibrium", fail)
    monkeypatch.setattr(model, "_renew", lambda q, fraction: asked.append(("stiffness", fraction)))
    zero = np.zeros(model.shapes.shape[1])
    with pytest.raises(NoEquilibrium):
        model._advance(zero, zero, 0.25, 0.75)
    halves = [0.25 + 0.5 / 2**depth for depth in range(reduced.HALVINGS + 1)]
    assert [each for each in asked if not isinstance(each, tuple)] == pytest.approx(halves)
    assert asked.count(("stiffness", 0.25)) == reduced.HALVINGS
    starts = []

    def fail_once(q, fraction):
        starts.append((q[0], fraction))
        if len(starts) == 1:
            raise NoEquilibrium("once")
        return q + 1

    monkeypatch.setattr(model, "_equilibrium", fail_once)
    assert model._advance(zero + 5, zero + 2, 0.25, 0.75)[0] == 5
    # From the last state, 2, to the middle, 3, and from there straight on, 2 x 3 - 2, to the end.
    assert starts == [(5, 0.75), (2, 0.5), (4, 0.75)]
