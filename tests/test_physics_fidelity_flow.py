"""The figures of a predicted flow, each wrong by a known amount, on Poiseuille flow and on waves behind a cylinder."""

import math
from dataclasses import replace

import numpy as np
import pytest

from physics.fidelity.flow import FlowReference, frequency, nothing_changes
from tests.flows import channel_flow
from tests.test_physics_currents import MU, H, L, U, channel

FRAMES, SPAN = 8, 0.025


@pytest.fixture(scope="module")
def truth():
    """Poiseuille flow whose speed and pressure are those of the scene in every frame, the fluid at rest in the first."""
    scene = channel(steps={"count": FRAMES, "duration": FRAMES * SPAN})
    of = FlowReference(np.zeros((1, 1, 2)), None, np.ones(1, bool), None, scene)._currents
    x, y = of.mesh.points[:, 0] - of.mesh.points[:, 0].min(), of.mesh.points[:, 1] - of.mesh.points[:, 1].min()
    u = np.stack([4 * U * y * (H - y) / H**2, 0 * y], axis=1)
    velocity = np.repeat(u[None], FRAMES + 1, axis=0)
    predicted = np.ones(len(u), bool)
    predicted[of.given] = False
    velocity[0, predicted] = 0
    pressure = np.repeat((8 * MU * U * (L - x) / H**2)[None], FRAMES + 1, axis=0)
    return FlowReference(velocity, pressure, predicted, of.mesh, scene, SPAN, 1)


def test_a_perfect_prediction_has_no_error_and_obeys_the_equations(truth):
    found = truth.verify(truth.velocity, truth.pressure)
    for name in ("velocity_rmse_1", "velocity_rmse_50", "velocity_rmse_all", "pressure_rmse_all", "drag_error", "lift_error",
                 "kinetic_energy_error"):
        assert getattr(found, name) == 0, name
    assert max(found.momentum_residual, found.slip, found.flux_error) < 1e-12
    assert found.divergence < 1e-10
    assert math.isnan(found.strouhal) and math.isnan(found.spectrum_error)


def test_a_tenth_too_fast_is_a_tenth_too_much_flux_and_a_fifth_too_much_energy(truth):
    """Frame 1 is shown, so the errors of frame 2 on count; of the parabola over all nodes that are predicted."""
    fast = truth.velocity.copy()
    fast[2:] *= 1.1
    found = truth.verify(fast, truth.pressure)
    inside = truth.velocity[1, truth.predicted]
    assert found.velocity_rmse_all == pytest.approx(0.1 * np.sqrt((inside**2).sum() / (2 * len(inside))))
    assert found.velocity_rmse_1 == found.velocity_rmse_50 == pytest.approx(found.velocity_rmse_all)
    assert found.flux_error == pytest.approx(0.1)
    assert found.kinetic_energy_error == pytest.approx(1.1**2 - 1)
    assert found.slip == pytest.approx(0.1 * U, rel=0.2)  # at the inlet, whose middle may lie between nodes
    assert found.worst_step == 2
    assert found.momentum_residual > 1e-3


def test_a_pressure_that_is_off_by_a_slope_is_missing_in_the_momentum_equation_alone(truth):
    tilted = truth.pressure + 0.3 * truth.mesh.points[:, 1]
    found = truth.verify(truth.velocity, tilted)
    assert found.velocity_rmse_all == found.kinetic_energy_error == 0
    assert found.pressure_rmse_all == pytest.approx(np.sqrt(np.mean((0.3 * truth.mesh.points[:, 1]) ** 2)))
    assert found.momentum_residual > 1e-2
    assert found.lift_error > 1e-3


def test_without_a_pressure_nothing_is_said_of_what_needs_one(truth):
    found = truth.verify(truth.velocity)
    nothing = ("pressure_rmse_50", "pressure_rmse_all", "momentum_residual", "drag_error", "lift_error", "strouhal")
    assert all(math.isnan(getattr(found, name)) for name in nothing)
    assert found.divergence < 1e-10 and found.flux_error < 1e-12
    alone = replace(truth, scene=None).verify(1.1 * truth.velocity)
    assert alone.velocity_rmse_all > 0 and math.isnan(alone.divergence)


def test_single_steps_count_from_the_frame_that_is_shown(truth):
    steps = truth.velocity[2:].copy()
    steps[:, truth.predicted] += [0.3, 0.4]
    assert truth.verify(truth.velocity, truth.pressure, steps).velocity_rmse_1 == pytest.approx(0.5 / np.sqrt(2))


def test_nothing_changes_keeps_what_is_shown_but_for_what_is_given():
    velocity = np.arange(24.0).reshape(4, 3, 2)
    found = nothing_changes(velocity, 1, np.array([True, False, True]))
    np.testing.assert_array_equal(found[:2], velocity[:2])
    np.testing.assert_array_equal(found[2:, 0], np.repeat(velocity[1:2, 0], 2, axis=0))
    np.testing.assert_array_equal(found[:, 1], velocity[:, 1])


def test_the_frequency_of_a_wave_is_found_between_frames():
    """0.071 periods a frame, on a drift of nothing; half of a period has none."""
    t = np.arange(100)
    assert frequency(3 + np.sin(2 * np.pi * 0.071 * t)) == pytest.approx(0.071, rel=2e-3)
    assert math.isnan(frequency(np.sin(2 * np.pi * 0.004 * t)))


def test_a_wake_of_another_amplitude_and_another_frequency_is_seen_in_the_spectrum():
    """A wave across of half the amplitude has half the spectrum: an error of 0.5; one of another frequency lies beside it: sqrt 2."""
    scene = channel_flow(steps={"count": 128, "duration": 1.28})
    mesh = FlowReference(np.zeros((1, 1, 2)), None, np.ones(1, bool), None, scene)._currents.mesh
    t = np.arange(129)[:, None]

    def wave(size, cycles):
        velocity = np.zeros((129, len(mesh.points), 2))
        velocity[..., 1] = size * np.sin(2 * np.pi * cycles * t / 64)
        return velocity

    reference = FlowReference(wave(1.0, 6), None, np.ones(len(mesh.points), bool), mesh, scene, 0.01, 0, 3)
    assert reference.verify(wave(0.5, 6)).spectrum_error == pytest.approx(0.5)
    assert reference.verify(wave(1.0, 14)).spectrum_error == pytest.approx(np.sqrt(2), rel=1e-2)
