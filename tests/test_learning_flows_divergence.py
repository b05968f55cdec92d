"""The divergence taken out of a frame: nothing is left of it, what is given stays, and no nearer velocity has as little."""

import numpy as np
import pytest

from datagen.flow.figures import predicted_nodes
from datagen.flow.trajectory import flow_trajectory
from learning.flows.divergence import without_divergence
from physics.fidelity.currents import Currents
from physics.flow.solution import solve_flow
from physics.flow.space import FlowSpace
from physics.flow.stored import computed_mesh
from tests.flows import channel_flow


@pytest.fixture(scope="module")
def flow():
    """A scene, the nodes inside and at the outflow, a velocity that was solved and the same disturbed at them."""
    scene = channel_flow()
    trajectory = flow_trajectory(scene, solve_flow(scene))
    predicted = predicted_nodes(trajectory)
    true = trajectory.fields["velocity"][-1, :, :2].astype(float)
    noise = np.random.default_rng(0).normal(size=true.shape) * 0.01 + [0.02, 0.0]
    return scene, predicted, true, true + np.where(predicted[:, None], noise, 0.0)


def test_what_is_left_has_no_divergence_and_the_flux_of_the_inflow(flow):
    scene, predicted, true, disturbed = flow
    freed = without_divergence(scene, predicted)(disturbed)
    of = Currents(scene)
    assert of.divergence(freed) < 1e-10 < 0.01 * of.divergence(true) < 0.01 * of.divergence(disturbed)
    inflow = of.inflow(scene.steps.duration)
    assert abs(of.fluxes(disturbed) - inflow).max() > 5 * abs(of.fluxes(freed) - inflow).max()
    np.testing.assert_array_equal(freed[~predicted], disturbed[~predicted])


def test_it_is_the_nearest_such_velocity_and_nearer_to_the_truth(flow):
    """The change is at right angles, in the norm of the mass matrix's diagonal, to every difference of velocities without divergence."""
    scene, predicted, true, disturbed = flow
    take = without_divergence(scene, predicted)
    freed, other = take(disturbed), take(true)
    space = FlowSpace(computed_mesh(scene), 2)
    weight = space.matrix(space.mass).diagonal()[:, None]
    product = (weight * (disturbed - freed) * (freed - other)).sum()
    lengths = [np.sqrt((weight * step**2).sum()) for step in (disturbed - freed, freed - other)]
    assert abs(product) < 1e-10 * np.prod(lengths) and min(lengths) > 1e-4
    assert np.linalg.norm(freed - true) < 0.8 * np.linalg.norm(disturbed - true)
    np.testing.assert_allclose(take(freed), freed, atol=1e-12)


def test_a_scene_of_order_two_stores_no_quadratic_functions():
    scene = channel_flow(fluid={"density": 1.0, "viscosity": 1e-3, "order": 2})
    assert without_divergence(scene, np.zeros(1, bool)) is None
