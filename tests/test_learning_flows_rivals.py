"""Rivals of learned flows, on histories whose continuation is known."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.files.trajectory import write_trajectory
from datagen.flow.prediction import read_flow_truth
from datagen.flow.trajectory import flow_trajectory
from learning.flows.rivals import REFERENCE, again, coarser, decomposed, dynamic_modes, elements, period, stays, trivial
from learning.prediction.predictor import LeftOut
from physics.flow.solution import solve_flow
from tests.flows import channel_flow
from tests.test_physics_currents import channel


def waves(frames, lag, nodes=30, decay=1.0):
    """(frames, nodes) a mean, and a wave that passes a line of nodes, and a weaker one twice as fast."""
    t, x = np.arange(frames)[:, None], np.linspace(0, 3, nodes)
    turn = 2 * np.pi * t / lag
    return 2 + x + decay**t * (np.sin(turn - x) + 0.3 * np.cos(2 * turn + 2 * x))


def test_the_period_of_a_wave_is_found():
    for lag in (9, 14, 23):
        assert period(waves(100, lag)) % lag == 0


def test_a_sum_of_waves_is_gone_on_with_by_a_linear_map():
    """Of rank five, so the map is known from what is shown: forty frames on it is still right."""
    x = waves(100, 17.3)
    np.testing.assert_allclose(dynamic_modes(x[:60], 40), x[60:], atol=1e-6)
    dying = waves(100, 17.3, decay=0.97)
    np.testing.assert_allclose(dynamic_modes(dying[:60], 40), dying[60:], atol=1e-6)


def test_what_would_grow_without_end_stays_within_bounds():
    """The wave that grows by 3 % a frame is 3.2 times as large after 40 frames; drawn back it keeps its size."""
    x = waves(100, 17.3, decay=1.03)
    found = dynamic_modes(x[:60], 40)
    assert abs(found - found.mean(axis=0)).max() < 1.2 * abs(x[59] - x[:60].mean(axis=0)).max() + 1.0
    assert abs(x[99] - x.mean(axis=0)).max() > 3 * abs(found[-1] - x.mean(axis=0)).max()


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = tmp_path_factory.mktemp("flows") / "a.vtkhdf"
    scene = channel_flow(inflow=[{"speed": 0.3}], steps={"count": 32, "duration": 0.32})
    write_trajectory(path, flow_trajectory(scene, solve_flow(scene)))
    return read_flow_truth(path)


def test_rivals_see_no_more_than_they_say(truth):
    """What follows the shown frames is altered inside: the predictions must not change."""
    for predictor in trivial():
        found = predictor.predict(truth)
        of, after = truth.reference, found.shown + 1
        velocity, pressure = of.velocity.copy(), of.pressure.copy()
        velocity[after:, of.predicted] = 7.0
        pressure[after:] = -7.0
        blind = predictor.predict(replace(truth, reference=replace(of, velocity=velocity, pressure=pressure)))
        np.testing.assert_array_equal(found.velocity, blind.velocity)
        np.testing.assert_array_equal(found.pressure, blind.pressure)
        np.testing.assert_array_equal(found.velocity[:, ~of.predicted], of.velocity[:, ~of.predicted])
        assert np.isfinite(found.velocity).all() and (found.velocity[:after] == of.velocity[:after]).all()
    assert (stays(truth).shown, again(truth).shown, decomposed(truth).shown) == (1, 16, 16)


def test_nothing_changes_steps_from_each_true_frame(truth):
    found, of = stays(truth), truth.reference
    np.testing.assert_array_equal(found.one_step[:, of.predicted], of.velocity[1:-1, of.predicted])
    np.testing.assert_array_equal(found.one_step[:, ~of.predicted], of.velocity[2:, ~of.predicted])
    assert (found.velocity[5:, of.predicted] == of.velocity[1, of.predicted]).all()


def test_the_solver_on_the_cells_of_the_data_is_the_data_and_on_larger_ones_near_it(truth):
    of = truth.reference
    same, near = elements(REFERENCE).predict(truth), elements("coarser", larger=1.5).predict(truth)
    np.testing.assert_array_equal(same.velocity, of.velocity)
    np.testing.assert_array_equal(same.pressure, of.pressure)
    off = np.sqrt(((near.velocity - of.velocity)[2:, of.predicted] ** 2).mean())
    size = np.sqrt((of.velocity[2:, of.predicted] ** 2).mean())
    assert 1e-3 * size < off < 0.1 * size


def test_cells_are_made_larger_in_a_channel_and_in_a_rectangle():
    found = coarser(channel_flow(), 2.0).body
    assert (found.cell_size, found.hole_cell_size) == (0.1, 0.04)
    assert coarser(channel(), 2.0).body.divisions == (4, 2)


def test_too_short_a_past_is_left_out(truth):
    of = truth.reference
    short = replace(truth, reference=replace(of, velocity=of.velocity[:12], pressure=of.pressure[:12]))
    for rival in (again, decomposed):
        with pytest.raises(LeftOut, match="the first half has 6 frames"):
            rival(short)
