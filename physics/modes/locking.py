"""How much too stiff are cells of first order in a mode? By the strain that jumps from cell to cell.

In a cell of first order that bends, strain cannot follow: shear grows along the cell and falls back at the next one (shear locking).
So the strain of a mode is averaged at the nodes, and the energy of what this takes away is compared with all of it (Zienkiewicz and
Zhu 1987). A body that is stiffer by the factor 1 / (1 - share) swings faster by its root. Legend: C cells, N nodes, P points, n corners.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.body.material import lame
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.mesh.sound.cells import PLACE
from physics.scene import Material

Floats = NDArray[np.float64]
TOLD = 0.05  # of a frequency
CHUNK = 20_000  # cells at once


def said(mesh: Mesh, shapes: Floats, rigid: int, material: Material) -> tuple[str, ...]:
    """A remark when the first of some modes (m, N, 3) that strains a solid body of first-order cells is much too stiff."""
    if mesh.dimension == 2 or rigid >= len(shapes):
        return ()
    excess = too_high(mesh, shapes[rigid], material)
    if excess < TOLD:
        return ()
    other = "hexahedra of order 2" if mesh.cell == "prism" else "body.order = 2"
    return (f"cells of first order bend too stiffly here: mode {rigid + 1} is too high by about {100 * excess:.0f} % or more; "
            f"take shorter cells or {other}",)


def too_high(mesh: Mesh, shape: Floats, material: Material) -> float:
    """By what share of itself a mode's frequency is too high, about; shape (N, 3) of a solid body of first order."""
    cell, place = CELLS[mesh.cell], PLACE[mesh.cell]
    at = place + 1e-3 * (place.mean(axis=0) - place)  # at the corners, but for those that are flat
    parts = np.array_split(mesh.cells, len(mesh.cells) // CHUNK + 1)
    mean, total = np.zeros((len(mesh.points), 3, 3)), np.zeros(len(mesh.points))
    for cells in parts:
        strain, size = _strains(cell.shapes(at)[1], mesh.points[cells], shape[cells])  # (C, n, 3, 3) at the corners
        volume = size.mean(axis=1)[:, None]
        np.add.at(mean, cells, strain * volume[..., None, None])
        np.add.at(total, cells, volume)
    mean /= total[:, None, None]
    whole = jumps = 0.0
    for cells in parts:
        strain, size = _strains(cell.shapes(cell.points)[1], mesh.points[cells], shape[cells])
        smooth = np.einsum("pn,cnij->cpij", cell.shapes(cell.points)[0], mean[cells])
        whole += float((_density(strain, material) * size * cell.weights).sum())
        jumps += float((_density(strain - smooth, material) * size * cell.weights).sum())
    share = min(jumps / whole, 0.999) if whole > 0 else 0.0
    return float((1 - share) ** -0.5 - 1)


def _strains(slopes: Floats, x: Floats, u: Floats) -> tuple[Floats, Floats]:
    """(C, P, 3, 3) small strains and (C, P) Jacobian determinants from gradients (P, n, 3) of the shape functions."""
    jacobian = np.einsum("pne,cnd->cped", slopes, x)
    gradient = np.linalg.solve(jacobian, np.einsum("pne,cnd->cped", slopes, u))
    return (gradient + gradient.swapaxes(2, 3)) / 2, np.linalg.det(jacobian)


def _density(strain: Floats, material: Material) -> Floats:
    """(C, P) strain energy a volume by Hooke's law."""
    first, second = lame(material)
    return first / 2 * np.trace(strain, axis1=2, axis2=3) ** 2 + second * (strain**2).sum(axis=(2, 3))
