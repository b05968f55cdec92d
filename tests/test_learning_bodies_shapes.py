"""Smooth displacements of any body: which functions, fits that meshes share, the shapes of a training, mirrors."""

from types import SimpleNamespace

import numpy as np
import pytest

from learning.bodies.samples import Fitted, fitted, sample_of
from learning.bodies.shapes import fit, functions, mirror_signs, powers, principal
from tests.test_learning_bodies_body import PLATE, seen


def test_degrees_go_with_the_sides_of_the_box():
    found = powers(np.array([0.1, 0.05, 0.01]), 6)
    assert found.max(axis=0).tolist() == [6, 3, 2, 0] and found.sum(axis=1).max() == 7
    assert len(np.unique(found, axis=0)) == len(found) and (found == 0).all(axis=1).sum() == 1


def test_functions_are_orthonormal_over_the_box():
    """By Gauss points, which integrate their products exactly."""
    at, weight = np.polynomial.legendre.leggauss(8)
    place = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3)
    share = np.einsum("i,j,k->ijk", weight, weight, weight).ravel() / 8
    values = functions(SimpleNamespace(points=place, box=lambda points: points), powers(np.ones(3), 4))
    assert np.allclose(values.T @ (share[:, None] * values), np.eye(values.shape[1]), atol=1e-12)


def test_a_smooth_displacement_has_the_same_coefficients_on_meshes_that_share_no_inner_node():
    """u = (x y, z^2, x^3 - 2 y) in the box's own coordinates."""
    degrees = powers(np.array([0.1, 0.08, 0.01]), 5)
    found = []
    for cells in ([14, 12, 4], [11, 9, 5]):
        body = seen(body=PLATE | {"cells": cells})
        x, y, z = body.box(body.points).T
        u = np.column_stack([x * y, z**2, x**3 - 2 * y])[None]
        values = functions(body, degrees)
        found.append(fit(values, u))
        assert np.allclose(values @ found[-1][0], u[0], atol=1e-3)  # the weight on coefficients is 1e-4
    assert np.allclose(found[0], found[1], atol=1e-3)


def test_principal_combinations_are_those_of_the_largest_share_orthonormal():
    shapes = np.zeros((2, 4, 3))
    shapes[0, 1, 2], shapes[1, 3, 0] = 1, 1
    amounts = np.array([[3.0, 0], [0, 1], [-3, 0], [0, 1]])
    found = principal(np.einsum("ti,imk->tmk", amounts, shapes), np.array([1.0, 1, 1, 1]), 2)
    assert np.allclose(abs(found), shapes, atol=1e-12)
    other = principal(np.einsum("ti,imk->tmk", amounts, shapes), np.array([0.1, 1, 0.1, 1]), 1)
    assert np.allclose(abs(other[0]), shapes[1], atol=1e-12)  # 0.18 against 2


@pytest.mark.parametrize("axis, touched", [(0, False), (1, False), (2, False), (0, True), (1, True)])
def test_a_mirror_changes_signs_as_it_does_at_the_nodes(axis, touched):
    body = seen()
    degrees = powers(body.extent, 4, touched)
    values, size = functions(body, degrees), np.random.default_rng(axis).normal(size=(len(degrees), 3))
    twin = body.mirrored(axis)
    u = values @ size * np.where(np.arange(3) == axis, -1, 1)
    assert np.allclose(functions(twin, degrees) @ (size * mirror_signs(degrees, axis)), u)


@pytest.mark.parametrize("touched", [False, True])
def test_errors_told_by_amounts_are_those_of_the_nodes(touched):
    """For any amounts, of a displacement that no shape has in full; the same in a mirror."""
    dice, body = np.random.default_rng(1), seen()
    degrees = powers(body.extent, 4, touched)
    truth = 1e-3 * dice.normal(size=(3, *body.points.shape))
    truth[:, body.held] = 0
    one = SimpleNamespace(body=body, fraction=np.array([0.4, 0.7, 1.0]), displacement=truth)
    shapes = principal(dice.normal(size=(9, len(degrees), 3)), np.ones(9), 5)
    for mirror in ((), (1,)):
        known: Fitted = fitted(one, degrees, mirror)
        signs = mirror_signs(degrees, 1) if mirror else np.ones((len(degrees), 3))
        sample = sample_of(known, shapes * signs)
        amounts = sample.best + 1e-4
        nodes = np.einsum("nm,imk->ink", functions(body, degrees), shapes)
        off = np.einsum("pi,ink->pnk", amounts.double().numpy(), nodes) - truth
        by_hand = np.sqrt((off[:, body.free] ** 2).sum(axis=2).mean(axis=1))
        assert sample.error(amounts).numpy() == pytest.approx(by_hand, rel=1e-4)
        assert (sample.error(amounts) > sample.error(sample.best)).all()
