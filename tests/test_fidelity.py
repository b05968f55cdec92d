"""The command line's own part: exit statuses, one line for what is wrong, numbers of modes and simulations from objects made by hand."""

import argparse
import importlib.util
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fidelity
from datagen import scene_verbs
from datagen.files.trajectory import read_trajectory, write_trajectory
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.schema import InputError, WorkError
from tests.scenes import beam
from tests.synthetic import bending


def called(capsys, *arguments):
    """Status, standard output and standard error of a command."""
    try:
        status = fidelity.main([str(argument) for argument in arguments])
    except SystemExit as stop:
        status = stop.code
    return status, *capsys.readouterr()


@pytest.mark.parametrize("error, status, line", [
    (InputError("a is wrong\nin two lines"), 2, "a is wrong in two lines"),
    (RuntimeError("no way"), 1, "no way"),
    (FloatingPointError("nan"), 1, "nan"),
    (WorkError("half done"), 1, "half done"),
    (MemoryError(), 1, "out of memory; finished files are kept"),
    (OSError(28, "No space left on device", "x.vtkhdf"), 1, "x.vtkhdf: No space left on device"),
    (OSError("odd"), 1, "cannot write: odd"),
    (KeyboardInterrupt(), 130, "stopped; finished files are kept")])
def test_every_failure_has_its_status_and_one_line(monkeypatch, capsys, error, status, line):
    def fail(options):
        raise error

    monkeypatch.setattr(fidelity, "demo", fail)
    for more in ([], ["--json"]):
        assert called(capsys, "demo", *more) == (status, "", f"fidelity: {line}\n")


def test_what_failed_work_can_tell_is_json_all_the_same(monkeypatch, capsys):
    def fail(options):
        raise WorkError("half done", {"done": float("inf"), "half": 0.5})

    monkeypatch.setattr(fidelity, "demo", fail)
    assert called(capsys, "demo", "--json") == (1, '{"done": null, "half": 0.5}\n', "fidelity: half done\n")
    assert called(capsys, "demo") == (1, "", "fidelity: half done\n")


def test_results_go_to_standard_output_only_as_json_and_without_nan(monkeypatch, capsys):
    monkeypatch.setattr(fidelity, "demo", lambda options: fidelity._say(options, "a line") or {"x": float("nan"), "y": [1, float("-inf")]})
    assert called(capsys, "demo") == (0, "a line\n", "")
    assert called(capsys, "demo", "--json") == (0, '{"x": null, "y": [1, null]}\n', "a line\n")


def test_the_demonstration_goes_to_a_folder_of_its_name(monkeypatch, capsys, tmp_path):
    given = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("learning.demo.run", lambda out, say: given.append(out) or say("words") or {"a": 1})
    assert called(capsys, "demo") == (0, "words\n", "") and called(capsys, "demo", "--out", "x")[0] == 0
    assert given == [Path("demo"), Path("x")] and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("function, good, bad", [
    (fidelity._positive, {"1": 1, "20": 20}, ("0", "-1", "1.5", "a", "")),
    (fidelity._count, {"0": 0, "1": 1, "7": 7}, ("-1", "00", "b", "1e3")),
    (fidelity._seed, {"0": 0, "9223372036854775807": 2**63 - 1}, ("9223372036854775808", "-1", "1.0", ""))])
def test_whole_numbers_have_their_bounds(function, good, bad):
    assert {text: function(text) for text in good} == good
    for text in bad:
        with pytest.raises(argparse.ArgumentTypeError, match="not a whole number"):
            function(text)


def test_an_output_is_checked_before_and_nothing_is_left_of_the_check(tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file.gif").touch()
    assert fidelity._writable(None) is None and fidelity._writable(None, ".gif") is None
    assert fidelity._writable(str(tmp_path / "a" / "b" / "new.gif"), ".gif") == tmp_path / "a" / "b" / "new.gif"
    assert fidelity._writable(tmp_path / "c" / "d") == tmp_path / "c" / "d"
    assert fidelity._writable(tmp_path / "file.gif", ".png", ".gif") and fidelity._writable(tmp_path / "folder")
    assert {path.name for path in tmp_path.rglob("*")} == {"folder", "file.gif"}
    for path, suffixes, words in (("new.gif", (".png", ".vtu"), "the name must end in .png or .vtu"), ("folder", ("",), "is a folder"),
                                  ("file.gif", (), "is not a folder"), ("file.gif/x", (), "Not a directory")):
        with pytest.raises(InputError, match=f"--out .*{words}"):
            fidelity._writable(tmp_path / path, *suffixes)
    assert {path.name for path in tmp_path.rglob("*")} == {"folder", "file.gif"}


# modes

def modes_found(elastic: bool):
    mesh = build_mesh(Body(length=0.03, width=0.02, height=0.02, cells=(1, 1, 1)))
    shapes = np.arange(2 * 8 * 3.0).reshape(2, 8, 3) if elastic else np.arange(16.0).reshape(2, 8)
    values = {"frequencies_hz": (10.0, 25.5)} if elastic else {"eigenvalues": np.array([3.0, 4.5])}
    return SimpleNamespace(
        mesh=mesh,
        shapes=shapes,
        pictured=shapes,
        residuals=np.array([1e-9, 2e-9]),
        dofs=24,
        seconds=1.5,
        cells="1 cell",
        solver="dense",
        clusters=[(0, 1)],
        remarks=("nothing of note",),
        report={"frequencies": "theirs"},
        **values,
    )


def test_modes_are_told_in_their_unit_counted_from_one(monkeypatch, capsys):
    monkeypatch.setattr(scene_verbs, "_elastic", lambda options, spread: (modes_found(True), None))
    monkeypatch.setattr(scene_verbs, "_laplacian", lambda options, spread: modes_found(False))
    rest = {"residuals": [1e-9, 2e-9], "dofs": 24, "seconds": 1.5, "cells": "1 cell", "solver": "dense", "clusters": [[1, 2]],
            "remarks": ["nothing of note"], "frequencies": "theirs"}
    for kind, first in (
        ("elastic", "mode   1            10 Hz  residual 1.0e-09"),
        ("laplacian", "mode   1             3 1/m2  residual 1.0e-09"),
    ):
        status, out, _ = called(capsys, "modes", "s.toml", "--kind", kind)
        assert status == 0 and out.splitlines()[0] == first and out.splitlines()[2:] == ["24 unknowns, 1 cell; dense", "nothing of note"]
        assert json.loads(called(capsys, "modes", "s.toml", "--kind", kind, "--json")[1]) == {"kind": kind, **rest}


def test_shapes_of_modes_stand_in_their_file(monkeypatch, capsys, tmp_path):
    import meshio

    monkeypatch.setattr(scene_verbs, "_elastic", lambda options, spread: (modes_found(True), None))
    monkeypatch.setattr(scene_verbs, "_laplacian", lambda options, spread: modes_found(False))
    (tmp_path / "s.toml").write_text(beam().to_toml())
    assert called(capsys, "modes", tmp_path / "s.toml", "--out", tmp_path / "e.vtu")[1].endswith(f"shapes: {tmp_path / 'e.vtu'}\n")
    data = meshio.read(tmp_path / "e.vtu").point_data
    assert list(data) == ["mode_1", "mode_2"] and np.array_equal(data["mode_2"], modes_found(True).shapes[1])
    called(capsys, "modes", tmp_path / "s.toml", "--out", tmp_path / "e.vtkhdf")
    kept = read_trajectory(tmp_path / "e.vtkhdf")
    assert np.array_equal(kept.modes, modes_found(True).shapes) and kept.frequencies_hz == (10.0, 25.5) and "[body]" in kept.scene
    called(capsys, "modes", tmp_path / "s.toml", "--kind", "laplacian", "--out", tmp_path / "l.vtkhdf")
    kept = read_trajectory(tmp_path / "l.vtkhdf")  # a value is kept as a height
    assert np.array_equal(kept.modes[:, :, 2], modes_found(False).shapes) and not kept.modes[:, :, :2].any()
    assert kept.extra["laplacian_eigenvalues"] == [3.0, 4.5] and kept.frequencies_hz == ()


def test_pictures_of_modes_are_named_by_value_and_unit(monkeypatch, capsys, tmp_path):
    given = []
    monkeypatch.setattr(scene_verbs, "_elastic", lambda options, spread: (modes_found(True), None))
    monkeypatch.setattr(scene_verbs, "_laplacian", lambda options, spread: modes_found(False))
    monkeypatch.setattr("physics.view.mode_pictures", lambda folder, mesh, shapes, names, films, say:
                        given.append((folder, names)) or say(f"films {films}") or ["a", "b"])
    status, out, _ = called(capsys, "modes", "s.toml", "--picture", tmp_path / "p")
    assert status == 0 and out.endswith(f"films True\n2 pictures: {tmp_path / 'p'}\n")
    assert json.loads(called(capsys, "modes", "s.toml", "--picture", tmp_path / "p", "--kind", "laplacian", "--json")[1])["pictures"] == [
        "a",
        "b",
    ]
    assert given == [(tmp_path / "p", ["f = 10 Hz", "f = 25.5 Hz"]), (tmp_path / "p", ["lambda = 3 1/m2", "lambda = 4.5 1/m2"])]


def test_modes_are_written_as_a_page(monkeypatch, capsys, tmp_path):
    given = []
    monkeypatch.setattr(scene_verbs, "_elastic", lambda options, spread: (modes_found(True), None))
    monkeypatch.setattr(scene_verbs, "_laplacian", lambda options, spread: modes_found(False))
    monkeypatch.setattr("physics.view.write_page", lambda path, title, shown, facts: given.append((path, title, shown, facts)))
    page = tmp_path / "m.html"
    assert called(capsys, "modes", "s.toml", "--html", page)[1].endswith(f"\npage: {page}\n")
    assert json.loads(called(capsys, "modes", "s.toml", "--kind", "laplacian", "--html", page, "--json")[1])["html"] == str(page)
    (path, title, (shown,), facts), (_, second, (flat,), _) = given
    assert (path, title, second) == (page, "Elastic modes of s.toml", "Laplacian modes of s.toml")
    assert list(shown.motions) == ["mode 1: f = 10 Hz", "mode 2: f = 25.5 Hz"] and facts["mesh"] == "8 nodes, 1 cell"
    assert facts["remarks"] == "nothing of note"
    # the largest displacement, of the last node, is a sixth of the 30 mm length
    assert np.linalg.norm(shown.motions["mode 2: f = 25.5 Hz"].displacement, axis=2).max() == pytest.approx(0.005)
    assert flat.motions["mode 1: lambda = 3 1/m2"].fields["value [of the largest]"].max() == 1
    assert called(capsys, "modes", "s.toml", "--html", tmp_path / "m.htm") == (
        2, "", f"fidelity: --html {tmp_path / 'm.htm'}: the name must end in .html\n")


def test_elastic_modes_want_a_scene_and_no_held_places(capsys, tmp_path):
    status, _, err = called(capsys, "modes", tmp_path / "s.vtu")
    assert status == 2 and "elastic modes need a scene (.toml)" in err
    status, _, err = called(capsys, "modes", "s.toml", "--dirichlet", "x")
    assert status == 2 and "--dirichlet is for --kind laplacian" in err


@pytest.mark.parametrize(
    "given, names", [([], None), (["--dirichlet", "none"], []), (["--dirichlet", " inlet, ,hole "], ["inlet", "hole"])]
)
def test_places_held_to_zero_are_a_list_with_commas(monkeypatch, capsys, given, names):
    asked = {}
    monkeypatch.setattr("physics.scene.load_body", lambda path: "body")
    monkeypatch.setattr("physics.modes.laplacian.laplacian_modes", lambda body, **how: asked.update(how, body=body) or modes_found(False))
    assert called(capsys, "modes", "s.toml", "--kind", "laplacian", "--count", "7", *given)[0] == 0
    assert asked == {"body": "body", "count": 7, "dirichlet": names, "spread": False}


# simulate

@pytest.fixture
def solved(monkeypatch, tmp_path):
    """simulate with a solution made by hand: 4 steps in 2 s, the largest and smallest of each figure in the middle."""
    (tmp_path / "s.toml").write_text(beam().to_toml())
    solution = SimpleNamespace(
        displacement=np.zeros((5, 8, 3)),
        seconds=2.0,
        newton_iterations=np.array([0, 1, 2, 3, 5]),
        factorisations=6,
        failure="",
        resumed=0,
        relative_residual=np.array([0, 1e-8, 5e-7, 1e-9, 0]),
        penetration=np.array([0, 1e-6, 3e-5, 2e-6, 0]),
        smallest_det_f=np.array([1, 0.9, 0.75, 0.8, 0.95]),
        reaction=np.array([[9.0, 0, 0], [0, 0, 1], [0, -50.5, 2], [0, 0, 3], [0, 0, 4]]),
        linear_steps=2,
        mesh=SimpleNamespace(remarks=("a cell is flat",)),
        stiff=lambda scene: ("too stiff",), idle=lambda scene: (),
    )
    monkeypatch.setattr("physics.solution.solve", lambda scene, **how: solution)
    made = SimpleNamespace(extra={"model": {"inertia": "left out"}}, per_frame={"obstacle": np.arange(15.0).reshape(5, 3)})
    monkeypatch.setattr("datagen.sets.generate.trajectory_of", lambda scene, solution: made)
    written = []
    monkeypatch.setattr("datagen.files.trajectory.write_trajectory", lambda path, trajectory: written.append(path))
    return SimpleNamespace(
        solution=solution, scene=tmp_path / "s.toml", out=tmp_path / "t.vtkhdf", part=tmp_path / "t.vtkhdf.part", written=written
    )


def test_a_simulation_is_told_by_its_extremes_and_sums(solved, capsys):
    solved.part.touch()
    result = json.loads(called(capsys, "simulate", solved.scene, "--out", solved.out, "--json")[1])
    assert result == {"steps": 4, "ms_per_step": 500.0, "newton_iterations": 11, "factorisations": 6, "largest_relative_residual": 5e-7,
                      "largest_penetration": 3e-5, "smallest_det_f": 0.75, "reaction": [[0, 0, 1], [0, -50.5, 2], [0, 0, 3], [0, 0, 4]],
                      "obstacle": np.arange(3.0, 15.0).reshape(4, 3).tolist(),
                      "model": {"inertia": "left out"}, "linear_steps": 2, "seconds": 2.0, "resumed_after_step": 0,
                      "remarks": ["a cell is flat", "too stiff"]}
    assert solved.written == [solved.out] and not solved.part.exists()  # the journal of a whole run is not needed any more
    assert called(capsys, "simulate", solved.scene, "--out", solved.out) == (
        0, f"4 steps in 2.00 s, 11 Newton steps, 6 factorisations, largest reaction 50.5 N: {solved.out}\n  inertia: left out\n"
        "a cell is flat\ntoo stiff\n", "")


def test_motion_beyond_the_numbers_of_a_file_is_told_and_not_written(solved, capsys):
    solved.solution.displacement[1] = 3.5e38
    assert called(capsys, "simulate", solved.scene, "--out", solved.out) == (
        1, "", "fidelity: the body moves by up to 3.5e+38 m, and a file holds numbers up to 3.4e+38; nothing is written\n")
    assert not solved.written


def test_a_simulation_that_fails_says_what_is_kept_and_keeps_its_journal(solved, capsys):
    solved.part.touch()
    solved.solution.failure, solved.solution.resumed = "no equilibrium at step 5", 3
    status, out, err = called(capsys, "simulate", solved.scene, "--out", solved.out)
    assert (status, out) == (1, "went on after step 3, which an earlier run had reached\n") and err == (
        f"fidelity: no equilibrium at step 5; the 4 steps before it are in {solved.out}; the same call tries again from there, without "
        "t.vtkhdf.part from the start\n")
    assert solved.part.exists() and solved.written == [solved.out]


def test_a_simulation_is_written_as_a_page_also_when_it_ends_early(solved, monkeypatch, capsys, tmp_path):
    page, path = tmp_path / "t.html", bending(cells=(4, 1, 1), steps=3)
    made = replace(path, extra={"model": {"inertia": "left out"}}, scene=beam().to_toml())
    monkeypatch.setattr("datagen.sets.generate.trajectory_of", lambda scene, solution: made)
    result = json.loads(called(capsys, "simulate", solved.scene, "--out", solved.out, "--html", page, "--json")[1])
    assert result["html"] == str(page)
    text = page.read_text()
    assert "<h1>The path of s.toml</h1>" in text
    assert "<dt>steps</dt><dd>3 of 20</dd>" in text and "<dt>inertia</dt><dd>left out</dd>" in text
    # By beam theory, pressed by 19 mm at 70 of 100 mm, the tip goes 19 (300 - 70) / 140 = 31.21 mm down and 10 * 19 * 3 / 140 aside.
    assert "<td>31.48</td>" in text
    page.unlink()
    solved.solution.failure = "no equilibrium at step 4"
    assert called(capsys, "simulate", solved.scene, "--out", solved.out, "--html", page)[0] == 1 and page.exists()


def test_a_trajectory_is_viewed_as_a_page_too(capsys, tmp_path):
    """One without a scene, as an imported one is, has no stress."""
    for scene, stress in (("", 0), (beam().to_toml(), 2)):  # of the frame that was reached, by its number and the rest state's
        write_trajectory(tmp_path / "t.vtkhdf", replace(bending(cells=(4, 1, 1), steps=1), scene=scene))
        page = tmp_path / "t.html"
        assert called(capsys, "view", tmp_path / "t.vtkhdf", "--out", page) == (0, f"page: {page}\n", "")
        table = page.read_text().split("<table>")[1].split("</table>")[0]
        assert table.count("largest displacement [mm]") == 1 and ("von Mises" in table) == bool(stress)
        assert table.count("<td>31.48</td>") == 1 and table.count("<td>") == 2 + stress


def test_plane_cells_of_second_order_are_solved_viewed_verified_and_have_modes_where_they_are_loaded(capsys, tmp_path):
    scene, out = tmp_path / "s.toml", tmp_path / "t.vtkhdf"
    scene.write_text(beam(body={"shape": "plate", "length": 0.1, "width": 0.02, "cells": [4, 2], "cell": "triangle", "order": 2},
                          load=[{"where": "x-max", "traction": [0.0, 100.0, 0.0]}], steps={"count": 2}).to_toml())
    assert called(capsys, "simulate", scene, "--out", out)[0] == 0
    assert "triangles, of second order" in read_trajectory(out).extra["model"]["material"]
    assert called(capsys, "view", out, "--out", tmp_path / "t.html")[0] == 0
    status, table, _ = called(capsys, "verify", out, "--reference", out, "--json")
    assert status == 0 and json.loads(table)["relative_residual"] < 1e-5  # without the remainder 1e-4 and more
    status, table, _ = called(capsys, "modes", scene, "--at", f"{out}:2", "--count", "2", "--json")
    assert status == 0 and len(json.loads(table)["frequencies_hz"]) == 2
    status, _, err = called(capsys, "pareto", scene, "--out", tmp_path / "report")
    assert status == 2 and "the comparison takes quasi-static scenes of first-order cells" in err


# the other verbs

def test_generate_hands_its_options_on(monkeypatch, capsys, tmp_path):
    given = {}
    monkeypatch.setattr("datagen.family.family.load_family", lambda name: name)
    monkeypatch.setattr("datagen.family.family.counts", lambda family, count, split: (count, split))
    monkeypatch.setattr(
        "datagen.sets.generate.generate", lambda family, wanted, out, **how: given.update(how, all=(family, wanted, out)) or {"new": 3}
    )
    assert called(capsys, "generate", "beam", "--out", tmp_path / "d") == (0, f"new 3: {tmp_path / 'd'}\n", "")
    assert given == {"all": ("beam", (None, None), tmp_path / "d"), "seed": 0, "workers": None, "cluster": "", "tls": (),
                     "time_limit": float("inf"), "stress": False}
    assert called(capsys, "generate", "beam", "--out", tmp_path / "d", "--count", "4", "--split", "test", "--seed", "9", "--workers", "2",
                  "--cluster", "tls://x", "--tls", "ca", "cert", "key", "--time-limit", "1.5", "--fields", "stress")[0] == 0
    assert given == {"all": ("beam", (4, "test"), tmp_path / "d"), "seed": 9, "workers": 2, "cluster": "tls://x",
                     "tls": ["ca", "cert", "key"], "time_limit": 1.5, "stress": True}
    monkeypatch.setattr("datagen.sets.plan.planned",
                        lambda family, wanted, seed: {"count": 3, "nodes": {"mean": 81.5, "min": 60.0}, "of": seed})
    assert called(capsys, "generate", "beam", "--dry-run", "--seed", "5")[1].splitlines() == [
        "count           3", "nodes           mean 81.5, min 60", "of              5"]
    status, _, err = called(capsys, "generate", "beam")
    assert status == 2 and "--out: give the folder, or --dry-run" in err


def test_verify_prints_the_lines_of_what_it_found(monkeypatch, capsys, tmp_path):
    given = []
    monkeypatch.setattr("datagen.flow.prediction.verify_files", lambda *arguments: given.append(arguments) or {"rmsd_all": 1.25e-4})
    monkeypatch.setattr("datagen.files.prediction.lines", lambda result: [f"error {result['rmsd_all']}", "verdict"])
    assert called(capsys, "verify", "p", "--reference", "r", "--out", tmp_path / "o")[1] == "error 0.000125\nverdict\n"
    assert json.loads(called(capsys, "verify", "p", "--reference", "r", "--json")[1]) == {"rmsd_all": 1.25e-4}
    assert given == [("p", "r", tmp_path / "o"), ("p", "r", None)]


def test_a_film_lies_beside_its_trajectory_and_shows_the_body_and_its_obstacle(monkeypatch, capsys, tmp_path):
    given = []
    monkeypatch.setattr("physics.view.film", lambda out, mesh, u, obstacle: given.append((out, mesh, u, obstacle)) or 7)
    trajectory = bending(steps=3)
    write_trajectory(tmp_path / "t.vtkhdf", trajectory)
    assert called(capsys, "view", tmp_path / "t.vtkhdf")[1] == f"7 pictures: {tmp_path / 't.gif'}\n"
    result = json.loads(called(capsys, "view", tmp_path / "t.vtkhdf", "--out", tmp_path / "x.gif", "--json")[1])
    assert result == {"pictures": 7, "out": str(tmp_path / "x.gif")} and [entry[0].name for entry in given] == ["t.gif", "x.gif"]
    _, mesh, u, obstacle = given[0]
    assert np.array_equal(u, trajectory.displacement[:, trajectory.body]) and len(mesh.points) == 99
    assert np.array_equal(obstacle.points, trajectory.obstacle[0]) and np.array_equal(obstacle.triangles, trajectory.obstacle[1])
    assert called(capsys, "view", tmp_path / "none.vtkhdf", "--out", tmp_path / "x.avi") == (  # before anything is read
        2, "", f"fidelity: --out {tmp_path / 'x.avi'}: the name must end in .gif or .png or .html\n")


def test_one_frame_is_a_picture_the_last_one_unless_another_is_named(capsys, tmp_path):
    write_trajectory(tmp_path / "t.vtkhdf", bending(steps=3))
    view = ("view", tmp_path / "t.vtkhdf", "--out", tmp_path / "x.png")
    assert called(capsys, *view)[1] == f"frame 3 of 3: {tmp_path / 'x.png'}\n"
    last = (tmp_path / "x.png").read_bytes()
    assert json.loads(called(capsys, *view, "--frame", "1", "--json")[1]) == {"frame": 1, "out": str(tmp_path / "x.png")}
    assert (tmp_path / "x.png").read_bytes() != last
    assert "--frame 4: the last one is 3" in called(capsys, *view, "--frame", "4")[2]
    assert "--frame 1: is for a picture" in called(capsys, "view", tmp_path / "t.vtkhdf", "--frame", "1")[2]
    called(capsys, *view)
    assert (tmp_path / "x.png").read_bytes() == last


# processes

@pytest.mark.parametrize(
    "given, verb, words",
    [
        ({"WORLD_SIZE": "2", "RANK": "0"}, "simulate", "simulate runs as one process"),
        ({"OMPI_COMM_WORLD_SIZE": "2"}, "view", "view runs as one process"),
        ({"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "1"}, "view", ""),
        ({"PMI_SIZE": "2", "PMI_RANK": "1"}, "view", ""),
        ({"PMI_SIZE": "3"}, "view", "view runs as one process"),
        ({}, "view", "no such file"),
        ({"WORLD_SIZE": "1"}, "view", "no such file"),
    ],
)
def test_only_the_first_of_several_processes_speaks(capsys, monkeypatch, tmp_path, given, verb, words):
    """What mpirun and torchrun leave in the environment is read when the program starts: by a fresh copy of it."""
    for key in ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK", "PMI_SIZE", "PMI_RANK", "RANK", "WORLD_SIZE"):
        monkeypatch.delenv(key, raising=False)
    for key, value in given.items():
        monkeypatch.setenv(key, value)
    spec = importlib.util.spec_from_file_location("fresh", fidelity.__file__)
    fresh = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fresh)
    status = fresh.main([verb, str(tmp_path / "none.vtkhdf")] + (["--out", str(tmp_path / "t.vtkhdf")] if verb == "simulate" else []))
    out, err = capsys.readouterr()
    assert status == 2 and out == ""
    assert (words in err and err.count("\n") == 1) if words else err == ""
