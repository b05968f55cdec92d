"""A packed set gives back every displacement within its bound and the rest as it was; damage is refused; the set in assets works."""

import dataclasses
import zipfile
from pathlib import Path

import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets import dataset
from datagen.sets.check import against_scene, check
from datagen.sets.pack import decode, encode, pack, unpack
from physics.schema import InputError
from tests.small_set import FILES
from tests.synthetic import bending

ASSET = Path(__file__).parents[1] / "assets" / "beam-small.pack"


def noisy(size):
    """A trajectory without low rank: white noise on its free nodes."""
    bent = bending(steps=20)
    noise = np.random.default_rng(0).normal(0, size, bent.displacement.shape).astype(np.float32)
    noise[:, ~bent.free], noise[0] = 0, 0
    return dataclasses.replace(bent, displacement=bent.displacement + noise)


def largest_error(packed, true):
    return np.linalg.norm(packed.displacement.astype(np.float64) - true.displacement, axis=2).max()


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-6, 1e-7, 1e-10])
@pytest.mark.parametrize("noise", [0, 1e-6, 1e-3])
def test_no_displacement_is_off_by_more_than_the_tolerance(tolerance, noise):
    true = noisy(noise)
    blob, said = encode(true, tolerance)
    packed = decode(blob)
    assert largest_error(packed, true) == pytest.approx(said, abs=1e-15) and said <= tolerance
    still = ~true.displacement.any(axis=(0, 2))
    assert not packed.displacement[:, still].any()  # what never moves is held: exactly at rest
    rigid = ~true.body
    assert np.array_equal(packed.displacement[:, rigid], true.displacement[:, rigid])
    for name in ("points", "connectivity", "offsets", "types", "node_kind"):
        array = getattr(packed, name)
        assert np.array_equal(array, getattr(true, name)) and array.dtype == getattr(true, name).dtype
    # Half a step of 1e-6 and the rounding of single precision near 1, 2^-24 = 6e-8.
    assert abs(packed.modes.astype(np.float64) - true.modes).max() <= 0.5e-6 + 6e-8


def test_everything_else_survives():
    random = np.random.default_rng(1)
    bent = bending(steps=5)
    true = dataclasses.replace(
        bent, segment=np.arange(len(bent.points), dtype=np.int32), scene="name = 'x'", seed=3, index=4, commit="abc",
        versions={"numpy": "1"}, extra={"why": ["because"]}, frequencies_hz=(1.5, 2.5),
        per_frame={"reaction": random.normal(size=(6, 3)), "newton_iterations": np.arange(6)},
        fields={"stress": random.normal(size=(6, len(bent.points), 1)).astype(np.float32)})
    packed = decode(encode(true, 1e-6)[0])
    assert packed.extra == {"why": ["because"], "tolerance": 1e-6}
    for name in ("scene", "seed", "index", "commit", "versions", "frequencies_hz", "complete"):
        assert getattr(packed, name) == getattr(true, name), name
    assert np.array_equal(packed.segment, true.segment) and np.array_equal(packed.fields["stress"], true.fields["stress"])
    assert np.array_equal(packed.per_frame["newton_iterations"], true.per_frame["newton_iterations"])
    # Single precision: half a unit in the last place, 2^-24.
    assert packed.per_frame["reaction"] == pytest.approx(true.per_frame["reaction"], rel=2**-24)


def test_a_body_at_rest_and_one_without_obstacle():
    bent = bending(steps=3)
    still = dataclasses.replace(bent, displacement=np.zeros_like(bent.displacement))
    assert not decode(encode(still, 1e-6)[0]).displacement.any()
    body = int(bent.body.sum())
    alone = dataclasses.replace(
        bent, points=bent.points[:body], node_kind=bent.node_kind[:body], displacement=bent.displacement[:, :body],
        modes=bent.modes[:, :body], types=bent.types[bent.types == 13], connectivity=bent.connectivity[:6 * (bent.types == 13).sum()],
        offsets=bent.offsets[:(bent.types == 13).sum() + 1])
    assert largest_error(decode(encode(alone, 1e-6)[0]), alone) <= 1e-6


def test_a_packed_set_unpacks_to_one_that_passes_its_check(folder, tmp_path):
    report = pack(folder, tmp_path / "small.pack", tolerance=1e-6)
    assert report["trajectories"] == 4 and report["largest_error"] <= 1e-6 and report["bytes"] == (tmp_path / "small.pack").stat().st_size
    unpack(tmp_path / "small.pack", tmp_path / "again")
    assert check(tmp_path / "again") == []
    before, after = dataset.read_manifest(folder), dataset.read_manifest(tmp_path / "again")
    assert after.recipe == before.recipe and [entry.file for entry in after.trajectories] == [entry.file for entry in before.trajectories]
    for file in FILES:
        assert largest_error(read_trajectory(tmp_path / "again" / file), read_trajectory(folder / file)) <= 1e-6


def test_damage_and_mistakes_are_refused(folder, tmp_path, capsys):
    packed = tmp_path / "small.pack"
    assert fidelity.main(["dataset", "pack", str(folder), "--out", str(packed)]) == 0
    data = packed.read_bytes()
    for damaged in (data[:len(data) // 2], data[:100], b"", data[:3000] + bytes([data[3000] ^ 1]) + data[3001:]):
        packed.write_bytes(damaged)
        with pytest.raises(InputError, match=r"small\.pack"):
            unpack(packed, tmp_path / "again")
        assert not (tmp_path / "again" / "manifest.json").exists()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("manifest.json", '{"schema": 99}')
    with pytest.raises(InputError, match="schema 99"):
        unpack(packed, tmp_path / "again")
    with pytest.raises(InputError, match="no such file"):
        unpack(tmp_path / "none.pack", tmp_path / "again")
    with pytest.raises(InputError, match="holds a data set already"):
        unpack(packed, folder)
    assert fidelity.main(["dataset", "pack", str(folder), "--out", str(packed), "--tolerance", "0"]) == 2
    found = read_trajectory(folder / FILES[1])
    write_trajectory(folder / FILES[1], dataclasses.replace(found, displacement=found.displacement * np.float32(1.5)))
    assert fidelity.main(["dataset", "pack", str(folder), "--out", str(packed)]) == 1
    assert FILES[1] in capsys.readouterr().err


def test_the_small_set_in_the_repository(tmp_path):
    """24 trajectories for tests of learning; two of each split are held against their equations, all against their sums."""
    assert ASSET.stat().st_size < 8e6
    assert unpack(ASSET, tmp_path)["trajectories"] == 24
    assert [len(dataset.files(tmp_path, split)) for split in ("train", "valid", "test")] == [16, 4, 4]
    for split in ("train", "valid", "test"):
        for path in dataset.files(tmp_path, split)[:2]:
            assert against_scene(read_trajectory(path), steps=3) == []
