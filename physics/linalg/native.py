"""C++ compiled for this very processor, once, and the BLAS that it calls: the libraries stand in a folder of the home directory."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_blas, cython_lapack

from physics import fem
from physics.threads import loaded

# Linked by a second command: were -ffast-math among its options, g++ before version 13 would add code that makes every denormal
# number of the whole process zero, also in other libraries (scipy's search trees abort on that).
APART = "linked apart"
ROUNDED = ["-O3", "-march=native", "-ffp-contract=off"]  # each product and each sum is rounded by itself, in the order that is written
LAPACK = ("potrf", "sytrf", "sytrs2")  # the rest is BLAS
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


@functools.cache
def blas(name: str, thread: int = 0) -> int:
    """The address of a routine of SciPy's BLAS or LAPACK, for the first thread or a further one.

    OpenBLAS without threads, as Debian has it, may not be called by several at once: its list of buffers has no lock. There every
    further thread has a copy of the library, and so of the list. Others can be called by all.
    """
    if thread and (library := _copied(thread)):
        return ctypes.cast(library[name + "_"], ctypes.c_void_p).value or 0
    capsule = (cython_lapack if name[1:] in LAPACK else cython_blas).__pyx_capi__[name]
    python = ctypes.pythonapi
    python.PyCapsule_GetName.restype, python.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    python.PyCapsule_GetPointer.restype, python.PyCapsule_GetPointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return int(python.PyCapsule_GetPointer(capsule, python.PyCapsule_GetName(capsule)))


@functools.cache
def _copied(thread: int) -> ctypes.CDLL | None:
    """A further thread's copy of OpenBLAS, None where it needs none."""
    for library in loaded("openblas"):
        if hasattr(library, "dpotrf_") and hasattr(library, "openblas_get_parallel") and not library.openblas_get_parallel():
            folder = fem.cache_folder()
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=folder) as scratch:  # the same file would be the same library
                copy = shutil.copyfile(library._name, Path(scratch) / "blas.so")
                return ctypes.CDLL(str(copy), mode=os.RTLD_LOCAL | os.RTLD_DEEPBIND)
    return None


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
