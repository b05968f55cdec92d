"""A file written whole: the old content stays until the new one is complete."""

import errno
import os
from pathlib import Path

import pytest

from physics.whole import folder_whole, write_whole, written_whole


def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "made" / "file"
    write_whole(path, b"old")
    with pytest.raises(KeyboardInterrupt), written_whole(path) as part:
        part.write_bytes(b"half of the n")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert list(path.parent.iterdir()) == [path]


def test_a_failed_write_names_the_file_that_was_asked_for() -> None:
    with pytest.raises(OSError, match="/proc/self/file"):
        write_whole("/proc/self/file", b"new")


def test_what_was_written_takes_the_place_of_the_old_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "file"
    write_whole(path, b"old")
    with written_whole(path) as part:
        # Beside it, hidden, and of this process alone: so a rename suffices, and two processes do not share it.
        assert part == path.parent / f".file.{os.getpid()}.part"
        part.write_bytes(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert list(path.parent.iterdir()) == [path]


def test_the_content_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    flush, rename = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda handle: (done.append("flushed"), flush(handle)))
    monkeypatch.setattr(os, "replace", lambda one, other: (done.append("renamed"), rename(one, other)))
    write_whole(tmp_path / "file", b"new")
    assert done == ["flushed", "renamed"]


def test_an_error_keeps_its_number_and_says_the_name_that_was_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_whole(path, b"old")
    with pytest.raises(OSError) as caught, written_whole(path) as part:
        part.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device", str(part))
    assert (caught.value.errno, caught.value.strerror, caught.value.filename) == (errno.ENOSPC, "No space left on device", str(path))
    assert list(tmp_path.iterdir()) == [path] and path.read_bytes() == b"old"
    with pytest.raises(FileNotFoundError), written_whole(path):
        pass  # nothing was written
    assert path.read_bytes() == b"old"


def test_a_name_in_a_folder_that_is_there_already(tmp_path: Path) -> None:
    for content in (b"one", b"two"):
        write_whole(str(tmp_path / "file"), content)
    assert (tmp_path / "file").read_bytes() == b"two"


def test_files_of_a_new_folder_move_into_folders_of_any_depth(tmp_path: Path) -> None:
    with folder_whole(tmp_path / "a" / "set") as part:
        (part / "x" / "y").mkdir(parents=True)
        (part / "x" / "y" / "file").write_bytes(b"deep")
    assert (tmp_path / "a" / "set" / "x" / "y" / "file").read_bytes() == b"deep"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "file", "set", "x", "y"]
