"""The unfinished path of a scene on disk: the steps so far, and all that the solver needs to go on from the last of them.

A journal is a file that only grows, block after block: length (8 bytes) and CRC-32 (4 bytes) of what follows, then named
arrays as .npz. The first block says whose path it is; every later one holds the frames since the block before and the
solver's memory after the last of them, in double precision. A process that is killed leaves at most half a block at the
end, which is cut off when the file is opened again. While one process has it open no other can.
"""

from __future__ import annotations

import fcntl
import io
import os
import time
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.schema import InputError, WorkError

EVERY = 1.0  # [s] between two blocks: what a kill may cost
MAGIC = b"fidelity journal 1\n"

Arrays = dict[str, NDArray[Any]]


class Journal:
    """One journal, opened for going on.

    frames: name -> (T, ...) of all frames that were kept; empty at the start of a path
    memory: the solver's, after the last of them
    """

    def __init__(self, path: str | Path, identity: str) -> None:
        """Open the journal at a path, or begin one there.

        Args:
            identity: of the scene and its mesh, one line

        Raises:
            InputError: the file is no journal, or that of another scene
            WorkError: another process has it open
            OSError: it cannot be written
        """
        self.path, self.frames, self.memory = Path(path), {}, {}  # type: Path, Arrays, Arrays
        self._waiting: list[Arrays] = []
        self._saved = time.monotonic()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = io.FileIO(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "r+")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._open(identity)
        except BlockingIOError:
            self._file.close()
            raise WorkError(f"{path}: another process is at work on this scene") from None
        except BaseException:
            self._file.close()
            raise

    def _open(self, identity: str) -> None:
        start = self._file.read(len(MAGIC))
        if not MAGIC.startswith(start):
            raise InputError(f"{self.path}: not an unfinished run; choose another --out, or delete it")
        whole = len(start)
        blocks = []
        if start == MAGIC:
            while (block := self._next()) is not None:
                blocks.append(block)
                whole = self._file.tell()
        if blocks and str(blocks[0]["identity"]) != identity:
            raise InputError(f"{self.path}: an unfinished run of another scene; choose another --out, or delete it to start anew")
        if len(blocks) > 1:
            self.memory = {name[1:]: array for name, array in blocks[-1].items() if name.startswith("<")}
            names = [name for name in blocks[-1] if not name.startswith("<")]
            self.frames = {name: np.concatenate([block[name] for block in blocks[1:]]) for name in names}
        if blocks:
            self._file.seek(whole)
            self._file.truncate()
        else:
            self._file.seek(0)
            self._file.truncate()
            self._write(MAGIC)
            self._append({"identity": np.array(identity)})

    def add(self, frame: Arrays, memory: Arrays) -> None:
        """Keep one more frame, and the solver's memory after it; written when `EVERY` seconds have passed since the last time."""
        self._waiting.append(frame)
        self.memory = memory
        if time.monotonic() - self._saved >= EVERY:
            self.save()

    def save(self) -> None:
        """Write what has not been written yet."""
        if self._waiting:
            frames = {name: np.stack([np.asarray(waiting[name]) for waiting in self._waiting]) for name in self._waiting[0]}
            self._append(frames | {"<" + name: array for name, array in self.memory.items()})
        self._waiting = []
        self._saved = time.monotonic()

    def close(self) -> None:
        """Let others have the file."""
        self._file.close()

    def _append(self, arrays: Arrays) -> None:
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        data = buffer.getvalue()
        self._write(len(data).to_bytes(8, "little") + zlib.crc32(data).to_bytes(4, "little") + data)

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left):]
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from None

    def _next(self) -> Arrays | None:
        """The block that follows; None where no whole one does."""
        head = self._file.read(12)
        size = int.from_bytes(head[:8], "little")
        if len(head) < 12 or size > os.fstat(self._file.fileno()).st_size - self._file.tell():
            return None
        data = self._file.read(size)
        if zlib.crc32(data) != int.from_bytes(head[8:], "little"):
            return None
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        except (ValueError, zipfile.BadZipFile):
            return None
