"""DeepMind's format: TFRecord, Example and meta.json against independent writers and readers, and there and back."""

import dataclasses
import json
import struct

import numpy as np
import pytest

import fidelity
from datagen.files.tfrecord import crc32c, masked, parse_example, read_records, write_example, write_records
from datagen.files.trajectory import OBSTACLE, problems, read_trajectory
from datagen.sets import dataset
from datagen.sets.check import check
from datagen.sets.deepmind import export_records, from_fields, import_records, to_fields
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.schema import InputError
from tests.small_set import FILES

# ---- an independent writer: bit by bit, from the specifications alone


def slow_crc(data):
    """CRC-32C one bit at a time."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0x82F63B78 if register & 1 else 0)
    return register ^ 0xFFFFFFFF


def slow_record(data):
    def guard(part):
        crc = slow_crc(part)
        return struct.pack("<I", (((crc >> 15) | (crc << 17)) + 0xA282EAD8) % 2**32)

    length = struct.pack("<Q", len(data))
    return length + guard(length) + data + guard(data)


def message(number, *parts):
    """A length-delimited protobuf field."""
    body, said = b"".join(parts), bytearray([number << 3 | 2])
    size = len(body)
    while size >= 128:
        said.append(size % 128 + 128)
        size //= 128
    return bytes(said) + bytes([size]) + body


def slow_example(arrays):
    return message(1, *(message(1, message(1, name.encode()), message(2, message(1, message(1, array.tobytes()))))
                        for name, array in arrays.items()))


def plate(frames=4, seed=0):
    """A tetrahedral block and a smaller one that pushes it, in DeformingPlate's layout; the obstacle's nodes come first."""
    random = np.random.default_rng(seed)
    body = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 1), cell="tetrahedron"))
    tool = build_mesh(Body(length=0.1, width=0.1, height=0.1, cells=(2, 2, 2), cell="tetrahedron"))
    first = len(tool.points)
    rest = np.concatenate([tool.points + [0.1, 0.05, 0.15], body.points]).astype(np.float32)
    kind = np.concatenate([np.full(first, 1), np.where(body.points[:, 0] == 0, 3, 0)]).astype(np.int32)
    world = np.repeat(rest[None], frames, axis=0)
    world[:, :first, 2] -= 0.01 * np.arange(frames, dtype=np.float32)[:, None]
    world[1:, kind == 0] += random.normal(0, 1e-3, (frames - 1, (kind == 0).sum(), 3)).astype(np.float32)
    return {"cells": np.concatenate([tool.cells, body.cells + first])[None].astype(np.int32), "mesh_pos": rest[None],
            "node_type": kind[None, :, None], "world_pos": world,
            "stress": random.normal(size=(frames, len(rest), 1)).astype(np.float32)}


def cylinder(frames=5):
    """A flow in CylinderFlow's layout."""
    random = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(4), np.arange(3), indexing="ij")
    number = np.arange(12).reshape(4, 3)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    cells = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    kind = np.where(x == 0, 4, np.where(x == 3, 5, np.where(y != 1, 6, 0))).ravel().astype(np.int32)
    return {"cells": cells[None], "mesh_pos": np.stack([x.ravel(), y.ravel()], 1)[None].astype(np.float32),
            "node_type": kind[None, :, None], "velocity": random.normal(size=(frames, 12, 2)).astype(np.float32),
            "pressure": random.normal(size=(frames, 12, 1)).astype(np.float32)}


def write_set(folder, **splits):
    folder.mkdir()
    some = next(iter(splits.values()))[0]
    frames = max(len(array) for array in some.values())
    features = {name: {"type": "dynamic" if len(array) > 1 else "static", "shape": [len(array), -1, array.shape[2]],
                       "dtype": array.dtype.name} for name, array in some.items()}
    (folder / "meta.json").write_text(json.dumps({"simulator": "test", "dt": 0.01, "features": features,
                                                  "field_names": list(features), "trajectory_length": frames}))
    for split, trajectories in splits.items():
        (folder / f"{split}.tfrecord").write_bytes(b"".join(slow_record(slow_example(t)) for t in trajectories))


# ---- the tests


def test_the_checksum_is_that_of_the_standard():
    """RFC 3720, B.4, and lengths on both sides of where lanes begin."""
    assert crc32c(b"123456789") == 0xE3069283
    assert crc32c(bytes(32)) == 0x8A9136AA and crc32c(b"\xff" * 32) == 0x62A8AB43 and crc32c(bytes(range(32))) == 0x46DD794E
    for size in (0, 1, 8191, 8192, 8193, 30_000):
        data = np.random.default_rng(size).bytes(size)
        assert crc32c(data) == slow_crc(data)


def test_records_and_examples_against_an_independent_writer(tmp_path):
    examples = [{"a": np.arange(200, dtype=np.int32), "b": np.zeros(0, np.float32)}, {"long name": np.arange(70_000, dtype=np.uint8)}]
    (tmp_path / "theirs").write_bytes(b"".join(slow_record(slow_example(example)) for example in examples))
    write_records(tmp_path / "ours", (write_example({name: array.tobytes() for name, array in example.items()}) for example in examples))
    assert (tmp_path / "ours").read_bytes() == (tmp_path / "theirs").read_bytes()
    for record, example in zip(read_records(tmp_path / "theirs"), examples, strict=True):
        assert parse_example(record) == {name: [array.tobytes()] for name, array in example.items()}


def test_other_lists_and_unknown_fields_are_skipped():
    other = message(1, message(1, b"n"), message(2, message(3, b"\x08\x05")))  # an Int64List
    extra = b"\x48\x96\x01" + b"\x51" + bytes(8) + b"\x5d" + bytes(4)  # a varint, a fixed64 and a fixed32
    assert parse_example(extra + message(1, other, message(1, message(1, b"m"), message(2, message(1, message(1, b"xy")))))) == {
        "n": [], "m": [b"xy"]}
    for broken in (b"\x0a\x05ab", b"\x0b", b"\xff" * 11):
        with pytest.raises(InputError, match="Example"):
            parse_example(broken)


def test_deforming_plate_is_read(tmp_path):
    one, other = plate(seed=0), plate(seed=1)
    write_set(tmp_path / "theirs", train=[one, other], test=[other])
    assert import_records(tmp_path / "theirs", tmp_path / "ours")["trajectories"] == 3
    assert check(tmp_path / "ours") == []
    assert [path.name for path in dataset.files(tmp_path / "ours", "train")] == ["0000.vtkhdf", "0001.vtkhdf"]
    read = read_trajectory(tmp_path / "ours" / "train" / "0001.vtkhdf")
    obstacle = other["node_type"][0, :, 0] == OBSTACLE
    order = np.concatenate([np.flatnonzero(~obstacle), np.flatnonzero(obstacle)])
    assert np.array_equal(read.points, other["mesh_pos"][0, order]) and np.array_equal(read.node_kind, other["node_type"][0, order, 0])
    # Single precision of numbers up to 0.3 on either side.
    assert np.allclose(read.points + read.displacement, other["world_pos"][:, order], rtol=0, atol=4e-8)
    assert np.array_equal(read.fields["stress"], other["stress"][:, order])
    of_body = other["cells"][0][~obstacle[other["cells"][0]].any(axis=1)]
    assert np.array_equal(order[read.cells_of(10)], of_body)
    triangles = read.cells_of(5)  # the outside of the 2 x 2 x 2 block: 6 faces of 4 squares of 2 triangles
    assert len(triangles) == 48 and (read.node_kind[triangles] == OBSTACLE).all()
    corners = read.points[triangles]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(1e-3, rel=1e-5)  # closed and outward


def test_cylinder_flow_goes_there_and_back(tmp_path):
    write_set(tmp_path / "theirs", valid=[cylinder()])
    import_records(tmp_path / "theirs", tmp_path / "ours")
    assert check(tmp_path / "ours") == []
    export_records(tmp_path / "ours", tmp_path / "back")
    assert (tmp_path / "back" / "valid.tfrecord").read_bytes() == (tmp_path / "theirs" / "valid.tfrecord").read_bytes()
    back, theirs = (json.loads((tmp_path / name / "meta.json").read_text()) for name in ("back", "theirs"))
    assert back["features"] == theirs["features"] and back["trajectory_length"] == 5


def test_ours_go_there_and_back(folder, tmp_path):
    export_records(folder, tmp_path / "theirs", cells="own")
    import_records(tmp_path / "theirs", tmp_path / "again")
    for file in FILES:
        before, after = read_trajectory(folder / file), read_trajectory(tmp_path / "again" / file)
        for name in ("connectivity", "offsets", "types", "node_kind"):
            assert np.array_equal(getattr(before, name), getattr(after, name)), name
        # Positions up to 0.1 m in single precision, twice.
        assert np.allclose(after.points, before.points, rtol=0, atol=4e-9)
        assert np.allclose(after.displacement, before.displacement, rtol=0, atol=1.5e-8)


def test_the_default_export_has_deforming_plates_layout(folder, tmp_path, capsys):
    assert fidelity.main(["dataset", "export", str(folder), "--out", str(tmp_path / "theirs")]) == 0
    meta = json.loads((tmp_path / "theirs" / "meta.json").read_text())
    assert meta["features"]["cells"] == {"type": "static", "shape": [1, -1, 4], "dtype": "int32"}
    assert meta["features"]["world_pos"] == {"type": "dynamic", "shape": [7, -1, 3], "dtype": "float32"}
    first = next(read_records(tmp_path / "theirs" / "train.tfrecord"))
    cells = np.frombuffer(parse_example(first)["cells"][0], np.int32).reshape(-1, 4)
    ours = read_trajectory(folder / FILES[0])
    corners = ours.points[cells]
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    assert volume.min() > 0 and volume.sum() == pytest.approx(np.prod(np.ptp(ours.points[ours.body], axis=0)))
    assert fidelity.main(["dataset", "import", str(tmp_path / "theirs"), "--out", str(tmp_path / "again"), "--count", "1"]) == 0
    assert len(dataset.read_manifest(tmp_path / "again").trajectories) == 3
    assert problems(read_trajectory(tmp_path / "again" / FILES[0])) == []


def test_damaged_and_foreign_files_are_refused_in_a_line(tmp_path):
    write_set(tmp_path / "theirs", train=[plate()])
    path = tmp_path / "theirs" / "train.tfrecord"
    data = path.read_bytes()
    for damaged in (data[:-1], data[:5], data[:100], data[:50] + bytes([data[50] ^ 1]) + data[51:], bytes([data[0] ^ 1]) + data[1:]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"train\.tfrecord: record 0") as error:
            import_records(tmp_path / "theirs", tmp_path / "ours")
        assert "\n" not in str(error.value) and not (tmp_path / "ours" / "manifest.json").exists()
    path.write_bytes(data[:8] + masked(data[:8]) + data[12:])
    meta = json.loads((tmp_path / "theirs" / "meta.json").read_text())
    for change, words in (({"stress": {"type": "dynamic_varlen", "shape": [4, -1, 1], "dtype": "float32"}}, "dynamic_varlen"),
                          ({"speed": {"type": "dynamic", "shape": [4, -1, 1], "dtype": "float32"}}, "field speed has 0 values"),
                          ({"stress": {"type": "dynamic", "shape": [7, -1, 11], "dtype": "float64"}}, "do not fit its shape")):
        (tmp_path / "theirs" / "meta.json").write_text(json.dumps(meta | {"features": meta["features"] | change}))
        with pytest.raises(InputError, match=words):
            import_records(tmp_path / "theirs", tmp_path / "ours")
    with pytest.raises(InputError, match=r"meta\.json"):
        import_records(tmp_path, tmp_path / "ours")
    mixed = plate()
    mixed["cells"][0, 0, 0] = mixed["node_type"].size - 1
    with pytest.raises(InputError, match="both the body and the obstacle"):
        from_fields(mixed)
    del mixed["cells"]
    with pytest.raises(InputError, match="no field cells"):
        from_fields(mixed)


def test_one_layout_for_all(folder, tmp_path):
    path = folder / FILES[1]
    from datagen.files.trajectory import write_trajectory

    found = read_trajectory(path)
    write_trajectory(path, dataclasses.replace(found, displacement=found.displacement[:-1], per_frame={}))
    with pytest.raises(InputError, match="one layout for all"):
        export_records(folder, tmp_path / "theirs")
    assert to_fields(found)["cells"].shape[2] == 4
