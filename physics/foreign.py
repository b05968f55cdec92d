"""A file of points and cells as meshio reads it, or one line that says why it does not."""

from __future__ import annotations

import io
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from physics.schema import InputError

BEHIND_END = 100  # lines
CUT_SHORT = "it is cut short: it ends where more is expected"


def read_foreign(path: Path) -> Any:
    """What meshio makes of a file, a `meshio.Mesh`. Raises `InputError` with meshio's own reason for one that it does not read."""
    import meshio

    _know_ends()
    said = io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            found = meshio.read(path)  # meshio prints, and ends the program
    except (Exception, SystemExit) as error:  # its readers raise whatever a damaged file leads them to
        words = [] if isinstance(error, SystemExit) else str(error).split("\n")
        if isinstance(error, UnicodeDecodeError):
            words = ["it is cut short or damaged, for it is text up to some place only"]
        if isinstance(error, KeyError):
            words = [f"{error} is not known to it"]
        words += [line.removeprefix("Error:") for line in said.getvalue().splitlines()]
        reason = next((word.strip() for word in words if word.strip()), type(error).__name__)
        raise InputError(f"not a mesh file that meshio can read: {reason[:200]}") from None
    if "cannot handle" in said.getvalue():  # and leaves out
        raise InputError("has cells of a kind that meshio cannot handle")
    return found


def _know_ends() -> None:
    """Give meshio files that say so when they are read behind their end: some of its readers ask for the next line for ever."""
    from meshio import _files
    from meshio.tetgen import _tetgen

    _files.open = _tetgen.open = _opened


def _opened(path: Path | str, mode: str = "r", **options: Any) -> Any:
    if mode not in ("r", "rb"):
        return open(path, mode, **options)
    found = _Bytes(io.FileIO(path))
    return found if mode == "rb" else _Text(found, **options)


class _Bytes(io.BufferedReader):
    idle = 0  # lines that were asked for behind the end, one after the other

    def readline(self, size: int | None = -1, /) -> bytes:
        line = super().readline(size)
        self.idle = 0 if line else self.idle + 1
        if self.idle > BEHIND_END:
            raise EOFError(CUT_SHORT)
        return line


class _Text(io.TextIOWrapper):
    idle = 0

    def readline(self, size: int = -1, /) -> str:  # type: ignore[override]
        line = super().readline(size)
        self.idle = 0 if line else self.idle + 1
        if self.idle > BEHIND_END:
            raise EOFError(CUT_SHORT)
        return line
