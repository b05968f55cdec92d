"""The force on a wall and the pressure between two points, on flows that are in the spaces: Poiseuille's, a uniform rate, linear
pressures."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from physics import solve_flow
from physics.flow.forces import Forces
from physics.flow.space import FlowSpace
from physics.flow.stored import computed_mesh
from physics.mesh.build import build_mesh
from physics.scene import Body, read_any
from physics.scene.flow import Force
from physics.schema import InputError
from tests.flows import channel_flow

L, H, U, RHO, MU = 2.0, 0.6, 0.7, 3.0, 0.2
ACROSS = 3  # cells
NONE = np.empty((0, 2), np.int64)


def plate(order=2):
    """2 x 0.6 m from the origin on, 4 x 3 rectangles cut in two."""
    mesh = build_mesh(Body(shape="plate", length=L, width=H, cells=(4, ACROSS), cell="triangle"))
    return FlowSpace(replace(mesh, points=mesh.points - mesh.points.min(axis=0)), order)


def forces_of(space, leaves=None, **of):
    edges = space.mesh.facets(leaves)[0] if leaves else NONE
    return Forces(SimpleNamespace(fluid=SimpleNamespace(density=RHO, viscosity=MU)), Force(**{"where": "y-min"} | of), space, edges)


@pytest.mark.parametrize("order", (2, 3))
@pytest.mark.parametrize("leaves", (True, False))
def test_the_force_of_poiseuille_flow_on_its_lower_wall(order, leaves):
    """mu 4 U / H L along it, the mean pressure times L downwards; not what the inlet bears at the wall's first node."""
    space = plate(order)
    y, x = space.velocity.points[:, 1], space.pressure.points[:, 0]
    u = np.stack([4 * U * y * (H - y) / H**2, 0 * y], axis=1)
    p = 8 * MU / RHO * U * (L - x) / H**2
    drag, lift = forces_of(space, leaves="x-max" if leaves else None).force(u, p, np.zeros_like(u))
    assert drag == pytest.approx(4 * MU * U / H * L, rel=1e-12)
    assert lift == pytest.approx(-4 * MU * U * L / H**2 * L, rel=1e-12)


@pytest.mark.parametrize("cells", ([20, 8], [40, 16]))
def test_the_drag_on_the_wall_of_a_channel_is_its_shear_times_its_length(cells):
    scene = read_any({"body": {"shape": "plate", "length": 2.0, "width": 0.4, "cells": cells, "cell": "triangle"},
                      "fluid": {"density": 1.0, "viscosity": 0.01}, "inflow": [{"where": "x-min", "speed": 1.0}],
                      "outflow": [{"where": "x-max"}], "force": {"where": "y-min"}, "steps": {"stationary": True}})
    assert solve_flow(scene).per_frame["drag"][-1] == pytest.approx(0.01 * 4 * 1.0 / 0.4 * 2.0, rel=1e-8)


def test_a_wall_between_walls_bears_its_own_share_alone():
    """u = (y, x) with p = -(x^2 + y^2) / 2 solves the equations. On y = 0: mu du_x/dy L along it, -density p downwards."""
    space = plate(3)
    u, (x, y) = space.velocity.points[:, ::-1].copy(), space.pressure.points.T
    found = forces_of(space).force(u, -(x**2 + y**2) / 2, np.zeros_like(u))
    np.testing.assert_allclose(found, [MU * L, RHO * L**3 / 6], rtol=1e-12)


@pytest.mark.parametrize("order", (2, 3))
def test_half_of_a_round_wall_bears_its_own_share_alone(order):
    """Of u = (y, x), whose convection its rate balances, and an even pressure; the integral of n is that of the line between the ends."""
    mesh = computed_mesh(channel_flow(body={"shape": "channel", "length": 0.8, "cell_size": 0.08, "hole_cell_size": 0.03}))
    hole = mesh.place("hole")
    mesh = replace(mesh, places=mesh.places | {"front": hole[mesh.points[hole, 0] < 0.2 + 1e-9]})
    space, edges = FlowSpace(mesh, order), mesh.facets("front")[0]
    x, p = space.velocity.points, np.full(len(space.pressure.points), 0.3)
    along = np.diff(mesh.points[edges][..., :2], axis=1)[:, 0].sum(axis=0)
    normal = np.array([along[1], -along[0]])  # times the length; the fluid is on the left of an outer edge
    assert mesh.middles and 0 < len(edges) < len(mesh.facets("hole")[0]) and normal[0] > 0.07
    found = forces_of(space, where="front").force(x[:, ::-1].copy(), p, -x)
    np.testing.assert_allclose(found, RHO * 0.3 * normal - MU * normal[::-1], rtol=1e-9)


def test_fluid_that_comes_back_through_the_outflow_does_not_pull_on_the_wall_beside_it():
    """Uniform, from right to left: the outflow takes (u . n)_- u / 2, which the pressure -u^2 / 2 balances."""
    space = plate()
    u = np.tile([-U, 0.0], (len(space.velocity.points), 1))
    found = forces_of(space, leaves="x-max").force(u, np.full(len(space.pressure.points), -U**2 / 2), np.zeros_like(u))
    np.testing.assert_allclose(found, [0, RHO * U**2 / 2 * L], atol=1e-12)


def test_fluid_that_is_sped_up_pulls_back_on_the_wall_with_the_mass_of_its_functions():
    """At rest with the rate (2, -5): of quadratic functions on a triangle those of an edge's middle have a third of the area, corners none;
    each edge of the wall has one triangle, half of L / 4 x H / 3."""
    space = plate()
    rest, mass = np.zeros((len(space.velocity.points), 2)), RHO * 4 * (L / 4 * H / ACROSS / 2) / 3
    found = forces_of(space).force(rest, np.zeros(len(space.pressure.points)), rest + [2.0, -5.0])
    np.testing.assert_allclose(found, [-2 * mass, 5 * mass], rtol=1e-12)


@pytest.mark.parametrize("length, speed, scale", [(0.5, 0.4, 0.5 * RHO * 0.16 * 0.5), (None, 0.4, None), (0.5, None, None)])
def test_a_coefficient_is_over_the_dynamic_pressure_times_the_length(length, speed, scale):
    assert forces_of(plate(), length=length, speed=speed).scale == (scale if scale is None else pytest.approx(scale, rel=1e-12))


@pytest.mark.parametrize("order", (2, 3))
@pytest.mark.parametrize("first, second", [
    ((0.5, 0.2), (1.5, 0.4)),  # corners of cells
    ((0.31, 0.17), (1.93, 0.52)),  # inside
    ((0.5 + 2e-6, 0.2 - 2e-6), (0.5, 0.2 + 1e-6)),  # beside a corner, which counts from a thousand-millionth on
    ((0.0, 0.05), (2.0, 0.6)),  # on the boundary
    ((0.25, 0.1), (1.13, 0.0))])
def test_the_pressure_difference_is_that_of_the_two_points(order, first, second):
    space = plate(order)
    x, y = space.pressure.points.T
    found = forces_of(space, points=(first, second)).difference(2 * x - 7 * y)
    assert found == pytest.approx(RHO * (2 * (first[0] - second[0]) - 7 * (first[1] - second[1])), rel=1e-9, abs=1e-13)
    if order == 3:
        quadratic = forces_of(space, points=(first, second)).difference(x * y + y**2)
        assert quadratic == pytest.approx(RHO * (first[0] * first[1] + first[1] ** 2 - second[0] * second[1] - second[1] ** 2), rel=1e-6)


def test_a_point_that_is_a_node_but_for_rounding_has_that_nodes_pressure():
    space = plate()
    p = np.zeros(len(space.pressure.points))
    p[np.hypot(*(space.pressure.points - [0.5, 0.2]).T) < 1e-9] = 1e12
    assert forces_of(space, points=((0.5 + 1e-10, 0.2), (1.5, 0.4))).difference(p) == RHO * 1e12


def test_points_in_curved_cells_have_the_pressure_there():
    """Between the parabola of a side on the hole and its chord lie points that no straight cell holds, and some that no curved one does.
    Pressures of order 2 on cells of order 2 are exact for linear ones."""
    scene = channel_flow(body={"shape": "channel", "length": 0.8, "cell_size": 0.08, "hole_cell_size": 0.03})
    space = FlowSpace(computed_mesh(scene), 3)
    p = space.pressure.points @ [3.0, -1.0]
    for chord in space.mesh.points[space.mesh.facets("hole")[0]][:4, :, :2].mean(axis=1):
        out = (0.05 / np.hypot(*(chord - 0.2)) - 1) * (chord - 0.2)  # from the chord to the circle
        with pytest.raises(InputError, match=r"^force\.points: .* m is not inside of the fluid$"):
            Forces(scene, replace(scene.force, points=(tuple(chord + 0.5 * out), (0.5, 0.2))), space, NONE)
        near = chord + 1.5 * out
        found = Forces(scene, replace(scene.force, points=((0.5, 0.2), tuple(near))), space, NONE).difference(p)
        assert found == pytest.approx(3 * (0.5 - near[0]) - (0.2 - near[1]), rel=1e-8)


@pytest.mark.parametrize("point", [(2.0 + 1e-6, 0.3), (-1e-6, 0.3), (1.0, 0.6 + 1e-6), (1.0, -1e-6), (5.0, 5.0)])
def test_a_point_outside_of_the_fluid_is_refused(point):
    with pytest.raises(InputError, match=r"^force\.points: .* m is not inside of the fluid$"):
        forces_of(plate(), points=((1.0, 0.3), point))


def test_a_place_that_is_none_or_has_no_edge_is_refused_and_without_points_there_is_no_difference():
    space = plate()
    assert forces_of(space).difference(space.pressure.points[:, 0]) is None
    with pytest.raises(InputError, match=r"^force\.where: no place named 'nowhere'"):
        forces_of(space, where="nowhere")
