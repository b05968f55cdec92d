"""Rivals of learned flows against plain loops, on flows made of whole numbers; the solver stands in."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse

from datagen.flow.prediction import FlowTruth
from datagen.flow.refined import carried
from learning.flows import rivals
from learning.flows.rivals import REFERENCE, FlowPath, again, coarser, decomposed, dynamic_modes, elements, period, stays, trivial
from learning.prediction.predictor import LeftOut
from physics.fidelity.flow import FlowReference
from physics.scene import Body, FlowScene
from physics.scene.flow import Fluid
from tests.flows import channel_flow

NODES = 4
INSIDE = np.array([True, False, True, True])


def flow(frames, lag=7, first=1, pressure=True, scene=None):
    """A flow of whole numbers that repeats itself after `lag` frames, at rest before `first`."""
    random = np.random.default_rng(3)
    u, p = (random.integers(-9, 10, (lag, NODES, *shape)).astype(float)[np.arange(frames) % lag] for shape in ((2,), ()))
    u[:first] = 0
    mesh = SimpleNamespace(points=np.arange(3.0 * NODES).reshape(NODES, 3))
    return FlowTruth(None, scene, FlowReference(u, p if pressure else None, INSIDE, mesh, scene, 0.1, first))


def nearest_lag(x):
    """The lag from six frames to half of them after which the later half was most like what was before, by loops."""
    frames = len(x)
    best, found = np.inf, None
    for lag in range(6, frames // 2 + 1):
        off = np.mean([((x[t] - x[t - lag]) ** 2).sum() for t in range(frames // 2, frames)])
        if off < best:
            best, found = off, lag
    return found


@pytest.mark.parametrize("frames", (12, 13, 30, 41))
@pytest.mark.parametrize("seed", range(6))
def test_the_period_is_the_best_lag_of_all(frames, seed):
    x = np.random.default_rng(seed).integers(-3, 4, (frames, 5)).astype(float)
    assert period(x) == nearest_lag(x)


@pytest.mark.parametrize("lag, frames, found", [(6, 24, 6), (5, 24, 10), (12, 24, 12), (12, 25, 12), (3, 12, 6)])
def test_a_period_is_of_six_frames_at_least_and_of_half_of_them_at_most(lag, frames, found):
    x = np.eye(lag)[np.arange(frames) % lag]
    assert period(x) == found


@pytest.mark.parametrize("pressure", (True, False))
def test_the_last_period_again_is_the_truth_of_what_repeats_itself(pressure):
    """Of 45 frames 22 and more are not shown; four periods of seven and a part are gone on with."""
    truth = flow(45, pressure=pressure)
    found = again(truth)
    assert found.shown == 22 and found.one_step is None and found.seconds >= 0 and found.set_up == 0
    np.testing.assert_array_equal(found.velocity, truth.reference.velocity)
    if pressure:
        np.testing.assert_array_equal(found.pressure, truth.reference.pressure)
    else:
        assert found.pressure is None
    changed = truth.reference.velocity.copy()
    changed[23:] = 50.0
    other = again(replace(truth, reference=replace(truth.reference, velocity=changed)))
    np.testing.assert_array_equal(other.velocity[23:, INSIDE], truth.reference.velocity[23:, INSIDE])
    assert (other.velocity[23:, ~INSIDE] == 50.0).all()


@pytest.mark.parametrize("frames, first, fine", [(26, 1, True), (25, 1, False), (24, 0, True), (23, 0, False)])
def test_twelve_frames_of_past_are_the_fewest(frames, first, fine):
    truth = flow(frames, lag=6, first=first)
    if fine:
        assert again(truth).shown == decomposed(truth).shown == frames // 2
    else:
        for rival in (again, decomposed):
            with pytest.raises(LeftOut, match=r"^the first half has 12 frames, of which nothing is learned$"):
                rival(truth)


@pytest.mark.parametrize("pressure", (True, False))
def test_nothing_changes_from_the_shown_frame_on_and_from_none_to_the_next(pressure):
    truth = flow(6, first=2, pressure=pressure)
    of, found = truth.reference, stays(truth)
    wanted = of.velocity.copy()
    wanted[3:, INSIDE] = of.velocity[2, INSIDE]
    np.testing.assert_array_equal(found.velocity, wanted)
    assert found.one_step.shape == (3, NODES, 2) and found.shown == 2
    np.testing.assert_array_equal(found.one_step[:, INSIDE], of.velocity[2:5, INSIDE])
    np.testing.assert_array_equal(found.one_step[:, ~INSIDE], of.velocity[3:6, ~INSIDE])
    if pressure:
        np.testing.assert_array_equal(found.pressure[:3], of.pressure[:3])
        np.testing.assert_array_equal(found.pressure[3:], np.repeat(of.pressure[2:3], 3, axis=0))
    else:
        assert found.pressure is None


@pytest.mark.parametrize("pressure", (True, False))
def test_a_decomposition_goes_on_with_velocity_and_pressure_where_they_are_not_given(pressure):
    """A wave of one frequency beside its mean; 1/cos of it, no whole number of frames long."""
    frames, t = 61, np.arange(61)
    wave = np.stack([np.ones(frames), np.cos(0.37 * t), np.sin(0.37 * t)])
    random = np.random.default_rng(0)
    u, p = (np.tensordot(wave.T, random.normal(size=(3, NODES, *shape)), 1) for shape in ((2,), ()))
    truth = flow(61)
    truth = replace(truth, reference=replace(truth.reference, velocity=u, pressure=p if pressure else None, first=0))
    changed = u.copy()
    changed[31:] = 5.0
    found = decomposed(replace(truth, reference=replace(truth.reference, velocity=changed)))
    assert found.shown == 30
    np.testing.assert_allclose(found.velocity[:, INSIDE], u[:, INSIDE], atol=1e-8)
    assert (found.velocity[31:, ~INSIDE] == 5.0).all()
    if pressure:
        np.testing.assert_allclose(found.pressure, p, atol=1e-8)
    else:
        assert found.pressure is None


def iterated(x, steps, rank):
    """The map of a number of singular vectors, taken again and again."""
    left, size, right = np.linalg.svd(x[:-1].T, full_matrices=False)
    left, inverse = left[:, :rank], right[:rank].T / size[:rank]
    state, found = left.T @ x[-1], []
    for _ in range(steps):
        state = left.T @ x[1:].T @ inverse @ state
        found.append(left @ state)
    return np.array(found)


def test_forty_modes_at_most_and_none_below_a_hundred_thousandth_are_taken():
    """Damped turns in 25 planes; and one that is small, a little more and a little less than that."""
    t = np.arange(70)
    turns = np.concatenate([[0.9**t * np.cos((0.1 + 0.11 * k) * t), 0.9**t * np.sin((0.1 + 0.11 * k) * t)] for k in range(25)])
    x = turns.T @ np.linalg.qr(np.random.default_rng(1).normal(size=(60, 50)))[0].T
    np.testing.assert_allclose(dynamic_modes(x, 5), iterated(x, 5, 40), rtol=1e-6, atol=1e-9 * abs(x).max())
    assert abs(iterated(x, 5, 40) - iterated(x, 5, 41)).max() > 1e-7 * abs(x[-1]).max()
    t = np.arange(30)
    for share, taken in ((1.05e-5, True), (0.95e-5, False)):  # of the largest singular value 0.9945 of that
        ahead = dynamic_modes(np.stack([0.9**t, share * (-0.9) ** t], axis=1), 1)[0, 1]
        assert (ahead == pytest.approx(share * 0.9**30, rel=1e-3)) == taken


def test_a_state_that_only_decays_is_one_mode_and_one_that_grows_is_held():
    x = 0.5 ** np.arange(8)[:, None] * [3.0, -1.0, 0.0]
    np.testing.assert_allclose(dynamic_modes(x, 3), x[-1] * 0.5 ** np.arange(1, 4)[:, None], rtol=1e-12)
    np.testing.assert_allclose(dynamic_modes(x[::-1].copy(), 3), np.repeat(x[:1], 3, axis=0), rtol=1e-12)


@pytest.fixture
def solver(monkeypatch):
    """What is solved: velocities 1, 2, .. and pressures in place of a flow; places are carried by doubling them."""
    seen = []

    def solved(scene, partial):
        seen.append((scene, partial))
        count = np.arange(1.0, 2 * 3 * NODES + 1)
        failure = "frame 3: too fast" if scene.name == "fails" else ""
        return SimpleNamespace(velocity=count.reshape(2, NODES, 3).astype(np.float32), pressure=count[:2 * NODES].reshape(2, NODES, 1),
                               failure=failure, set_up=100.0)

    def reader(scene, points):
        seen.append(points)
        return scipy.sparse.csr_matrix(2 * np.eye(NODES))

    monkeypatch.setattr(rivals, "solve_flow", solved)
    monkeypatch.setattr(rivals, "reader", reader)
    return seen


def test_the_reference_is_the_solver_and_larger_cells_are_carried_to_the_nodes_of_the_data(solver):
    truth = flow(2, scene=channel_flow())
    u = np.arange(1.0, 25).reshape(2, NODES, 3)[..., :2]
    same = elements(REFERENCE)
    found = same.predict(truth)
    assert (same.kind, same.name) == ("reference", REFERENCE) and solver == [(truth.scene, True)]
    np.testing.assert_array_equal(found.velocity, u)
    np.testing.assert_array_equal(found.pressure, np.arange(1.0, 9).reshape(2, NODES))
    assert found.set_up == 100 and -101 < found.seconds < -99 and found.shown == 0 and found.velocity.dtype == found.pressure.dtype == float
    solver.clear()
    large = elements("large", larger=1.5)
    found = large.predict(truth)
    assert large.kind == "fe" and solver[0] == (coarser(truth.scene, 1.5), True)
    np.testing.assert_array_equal(solver[1], truth.reference.mesh.points[:, :2])
    np.testing.assert_array_equal(found.velocity[:, INSIDE], 2 * u[:, INSIDE])
    np.testing.assert_array_equal(found.velocity[:, ~INSIDE], truth.reference.velocity[:, ~INSIDE])
    np.testing.assert_array_equal(found.pressure, 2 * np.arange(1.0, 9).reshape(2, NODES))
    solver.clear()
    elements("quadratic", order=2).predict(truth)
    assert solver[0][0] == replace(truth.scene, fluid=replace(truth.scene.fluid, order=2))


def test_what_the_solver_cannot_do_is_left_out(solver):
    one = elements("one")
    with pytest.raises(LeftOut, match="there is no scene"):
        one.predict(flow(2))
    file = FlowScene(body=Body(shape="file", path="a.msh"), fluid=Fluid(density=1.0, viscosity=1.0))
    with pytest.raises(LeftOut, match="the mesh is that of a file"):
        one.predict(flow(2, scene=file))
    with pytest.raises(LeftOut, match="^there is frame 3: too fast$"):
        one.predict(flow(2, scene=replace(channel_flow(), name="fails")))


def test_larger_cells_of_every_body():
    scene = channel_flow()
    assert coarser(scene, 1.0) is scene
    found = coarser(scene, 1.5).body
    assert (found.cell_size, found.hole_cell_size) == pytest.approx((1.5 * 0.05, 1.5 * 0.02))
    plain = replace(scene, body=replace(scene.body, hole_cell_size=None))
    assert (coarser(plain, 2.0).body.cell_size, coarser(plain, 2.0).body.hole_cell_size) == (0.1, None)
    plate = replace(scene, body=Body(shape="plate", length=1.0, width=1.0, cells=(7, 1), cell="triangle"))
    found = coarser(plate, 2.0).body
    assert found.divisions == (4, 1) and found.cell_size is None  # 3.5 to the even one, and one at least


def test_those_that_know_nothing_have_names_and_a_path_costs_nothing_before_its_first_step():
    assert [(one.name, one.kind, one.predict) for one in trivial()] == [
        ("nothing changes", "trivial", stays), ("the last period again", "trivial", again),
        ("dynamic mode decomposition", "trivial", decomposed)]
    bare = FlowPath(velocity=np.zeros((1, 1, 2)), seconds=1.0, shown=0)
    assert (bare.pressure, bare.one_step, bare.set_up) == (None, None, 0.0)


def test_values_are_carried_frame_by_frame():
    """Two nodes to three: x, y, x + y; of numbers and of pairs."""
    carry = scipy.sparse.csr_matrix(np.array([[1.0, 0], [0, 1], [1, 1]]))
    values = np.arange(20.0).reshape(5, 2, 2)
    wanted = np.stack([values[:, 0], values[:, 1], values.sum(axis=1)], axis=1)
    np.testing.assert_array_equal(carried(carry, values), wanted)
    np.testing.assert_array_equal(carried(carry, values[..., 0]), wanted[..., 0])
