"""A stored flow at other points: quadratic functions on straight and curved cells come back exactly."""

import numpy as np
import pytest

from physics.fidelity.carried import reader
from physics.fidelity.currents import Currents
from tests.flows import channel_flow
from tests.test_physics_currents import H, L, channel


def test_a_quadratic_function_on_straight_cells_is_read_off_exactly():
    points = np.random.default_rng(0).uniform([0, -H / 2], [L, H / 2], (40, 2))
    mesh = Currents(channel()).mesh
    points += mesh.points[:, :2].min(axis=0) - [0, -H / 2]

    def function(x):
        return 1 + x[:, 0] - 2 * x[:, 1] + 3 * x[:, 0] ** 2 - x[:, 0] * x[:, 1] + 5 * x[:, 1] ** 2

    found = reader(channel(), points) @ function(mesh.points)
    np.testing.assert_allclose(found, function(points), rtol=1e-10)


def test_places_around_a_round_hole_are_read_off_to_the_error_of_a_parabola_for_an_arc():
    """Positions at the nodes of curved cells stand for the quadratic map itself, so places come back as places."""
    scene = channel_flow()
    nodes = Currents(scene).mesh.points[:, :2]
    (x, y), r = scene.body.hole_centre, scene.body.hole_radius
    angle = np.linspace(0, 2 * np.pi, 37)[:-1]
    for out in (1.0, 1.05, 1.5):
        around = np.stack([x + out * r * np.cos(angle), y + out * r * np.sin(angle)], axis=1)
        np.testing.assert_allclose(reader(scene, around) @ nodes, around, atol=1e-4 * r)


def test_at_the_stored_nodes_it_is_the_identity():
    scene = channel_flow()
    nodes = Currents(scene).mesh.points[:, :2]
    values = np.random.default_rng(1).normal(size=len(nodes))
    np.testing.assert_allclose(reader(scene, nodes) @ values, values, atol=1e-9)
    with pytest.raises(ValueError, match="dimension"):
        reader(scene, nodes) @ values[:-1]
