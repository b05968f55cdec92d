"""The error of a stored flow's mesh: the difference to the same flow on cells half as large."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.flow import refined
from datagen.flow.figures import predicted_nodes
from datagen.flow.refined import coarser, flow_mesh_error
from datagen.flow.trajectory import flow_trajectory
from datagen.sets import statistics
from physics.flow.solution import solve_flow
from tests.flows import channel_flow


@pytest.fixture(scope="module")
def solved():
    """A flow of four frames and the same on cells of half the size."""
    scene = channel_flow(steps={"count": 4, "duration": 0.04})
    return scene, solve_flow(scene), solve_flow(coarser(scene, 0.5))


def test_a_flow_is_held_against_cells_of_half_the_size(solved, monkeypatch):
    """The finer flow made up: 0.3 and 0.4 m/s more at every node, a third more drag, no lift in either."""
    scene, found, finest = solved
    found = replace(found, per_frame=found.per_frame | {"lift": 0 * found.per_frame["lift"]})
    made = flow_trajectory(scene, found)
    asked = []

    def finer(given, partial):
        asked.append(given)
        return replace(finest, per_frame={"drag": 4 / 3 * found.per_frame["drag"], "lift": found.per_frame["lift"]})

    def carried(carry, values):
        assert carry.shape[1] == values.shape[1] and carry.shape[0] == predicted_nodes(made).sum()
        return made.fields["velocity"][:, predicted_nodes(made), :2] + np.array([0.3, 0.4])

    monkeypatch.setattr(refined, "solve_flow", finer)
    monkeypatch.setattr(refined, "carried", carried)
    row = flow_mesh_error(made, scene)
    assert (asked[0].body.cell_size, asked[0].body.hole_cell_size) == (0.025, 0.01)
    assert row["velocity_rmse_50"] == pytest.approx(np.sqrt(0.125), rel=1e-6) == row["velocity_rmse_all"]
    drag = found.per_frame["drag"] / found.scale
    assert row["drag_rmse"] == pytest.approx(np.sqrt((drag**2).mean()) / 3, rel=1e-6)
    assert row["drag_mean"] == pytest.approx(-0.25) and row["lift_rmse"] == 0
    assert (row["wake"], row["frequency"], row["lift_range"]) == ("steady", 0.0, 0.0)


def test_a_flow_on_cells_of_half_the_size_is_near(solved):
    """Within a tenth of the velocity, read where both are: were nodes mixed up, it would be as far off as the flow is fast."""
    scene, found, fine = solved
    row = statistics.mesh_error(flow_trajectory(scene, found))
    assert 1e-3 < row["velocity_relative"] < 0.1
    assert row["drag_mean"] == pytest.approx(found.per_frame["drag"][2:].mean() / fine.per_frame["drag"][2:].mean() - 1, rel=1e-6)


def test_where_vortices_are_shed_range_and_frequency_are_told(solved, monkeypatch):
    """A lift of eight periods in the second half where the finer one has ten, and half as large."""
    scene, found, _ = solved
    frames, scale = 400, found.scale
    turn = np.arange(frames) / frames
    own, finer = 0.1 * np.sin(2 * np.pi * 16 * turn), 0.2 * np.sin(2 * np.pi * 20 * turn)
    still = np.zeros((frames, len(found.mesh.points), 3), np.float32)
    flow = replace(found, velocity=still, pressure=still[..., :1], per_frame={"drag": np.ones(frames) * scale, "lift": own * scale})
    monkeypatch.setattr(refined, "solve_flow", lambda given, partial: replace(
        flow, per_frame={"drag": np.ones(frames) * scale, "lift": finer * scale}))
    monkeypatch.setattr(refined, "carried", lambda carry, values: np.zeros((frames, carry.shape[0], 2)))
    row = flow_mesh_error(flow_trajectory(scene, flow), scene)
    assert row["wake"] == "shedding" and row["frequency"] == pytest.approx(-0.2, abs=2e-3)
    assert row["lift_range"] == pytest.approx(-0.5, abs=1e-2) and row["lift_rmse"] == pytest.approx(np.sqrt(0.025), rel=2e-2)
    assert row["velocity_relative"] == 0


def test_what_cannot_be_solved_again_is_said(solved, monkeypatch):
    scene, found, _ = solved
    made = flow_trajectory(scene, found)
    with pytest.raises(RuntimeError, match="mesh of a file"):
        flow_mesh_error(made, replace(scene, body=replace(scene.body, shape="file")))
    monkeypatch.setattr(refined, "solve_flow", lambda given, partial: replace(found, failure="no flow"))
    with pytest.raises(RuntimeError, match="the flow on finer cells: no flow"):
        flow_mesh_error(made, scene)
