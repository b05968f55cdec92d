"""A file written whole: the old content stays until the new one is complete."""

from pathlib import Path

import pytest

from physics.whole import write_whole, written_whole


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
