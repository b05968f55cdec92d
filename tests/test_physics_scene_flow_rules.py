"""A flow scene at the edge of every rule: units and bounds in one table, what is left out, and forces by hand."""

import dataclasses
import tomllib

import numpy as np
import pytest

from physics.scene import read_any
from physics.scene.flow import HOLE, FlowSteps, Fluid, Force, Inflow, Outflow, Wall
from physics.schema import Bound, InputError

CHANNEL = {"body": {"shape": "channel"}, "fluid": {"density": 2.0, "viscosity": 1e-2}, "inflow": [{"speed": 1.5}], "outflow": [{}],
           "steps": {"count": 10, "duration": 0.1}}
BOX = CHANNEL | {"body": {"shape": "plate", "length": 2.0, "width": 1.0, "cell_size": 0.5}, "inflow": [], "outflow": []}
FAR = (None, None, -1e9, 1e9)
# (unit, above, below, at least, at most), of keys that have any
BOUNDS = {
    Fluid: {"density": ("kg/m3", 0, None, 1e-12, 1e12), "viscosity": ("Pa s", 0, None, 1e-15, 1e12), "order": ("", None, None, 2, 3)},
    Inflow: {"speed": ("m/s", *FAR), "along": ("", None, None, 0, 1), "share": ("", *FAR), "ramp": ("s", 0, None, None, 1e9),
             "period": ("s", 0, None, None, 1e9), "mean": ("", None, None, 0, 1), "factor": ("", *FAR)},
    Outflow: {}, Wall: {"velocity": ("m/s", *FAR)},
    Force: {"length": ("m", 0, None, 1e-9, 1e9), "speed": ("m/s", 0, None, 1e-9, 1e9), "points": ("m", *FAR)},
    FlowSteps: {"count": ("", None, None, 1, 100_000), "duration": ("s", 0, None, None, 1e9)},
}
DEFAULTS = {Inflow: {"where": "inlet", "profile": "parabola"}, Outflow: {"where": "outlet"}, FlowSteps: {"count": 1, "stationary": False}}


def flow(base=CHANNEL, **changes):
    return read_any(base | changes)


@pytest.mark.parametrize("kind", BOUNDS)
def test_every_number_of_a_flow_has_its_unit_bounds_and_default(kind):
    found = {field.name: field.metadata.get("bound", Bound()) for field in dataclasses.fields(kind)}
    seen = {name: (bound.unit, bound.above, bound.below, bound.at_least, bound.at_most) for name, bound in found.items()}
    assert {name: bound for name, bound in seen.items() if bound != ("", None, None, None, None)} == BOUNDS[kind]
    defaults = {field.name: field.default for field in dataclasses.fields(kind)}
    assert {name: value for name, value in defaults.items() if value not in (dataclasses.MISSING, None)} == DEFAULTS.get(kind, {})


def test_what_a_domain_has_when_it_is_left_out():
    """Without a shape it is the channel, whose triangles on the hole are three times smaller, whatever its cells; a plate has them too."""
    assert HOLE == 3 and flow(body={}).body == flow().body
    assert flow(body={"cell_size": 0.03}).body.hole_cell_size == pytest.approx(0.01)
    wide = {"length": 40, "height": 30, "hole_centre": [15, 15], "hole_radius": 5, "cell_size": 3}
    assert flow(body=wide).body.hole_cell_size == 1  # a whole number of metres is no other
    assert flow(body={"cell_size": 0.03, "hole_cell_size": 0.02}).body.hole_cell_size == 0.02
    plate = flow(BOX)
    assert plate.body.cell == "triangle" and plate.force is None and plate.order == 3 and plate.name == "flow"
    assert (plate.inflow, plate.outflow, plate.wall) == ((), (), ()) and plate.reynolds_number is None
    assert flow(body={"shape": "file", "path": "a.msh"}, inflow=[], outflow=[]).order == 2
    assert [flow(fluid=CHANNEL["fluid"] | {"order": order}).order for order in (2, 3)] == [2, 3]
    with pytest.raises(InputError, match=r"body\.cell_size must be a number, not a string"):
        flow(body={"shape": "channel", "cell_size": "small"})
    with pytest.raises(InputError, match="body must be a table"):
        flow(body=3)
    assert flow().steps.dynamic and not flow(steps={"stationary": True}).steps.dynamic


@pytest.mark.parametrize(("changes", "words"), [
    ({"body": {"shape": "channel", "cell": "quadrilateral"}}, "plane domain of triangles"),
    ({"body": {"shape": "channel", "plane": "strain"}}, "a flow has no plane and no thickness"),
    ({"body": {"shape": "file", "path": "a.msh", "thickness": 1.0}}, "a flow has no plane and no thickness"),
    ({"body": {"shape": "channel", "element": "mean-dilatation"}}, "is for solids|only for prisms"),
    ({"body": {"shape": "file", "path": "a.msh", "element": "mean-dilatation"}}, "is for solids"),
    ({"outflow": [{"where": "outlett"}]}, r"^outflow\[0\]\.where = 'outlett'"),
    ({"inflow": [{"speed": 1.0}, {"speed": 1.0, "where": "here"}]}, r"^inflow\[1\]\.where = 'here'"),
    ({"wall": [{"where": "walls", "velocity": [1, 0]}, {"where": "there", "velocity": [1, 0]}]}, r"^wall\[1\]\.where = 'there'"),
    ({"inflow": [{"speed": 1.0}, {"speed": 1.0, "ramp": 1.0, "steps": [0, 1], "factor": [0, 1]}]}, r"^inflow\[1\]: give at most one"),
    ({"inflow": [{"speed": 1.0, "period": 1.0, "steps": [0, 1], "factor": [0, 1]}]}, "give at most one of ramp, period and steps"),
    ({"inflow": [{"speed": 1.0, "mean": 0.0}]}, r"mean: goes with a period"),
    ({"inflow": [{"speed": 1.0, "mean": 0.5, "ramp": 1.0}]}, r"mean: goes with a period"),
    ({"inflow": [{"speed": 1.0, "steps": [0, 1]}]}, "2 steps for 0 values of factor"),
    ({"inflow": [{"speed": 1.0, "factor": [0, 1]}]}, "factor: needs steps"),
    ({"inflow": [{"speed": 1.0, "steps": [0, 1], "factor": [1, 1]}]}, "must start at 0"),
    ({"inflow": [{"speed": 1.0, "profile": "table", "along": [0, 1]}]}, "needs along and share"),
    ({"inflow": [{"speed": 1.0, "profile": "table", "share": [0, 1]}]}, "needs along and share"),
    ({"inflow": [{"speed": 1.0, "share": [0, 1]}]}, "needs along and share"),
    ({"inflow": [{"speed": 1.0, "profile": "uniform", "along": [0, 1], "share": [0, 1]}]}, "the others take neither"),
    ({"inflow": [{"speed": 1.0, "profile": "table", "along": [0.5], "share": [1]}]}, "the same number of entries, two at least"),
    ({"inflow": [{"speed": 1.0, "profile": "table", "along": [0, 1], "share": [1, 1, 1]}]}, "the same number of entries"),
    ({"inflow": [{"speed": 1.0, "profile": "table", "along": [0, 0.6, 0.5, 1], "share": [1, 1, 1, 1]}]}, "along must rise"),
    ({"inflow": [{"speed": 1.0, "profile": "table", "along": [0, 0.5, 0.5], "share": [1, 1, 1]}]}, "along must rise"),
    ({"steps": {"count": 2, "stationary": True, "duration": 1.0}}, "one frame, without a duration"),
    ({"steps": {"stationary": True, "duration": 1.0}}, "one frame, without a duration"),
    ({"steps": {"count": 2, "stationary": True}}, "one frame, without a duration"),
    ({"steps": {"count": 1}}, "steps.duration: missing")])
def test_what_does_not_go_together_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        flow(**changes)


@pytest.mark.parametrize("changes", [
    {"inflow": []}, {"inflow": [], "outflow": []}, {"steps": {"stationary": True}}, {"steps": {"count": 1, "stationary": True}},
    {"inflow": [{"speed": 1.0, "period": 1.0, "mean": 0.0}]},
    {"inflow": [{"speed": 1.0, "profile": "table", "along": [0, 1], "share": [0, 0]}]}])
def test_what_just_goes_together_is_read(changes):
    assert flow(**changes).fluid.density == 2.0


def test_what_a_force_is_told_and_what_it_finds_by_itself():
    """The largest mean speed of the inflows, either way; of a hole at (0.3, 0.2) of radius 0.05 its diameter and its ends along x."""
    body = {"shape": "channel", "hole_centre": [0.3, 0.2], "hole_radius": 0.04}
    two = [{"speed": 3.0}, {"speed": -2.5, "profile": "uniform", "where": "x-max"}]
    force = flow(body=body, inflow=two).force
    assert (force.where, force.speed) == ("hole", 2.5)
    assert force.length == pytest.approx(0.08) and np.array(force.points) == pytest.approx(np.array([[0.26, 0.2], [0.34, 0.2]]))
    scene = flow(body=body, inflow=two)
    assert scene.reynolds_number == pytest.approx(2.0 * 2.5 * 0.08 / 1e-2)
    told = flow(force={"where": "hole", "length": 0.3, "speed": 4.0, "points": [[0, 0], [1, 0.1]]}).force
    assert (told.length, told.speed, told.points) == (0.3, 4.0, ((0.0, 0.0), (1.0, 0.1)))
    wall = flow(force={"where": "walls"})
    assert (wall.force.length, wall.force.points) == (None, None) and wall.force.speed == pytest.approx(1.0)
    assert wall.reynolds_number is None
    still = flow(inflow=[], outflow=[])
    assert still.force.speed is None and still.force.length == pytest.approx(0.1) and still.reynolds_number is None
    assert flow(inflow=[{"speed": 0.0}]).force.speed is None
    plate = flow(BOX, force={"where": "y-min", "length": 2.0, "speed": 3.0})
    assert plate.force.points is None and plate.reynolds_number == pytest.approx(2.0 * 3.0 * 2.0 / 1e-2)


def test_profiles_at_the_ends_and_in_the_middle():
    s = np.array([0.0, 0.25, 0.5, 1.0])
    inflow = Inflow(speed=7.0)
    assert inflow.profile_at(s) == pytest.approx([0, 0.75, 1, 0]) and inflow.mean_speed == pytest.approx(14 / 3)
    assert dataclasses.replace(inflow, profile="uniform").profile_at(s) == pytest.approx([1, 1, 1, 1])
    table = Inflow(speed=2.0, profile="table", along=(0.25, 0.75), share=(1.0, 3.0))  # goes on as at its ends
    assert table.profile_at(s) == pytest.approx([1, 1, 2, 3])
    assert table.mean_speed == pytest.approx(2 * (0.25 * 1 + 0.5 * 2 + 0.25 * 3))


def test_a_ramp_starts_and_ends_level_and_a_period_has_its_mean():
    ramp, swing = Inflow(speed=1.0, ramp=3.0), Inflow(speed=1.0, period=8.0, mean=0.25)
    assert [ramp.factor_at(t, 9.0) for t in (0.0, 1.0, 1.5, 2.0, 3.0, 4.5)] == pytest.approx([0, 0.25, 0.5, 0.75, 1, 1], abs=1e-15)
    assert [swing.factor_at(t, 9.0) for t in (0.0, 2.0, 4.0, 6.0, 10.0)] == pytest.approx([0.25, 1, 0.25, -0.5, 1], abs=1e-15)
    assert Inflow(speed=1.0, period=8.0).factor_at(6.0, 9.0) == pytest.approx(-1)
    table = Inflow(speed=1.0, steps=(0.0, 0.5, 1.0), factor=(0.0, 2.0, -1.0))
    assert [table.factor_at(t, 4.0) for t in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)] == pytest.approx([0, 1, 2, 0.5, -1, -1])


def test_a_written_flow_has_no_keys_of_other_shapes():
    assert "height" not in flow(BOX).to_toml() and "hole_radius = 0.05" in flow().to_toml()
    assert read_any(tomllib.loads(flow(BOX).to_toml())) == flow(BOX)
