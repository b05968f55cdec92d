"""A set whose family asks for an error: each scene has a mesh of its own, and what is not promised stays and is counted."""

import dataclasses
import json
from functools import partial

import pytest

import fidelity
from datagen.family.family import counts, draw, load_family
from datagen.files.solved import answers
from datagen.files.trajectory import read_trajectory
from datagen.sets import check, dataset, generate
from datagen.sets.card import write_card
from physics.accuracy import answer as answering
from physics.accuracy.choose import choose
from physics.mesh.build import build_mesh
from physics.mesh.files import write_mesh
from physics.scene import Body, Scene
from tests.scenes import beam

TEXT = """
name = "asks"
[body]
length = { uniform = [0.04, 0.09] }
width = 0.02
height = 0.02
[material]
young_modulus = 1e6
poisson_ratio = 0.3
[[support]]
where = "x-min"
[[load]]
where = "x-max"
traction = [0.0, 0.0, { uniform = [-3000, -500] }]
[steps]
count = 24
error = 0.1
[splits]
train = 2
valid = 0
test = 1
"""


@pytest.fixture(scope="module")
def family(tmp_path_factory):
    path = tmp_path_factory.mktemp("family") / "asks.toml"
    path.write_text(TEXT)
    return load_family(path)


def here(function, jobs, processes, *, kept):
    """In the place of `on_this_machine`: in this process, the last first."""
    return [(job, function(job)) for job in reversed(jobs)]


@pytest.fixture(scope="module")
def made(family, tmp_path_factory):
    """The set, made here in reverse order; the second mesh may have too few nodes for the error."""
    folder = tmp_path_factory.mktemp("asked")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generate, "on_this_machine", here)
        patch.setattr(answering, "choose", lambda scene, **how: choose(scene, most=80 if scene == draw(family, 0, 1) else 2000, **how))
        return folder, generate.generate(family, counts(family), folder, workers=1)


def test_each_scene_has_the_mesh_that_its_error_takes_and_every_step_satisfies_the_equations(family, made):
    folder, report = made
    assert check.check(folder, steps=24) == []
    entries = dataset.read_manifest(folder).trajectories
    assert len({entry.nodes for entry in entries}) > 1 and (report["new"], report["failed_attempts"]) == (3, 0)
    for entry in entries:
        found, asks = read_trajectory(folder / entry.file), draw(family, 0, entry.index)
        solved = Scene.from_toml(found.scene)
        assert asks.steps.error == 0.1 and solved.steps.error is None and solved.body.cells is not None
        assert found.extra["accuracy"]["asked"] == 0.1 and found.extra["accuracy"]["quantity"] == "displacement"
        assert (solved.body.length, solved.load) == (asks.body.length, asks.load)


def test_what_is_not_promised_stays_in_the_set_and_is_counted_in_the_manifest_and_on_the_card(family, made):
    folder, report = made
    assert report["not_promised"] == 1
    assert [entry.promised for entry in dataset.read_manifest(folder).trajectories] == [True, False, True]
    assert read_trajectory(folder / "train/0001.vtkhdf").extra["accuracy"]["reached"] is False
    assert "It is promised of 2 of 3" in write_card(folder, refined=0).read_text()


def test_another_run_makes_nothing_anew_and_what_is_gone_again_to_the_same_bits(family, made, monkeypatch):
    folder, _ = made
    before = dataset.read_manifest(folder)
    monkeypatch.setattr(generate, "on_this_machine", here)
    again = generate.generate(family, counts(family), folder, workers=1)
    assert (again["new"], again["not_promised"]) == (0, 1) and dataset.read_manifest(folder) == before
    (folder / "test/0000.vtkhdf").unlink()
    assert generate.generate(family, counts(family), folder, workers=1)["new"] == 1
    same = [entry.sha256 for entry in dataset.read_manifest(folder).trajectories]
    assert same == [entry.sha256 for entry in before.trajectories]


@pytest.mark.parametrize("change", [{"error": 0.05}, {"quantity": "reaction"}, {"count": 23}])
def test_a_file_answers_no_other_question(family, made, change):
    folder, _ = made
    found, asks = read_trajectory(folder / "train/0000.vtkhdf"), draw(family, 0, 0)
    assert answers(asks, found) and not answers(draw(family, 0, 1), found)
    assert not answers(dataclasses.replace(asks, steps=dataclasses.replace(asks.steps, **change)), found)
    assert not answers(asks, dataclasses.replace(found, scene="", extra={}))


@pytest.mark.parametrize("number", [0, 2])
def test_the_command_ends_with_status_1_where_an_error_is_not_promised(family, monkeypatch, tmp_path, capsys, number):
    path = tmp_path / "asks.toml"
    path.write_text(TEXT)
    report = {"trajectories": 3, "new": 3, "seconds": 1.0, "failed_attempts": 0, "not_promised": number}
    monkeypatch.setattr(generate, "generate", lambda *_, **__: report)
    status = fidelity.main(["generate", str(path), "--out", str(tmp_path / "data"), "--json"])
    said = capsys.readouterr()
    assert status == (1 if number else 0) and json.loads(said.out)["not_promised"] == number
    assert ("the error asked is not promised of 2 of 3 trajectories; they are in" in said.err) == bool(number)


def test_forms_are_compiled_for_every_kind_of_mesh_that_may_be_chosen(family, monkeypatch):
    asked = []
    monkeypatch.setattr(generate, "solve", lambda scene: asked.append((scene.body.cell, scene.body.order, scene.body.element)))
    monkeypatch.setattr(generate, "elastic_modes", lambda scene, count: None)
    generate.compile_forms([draw(family, 0, 0)])
    assert sorted(asked) == [("hexahedron", 1, "mean-dilatation"), ("hexahedron", 2, "standard")]


def test_forms_of_a_file_are_those_of_its_cells_at_both_orders(tmp_path, monkeypatch):
    write_mesh(tmp_path / "t.vtu", build_mesh(Body(length=0.06, width=0.02, height=0.02, cells=(3, 1, 1), cell="tetrahedron")), {})
    asked = []
    monkeypatch.setattr(generate, "solve", lambda scene: asked.append((scene.body.cell, build_mesh(scene.body).cell)))
    monkeypatch.setattr(generate, "elastic_modes", lambda scene, count: None)
    generate.compile_forms([beam(body={"shape": "file", "path": str(tmp_path / "t.vtu")}, steps={"count": 1, "error": 0.1},
                                 support=[{"where": {"near": [0.0, 0.0, 0.0], "within": 0.03}}])])
    assert sorted(asked) == [("tetrahedron", "tetrahedron"), ("tetrahedron", "tetrahedron10")]


def test_a_scene_over_its_time_when_its_mesh_is_chosen_is_given_up(family):
    clock = generate._clock(1e-9, 24)
    with pytest.raises(generate.OverTime, match="at step 1 of 24"):
        generate.trajectory_of(draw(family, 0, 0), on_step=partial(clock))
