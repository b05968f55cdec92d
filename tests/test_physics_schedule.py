"""Loads, supports and obstacles by tables of steps, and supports that turn: shares, closed forms, back to rest, contradictions."""

import numpy as np
import pytest

from datagen.sets.check import against_scene
from datagen.sets.generate import trajectory_of
from physics import journal
from physics.body.schedule import Moves, share, turned
from physics.fidelity.verify import Checker
from physics.mesh.build import build_mesh
from physics.motion.inertia import legs
from physics.scene import Load, Scene, Support
from physics.schema import InputError
from physics.solution import solve
from tests.scenes import beam, pressed

UP_AND_DOWN = {"steps": [0.0, 0.5, 1.0], "factor": [0.0, 1.0, 0.0]}
COARSE = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [6, 2, 2]}


def pushed(**more):
    return {"where": "x-max", "traction": [0.0, 0.0, -2000.0]} | more


def test_the_share_lies_on_straight_lines_between_the_rows():
    load = Load(where="x-max", traction=(1.0, 0.0, 0.0), steps=(0.0, 0.2, 1.0), factor=(0.0, 3.0, -1.0))
    assert [share(load, at) for at in (0.0, 0.1, 0.2, 0.4, 1.0)] == pytest.approx([0, 1.5, 3, 2, -1])
    assert share(Load(where="x-max", traction=(1.0, 0.0, 0.0)), 0.3) == 0.3


@pytest.mark.parametrize("law", ["neo-hookean", "linear"])
@pytest.mark.parametrize("load", [pushed(), {"where": "z-max", "pressure": 1000.0},
                                  {"where": "z-max", "pressure": 1000.0, "follower": True}, {"acceleration": [0.0, 0.0, -40.0]}])
def test_up_and_down_again_is_the_way_up_backwards_and_ends_at_rest(law, load):
    if load.get("follower") and law == "linear":
        return
    material = {"law": law, "young_modulus": 1e6, "poisson_ratio": 0.4}
    both = solve(beam(body=COARSE, material=material, load=[load | UP_AND_DOWN], steps={"count": 8}))
    up = solve(beam(body=COARSE, material=material, load=[load], steps={"count": 4}))
    assert not both.failure
    largest = abs(up.displacement[-1]).max()
    assert largest > 1e-3
    # Equilibria to 1e-6 of the reaction; a bending beam is some hundred times softer than its stiffest part.
    np.testing.assert_allclose(both.displacement[:5], up.displacement, atol=1e-5 * largest)
    np.testing.assert_allclose(both.displacement[4:], up.displacement[::-1], atol=1e-5 * largest)
    assert abs(both.displacement[-1]).max() < 1e-6 * largest


def test_a_support_by_a_table_leads_its_nodes_and_brings_them_back():
    support = [{"where": "x-min"}, {"where": "x-max", "fixed": "xz", "displacement": [0.003, 0, -0.006], **UP_AND_DOWN}]
    scene = beam(body=COARSE, support=support, steps={"count": 8})
    solution = solve(scene)
    end = abs(solution.mesh.points[:, 0] - 0.06) < 1e-9
    for step, factor in enumerate([0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0]):
        led = solution.displacement[step, end]
        np.testing.assert_allclose(led[:, [0, 2]], np.tile([0.003 * factor, -0.006 * factor], (len(led), 1)), atol=1e-15)
    assert abs(solution.displacement[-1]).max() < 1e-6 * 0.006 < abs(solution.displacement[4]).max()
    assert against_scene(trajectory_of(scene, solution=solution)) == []


def test_an_obstacle_by_a_table_presses_and_lets_go():
    low, high = [0.05, 0.01, 0.0255], [0.05, 0.01, 0.0305]
    obstacle = {"shape": "cylinder", "radius": 0.01, "path": [high, low, high], "steps": [0.0, 0.25, 1.0]}
    scene = pressed(body=COARSE, obstacle=obstacle, steps={"count": 8})
    solution = solve(scene)
    deepest = solve(pressed(body=COARSE, obstacle={**obstacle, "path": [high, low], "steps": [0.0, 1.0]}, steps={"count": 2}))
    np.testing.assert_allclose(solution.displacement[2], deepest.displacement[-1], atol=1e-5 * abs(deepest.displacement).max())
    assert abs(solution.displacement[-1]).max() < 1e-6 * abs(solution.displacement).max() and solution.reaction[-1].tolist() == [0, 0, 0]
    assert against_scene(trajectory_of(scene, solution=solution)) == []
    assert legs(scene) == 4 and legs(pressed()) == 1 and legs(beam(load=[pushed(**UP_AND_DOWN)])) == 2


@pytest.mark.parametrize("axis, angle, expected", [
    ([0, 0, 2.0], 90.0, [-2, 1, 3]), ([1.0, 0, 0], 90.0, [1, -3, 2]), ([0, 1.0, 0], 180.0, [-1, 2, -3]),
    ([1.0, 1.0, 1.0], 120.0, [3, 1, 2])])
def test_a_turn_is_the_rotation_of_textbooks(axis, angle, expected):
    support = Support(where="x-max", axis=tuple(axis), angle=angle, centre=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(turned(np.array([[1.0, 2.0, 3.0]]), support, 1.0), [expected], atol=1e-14)
    np.testing.assert_allclose(turned(turned(np.array([[1.0, 2.0, 3.0]]), support, 0.25), support, 0.75), [expected], atol=1e-14)


def test_a_twisted_bar_has_the_torque_of_saint_venant():
    """A square bar of side a, one end turned by a small angle t about its axis: T = 0.1406 G a^4 t / L (Timoshenko and Goodier, art. 109).
    Both ends are held against warping, which stiffens a bar of length 10 a by some percent; its mesh does by some more."""
    scene = beam(body={"length": 0.2, "width": 0.02, "height": 0.02, "cells": [40, 8, 8], "cell": "hexahedron"}, steps={"count": 1},
                 material={"law": "neo-hookean", "young_modulus": 1e6, "poisson_ratio": 0.0},
                 support=[{"where": "x-min"}, {"where": "x-max", "axis": [1, 0, 0], "angle": 1.0}])
    solution = solve(scene)
    mesh = solution.mesh
    force = Checker(scene, mesh).balance.elasticity.force(solution.displacement[-1])
    end = abs(mesh.points[:, 0] - 0.2) < 1e-9
    arm = mesh.points[end] - [0.2, 0.01, 0.01]
    torque = np.cross(arm, force[end]).sum(axis=0)
    theory = 0.1406 * 0.5e6 * 0.02**4 * np.radians(1.0) / 0.2
    assert theory < torque[0] < 1.06 * theory and abs(torque[1:]).max() < 1e-3 * theory


def test_a_bar_turned_as_a_whole_is_not_strained():
    turn = {"axis": [0.0, 1.0, 0.0], "angle": 200.0, "centre": [0.01, 0.0, 0.03]}
    scene = beam(body=COARSE, support=[{"where": "x-min", **turn}, {"where": "x-max", **turn}], steps={"count": 10})
    solution = solve(scene)
    assert not solution.failure and solution.energy.max() < 1e-9 * 1e6 * 0.06 * 0.02**2
    back = Support(where="x-min", axis=(0.0, 1.0, 0.0), angle=200.0, centre=(0.01, 0.0, 0.03))
    np.testing.assert_allclose(solution.displacement[-1], turned(solution.mesh.points, back, 1.0) - solution.mesh.points, atol=1e-7)


def test_a_shaken_bar_in_motion_starts_and_stops_with_its_support():
    """One step of a stiff bar on a support that goes up and down: the free end follows, and the held velocity is that of the table."""
    support = [{"where": "x-min", "displacement": [0, 0, 0.001], **UP_AND_DOWN}]
    scene = beam(body=COARSE, material={"young_modulus": 1e9, "poisson_ratio": 0.4}, support=support,
                 steps={"count": 40, "dynamic": True, "duration": 0.4})
    solution = solve(scene)
    held = abs(solution.mesh.points[:, 0]) < 1e-9
    np.testing.assert_allclose(solution.displacement[20, held, 2], 0.001, rtol=1e-12)
    assert abs(solution.displacement[-1, held]).max() < 1e-15
    assert solution.displacement[20, ~held, 2].min() > 0.0008 and abs(solution.displacement[-1, ~held, 2]).max() < 0.0003


def test_a_load_by_a_table_in_motion_has_the_impulse_of_its_area():
    """A free block under a force F that rises to its peak and falls: momentum F t / 2; steps that end at the peak make it exact."""
    scene = beam(body={**COARSE, "cells": [2, 1, 1]}, support=[], load=[pushed(**UP_AND_DOWN)],
                 steps={"count": 20, "dynamic": True, "duration": 0.01})
    mass, force = 1000.0 * 0.06 * 0.02**2, 2000.0 * 0.02**2
    solution = solve(scene)
    mean = solution.displacement[:, :, 2] @ np.ones(12) / 12  # of the nodes: ends and middle weigh differently, hence the tolerance
    speed = (mean[-1] - mean[-3]) / (2 * 0.01 / 20)
    assert speed == pytest.approx(-force * 0.01 / 2 / mass, rel=0.2)
    momentum = solution.displacement[-1, :, 2] - solution.displacement[-2, :, 2]
    weight = np.where(abs(solution.mesh.points[:, 0] - 0.03) < 1e-9, 2, 1)
    assert (momentum @ weight) / weight.sum() / (0.01 / 20) == pytest.approx(-force * 0.01 / 2 / mass, rel=0.02)


def test_in_motion_a_table_that_grows_evenly_is_none():
    even = {"steps": [0.0, 0.3, 1.0], "factor": [0.0, 0.3, 1.0]}
    paths = [solve(beam(body=COARSE, load=[pushed(**more)], steps={"count": 10, "dynamic": True, "duration": 0.05},
                        support=[{"where": "x-min", "displacement": [0, 0.002, 0.001], **more}])) for more in ({}, even)]
    for name in ("displacement", "kinetic_energy"):
        one, other = (getattr(path, name) for path in paths)
        np.testing.assert_allclose(other, one, atol=1e-9 * abs(one).max())


def test_a_path_by_a_table_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr(journal, "EVERY", 0.0)
    scene = beam(body=COARSE, load=[pushed(**UP_AND_DOWN)], steps={"count": 8})

    def stop(step):
        if step == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve(scene, journal=tmp_path / "j", on_step=stop)
    again = solve(scene, journal=tmp_path / "j")
    assert again.resumed > 0 and np.array_equal(again.displacement, solve(scene).displacement)


def test_scenes_with_tables_and_turns_are_written_and_read():
    obstacle = {"shape": "sphere", "radius": 0.01, "path": [[0, 0, 1.0], [0, 0, 2.0]], "steps": [0.0, 1.0]}
    scene = beam(load=[pushed(**UP_AND_DOWN)], obstacle=obstacle,
                 support=[{"where": "x-min", "axis": [0, 0, 1], "angle": 3, "centre": [0, 0, 0], **UP_AND_DOWN}])
    assert Scene.from_toml(scene.to_toml()) == scene and scene.load[0].factor == (0.0, 1.0, 0.0)
    plain = beam(load=[pushed()]).to_toml()
    assert not any(key in plain for key in ("factor", "angle", "axis", "centre", "steps =", "follower", "pressure"))


@pytest.mark.parametrize("first, second, same", [
    ({**UP_AND_DOWN}, {**UP_AND_DOWN}, True), ({**UP_AND_DOWN}, {}, False),
    ({"axis": [0, 0, 1], "angle": 5.0}, {"axis": [0, 0, 1], "angle": 5.0}, False),  # each about the mean of its own nodes
    ({"axis": [0, 0, 1], "angle": 5.0, "centre": [0, 0, 0]}, {"axis": [0, 0, 1], "angle": 5.0, "centre": [0, 0, 0]}, True),
    ({"axis": [0, 0, 1], "angle": 0.0}, {"displacement": [0, 0, 0]}, False)])
def test_supports_that_share_nodes_must_move_them_alike(first, second, same):
    base = {"displacement": [0, 0, 0.001]}
    scene = beam(support=[{"where": "x-min"} | base | first, {"where": "z-min"} | base | second])
    if same:
        Moves(scene, build_mesh(scene.body))
        return
    with pytest.raises(InputError, match=r"support\[1\]: gives the . displacement"):
        Moves(scene, build_mesh(scene.body))
