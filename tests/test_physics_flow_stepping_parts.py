"""One step against its formulas in full matrices, and the parts of the stepper by themselves."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse

from physics.flow import stepping
from physics.flow.conditions import Conditions, OpenEdges
from physics.flow.space import FlowSpace
from physics.flow.stepping import Memory, Stepper
from tests.flows import rectangle

NU, SIZE = 0.3, 0.05
# For each metre of an outflow's edge, and the mass of an edge of length one at its pressure nodes in a row.
PENALTY = {2: (24.0, np.array([[2, 1], [1, 2]]) / 6), 3: (64.0, np.array([[4, 2, -1], [2, 16, 2], [-1, 2, 4]]) / 30)}


def setting(order, enclosed):
    """A space of 3 x 3 squares cut in two, its right side open unless enclosed; given velocities and a source that change in time."""
    space = FlowSpace(rectangle(3, seed=2), order)
    outer = space.mesh.boundary[0]
    right = (space.mesh.points[outer, 0] > 1 - 1e-9).all(axis=1)
    fixed = space.velocity.on_edges(space.mesh, outer if enclosed else outer[~right])
    x = space.velocity.points
    return space, Conditions(fixed, lambda t: t * np.sin(3 * x[fixed] + 1), outer[:0] if enclosed else outer[right],
                             lambda t: np.cos(2 * x[:, ::-1] + t))


def full(space, order, edges):
    """Matrices of mass, viscosity, the pressure's mass and its Laplacian with what is asked for at the outflow."""
    mass, viscosity = (space.matrix(blocks).toarray() for blocks in (space.mass, space.viscosity))
    count = len(space.pressure.points)
    squares = []
    for blocks in (space.mass_of_pressure(), space.stiffness_of_pressure()):
        matrix = np.zeros((count, count))
        for nodes, block in zip(space.pressure.cells, blocks, strict=True):
            matrix[np.ix_(nodes, nodes)] += block
        squares.append(matrix)
    factor, edge = PENALTY[order]
    for nodes in space.pressure.along_edges(space.mesh, edges):
        squares[1][np.ix_(nodes, nodes)] += factor * edge
    return mass, viscosity, *squares


@pytest.mark.parametrize("order", (2, 3))
@pytest.mark.parametrize("enclosed", (True, False))
def test_a_step_is_what_its_formulas_say(order, enclosed):
    """From velocities and pressures at random, so that fluid comes back through the outflow too."""
    space, conditions = setting(order, enclosed)
    random = np.random.default_rng(order)
    n, m = len(space.velocity.points), len(space.pressure.points)
    u, before, earlier = random.normal(size=(3, n, 2))
    p, phi, phi_before = random.normal(size=(3, m))
    stepper = Stepper(space, conditions, NU, Memory(0.2, u, p, SIZE, phi, phi_before, before, earlier, 7))
    mass, viscosity, pressures, laplacian = full(space, order, conditions.open)
    wind, time = 2 * u - before, 0.2 + SIZE
    history = (4 * u - before) / (2 * SIZE) + conditions.source(time)
    right = space.momentum(wind, history, p + 4 / 3 * phi - phi_before / 3)
    open_ = OpenEdges(space, conditions.open)
    if not enclosed:
        back = open_.backflow(wind)
        assert abs(back).max() > 1e-3
        np.add.at(right, open_.nodes, back)
    matrix, found = 3 / (2 * SIZE) * mass + NU * viscosity, np.zeros((n, 2))
    found[conditions.fixed] = conditions.values(time)
    free = np.setdiff1d(np.arange(n), conditions.fixed)
    found[free] = np.linalg.solve(matrix[np.ix_(free, free)], (right - matrix @ found)[free])
    leak, kept = space.divergence(found), slice(1 if enclosed else 0, None)
    step = np.zeros(m)
    step[kept] = -np.linalg.solve(laplacian[kept, kept], 3 / (2 * SIZE) * leak[kept])
    pressure = p + step - NU * np.linalg.solve(pressures, leak)
    if enclosed:
        pressure -= np.ones(m) @ pressures @ pressure / pressures.sum()
    stepper.advance(time, 1)
    now = stepper.memory
    for made, wanted in ((now.u, found), (now.p, pressure), (now.phi, step)):
        np.testing.assert_allclose(made, wanted, rtol=0, atol=1e-10 * abs(wanted).max())
    assert now.phi_before is phi and now.before is u and now.earlier is before
    assert (now.time, now.size, now.steps, stepper.enclosed, stepper.iterations) == (time, SIZE, 8, enclosed, 0)
    assert stepper.energy() == pytest.approx(np.einsum("id,ij,jd->", found, mass, found) / 2, rel=1e-9)
    assert stepper.divergence() == pytest.approx(np.sqrt(leak @ np.linalg.solve(pressures, leak)), rel=1e-9)  # over one square metre


@pytest.mark.parametrize("order", (2, 3))
@pytest.mark.parametrize("enclosed", (True, False))
def test_the_first_step_is_backward_eulers_with_its_pressure_in_few_iterations(order, enclosed):
    """All in one matrix; conjugate gradients with a preconditioner of its size and sign need no more than thirty."""
    space, conditions = setting(order, enclosed)
    n, m = len(space.velocity.points), len(space.pressure.points)
    x = space.velocity.points
    u = np.stack([np.sin(2 * x[:, 1]), np.cos(x[:, 0])], axis=1)
    if enclosed:
        conditions = Conditions(conditions.fixed, lambda t: t * np.stack([x[:, 1], -x[:, 0]], axis=1)[conditions.fixed], conditions.open,
                                conditions.source)
    stepper = Stepper(space, conditions, NU, Memory(0.2, u, np.zeros(m)))
    time = 0.2 + SIZE
    mass, viscosity, pressures, _ = full(space, order, conditions.open)
    divergence = np.stack([space.divergence(one.reshape(n, 2)) for one in np.eye(2 * n)], axis=1)
    a = np.kron(mass / SIZE + NU * viscosity, np.eye(2))
    whole = np.block([[a, -divergence.T], [-divergence, np.zeros((m, m))]])
    right = space.momentum(u, u / SIZE + conditions.source(time), np.zeros(m))
    back = OpenEdges(space, conditions.open).backflow(u)
    if back is not None:
        np.add.at(right, OpenEdges(space, conditions.open).nodes, back)
    found = np.zeros(2 * n + m)
    found[:2 * n].reshape(n, 2)[conditions.fixed] = conditions.values(time)
    free = np.ones(2 * n + m, bool)
    free[:2 * n].reshape(n, 2)[conditions.fixed] = False
    free[2 * n] = not enclosed
    found[free] = np.linalg.solve(whole[np.ix_(free, free)], (np.append(right, np.zeros(m)) - whole @ found)[free])
    pressure = found[2 * n:]
    stepper.advance(time, 1)
    now = stepper.memory
    if enclosed:
        pressure, p = (field - np.ones(m) @ pressures @ field / pressures.sum() for field in (pressure, now.p))
    else:
        p = now.p
    np.testing.assert_allclose(now.u.ravel(), found[:2 * n], rtol=0, atol=1e-8)
    np.testing.assert_allclose(p, pressure, rtol=0, atol=1e-7 * abs(pressure).max())
    assert 3 < stepper.iterations <= 30
    assert now.phi.tolist() == now.phi_before.tolist() == [0.0] * m and now.before is u and now.earlier is None and now.steps == 1


def bare(**parts):
    """A stepper that has nothing but what is asked of it."""
    stepper = Stepper.__new__(Stepper)
    vars(stepper).update(parts)
    return stepper


def test_conjugate_gradients_stop_at_a_ten_thousand_millionth_or_after_two_hundred_iterations():
    """As many iterations as the matrix has values, one at a time told apart; what is not symmetric never comes to an end."""
    assert stepping.EXACT == 1e-10 and stepping.MOST == 200

    def solved(matrix, start):
        space = SimpleNamespace(divergence=lambda u: u[0].copy(), momentum=lambda none, also, p: p[None])
        stepper = bare(space=space, iterations=5, enclosed=False, viscosity=0.5, _correction=lambda a0, leak: -a0 * leak,
                       pressure_mass=SimpleNamespace(solve=lambda leak: 2 * leak))
        u, p = stepper._exact(SimpleNamespace(solve=lambda right: right @ matrix), 3.0, np.array([start]), np.ones(len(start)))
        return stepper.iterations - 5, u[0], p

    for values in ([4.0, 4.0, 4.0], [1.0, 4.0, 4.0], [1.0, 4.0, 9.0]):
        start = np.array([1.0, 2.0, -3.0])
        count, left, p = solved(np.diag(values), start)
        assert count == len(set(values)) and abs(left).max() < 1e-12
        np.testing.assert_allclose(p, 1 - start / values, atol=1e-12)
    assert solved(np.eye(2), [0.0, 0.0])[0] == 0
    assert solved(np.array([[1.0, 1.0], [-1.0, 1.0]]), [1.0, 2.0])[0] == 200


def test_steps_to_a_time_are_of_one_size_and_end_there():
    """0.3 s in three steps: sizes are rounded to nine digits, so that the same size has the same factor."""
    taken, sizes = [], []
    stepper = bare(memory=Memory(0.1, np.zeros((1, 2)), np.zeros(1)), _resize=sizes.append,
                   _step=lambda time, size: taken.append((time, size)))
    stepper.advance(0.4, 3)
    assert sizes == [0.1] and taken == [(0.4 - 2 * 0.1, 0.1), (0.4 - 0.1, 0.1), (0.4, 0.1)]
    taken.clear()
    stepper.advance(0.1 + 1 / 3, 1)
    assert taken == [(0.1 + 1 / 3, 0.333333333)]


def parabola(t):
    return np.array([[1 + 2 * t + 3 * t**2, -t + 5 * t**2]])


def test_a_memory_is_read_off_the_parabola_through_three_velocities_at_another_size():
    """From steps of 0.5 to steps of 0.2 at t = 3; corrections of the pressure go with the size."""
    memory = Memory(3.0, parabola(3.0), np.array([7.0]), 0.5, np.array([10.0]), np.array([20.0]), parabola(2.5), parabola(2.0), 4)
    stepper = bare(memory=memory)
    stepper._resize(0.2)
    now = stepper.memory
    np.testing.assert_allclose(now.before, parabola(2.8), rtol=1e-12)
    np.testing.assert_allclose(now.earlier, parabola(2.6), rtol=1e-12)
    assert (now.size, now.phi[0], now.phi_before[0], now.steps, now.time) == (0.2, 4.0, 8.0, 4, 3.0) and now.u is memory.u
    line = Memory(3.0, np.array([[4.0, 1.0]]), np.array([7.0]), 0.5, np.array([1.0]), np.array([1.0]), np.array([[2.0, 2.0]]), None, 4)
    stepper = bare(memory=line)
    stepper._resize(1.0)
    assert stepper.memory.before.tolist() == [[0.0, 3.0]] and stepper.memory.earlier is None


@pytest.mark.parametrize("change, kept", [({"size": 0.2 * (1 + 0.9e-9)}, True), ({"size": 0.2 * (1 - 0.9e-9)}, True),
                                          ({"size": 0.2 * (1 + 1.1e-9)}, False), ({"before": None}, True), ({"phi": None}, True),
                                          ({"phi_before": None}, True), ({}, False)])
def test_a_memory_of_the_same_size_but_for_rounding_or_without_a_past_stays_as_it_is(change, kept):
    parts = {"size": 0.5, "phi": np.ones(1), "phi_before": np.ones(1), "before": parabola(2.5), "earlier": parabola(2.0)} | change
    memory = Memory(3.0, parabola(3.0), np.ones(1), **parts)
    stepper = bare(memory=memory)
    stepper._resize(0.2)
    assert (stepper.memory is memory) == kept


def test_twelve_factors_are_kept_and_the_oldest_goes_first():
    made = []
    stepper = bare(space=SimpleNamespace(mass=2.0, viscosity=3.0), viscosity=10.0, factorisations=0, _factors={},
                   _numbering=SimpleNamespace(factor=lambda blocks: made.append(blocks) or len(made)))
    assert [stepper.factor(float(a0)) for a0 in range(1, 13)] == list(range(1, 13))
    assert made == [2.0 * a0 + 30.0 for a0 in range(1, 13)]
    assert stepper.factor(1.0) == 1 and stepper.factorisations == 12
    assert stepper.factor(13.0) == 13 and len(stepper._factors) == 12
    assert stepper.factor(2.0) == 2 and stepper.factor(1.0) == 14 and stepper.factorisations == 14 and len(stepper._factors) == 12


def test_what_given_velocities_take_from_the_right_hand_side_is_worked_out_anew_when_they_or_the_step_change():
    mass, viscosity = np.array([[1.0], [2.0]]), np.array([[5.0], [7.0]])
    stepper = bare(_to_fixed=(mass, viscosity), viscosity=0.1, _lifted=None)
    for a0, given in ((2.0, 3.0), (2.0, 3.0), (2.0, 4.0), (8.0, 4.0)):
        np.testing.assert_allclose(stepper._lift(a0, np.array([[given]])), a0 * mass * given + 0.1 * viscosity * given, rtol=1e-12)
    kept = stepper._lift(8.0, np.array([[4.0]]))
    assert stepper._lift(8.0, np.array([[4.0]])) is kept


def test_columns_of_given_nodes_in_the_rows_of_the_others():
    matrix = scipy.sparse.csr_matrix(np.arange(1.0, 10.0).reshape(3, 3))
    found = stepping._columns(matrix, np.array([2, 0]), np.array([True, False, True]))
    np.testing.assert_array_equal(found.toarray(), [[0, 0], [6, 4], [0, 0]])


def test_bytes_are_those_of_the_factors_of_velocity_pressure_and_mass():
    space, conditions = setting(2, False)
    stepper = Stepper(space, conditions, NU, Memory(0.0, np.zeros((len(space.velocity.points), 2)), np.zeros(len(space.pressure.points))))
    stepper.factor(1.0), stepper.factor(2.0)
    assert stepper.bytes == stepper.factor(1.0).bytes + stepper._laplacian.bytes + stepper.pressure_mass.bytes
    assert stepper.factor(1.0).bytes > stepper.pressure_mass.bytes > 8 * 16


def test_energy_and_divergence_of_a_velocity_that_has_some():
    """(3 x, -x) on the unit square: half of 9 / 3 + 1 / 3, and 3."""
    space, conditions = setting(2, True)
    x = space.velocity.points[:, 0]
    stepper = Stepper(space, conditions, NU, Memory(0.0, np.stack([3 * x, -x], axis=1), np.zeros(len(space.pressure.points))))
    assert stepper.energy() == pytest.approx(5 / 3, rel=1e-12) and stepper.divergence() == pytest.approx(3.0, rel=1e-12)
    assert math.isclose(stepper._weights.sum(), 1.0)
