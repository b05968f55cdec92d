"""A packed trajectory read by hand, as pack.py's docstring describes it: the coarsest within its bound; and all damage is noticed."""

import dataclasses
import json
import lzma
import math
import zipfile

import numpy as np
import pytest

from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets import dataset
from datagen.sets.pack import decode, encode, pack, unpack
from physics.schema import InputError
from tests.five_nodes import UNIT, tiny, write_set
from tests.synthetic import bending


def opened(blob):
    """Header and arrays of a packed trajectory: each array as its first bytes, its second bytes and so on."""
    size = int.from_bytes(blob[:8], "little")
    header, at, arrays = json.loads(blob[8:8 + size]), 8 + size, {}
    for name, (kind, shape) in header["arrays"].items():
        width, count = np.dtype(kind).itemsize, int(np.prod(shape, dtype=int))
        planes = [blob[at + k * count:at + (k + 1) * count] for k in range(width)]
        arrays[name] = np.frombuffer(bytes(byte for entry in zip(*planes, strict=True) for byte in entry), kind).reshape(shape)
        at += width * count
    assert at == len(blob)
    return header, arrays


def far(a, b):
    """Largest length of a node's difference."""
    return max(math.sqrt(sum(float(x) ** 2 for x in row)) for row in (a.astype(float) - b).reshape(-1, 3))


def of_rank(sizes, seed=0):
    """A trajectory whose motion is a sum of so many random shapes of these sizes [m], with random shares."""
    random, bent = np.random.default_rng(seed), bending(cells=(4, 2, 2), steps=14)
    frames, free = len(bent.displacement), bent.free
    left = np.linalg.qr(random.normal(size=(frames - 1, len(sizes))))[0]
    right = np.linalg.qr(random.normal(size=(3 * free.sum(), len(sizes))))[0]
    u = np.zeros_like(bent.displacement)
    u[1:, free] = ((left * sizes) @ right.T).reshape(frames - 1, -1, 3)
    return dataclasses.replace(bent, displacement=u)


SIZES = (1.0, 1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_rank_and_step_are_the_coarsest_within_the_bound(tolerance):
    """The rank: the smallest whose truncation alone costs half of the tolerance at most. The step: 3 tolerances over the root of the
    rank and down by 15 % at a time until the bound holds, so the one before did not: the error is next to the tolerance."""
    true = of_rank(SIZES)
    blob, error = encode(true, tolerance)
    header, arrays = opened(blob)
    moving = true.displacement[:, true.free]
    left, size, right = np.linalg.svd(moving.reshape(len(moving), -1).astype(float), full_matrices=False)
    rank = next(r for r in range(len(size) + 1)
                if far(((left[:, :r] * size[:r]) @ right[:r]).reshape(moving.shape), moving) <= tolerance / 2)
    assert 1 < rank < len(SIZES) and arrays["shapes"].shape == (rank, true.free.sum(), 3)
    assert arrays["shares"].shape == (len(moving), rank)
    times = round(math.log(header["step"] / (3 * tolerance / rank**0.5), 0.85))
    assert header["step"] == pytest.approx(3 * tolerance / rank**0.5 * 0.85**times, rel=1e-12) and times >= 0
    # Read by hand: shares are the sums of their changes.
    shares = np.cumsum(arrays["shares"], axis=0) * header["share_steps"]
    u = np.einsum("tr,rni->tni", shares, arrays["shapes"] * header["step"]).astype(np.float32)
    assert far(u, moving) == pytest.approx(error, rel=1e-12) and error <= tolerance
    assert np.array_equal(decode(blob).displacement[:, true.free], u)
    # Shares are rounded to a power of two that moves no node by more than a tenth of the shapes' step, and more than a twentieth.
    for shape, step in zip(arrays["shapes"] * header["step"], header["share_steps"], strict=True):
        assert math.log2(step) % 1 == 0 and 0.05 * header["step"] < step * abs(shape).max() <= 0.1 * header["step"]
    # Fitted again: no shares suit the rounded shapes better, but for their own rounding.
    best = np.linalg.lstsq((arrays["shapes"].reshape(rank, -1) * header["step"]).T, moving.reshape(len(moving), -1).T, rcond=None)[0].T
    assert (abs(shares - best) <= 0.51 * np.array(header["share_steps"])).all()
    # One step coarser, made by hand, is too coarse.
    if times:
        scaled = right[:rank] * (size[:rank] * abs(left[:, :rank]).max(axis=0))[:, None]
        coarse = np.round(scaled / (header["step"] / 0.85)) * (header["step"] / 0.85)
        again = np.linalg.lstsq(coarse.T, moving.reshape(len(moving), -1).T, rcond=None)[0].T @ coarse
        assert far(again.reshape(moving.shape), moving) > 0.9 * tolerance  # without the shares' own rounding, up to a tenth


def test_the_error_that_is_said_is_next_to_the_tolerance():
    """Of five sets of shapes the largest error comes within a tenth of the tolerance: the bound is used."""
    errors = [encode(of_rank(SIZES, seed), 1e-3)[1] for seed in range(5)]
    assert 0.9e-3 < max(errors) <= 1e-3 and min(errors) > 0.6e-3


def test_a_motion_of_one_shape_takes_one():
    header, arrays = opened(encode(of_rank((1.0,)), 1e-5)[0])
    assert arrays["shapes"].shape[0] == 1 and "motion" not in arrays and header["frames"] == 15


def test_nothing_that_moves_less_than_half_the_tolerance_takes_a_shape():
    whole = tiny()
    for tolerance, ranks in ((2.01 * 13 * UNIT, 0), (1.99 * 13 * UNIT, 1)):
        still = dataclasses.replace(whole, displacement=np.where(whole.free[:, None], whole.displacement, 0).astype(np.float32))
        header, arrays = opened(encode(still, tolerance)[0])
        assert arrays["shapes"].shape[0] == ranks and len(header["share_steps"]) == ranks
        assert far(decode(encode(still, tolerance)[0]).displacement, still.displacement) <= tolerance


@pytest.mark.parametrize("tolerance", [1e-9, 1e-30])
def test_where_nothing_coarser_would_do_the_numbers_are_kept_as_they_are(tolerance):
    """Below the rounding of single precision, 2^-24 of the 13/1024 m here: 8e-10 m; no motion of rank 2 is left out."""
    whole = tiny()
    noise = np.random.default_rng(1).normal(0, 1e-3, whole.displacement.shape).astype(np.float32)
    noisy = dataclasses.replace(whole, displacement=noise)
    blob, error = encode(noisy, tolerance)
    _, arrays = opened(blob)
    assert error == 0 and "shapes" not in arrays and np.array_equal(arrays["motion"], noise)
    assert np.array_equal(decode(blob).displacement, noise)


def test_what_is_in_a_packed_trajectory():
    """Differences of node numbers, modes in steps of 1e-6, numbers of frames in single precision, and the obstacle's path alone."""
    true = tiny(segment=np.arange(8, dtype=np.int32), modes=np.full((1, 8, 3), 0.1234567, np.float32), frequencies_hz=(2.5,))
    header, arrays = opened(encode(true, 1e-3)[0])
    assert arrays["connectivity"].tolist() == [0, 1, 1, 1, -2, 1, 1, 1, 1, 1, 1] and arrays["connectivity"].dtype == np.int32
    assert (arrays["modes"] == 123457).all() and arrays["frame energy"].tolist() == [0, 0.5, 0.25]
    assert arrays["frame reaction"].dtype == np.float32 and arrays["frame newton_iterations"].dtype == np.int64
    assert arrays["moving"].tolist() == [True, True, True, False, True, False, False, False]
    assert np.array_equal(arrays["path"], [[0, 0, 0], [0, 50 * UNIT, 0], [0, 50 * UNIT, 0]])
    assert {name: header[name] for name in ("frequencies_hz", "seed", "index", "commit", "complete", "scene", "frames", "extra")} == {
        "frequencies_hz": [2.5], "seed": 3, "index": 7, "commit": "abc", "complete": True, "scene": "", "frames": 3,
        "extra": {"seconds": 6.0, "tolerance": 1e-3}}
    assert decode(encode(true, 1e-3)[0]).offsets.tolist() == [0, 4, 8, 11]


def test_an_obstacle_that_turns_is_packed_as_the_body_is():
    whole = tiny()
    turning = whole.displacement.copy()
    turning[2, 6, 0] += np.float32(0.5)
    blob, _ = encode(dataclasses.replace(whole, displacement=turning), 1e-3)
    _, arrays = opened(blob)
    assert "path" not in arrays and arrays["moving"][5:].all() and far(decode(blob).displacement, turning) <= 1e-3
    alone = dataclasses.replace(whole, node_kind=np.where(whole.body, whole.node_kind, 0).astype(np.uint8))
    _, arrays = opened(encode(alone, 1e-3)[0])
    assert "path" not in arrays and arrays["moving"][5:].all()


# ---- whole sets


@pytest.mark.parametrize(("first", "second"), [(1e-3, 1e-6), (1e-6, 1e-3)])
def test_a_set_packed_twice_is_as_coarse_as_the_coarser_time(tmp_path, first, second):
    write_set(tmp_path / "a", {"train/0000.vtkhdf": tiny()})
    for here, there, tolerance in (("a", "b", first), ("b", "c", second)):
        report = pack(tmp_path / here, tmp_path / f"{there}.pack", tolerance=tolerance)
        assert report["tolerance"] == tolerance
        assert unpack(tmp_path / f"{there}.pack", tmp_path / there) == {"trajectories": 1, "tolerance": tolerance}
    assert read_trajectory(tmp_path / "b/train/0000.vtkhdf").extra["tolerance"] == first
    assert read_trajectory(tmp_path / "c/train/0000.vtkhdf").extra["tolerance"] == 1e-3


@pytest.fixture
def packed(tmp_path):
    """Two trajectories, the second twice as large and in another split."""
    other = tiny(displacement=2 * tiny().displacement, index=2_000_000)
    write_set(tmp_path / "set", {"train/0000.vtkhdf": tiny(), "test/0000.vtkhdf": other})
    return tmp_path / "small.pack"


def test_the_report_and_the_archive_say_what_is_there(packed, tmp_path):
    report = pack(tmp_path / "set", packed, tolerance=1e-3)
    files = [tmp_path / "set" / name for name in ("train/0000.vtkhdf", "test/0000.vtkhdf")]
    with zipfile.ZipFile(packed) as archive:
        assert archive.namelist() == ["manifest.json", "train/0000", "test/0000"]
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_LZMA}
        about = json.loads(archive.read("manifest.json"))
        errors = [far(decode(archive.read(name)).displacement, read_trajectory(file).displacement)
                  for name, file in zip(archive.namelist()[1:], files, strict=True)]
    assert about == {"schema": 1, "tolerance": 1e-3, "manifest": json.loads((tmp_path / "set/manifest.json").read_text())}
    size = packed.stat().st_size
    assert report == {"trajectories": 2, "bytes": size, "ratio": sum(file.stat().st_size for file in files) / size,
                      "largest_error": pytest.approx(max(errors), rel=1e-12), "tolerance": 1e-3}
    assert unpack(packed, tmp_path / "again") == {"trajectories": 2, "tolerance": 1e-3}
    again, before = (dataset.read_manifest(tmp_path / name) for name in ("again", "set"))
    for new, old in zip(again.trajectories, before.trajectories, strict=True):
        assert new.sha256 == dataset.digest(read_trajectory(tmp_path / "again" / new.file)) != old.sha256
        assert dataclasses.replace(new, sha256="") == dataclasses.replace(old, sha256="")


@pytest.mark.parametrize("tolerance", [0.0, -1e-6, math.nan, math.inf])
def test_a_tolerance_is_a_length(packed, tmp_path, tolerance):
    with pytest.raises(InputError, match="must be above 0 m"):
        pack(tmp_path / "set", packed, tolerance=tolerance)
    assert not packed.exists()


def test_a_set_that_is_not_what_its_manifest_says_leaves_no_file(packed, tmp_path):
    write_trajectory(tmp_path / "set/test/0000.vtkhdf", tiny())
    with pytest.raises(RuntimeError, match="checksum differs"):
        pack(tmp_path / "set", packed)
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_flipped_bytes_are_refused_or_change_nothing(packed, tmp_path, monkeypatch):
    """Every fifth byte, turned over; only in the archive's own headers (times, attributes) may one go unnoticed, never in the data."""
    monkeypatch.setattr("datagen.sets.pack.write_trajectory", lambda path, trajectory: None)
    pack(tmp_path / "set", packed, tolerance=1e-3)
    data = packed.read_bytes()
    with zipfile.ZipFile(packed) as archive:  # behind 30 bytes and the name; of LZMA not the properties, nor the mark of its end
        starts = {info: info.header_offset + 30 + len(info.filename) for info in archive.infolist()}
        vital = {place for info, start in starts.items() for place in range(start + 10, start + info.compress_size - 16)}
    sums = []
    monkeypatch.setattr(dataset, "write_manifest", lambda out, manifest: sums.append(manifest))
    unpack(packed, tmp_path / "again")
    for place in range(0, len(data), 5):
        packed.write_bytes(data[:place] + bytes([data[place] ^ 0xFF]) + data[place + 1:])
        try:
            unpack(packed, tmp_path / "again")
        except InputError as error:
            assert str(error).startswith(f"{packed}: ") and "\n" not in str(error)
        else:
            assert place not in vital and sums.pop() == sums[0]


@pytest.mark.parametrize("part", [0, 0.1, 0.5, 0.9, 0.99, 1])
def test_a_file_cut_short_is_refused(packed, tmp_path, part):
    pack(tmp_path / "set", packed, tolerance=1e-3)
    data = packed.read_bytes()
    packed.write_bytes(data[:min(int(part * len(data)), len(data) - 1)])
    with pytest.raises(InputError, match=r"small\.pack: not a whole packed data set"):
        unpack(packed, tmp_path / "again")
    assert not (tmp_path / "again/manifest.json").exists()


@pytest.mark.parametrize("error", [lzma.LZMAError("x"), KeyError("x"), ValueError("x"), EOFError("x"), RuntimeError("x")])
def test_whatever_damage_looks_like_is_said_in_a_line(packed, tmp_path, monkeypatch, error):
    pack(tmp_path / "set", packed)

    def damaged(blob):
        raise error

    monkeypatch.setattr("datagen.sets.pack.decode", damaged)
    with pytest.raises(InputError, match=r"small\.pack: not a whole packed data set: '?x"):
        unpack(packed, tmp_path / "again")
