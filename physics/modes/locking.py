"""How much too stiff are cells of first order in a mode? By the strain that jumps from cell to cell.

In a cell of first order that bends, strain cannot follow: shear grows along the cell and falls back at the next one (shear locking).
So the strain of a mode is averaged at the nodes, and the energy of what this takes away is compared with all of it (Zienkiewicz and
Zhu 1987). A body that is stiffer by the factor 1 / (1 - share) swings faster by its root. Legend: C cells, N nodes, P points, n corners.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from physics.body.material import by_region, lame
from physics.mesh.cell import CELLS, GAUSS, TRIANGLE
from physics.mesh.mesh import Mesh
from physics.mesh.sound.cells import PLACE
from physics.scene import Material, Materials

Floats = NDArray[np.float64]
TOLD = 0.05  # of a frequency
CHUNK = 20_000  # cells at once


def said(mesh: Mesh, shapes: Floats, rigid: int, material: Materials) -> tuple[str, ...]:
    """A remark when the first of some modes (m, N, 3) that strains a body of first-order cells is much too stiff."""
    if rigid >= len(shapes):
        return ()
    excess = too_high(mesh, shapes[rigid], material)
    if excess < TOLD:
        return ()
    other = "hexahedra of order 2" if mesh.cell == "prism" else "body.order = 2"
    return (f"cells of first order bend too stiffly here: mode {rigid + 1} is too high by about {100 * excess:.0f} % or more; "
            f"take shorter cells or {other}",)


def too_high(mesh: Mesh, shape: Floats, material: Materials) -> float:
    """By what share of itself a mode's frequency is too high, about; shape (N, 3) of a body of first order.

    A plane body counts as one without strain across it.
    """
    place, points, weights = _rule(mesh.cell)
    at = place + 1e-3 * (place.mean(axis=0) - place)  # at the corners, but for those that are flat
    d = mesh.dimension
    x, u = mesh.points[:, :d], shape[:, :d]
    (_, near), (values, slopes) = _shapes(mesh.cell, at), _shapes(mesh.cell, points)
    whole = jumps = 0.0
    for own, chosen in by_region(material, mesh):  # between materials strain may jump
        all_cells = mesh.cells[chosen]
        parts = np.array_split(all_cells, len(all_cells) // CHUNK + 1)
        mean, total = np.zeros((len(mesh.points), d, d)), np.zeros(len(mesh.points))
        for cells in parts:
            strain, size = _strains(near, x[cells], u[cells])  # (C, n, d, d) at the corners
            volume = size.mean(axis=1)[:, None]
            np.add.at(mean, cells, strain * volume[..., None, None])
            np.add.at(total, cells, volume)
        mean /= np.where(total > 0, total, 1.0)[:, None, None]
        for cells in parts:
            strain, size = _strains(slopes, x[cells], u[cells])
            smooth = np.einsum("pn,cnij->cpij", values, mean[cells])
            whole += float((_density(strain, own) * size * weights).sum())
            jumps += float((_density(strain - smooth, own) * size * weights).sum())
    share = min(jumps / whole, 0.999) if whole > 0 else 0.0
    return float((1 - share) ** -0.5 - 1)


def _rule(kind: str) -> tuple[Floats, Floats, Floats]:
    """Corners (n, d), sample points (P, d) and their weights (P,) of a cell."""
    if CELLS[kind].dimension == 3:
        return PLACE[kind], CELLS[kind].points, CELLS[kind].weights
    if kind == "triangle":
        return np.array([(0, 0), (1, 0), (0, 1)], float), np.array(TRIANGLE), np.full(3, 1 / 6)
    return np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float), np.array(list(product(GAUSS, repeat=2))), np.full(4, 1 / 4)


def _shapes(kind: str, at: Floats) -> tuple[Floats, Floats]:
    """(P, n) first-order shape functions and (P, n, d) their gradients."""
    d = CELLS[kind].dimension
    values, slopes = CELLS[kind].shapes(np.pad(at, ((0, 0), (0, 3 - d))))
    return values, slopes[:, :, :d]


def _strains(slopes: Floats, x: Floats, u: Floats) -> tuple[Floats, Floats]:
    """(C, P, d, d) small strains and (C, P) Jacobian determinants from gradients (P, n, d) of the shape functions."""
    jacobian = np.einsum("pne,cnd->cped", slopes, x)
    gradient = np.linalg.solve(jacobian, np.einsum("pne,cnd->cped", slopes, u))
    return (gradient + gradient.swapaxes(2, 3)) / 2, np.linalg.det(jacobian)


def _density(strain: Floats, material: Material) -> Floats:
    """(C, P) strain energy a volume by Hooke's law."""
    first, second = lame(material)
    return first / 2 * np.trace(strain, axis1=2, axis2=3) ** 2 + second * (strain**2).sum(axis=(2, 3))
