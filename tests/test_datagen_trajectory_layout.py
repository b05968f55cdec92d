"""The layout of a trajectory file, read as plain arrays by h5py alone; what is derived of a trajectory; and every problem of its data."""

import dataclasses
import json

import h5py
import numpy as np
import pytest

from datagen.files import trajectory as module
from datagen.files.layout import displacements
from datagen.files.solved import as_solved
from datagen.files.trajectory import at_rest, problems, read_sound, read_trajectory, unfinished, write_trajectory
from physics.mesh.build import build_mesh
from physics.mesh.cell import OF_VTK
from physics.scene import Body
from physics.schema import InputError
from tests.five_nodes import UNIT, tiny
from tests.scenes import beam

FIELD = np.arange(3 * 8 * 2, dtype=np.float32).reshape(3, 8, 2)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Everything that a file may hold; of a dynamic scene with steps of a quarter of a second."""
    path = tmp_path_factory.mktemp("layout") / "t.vtkhdf"
    write_trajectory(path, tiny(segment=np.arange(8, dtype=np.int32), fields={"velocity": FIELD}, scene="name = 'x'",
                                extra={"step_seconds": 0.25}, complete=False))
    with h5py.File(path) as opened:
        yield opened


def test_the_mesh_is_stored_once_as_it_is(file):
    root = file["VTKHDF"]
    assert root.attrs["Type"] == b"UnstructuredGrid" and root.attrs["Version"].tolist() == [2, 1]
    assert root["Points"].dtype == np.float64 and root["Points"][4].tolist() == [0.3, 0.2, 0.1] and root["Points"].shape == (8, 3)
    assert root["Connectivity"][()].tolist() == [0, 1, 2, 3, 1, 2, 3, 4, 5, 6, 7] and root["Connectivity"].dtype == np.int64
    assert root["Offsets"][()].tolist() == [0, 4, 8, 11] and root["Types"][()].tolist() == [10, 10, 5] and root["Types"].dtype == np.uint8
    assert [root[name][()].tolist() for name in ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")] == [[8], [3], [11]]


def test_what_moves_is_stored_frame_after_frame(file):
    points, steps = file["VTKHDF/PointData"], file["VTKHDF/Steps"]
    assert points["displacement"].shape == (24, 3) and points["displacement"].dtype == np.float32
    assert points["displacement"][8 + 1].tolist() == [3 * UNIT, 4 * UNIT, 0]
    assert points["displacement"][16 + 2].tolist() == [0, 6 * UNIT, 8 * UNIT]
    assert np.array_equal(points["velocity"], FIELD.reshape(24, 2)) and json.loads(file.attrs["fields"]) == ["velocity"]
    for name, width in (("displacement", 3), ("velocity", 2)):
        stored = points[name]
        assert (stored.chunks, stored.compression, stored.compression_opts) == ((8, width), "gzip", 4)
        assert stored.shuffle and stored.fletcher32
        assert steps[f"PointDataOffsets/{name}"][()].tolist() == [0, 8, 16]
    assert points["node_kind"][()].tolist() == [3, 0, 0, 3, 0, 1, 1, 1] and points["segment"][()].tolist() == list(range(8))
    assert points["mode_1"][1].tolist() == [0, 0, 1] and points["mode_2"][2].tolist() == [0, 1, 0] and "mode_3" not in points
    for name in ("node_kind", "segment", "mode_1", "mode_2"):
        assert steps[f"PointDataOffsets/{name}"][()].tolist() == [0, 0, 0]


def test_the_steps_tell_a_reader_where_each_frame_starts(file):
    steps, fields = file["VTKHDF/Steps"], file["VTKHDF/FieldData"]
    assert steps.attrs["NSteps"] == 3 and steps["Values"][()].tolist() == [0, 0.25, 0.5]
    assert steps["NumberOfParts"][()].tolist() == [1, 1, 1]
    assert steps["PartOffsets"][()].tolist() == steps["PointOffsets"][()].tolist() == [0, 0, 0]
    assert steps["CellOffsets"][()].tolist() == steps["ConnectivityIdOffsets"][()].tolist() == [[0], [0], [0]]
    assert fields["reaction"][1].tolist() == [2, 3, 6] and fields["energy"][()].tolist() == [0, 0.5, 0.25]
    for name, width in (("reaction", 3), ("energy", 1), ("newton_iterations", 1)):
        assert steps[f"FieldDataOffsets/{name}"][()].tolist() == [0, 1, 2]
        assert steps[f"FieldDataSizes/{name}"][()].tolist() == [[width, 1]] * 3


def test_the_attributes_say_where_it_comes_from(file):
    said = {name: file.attrs[name] for name in ("schema", "scene", "seed", "index", "commit", "complete")}
    assert said == {"schema": 1, "scene": "name = 'x'", "seed": 3, "index": 7, "commit": "abc", "complete": False}
    assert json.loads(file.attrs["versions"]) == {"numpy": "1"} and json.loads(file.attrs["extra"]) == {"step_seconds": 0.25}
    assert file.attrs["frequencies_hz"].tolist() == [10, 12.5]


def test_steps_of_a_path_are_counted(tmp_path):
    write_trajectory(tmp_path / "t.vtkhdf", tiny())
    with h5py.File(tmp_path / "t.vtkhdf") as file:
        assert file["VTKHDF/Steps/Values"][()].tolist() == [0, 1, 2] and "fields" not in file.attrs
    assert read_trajectory(tmp_path / "t.vtkhdf").segment is None


def test_what_is_read_of_a_file_written_by_hand(file):
    """Two fields, one mode less, other numbers: put there by h5py."""
    with h5py.File("hand", "w", driver="core", backing_store=False) as other:
        file.copy("VTKHDF", other)
        other.attrs.update(dict(file.attrs))
        del other["VTKHDF/PointData/mode_2"]
        other["VTKHDF/PointData/stress"] = np.arange(24.0, dtype=np.float32)
        other.attrs.update(fields='["velocity", "stress"]', seed=5, index=6, complete=True, frequencies_hz=np.array([1.5]))
        read = module._read(other)
        other.attrs["schema"] = 2
        with pytest.raises(InputError, match="trajectory schema 2, this program reads 1"):
            module._read(other)
    assert read.displacement[2, 4].tolist() == [0, 0, UNIT] and np.array_equal(read.fields["velocity"], FIELD)
    assert read.fields["stress"].shape == (3, 8, 1) and read.fields["stress"][1, 2, 0] == 10
    assert (read.seed, read.index, read.complete, read.frequencies_hz) == (5, 6, True, (1.5,))
    assert read.modes.shape == (1, 8, 3) and read.modes[0, 1].tolist() == [0, 0, 1]


def test_what_is_derived_of_a_trajectory():
    made = tiny()
    assert made.body.tolist() == [True] * 5 + [False] * 3 and np.flatnonzero(made.free).tolist() == [1, 2, 4]
    assert made.mesh.cell == "tetrahedron" and made.mesh.cells.tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]] and len(made.mesh.points) == 5
    surface, triangles = made.obstacle
    assert triangles.tolist() == [[0, 1, 2]] and surface.shape == (3, 3, 3)
    assert surface[2, 1].tolist() == [1.5, 1 + 50 * UNIT, 1] and surface[0, 2].tolist() == [1, 1.5, 2]
    assert made.cells_of(5).tolist() == [[5, 6, 7]]
    assert tiny(node_kind=np.zeros(8, np.uint8)).obstacle is None
    other = tiny(types=np.array([5, 10, 10], np.uint8), offsets=np.array([0, 3, 7, 11]))  # the triangle first
    assert other.cells_of(10).tolist() == [[3, 1, 2, 3], [4, 5, 6, 7]] and other.cells_of(5).tolist() == [[0, 1, 2]]


def test_the_numbers_of_node_kinds_and_cells_are_those_of_the_public_data_sets_and_of_vtk():
    names = ("NORMAL", "OBSTACLE", "AIRFOIL", "HANDLE", "INFLOW", "OUTFLOW", "WALL")
    assert [getattr(module, name) for name in names] == [0, 1, 2, 3, 4, 5, 6]
    # triangle, quadrilateral, tetrahedron, hexahedron, wedge, and their kin of second order, by corners
    assert {vtk: cell.corners for vtk, cell in OF_VTK.items()} == {5: 3, 9: 4, 10: 4, 12: 8, 13: 6, 22: 3, 24: 4, 28: 4, 29: 8}


@pytest.mark.parametrize(("cell", "vtk", "corners"), [("prism", 13, 6), ("hexahedron", 12, 8), ("tetrahedron", 10, 4)])
def test_a_mesh_at_rest_is_one_frame(cell, vtk, corners):
    mesh = build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=(2, 1, 1), cell=cell))
    still = at_rest(mesh, np.ones((2, len(mesh.points), 3)), seed=4)
    assert still.displacement.shape == (1, len(mesh.points), 3) and not still.displacement.any() and problems(still) == []
    assert set(still.types.tolist()) == {vtk} and still.offsets.tolist() == list(range(0, corners * len(mesh.cells) + 1, corners))
    assert np.array_equal(still.mesh.cells, mesh.cells) and still.free.all() and still.modes.dtype == np.float32 and still.seed == 4


def test_steps_that_were_linear_are_held_against_the_linear_law():
    scene = beam()
    made = tiny(extra={"linear_steps": 5})
    assert [as_solved(scene, made, step).material.law for step in (1, 5, 6)] == ["linear", "linear", "neo-hookean"]
    assert dataclasses.replace(as_solved(scene, made, 5).material, law="neo-hookean") == scene.material
    assert as_solved(scene, tiny(), 1) is scene


def test_a_file_that_is_not_finished_says_its_scene(tmp_path):
    path = tmp_path / "t.vtkhdf"
    write_trajectory(path, tiny(scene="name = 'y'", complete=False))
    assert unfinished(path) == "name = 'y'" and read_sound(path, complete=False).index == 7
    with pytest.raises(InputError, match=r"t\.vtkhdf: the solver stopped before the last step"):
        read_sound(path)
    write_trajectory(path, tiny())
    assert unfinished(path) is None and read_sound(path).index == 7
    path.write_bytes(b"x")
    with pytest.raises(InputError, match=r"t\.vtkhdf: not a trajectory file"):
        unfinished(path)


def nan_at(array, place):
    array = np.array(array, float)
    array[place] = np.nan
    return array


@pytest.mark.parametrize(("change", "found"), [
    ({}, []),
    ({"scene": "x"}, []),  # the first frame is at rest
    ({"complete": False}, ["the solver stopped before the last step"]),
    ({"offsets": np.array([0, 4, 8, 10])}, ["the offsets of the cells do not fit their types"]),
    ({"offsets": np.array([1, 5, 9, 12])}, ["the offsets of the cells do not fit their types"]),
    ({"connectivity": np.array([0, 1, 2, 3, 1, 2, 3, 4, 5, 6, 7, 7])}, ["the offsets of the cells do not fit their types"]),
    ({"types": np.array([10, 10, 7], np.uint8)}, ["the offsets of the cells do not fit their types"]),
    ({"connectivity": np.array([0, 1, 2, 3, 1, 2, 3, 4, 5, 6, 8])}, ["a cell names a node outside of 0 .. 7"]),
    ({"connectivity": np.array([0, 1, 2, 3, 1, 2, 3, -1, 5, 6, 7])}, ["a cell names a node outside of 0 .. 7"]),
    ({"node_kind": np.array([3, 1, 0, 3, 0, 1, 1, 1], np.uint8)}, ["the node kinds are not body first, obstacle last"]),
    ({"node_kind": np.array([3, 0, 0, 3, 7, 1, 1, 1], np.uint8)}, ["the node kinds are not body first, obstacle last"]),
    ({"node_kind": np.array([0, 2, 3, 4, 5, 6, 0, 1], np.uint8)}, []),
    ({"node_kind": np.ones(8, np.uint8)}, []),
    ({"points": nan_at(tiny().points, (7, 2))}, ["points is not finite everywhere"]),
    ({"displacement": nan_at(tiny().displacement, (2, 0, 1))}, ["displacement is not finite everywhere"]),
    ({"modes": nan_at(tiny().modes, (1, 0, 1))}, ["modes is not finite everywhere"]),
    ({"per_frame": {"energy": np.array([0, np.inf, 0])}}, ["energy is not finite everywhere"]),
    ({"fields": {"stress": nan_at(FIELD, (1, 1, 1))}}, ["stress is not finite everywhere"]),
    ({"per_frame": {"energy": np.zeros(2), "snap": np.zeros(4), "released": np.zeros(3)}},
     ["energy has 2 rows for 3 frames", "snap has 4 rows for 3 frames"]),
    ({"displacement": np.where(np.arange(3)[:, None, None] == 0, UNIT, tiny().displacement)}, []),  # imported: it may start as it lies
    ({"displacement": np.where(np.arange(3)[:, None, None] == 0, UNIT, tiny().displacement), "scene": "x"},
     ["the first frame is not the rest state"])])
def test_every_problem_is_named_and_no_other(change, found):
    assert problems(tiny(**change)) == found


def test_nothing_is_left_of_a_file_that_could_not_be_written(tmp_path):
    with pytest.raises(TypeError):
        write_trajectory(tmp_path / "t.vtkhdf", tiny(extra={"why": object()}))
    assert not list(tmp_path.iterdir())
    write_trajectory(tmp_path / "deep" / "t.vtkhdf", tiny())
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["t.vtkhdf"]


@pytest.mark.parametrize("given", [[[["a", "b", "c"]]], [[[object(), 1, 2]]], [[1, 2], [3]]])
def test_what_is_no_array_of_numbers_is_said_in_one_line(given):
    with pytest.raises(InputError, match="^displacement is no array of numbers: [^\n]+$"):
        displacements(given, None, 1, "of the body")
