"""Scenes that ask for an error: what is chosen, whether the error is kept, and what is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from physics.accuracy import pilot
from physics.accuracy.choose import choose
from physics.accuracy.estimate import distance
from physics.accuracy.meshes.ladder import families, points_of
from physics.accuracy.motion import choose_motion
from physics.accuracy.table import HEADS, judge
from physics.mesh.build import build_mesh
from physics.mesh.files import write_mesh
from physics.mesh.shapes.boxes import box
from physics.scene import Body, Scene, Steps, read_scene
from physics.schema import InputError
from physics.solution import solve, through_held
from tests.scenes import beam

SIDES = {"length": 0.06, "width": 0.02, "height": 0.02}


def asked(error=0.05, **changes):
    """A beam in small bending by a traction at its end, of which an error is asked."""
    traction = [{"where": "x-max", "traction": [0.0, 0.0, -1.0]}]
    steps = {"count": 2, "error": error} | changes.pop("steps", {})
    return beam(**({"body": SIDES, "load": traction, "steps": steps} | changes))


@pytest.fixture(scope="module")
def bent():
    scene = asked()
    choice = choose(scene)
    solution = solve(choice.scene, mesh=choice.mesh, tolerance=choice.tolerance, small_strain=choice.small_strain)
    return scene, choice, solution, judge(choice, solution)


def test_a_bar_pulled_evenly_is_exact_on_the_coarsest_mesh_of_first_order():
    """u = sigma / E (x, -nu y, -nu z), which cells of any size hold."""
    rollers = [{"where": f"{axis}-min", "fixed": axis} for axis in "xyz"]
    scene = asked(support=rollers, load=[{"where": "x-max", "traction": [10.0, 0.0, 0.0]}])
    choice = choose(scene)
    assert choice.climb.family.order == 1 and choice.climb.sizes == choice.climb.family.base and choice.climb.error < 1e-6
    u = choice.pilot.values[-1]
    exact = choice.pilots.points * [1e-5, -4e-6, -4e-6]
    assert abs(u - exact).max() < 5e-3 * abs(exact).max()  # small strain may make 0.005 of it


def test_a_bent_beam_keeps_the_error_against_much_finer_cells_of_second_order(bent):
    _, choice, solution, verdict = bent
    fine = replace(choice.scene.body, cells=(16, 5, 5), cell="hexahedron", order=2, element="standard")
    truth = solve(replace(choice.scene, body=fine, steps=replace(choice.scene.steps, count=1)))
    pilots = choice.pilots
    true = distance(pilots.of(choice.scene, solution, [2]), pilots.of(choice.scene, truth, [1]), pilots.weights)
    assert verdict.reached and 0.05 / 20 < true < 0.05
    assert true < verdict.estimated <= 0.05


def test_the_table_has_a_row_for_each_choice_and_its_shares_make_the_whole(bent):
    *_, verdict = bent
    rows = {row["choice"]: row for row in verdict.rows}
    assert all(tuple(row) == HEADS for row in verdict.rows)
    parts = ("cells along x", "cells along y", "cells along z", "kinematics", "tolerance", "steps", "the path")
    assert {*parts, "the whole scene", "next finer", "the search"} <= set(rows)
    assert sum(rows[name]["error"] for name in parts) == pytest.approx(rows["the whole scene"]["error"]) == verdict.estimated
    assert rows["next finer"]["error"] < rows["the whole scene"]["error"]
    assert "next coarser" not in rows or rows["next coarser"]["error"] > 0.8 * 0.05
    lines = verdict.lines()
    assert lines[0].startswith("error of the displacement: 0.05 asked") and lines[0].endswith("kept") and lines[1].split() == list(HEADS)
    assert verdict.table()["rows"] == list(verdict.rows)


def test_small_strain_is_tried_until_a_mesh_is_too_far_for_it(bent):
    """A traction a thousand times as large bends the beam by F L^3 / 3 E I = 2.2 mm."""
    _, small, solution, _ = bent
    assert small.small_strain > 0 and solution.linear_steps == 2
    far = choose(asked(load=[{"where": "x-max", "traction": [0.0, 0.0, -1000.0]}]))
    assert far.small_strain == 0
    found = solve(far.scene, mesh=far.mesh, tolerance=far.tolerance, small_strain=0.0)
    assert found.linear_steps == 0 and 0.002 < np.abs(found.displacement).max() < 0.0025


def test_the_same_scene_leads_to_the_same_choice(bent):
    scene, choice, _, _ = bent
    again = choose(scene)
    assert again.scene == choice.scene and again.tolerance == choice.tolerance
    assert np.array_equal(again.pilot.values, choice.pilot.values)


def test_what_is_solved_is_a_scene_of_its_own_that_asks_for_nothing(bent):
    _, choice, _, _ = bent
    assert choice.scene.steps.error is None and Scene.from_toml(choice.scene.to_toml()) == choice.scene
    assert np.array_equal(build_mesh(choice.scene.body).points, choice.mesh.points)


def test_an_error_beyond_the_nodes_allowed_is_not_promised():
    scene = asked(error=1e-4)
    choice = choose(scene, most=250)
    assert not choice.climb.reached and choice.climb.error > 1e-4
    solution = solve(choice.scene, mesh=choice.mesh)
    verdict = judge(choice, solution)
    assert not verdict.reached and "is not promised" in verdict.not_kept() and verdict.lines()[0].endswith("NOT kept")


def test_a_pilot_that_took_no_time_by_the_clock_tells_no_seconds_of_other_meshes(bent, monkeypatch):
    _, choice, solution, verdict = bent
    stopped = replace(choice.pilot, seconds=0.0)
    monkeypatch.setattr(type(choice), "pilot", property(lambda choice: stopped))
    rows = {row["choice"]: row["seconds"] for row in judge(choice, solution).rows}
    assert rows["next coarser"] is None and rows["the whole scene"] == solution.seconds
    assert {row["choice"]: row["seconds"] for row in verdict.rows}["next coarser"] > 0


def test_what_pilots_have_at_their_points_is_that_of_the_mesh_asked_for_whichever_was_asked_before(bent):
    """Displacements x and then 2 x, which cells of any size hold."""
    pilots = bent[1].pilots
    family = families(bent[0])[0]
    meshes = [family.rung(sizes)[1] for sizes in ((6, 2, 2), (5, 3, 2))]
    for factor, mesh in zip((1.0, 2.0, 1.0, 2.0), [*meshes, *meshes], strict=True):
        solution = SimpleNamespace(mesh=mesh, displacement=factor * mesh.points[None], reaction=np.zeros((1, 3)), linear_steps=0)
        assert pilots.of(bent[0], solution, [0])[0] == pytest.approx(factor * pilots.points, rel=1e-12)


def test_points_of_comparison_lie_in_all_meshes_of_a_box_and_weigh_one():
    first = families(asked())[0]
    points, weights = points_of(first)
    assert weights.sum() == pytest.approx(1) and points.min() > 0 and np.all(points.max(axis=0) < [0.06, 0.02, 0.02])
    assert points.mean(axis=0) == pytest.approx([0.03, 0.01, 0.01])


@pytest.mark.parametrize("changes, words", [
    ({"body": SIDES | {"cells": [3, 1, 1]}},
     "body.cells: steps.error decides cells, cell_size, graded, focus_x, focus_y, focus_z, layers, order, element, cell; leave cells"),
    ({"body": SIDES | {"order": 2, "cell": "hexahedron"}}, "leave order and cell out"),
    ({"steps": {"error": 0.0}}, "steps.error = 0.0"),
    ({"steps": {"error": 1.0}}, "steps.error = 1.0"),
    ({"steps": {"quantity": "strain"}}, "steps.quantity = 'strain': must be one of displacement, reaction, stress"),
])
def test_what_cannot_be_asked_for_is_refused_in_one_line(changes, words):
    with pytest.raises(InputError, match="steps|body") as refused:
        asked(**changes)
    assert words in str(refused.value) and "\n" not in str(refused.value)


def test_a_quantity_without_an_error_and_a_mesh_that_only_simulate_chooses_are_refused():
    with pytest.raises(InputError, match="steps.quantity: needs error"):
        beam(steps={"count": 1, "quantity": "stress"})
    with pytest.raises(InputError, match="steps.error, which chooses them, is for simulate, generate and modes$"):
        build_mesh(asked().body)


def test_a_scene_that_asks_is_written_and_read_back_and_one_that_does_not_says_nothing_of_it():
    scene = asked(steps={"quantity": "reaction"})
    assert Scene.from_toml(scene.to_toml()) == scene
    text = beam().to_toml()
    assert "error" not in text and "quantity" not in text
    plane = read_scene({"body": {"shape": "plate", "length": 1.0, "width": 1.0, "cell": "triangle"}, "steps": {"error": 0.1},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}})
    assert Scene.from_toml(plane.to_toml()) == plane and families(plane)[0].axes == ("x", "y")


def test_a_scene_that_no_mesh_mends_is_refused_before_its_meshes_are_too_large(tmp_path, monkeypatch):
    """A file's 24 nodes, hinged at an edge: of its halves' some 100 and 500 nodes the first are tried, the others are more than 300."""
    write_mesh(tmp_path / "box.vtu", box(Body(length=0.06, width=0.02, height=0.01, cells=(3, 2, 1), cell="tetrahedron")), {})
    scene = asked(body={"shape": "file", "path": str(tmp_path / "box.vtu")}, support=[{"where": {"box": [[0, 0, 0], [1e-6, 1, 1e-6]]}}],
                  load=[{"acceleration": [0, 0, -1.0]}])
    tried = []
    monkeypatch.setattr(pilot, "solve", lambda scene, mesh, **_: tried.append(len(mesh.points)) or solve(scene, mesh=mesh))
    with pytest.raises(InputError, match="1 rigid motion of the body left free"):
        choose(scene, most=300)
    assert max(tried) <= 300 and len(tried) == 3


def test_stress_that_is_asked_for_is_kept_where_two_meshes_alone_would_have_it_fall_too_fast():
    """A beam clamped at both ends under its own weight: one refinement looked as if the stress of bricks fell as h^1.5."""
    scene = asked(error=0.15, body={"length": 0.06, "width": 0.02, "height": 0.01}, support=[{"where": "x-min"}, {"where": "x-max"}],
                  load=[{"acceleration": [0, 0, -9.81]}], steps={"quantity": "stress"})
    choice = choose(scene)
    fine = choice.pilots.beside(*families(scene)[0].rung((20, 6, 4)), 1e-6, choice.pilot, choice.pilots.fractions)
    true = distance(choice.pilot.values, fine.values, choice.pilots.weights)
    assert choice.climb.reached and true < choice.climb.error <= 0.15


def lowered(to, back=None, support=None):
    """A beam 10 mm high that is held at x = 0, under a plate that comes down to a height."""
    path = [[0, 0, 0.011], [0, 0, to], *([] if back is None else [[0, 0, back]])]
    return beam(body=SIDES | {"height": 0.01, "cells": [6, 2, 2]}, steps={"count": 10},
                obstacle={"shape": "half-space", "normal": [0, 0, -1], "path": path},
                support=support or [{"where": "x-min"}])


@pytest.mark.parametrize("scene, deep", [
    (lowered(0.006), 0.004),
    (lowered(0.006, back=0.011), 0.004),  # and comes up again
    (lowered(0.01), 0.0),  # touches
    (lowered(0.006, support=[{"where": "x-min", "displacement": [0, 0, -0.004]}]), 0.0),  # the support goes before it
    (lowered(0.006, support=[{"where": "x-min", "fixed": "xy"}, {"where": "z-min"}]), 0.0),  # what it presses may give way
    (lowered(0.006, support=[{"where": "z-max"}]), 0.004),
])
def test_how_deep_an_obstacle_passes_into_what_is_held(scene, deep):
    assert through_held(scene, build_mesh(scene.body)) == pytest.approx(deep, rel=1e-9)


def test_no_error_is_kept_where_an_obstacle_passes_through_what_is_held():
    scene = replace(lowered(0.006), body=replace(lowered(0.006).body, cells=None))
    for dynamic, ask in ((False, choose), (True, choose_motion)):
        steps = replace(scene.steps, error=0.1, dynamic=dynamic, duration=1.0)
        with pytest.raises(InputError, match="obstacle: passes through points that are held, by up to 0.004 m: forces beside them grow"):
            ask(replace(scene, steps=steps))
    found = solve(replace(lowered(0.0095), steps=Steps(count=2)))
    assert found.model["held"].startswith("an obstacle passes through points that are held, by up to 0.0005 m")
    assert "held" not in solve(replace(lowered(0.01), steps=Steps(count=2))).model
