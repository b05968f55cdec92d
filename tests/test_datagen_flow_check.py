"""Each of the things that contradict a flow's scene, at its limit, on few cells; the solver stands in."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from datagen.flow import check
from datagen.flow.check import ANEW, HALF_ULP, LEAK, against_flow, tolerance_of
from physics.flow.space import FlowSpace
from physics.flow.stored import computed_mesh, stored
from physics.scene import Body, FlowScene
from physics.scene.flow import FlowSteps, Fluid, Inflow, Outflow

STEPS = FlowSteps(count=10, duration=5.0)


def setting(order, steps=STEPS, **inflow):
    """2 x 1 m with a uniform inflow whose ramp is done at 4 s: scene, space, stored mesh."""
    body = Body(shape="plate", length=2.0, width=1.0, cells=(6, 4), cell="triangle")
    inflow = Inflow(**{"where": "x-min", "speed": 2.0, "profile": "uniform", "ramp": 4.0} | inflow)
    scene = FlowScene(body=body, fluid=Fluid(density=1.0, viscosity=1.0, order=order), inflow=(inflow,),
                      outflow=(Outflow(where="x-max"),), steps=steps)
    space = FlowSpace(computed_mesh(scene), order)
    return scene, space, stored(scene, space)


def frames_of(scene, where):
    """(T, S, 2) what is given at the inlet, and 7 m/s where nothing is; walls at rest."""
    x, y = np.round(where.mesh.points[:, :2] - where.mesh.points[:, :2].min(axis=0), 9).T
    velocity = np.full((scene.steps.count + 1, len(x), 2), 7.0)
    for frame in range(len(velocity)):
        velocity[frame, x == 0] = 2.0 * (1 - np.cos(np.pi * min(frame * 0.5 / 4.0, 1.0))) / 2, 0.0
    velocity[:, (y == 0) | (y == 1)] = 0.0
    return velocity, (x, y)


@pytest.mark.parametrize("order", (2, 3))
def test_velocities_at_inlets_and_walls_are_those_of_the_frames_time(order):
    scene, space, where = setting(order)
    velocity, (x, y) = frames_of(scene, where)
    assert where.halved == (order == 3)
    assert check._boundary(velocity, scene, space, where.halved, 1e-12) == []
    middle = np.flatnonzero((x == 0) & (y == 0.25 if order == 3 else y == 0.5))
    for node, size in ((middle[0], 0.2), (np.flatnonzero((y == 1) & (x == x[(x > 0.1) & (y == 1)].min()))[0], -0.2)):
        off = velocity.copy()
        off[6, node, 1] += size
        assert check._boundary(off, scene, space, where.halved, 0.19) == ["the velocity at inlets and walls is off by 0.2 m/s in frame 6"]
        assert check._boundary(off, scene, space, where.halved, 0.21) == []


@pytest.mark.parametrize("steps, frame", [(5, 2), (10, 1), (1, 10), (3, 3)])
def test_frames_evenly_spaced_up_to_the_last_are_looked_at_for_divergence(steps, frame):
    """(a x, 0) has the divergence a everywhere; allowed are 0.05 of 3 m/s over the root of the cells' mean area."""
    scene, space, where = setting(3)
    allowed = 0.05 * 3.0 / np.sqrt(2.0 / len(space.mesh.cells))
    assert LEAK == 0.05 and len(space.mesh.cells) == 12
    x = where.mesh.points[:, 0]
    for share, fine in ((0.999, True), (1.001, False)):
        velocity = np.zeros((11, len(x), 2))
        velocity[frame, :, 0] = share * allowed * x
        said = check._leaks(velocity, scene, space, True, steps, 3.0)
        words = f"the divergence in frame {frame} is {share * allowed:.2g} 1/s, where {allowed:.2g} 1/s is allowed"
        assert said == ([] if fine else [words])
    last = np.zeros((11, len(x), 2))
    last[0, :, 0] = last[-2, :, 0] = 9 * x
    assert check._leaks(last, scene, space, True, 2, 3.0) == [] == check._leaks(velocity, scene, space, False, steps, 3.0)


@pytest.fixture
def solver(monkeypatch):
    """Solves anew what is 1 everywhere in velocity, 2 in pressure; the scenes it was given."""
    scenes = []

    def solved(scene):
        scenes.append(scene)
        frames = scene.steps.count + 1
        return SimpleNamespace(velocity=np.ones((frames, 3, 3)), pressure=np.full((frames, 3, 1), 2.0),
                               per_frame={"drag": np.arange(1.0, frames + 1), "none": np.zeros(frames)})

    monkeypatch.setattr(check, "solve_flow", solved)
    return scenes


def made(**changes):
    parts = {"fields": {"velocity": np.ones((11, 3, 3)), "pressure": np.full((11, 3, 1), 2.0)}, "extra": {},
             "per_frame": {"drag": np.arange(1.0, 12), "other": np.zeros(11)}}
    return SimpleNamespace(**parts | changes)


def test_the_first_frames_are_computed_anew_over_their_share_of_the_duration(solver):
    scene, _, _ = setting(3)
    assert check._anew(made(), scene, 4) == [] == check._anew(made(), scene, 99)
    assert [(each.steps.count, each.steps.duration) for each in solver] == [(4, 2.0), (10, 5.0)]
    assert solver[1] == scene


def test_where_factors_are_shares_of_the_duration_all_of_it_is_computed_and_a_stationary_flow_as_it_is(solver):
    scene, _, _ = setting(3)
    shares = replace(scene, inflow=(replace(scene.inflow[0], ramp=None, steps=(0.0, 1.0), factor=(0.0, 1.0)),))
    assert check._anew(made(), shares, 4) == [] and solver[0] == shares
    still = replace(scene, steps=FlowSteps(stationary=True))
    assert check._anew(made(), still, 4) == [] and solver[1] == still


@pytest.mark.parametrize("name, size", [("velocity", 1.0), ("pressure", 2.0)])
def test_a_frame_that_differs_by_a_hundred_thousandth_of_the_largest_value_is_another(solver, name, size):
    """And by what packing may have changed besides."""
    assert ANEW == 1e-5
    scene, _, _ = setting(3)
    for tolerance in (0.0, 0.5):
        for share, fine in ((0.99, True), (1.01, False)):
            found = made(extra={"field_tolerance": {name: tolerance}})
            found.fields[name] = found.fields[name].copy()
            found.fields[name][3, 1, 0] -= share * (ANEW * size + tolerance)
            assert bool(check._anew(found, scene, 4)) != fine
            if not fine:
                assert check._anew(found, scene, 4)[0].startswith(f"the {name} of the first frames, computed anew, differs by ")
                assert check._anew(found, scene, 2) == []


def test_figures_of_a_frame_are_the_same_to_a_thousandth_or_a_millionth_of_the_largest(solver):
    scene, _, _ = setting(3)
    for change, fine in ((0.99e-3 * 4, True), (1.01e-3 * 4 + 5e-6, False)):
        drag = np.arange(1.0, 12)
        drag[3] += change  # of 4, beside 5 in the frames that are computed
        words = "drag of the first frames, computed anew, is another"
        assert check._anew(made(per_frame={"drag": drag}), scene, 4) == ([] if fine else [words])
    assert check._anew(made(per_frame={"none": np.full(11, 1e-9)}), scene, 4) == ["none of the first frames, computed anew, is another"]


def test_a_tolerance_is_that_of_the_field_or_none():
    assert tolerance_of(made(), "velocity") == 0.0 == tolerance_of(made(extra={"field_tolerance": 3.0}), "velocity")
    found = made(extra={"field_tolerance": {"velocity": 0.25}})
    assert tolerance_of(found, "velocity") == 0.25 and tolerance_of(found, "pressure") == 0.0


def whole(order=2, **changes):
    """A file of a setting whose boundary is right, and its scene."""
    scene, _, where = setting(order)
    velocity, _ = frames_of(scene, where)
    fields = {"velocity": np.pad(velocity, ((0, 0), (0, 0), (0, 1))), "pressure": np.zeros((11, len(where.mesh.points), 1))}
    return SimpleNamespace(**{"fields": fields, "extra": {}, "displacement": np.zeros((11, 1, 3)), "points": where.mesh.points,
                              "connectivity": where.mesh.cells.ravel(), "per_frame": {}} | changes), scene


def test_the_boundary_may_be_off_by_two_units_in_the_last_place_of_the_fastest_fluid_or_by_what_packing_changed(monkeypatch):
    """Seven metres a second: 4 x 2^-24 x 7. What was computed anew does not count here."""
    monkeypatch.setattr(check, "_anew", lambda trajectory, scene, steps: [f"{steps} anew"])
    for tolerance in (0.0, 1e-3):
        for share, fine in ((0.99, True), (1.01, False)):
            found, scene = whole(extra={"field_tolerance": {"velocity": tolerance}})
            x = found.points[:, 0]
            found.fields["velocity"][4, np.flatnonzero(x == x.min())[1], 1] += share * max(4 * HALF_ULP * 7.0, tolerance)
            said = against_flow(found, scene, steps=3)
            assert said == ["3 anew"] if fine else said[0].startswith("the velocity at inlets and walls is off by")
    assert HALF_ULP == 2.0**-24


def test_other_frames_another_mesh_and_missing_fields_are_said_first():
    found, scene = whole()
    assert against_flow(SimpleNamespace(**vars(found) | {"displacement": np.zeros((10, 1, 3))}), scene) == ["10 frames for 10"]
    for change in ({"points": found.points + 1e-9}, {"connectivity": found.connectivity[::-1]}):
        assert against_flow(SimpleNamespace(**vars(found) | change), scene) == ["the mesh is not that of its scene"]
    del found.fields["pressure"]
    assert against_flow(found, scene) == ["has no pressure"]
