"""The journal of an unfinished path: what it holds, when it is written, and that no damage to it goes unnoticed."""

import itertools
import zlib
from dataclasses import dataclass

import numpy as np
import pytest

from physics import journal
from physics.journal import Journal, flatten, unflatten
from physics.schema import InputError, WorkError


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until it is told to go on."""
    now = [100.0]
    monkeypatch.setattr(journal.time, "monotonic", lambda: now[0])
    return now


def frame(i):
    return {"u": np.arange(6.0).reshape(2, 3) + 10 * i, "n": np.asarray(i)}


def kept(path, identity="scene"):
    """Frames and memory of a journal, and nothing left open."""
    opened = Journal(path, identity)
    opened.close()
    return opened.frames, opened.memory


def written(path, frames, *, start=0, each=True):
    """A journal with a block for each frame, or one block for all."""
    made = Journal(path, "scene")
    for i in range(start, frames):
        made.add(frame(i), lambda i=i: {"m": np.array([i, i + 0.5]), "word": np.array("a<b")})
        if each:
            made.save()
    made.save()
    made.close()


def test_frames_and_the_last_memory_come_back_to_the_bit(tmp_path):
    path = tmp_path / "made" / "part"
    assert kept(path) == ({}, {})
    written(path, 2)
    written(path, 5, start=2, each=False)  # gone on with: one block of three frames
    frames, memory = kept(path)
    assert sorted(frames) == ["n", "u"] and sorted(memory) == ["m", "word"]
    assert np.array_equal(frames["u"], np.array([frame(i)["u"] for i in range(5)])) and frames["n"].tolist() == [0, 1, 2, 3, 4]
    assert memory["m"].tolist() == [4.0, 4.5] and str(memory["word"]) == "a<b"


def test_the_file_is_what_its_description_says(tmp_path):
    """Magic; then blocks: length in 8 bytes, CRC-32 in 4, little end first, and an .npz; the first holds the identity."""
    written(tmp_path / "part", 2)
    data = (tmp_path / "part").read_bytes()
    assert data.startswith(b"fidelity journal 2\n")
    at, names = len(b"fidelity journal 2\n"), []
    while at < len(data):
        size, check = int.from_bytes(data[at:at + 8], "little"), int.from_bytes(data[at + 8:at + 12], "little")
        block = data[at + 12:at + 12 + size]
        assert zlib.crc32(block) == check
        (tmp_path / "block.npz").write_bytes(block)
        with np.load(tmp_path / "block.npz") as archive:
            names.append({name: archive[name].tolist() for name in archive.files})
        at += 12 + size
    assert at == len(data) and names[0] == {"identity": "scene"} and len(names) == 3
    assert names[2] == {"u": [frame(1)["u"].tolist()], "n": [1], "<m": [1.0, 1.5], "<word": "a<b"}


def test_every_flipped_byte_is_noticed(tmp_path):
    """Whichever byte of the last block is another one: its frames are gone, those before are as they were. So in the first block."""
    path, flipped = tmp_path / "part", tmp_path / "flipped"
    sizes = []
    for frames in (0, 1, 2):
        written(path, frames, start=max(0, frames - 1))
        sizes.append(path.stat().st_size)
    data = bytearray(path.read_bytes())
    magic = len(journal.MAGIC)
    rng = np.random.default_rng(0)
    for start, end, left in ((sizes[1], sizes[2], 1), (sizes[0], sizes[1], 0), (magic, sizes[0], 0)):
        # Every byte of the head, where the least is said twice, and every fifth of the rest.
        for at in [*range(start, start + 12), *range(start + 12, end, 5), end - 1]:
            broken = data.copy()
            broken[at] ^= int(rng.integers(1, 256))
            flipped.write_bytes(broken)
            frames, memory = kept(flipped)
            assert len(frames.get("n", [])) == left and bool(memory) == bool(left), at
            assert not left or (np.array_equal(frames["u"], [frame(0)["u"]]) and memory["m"].tolist() == [0, 0.5])
            assert flipped.stat().st_size == sizes[left]  # what is damaged is cut off
    for at in range(magic):
        broken = data.copy()
        broken[at] ^= 1
        flipped.write_bytes(broken)
        with pytest.raises(InputError, match="not an unfinished run; choose another --out, or delete it"):
            Journal(flipped, "scene")
        assert flipped.read_bytes() == broken


def test_a_file_cut_off_anywhere_is_gone_on_with(tmp_path):
    path, cut = tmp_path / "part", tmp_path / "cut"
    sizes = []
    for frames in (0, 1, 2):
        written(path, frames, start=max(0, frames - 1))
        sizes.append(path.stat().st_size)
    data = path.read_bytes()
    for length in [*range(0, 40), *range(40, len(data), 41), *(size + d for size in sizes for d in (-1, 0, 1, 11, 12, 13))]:
        cut.write_bytes(data[:length])
        frames, _ = kept(cut)
        left = sum(length >= size for size in sizes[1:])
        assert len(frames.get("n", [])) == left and cut.read_bytes() == data[:sizes[left]], length
    written(cut, 3, start=2)  # which then takes more
    assert kept(cut)[0]["n"].tolist() == [0, 1, 2]


def test_frames_without_a_memory_after_them_cannot_be_gone_on_from(tmp_path):
    path = tmp_path / "part"
    written(path, 2)
    size = path.stat().st_size
    made = Journal(path, "scene")
    for i in (2, 3):
        made.add(frame(i), dict)
        made.save()
    made.close()
    frames, memory = kept(path)
    assert frames["n"].tolist() == [0, 1] and memory["m"].tolist() == [1, 1.5] and path.stat().st_size == size


def test_another_identity_and_another_opener_are_refused(tmp_path):
    path = tmp_path / "part"
    written(path, 2)
    data = path.read_bytes()
    with pytest.raises(InputError, match="an unfinished run of another scene"):
        Journal(path, "other")
    made = Journal(path, "scene")
    with pytest.raises(WorkError, match="part: another process is at work on this scene"):
        Journal(path, "scene")
    made.close()
    assert path.read_bytes() == data and kept(path)[0]["n"].tolist() == [0, 1]


def test_a_block_is_written_once_a_second(tmp_path, clock):
    path = tmp_path / "part"
    made = Journal(path, "scene")
    sizes, asked = [path.stat().st_size], []
    for i, now in enumerate((100.0, 100.9, 101.0, 101.5, 101.9, 102.0)):
        clock[0] = now
        made.add(frame(i), lambda i=i: asked.append(i) or {"m": np.array(i)})
        sizes.append(path.stat().st_size)
    assert [size > before for before, size in itertools.pairwise(sizes)] == [False, False, True, False, False, True]
    assert made.memory["m"] == 5 and asked == [2, 5]  # what the solver remembers costs nothing in between
    made.save()
    assert path.stat().st_size == sizes[-1]  # nothing new
    clock[0] = 200.0
    made.save()
    clock[0] = 200.5
    made.add(frame(6), lambda: {"m": np.array(6)})
    made.close()
    assert kept(path)[0]["n"].tolist() == [0, 1, 2, 3, 4, 5]  # half a second after the last time


def test_what_is_useless_is_dropped_once_it_is_more_than_frames_and_waste(tmp_path, monkeypatch):
    """Frames of 48 + 8 bytes, memories of 80: with 150 more allowed, 80 n > 56 n + 150 first holds at n = 7, seen before the 8th."""
    monkeypatch.setattr(journal, "WASTE", 150)
    path = tmp_path / "part"

    def add(made, i):
        before = path.stat().st_size
        made.add(frame(i), lambda i=i: {"m": np.full(10, i, float)})
        made.save()
        return path.stat().st_size - before

    made = Journal(path, "scene")
    grown = [add(made, i) for i in range(5)]
    made.close()
    made = Journal(path, "scene")  # counts what an earlier run left
    grown += [add(made, i) for i in range(5, 8)]
    block = grown[0]
    assert grown[:7] == 7 * [block] and grown[7] < block
    # One memory of the old ones is left, so 80 (1 + m) > 56 (7 + m) + 150 once m > 19.25: before the 21st from here.
    grown = [add(made, i) for i in range(8, 29)]
    assert grown[:19] == 19 * [block] and [size < 0 for size in grown].count(True) == 1
    made.close()
    assert list(tmp_path.iterdir()) == [path]
    frames, memory = kept(path)
    assert frames["n"].tolist() == list(range(29)) and np.array_equal(frames["u"], [frame(i)["u"] for i in range(29)])
    assert memory["m"].tolist() == 10 * [28.0]


def test_written_anew_it_is_still_locked_and_a_failure_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "part"
    written(path, 3)
    (tmp_path / "part.new").write_bytes(b"left by a run that was killed")
    made = Journal(path, "scene")
    assert list(tmp_path.iterdir()) == [path]
    monkeypatch.setattr(journal, "WASTE", -1000)
    made.add(frame(3), lambda: {"m": np.array([3, 3.5])})
    data = path.read_bytes()
    with monkeypatch.context() as patch:
        def full(*names):
            raise OSError(28, "No space left on device")

        patch.setattr(journal.os, "replace", full)
        with pytest.raises(OSError, match="No space left"):
            made.save()
    assert list(tmp_path.iterdir()) == [path] and path.read_bytes() == data
    made.save()  # what was waiting still is
    with pytest.raises(WorkError):
        Journal(path, "scene")
    made.close()
    frames, memory = kept(path)
    assert frames["n"].tolist() == [0, 1, 2, 3] and memory["m"].tolist() == [3, 3.5]


def test_a_disk_that_is_full_is_said_with_the_file(tmp_path):
    made = Journal(tmp_path / "part", "scene")
    made.close()
    made._file = open("/dev/full", "wb", buffering=0)
    made.add(frame(0), lambda: {"m": np.array(0)})
    with pytest.raises(OSError, match="No space left") as caught:
        made.save()
    assert caught.value.errno == 28 and caught.value.filename == str(tmp_path / "part")
    made.close()


def test_between_two_blocks_a_kill_costs_a_second_and_memories_may_take_50_megabytes():
    assert (journal.EVERY, journal.WASTE) == (1.0, 50e6)


@dataclass(frozen=True)
class Inner:
    u: np.ndarray
    count: int


@dataclass(frozen=True)
class Outer:
    word: str
    one: Inner
    other: Inner | None
    more: np.ndarray | None
    share: float


@pytest.mark.parametrize("other, more", [(None, None), (Inner(np.zeros((0, 3)), 0), np.arange(3))])
def test_nested_memories_are_arrays_by_name_and_come_back(other, more):
    given = Outer("a.b", Inner(np.array([[0.1, 2.0]]), 7), other, more, 1 / 3)
    arrays = flatten(given)
    assert ("other.u" in arrays) == ("more" in arrays) == (other is not None) and arrays["one.u"] is given.one.u
    found = unflatten(Outer, arrays | {"seconds": np.array(1.0)})
    assert (found.word, found.share, found.one.count, type(found.one.count)) == ("a.b", 1 / 3, 7, int)
    assert np.array_equal(found.one.u, given.one.u) and (found.other is None) == (other is None) and np.array_equal(found.more, more)
    assert other is None or (found.other.u.shape == (0, 3) and found.other.count == 0)
