"""C++ compiled for this very processor, once: the libraries stand in a folder of the home directory."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics import fem

# Linked by a second command: were -ffast-math among its options, g++ before version 13 would add code that makes every denormal
# number of the whole process zero, also in other libraries (scipy's search trees abort on that).
APART = "linked apart"
ROUNDED = ["-O3", "-march=native", "-ffp-contract=off"]  # each product and each sum is rounded by itself, in the order that is written
LINK = ["-lmvec"] if platform.machine() == "x86_64" else []  # glibc's functions of several numbers at once


def compiled(source: Callable[[], str] | str, *key: str, rounded: bool = False) -> ctypes.CDLL:
    """The library of a C++ source. A source that is costly to write is a function, and its key says all that it depends on.

    Args: rounded: to the same bits as numpy's arithmetic; else as fast as can be

    Raises:
        RuntimeError: the compiler's first line, when it does not compile
    """
    folder = fem.cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    options = ROUNDED if rounded else fem.COMPILE
    name = hashlib.sha256("\n".join([*options, APART, *LINK, *(key or (str(source),))]).encode()).hexdigest()[:32]
    library = folder / f"kernel_{name}.so"
    if not library.exists():
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            (Path(scratch) / "kernel.cpp").write_text(source if isinstance(source, str) else source())
            for command in (["g++", *options, "-c", "-fPIC", "-Wno-psabi", "-o", "kernel.o", "kernel.cpp"],
                            ["g++", "-shared", "-o", "kernel.so", "kernel.o", *LINK]):
                made = subprocess.run(command, cwd=scratch, capture_output=True, text=True)
                if made.returncode:
                    raise RuntimeError(f"g++ could not compile a kernel: {made.stderr.strip().splitlines()[0]}")
            os.replace(Path(scratch) / "kernel.so", library)  # whole or not at all, whoever else is compiling the same
    return ctypes.CDLL(str(library))


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """The address of an array's numbers, which must lie one after another; it does not keep the array alive."""
    try:
        return ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(array)))  # type: ignore[arg-type]
    except (TypeError, ValueError):  # of an array that is empty or not to be written to, in five times the time
        assert array.flags.c_contiguous
        return ctypes.c_void_p(array.ctypes.data)


def aligned(size: int) -> NDArray[np.float64]:
    """Numbers whose first one lies on a multiple of 64 bytes: what is summed in vectors then gives the same bits every time."""
    room = np.empty(size + 8)
    start = -room.ctypes.data // 8 % 8
    return room[start:start + size]
