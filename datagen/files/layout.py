"""Whether what was read from a trajectory file has the shapes and kinds that its layout says, so that nothing behind has to ask."""

from __future__ import annotations

from typing import Any

import numpy as np

from physics.mesh.cell import OF_VTK

EXTRA = {"linear_steps": int, "factorisations": int, "tolerance": float, "seconds": float, "step_seconds": float, "seconds_per_step": float,
         "failure": str, "imported": str, "model": dict, "mesh_file": dict, "failed_attempts": list, "laplacian_eigenvalues": list}


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
