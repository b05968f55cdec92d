"""A file of points and cells as meshio reads it, or one line that says why it does not."""

from __future__ import annotations

import io
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from physics.schema import InputError


def read_foreign(path: Path) -> Any:
    """What meshio makes of a file, a `meshio.Mesh`. Raises `InputError` with meshio's own reason for one that it does not read."""
    import meshio

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
