"""Functions about the touch: where that is, how far a point lies aside of it, what they are, and what of a motion they are to tell."""

import numpy as np
import pytest

from learning.bodies.samples import Fitted, shapes_of
from learning.bodies.shapes import WIDTHS, functions, powers, principal
from physics.contact.obstacles import Rigid
from tests.test_learning_bodies_body import PLATE, seen

ROUND = {"shape": "cylinder", "radius": 0.02, "axis": [0, 1, 0], "path": [[0.06, 0.03, 0.031], [0.06, 0.03, 0.027]]}
FINE = PLATE | {"cells": [20, 16, 2]}


def test_a_sphere_touches_below_its_middle_and_a_cylinder_in_the_middle_of_its_line():
    """Points of the other face, farther by a thickness, count e^-10."""
    for changes in ({}, {"obstacle": ROUND}):
        assert seen(body=FINE, **changes).touch == pytest.approx([0.06, 0.04, 0.01], abs=2e-5)


def test_how_far_a_point_lies_aside_is_its_distance_in_the_face_from_the_touch_or_the_line():
    places = np.array([[0.063, 0.044, 0.01], [0.04, 0.04, 0.01], [0.06, 0.0, 0.01]])
    assert seen().aside(places) == pytest.approx([25e-6, 4e-4, 16e-4], abs=1e-9)
    assert seen(obstacle=ROUND).aside(places) == pytest.approx([9e-6, 4e-4, 0], abs=1e-9)
    box = {"shape": "box", "size": [0.02, 0.02, 0.02], "radius": 0.001, "path": [[0.06, 0.04, 0.021], [0.06, 0.04, 0.017]]}
    assert seen(obstacle=box).aside(places) == pytest.approx([0, 1.21e-4, 9.61e-4], abs=1e-9)  # from its flat part, 9 mm to each side


@pytest.mark.parametrize("obstacle", [{}, ROUND, {"shape": "sphere", "radius": 0.02, "path": [[0.0, 0.04, 0.033], [0.09, 0.045, 0.012]]}])
def test_depth_is_that_of_all_points_of_the_surface_though_few_are_looked_at(obstacle):
    body = seen(body=FINE, **({"obstacle": obstacle} if obstacle else {}))
    poses = np.linspace(0, 1, 23)
    centres = body.centre(poses)
    every = [-Rigid(body.obstacle).shape.gap(body.surface - centre)[0].min() for centre in centres]
    assert np.array_equal(body.depth(poses), every) and len(body._near) < len(body.surface) / 2


def test_functions_about_the_touch_are_powers_of_the_way_from_it_under_a_bell():
    """At a node 5 mm, 5 mm aside of the touch on a plate of 10 mm: s^2 = 1/2, y = (1/2, 1/2, 0); of the widths 1/2, 1 and 2."""
    body = seen(body=FINE)
    degrees = powers(body.extent, 2, touched=True)
    about = degrees[degrees[:, 3] > 0]
    assert len(about) == 30 and (degrees[:len(degrees) - 30, 3] == 0).all() and about[:, :3].sum(axis=1).max() == 2
    node = int(np.argmin(np.linalg.norm(body.points - [0.065, 0.045, 0.01], axis=1)))
    bells = [np.exp(-1.0), np.exp(-0.25), np.exp(-0.0625)]
    by_hand = [bells[w - 1] * 0.5 ** (i + j) * 0.0**k for i, j, k, w in about]
    assert len(WIDTHS) == 3 and functions(body, degrees)[node, -30:] == pytest.approx(by_hand, abs=2e-3)  # as the touch, 2e-5 m
    alone = functions(body, powers(body.extent, 2))
    assert np.array_equal(functions(body, degrees)[:, :-30], alone)


def test_principal_combinations_count_by_what_functions_do():
    """Of two functions the first is ten times as large: 1 of it against 5 of the other; and what is found has a mean square of 1."""
    coefficients = np.zeros((2, 2, 3))
    coefficients[0, 0, 2], coefficients[1, 1, 2] = 1.0, 5.0
    found = principal(coefficients, np.ones(2), 1, np.diag([100.0, 1.0]))
    assert np.allclose(abs(found[0, :, 2]), [0.1, 0], atol=1e-12)
    assert np.allclose(abs(principal(coefficients, np.ones(2), 1)[0, :, 2]), [0, 1], atol=1e-12)


def test_shapes_about_the_touch_tell_what_those_of_the_box_leave_over():
    """One function of the box and two about the touch, the first of which has a product of 1/2 with that of the box: u is 3 of the box and
    0.1 of the last, which is what is left over, though the other moves more with u."""
    products = np.array([[1.0, 0.5, 0], [0.5, 1, 0], [0, 0, 1]])
    amounts = np.zeros((1, 3, 3))
    amounts[0, 0, 2], amounts[0, 2, 2] = 3.0, 0.1
    moments = np.einsum("mn,tnk->tmk", products, amounts)
    assert moments[0, 1, 2] > 10 * moments[0, 2, 2]
    square = np.einsum("tmk,tmk->t", amounts, moments)
    found = shapes_of([Fitted(np.zeros((1, 1)), np.ones(1), amounts[:, :1], products, moments, square)], 1, 1)
    assert np.allclose(abs(found[0]), [[0, 0, 1], [0, 0, 0], [0, 0, 0]], atol=1e-9)
    assert np.allclose(abs(found[1]), [[0, 0, 0], [0, 0, 0], [0, 0, 1]], atol=1e-6) and found.shape == (2, 3, 3)
    alone = Fitted(np.zeros((1, 1)), np.ones(1), amounts[:, :1], products[:1, :1], moments[:, :1], square)
    assert shapes_of([alone], 1, 0).shape == (1, 1, 3)
