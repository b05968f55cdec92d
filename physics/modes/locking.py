"""How much too stiff are cells of first order in a mode, or under a load? By the strain that jumps from cell to cell.

In a cell of first order that bends, strain cannot follow: shear grows along the cell and falls back at the next one (shear locking).
So the strain of a motion is averaged at the nodes, and the energy of what this takes away is compared with all of it (Zienkiewicz and
Zhu 1987). A body is stiffer by the factor 1 / (1 - share), and swings faster by its root. Strain is Green's, which turns with the body.
Legend: C cells, N nodes, P points, n corners.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.body.material import by_region, lame
from physics.mesh.cell import CELLS, CORNERS, TRIANGLE
from physics.mesh.mesh import Mesh
from physics.scene import Material, Materials, Scene

Floats = NDArray[np.float64]
INCOMPRESSIBLE = 0.49  # Poisson's ratio from which cells of standard sampling are told of
CLOSEST = 0.49999  # Poisson's ratio past which rounding may keep an equilibrium from being found
TOLD = 0.05  # of a frequency, which is 10 % of the stiffness
CHUNK = 20_000  # cells at once
RIGID = 1e-7  # strain over displacement by extent, below which a body is not strained; in the thinnest beam that bends it is 1e-4


def said(mesh: Mesh, shapes: Floats, rigid: int, scene: Scene) -> tuple[str, ...]:
    """A remark when the first of some modes (m, N, 3) that strains a body of first-order cells is much too stiff."""
    if rigid >= len(shapes) or not _may_lock(scene):
        return ()
    excess = too_high(mesh, shapes[rigid], scene.material, scene.body.element)
    if excess < TOLD:
        return ()
    other = "hexahedra of order 2" if mesh.cell == "prism" else "body.order = 2"
    return (f"cells of first order bend too stiffly here: mode {rigid + 1} is too high by about {100 * excess:.0f} % or more; "
            f"take shorter cells or {other}",)


def said_of_path(scene: Scene, mesh: Mesh, displacement: Floats, energy: Floats, linear: int) -> tuple[str, ...]:
    """A remark when a body of first-order cells is much too stiff in the step that strains it most, or one of second order may be.

    Args:
        displacement, energy: (T, N, 3) and (T,) of a path; linear: how many of its first steps solved linear elasticity
    """
    step = int(np.argmax(energy))
    if not energy[step] > 0:
        return ()
    if scene.body.order == 2:
        return _said_of_volume(scene, mesh)
    if not _may_lock(scene):
        return ()
    finite = not scene.linear and step > linear
    stiff = too_stiff(mesh, displacement[step], scene.material, scene.body.element, finite=finite)
    if (1 + stiff) ** 0.5 - 1 < TOLD:
        return _said_of_volume(scene, mesh)
    reduced = mesh.cell == "prism" and scene.body.shape == "beam" and scene.body.extent[0] >= max(scene.body.extent[1:])
    second = "tetrahedra or hexahedra of order 2" if mesh.cell == "prism" else "body.order = 2"
    other = (', or body.element = "reduced"' if reduced else "") + f", or {second}"
    return (f"cells of first order resist too stiffly here: at step {step} the body by about {100 * stiff:.0f} %, so it moves too little "
            f"or pushes back too hard; take smaller cells{other}",)


def said_of_failure(scene: Scene, mesh: Mesh) -> tuple[str, ...]:
    """What may be in the way of an equilibrium near a Poisson ratio of 1/2, where a change of volume takes any force."""
    close = max(material.poisson_ratio for material in scene.materials) > CLOSEST
    rounding = f"take a Poisson's ratio of at most {CLOSEST:g}: closer to 1/2 the body moves the same, and rounding may be in the way"
    return (*_said_of_volume(scene, mesh), *[rounding] * close)


def _said_of_volume(scene: Scene, mesh: Mesh) -> tuple[str, ...]:
    """A remark on solid cells that keep their volume at too many points, near a Poisson ratio of 1/2; strain need not jump for that."""
    largest = max(material.poisson_ratio for material in scene.materials)
    if mesh.dimension == 2 or scene.body.element != "standard" or largest < INCOMPRESSIBLE:
        return ()
    order = "body.order = 2 and " if mesh.cell == "tetrahedron" else ""
    what = "coarse cells resist too stiffly even so" if scene.body.order == 2 else "cells of first order resist too stiffly"
    return (f"Poisson's ratio is {largest:.12g}: {what}; take {order}body.element = \"mean-dilatation\"",)


def too_high(mesh: Mesh, shape: Floats, material: Materials, element: str = "standard") -> float:
    """By what share of itself a mode's frequency is too high, about; shape (N, 3) of a body of first order."""
    return float((1 + too_stiff(mesh, shape, material, element)) ** 0.5 - 1)


def too_stiff(mesh: Mesh, shape: Floats, material: Materials, element: str = "standard", *, finite: bool = False) -> float:
    """By what share of itself a body of first order is too stiff in a motion (N, 3), about; 0 where that is rigid.

    A plane body counts as one without strain across it. Args: finite: strain is Green's, not that of small displacements
    """
    place, points, weights = _rule(mesh.cell)
    at = place + 1e-3 * (place.mean(axis=0) - place)  # at the corners, but for those that are flat
    d = mesh.dimension
    x, u = mesh.points[:, :d], shape[:, :d]
    (_, near), (values, slopes) = _shapes(mesh.cell, at), _shapes(mesh.cell, points)
    whole = jumps = most = 0.0
    for own, chosen in by_region(material, mesh):  # between materials strain may jump
        all_cells = mesh.cells[chosen]
        parts = np.array_split(all_cells, len(all_cells) // CHUNK + 1)
        mean, total = np.zeros((len(mesh.points), d, d)), np.zeros(len(mesh.points))
        for cells in parts:
            (strain, size), (inner, inner_size) = (_strains(of, x[cells], u[cells], finite) for of in (near, slopes))
            if element == "mean-dilatation":
                strain = _dilated(strain, _dilatation(inner, inner_size * weights))
            volume = size.mean(axis=1)[:, None]
            np.add.at(mean, cells, strain * volume[..., None, None])
            np.add.at(total, cells, volume)
        mean /= np.where(total > 0, total, 1.0)[:, None, None]
        most = max(most, float(abs(mean).max(initial=0)))
        for cells in parts:
            strain, size = _strains(slopes, x[cells], u[cells], finite)
            if element == "mean-dilatation":
                strain = _dilated(strain, _dilatation(strain, size * weights))
            smooth = np.einsum("pn,cnij->cpij", values, mean[cells])
            whole += float((_density(strain, own) * size * weights).sum())
            jumps += float((_density(strain - smooth, own) * size * weights).sum())
    if most * np.ptp(x) <= RIGID * abs(u).max(initial=0):
        return 0.0
    share = min(jumps / whole, 0.999) if whole > 0 else 0.0
    return 1 / (1 - share) - 1


def _may_lock(scene: Scene) -> bool:
    """Whether its cells are of the kind that may be much too stiff, and the measure is for its material."""
    return scene.body.order == 1 and scene.body.element != "reduced" and not any(material.orthotropic for material in scene.materials)


def _rule(kind: str) -> tuple[Floats, Floats, Floats]:
    """Corners (n, d), sample points (P, d) and their weights (P,) of a cell."""
    d = CELLS[kind].dimension
    if kind == "triangle":
        return CORNERS[kind][:, :d], np.array(TRIANGLE), np.full(3, 1 / 6)
    return CORNERS[kind][:, :d], CELLS[kind].points[:, :d], CELLS[kind].weights


def _shapes(kind: str, at: Floats) -> tuple[Floats, Floats]:
    """(P, n) first-order shape functions and (P, n, d) their gradients."""
    d = CELLS[kind].dimension
    values, slopes = CELLS[kind].shapes(np.pad(at, ((0, 0), (0, 3 - d))))
    return values, slopes[:, :, :d]


def _strains(slopes: Floats, x: Floats, u: Floats, finite: bool) -> tuple[Floats, Floats]:
    """(C, P, d, d) strains and (C, P) Jacobian determinants from gradients (P, n, d) of the shape functions.

    Of a finite motion they are Green's, but for their trace, which is the change of volume.
    """
    jacobian = np.einsum("pne,cnd->cped", slopes, x)
    gradient = np.linalg.solve(jacobian, np.einsum("pne,cnd->cped", slopes, u))  # [..., e, d]: of component d along e
    strain = (gradient + gradient.swapaxes(2, 3)) / 2
    if finite:
        strain = _dilated(strain + gradient @ gradient.swapaxes(2, 3) / 2, np.linalg.det(gradient + np.eye(x.shape[2])) - 1)
    return strain, np.linalg.det(jacobian)


def _dilatation(strain: Floats, weights: Floats) -> Floats:
    """(C, 1) the mean trace of strains (C, P, d, d) in each cell, by weights (C, P)."""
    return (np.trace(strain, axis1=2, axis2=3) * weights).sum(axis=1, keepdims=True) / weights.sum(axis=1, keepdims=True)


def _dilated(strain: Floats, dilatation: Floats) -> Floats:
    """Strains (C, P, d, d) with another trace (C, P) or (C, 1)."""
    d = strain.shape[2]
    missing = dilatation - np.trace(strain, axis1=2, axis2=3)
    return strain + missing[..., None, None] / d * np.eye(d)


def _density(strain: Floats, material: Material) -> Floats:
    """(C, P) strain energy a volume by Hooke's law."""
    first, second = lame(material)
    return first / 2 * np.trace(strain, axis1=2, axis2=3) ** 2 + second * (strain**2).sum(axis=(2, 3))
