"""A folder's manifest, its files in order, and the checksum of arrays, put together by hashlib alone."""

import dataclasses
import hashlib
import json

import numpy as np
import pytest

from datagen.sets import dataset
from datagen.sets.dataset import digest, entry_of, file_name, files, read_manifest, write_manifest
from physics.schema import InputError
from tests.five_nodes import tiny, write_set


def by_hand(made):
    """Name, type and shape of each array and then its bytes: the mesh, motion, modes, frequencies, what is per frame by name, fields."""
    arrays = [("points", made.points), ("connectivity", made.connectivity), ("offsets", made.offsets), ("types", made.types),
              ("node_kind", made.node_kind), ("displacement", made.displacement), ("modes", made.modes),
              ("frequencies_hz", np.array(made.frequencies_hz)), *sorted(made.per_frame.items()), *made.fields.items()]
    text = b"".join(f"{name} {array.dtype.str} {array.shape}".encode() + array.tobytes() for name, array in arrays)
    return hashlib.sha256(text).hexdigest()


def test_the_checksum_is_that_of_names_types_shapes_and_bytes():
    made = tiny(fields={"stress": np.ones((3, 8, 1), np.float32)})
    assert digest(made) == by_hand(made)
    turned = dataclasses.replace(made, per_frame=dict(reversed(made.per_frame.items())))
    assert digest(turned) == digest(made)


@pytest.mark.parametrize("change", [
    {"segment": np.arange(8, dtype=np.int32)}, {"extra": {"seconds": 1.0}}, {"versions": {}}, {"commit": "x"}, {"seed": 9}, {"index": 9},
    {"scene": "name = 'x'"}])
def test_what_plays_no_part_in_the_checksum(change):
    assert digest(tiny(**change)) == digest(tiny())


@pytest.mark.parametrize("change", [
    {"points": tiny().points + 1e-12}, {"displacement": tiny().displacement[:, ::-1]}, {"modes": tiny().modes[:1]},
    {"frequencies_hz": (10.0, 12.6)}, {"node_kind": np.zeros(8, np.uint8)}, {"per_frame": {}}, {"fields": {"x": np.zeros((3, 8, 1))}},
    {"offsets": tiny().offsets.astype(np.int32)}])
def test_what_plays_a_part_in_the_checksum(change):
    assert digest(tiny(**change)) != digest(tiny())


def test_an_entry_says_what_the_trajectory_is():
    made = tiny(extra={"seconds": 2, "failed_attempts": ["a", "b"]})
    assert entry_of("valid/0003.vtkhdf", made) == dataset.Entry(
        file="valid/0003.vtkhdf", split="valid", index=7, failed_attempts=("a", "b"), nodes=8, cells=3, steps=2, seconds=2.0,
        sha256=by_hand(made))
    bare = entry_of("test/0000.vtkhdf", tiny(extra={}))
    assert (bare.failed_attempts, bare.seconds, bare.promised) == ((), 0.0, None)
    for reached in (True, False):
        assert entry_of("test/0000.vtkhdf", tiny(extra={"accuracy": {"reached": reached}})).promised is reached


def test_files_are_numbered_from_four_digits_on():
    assert file_name("train", 7) == "train/0007.vtkhdf" and file_name("valid", 12345) == "valid/12345.vtkhdf"


def test_the_files_of_a_split_are_in_order(tmp_path):
    (tmp_path / "valid").mkdir()
    for name in ("0010.vtkhdf", "0002.vtkhdf", ".0003.vtkhdf.1.part", "x.vtkhdf", "0004.txt"):
        (tmp_path / "valid" / name).touch()
    assert files(tmp_path, "valid") == [tmp_path / "valid/0002.vtkhdf", tmp_path / "valid/0010.vtkhdf"]
    with pytest.raises(InputError, match="train: no trajectory files"):
        files(tmp_path, "train")
    with pytest.raises(InputError, match="must be one of train, valid, test; did you mean 'valid'"):
        files(tmp_path, "valida")


def test_a_manifest_is_read_as_it_was_written(tmp_path):
    manifest = write_set(tmp_path, {"train/0000.vtkhdf": tiny(), "test/0000.vtkhdf": tiny(extra={"failed_attempts": ["slipped"]})})
    assert read_manifest(tmp_path) == manifest
    table = json.loads((tmp_path / "manifest.json").read_text())
    assert table.keys() == {"schema", "family", "seed", "trajectories"} and (table["schema"], table["seed"]) == (1, 3)
    assert table["trajectories"][1]["failed_attempts"] == ["slipped"] and table["trajectories"][0]["file"] == "train/0000.vtkhdf"
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(InputError, match=r"manifest\.json: not a manifest"):
        read_manifest(tmp_path)


def test_a_set_is_the_same_with_other_numbers_of_trajectories(tmp_path):
    manifest = write_set(tmp_path, {}, family='name = "x"\n[body]\nlength = 1\n[splits]\ntrain = 3\n')
    assert manifest.recipe == ({"name": "x", "body": {"length": 1}}, 3)
    assert dataclasses.replace(manifest, family='name = "x"\n[splits]\ntest = 9\n[body]\nlength = 1').recipe == manifest.recipe
    assert dataclasses.replace(manifest, seed=4).recipe != manifest.recipe
    assert dataclasses.replace(manifest, family='name = "x"\n[body]\nlength = 2').recipe != manifest.recipe


def test_a_manifest_is_written_whole_or_not_at_all(tmp_path):
    manifest = write_set(tmp_path, {})
    before = (tmp_path / "manifest.json").read_bytes()
    with pytest.raises(TypeError):
        write_manifest(tmp_path, dataclasses.replace(manifest, seed=object()))
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"] and (tmp_path / "manifest.json").read_bytes() == before
