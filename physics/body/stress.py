"""Cauchy stress at the centres of cells, and von Mises' measure of it.

    sigma = P F^T / det F,   P = dW/dF,   von Mises = sqrt(3/2 s : s),   s = sigma - tr(sigma)/3 I          [Pa]

P is not written down for each law: a cell of volume 1 with three nodes whose gradients are the unit vectors has the columns
of P as its nodal forces. They come from the same kernel as those of the solver. Where small strains are assumed (law
"linear") sigma is P itself.

Legend: N nodes, C cells, n nodes of a cell, M tensors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics.body.element import Samples
from physics.body.kernel import Kernel
from physics.body.material import lame
from physics.mesh.mesh import Mesh
from physics.mesh.quality import centre_gradients
from physics.scene import Material

Floats = NDArray[np.float64]


def deformation(mesh: Mesh, displacement: ArrayLike) -> Floats:
    """(C, 3, 3) deformation gradient F at the cells' centres for displacements (N, 3) [m]."""
    gradients = centre_gradients(mesh.cell)  # (n, 3)
    rest = np.einsum("cni,nk->cik", mesh.points[mesh.cells], gradients)
    moved = np.einsum("cni,nk->cik", np.asarray(displacement, np.float64)[mesh.cells], gradients)
    return np.eye(3) + moved @ np.linalg.inv(rest)  # not by the positions, whose rounding would be stress in a body at rest


def first_piola(F: Floats, material: Material) -> Floats:
    """(M, 3, 3) P [Pa] at deformation gradients (M, 3, 3)."""
    columns = np.ascontiguousarray((F - np.eye(3)).transpose(0, 2, 1)).reshape(-1, 3)  # (3 M, 3) displacements of the nodes
    cells = Samples(np.broadcast_to(np.eye(3), (1, len(F), 3, 3)), np.ones((1, len(F))), np.ones((1, 2)))
    kernel = Kernel(material.law, np.arange(len(columns)).reshape(-1, 3), cells)
    return kernel.forces(columns, lame(material)).reshape(-1, 3, 3).transpose(0, 2, 1)


def cauchy(mesh: Mesh, displacement: ArrayLike, material: Material) -> Floats:
    """(C, 3, 3) sigma [Pa] at the cells' centres for displacements (N, 3) [m]; not a number where a cell is inverted."""
    F = deformation(mesh, displacement)
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = first_piola(F, material)
        return sigma if material.law == "linear" else sigma @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]


def von_mises_of(sigma: Floats) -> Floats:
    """(M,) von Mises stress [Pa] of tensors (M, 3, 3)."""
    with np.errstate(invalid="ignore"):
        deviator = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))


def von_mises(mesh: Mesh, displacement: ArrayLike, material: Material) -> Floats:
    """(C,) von Mises stress [Pa] at the cells' centres for displacements (N, 3) [m]; not a number where a cell is inverted."""
    return von_mises_of(cauchy(mesh, displacement, material))
