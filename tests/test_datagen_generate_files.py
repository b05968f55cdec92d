"""A file that an earlier run made of a body from a mesh file: it is found again where the mesh is the same, by whatever path."""

import dataclasses
import shutil

import pytest

from datagen.files.solved import answers
from datagen.sets.generate import trajectory_of
from physics.mesh.files import write_mesh
from physics.mesh.shapes.boxes import box
from physics.scene import Body, Steps
from tests.scenes import beam

SIDES = {"length": 0.06, "width": 0.02, "height": 0.01}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("of a file")
    write_mesh(folder / "box.vtu", box(Body(**SIDES, cells=(3, 1, 1), cell="tetrahedron")), {})
    scene = beam(body={"shape": "file", "path": str(folder / "box.vtu")}, steps={"count": 2},
                 support=[{"where": {"plane": [0, 0, 0], "normal": [1, 0, 0], "within": 1e-6}}],
                 load=[{"where": {"plane": [0.06, 0, 0], "normal": [1, 0, 0], "within": 1e-6}, "traction": [0, 0, 1.0]}])
    return folder, scene, trajectory_of(scene)


def by(scene, path):
    return dataclasses.replace(scene, body=dataclasses.replace(scene.body, path=str(path)))


def test_the_same_mesh_under_another_name_is_the_same_body(made):
    folder, scene, found = made
    shutil.copy(folder / "box.vtu", folder / "copy.vtu")
    assert answers(scene, found) and answers(by(scene, folder / "copy.vtu"), found)


def test_another_mesh_another_scene_and_a_file_that_tells_nothing_of_it_are_not(made):
    folder, scene, found = made
    write_mesh(folder / "other.vtu", box(Body(**SIDES | {"height": 0.0101}, cells=(3, 1, 1), cell="tetrahedron")), {})
    assert not answers(by(scene, folder / "other.vtu"), found)
    assert not answers(dataclasses.replace(scene, steps=Steps(count=3)), found)
    assert not answers(scene, dataclasses.replace(found, places=None))
    assert not answers(scene, dataclasses.replace(found, extra={}))
    assert not answers(scene, dataclasses.replace(found, scene="no scene at all"))
