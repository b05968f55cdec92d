"""Steps in time: Taylor and Green's vortex, the coupled scheme, energy, a changed step, an outflow with vortices."""

from dataclasses import replace

import numpy as np
import pytest

from physics.flow.conditions import Conditions, conditions_of
from physics.flow.frames import advance
from physics.flow.space import FlowSpace
from physics.flow.stepping import Memory, Stepper
from physics.flow.stored import computed_mesh
from tests.flows import Coupled, channel_flow, given_all_around, norm, rectangle, started, vortex

NU = 0.02


def order_of(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


@pytest.mark.parametrize("order", (2, 3))
def test_a_vortex_decays_with_the_order_of_its_elements_in_space(order):
    """Velocity of order k + 1 in L2, pressure of order k; on moved nodes to within half an order."""
    velocity, pressure = vortex(0.2)
    errors, pressures, sides = [], [], (7, 15)
    for n in sides:
        space = FlowSpace(rectangle(n, (-1, -1), (1, 1), seed=1), order)
        stepper = started(space, given_all_around(space, velocity), 0.2, velocity, pressure)
        stepper.advance(0.1, 160)
        off = stepper.memory.p - pressure(space.pressure.points, 0.1)
        errors.append(norm(space, stepper.memory.u - velocity(space.velocity.points, 0.1)))
        pressures.append(float(np.std(off)))
    ratio = np.log(sides[1] / sides[0])
    assert np.log(errors[0] / errors[1]) / ratio > order + 0.5
    assert np.log(pressures[0] / pressures[1]) / ratio > order - 0.5


def test_a_vortex_decays_with_order_two_in_time_and_as_the_coupled_scheme_does():
    """On one mesh, against a run of small steps; the splitting's own error shrinks as fast."""
    velocity, pressure = vortex(NU)
    space = FlowSpace(rectangle(5, (-1, -1), (1, 1), seed=1), 3)
    conditions = given_all_around(space, velocity)

    def run(steps):
        stepper = started(space, conditions, NU, velocity, pressure)
        stepper.advance(0.5, steps)
        return stepper.memory

    fine, errors, pressures, gaps = run(320), [], [], []
    for steps in (20, 40, 80):
        coarse = run(steps)
        coupled = Coupled(space, conditions, NU, velocity(space.velocity.points, 0.0))
        for _ in range(steps):
            coupled.step(0.5 / steps)
        errors.append(norm(space, coarse.u - fine.u))
        pressures.append(float(np.std(coarse.p - fine.p)))
        gaps.append(norm(space, coupled.u - coarse.u))
    assert order_of(errors).min() > 1.8
    assert order_of(pressures).min() > 1.8
    assert order_of(gaps).min() > 1.8
    assert gaps[-1] < 1e-3 * norm(space, fine.u)


def test_the_splitting_tends_to_the_coupled_scheme_where_fluid_leaves():
    """A channel with a cylinder: velocity, pressure at the outflow too, and the divergence against every pressure."""
    scene = channel_flow()
    space = FlowSpace(computed_mesh(scene), scene.order)
    conditions = conditions_of(scene, space)
    nodes = len(space.velocity.points)
    gaps, outlet = [], space.pressure.points[:, 0] > 0.8 - 1e-9
    for steps in (20, 40, 80):
        stepper = Stepper(space, conditions, 1e-3, Memory(0.0, np.zeros((nodes, 2)), np.zeros(len(space.pressure.points))))
        stepper.advance(0.2, steps)
        coupled = Coupled(space, conditions, 1e-3, np.zeros((nodes, 2)))
        for _ in range(steps):
            coupled.step(0.2 / steps)
        gaps.append((norm(space, coupled.u - stepper.memory.u), abs(coupled.p - stepper.memory.p)[outlet].max(), stepper.divergence()))
    speed, force = norm(space, coupled.u), abs(coupled.p).max()
    assert gaps[2][0] < 2e-4 * speed
    assert gaps[2][1] < 5e-3 * force
    assert gaps[2][0] < gaps[1][0] / 2 < gaps[0][0] / 4
    assert gaps[2][2] < gaps[1][2] < gaps[0][2]


def test_the_first_step_has_the_pressure_of_an_impulsive_start_to_the_end():
    """Backward Euler's coupled step, velocity and pressure, to the tolerance of conjugate gradients."""
    scene = channel_flow(inflow=[{"speed": 0.3}])
    space = FlowSpace(computed_mesh(scene), scene.order)
    conditions = conditions_of(scene, space)
    rest = np.zeros((len(space.velocity.points), 2))
    stepper = Stepper(space, conditions, 1e-3, Memory(0.0, rest, np.zeros(len(space.pressure.points))))
    stepper.advance(0.01, 1)
    coupled = Coupled(space, conditions, 1e-3, rest)
    coupled.step(0.01)
    assert norm(space, stepper.memory.u - coupled.u) < 1e-8 * norm(space, coupled.u)
    assert abs(stepper.memory.p - coupled.p).max() < 1e-7 * abs(coupled.p).max()
    assert stepper.divergence() < 1e-8


def test_energy_goes_where_viscosity_takes_it():
    """No flow through the walls: the energy lost is nu times the integral of |grad u|^2, to the second order of the step."""
    space = FlowSpace(rectangle(6, seed=4), 3)
    x = space.velocity.points
    bubble = (x * (1 - x)).prod(axis=1)
    u = np.stack([bubble * (1 - 2 * x[:, 1]) * x[:, 0] * (1 - x[:, 0]), -bubble * (1 - 2 * x[:, 0]) * x[:, 1] * (1 - x[:, 1])], axis=1) * 60
    conditions = replace(given_all_around(space, lambda at, t: np.zeros_like(at)))
    viscosity, misses = space.matrix(space.viscosity), []
    for steps in (40, 80):
        stepper = Stepper(space, conditions, NU, Memory(0.0, u, np.zeros(len(space.pressure.points))))
        stepper.advance(0.1, steps)
        energies, losses = [stepper.energy()], [NU * (stepper.memory.u * (viscosity @ stepper.memory.u)).sum()]
        for k in range(1, steps + 1):
            stepper.advance(0.1 + 0.1 * k / steps, 1)
            energies.append(stepper.energy())
            losses.append(NU * (stepper.memory.u * (viscosity @ stepper.memory.u)).sum())
        lost = 0.1 / steps * (sum(losses) - (losses[0] + losses[-1]) / 2)
        misses.append(abs(energies[0] - energies[-1] - lost) / lost)
        assert (np.diff(energies) < 0).all()
    assert misses[0] < 2e-3
    assert misses[0] / misses[1] > 3


def test_a_step_of_another_size_goes_on_with_the_same_order():
    """Three sizes on the way are no worse than the largest of them alone, and no better than the smallest."""
    velocity, pressure = vortex(NU)
    space = FlowSpace(rectangle(5, (-1, -1), (1, 1), seed=1), 3)
    conditions = given_all_around(space, velocity)

    def run(*legs):
        stepper = started(space, conditions, NU, velocity, pressure)
        for until, steps in legs:
            stepper.advance(until, steps)
        return stepper.memory.u

    fine = run((0.6, 480))
    mixed, large = norm(space, run((0.2, 20), (0.4, 10), (0.6, 16)) - fine), norm(space, run((0.6, 30)) - fine)
    assert mixed < 1.1 * large
    assert norm(space, run((0.2, 40), (0.4, 20), (0.6, 32)) - fine) < mixed / 3


@pytest.mark.slow
def test_vortices_that_leave_bring_no_energy_back():
    """A pair of vortices is pushed out; with the remedy for backflow the energy falls, without it the same run gains what comes in."""
    mesh = rectangle(10, seed=None)
    space = FlowSpace(mesh, 3)
    outer = mesh.boundary[0]
    x = space.velocity.points
    out = outer[(mesh.points[outer, 0] > 1 - 1e-9).all(axis=1)]
    fixed = space.velocity.on_edges(mesh, outer[~(mesh.points[outer, 0] > 1 - 1e-9).all(axis=1)])
    strong = np.sin(np.pi * x[:, 1]) ** 2 * np.sin(np.pi * x[:, 0] / 2) ** 2
    u = 3 * np.stack([strong * np.cos(2 * np.pi * x[:, 1]), np.zeros(len(x))], axis=1)
    conditions = Conditions(fixed, lambda t: np.zeros((len(fixed), 2)), out)
    stepper = Stepper(space, conditions, 1e-3, Memory(0.0, u, np.zeros(len(space.pressure.points))))
    energies = []
    for k in range(1, 26):
        advance(stepper, 0.02 * k)
        energies.append(stepper.energy())
    assert np.isfinite(energies).all()
    assert (np.diff(energies) < 1e-9).all()
