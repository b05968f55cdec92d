"""The equations of a flow at stored nodes, held against Poiseuille's, whose every figure is known."""

import numpy as np
import pytest

from physics.fidelity.currents import BANDS, Currents
from physics.scene import read_any

L, H, U, RHO, MU = 2.0, 0.5, 0.7, 3.0, 0.2


def channel(**changes):
    """A plain rectangle, in from the left and out to the right, walls below and above."""
    table = {"body": {"shape": "plate", "length": L, "width": H, "cells": [9, 5]}, "fluid": {"density": RHO, "viscosity": MU},
             "inflow": [{"where": "x-min", "speed": U}], "outflow": [{"where": "x-max"}],
             "force": {"where": "y-min", "length": L, "speed": U}, "steps": {"count": 4, "duration": 0.1}}
    return read_any(table | changes)


@pytest.fixture(scope="module")
def poiseuille():
    """Currents, velocity (S, 2) 4 U y (H - y) / H^2 and pressure (S,) 8 mu U (L - x) / H^2."""
    of = Currents(channel())
    x, y = of.mesh.points[:, 0], of.mesh.points[:, 1]
    y = y - y.min()
    return of, np.stack([4 * U * y * (H - y) / H**2, 0 * y], axis=1), 8 * MU * U * (L - x + x.min()) / H**2


def test_poiseuille_flow_leaves_nothing_over_and_has_no_divergence(poiseuille):
    of, u, p = poiseuille
    forces = of.forces(u, p, 0 * u)
    scale = RHO * U**2 * np.sqrt(L * H)
    assert of.area == pytest.approx(L * H)
    assert of.residual(forces) < 1e-9 * scale
    assert of.divergence(u) < 1e-9 * U / H
    assert of.energy(u) == pytest.approx(RHO / 2 * U**2 * L * H * 8 / 15)


def test_the_drag_of_a_wall_is_viscosity_times_slope_times_length_and_its_lift_the_pressure_on_it(poiseuille):
    """mu 4 U / H L to the right; downwards the mean pressure 4 mu U L / H^2 over L. The functions of the wall's ends reach a cell of H / 3
    up the inlet, where their integral is a sixth of that, and bear the pressure there."""
    of, u, p = poiseuille
    drag, lift = of.on_place(of.forces(u, p, 0 * u))
    assert drag == pytest.approx(4 * MU * U / H * L - 8 * MU * U * L / H**2 * H / 3 / 6)
    assert lift == pytest.approx(-4 * MU * U * L / H**2 * L)


def test_what_flows_through_every_section_is_two_thirds_of_the_largest_speed(poiseuille):
    of, u, _ = poiseuille
    np.testing.assert_allclose(of.fluxes(np.array([u, 2 * u])), np.full((2, BANDS), 1) * 2 / 3 * U * H * np.array([[1], [2]]), rtol=1e-12)
    assert of.inflow(0.1) == pytest.approx(2 / 3 * U * H)
    x = of.mesh.points[:, 0] - of.mesh.points[:, 0].min()
    swelling = u * (1 + x / L)[:, None]  # two bands share each of five columns of cells
    np.testing.assert_allclose(of.fluxes(swelling[None])[0], 2 / 3 * U * H * (1 + (np.arange(BANDS) // 2 + 0.5) / 5), rtol=1e-12)


def test_a_body_force_that_is_not_there_is_the_residual():
    """At rest with the rate (a, 0): R(v) = rho a (1, v_x), whose norm over functions that vanish all around is that of the torsion of a
    bar, rho a sqrt(T), T = 0.0351 s^4 for a square of side s (Timoshenko: 0.1406 s^4 / 4)."""
    closed = {"inflow": [], "outflow": [], "body": {"shape": "plate", "length": H, "width": H, "cells": [16, 16]}, "force": None}
    of = Currents(read_any({key: value for key, value in {**TABLE, **closed}.items() if value is not None}))
    rest = np.zeros((len(of.mesh.points), 2))
    forces = of.forces(rest, np.zeros(len(rest)), rest + [2.0, 0.0])
    assert of.residual(forces) == pytest.approx(RHO * 2.0 * np.sqrt(0.1406 / 4 * H**4), rel=2e-3)
    assert np.isnan(of.on_place(forces)).all() and np.isnan(of.fluxes(rest[None])).all()


TABLE = {"fluid": {"density": RHO, "viscosity": MU}, "steps": {"count": 4, "duration": 0.1}}


def test_divergence_is_that_of_a_velocity_that_has_some():
    """(3 x, -x) has 3 everywhere, whatever its curl."""
    of = Currents(channel())
    x = of.mesh.points[:, 0]
    assert of.divergence(np.stack([3 * x, -x], axis=1)) == pytest.approx(3.0)
