"""One step of time, part by part: its equations, how it begins, how long it may be, what it leaves behind."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse

from physics.body.elasticity import Elasticity
from physics.equilibrium.newton import TOLERANCE
from physics.equilibrium.state import HALVINGS, NoEquilibrium, State
from physics.mesh.build import build_mesh
from physics.motion import dynamics
from physics.motion.dynamics import Motion, Moving
from physics.solution import solve
from tests.scenes import beam

BLOCK = {"length": 0.02, "width": 0.03, "height": 0.04, "cells": [1, 2, 1], "cell": "hexahedron"}
MASS = 1000 * 0.02 * 0.03 * 0.04  # 0.024 kg
SVK = {"law": "saint-venant-kirchhoff", "young_modulus": 1e5, "poisson_ratio": 0.3}
RNG = np.random.default_rng(4)


def motion(*, duration=0.5, count=10, velocity=None, **changes):
    steps = {"dynamic": True, "duration": duration, "count": count} | ({"velocity": list(velocity)} if velocity else {})
    scene = beam(**({"body": BLOCK, "material": SVK, "support": [], "steps": steps} | changes))
    return Motion(scene, build_mesh(scene.body))


def node_masses(mesh):
    """An eighth of each hexahedron's for each of its nodes; all of the block's are 12 g."""
    return MASS / 16 * np.bincount(mesh.cells.ravel())


def test_forces_are_those_of_the_steps_equations():
    """f' by five Gauss points, which are as exact as two for forces of the third degree; M by shares of cells."""
    made = motion()
    body, points = made.body, made.balance.mesh.points
    moving = Moving(body)
    start, velocity, end = (RNG.normal(scale=scale, size=points.shape) for scale in (2e-3, 0.1, 2e-3))
    outer = RNG.normal(size=points.shape)
    moving.begin(start, velocity, outer, 0.02)
    at, weight = np.polynomial.legendre.leggauss(5)
    inner = sum(w / 2 * body.force(start + (1 + s) / 2 * (end - start)) for s, w in zip(at, weight, strict=True))
    mass = node_masses(made.balance.mesh)[:, None]
    assert moving.node_mass == pytest.approx(mass)
    after = 2 * (end - start) / 0.02 - velocity  # (u1 - u0) / h = (v0 + v1) / 2
    assert moving.force(end) == pytest.approx(inner - outer + mass * (after - velocity) / 0.02, rel=1e-9)
    # Its work is the change of the stored energy.
    assert (inner * (end - start)).sum() == pytest.approx(body.energy(end) - body.energy(start), rel=1e-9)


def whole(body, u):
    start, column, value = body.stiffness(u).getValuesCSR()
    return scipy.sparse.csr_matrix((value, column, start)).toarray()


def test_stiffness_is_half_the_bodys_and_two_masses_over_h_squared():
    scene = beam(body=BLOCK, material=SVK)
    mesh = build_mesh(scene.body)
    body = Elasticity(mesh, scene.material, np.zeros(mesh.points.shape, bool))
    u = RNG.normal(scale=1e-3, size=mesh.points.shape)
    moving = Moving(body)
    moving.begin(u, u, u, 0.02)
    masses = body.space.to_dofs(np.repeat(node_masses(mesh)[:, None], 3, axis=1))
    expected = whole(body, u) / 2 + np.diag(masses) * 2 / 0.02**2
    assert whole(moving, u) == pytest.approx(expected, rel=1e-9, abs=1e-9 * abs(expected).max())
    assert whole(body, u) == pytest.approx(2 * (expected - np.diag(masses) * 2 / 0.02**2), rel=1e-9, abs=1e-9 * abs(expected).max())


def test_how_a_motion_begins():
    load = [{"where": "x-max", "traction": [7.0, 0.0, 0.0]}, {"where": "z-max", "traction": [0.0, 0.0, -2.0], "sudden": True},
            {"acceleration": [0.0, 3.0, 0.0], "sudden": True}, {"acceleration": [0.0, 0.0, 5.0]}]
    support = [{"where": "x-min", "fixed": "xz", "displacement": [0.001, 0.0, 0.004]}]
    made = motion(load=load, support=support, velocity=(1.0, 2.0, 3.0))
    assert made.sudden.sum(axis=0) == pytest.approx([0, 3 * MASS, -2 * 0.02 * 0.03])
    assert made.growing.sum(axis=0) == pytest.approx([7 * 0.03 * 0.04, 0, 5 * MASS])
    assert not made.balance.load.any() and not made.newton.round_obstacle
    left = made.balance.mesh.points[:, 0] < 1e-9
    assert made.velocity == pytest.approx(np.where(left[:, None], [0.002, 2.0, 0.008], [1.0, 2.0, 3.0]))  # led for half a second
    assert made.pull(0.0, 0.1) == pytest.approx(np.where(left[:, None], [0.002, 0, 0.008], 0.0))
    assert made._largest == pytest.approx(max(np.linalg.norm(made.sudden), np.linalg.norm(made.growing)))
    assert made.kinetic_energy == pytest.approx((made.moving.node_mass * made.velocity**2).sum() / 2)
    assert not motion().velocity.any()
    assert (made.order, made.halvings, made.moving.factored_h, len(made.states), made.states[0].fraction) == (0, 0, 0.0, 1, 0.0)


def test_a_body_that_nothing_holds_moves_as_newton_says():
    """Sudden g along z and a load that grows to a along y: v_y = a t^2 / (2 T) at each step, exactly; u by the trapezoidal rule."""
    g, a, T = -9.81, 6.0, 0.5
    made = motion(load=[{"acceleration": [0.0, 0.0, g], "sudden": True}, {"acceleration": [0.0, a, 0.0]}], velocity=(0.3, 0.0, 1.0))
    times = np.array([0.0, 0.1, 0.15, 0.3, 0.5])  # of unlike lengths
    speed = np.stack([0 * times + 0.3, a * times**2 / (2 * T), 1.0 + g * times], axis=1)
    way = np.concatenate([[np.zeros(3)], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(times)[:, None], axis=0)])
    for k in range(1, 5):
        state = made.advance(times[k] / T)
        assert state.u == pytest.approx(np.tile(way[k], (12, 1)), abs=1e-9)
        assert made.velocity == pytest.approx(np.tile(speed[k], (12, 1)), abs=1e-7)
    assert made.halvings == 0 and len(made.states) == 4
    frame = made.frame()
    assert frame["kinetic_energy"] == pytest.approx(MASS / 2 * (speed[-1] ** 2).sum())
    assert frame["energy"] == pytest.approx(0, abs=1e-9) and frame["snap"] == frame["released"] == 0
    assert np.array_equal(frame["displacement"], state.u)


def test_held_components_move_as_they_are_led():
    made = motion(support=[{"where": "x-min", "fixed": "xyz", "displacement": [0.0, 0.0, 0.01]}], duration=2.0)
    left = made.balance.mesh.places["x-min"]
    for fraction in (0.25, 0.5):
        state = made.advance(fraction)
        assert state.u[left] == pytest.approx(np.tile([0, 0, 0.01 * fraction], (len(left), 1)), abs=1e-15)
        assert made.velocity[left] == pytest.approx(np.tile([0, 0, 0.005], (len(left), 1)), abs=1e-15)


def plate(thickness, path=((0.01, 0.015, -0.2),)):
    return {"shape": "box", "size": [0.5, 0.5, thickness], "path": [list(p) for p in path]}


@pytest.mark.parametrize("thickness, way, speed, allowed", [
    (0.006, 0.0, 1.0, 0.003),  # half of the plate, at 1 m/s
    (0.006, 0.0, 4.0, 0.00075),
    (0.5, 0.0, 1.0, 0.01),  # of a thick one half of the body's smallest extent
    (0.006, 0.002, 1.0, 0.001),  # the obstacle takes two thirds of it
    (0.006, 0.0031, 0.0, 0.0)])
def test_steps_are_so_short_that_body_and_obstacle_cannot_pass_through_each_other(thickness, way, speed, allowed):
    path = ((0.01, 0.015, -0.4), (0.01, 0.015, -0.4 - 2 * way))
    made = motion(obstacle=plate(thickness, path), velocity=(0.0, 0.0, -speed))
    made.velocity = made.velocity * np.linspace(0.2, 1, 12)[:, None]  # the fastest node counts
    assert made._too_far(0.0, 0.5, allowed * 1.01 + 1e-9)
    if allowed:
        assert not made._too_far(0.0, 0.5, allowed * 0.99)
    assert not motion(velocity=(0.0, 0.0, -9.0))._too_far(0.0, 0.5, 100.0)


def test_a_body_thrown_in_one_step_does_not_pass_through_a_thin_plate():
    """80 mm in one step, from above a plate of 4 mm to far below it: stopped on it all the same, by the body's own speed."""
    steps = {"dynamic": True, "duration": 0.02, "count": 1, "velocity": [0.0, 0.0, -4.0]}
    body = {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [2, 2, 2]}
    still = {"shape": "box", "size": [0.1, 0.1, 0.004], "path": [[0.01, 0.01, -0.02]]}
    solution = solve(beam(body=body, support=[], obstacle=still, steps=steps))
    assert not solution.failure
    z = (solution.mesh.points + solution.displacement[-1])[:, 2]
    assert z.min() > -0.0181
    # The motion of one layer of nodes, a quarter of its mass, may be lost, each time that one of its six faces strikes; no energy is made.
    assert 0.4 * 0.008 / 2 * 16 < solution.kinetic_energy[-1] + solution.energy[-1] < 0.008 / 2 * 16


def test_a_block_that_is_struck_takes_all_its_momentum_and_at_most_the_work():
    """A block in flight, struck from below by a floor that rises at 2 m/s: impulses are changes of momentum, work bounds energy."""
    floor = {"shape": "half-space", "normal": [0.0, 0.6, 0.8], "path": [[0.0, 0.0, -0.001], [0.0, 0.0, 0.019]]}
    body = {"length": 0.02, "width": 0.03, "height": 0.04, "cells": [1, 2, 2], "cell": "hexahedron"}
    made = motion(body=body, obstacle=floor, duration=0.01, count=40, velocity=(0.5, 0.0, 0.0))
    impulse, work, lost = np.zeros(3), 0.0, []
    for step in range(1, 41):
        state = made.advance(step / 40)
        impulse -= state.reaction * 0.01 / 40
        work -= state.reaction @ [0, 0, 0.02 / 40]
        momentum = (made.moving.node_mass * made.velocity).sum(axis=0)
        assert momentum == pytest.approx(impulse + [0.5 * MASS, 0, 0], abs=1e-6 * MASS)  # the solver's tolerance, over 1 m/s
        lost.append(work + 0.25 * MASS / 2 - made.body.energy(state.u) - made.kinetic_energy)
    assert work > 0.02 and momentum @ [0, 0.6, 0.8] > 0.9 * 1.6 * MASS  # it is about as fast as the floor now
    assert min(np.diff([0.0, *lost])) > -1e-5 * work and 0 < lost[-1] < 0.5 * work
    assert made.halvings == 0


def test_nothing_is_solved_before_anything_moves():
    down = ((0.01, 0.015, -0.012), (0.01, 0.015, 0.008))  # a plate below the block that reaches it before half time
    made = motion(obstacle=plate(0.006, down), duration=100.0)
    for k in range(1, 5):
        state = made.advance(k / 10)
        assert state.iterations == 0 and not state.u.any() and state.fraction == k / 10
    assert made.newton.factorisations == 0
    for changes in ({"velocity": (0.0, 0.0, 1e-3)}, {"load": [{"acceleration": [0.0, 0.0, 1e-3]}]},
                    {"load": [{"acceleration": [0.0, 0.0, 1e-3], "sudden": True}]}):
        assert motion(**changes).advance(1e-3).iterations > 0


def test_a_factor_is_kept_from_one_step_to_the_next_that_is_as_long():
    """What is factored is K / 2 + 2 M / h^2: another h outdates it, rounding (0.1 + 0.1 + 0.1) does not."""
    made, outdated = motion(velocity=(0.0, 0.0, 1e-3)), []
    made.newton.outdate = lambda: outdated.append(round(fraction, 3))
    stubbed(made, made.states[0])
    fraction = 0.0
    for h in (0.1, 0.1, 0.1, 0.1 * (1 + 1e-4), 0.2):
        fraction += h
        made.advance(fraction)
        made.moving.factored_h = made.moving.h  # as a factor made in this step would say
    assert outdated == [0.1, 0.4, 0.6]


def stubbed(made, found=None):
    """The starts and arguments that Newton's method is called with; it answers with what it is given, shifted by 1 mm."""
    calls = []

    def equilibrium(fraction, start, last):
        calls.append((fraction, start, made.balance.floor, made.moving.h, made.moving.outer))
        if found is None:
            raise NoEquilibrium("not here")
        return replace(found, fraction=fraction, u=start + 1e-3)

    made.newton.equilibrium = equilibrium
    return calls


def test_a_step_starts_from_where_its_velocity_leads():
    made = motion(support=[{"where": "x-min", "fixed": "x", "displacement": [0.002, 0.0, 0.0]}], velocity=(1.0, 2.0, 0.0),
                  load=[{"acceleration": [0.0, 0.0, 5.0]}])
    left = (made.balance.mesh.points[:, 0] < 1e-9)[:, None]
    calls = stubbed(made, State(0.0, np.zeros((12, 3)), np.zeros(0), reaction=np.array([3.0, 0.0, -4.0])))
    largest = np.linalg.norm(made.growing)
    momentum = np.linalg.norm(made.moving.node_mass * made.velocity)
    made.advance(0.2)
    fraction, start, floor, h, outer = calls[0]
    assert fraction == 0.2 and h == pytest.approx(0.1)
    assert start == pytest.approx(np.where(left, [0.0004, 0.2, 0.0], [0.1, 0.2, 0.0]))
    assert floor == pytest.approx(TOLERANCE * max(largest, momentum / (10 * 0.1)))  # what would stop it in ten steps
    assert outer == pytest.approx(0.1 * made.growing)  # the mean of the step
    # Afterwards v1 = 2 (u1 - u0) / h - v0, and its change is a force.
    after = np.where(left & np.array([True, False, False]), 0.004, 20 * made.states[-1].u - [1.0, 2.0, 0.0])
    assert made.velocity == pytest.approx(after)
    free = 20 * made.states[-1].u - 2 * np.where(left & np.array([True, False, False]), 0.004, [1.0, 2.0, 0.0])
    assert made._largest == pytest.approx(max(largest, 5.0, np.linalg.norm(made.moving.node_mass * free) / 0.1))
    before = made._largest
    made.advance(0.6)
    assert calls[1][2] >= TOLERANCE * before and calls[1][4] == pytest.approx(0.4 * made.growing) and calls[1][3] == pytest.approx(0.2)


def test_a_step_that_fails_is_halved_and_then_given_up():
    made = motion(velocity=(1.0, 0.0, 0.0), duration=0.64, count=1)
    calls = stubbed(made)
    with pytest.raises(NoEquilibrium, match=rf"not here after {HALVINGS} halvings; a step of time is 0\.64 s"):
        made.advance(1.0)
    assert [call[0] for call in calls] == [0.5**k for k in range(HALVINGS + 1)] and made.halvings == HALVINGS


def test_points_that_bear_are_stopped_by_masses_and_the_obstacles_speed(monkeypatch):
    """What the impact is told, and that the force which it adds is part of the reaction."""
    path = ((0.01, 0.015, -0.1), (0.02, 0.015, -0.06))
    made = motion(obstacle=plate(0.006, path), support=[{"where": "x-min", "fixed": "x"}])
    state = State(0.75, np.zeros((12, 3)), np.ones(len(made.balance.contact.surface.area)), reaction=np.array([1.0, 2.0, 3.0]))
    told = {}

    def bear(contact, u, velocity, **others):
        told.update(others)
        return velocity + 1, np.array([[10.0, 20.0, 40.0]])

    monkeypatch.setattr(dynamics, "bear", bear)
    borne, velocity = made._borne(0.25, state, np.full((12, 3), 3.0), 0.25)
    assert np.array_equal(borne.reaction, [-9, -18, -37]) and np.array_equal(velocity, np.full((12, 3), 4.0))
    assert told["centre"] == pytest.approx([0.0175, 0.015, -0.07]) and told["towards"] == pytest.approx([0.02, 0, 0.08])
    mobile = 1 / np.repeat(node_masses(made.balance.mesh)[:, None], 3, axis=1)
    mobile[made.balance.mesh.points[:, 0] < 1e-9, 0] = 0
    assert told["mobile"] == pytest.approx(mobile) and told["h"] == 0.25
    told.clear()
    nothing = replace(state, pressure=0 * state.pressure)
    assert made._borne(0.25, nothing, velocity, 0.25)[0] is nothing and not told


def test_a_motion_says_what_it_models():
    said = motion(obstacle=plate(0.006)).model()
    assert said["kinematics"] == "finite strain: in motion" and said["material"].startswith("saint-venant-kirchhoff; hexahedra")
    assert said["contact"].endswith("nothing is solved before it touches; what a surface layer of nodes loses when it is struck is gone, "
                                    "and contact makes no energy")
    free = motion(material={"law": "linear", "young_modulus": 1e5, "poisson_ratio": 0.3}).model()
    assert free["kinematics"] == "small strain, as the linear law has it" and free["contact"] == "none: the scene has no obstacle"


def test_a_motion_remembers_all_that_its_rest_depends_on():
    """Two motions, one of which takes over from the other in the midst of it, end with the same bits, in steps of other lengths."""
    load = [{"acceleration": [0.0, 300.0, -50.0], "sudden": True}, {"where": "x-max", "traction": [0.0, 0.0, 9000.0]}]
    changes = {"load": load, "support": [{"where": "z-min", "fixed": "xyz"}], "duration": 0.02}
    one, other = motion(**changes), motion(**changes)
    for fraction in (0.1, 0.2, 0.25, 0.35, 0.45):
        one.advance(fraction)
    other.recall(one.memory())
    for fraction in (0.55, 0.65, 0.7, 1.0):
        assert np.array_equal(one.advance(fraction).u, other.advance(fraction).u)
        assert one.states[-1].iterations == other.states[-1].iterations
    assert np.array_equal(one.velocity, other.velocity) and one._largest == other._largest and one.order == other.order
    assert (one.newton.factorisations, one.halvings) == (other.newton.factorisations, other.halvings)
    assert abs(one.states[-1].u).max() > 1e-4
