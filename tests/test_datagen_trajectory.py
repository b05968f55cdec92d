"""A trajectory file gives back what was written, to h5py and to VTK alike, and a damaged one is refused in a line."""

import dataclasses

import h5py
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

from datagen.files import trajectory as module
from datagen.files.trajectory import Trajectory, problems, read_trajectory, write_trajectory
from physics.schema import InputError
from tests.synthetic import bending


@pytest.fixture
def made() -> Trajectory:
    """Eleven frames with every kind of field."""
    bent = bending(steps=10)
    frames = len(bent.displacement)
    random = np.random.default_rng(0)
    return dataclasses.replace(
        bent, segment=np.arange(len(bent.points), dtype=np.int32), scene="name = 'x'", seed=3, index=4, commit="abc",
        versions={"numpy": "1"}, extra={"why": ["because"]},
        per_frame={"reaction": random.normal(size=(frames, 3)), "energy": random.normal(size=frames),
                   "newton_iterations": np.arange(frames)})


def test_what_is_read_is_what_was_written(made, tmp_path):
    write_trajectory(tmp_path / "t.vtkhdf", made)
    read = read_trajectory(tmp_path / "t.vtkhdf")
    for field in dataclasses.fields(Trajectory):
        expected, found = getattr(made, field.name), getattr(read, field.name)
        if isinstance(expected, np.ndarray):
            assert found.dtype == expected.dtype and np.array_equal(found, expected), field.name
        elif field.name == "per_frame":
            assert found.keys() == expected.keys() and all(np.array_equal(found[key], expected[key]) for key in found)
        else:
            assert found == expected, field.name
    assert problems(read) == []


def test_vtk_reads_every_step_as_h5py_does(made, tmp_path):
    path = tmp_path / "t.vtkhdf"
    write_trajectory(path, made)
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == len(made.displacement)
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        for step in range(len(made.displacement)):
            reader.SetStep(step)
            reader.Update()
            grid = reader.GetOutput()
            points = grid.GetPointData()
            first = root["Steps/PointDataOffsets/displacement"][step]
            assert np.array_equal(vtk_to_numpy(points.GetArray("displacement")),
                                  root["PointData/displacement"][first:first + len(made.points)])
            assert np.array_equal(vtk_to_numpy(points.GetArray("displacement")), made.displacement[step])
            assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), made.points)
            assert [grid.GetCellType(cell) for cell in range(grid.GetNumberOfCells())] == made.types.tolist()
            assert np.array_equal(vtk_to_numpy(grid.GetCells().GetConnectivityArray()), made.connectivity)
            for name, expected in (("node_kind", made.node_kind), ("segment", made.segment), ("mode_2", made.modes[1])):
                assert np.array_equal(vtk_to_numpy(points.GetArray(name)), expected), name
            for name, rows in made.per_frame.items():
                assert np.array_equal(vtk_to_numpy(grid.GetFieldData().GetArray(name)).ravel(), np.ravel(rows[step])), name


def test_pyvista_opens_every_step(made, tmp_path):
    """PyVista's reader of VTKHDF has no time interface of its own (0.49); the VTK reader inside of it has."""
    import pyvista

    with_field = dataclasses.replace(made, fields={"velocity": 2 * made.displacement[:, :, :2]})
    write_trajectory(tmp_path / "t.vtkhdf", with_field)
    assert np.array_equal(read_trajectory(tmp_path / "t.vtkhdf").fields["velocity"], with_field.fields["velocity"])
    reader = pyvista.get_reader(tmp_path / "t.vtkhdf")
    reader.reader.UpdateInformation()
    assert reader.reader.GetNumberOfSteps() == len(made.displacement)
    for step in (0, 7, 10):
        reader.reader.SetStep(step)
        grid = reader.read()
        assert np.array_equal(grid.point_data["displacement"], made.displacement[step])
        assert np.array_equal(grid.point_data["velocity"], with_field.fields["velocity"][step])


def test_one_chunk_is_one_frame(made, tmp_path):
    write_trajectory(tmp_path / "t.vtkhdf", made)
    with h5py.File(tmp_path / "t.vtkhdf") as file:
        assert file["VTKHDF/PointData/displacement"].chunks == (len(made.points), 3)


@pytest.mark.parametrize("kept", [0, 1, 100, 0.5, 0.9, -1])
def test_a_file_cut_short_is_refused(made, tmp_path, kept):
    path = tmp_path / "t.vtkhdf"
    write_trajectory(path, made)
    data = path.read_bytes()
    path.write_bytes(data[:int(kept * len(data)) if isinstance(kept, float) else kept])
    with pytest.raises(InputError) as error:
        read_trajectory(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_flipped_bits_in_the_displacement_are_noticed(made, tmp_path):
    """Each chunk carries a checksum; without one the numbers would be read as if nothing had happened."""
    path = tmp_path / "t.vtkhdf"
    write_trajectory(path, made)
    with h5py.File(path) as file:
        chunk = file["VTKHDF/PointData/displacement"].id.get_chunk_info(5)
    data = bytearray(path.read_bytes())
    for place in range(0, chunk.size, max(1, chunk.size // 7)):
        damaged = data.copy()
        damaged[chunk.byte_offset + place] ^= 0x10
        path.write_bytes(damaged)
        with pytest.raises(InputError):
            read_trajectory(path)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_trajectory(tmp_path / "none.vtkhdf")
    (tmp_path / "text.vtkhdf").write_text("not HDF5")
    with h5py.File(tmp_path / "other.vtkhdf", "w") as file:
        file["x"] = 1
    for name in ("text", "other"):
        with pytest.raises(InputError):
            read_trajectory(tmp_path / f"{name}.vtkhdf")


def test_an_interrupted_write_leaves_what_was_there(made, tmp_path, monkeypatch):
    path = tmp_path / "t.vtkhdf"
    write_trajectory(path, made)
    before = path.read_bytes()
    write = module._write

    def interrupted(file, trajectory):
        write(file, trajectory)
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "_write", interrupted)
    for target in (path, tmp_path / "new.vtkhdf"):
        with pytest.raises(KeyboardInterrupt):
            write_trajectory(target, made)
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.vtkhdf"] and path.read_bytes() == before


@pytest.mark.parametrize(("change", "message"), [
    (lambda t: {"displacement": np.where(np.arange(len(t.points))[:, None] == 3, np.nan, t.displacement)}, "not finite"),
    (lambda t: {"displacement": t.displacement[1:]}, "rows for"),
    (lambda t: {"displacement": t.displacement + np.float32(1)}, "rest state"),
    (lambda t: {"connectivity": t.connectivity + 1}, "a cell names a node"),
    (lambda t: {"offsets": t.offsets[:-1]}, "offsets"),
    (lambda t: {"node_kind": t.node_kind[::-1]}, "body first"),
    (lambda t: {"complete": False}, "stopped"),
])
def test_problems_are_named(made, change, message):
    found = problems(dataclasses.replace(made, **change(made)))
    assert any(message in line for line in found), found
