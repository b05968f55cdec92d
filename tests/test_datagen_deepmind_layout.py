"""DeepMind's layout for bodies of a few nodes, written out by hand: which node goes where, which cells and which fields."""

import json

import numpy as np
import pytest

from datagen.files.tfrecord import parse_example, read_records, write_example, write_records
from datagen.files.trajectory import problems, read_trajectory
from datagen.sets import dataset
from datagen.sets.deepmind import KIND_OF, _decoded, _read_meta, export_records, from_fields, import_records, to_fields
from physics.schema import InputError
from tests.five_nodes import UNIT, tiny, write_set


def fields(**changes):
    """A tetrahedron of an obstacle (nodes 0, 2, 4, 6), which comes down, and one of a body (1, 3, 5, 7)."""
    rest = np.array([[0, 0, 5], [0, 0, 0], [1, 0, 5], [1, 0, 0], [0, 1, 5], [0, 1, 0], [0, 0, 6], [0, 0, 1]], np.float32)
    world = np.repeat(rest[None], 3, axis=0)
    world[1:, 3, 0] += np.float32(0.5)
    world[2, ::2, 2] -= 2
    kind = np.array([1, 3, 1, 0, 1, 0, 1, 0], np.int32)
    return {"cells": np.array([[[0, 2, 4, 6], [1, 3, 5, 7]]], np.int32), "mesh_pos": rest[None], "node_type": kind[None, :, None],
            "world_pos": world, "stress": np.arange(24, dtype=np.float32).reshape(3, 8, 1)} | changes


def test_nodes_of_the_obstacle_move_to_the_end_and_its_cells_become_their_outside():
    made = from_fields(fields(), index=4, source="here")
    assert made.node_kind.tolist() == [3, 0, 0, 0, 1, 1, 1, 1] and made.points[1].tolist() == [1, 0, 0]
    assert made.points[7].tolist() == [0, 0, 6]
    assert made.cells_of(10).tolist() == [[0, 1, 2, 3]] and made.types.tolist() == [10, 5, 5, 5, 5]
    assert {frozenset(triangle) for triangle in made.cells_of(5).tolist()} == {
        frozenset(set(range(4, 8)) - {left}) for left in range(4, 8)}
    assert made.offsets.tolist() == [0, 4, 7, 10, 13, 16] and problems(made) == []
    assert made.displacement[1, 1].tolist() == [0.5, 0, 0] and made.displacement[2, 4].tolist() == [0, 0, -2]
    assert not made.displacement[0].any()
    assert made.fields["stress"][1, :, 0].tolist() == [9, 11, 13, 15, 8, 10, 12, 14] and list(made.fields) == ["stress"]
    assert (made.index, made.extra, made.modes.shape) == (4, {"imported": "here"}, (0, 8, 3))


def test_fields_of_other_shapes_are_left_out():
    other = fields(short=np.zeros((2, 8, 1), np.float32), of_cells=np.zeros((3, 2, 1), np.float32), one=np.zeros((1, 8, 1), np.float32))
    assert list(from_fields(other).fields) == ["stress"]


def test_a_cloth_starts_as_it_lies():
    """Two coordinates in its own plane, three in space; triangles."""
    world = np.arange(2 * 3 * 3, dtype=np.float32).reshape(2, 3, 3)
    made = from_fields({"cells": np.array([[[0, 1, 2]]], np.int32), "mesh_pos": np.zeros((1, 3, 2), np.float32),
                        "node_type": np.zeros((1, 3, 1), np.int32), "world_pos": world})
    assert np.array_equal(made.points, world[0]) and (made.displacement[1] == 9).all() and made.types.tolist() == [5]
    flow = from_fields({"cells": np.array([[[0, 1, 2]]], np.int32), "mesh_pos": np.arange(6, dtype=np.float32).reshape(1, 3, 2),
                        "node_type": np.zeros((1, 3, 1), np.int32), "velocity": np.ones((4, 3, 2), np.float32)})
    assert flow.points.tolist() == [[0, 1, 0], [2, 3, 0], [4, 5, 0]] and flow.displacement.shape == (4, 3, 3)
    assert not flow.displacement.any()


@pytest.mark.parametrize(("cells", "words"), [
    ([[0, 2, 4, 6], [1, 3, 5, 8]], "outside of 0 .. 7"), ([[0, 2, 4, 6], [1, 3, 5, -1]], "outside of 0 .. 7"),
    ([[0, 2, 4, 7], [1, 3, 5, 7]], "both the body and the obstacle"), ([[0, 2, 4, 6, 0]], "cells of 5 nodes"),
    ([[0, 2]], "cells of 2 nodes")])
def test_cells_that_cannot_be_are_refused(cells, words):
    with pytest.raises(InputError, match=words):
        from_fields(fields(cells=np.array([cells], np.int32)))


def test_the_first_and_the_last_node_may_be_in_a_cell():
    assert from_fields(fields(cells=np.array([[[1, 3, 5, 7]]], np.int32))).types.tolist() == [10]
    assert KIND_OF == {3: "triangle", 4: "tetrahedron", 6: "prism", 8: "hexahedron"}


def test_an_obstacle_of_bricks_becomes_two_triangles_a_face():
    """One brick of the obstacle, its six faces in two triangles each, closed and outward: a volume of 2 x 3 x 4."""
    corner = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], np.float32) * [2, 3, 4]
    both = np.concatenate([corner, corner + 10]).astype(np.float32)
    made = from_fields({"cells": np.array([[range(8), range(8, 16)]], np.int32), "mesh_pos": both[None],
                        "node_type": np.repeat([1, 0], 8).astype(np.int32)[None, :, None]})
    triangles = made.points[made.cells_of(5)]
    assert len(triangles) == 12 and made.cells_of(12).tolist() == [list(range(8))]
    assert np.einsum("fi,fi->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6 == pytest.approx(24)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    assert sorted(area.tolist()) == pytest.approx([3] * 4 + [4] * 4 + [6] * 4)


def test_what_is_written_of_a_trajectory():
    made = tiny(fields={"stress": np.ones((3, 8, 1), np.float32)})
    found = to_fields(made)
    assert list(found) == ["cells", "obstacle_cells", "mesh_pos", "node_type", "world_pos", "stress"]
    assert found["cells"].tolist() == [[[0, 1, 2, 3], [1, 2, 3, 4]]] and found["obstacle_cells"].tolist() == [[[5, 6, 7]]]
    assert found["node_type"][0, :, 0].tolist() == [3, 0, 0, 3, 0, 1, 1, 1] and found["mesh_pos"].shape == (1, 8, 3)
    assert found["world_pos"][2, 1] == pytest.approx([0.3 + 3 * UNIT, 4 * UNIT, 12 * UNIT], rel=1e-7)
    assert {name: field.dtype.name for name, field in found.items()} == {
        "cells": "int32", "obstacle_cells": "int32", "mesh_pos": "float32", "node_type": "int32", "world_pos": "float32",
        "stress": "float32"}
    again = from_fields(found)
    assert again.connectivity.tolist() == made.connectivity.tolist()
    assert np.allclose(again.displacement, made.displacement, rtol=0, atol=2e-7)
    assert "obstacle_cells" not in to_fields(tiny(node_kind=np.zeros(8, np.uint8)))


def flat(**changes):
    return tiny(**{"points": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), "types": np.array([5], np.uint8), "offsets": np.array([0, 3]),
                   "connectivity": np.arange(3), "node_kind": np.zeros(3, np.uint8),
                   "displacement": np.zeros((2, 3, 3), np.float32), **changes})


def test_what_lies_in_its_plane_has_two_coordinates_and_no_motion():
    assert list(to_fields(flat())) == ["cells", "mesh_pos", "node_type"] and to_fields(flat())["mesh_pos"].shape == (1, 3, 2)
    for change in ({"points": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]])}, {"displacement": np.ones((2, 3, 3), np.float32)}):
        assert to_fields(flat(**change))["mesh_pos"].shape == (1, 3, 3) and "world_pos" in to_fields(flat(**change))


def test_a_plane_body_of_quadrilaterals_that_moves_is_read_back_as_one():
    moving = np.zeros((2, 4, 3), np.float32)
    moving[1, 2, :2] = 0.25, 0.5
    square = flat(points=np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), types=np.array([9], np.uint8), offsets=np.array([0, 4]),
                  connectivity=np.arange(4), node_kind=np.zeros(4, np.uint8), displacement=moving, modes=np.zeros((0, 4, 3), np.float32))
    found = to_fields(square)
    assert found["mesh_pos"].shape == (1, 4, 2) and found["world_pos"].shape == (2, 4, 3)
    again = from_fields(found)
    assert again.mesh.cell == "quadrilateral" and np.array_equal(again.displacement, moving) and np.array_equal(again.points, square.points)


def test_the_stress_that_is_written_is_von_mises_and_the_tensor_has_another_name():
    tensor, mises = np.ones((3, 8, 6), np.float32), np.full((3, 8, 1), 2, np.float32)
    found = to_fields(tiny(fields={"stress": tensor, "von_mises": mises}))
    assert found["stress"] is mises and found["cauchy_stress"] is tensor and "von_mises" not in found
    assert {name: field.shape[2] for name, field in from_fields(found).fields.items()} == {"stress": 1, "cauchy_stress": 6}


def test_two_obstacles_go_there_and_back_each_with_its_own_way():
    u = np.zeros((3, 11, 3), np.float32)
    u[:, :8] = tiny().displacement
    u[1:, 8:] = -0.5, 0.25, 0
    two = tiny(points=np.concatenate([tiny().points, tiny().points[5:] + [0, -4, 0]]), node_kind=np.append(tiny().node_kind, [1, 1, 1]),
               connectivity=np.append(tiny().connectivity, [8, 9, 10]), offsets=np.append(tiny().offsets, 14),
               types=np.append(tiny().types, 5).astype(np.uint8), displacement=u, modes=np.zeros((0, 11, 3), np.float32), frequencies_hz=())
    again = from_fields(to_fields(two))
    assert np.array_equal(again.obstacle[1], [[0, 1, 2], [3, 4, 5]]) and again.node_kind.tolist() == two.node_kind.tolist()
    assert np.allclose(again.displacement, u, rtol=0, atol=3e-7) and np.allclose(again.points, two.points, rtol=0, atol=3e-7)


def test_bricks_are_kept_whole_or_refused():
    brick = tiny(points=np.eye(8, 3), types=np.array([12], np.uint8), offsets=np.array([0, 8]), connectivity=np.arange(8),
                 node_kind=np.zeros(8, np.uint8))
    assert to_fields(brick, cells="own")["cells"].tolist() == [[list(range(8))]]
    with pytest.raises(InputError, match="--cells own"):
        to_fields(brick)
    prism = tiny(points=np.eye(8, 3), types=np.array([13], np.uint8), offsets=np.array([0, 6]), connectivity=np.arange(6),
                 node_kind=np.zeros(8, np.uint8))
    assert to_fields(prism)["cells"].shape == (1, 3, 4) and to_fields(prism, cells="own")["cells"].shape == (1, 1, 6)


def test_a_tetrahedron_of_ten_nodes_becomes_eight_of_four():
    ten = tiny(points=np.eye(10, 3), types=np.array([24], np.uint8), offsets=np.array([0, 10]), connectivity=np.arange(10),
               node_kind=np.zeros(10, np.uint8), displacement=np.zeros((3, 10, 3), np.float32), modes=np.zeros((0, 10, 3), np.float32))
    assert to_fields(ten)["cells"].tolist() == [[[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3],
                                                 [4, 5, 6, 9], [4, 6, 7, 9], [4, 7, 8, 9], [4, 8, 5, 9]]]
    assert to_fields(ten, cells="own")["cells"].shape == (1, 1, 10)


# ---- files


def test_a_set_is_written_split_by_split_with_one_layout(tmp_path):
    write_set(tmp_path / "ours", {"train/0000.vtkhdf": tiny(), "test/0000.vtkhdf": tiny(displacement=2 * tiny().displacement),
                                  "train/0001.vtkhdf": tiny(displacement=3 * tiny().displacement)})
    assert export_records(tmp_path / "ours", tmp_path / "theirs") == {
        "trajectories": 3, "fields": ["cells", "obstacle_cells", "mesh_pos", "node_type", "world_pos"], "train": 2, "test": 1}
    assert sorted(path.name for path in (tmp_path / "theirs").iterdir()) == ["meta.json", "test.tfrecord", "train.tfrecord"]
    meta = json.loads((tmp_path / "theirs/meta.json").read_text())
    static, dynamic = ({"type": kind, "shape": [rows, -1, 3], "dtype": "float32"} for kind, rows in (("static", 1), ("dynamic", 3)))
    assert meta == {"simulator": "fidelity", "dt": 1.0, "field_names": list(meta["features"]), "trajectory_length": 3, "features": {
        "cells": {"type": "static", "shape": [1, -1, 4], "dtype": "int32"}, "obstacle_cells": static | {"dtype": "int32"},
        "mesh_pos": static, "node_type": {"type": "static", "shape": [1, -1, 1], "dtype": "int32"}, "world_pos": dynamic}}
    second = list(read_records(tmp_path / "theirs/train.tfrecord"))[1]
    world = np.frombuffer(parse_example(second)["world_pos"][0], "<f4").reshape(3, 8, 3)
    assert world[2, 1] == pytest.approx([0.3 + 9 * UNIT, 12 * UNIT, 36 * UNIT], rel=1e-6)

    assert import_records(tmp_path / "theirs", tmp_path / "again")["trajectories"] == 3
    entries = dataset.read_manifest(tmp_path / "again").trajectories
    assert [(entry.file, entry.index) for entry in entries] == [
        ("train/0000.vtkhdf", 0), ("train/0001.vtkhdf", 1), ("test/0000.vtkhdf", 2_000_000)]
    assert read_trajectory(tmp_path / "again/train/0001.vtkhdf").extra == {"imported": "train.tfrecord, record 1"}
    manifest = dataset.read_manifest(tmp_path / "again")
    assert (manifest.family, manifest.seed) == ('# Imported from theirs\nname = "fidelity"\n', 0)
    assert import_records(tmp_path / "theirs", tmp_path / "few", count=1)["trajectories"] == 2
    with pytest.raises(InputError, match="holds a data set already"):
        import_records(tmp_path / "theirs", tmp_path / "few")
    with pytest.raises(InputError, match="no train.tfrecord, valid.tfrecord or test.tfrecord"):
        (tmp_path / "theirs/train.tfrecord").unlink()
        (tmp_path / "theirs/test.tfrecord").unlink()
        import_records(tmp_path / "theirs", tmp_path / "none")
    write_set(tmp_path / "empty", {})
    with pytest.raises(InputError, match="no trajectories"):
        export_records(tmp_path / "empty", tmp_path / "nothing")


def meta(tmp_path, **feature):
    path = tmp_path / "meta.json"
    path.write_text(json.dumps({"features": {"x": {"type": "dynamic", "shape": [2, -1, 3], "dtype": "float32"} | feature}}))
    return path


@pytest.mark.parametrize(("feature", "words"), [
    ({"type": "other"}, "field x is 'other'"), ({"shape": [2, -1]}, "shape"), ({"shape": [2, -1, 3, 1]}, "shape"),
    ({"shape": [-1, -1, 3]}, "shape"), ({"dtype": "none"}, "not the description"), ({"shape": None}, "not the description"),
    ({"shape": ["a"]}, "not the description")])
def test_a_description_that_is_none_is_refused(tmp_path, feature, words):
    with pytest.raises(InputError, match=rf"meta\.json: .*{words}"):
        _read_meta(meta(tmp_path, **feature))


@pytest.mark.parametrize(("shape", "size", "rows"), [
    ([2, -1, 3], 48, (2, 2, 3)), ([2, -1, 3], 24, (2, 1, 3)), ([2, -1, 3], 36, None), ([2, -1, 3], 47, None), ([2, 2, 3], 48, (2, 2, 3)),
    ([2, 2, 3], 96, None), ([2, 2, 3], 24, None), ([-1, 2, 3], 72, (3, 2, 3)), ([2, -1, 0], 0, None)])
def test_bytes_fit_their_shape_or_are_refused(tmp_path, shape, size, rows):
    given = _read_meta(meta(tmp_path, shape=shape))
    record = write_example({"x": np.arange(size, dtype=np.uint8).tobytes()})
    if rows is None:
        with pytest.raises(InputError, match=f"field x has {size} bytes"):
            _decoded(record, given)
    else:
        found = _decoded(record, given)["x"]
        assert found.shape == rows and found.dtype == np.dtype("<f4") and found.tobytes() == np.arange(size, dtype=np.uint8).tobytes()
    with pytest.raises(InputError, match="field x has 0 values"):
        _decoded(write_example({}), given)


def test_a_record_that_is_wrong_is_named(tmp_path):
    meta(tmp_path)
    write_records(tmp_path / "valid.tfrecord", [write_example({"x": bytes(48)})])
    with pytest.raises(InputError, match=r"valid\.tfrecord, record 0: no field cells"):
        import_records(tmp_path, tmp_path / "out")
