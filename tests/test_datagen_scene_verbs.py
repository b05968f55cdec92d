"""modes and simulate: what their options come to, of one process and of several, with solvers and files that are made up."""

import argparse
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from datagen import scene_verbs
from datagen.files.trajectory import at_rest, read_trajectory, write_trajectory
from physics.mesh.build import build_mesh
from physics.mesh.shapes.boxes import box
from physics.scene import Body
from physics.schema import InputError, WorkError
from tests.scenes import beam
from tests.test_physics_mesh_places import gmsh_text

COARSE = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [3, 1, 1], "cell": "hexahedron"}


def writable(path, *suffixes, option="--out"):
    return path


@pytest.fixture
def solved(tmp_path):
    """A scene of four steps and the file of a path of which three frames were made, 0, 1 and 2 mm to the side."""
    scene = beam(body=COARSE, steps={"count": 4})
    mesh = build_mesh(scene.body)
    moved = np.ones((3, len(mesh.points), 3), np.float32) * np.arange(3)[:, None, None] * np.array([0, 1e-3, 0], np.float32)
    made = replace(at_rest(mesh, np.zeros((0, len(mesh.points), 3)), scene=scene.to_toml()), displacement=moved, complete=False)
    write_trajectory(tmp_path / "t.vtkhdf", made)
    return SimpleNamespace(scene=scene, path=tmp_path / "t.vtkhdf", mesh=mesh, made=made)


def test_a_state_is_a_frame_and_its_share_of_the_steps(solved):
    """Of a path that stopped after the second of four steps."""
    for frame in range(3):
        mesh, (u, fraction) = scene_verbs._state(solved.scene, f"{solved.path}:{frame}")
        assert fraction == frame / 4 and u.dtype == np.float64 and np.array_equal(u, solved.made.displacement[frame])
        assert np.array_equal(mesh.points, solved.mesh.points)
    for at, words in ((f"{solved.path}:3", "has frames 0 .. 2"), (":1", "must be a trajectory and the number of a frame"),
                      (f"{solved.path}", "must be a trajectory"), (f"{solved.path}:", "must be a trajectory"),
                      (f"{solved.path}:-1", "must be a trajectory"), (f"{solved.path}:1.5", "must be a trajectory")):
        with pytest.raises(InputError, match=words):
            scene_verbs._state(solved.scene, at)
    with pytest.raises(InputError, match="is not a trajectory of this scene"):
        scene_verbs._state(replace(solved.scene, body=replace(solved.scene.body, length=0.07)), f"{solved.path}:1")
    write_trajectory(solved.path, replace(solved.made, scene=""))
    with pytest.raises(InputError, match="is not a trajectory of this scene"):
        scene_verbs._state(solved.scene, f"{solved.path}:1")
    points = solved.mesh.points.copy()
    points[3, 1] += 1e-9
    write_trajectory(solved.path, replace(solved.made, points=points))
    with pytest.raises(InputError, match="its mesh is not the one that the scene builds"):
        scene_verbs._state(solved.scene, f"{solved.path}:1")


@pytest.mark.parametrize("at", [None, ":2"])
@pytest.mark.parametrize("spread", [False, True])
def test_elastic_modes_are_asked_for_with_the_changes_of_the_scene_and_the_state(solved, tmp_path, monkeypatch, at, spread):
    (tmp_path / "s.toml").write_text(beam(body=COARSE, steps={"count": 4}, material={"young_modulus": 2e6, "poisson_ratio": 0.4}).to_toml())
    asked = []
    monkeypatch.setattr("physics.modes.elastic.elastic_modes", lambda scene, **how: asked.append((scene, how)))
    scene_verbs._elastic(argparse.Namespace(scene=tmp_path / "s.toml", dirichlet=None, set=["material.young_modulus=1e6"], count=7,
                                            at=at and f"{solved.path}{at}"), spread)
    (scene, how), = asked
    assert scene == solved.scene and (how["count"], how["spread"]) == (7, spread)
    if at is None:
        assert set(how) == {"count", "spread"}
    else:
        u, fraction = how["at"]
        assert fraction == 0.5 and np.array_equal(u, solved.made.displacement[2]) and how["mesh"].cell == "hexahedron"


def test_laplacian_modes_take_a_shape_and_nothing_of_a_scene(tmp_path):
    given = {"scene": tmp_path / "s.toml", "dirichlet": None, "set": [], "count": 1, "at": None}
    for wrong, words in (({"at": "t:1"}, "--at is for elastic modes"), ({"set": ["a=1"]}, "--set is for elastic modes and simulate"),
                         ({"error": 0.01}, "--error is for elastic modes and simulate")):
        with pytest.raises(InputError, match=words):
            scene_verbs._laplacian(argparse.Namespace(**given | wrong), False)


def test_modes_of_a_mesh_file_keep_its_places_and_which_file_it_was(tmp_path):
    mesh = box(Body(length=0.4, width=0.1, height=0.1, cells=(4, 1, 1), cell="hexahedron"))
    (tmp_path / "part.msh").write_text(gmsh_text(mesh, [(5, 9, mesh.cells), (3, 2, [mesh.cells[0, :4]])]))
    scene = beam(body={"shape": "file", "path": str(tmp_path / "part.msh")}, support=[{"where": "2"}])
    (tmp_path / "s.toml").write_text(scene.to_toml())
    built = build_mesh(scene.body)
    shapes = np.arange(60.0).reshape(1, 20, 3)
    found = SimpleNamespace(mesh=built, pictured=shapes, frequencies_hz=(3.5,))
    options = argparse.Namespace(kind="elastic", scene=tmp_path / "s.toml", set=["steps.count=9"])
    scene_verbs._write_modes(tmp_path / "m.vtkhdf", options, found)
    kept = read_trajectory(tmp_path / "m.vtkhdf")
    assert np.array_equal(kept.modes, shapes) and kept.frequencies_hz == (3.5,) and "count = 9" in kept.scene
    assert kept.extra["mesh_file"]["path"].endswith("part.msh") and len(kept.extra["mesh_file"]["sha256"]) == 64
    assert {name: place["nodes"].tolist() for name, place in kept.places.items()} == {"9": list(range(20)), "2": [0, 1, 2, 3]}


def test_a_process_alone_is_the_first_one_and_writes(tmp_path, monkeypatch):
    written = []
    found = SimpleNamespace(frequencies_hz=(1.0,), residuals=np.zeros(1), dofs=3, cells="1 cell", solver="dense", remarks=(), seconds=0.0,
                            clusters=[], report={})
    monkeypatch.setattr(scene_verbs, "_elastic", lambda options, spread: (None if spread else found, None))
    monkeypatch.setattr(scene_verbs, "_write_modes", lambda out, options, found, chosen: written.append(out))
    options = argparse.Namespace(kind="elastic", scene="s.toml", out="m.vtu", picture=None, html=None)
    scene_verbs.modes(options, say=lambda text: None, writable=writable)
    assert written == ["m.vtu"]
    with pytest.raises(AttributeError):  # of several the modes are asked for together
        scene_verbs.modes(options, say=lambda text: None, writable=writable, processes=2)


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """simulate with a solver of three steps; what it was given and what was written."""
    given = SimpleNamespace(how={}, written=[], failure="")
    made = replace(at_rest(build_mesh(beam(body=COARSE).body), np.zeros((0, 16, 3))), displacement=np.zeros((4, 16, 3), np.float32),
                   extra={"model": {}}, per_frame={})
    solution = SimpleNamespace(displacement=np.zeros((4, 16, 3)), seconds=0.6, newton_iterations=np.array([0, 2, 3, 4]), factorisations=1,
                               failure="", resumed=0, relative_residual=np.zeros(4), penetration=np.zeros(4), smallest_det_f=np.ones(4),
                               reaction=np.zeros((4, 3)), linear_steps=0, mesh=SimpleNamespace(remarks=("odd",)),
                               stiff=lambda scene: ("stiff",), idle=lambda scene: ())

    def solve(scene, **how):
        given.how = how
        how["on_step"](3)
        solution.failure = given.failure
        return solution

    monkeypatch.setattr("physics.solution.solve", solve)
    monkeypatch.setattr("datagen.sets.generate.trajectory_of", lambda scene, solution: made)
    monkeypatch.setattr("datagen.files.trajectory.write_trajectory", lambda path, trajectory: given.written.append((path, trajectory)))
    monkeypatch.setattr("datagen.files.fields.stress_fields", lambda *what: {"stress": np.ones((4, 16, 6), np.float32)})
    monkeypatch.setattr("datagen.files.inputs.write_table", lambda path, trajectory: given.written.append((path, "table")))
    (tmp_path / "s.toml").write_text(beam(body=COARSE).to_toml())
    given.options = {"scene": tmp_path / "s.toml", "set": ["steps.count=3"], "out": tmp_path / "t.vtkhdf", "fields": None, "csv": None,
                     "html": None}

    def run(rank=0, processes=1, **changes):
        said = []
        several = {} if processes == 1 else {"rank": rank, "processes": processes}
        result = scene_verbs.simulate(argparse.Namespace(**given.options | changes), say=said.append, writable=writable, **several)
        return result, said

    given.run = run
    return given


def test_one_process_keeps_a_journal_and_several_keep_none(asked, tmp_path):
    part = tmp_path / "t.vtkhdf.part"
    result, said = asked.run()
    assert {name: asked.how[name] for name in ("journal", "spread", "partial")} == {"journal": part, "spread": False, "partial": True}
    assert result["steps"] == 3 and result["newton_iterations"] == 9 and result["ms_per_step"] == pytest.approx(200.0)
    assert "obstacle" not in result and result["remarks"] == ["odd", "stiff"] and said[-2:] == ["odd", "stiff"]
    assert [path for path, _ in asked.written] == [tmp_path / "t.vtkhdf"]
    asked.run(processes=2)
    assert asked.how["journal"] is None and asked.how["spread"] is True and len(asked.written) == 2
    asked.run(rank=1, processes=2, csv=tmp_path / "t.csv", fields="stress")  # all compute, the first one writes
    assert len(asked.written) == 2
    part.touch()
    with pytest.raises(InputError, match="is of an unfinished run, which one process goes on with"):
        asked.run(processes=2)
    asked.failure = "no equilibrium"
    with pytest.raises(WorkError, match="the same call tries again from there, without t.vtkhdf.part from the start"):
        asked.run()
    part.unlink()
    with pytest.raises(WorkError, match=r"^no equilibrium; the 3 steps before it are in .*t.vtkhdf$"):
        asked.run(processes=2)


def test_stress_goes_into_the_file_and_the_table_beside_it(asked, tmp_path):
    asked.run(fields="stress", csv=tmp_path / "t.csv")
    (path, trajectory), (table, kind) = asked.written
    assert path == tmp_path / "t.vtkhdf" and trajectory.fields["stress"].shape == (4, 16, 6)
    assert (table, kind) == (tmp_path / "t.csv", "table")


def test_an_unfinished_run_of_another_scene_is_not_written_over(asked, tmp_path):
    made = replace(at_rest(build_mesh(beam(body=COARSE).body), np.zeros((0, 16, 3))), complete=False,
                   scene=beam(body=COARSE, steps={"count": 3}).to_toml())
    write_trajectory(tmp_path / "t.vtkhdf", made)
    asked.run()  # of the same scene it goes on
    with pytest.raises(InputError, match="an unfinished run of another scene; choose another name, or delete it to start anew"):
        asked.run(set=["steps.count=4"])
    write_trajectory(tmp_path / "t.vtkhdf", replace(made, complete=True))
    asked.run(set=["steps.count=4"])


def test_the_page_of_a_path_counts_all_steps_and_tells_their_time(tmp_path, monkeypatch):
    shown = {}
    monkeypatch.setattr("physics.view.path_exhibit", lambda title, mesh, paths, material, **how: shown.update(
        how, title=title, paths=paths, material=material) or "exhibit")
    monkeypatch.setattr("physics.view.write_page", lambda html, title, exhibits, facts:
                        shown.update(page=(html, title, exhibits), facts=facts))
    scene = beam(body=COARSE, steps={"count": 9})
    mesh = build_mesh(scene.body)
    made = replace(at_rest(mesh, np.zeros((0, 16, 3))), displacement=np.zeros((4, 16, 3), np.float32), scene=scene.to_toml(),
                   extra={"model": {"inertia": "none"}, "step_seconds": 0.5, "linear_steps": 3})
    scene_verbs.write_path(tmp_path / "p.html", "A path", made)
    assert shown["page"] == (tmp_path / "p.html", "A path", ["exhibit"]) and (shown["title"], shown["steps"]) == ("p", 9)
    assert shown["step_seconds"] == 0.5 and shown["obstacle"] is None and shown["material"].law == "linear"  # as its last frame was solved
    assert shown["facts"] == {"mesh": "16 nodes, 3 cells of the kind hexahedron", "steps": "3 of 9", "inertia": "none"}
    assert shown["paths"]["path"].shape == (4, 16, 3)
    scene_verbs.write_path(tmp_path / "p.html", "A path", replace(made, scene="", extra={}))
    assert (shown["steps"], shown["material"], shown["step_seconds"]) == (3, None, None) and shown["facts"]["steps"] == "3 of 3"
    scene_verbs.write_path(tmp_path / "p.html", "A path", replace(made, extra={"linear_steps": 2}))
    assert shown["material"].law == "neo-hookean"


@pytest.mark.parametrize("reached", [True, False])
def test_an_error_that_is_asked_replaces_the_mesh_and_its_table_is_printed_and_kept(tmp_path, monkeypatch, reached):
    """The choice is made up: another number of cells. Where it is not kept the file is written and the work has failed."""
    from physics.accuracy.table import HEADS, Verdict

    path = tmp_path / "s.toml"
    path.write_text(beam(body=COARSE | {"order": 2}, steps={"count": 1}, load=[{"where": "x-max", "traction": [1.0, 0.0, 0.0]}]).to_toml())
    verdict = Verdict(0.02, "stress", 0.01, reached, (dict(zip(HEADS, ("cells along x", "2", 0.01, None), strict=True)),), ("odd",))
    asked, said = [], []

    def choose(scene, balanced):
        assert not balanced
        asked.append(scene)
        own = beam(body=COARSE | {"cells": [2, 1, 1]}, steps={"count": 1}, load=[{"where": "x-max", "traction": [1.0, 0.0, 0.0]}])
        return SimpleNamespace(scene=own, mesh=build_mesh(own.body), tolerance=1e-7, small_strain=2e-3)

    monkeypatch.setattr("physics.accuracy.answer.choose", choose)
    monkeypatch.setattr("physics.accuracy.answer.judge", lambda choice, solution: verdict)
    options = argparse.Namespace(scene=path, out=tmp_path / "t.vtkhdf", csv=None, html=None, fields=None, set=[], error=0.02,
                                 quantity="stress")

    def run():
        return scene_verbs.simulate(options, say=said.append, writable=writable)

    if reached:
        assert run()["accuracy"] == verdict.table()
    else:
        with pytest.raises(WorkError, match="is not promised") as failed:
            run()
        assert failed.value.result["accuracy"]["reached"] is False
    (scene,) = asked
    assert (scene.steps.error, scene.steps.quantity, scene.body.cells, scene.body.order) == (0.02, "stress", None, 1)
    made = read_trajectory(tmp_path / "t.vtkhdf")
    assert len(made.mesh.cells) == 2 and made.extra["accuracy"] == verdict.table() and "error" not in made.scene
    assert any(line.split() == ["cells", "along", "x", "2", "0.01"] for line in said) and said[-1] == "odd"


def test_an_error_that_is_asked_of_a_motion_chooses_its_steps_of_time(tmp_path):
    """A free body that falls: 16 steps are as good as any; its file has the frames that were asked for, and says what was solved."""
    path = tmp_path / "s.toml"
    falling = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [2, 1, 1]}, support=[],
                   load=[{"acceleration": [0.0, 0.0, -9.81], "sudden": True}], steps={"count": 32, "duration": 0.2, "dynamic": True})
    path.write_text(falling.to_toml())
    options = argparse.Namespace(scene=path, out=tmp_path / "t.vtkhdf", csv=None, html=None, fields=None, set=[], error=0.1, quantity=None)
    result = scene_verbs.simulate(options, say=lambda text: None, writable=writable)
    assert result["accuracy"]["reached"] and result["steps"] == 32 and result["model"]["steps"] == "16 of time for 32 frames"
    made = read_trajectory(tmp_path / "t.vtkhdf")
    np.testing.assert_allclose(made.displacement[:, 0, 2], -9.81 / 2 * np.linspace(0, 0.2, 33) ** 2, atol=1e-6)
    assert made.extra["accuracy"]["asked"] == 0.1 and made.extra["step_seconds"] == pytest.approx(0.2 / 32)
