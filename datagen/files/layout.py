"""Whether what was read from a trajectory file, or is to be written, has the shapes and kinds of its layout, so that nobody else asks.

Displacements u are stored as the nearest numbers of single precision and, where a `remainder` is kept, what that rounding took,

    u = displacement + remainder + what 12 bits leave of it: 2^-24 |u| 2^-12 at most, 3e-13 m of 2 cm.

The balance of forces needs it where cells are stiff and the body is soft: K times the rounding of u is then a ten-thousandth of the
reaction. The last 12 bits of each number are zero, so that they are packed to almost nothing. Legend: T frames, N nodes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics.mesh.cell import OF_VTK
from physics.schema import InputError

HALF_ULP = 2.0**-24  # of single precision, relative
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
    if made.remainder is not None:
        wanted["remainder"] = "f", (frames, nodes, 3)
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


def of_nodes(trajectory: Any) -> NDArray[np.float32]:
    """The displacements of a `Trajectory` as a file holds them. Raises `InputError` in one line that says which shape is right."""
    nodes, body = len(trajectory.points), int(trajectory.body.sum())
    parts = f", those of the body ({body}) first, then those of the obstacle ({nodes - body})" if body < nodes else ""
    u = displacements(trajectory.displacement, None, nodes, f"nodes{parts}")
    if holds_positions(u, trajectory.points):
        raise InputError("displacement holds positions, it seems: take the rest positions away (displacement - points)")
    return u.astype(np.float32, copy=False)


def holds_positions(u: NDArray[Any], points: NDArray[Any]) -> bool:
    """Whether displacements (T, N, 3) begin at the rest positions (N, 3) in place of zero."""
    return bool(np.linalg.norm(u[0] - points) < 0.1 * np.linalg.norm(points))


def remainder_of(u: NDArray[np.float64]) -> NDArray[np.float32]:
    """(T, N, 3) what single precision takes from displacements (T, N, 3), its last 12 bits rounded away."""
    bits = (u - u.astype(np.float32)).astype(np.float32).view(np.uint32)
    return ((bits + np.uint32(1 << 11)) & ~np.uint32((1 << 12) - 1)).view(np.float32)


def exact(displacement: NDArray[Any], remainder: NDArray[Any] | None) -> NDArray[np.float64]:
    """(T, N, 3) displacements with what rounding took from them, as far as that is known."""
    u = displacement.astype(np.float64)
    return u if remainder is None else u + remainder


def precision(displacement: NDArray[Any], remainder: NDArray[Any] | None) -> NDArray[np.float64]:
    """(T, N, 3) [m] how far `exact` may be from the displacements that were rounded."""
    return HALF_ULP * abs(displacement.astype(np.float64)) if remainder is None else 2.0**-12 * abs(remainder.astype(np.float64))


def is_remainder(remainder: NDArray[Any], displacement: NDArray[Any]) -> bool:
    """Whether a remainder (T, N, 3) may be what rounding took from displacements: half a unit in their last place at most."""
    with np.errstate(invalid="ignore"):
        return bool((abs(remainder) <= 0.5 * np.spacing(abs(displacement))).all())
