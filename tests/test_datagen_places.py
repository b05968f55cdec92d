"""The places of a mesh file in a trajectory: what is kept of them, what comes back, and what is refused."""

import hashlib
from dataclasses import replace

import h5py
import numpy as np
import pytest

from datagen.files.places import mesh_file, places_of, read_places, remarks_on_file, with_places, write_places, wrong_places
from physics.mesh.shapes.boxes import box
from physics.scene import Body
from physics.schema import InputError
from tests.scenes import beam

PLAIN = box(Body(length=0.4, width=0.1, height=0.1, cells=(4, 1, 1), cell="hexahedron"))
QUADS, LINES = np.array([[0, 1, 2, 3]]), np.array([[0, 1], [1, 2]])
MESH = replace(PLAIN, places={"wall": np.array([0, 1, 2, 3]), "ends": np.array([0, 19]), "": np.array([5])},
               parts={"wall": [("quadrilateral", QUADS), ("line", LINES[:1]), ("quadrilateral", QUADS + 16), ("line", LINES[1:])]})


def test_a_place_is_its_nodes_and_beside_them_the_cells_of_each_kind(tmp_path):
    places = places_of(MESH)
    assert {name: {kind: rows.tolist() for kind, rows in place.items()} for name, place in places.items()} == {
        "wall": {"nodes": [0, 1, 2, 3], "quadrilateral": [[0, 1, 2, 3], [16, 17, 18, 19]], "line": [[0, 1], [1, 2]]},
        "ends": {"nodes": [0, 19]}, "": {"nodes": [5]}}
    with h5py.File(tmp_path / "a.h5", "w") as file:
        assert read_places(file) is None
        write_places(file, places)
        read = read_places(file)
        assert list(file["places"]) == ["0", "1", "2"] and file["places/1/nodes"][()].tolist() == [0, 19]
    found = with_places(PLAIN, read)
    assert {name: nodes.tolist() for name, nodes in found.places.items()} == {"wall": [0, 1, 2, 3], "ends": [0, 19], "": [5]}
    assert {name: [(kind, rows.tolist()) for kind, rows in parts] for name, parts in found.parts.items()} == {
        "wall": [("line", [[0, 1], [1, 2]]), ("quadrilateral", [[0, 1, 2, 3], [16, 17, 18, 19]])]}  # as HDF5 sorts them


@pytest.mark.parametrize("kind, rows, words", [
    ("nodes", [0, 19], ""), ("nodes", [0, 20], "names a node outside of 0 .. 19"), ("nodes", [-1], "names a node outside of 0 .. 19"),
    ("nodes", np.zeros(0, np.int64), ""), ("nodes", [[0]], "'nodes' of an unknown form"), ("line", [[0, 19]], ""),
    ("line", [[0, 1, 2]], "'line' of an unknown form"), ("line", [0, 1], "'line' of an unknown form"), ("hexahedron", [list(range(8))], ""),
    ("quadrilateral", [[0, 1, 2, -1]], "names a node outside"), ("quad", [[0, 1, 2, 3]], "'quad' of an unknown form"),
    ("line", [[0.0, 1.0]], "'line' of an unknown form"), ("line", np.zeros((1, 2), np.int32), "'line' of an unknown form")])
def test_what_is_no_place_of_a_body_is_said(kind, rows, words):
    place = {"nodes": np.array([0])} | {kind: np.asarray(rows)}
    found = wrong_places({"good": {"nodes": np.array([1])}, "odd": place}, 20)
    assert (words in found and found.startswith("place 'odd' ")) if words else found == ""
    assert wrong_places({"odd": {"line": np.array([[0, 1]])}}, 20) == "place 'odd' has no nodes"


def test_a_mesh_file_is_known_by_its_path_and_its_bytes(tmp_path):
    path = tmp_path / "part.msh"
    path.write_bytes(b"a mesh")
    scene = beam()
    scene = replace(scene, body=replace(scene.body, path=str(path)))
    known = mesh_file(scene)
    assert known == {"path": str(path), "sha256": hashlib.sha256(b"a mesh").hexdigest()} and remarks_on_file({"mesh_file": known}) == []
    path.write_bytes(b"another")
    assert remarks_on_file({"mesh_file": known}) == [f"the mesh file {path} has changed since; what counts is the mesh in the trajectory"]
    path.unlink()
    gone = [f"the mesh file {path} is not to be found from here; what counts is the mesh in the trajectory"]
    assert remarks_on_file({"mesh_file": known}) == gone
    for extra in ({}, {"mesh_file": "part.msh"}, {"mesh_file": {}}, {"mesh_file": {"path": 3}}):
        assert remarks_on_file(extra) == []
    with pytest.raises(InputError, match=f"{path}: No such file"):
        mesh_file(scene)
