"""Cauchy stress at the centres of cells, and von Mises' measure of it.

    sigma = P F^T / det F,   P = dW/dF,   von Mises = sqrt(3/2 s : s),   s = sigma - tr(sigma)/3 I          [Pa]

P is not written down for each law: on the unit tetrahedron with a uniform F, the nodal forces are f_a = P grad N_a / 6 and
the gradients of its nodes 1 to 3 are the unit vectors, so these forces are the columns of P / 6. They come from the same
kernel as those of the solver. Where small strains are assumed (law "linear") sigma is P itself.

Legend: N nodes, C cells, n nodes of a cell, M tensors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics import fem
from physics.elasticity import kernels
from physics.material import lame
from physics.mesh import Mesh
from physics.quality import centre_gradients
from physics.scene import Material

Floats = NDArray[np.float64]
UNIT = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def deformation(mesh: Mesh, displacement: ArrayLike) -> Floats:
    """(C, 3, 3) deformation gradient F at the cells' centres for displacements (N, 3) [m]."""
    gradients = centre_gradients(mesh.cell)  # (n, 3)
    rest = np.einsum("cni,nk->cik", mesh.points[mesh.cells], gradients)
    now = np.einsum("cni,nk->cik", (mesh.points + np.asarray(displacement, np.float64))[mesh.cells], gradients)
    return now @ np.linalg.inv(rest)


def first_piola(F: Floats, material: Material) -> Floats:
    """(M, 3, 3) P [Pa] at deformation gradients (M, 3, 3)."""
    points = np.tile(UNIT, (len(F), 1))  # (4 M, 3)
    u = np.einsum("mij,aj->mai", F - np.eye(3), UNIT).reshape(-1, 3)
    cells = np.arange(len(points)).reshape(-1, 4)[:, fem.FROM_GMSH["tetrahedron"]]
    force = kernels("tetrahedron", material.law)[1](np.ascontiguousarray(cells, np.int32), points, np.ascontiguousarray(u),
                                                    np.array(lame(material)), np.zeros_like(points))
    return 6 * force.reshape(-1, 4, 3)[:, 1:].transpose(0, 2, 1)


def von_mises(mesh: Mesh, displacement: ArrayLike, material: Material) -> Floats:
    """(C,) von Mises stress [Pa] at the cells' centres for displacements (N, 3) [m]; not a number where a cell is inverted."""
    F = deformation(mesh, displacement)
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = first_piola(F, material)
        if material.law != "linear":
            sigma = sigma @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]
        deviator = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))
