"""Stationary flows: Kovasznay's, Poiseuille's through the outflow, a cylinder at Reynolds number 20, energy, a closed box."""

import numpy as np
import pytest

from physics.flow.conditions import Conditions, OpenEdges, conditions_of
from physics.flow.forces import Forces
from physics.flow.space import FlowSpace
from physics.flow.stationary import stationary
from physics.flow.stored import computed_mesh
from physics.scene import read_any
from tests.flows import channel_flow, given_all_around, norm, rectangle

RE = 40
LAMBDA = RE / 2 - np.sqrt(RE**2 / 4 + 4 * np.pi**2)


def kovasznay(x, t):
    grown = np.exp(LAMBDA * x[:, 0])
    across = 2 * np.pi * x[:, 1]
    return np.stack([1 - grown * np.cos(across), LAMBDA / (2 * np.pi) * grown * np.sin(across)], axis=1)


@pytest.mark.parametrize("order", (2, 3))
def test_kovasznays_flow_has_the_order_of_its_elements(order):
    errors, pressures = [], []
    for n in (6, 12):
        space = FlowSpace(rectangle(n, (-0.5, -0.5), (1.0, 0.5)), order)
        found = stationary(space, given_all_around(space, kovasznay), 1 / RE)
        errors.append(norm(space, found.u - kovasznay(space.velocity.points, 0)))
        pressures.append(float(np.std(found.p + np.exp(2 * LAMBDA * space.pressure.points[:, 0]) / 2)))
        assert found.residual < 1e-9
    assert np.log2(errors[0] / errors[1]) > order + 0.5
    assert np.log2(pressures[0] / pressures[1]) > order - 0.5


def test_a_manufactured_flow_with_a_source():
    """u = curl psi, psi = (x (1 - x) y (1 - y))^2, p = x^3 y, at Reynolds numbers where every term counts; in the space of order 3 to
    the fourth order."""
    nu = 0.05

    def parts(z):
        """A function f = (z (1 - z))^2 and its first three derivatives."""
        return z**2 - 2 * z**3 + z**4, 2 * z - 6 * z**2 + 4 * z**3, 2 - 12 * z + 12 * z**2, -12 + 24 * z

    def velocity(at, t):
        (f, df, _, _), (g, dg, _, _) = parts(at[:, 0]), parts(at[:, 1])
        return 100 * np.stack([f * dg, -df * g], axis=1)

    def source(at):
        x, y = at.T
        (f, df, ddf, dddf), (g, dg, ddg, dddg) = parts(x), parts(y)
        u, v = 100 * f * dg, -100 * df * g
        ux, uy, vx, vy = 100 * df * dg, 100 * f * ddg, -100 * ddf * g, -100 * df * dg
        lap = 100 * np.stack([ddf * dg + f * dddg, -(dddf * g + df * ddg)], axis=1)
        return np.stack([u * ux + v * uy, u * vx + v * vy], axis=1) + np.stack([3 * x**2 * y, x**3], axis=1) - nu * lap

    errors = []
    for n in (5, 10):
        space = FlowSpace(rectangle(n), 3)
        base = given_all_around(space, velocity)
        conditions = Conditions(base.fixed, base.values, base.open, lambda t, s=space: source(s.velocity.points))
        found = stationary(space, conditions, nu)
        off = found.p - space.pressure.points[:, 0] ** 3 * space.pressure.points[:, 1]
        errors.append((norm(space, found.u - velocity(space.velocity.points, 0)), float(np.std(off))))
    assert np.log2(errors[0][0] / errors[1][0]) > 3.5
    assert np.log2(errors[0][1] / errors[1][1]) > 2.5
    assert errors[1][0] < 2e-4


@pytest.mark.parametrize("order", (2, 3))
def test_poiseuilles_flow_leaves_through_the_outflow_as_it_came(order):
    """Quadratic velocity and linear pressure are in the spaces, so the answer is exact: p falls by 8 nu U / H^2 a metre to zero."""
    scene = read_any({"body": {"shape": "plate", "length": 2.0, "width": 0.5, "cells": [6, 3]}, "outflow": [{"where": "x-max"}],
                      "fluid": {"density": 2.0, "viscosity": 0.02, "order": order},
                      "inflow": [{"where": "x-min", "speed": 1.5}], "steps": {"stationary": True}})
    space = FlowSpace(computed_mesh(scene), order)
    found = stationary(space, conditions_of(scene, space), 0.01)
    y = space.velocity.points[:, 1]
    np.testing.assert_allclose(found.u[:, 0], 4 * 1.5 * y * (0.5 - y) / 0.25, atol=1e-9)
    np.testing.assert_allclose(found.u[:, 1], 0, atol=1e-9)
    np.testing.assert_allclose(found.p, 8 * 0.01 * 1.5 / 0.25 * (2 - space.pressure.points[:, 0]), atol=1e-8)


@pytest.mark.parametrize("density", (1.0, 1000.0))
def test_a_cylinder_at_reynolds_number_20(density):
    """Nabh's values, on 370 cells; the lift, a difference of two large numbers, to 3 %. Forces are of the density, coefficients not."""
    scene = channel_flow(body={"shape": "channel", "length": 2.2, "cell_size": 0.04, "hole_cell_size": 0.006},
                         fluid={"density": density, "viscosity": 1e-3 * density}, steps={"stationary": True})
    space = FlowSpace(computed_mesh(scene), scene.order)
    conditions = conditions_of(scene, space)
    found = stationary(space, conditions, 1e-3)
    forces = Forces(scene, scene.force, space, conditions.open)
    drag, lift = forces.force(found.u, found.p, np.zeros_like(found.u))
    assert drag / forces.scale == pytest.approx(5.57953523384, rel=3e-4)
    assert lift / forces.scale == pytest.approx(0.010618948146, rel=3e-2)
    assert forces.difference(found.p) == pytest.approx(0.11752016697 * density, rel=3e-3)
    assert drag == pytest.approx(5.57953523384 * 0.5 * density * 0.2**2 * 0.1, rel=3e-4)


def test_the_power_of_the_boundary_is_what_viscosity_and_the_outflow_take():
    """Test the equations with the velocity itself: convection is skew but for what passes the boundary, to the last digits."""
    scene = read_any({"body": {"shape": "plate", "length": 1.0, "width": 0.5, "cells": [10, 6]}, "outflow": [{"where": "x-max"}],
                      "fluid": {"density": 1.0, "viscosity": 0.01}, "wall": [{"where": "y-max", "velocity": [0.4, 0.0]}],
                      "inflow": [{"where": "x-min", "speed": 1.0, "profile": "table", "along": [0.0, 0.3, 1.0], "share": [0.0, 1.0, 0.0]}],
                      "steps": {"stationary": True}})
    space = FlowSpace(computed_mesh(scene), 3)
    conditions = conditions_of(scene, space)
    found = stationary(space, conditions, 0.01)
    stiffness = space.matrix(space.viscosity)
    reaction = 0.01 * (stiffness @ found.u) - space.momentum(found.u, np.zeros_like(found.u), found.p)
    power = (reaction * found.u)[conditions.fixed].sum()
    dissipation = 0.01 * (found.u * (stiffness @ found.u)).sum()
    outer, passed = space.mesh.boundary[0], 0.0
    edges = OpenEdges(space, outer)
    for u, normal in zip(found.u[edges.nodes], edges._normal, strict=True):
        s, w = np.polynomial.legendre.leggauss(8)
        basis = np.array([np.polyval(np.polyfit([0, 1 / 3, 2 / 3, 1], row, 3), (s + 1) / 2) for row in np.eye(4)])
        at = basis.T @ u
        passed += (w / 2 * (at @ normal) * (at**2).sum(axis=1) / 2).sum()
    assert abs(passed) > 1e-2
    assert power == pytest.approx(dissipation + passed, rel=1e-9)


def test_a_lid_drives_the_fluid_of_a_closed_box():
    """Botella and Peyret's extremes at Reynolds number 1000 need cells at the lid's corners; 16 x 16 moved towards the walls give 1 %."""
    scene = read_any({"body": {"shape": "plate", "length": 1.0, "width": 1.0, "cells": [32, 32]},
                      "fluid": {"density": 1.0, "viscosity": 1e-3},
                      "wall": [{"where": "y-max", "velocity": [1.0, 0.0]}], "steps": {"stationary": True}})
    mesh = computed_mesh(scene)
    mesh.points[:, :2] = (1 - np.cos(np.pi * mesh.points[:, :2])) / 2
    space = FlowSpace(mesh, 3)
    found = stationary(space, conditions_of(scene, space), 1e-3)
    middle = abs(space.velocity.points[:, 0] - 0.5) < 1e-9
    assert found.u[middle, 0].min() == pytest.approx(-0.3885698, rel=1e-2)
    level = abs(space.velocity.points[:, 1] - 0.5) < 1e-9
    assert found.u[level, 1].max() == pytest.approx(0.3769447, rel=1e-2)
    assert found.u[level, 1].min() == pytest.approx(-0.5270771, rel=1e-2)
