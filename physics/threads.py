"""One thread for the linear algebra, as `./run` has it: set when `physics` is imported, unless the user has said otherwise.

Most matrices of a body are too small to share: on several threads the processors wait for each other, and work is better spread over
scenes. OMP_NUM_THREADS or OPENBLAS_NUM_THREADS, set to anything before Python starts, is left as it is; as many threads as
OMP_NUM_THREADS says share the own loops of a body that is large enough (`count`). Otherwise both are set to 1,
for libraries that are still to come (torch among them, which takes `torch.set_num_threads` all the same) and for processes that are
started; an OpenBLAS that numpy or scipy has loaded before is told so.
"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
SETTERS = ("openblas_set_num_threads", "openblas_set_num_threads64_", "scipy_openblas_set_num_threads", "scipy_openblas_set_num_threads64_")


def one_thread() -> None:
    """One thread from now on, unless the environment names a number."""
    if any(os.environ.get(name) for name in VARIABLES):
        return
    os.environ.update(dict.fromkeys(VARIABLES, "1"))
    for library in loaded("openblas"):
        for name in SETTERS:
            setter = getattr(library, name, None)
            if setter is not None:
                setter(1)


def count() -> int:
    """How many threads OMP_NUM_THREADS allows now: its first number, at least 1."""
    first = os.environ.get(VARIABLES[0], "").split(",")[0].strip()
    return max(1, int(first)) if first.isdecimal() else 1


def loaded(word: str) -> list[ctypes.CDLL]:
    """The shared libraries in this process with a word in their file's name; none where the system does not tell (Linux does)."""
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return []
    lines = (line.split(maxsplit=5) for line in maps.read_text().splitlines())
    paths = {parts[5] for parts in lines if len(parts) == 6 and word in Path(parts[5]).name and ".so" in Path(parts[5]).name}
    return [ctypes.CDLL(path) for path in sorted(paths)]
