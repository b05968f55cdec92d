"""From a gmsh file to a report: a body of the user's own goes through every verb, from another folder and without its mesh file."""

import json
from dataclasses import replace

import meshio
import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import read_trajectory, write_trajectory
from physics.mesh.files import read_mesh
from physics.mesh.shapes.boxes import box
from physics.scene import Body, Scene, load_scene

SCENE = """
[body]
shape = "file"
path = "part.msh"
[material]
young_modulus = {modulus}
poisson_ratio = 0.3
[[support]]
where = "wall"
[[load]]
where = "tip"
traction = [0.0, 0.0, 500.0]
[steps]
count = 3
"""
CONFIG = """
segments = 3
method = "slic-md"
contact_radius = 0.03
batch_size = 1
steps = 4
validate_every = 2
[network]
hidden = 8
message_steps = 1
transformer_layers = 1
heads = 2
"""


def write_part(path, length=0.4):
    """A bar of 4 x 1 x 1 hexahedra, its ends named "wall" and "tip", in gmsh's format."""
    mesh = box(Body(length=length, width=0.1, height=0.1, cells=(4, 1, 1), cell="hexahedron"))
    ends = [next(facets for facets in mesh.facets(name) if len(facets)) for name in ("x-min", "x-max")]
    tags = [np.array([3, 3, 3, 3]), np.array([1]), np.array([2])]
    meshio.Mesh(mesh.points, [("hexahedron", mesh.cells), ("quad", ends[0]), ("quad", ends[1])],
                cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
                field_data={"wall": np.array([1, 2]), "tip": np.array([2, 2]), "body": np.array([3, 3])}
                ).write(path, file_format="gmsh22", binary=False)


@pytest.fixture
def say(capsys, monkeypatch):
    """Runs a command that must succeed: what it printed, or with --json its object."""
    def run(*words):
        status = fidelity.main([str(word) for word in words])
        out, err = capsys.readouterr()
        assert status == 0, err
        return json.loads(out) if "--json" in words else out

    return run


def test_from_a_gmsh_file_through_every_verb_without_the_file(say, tmp_path, monkeypatch):
    there, here = tmp_path / "there", tmp_path / "here"
    there.mkdir()
    here.mkdir()
    write_part(there / "part.msh")
    (there / "family.toml").write_text(SCENE.format(modulus="{ uniform = [1e6, 2e6] }") + "[splits]\ntrain = 2\nvalid = 1\ntest = 1\n")
    (here / "config.toml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    say("generate", "there/family.toml", "--out", "there/data", "--workers", "1")
    (there / "data").rename(here / "data")
    (there / "part.msh").unlink()
    monkeypatch.chdir(here)
    assert "nothing wrong" in say("dataset", "check", "data")
    found = say("dataset", "stats", "data", "--refined", "1", "--json")["refined"]
    assert found["failures"] == [] and 0.1 < found["mesh_relative"]["mean"] < 0.6  # two hexahedra more than half as stiff again as four
    packed = say("dataset", "pack", "data", "--out", "set.pack", "--json")
    assert packed["trajectories"] == 4
    say("dataset", "unpack", "set.pack", "--out", "again")
    assert "nothing wrong" in say("dataset", "check", "again")
    say("train", "config.toml", "--data", "again", "--out", "run")
    truth = "data/test/0000.vtkhdf"
    one = say("rollout", "run", truth, "--out", "p.vtkhdf", "--json")
    corrected = say("rollout", "run", truth, "--out", "c.vtkhdf", "--correct", "1", "--json")
    assert corrected["rmsd_all"] < 0.1 * one["rmsd_all"]  # a Newton step needs the supports and loads of the scene
    assert say("verify", "p.vtkhdf", "--reference", truth, "--json")["rmsd_all"] == pytest.approx(one["rmsd_all"], rel=1e-6)
    same = say("verify", truth, "--reference", truth, "--json")
    assert same["rmsd_all"] == 0 and same["relative_residual"] < 1e-4
    rows = {row["name"]: row for row in say("evaluate", "run", "--data", "again", "--out", "report", "--json")["rows"]}
    assert {"M4GN", "M4GN, corrected 10-fold", "nothing moves", "FE, the reference"} == rows.keys() - {"keep the last velocity",
                                                                                                 "quadratic extrapolation"}


@pytest.fixture
def solved(say, tmp_path, monkeypatch):
    write_part(tmp_path / "part.msh")
    (tmp_path / "scene.toml").write_text(SCENE.format(modulus=1e6))
    monkeypatch.chdir(tmp_path)
    say("simulate", "scene.toml", "--out", "a.vtkhdf")
    return tmp_path / "a.vtkhdf"


def test_the_mesh_and_its_places_stand_in_the_trajectory_and_the_scene_is_the_same(solved):
    found, mesh = read_trajectory(solved), read_mesh("part.msh")
    assert Scene.from_toml(found.scene) == load_scene("scene.toml")
    assert np.array_equal(found.mesh.points, mesh.points) and np.array_equal(found.mesh.cells, mesh.cells)
    assert {name: nodes.tolist() for name, nodes in found.mesh.places.items()} == {name: n.tolist() for name, n in mesh.places.items()}
    for name in mesh.places:
        assert [f.tolist() for f in found.mesh.facets(name)] == [f.tolist() for f in mesh.facets(name)]


def test_a_mesh_file_that_has_changed_or_gone_is_noticed_and_what_was_solved_counts(say, solved):
    before = say("verify", solved, "--reference", solved, "--json")
    assert before["remarks"] == [] and "remark" not in say("verify", solved, "--reference", solved)
    write_part("part.msh", length=0.8)
    assert "remark: the mesh file part.msh has changed since" in say("verify", solved, "--reference", solved)
    assert say("verify", solved, "--reference", solved, "--json") | {"remarks": []} == before
    (solved.parent / "part.msh").unlink()
    assert "remark: the mesh file part.msh is not to be found" in say("verify", solved, "--reference", solved)
    assert say("verify", solved, "--reference", solved, "--json") | {"remarks": []} == before


def test_a_set_goes_on_with_the_same_mesh_by_another_way_and_begins_anew_with_another_mesh(say, tmp_path, monkeypatch):
    write_part(tmp_path / "part.msh")
    (tmp_path / "family.toml").write_text(SCENE.format(modulus="{ uniform = [1e6, 2e6] }") + "[splits]\ntrain = 1\nvalid = 0\ntest = 0\n")
    monkeypatch.chdir(tmp_path)
    made = ("generate", tmp_path / "family.toml", "--out", "data", "--workers", "1", "--json")
    assert say(*made)["new"] == 1
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert say("generate", "../family.toml", "--out", "../data", "--workers", "1", "--json")["new"] == 0
    write_part(tmp_path / "part.msh", length=0.5)
    assert say("generate", "../family.toml", "--out", "../data", "--workers", "1", "--json")["new"] == 1
    assert np.ptp(read_trajectory(tmp_path / "data" / "train" / "0000.vtkhdf").points[:, 0]) == pytest.approx(0.5)


def test_places_that_do_not_fit_are_refused(solved, capsys):
    found = read_trajectory(solved)
    for wrong, words in (({"nodes": np.array([99])}, "outside of 0 .. 19"), ({"nodes": np.array([0.5])}, "unknown form"),
                         ({"nodes": np.array([0]), "quad": np.array([[0, 1, 2, 3]])}, "unknown form"),
                         ({"line": np.array([[0, 1]])}, "has no nodes"),
                         ({"nodes": np.array([0]), "triangle": np.array([[0, 1]])}, "unknown form")):
        write_trajectory("wrong.vtkhdf", replace(found, places={**found.places, "tip": wrong}))
        assert fidelity.main(["verify", "wrong.vtkhdf", "--reference", "wrong.vtkhdf"]) == 2
        assert words in capsys.readouterr().err


def test_a_body_that_is_held_everywhere_is_refused_before_anything_is_solved(solved, capsys):
    (solved.parent / "held.toml").write_text(SCENE.format(modulus=1e6).replace('where = "wall"', 'where = "body"'))
    assert fidelity.main(["simulate", "held.toml", "--out", "held.vtkhdf"]) == 2
    assert "every node of the body is held" in capsys.readouterr().err and not list(solved.parent.glob("held.vtkhdf*"))


@pytest.mark.parametrize("length, scale, asked", [(21, "", True), (20, "", False), (21, "scale = 1.0", False),
                                                  (21_000, "scale = 1e-3", False)])
def test_a_body_that_may_be_in_millimetres_is_asked_about(say, tmp_path, monkeypatch, length, scale, asked):
    write_part(tmp_path / "part.msh", length=length)
    (tmp_path / "scene.toml").write_text(SCENE.format(modulus=1e15).replace('"part.msh"', f'"part.msh"\n{scale}'))
    monkeypatch.chdir(tmp_path)
    for words in (("modes", "scene.toml", "--count", "1"), ("simulate", "scene.toml", "--out", "a.vtkhdf")):
        assert ("the body is 21 m long: is the file in mm? then body.scale = 0.001" in say(*words)) == asked
