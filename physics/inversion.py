"""Whether a path turns cells inside out: the smallest det F of each of its frames, in one compiled pass.

The figure is that of `mesh.quality.det_f`, which works on a few frames without a compiler; all frames of a path take a third of its
time here. Legend: N nodes, C cells, T frames, Q sample points of a cell.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.linalg.native import compiled, pointer
from physics.mesh.mesh import Mesh
from physics.mesh.quality import rest_jacobians, slopes

Floats = NDArray[np.float64]

PACK = 4  # cells at a time


def smallest_det_f(mesh: Mesh, displacement: Floats) -> Floats:
    """(T,) smallest det F of a mesh that is sound at rest, at displacements (T, N, 3) [m] without a nan."""
    rest, u = rest_jacobians(mesh.points, mesh.cells, mesh.cell), np.ascontiguousarray(displacement, float)
    more = -len(mesh.cells) % PACK
    packs = np.pad(rest, ((0, 0), (0, more)), constant_values=np.nan).reshape(len(rest), -1, PACK).transpose(1, 0, 2).copy()
    cells = np.pad(mesh.cells, ((0, more), (0, 0))).astype(np.int32)
    points, slope, found = np.ascontiguousarray(mesh.points), np.ascontiguousarray(slopes(mesh.cell)), np.empty(len(u))
    sizes = map(ctypes.c_int64, (len(u), len(points), len(packs), len(slope)))
    arrays = (pointer(array) for array in (cells, points, u, slope, packs, found))
    _library(cells.shape[1], mesh.dimension == 2).smallest(*sizes, *arrays)
    return found


@cache
def _library(nodes: int, plane: bool) -> ctypes.CDLL:
    source = (Path(__file__).parent / "inversion.cpp").read_text()
    return compiled(f"#define NODES {nodes}\n#define PLANE {int(plane)}\n{source}", rounded=True)
