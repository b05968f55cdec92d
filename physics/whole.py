"""A file, or a folder of them, is written whole or not at all: under another name first, flushed to the disk, then renamed."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """A name beside `path` to write to; what was written there takes the place of `path` when the block ends well.

    The folder is made. When the block raises, or the process is killed, `path` is what it was before.

    Raises:
        OSError: naming `path`, when the disk is full or forbids writing
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with open(part, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(part, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: str | Path, content: bytes) -> None:
    """Put content under a name, all of it or none. Raises OSError as `written_whole` does."""
    with written_whole(path) as part:
        part.write_bytes(content)


@contextmanager
def folder_whole(path: str | Path) -> Iterator[Path]:
    """A new folder beside `path` to write into; what is in it moves into `path` when the block ends well, and is gone when it does not.

    Raises:
        OSError: the folders cannot be written
    """
    path = Path(path)
    missing = [place for place in path.absolute().parents if not place.exists()]  # the deepest first
    path.absolute().parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{path.name[:100]}.", suffix=".part", dir=path.absolute().parent))
    try:
        yield part
        for file in sorted(file for file in part.rglob("*") if file.is_file()):
            there = path / file.relative_to(part)
            there.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, there)
        missing = []
    finally:
        shutil.rmtree(part)
        for place in missing:
            place.rmdir()
