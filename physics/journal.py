"""The unfinished path of a scene on disk: the steps so far, and all that the solver needs to go on from the last of them.

A journal is a file that grows, block after block: length (8 bytes) and CRC-32 (4 bytes) of what follows, then named
arrays as .npz. The first block says whose path it is; every later one holds the frames since the block before and the
solver's memory after the last of them, in double precision. A process that is killed leaves at most half a block at the
end, which is cut off when the file is opened again. What an older block remembers is of no more use: when that has become more
than the frames and `WASTE` together, the file is written anew without it. While one process has it open no other can.
"""

from __future__ import annotations

import fcntl
import hashlib
import io
import os
import time
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from physics.schema import InputError, WorkError

EVERY = 1.0  # [s] between two blocks: what a kill may cost
WASTE = 50_000_000  # bytes
MAGIC = b"fidelity journal 2\n"  # another number: what the solver remembers has other names

Arrays = dict[str, NDArray[Any]]


def digest_of(text: str, *arrays: NDArray[Any]) -> str:
    """SHA-256 of a scene's text and of what belongs to it: whose path a journal is."""
    digest = hashlib.sha256(text.encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def flatten(memory: Any, before: str = "") -> Arrays:
    """The leaves of nested dataclasses as arrays by name, "newton.zone.u"; what is None has none."""
    found: Arrays = {}
    for each in fields(memory):
        value, name = getattr(memory, each.name), before + each.name
        if is_dataclass(value):
            found |= flatten(value, name + ".")
        elif value is not None:
            found[name] = np.asarray(value)
    return found


def unflatten(kind: type[Any], arrays: Arrays, before: str = "") -> Any:
    """The nested dataclasses of a kind that `flatten` made these arrays of, "X | None" for what may be None; other names are left alone."""
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        place, inner = before + name, get_args(hint)[0] if NoneType in get_args(hint) else hint
        if any(other.startswith(place + ".") for other in arrays):
            values[name] = unflatten(inner, arrays, place + ".")
        elif place in arrays:
            values[name] = inner(arrays[place].item()) if inner in (int, float, str) else arrays[place]
    return kind(**dict.fromkeys(get_type_hints(kind)) | values)


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

    @property
    def rows(self) -> list[Arrays]:
        """The frames that were kept, one after the other."""
        return [dict(zip(self.frames, rows, strict=True)) for rows in zip(*self.frames.values(), strict=True)]

    def _open(self, identity: str) -> None:
        start = self._file.read(len(MAGIC))
        if not MAGIC.startswith(start):
            raise InputError(f"{self.path}: not an unfinished run; choose another --out, or delete it")
        blocks, ends = [], [0]
        while start == MAGIC and (block := _next(self._file)) is not None:
            blocks.append(block)
            ends.append(self._file.tell())
        if blocks and str(blocks[0]["identity"]) != identity:
            raise InputError(f"{self.path}: an unfinished run of another scene; choose another --out, or delete it to start anew")
        while len(blocks) > 1 and not _memory(blocks[-1]):  # frames that cannot be gone on from
            blocks.pop()
        self._file.seek(ends[len(blocks)])
        self._file.truncate()
        if len(blocks) > 1:
            self.memory = _memory(blocks[-1])
            self.frames = {name: np.concatenate([block[name] for block in blocks[1:]]) for name in _frames(blocks[-1])}
        elif not blocks:
            self._begin(identity)
        self._anew.unlink(missing_ok=True)  # half written when a run was killed
        self._identity, self._useful = identity, _size(self.frames)
        self._useless = sum(_size(_memory(block)) for block in blocks[1:])

    @property
    def _anew(self) -> Path:
        return self.path.with_name(self.path.name + ".new")

    def _begin(self, identity: str) -> None:
        self._write(MAGIC)
        self._append({"identity": np.array(identity)})

    def add(self, frame: Arrays, memory: Callable[[], Arrays]) -> None:
        """Keep one more frame; written when `EVERY` seconds have passed since the last time.

        memory: gives what the solver remembers after it, and is asked when that is written
        """
        self._waiting.append(frame)
        self._remembered = memory
        if time.monotonic() - self._saved >= EVERY:
            self.save()

    def save(self) -> None:
        """Write what has not been written yet."""
        if self._waiting:
            self.memory = self._remembered()
            if self._useless > self._useful + WASTE:
                self._forget()
            frames = {name: np.stack([np.asarray(waiting[name]) for waiting in self._waiting]) for name in self._waiting[0]}
            self._append(frames | {"<" + name: array for name, array in self.memory.items()})
            self._useful += _size(frames)
            self._useless += _size(self.memory)
        self._waiting = []
        self._saved = time.monotonic()

    def _forget(self) -> None:
        """Write the file anew, all frames and only the last memory, and put it in the place of the old one."""
        old, path = self._file, self._anew
        try:
            self._file = io.FileIO(path, "w+")
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._begin(self._identity)
            old.seek(len(MAGIC))
            _next(old)
            block = _next(old)
            while block is not None:
                following = _next(old)
                self._append(block if following is None else _frames(block))
                last, block = block, following
            os.replace(path, self.path)
        except OSError:
            path.unlink(missing_ok=True)
            self._file.close()
            self._file = old
            raise
        old.close()
        self._useless = _size(_memory(last))

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


@dataclass(frozen=True)
class Followed:
    """A path as far as it was followed.

    frames: name -> (T, ...) of all of them
    seconds: of this run and of those that it goes on from
    resumed: frames after the first that an earlier run had reached
    failed: the frame that was not reached and why, or None
    """

    frames: Arrays
    seconds: float
    resumed: int
    failed: tuple[int, Exception] | None


def follow(count: int, go: Callable[[int], dict[str, Any]], memory: Callable[[], Any], recall: Callable[[Arrays], None], *,
           failures: tuple[type[Exception], ...], path: str | Path | None, identity: str, started: float,
           on_step: Callable[[int], None] | None) -> Followed:
    """Go through frames 0 to count, kept in a journal where one is wanted, from the last one on that it holds.

    Args:
        go: goes on to a frame and gives what is to be kept of it; of frame 0 nothing is to be done
        memory, recall: what the next frame depends on, as a dataclass; and the way back to it from its arrays (`flatten`)
        failures: which end the path before its end
        path, identity: of the journal, see `Journal`; no path: none is kept
        started: when this run began, by time.perf_counter
        on_step: called with the number of each frame that is reached

    Raises: see `Journal`
    """
    kept, frames, spent, failed = None if path is None else Journal(path, identity), [], 0.0, None
    try:
        if kept is not None and kept.frames:
            frames, spent = kept.rows, float(kept.memory["seconds"])
            recall(kept.memory)
        resumed = max(0, len(frames) - 1)
        for number in range(len(frames), count + 1):
            try:
                frames.append(go(number))
            except failures as error:
                failed = number, error
                break
            if kept is not None:
                kept.add(frames[-1], partial(_after, memory(), spent + time.perf_counter() - started))
            if on_step is not None and number:
                on_step(number)
        if kept is not None:
            kept.save()
    finally:
        if kept is not None:
            kept.close()
    rows = {name: np.array([frame[name] for frame in frames]) for name in frames[0]}
    return Followed(rows, spent + time.perf_counter() - started, resumed, failed)


def _after(memory: Any, seconds: float) -> Arrays:
    return flatten(memory) | {"seconds": np.array(seconds)}


def _next(file: io.FileIO) -> Arrays | None:
    """The block that follows; None where no whole one does."""
    head = file.read(12)
    size = int.from_bytes(head[:8], "little")
    if len(head) < 12 or size > os.fstat(file.fileno()).st_size - file.tell():
        return None
    data = file.read(size)
    if zlib.crc32(data) != int.from_bytes(head[8:], "little"):
        return None
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (ValueError, zipfile.BadZipFile):
        return None


def _memory(block: Arrays) -> Arrays:
    return {name[1:]: array for name, array in block.items() if name.startswith("<")}


def _frames(block: Arrays) -> Arrays:
    return {name: array for name, array in block.items() if not name.startswith("<")}


def _size(arrays: Arrays) -> int:
    return sum(array.nbytes for array in arrays.values())
