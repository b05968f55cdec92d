"""The numbers of a flow, worked out on few nodes, and the frame that predictions of it begin at."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from datagen.files.trajectory import INFLOW, NORMAL, OUTFLOW, WALL
from datagen.flow.figures import flow_figures, predicted_nodes, resting

KINDS = np.array([NORMAL, INFLOW, OUTFLOW, WALL, NORMAL], np.uint8)


def flow(frames=7, *, first=None, **changes):
    """Frame t has the velocity t (3, 4) at the nodes that are predicted, and 100 elsewhere."""
    velocity = np.full((frames, 5, 3), 100.0, np.float32)
    velocity[:, [0, 2, 4]] = np.arange(frames)[:, None, None] * [3.0, 4.0, 0.0]
    if first is not None:
        velocity[0] = first
    return SimpleNamespace(**{"fields": {"velocity": velocity}, "node_kind": KINDS, "per_frame": {}, "extra": {}} | changes)


def test_predicted_are_the_nodes_inside_and_at_the_outflow():
    assert predicted_nodes(flow()).tolist() == [True, False, True, False, True]


@pytest.mark.parametrize("frames, start, first", [(3, 0, 1), (2, 0, 0), (3, 1, 0)])
def test_a_flow_begins_after_the_first_of_three_frames_at_least_when_it_is_at_rest_there(frames, start, first):
    made = flow(frames)
    made.fields["velocity"][:, predicted_nodes(made)] += start
    assert resting(made) == first


def test_a_node_beside_an_inlet_may_move_at_rest_but_not_the_median_one():
    made = flow()
    made.fields["velocity"][0, 0, 1] = -0.5
    assert resting(made) == 1
    made.fields["velocity"][0, 2, 1] = -0.5
    assert resting(made) == 0


def test_velocities_are_of_the_predicted_nodes_and_changes_of_what_moves():
    """0, 5, .. 30 m/s: root of the mean of 25 t^2, t to 6, is root of 325; from frame 1 on every change is 5 m/s, the largest 30."""
    found = flow_figures(flow(), None)
    assert found == {"velocity_rms": pytest.approx(math.sqrt(325)), "velocity_change_rms": pytest.approx(5.0), "velocity_largest": 30.0}
    moving = flow(first=100.0)  # a change of (97, 96) first, which counts when the fluid does not begin at rest
    assert flow_figures(moving, None)["velocity_change_rms"] == pytest.approx(math.sqrt((97**2 + 96**2 + 5 * 25) / 6))
    single = flow_figures(flow(1), None)
    assert single == {"velocity_rms": 0.0, "velocity_change_rms": 0.0, "velocity_largest": 0.0}


@pytest.mark.parametrize("number, said", [(None, 0.0), (20.0, 20.0)])
def test_a_scene_gives_its_reynolds_number_or_nought(number, said):
    assert flow_figures(flow(), SimpleNamespace(reynolds_number=number))["reynolds_number"] == said


def test_pressure_is_over_all_nodes():
    made = flow()
    made.fields["pressure"] = np.full((7, 5, 1), -2.0, np.float32)
    made.fields["pressure"][0] = 5.0
    assert flow_figures(made, None)["pressure_rms"] == pytest.approx(math.sqrt((25 + 6 * 4) / 7))


@pytest.mark.parametrize("swing, wake", [(0.0199, "steady"), (0.0201, "shedding")])
def test_a_wake_sheds_when_its_lift_swings_by_two_hundredths_in_the_last_third(swing, wake):
    """Of 7 frames the last third begins at 4; what was before counts nothing. Forces are over 2 N/m."""
    extra = {"flow": {"force_of_coefficient_1_N_m": 2.0}}
    forces = {"drag": np.array([90.0] * 4 + [6.0, 7.0, 8.0]), "lift": np.array([50.0] * 4 + [0.0, 2 * swing, swing])}
    found = flow_figures(flow(per_frame=forces, extra=extra), None)
    assert found["drag_coefficient"] == pytest.approx(3.5) and found["wake"] == wake
    for lacking in (flow(per_frame=forces), flow(per_frame={"drag": forces["drag"]}, extra=extra),
                    flow(per_frame=forces, extra={"flow": {"force_of_coefficient_1_N_m": None}})):
        assert "wake" not in flow_figures(lacking, None) and "drag_coefficient" not in flow_figures(lacking, None)
