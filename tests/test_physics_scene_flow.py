"""A flow scene: defaults, profiles, factors over time, and one clear line for what is wrong."""

import numpy as np
import pytest

from physics import load_scene
from physics.scene import FlowScene, Scene, load_solid, read_any, scene_of
from physics.schema import InputError

TABLE = {"body": {"shape": "channel"}, "fluid": {"density": 1.0, "viscosity": 1e-3}, "inflow": [{"speed": 1.5}], "outflow": [{}],
         "steps": {"count": 10, "duration": 0.1}}


def flow(**changes):
    return read_any(TABLE | changes)


def test_a_channel_knows_its_own_force():
    """That on the hole, by its diameter and the mean speed 2/3 of the parabola's largest, between its foremost and rearmost point."""
    scene = flow()
    assert isinstance(scene, FlowScene)
    assert (scene.body.cell_size, scene.body.hole_cell_size) == (0.02, pytest.approx(0.02 / 3))
    assert (scene.force.where, scene.force.length, scene.force.speed) == ("hole", 0.1, pytest.approx(1.0))
    np.testing.assert_allclose(scene.force.points, [[0.15, 0.2], [0.25, 0.2]])
    assert scene.order == 3


def test_a_scene_comes_back_from_its_toml():
    scene = flow(inflow=[{"speed": 1.5, "profile": "table", "along": [0.0, 0.5, 1.0], "share": [0.0, 1.0, 0.2], "steps": [0, 1],
                          "factor": [0, 2]}],
                 wall=[{"where": "walls", "velocity": [0.5, 0.0]}])
    assert scene_of(scene.to_toml()) == scene


def test_what_is_loaded_is_a_flow_or_a_solid(tmp_path):
    (tmp_path / "flow.toml").write_text(flow().to_toml())
    solid = '[body]\nlength = 0.1\nwidth = 0.02\nheight = 0.02\ncells = [4, 1, 1]\n[material]\nyoung_modulus = 1e6\npoisson_ratio = 0.3\n'
    (tmp_path / "solid.toml").write_text(solid)
    assert load_scene(tmp_path / "flow.toml", ["fluid.viscosity=0.002"]).fluid.viscosity == 0.002
    assert isinstance(load_scene(tmp_path / "solid.toml"), Scene)
    with pytest.raises(InputError, match="is a flow"):
        load_solid(tmp_path / "flow.toml")


def test_factors_over_time():
    def at(t, **keys):
        return flow(inflow=[{"speed": 1.0, **keys}]).inflow[0].factor_at(t, 2.0)

    assert [at(t) for t in (0.0, 1.0)] == [1.0, 1.0]
    np.testing.assert_allclose([at(t, ramp=0.4) for t in (0, 0.1, 0.2, 0.4, 3)], [0, (1 - np.sqrt(0.5)) / 2, 0.5, 1, 1], atol=1e-15)
    np.testing.assert_allclose([at(t, period=16.0) for t in (0, 4, 8)], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose([at(t, period=2.0, mean=0.75) for t in (0, 0.5, 1.5)], [0.75, 1, 0.5], atol=1e-15)
    np.testing.assert_allclose([at(t, steps=[0, 0.25, 1], factor=[0, 1, 3]) for t in (0.25, 0.5, 1.25)], [0.5, 1, 2], atol=1e-15)


@pytest.mark.parametrize(("profile", "mean"), [({}, 2 / 3), ({"profile": "uniform"}, 1.0), (
    {"profile": "table", "along": [0.0, 0.25, 1.0], "share": [0.0, 1.0, 0.5]}, 0.125 + 0.5625)])
def test_the_mean_speed_is_that_of_the_profile(profile, mean):
    inflow = flow(inflow=[{"speed": 2.0, **profile}]).inflow[0]
    s = (np.arange(100_000) + 0.5) / 100_000
    assert inflow.mean_speed == pytest.approx(2 * mean, rel=1e-12)
    assert 2 * inflow.profile_at(s).mean() == pytest.approx(inflow.mean_speed, rel=1e-8)


@pytest.mark.parametrize(("changes", "words"), [
    ({"fluid": {"density": 1.0}}, r"fluid\.viscosity: missing"),
    ({"fluid": {"density": 1.0, "viscosity": 0.0}}, r"fluid\.viscosity = 0\.0: must be above 0 Pa s"),
    ({"fluid": {"density": 1.0, "viscosity": 1.0, "viscocity": 1.0}}, r"did you mean 'viscosity'"),
    ({"material": {"young_modulus": 1.0, "poisson_ratio": 0.3}}, r"material: unknown key"),
    ({"body": {"shape": "beam", "length": 1.0, "width": 1.0, "height": 1.0, "cell_size": 0.5}}, "a flow is in a plane domain of triangles"),
    ({"body": {"shape": "plate", "length": 1.0, "width": 1.0, "cell": "quadrilateral", "cells": [2, 2]}}, "plane domain of triangles"),
    ({"body": {"shape": "channel", "hole_centre": [0.2, 0.37]}}, "does not lie inside the channel"),
    ({"body": {"shape": "channel", "thickness": 1.0}}, "no thickness"),
    ({"inflow": [{"speed": 1.0, "where": "inlett"}]}, r"inflow\[0\]\.where = 'inlett'.*did you mean 'inlet'"),
    ({"outflow": []}, "outflow: missing; what flows in must flow out"),
    ({"inflow": [{"speed": 1.0, "ramp": 1.0, "period": 2.0}]}, r"inflow\[0\]: give at most one of ramp, period and steps"),
    ({"inflow": [{"speed": 1.0, "mean": 0.5}]}, r"inflow\[0\]\.mean: goes with a period"),
    ({"inflow": [{"speed": 1.0, "profile": "table"}]}, "needs along and share"),
    ({"inflow": [{"speed": 1.0, "along": [0.0, 1.0], "share": [0.0, 1.0]}]}, "needs along and share"),
    ({"inflow": [{"speed": 1.0, "profile": "table", "along": [0.0, 0.0], "share": [0.0, 1.0]}]}, "along must rise"),
    ({"inflow": [{"speed": float("inf")}]}, "must be finite"),
    ({"steps": {"count": 3}}, r"steps\.duration: missing"),
    ({"steps": {"count": 3, "stationary": True}}, "one frame, without a duration"),
    ({"force": {"where": "cylinder"}}, r"force\.where = 'cylinder'")])
def test_what_is_wrong_is_said_in_one_line(changes, words):
    with pytest.raises(InputError, match=words) as caught:
        flow(**changes)
    assert "\n" not in str(caught.value)
