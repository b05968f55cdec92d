"""Whether what was read from a trajectory file, or is to be written, has the shapes and kinds of its layout, so that nobody else asks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics.mesh.cell import OF_VTK
from physics.schema import InputError

EXTRA = {"linear_steps": int, "factorisations": int, "tolerance": float, "seconds": float, "step_seconds": float, "seconds_per_step": float,
         "failure": str, "imported": str, "model": dict, "mesh_file": dict, "accuracy": dict,
         "failed_attempts": list, "laplacian_eigenvalues": list}


def misshapen(made: Any) -> str:
    """What is wrong with the arrays of a `Trajectory`, by their shapes and kinds, and with its attributes; empty when nothing is."""
    displacement = np.asarray(made.displacement)
    if displacement.ndim != 3 or not len(displacement):
        return "displacement is not an array of frames"
    frames, nodes = displacement.shape[:2]
    wanted = {"points": ("f", (nodes, 3)), "displacement": ("f", (frames, nodes, 3)), "node_kind": ("iu", (nodes,)),
              "connectivity": ("iu", (None,)), "offsets": ("iu", (None,)), "types": ("iu", (None,)), "modes": ("f", (None, nodes, 3))}
    if made.segment is not None:
        wanted["segment"] = ("iu", (nodes,))
    arrays = {name: (getattr(made, name), *how) for name, how in wanted.items()}
    arrays |= {name: (array, "fiu", (frames, None)[:max(1, array.ndim)]) for name, array in made.per_frame.items()}
    arrays |= {name: (array, "f", (frames, nodes, None)) for name, array in made.fields.items()}
    for name, (array, kinds, shape) in arrays.items():
        fits = array.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
        if array.dtype.kind not in kinds or not fits:
            said = " x ".join("any" if n is None else str(n) for n in shape)
            return f"{name} is {' x '.join(map(str, array.shape)) or 'one'} of {array.dtype.name}, not {said} numbers"
    if not len(made.types) or not len(made.connectivity) or not set(made.types.tolist()) <= OF_VTK.keys():
        return f"it has no cells, or cells of a kind that is not among {', '.join(cell.plural for cell in OF_VTK.values())}"
    if not made.body.any():
        return "every node is of the obstacle, none of a body"
    if len(made.frequencies_hz) not in (0, len(made.modes)):
        return f"{len(made.frequencies_hz)} frequencies for {len(made.modes)} modes"
    for name, kind in EXTRA.items():
        value = made.extra.get(name, kind())
        if not isinstance(value, (int, float) if kind is float else kind) or value != value:
            return f"extra has {name} = {str(value)[:40]!r}"
    return ""


def displacements(given: ArrayLike, frames: int | None, nodes: int, of: str) -> NDArray[Any]:
    """Displacements as an array (T, n, 3). Raises `InputError` in one line that says which shape is right, and of which nodes."""
    try:
        u = np.asarray(given)
        u = u if u.dtype.kind in "fiu" else u.astype(np.float64)
    except (ValueError, TypeError, RuntimeError) as error:  # torch raises the last
        raise InputError(f"displacement is no array of numbers: {str(error).splitlines()[0]}") from None
    if u.ndim != 3 or not len(u) or u.shape[1:] != (nodes, 3) or frames not in (None, len(u)):
        right = f"({frames or 'T'}, {nodes}, 3), frames from the rest state on, {of}, x y z"
        raise InputError(f"displacement has shape {u.shape}: must be {right}")
    return u
