"""Where the energy of a cell is sampled, and with which gradients of its shape functions.

A cell of the rest body has the energy sum_p V_p W(F_p), F_p = I + sum_a u_a (x) g_ap: at each of its sample points p a
volume V_p [m3] and a gradient g_ap [1/m] for each node a. An element is a choice of these.

standard: g_ap is the gradient of the shape function of node a at the points of a Gauss rule.

mean-dilatation (prisms, hexahedra, tetrahedra of second order): nearly incompressible cells have more points to keep their volume at
    than they have freedom, and lock. All laws in material.py are sums of a part with mu and a part with lambda; the latter is sampled only
    once in each cell, with the mean gradient (Hughes, The Finite Element Method, section 4.5). A hexahedron of 27 nodes has the linear
    functions of the cell's coordinates in place of the mean, those that are nearest to the gradient in it: its four dilatations are
    sampled at four points that integrate their squares exactly (Q2/P1, which keeps the order of convergence where cells are bricks:
    Boffi, Brezzi and Fortin, Mixed Finite Element Methods, section 8.6). A tetrahedron of ten nodes with one dilatation (P2/P0) loses
    one order, and locks no more.

reduced (prisms whose triangles lie across a beam): locks neither then nor in bending. Along the beam, a linear deflection
    cannot follow a curvature; the slope that is missing turns up as shear, and stiffens cells of length h in a beam of
    height H by the share G h^2 / E H^2, E and G being Young's and the shear modulus. In the section, strain along the beam
    varies within a triangle and strain across it cannot, so the lateral contraction is hindered. So
    - the part of W with mu is sampled at mid-height only, at three points of the triangle. It leaves no motion without
      energy but the six rigid ones: the difference of the two triangles' motions enters as stretch along the axis and as
      shear, and both are zero only for a rigid turn;
    - the part with lambda is sampled as above.
    At mid-height a constant is added to the gradients that gives them the mean of the true ones, the integral of grad N_a
    over the cell divided by V (Flanagan and Belytschko 1981, eq. 16): only then is uniform stress in equilibrium on
    distorted cells too. Strain in the section that varies along the axis within one cell is not resisted by itself, so this
    is no element for prisms that lie flat in a plate.

Legend: C cells, n nodes of a cell (in gmsh's order), P sample points of a cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, CURVED_TETRAHEDRON, TRIANGLE
from physics.mesh.mesh import Mesh
from physics.mesh.second import is_curved
from physics.schema import InputError

Floats = NDArray[np.float64]

FOUR = 0.5 + np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) / 12**0.5  # of a cube; equal weights, exact for degree 2
MID_HEIGHT = np.array([(r, s, 0.5) for r, s in TRIANGLE]), np.full(3, 1 / 6)


@dataclass(frozen=True)
class Samples:
    """The sample points of all cells of a mesh; `parts` says which share of lambda and of mu counts at each."""

    gradients: Floats  # (P, C, n, 3) [1/m]
    volumes: Floats  # (P, C) [m3]
    parts: Floats  # (P, 2)


def samples(mesh: Mesh, element: str = "standard") -> Samples:
    """The sample points of an element on a mesh. Raises `InputError` for cells that it is not for."""
    curved = mesh.cell == "tetrahedron10" and is_curved(mesh)
    gradients, volumes = _isoparametric(mesh, *(CURVED_TETRAHEDRON if curved else (CELLS[mesh.cell].points, CELLS[mesh.cell].weights)))
    if element == "standard":
        return Samples(gradients, volumes, np.ones((len(volumes), 2)))
    if mesh.cell == "tetrahedron" or mesh.dimension == 2 or (element == "reduced" and mesh.cell != "prism"):
        raise InputError(f"body.element = {element!r}: not for {CELLS[mesh.cell].plural}; leave it out")
    if mesh.cell == "hexahedron27":
        linear, volume = _linear(gradients, volumes)
        return Samples(np.concatenate([gradients, linear]), np.concatenate([volumes, volume]),
                       np.repeat([(0.0, 1.0), (1.0, 0.0)], [len(volumes), len(volume)], axis=0))
    mean, volume = _mean(gradients, volumes)
    if element == "reduced":
        gradients, volumes = _isoparametric(mesh, *MID_HEIGHT)
        volumes *= volume / volumes.sum(axis=0)
        gradients += mean - _mean(gradients, volumes)[0]
    return Samples(np.concatenate([gradients, mean[None]]), np.concatenate([volumes, volume[None]]),
                   np.array([(0.0, 1.0)] * len(volumes) + [(1.0, 0.0)]))


def node_volumes(mesh: Mesh) -> Floats:
    """(C, n) [m3] the integral over each cell of the shape function of each of its nodes, where its sides are straight."""
    cell = CELLS[mesh.cell]
    return np.asarray(_isoparametric(mesh, cell.points, cell.weights)[1].T @ cell.shapes(cell.points)[0])


def _isoparametric(mesh: Mesh, points: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Gradients (P, C, n, 3) and volumes (P, C) at points of every cell; those of a plane cell have no part along z."""
    local = CELLS[mesh.cell].shapes(points)[1]  # (P, n, 3)
    jacobian = np.einsum("cni,pnj->pcij", mesh.points[mesh.cells], local)
    if mesh.dimension == 2:
        jacobian[..., 2, 2] = mesh.thickness
    return local[:, None] @ np.linalg.inv(jacobian), weights[:, None] * np.linalg.det(jacobian)


def _linear(gradients: Floats, volumes: Floats) -> tuple[Floats, Floats]:
    """(4, C, n, 3) at FOUR points of a cube the linear functions nearest to gradients in each cell, and shares (4, C) of its volume."""
    of = [np.column_stack([np.ones(len(at)), at]) for at in (CELLS["hexahedron27"].points, FOUR)]  # 1, r, s, t
    moments = np.einsum("pk,pl,pc->ckl", of[0], of[0], volumes)
    factors = np.linalg.solve(moments, np.einsum("pk,pc,pcni->ckni", of[0], volumes, gradients).reshape(len(moments), 4, -1))
    found = np.einsum("qk,ckm->qcm", of[1], factors).reshape(4, len(moments), -1, 3)
    # Weights that have the volume and the first moments of the cell, which for a brick are quarters.
    return found, np.linalg.solve(of[1].T, moments[:, 0].T)


def _mean(gradients: Floats, volumes: Floats) -> tuple[Floats, Floats]:
    """(C, n, 3) mean of gradients over each cell, and the cells' volumes (C,)."""
    volume = volumes.sum(axis=0)
    return np.einsum("pc,pcni->cni", volumes, gradients) / volume[:, None, None], volume
