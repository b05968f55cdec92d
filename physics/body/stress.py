"""Cauchy stress at the centres of cells and at nodes, and von Mises' measure of it.

    sigma = P F^T / det F,   P = dW/dF,   von Mises = sqrt(3/2 s : s),   s = sigma - tr(sigma)/3 I          [Pa]

P is not written down for each law: a cell of volume 1 with three nodes whose gradients are the unit vectors has the columns
of P as its nodal forces. They come from the same kernel as those of the solver. Where small strains are assumed (law
"linear") sigma is P itself.

At the nodes it follows from that at the centres. Around each node a linear function is fitted to the stress at the centres of the
cells nearby, those at the node and those that touch them, by least squares with weights 1/d^2, d the distance of a centre from the
node. Its value at the node is a weighted sum of the cells' stresses, the same for all frames,

    sigma(x) = sum_c r_c sigma_c,    r_c = p_c (1 + (x - m) . S^+ (x_c - m)),    m = sum p_c x_c,    S = sum p_c (x_c - m) (x_c - m)^T

with p the weights over their sum. So stress that varies linearly is exact up to the surface, where means over cells are too low by what
it changes in half a cell (Zienkiewicz and Zhu, Int. J. Numer. Meth. Engng 33, 1992, 1331: recovery from patches). Across a single layer
of cells there is nothing to fit: S^+ leaves out the directions in which the centres spread by less than SPREAD of what the nodes of
their cells do.

Cells of second order know their stress best at the points of the rule of one degree less (Barlow, Int. J. Numer. Meth. Engng 10, 1976,
243): four in a tetrahedron, eight in a hexahedron, three in a triangle, four in a quadrilateral. From these it goes on to a cell's nodes by
the functions of first order that have its values there, and a node has the mean over its cells.

Legend: N nodes, C cells, n nodes of a cell, P points of one that stress is taken at, M tensors, k pairs of a node and a cell nearby.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from physics.body.element import Samples
from physics.body.kernel import Kernel
from physics.body.material import by_region, lame
from physics.mesh.cell import CELLS, CORNERS, TRIANGLE
from physics.mesh.mesh import Mesh
from physics.mesh.quality import centre_gradients
from physics.scene import Material, Materials

Floats = NDArray[np.float64]

SPREAD = 0.1  # of centres over that of the nodes of their cells, as variances: two layers have 0.36 at their surface, one has 0


def deformation(mesh: Mesh, displacement: ArrayLike, gradients: Floats | None = None) -> Floats:
    """(C, 3, 3) deformation gradient F for displacements (N, 3) [m], at the cells' centres or where the shape functions have some
    gradients (n, 3) by the cell's coordinates."""
    gradients = centre_gradients(mesh.cell) if gradients is None else gradients
    rest = np.einsum("cni,nk->cik", mesh.points[mesh.cells], gradients)
    rest[:, mesh.dimension:, mesh.dimension:] = np.eye(3 - mesh.dimension)
    moved = np.einsum("cni,nk->cik", np.asarray(displacement, np.float64)[mesh.cells], gradients)
    return np.eye(3) + moved @ np.linalg.inv(rest)  # not by the positions, whose rounding would be stress in a body at rest


def first_piola(F: Floats, material: Material) -> Floats:
    """(M, 3, 3) P [Pa] at deformation gradients (M, 3, 3)."""
    columns = np.ascontiguousarray((F - np.eye(3)).transpose(0, 2, 1)).reshape(-1, 3)  # (3 M, 3) displacements of the nodes
    cells = Samples(np.broadcast_to(np.eye(3), (1, len(F), 3, 3)), np.ones((1, len(F))), np.ones((1, 2)))
    kernel = Kernel(material.law, np.arange(len(columns)).reshape(-1, 3), cells)
    return kernel.forces(columns, lame(material)).reshape(-1, 3, 3).transpose(0, 2, 1)


def thinned(F: Floats, material: Material) -> Floats:
    """(M, 3, 3) F with the stretch F_33 at which a thin sheet has no stress across, P_33 = 0, by Newton's method."""
    F, small = F.copy(), np.sqrt(np.finfo(float).eps)
    for _ in range(40):
        across, beside = F[:, 2, 2].copy(), F + small * np.diag([0.0, 0.0, 1.0])
        here, there = (first_piola(each, material)[:, 2, 2] for each in (F, beside))
        F[:, 2, 2] = np.maximum(across - here * small / (there - here), across / 2)
        if not (abs(F[:, 2, 2] - across) > 1e-13).any():
            break
    return F


def cauchy(mesh: Mesh, displacement: ArrayLike, material: Materials) -> Floats:
    """(C, 3, 3) sigma [Pa] at the cells' centres for displacements (N, 3) [m]; not a number where a cell is inverted."""
    return _cauchy(mesh, deformation(mesh, displacement), material)


def _cauchy(mesh: Mesh, F: Floats, material: Materials) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.empty_like(F)
        for own, cells in by_region(material, mesh):
            f = thinned(F[cells], own) if mesh.sheet else F[cells]
            sigma = first_piola(f, own)
            found[cells] = sigma if own.law == "linear" else sigma @ f.transpose(0, 2, 1) / np.linalg.det(f)[:, None, None]
        return found


def von_mises_of(sigma: Floats) -> Floats:
    """(M,) von Mises stress [Pa] of tensors (M, 3, 3)."""
    with np.errstate(invalid="ignore"):
        deviator = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))


def von_mises(mesh: Mesh, displacement: ArrayLike, material: Materials) -> Floats:
    """(C,) von Mises stress [Pa] at the cells' centres for displacements (N, 3) [m]; not a number where a cell is inverted."""
    return von_mises_of(cauchy(mesh, displacement, material))


def recovery(mesh: Mesh, material: Materials | None = None) -> scipy.sparse.csr_matrix:
    """(N, P C) what the value at each point of each cell, of first order its centre, counts at each node; a node of no cell has zeros.

    Of several materials each one is fitted by itself, for stress jumps between them; a node that they share has the mean.
    """
    if isinstance(material, tuple):
        points = len(_best(mesh.cell)) if CELLS[mesh.cell].middles else 1
        found = scipy.sparse.csr_matrix((len(mesh.points), points * len(mesh.cells)))
        for _, cells in by_region(material, mesh):
            rows = (np.arange(len(mesh.cells))[cells] + len(mesh.cells) * np.arange(points)[:, None]).ravel()
            whole = scipy.sparse.identity(points * len(mesh.cells), format="csr")[rows]
            found += recovery(replace(mesh, cells=mesh.cells[cells])) @ whole
        return scipy.sparse.diags(1 / np.maximum(np.asarray(found.sum(axis=1)).ravel(), 1.0)) @ found
    if CELLS[mesh.cell].middles:
        return _extrapolation(mesh)
    n, corners = mesh.cells.shape[1], mesh.points[mesh.cells]
    ends = n * np.arange(len(mesh.cells) + 1)
    touches = scipy.sparse.csr_matrix((np.ones(mesh.cells.size), mesh.cells.ravel(), ends), shape=(len(mesh.cells), len(mesh.points)))
    near = (touches.T @ (touches @ touches.T)).tocoo()
    node, cell = near.row, near.col  # (k,)
    centre = corners.mean(axis=1)
    away = centre[cell] - mesh.points[node]
    weight = 1 / (away**2).sum(axis=1)
    weight /= np.bincount(node, weight, len(mesh.points))[node]

    def mean(values: Floats) -> Floats:
        """(N, ...) of values (k, ...)."""
        rows = scipy.sparse.csr_matrix((weight, (node, np.arange(len(node)))), shape=(len(mesh.points), len(node)))
        return np.asarray(rows @ values.reshape(len(node), -1)).reshape(-1, *values.shape[1:])

    middle = mean(away)  # (N, 3) m - x
    apart = away - middle[node]
    own = corners - centre[:, None]
    size = mean((np.einsum("cni,cnj->cij", own, own) / n)[cell])  # (N, 3, 3) spread of the nodes of the cells
    size[:, mesh.dimension:, mesh.dimension:] = np.eye(3 - mesh.dimension)
    size[np.bincount(node, minlength=len(mesh.points)) == 0] = np.eye(3)
    unit = np.linalg.inv(np.linalg.cholesky(size))
    spread, axes = np.linalg.eigh(unit @ mean(apart[:, :, None] * apart[:, None, :]) @ unit.transpose(0, 2, 1))
    kept = np.where(spread > SPREAD, 1 / np.maximum(spread, SPREAD), 0.0)
    slope = np.einsum("nji,njk,nk,nlk,nlm,nm->ni", unit, axes, kept, axes, unit, -middle, optimize=True)  # (N, 3) S^+ (x - m)
    share = weight * (1 + (slope[node] * apart).sum(axis=1))
    return scipy.sparse.csr_matrix((share, (node, cell)), shape=(len(mesh.points), len(mesh.cells)))


def nodal_stress(mesh: Mesh, displacement: ArrayLike, material: Materials, at_nodes: scipy.sparse.csr_matrix | None = None) -> Floats:
    """(N, 3, 3) Cauchy stress [Pa] at the nodes for displacements (N, 3) [m]; not a number near an inverted cell.

    at_nodes: `recovery` of the mesh, where it is at hand
    """
    at_nodes = recovery(mesh, material) if at_nodes is None else at_nodes
    return np.asarray(at_nodes @ _sampled(mesh, displacement, material).reshape(-1, 9)).reshape(-1, 3, 3)


def _sampled(mesh: Mesh, displacement: ArrayLike, material: Materials) -> Floats:
    """(P, C, 3, 3) Cauchy stress [Pa] where it is best known in each cell: of first order at its centre."""
    if not CELLS[mesh.cell].middles:
        return cauchy(mesh, displacement, material)[None]
    gradients = CELLS[mesh.cell].shapes(_best(mesh.cell))[1]
    return np.array([_cauchy(mesh, deformation(mesh, displacement, each), material) for each in gradients])


def stress_jumps(mesh: Mesh, displacement: ArrayLike, material: Materials) -> Floats:
    """(C,) how far the Cauchy stress of each cell is at its corners from that of the nodes there [Pa], as a root of the mean square."""
    cell, own = CELLS[mesh.cell], _sampled(mesh, displacement, material)
    at_nodes = np.asarray(recovery(mesh, material) @ own.reshape(-1, 9)).reshape(-1, 3, 3)
    there = at_nodes[mesh.cells[:, :cell.corners]]  # (C, k, 3, 3)
    here = own[0][:, None]
    if cell.middles:
        first = CELLS[cell.first]
        share = first.shapes(CORNERS[first.name])[0] @ np.linalg.inv(first.shapes(_best(mesh.cell))[0])  # (k, P)
        here = np.einsum("kp,pcij->ckij", share, own)
    return np.asarray(np.sqrt(((there - here) ** 2).sum(axis=(2, 3)).mean(axis=1)))


def _best(cell: str) -> Floats:
    """(P, 3) where in a cell of second order its stress is best."""
    if cell == "triangle6":
        return np.pad(TRIANGLE, ((0, 0), (0, 1)))
    return CELLS[cell if cell == "tetrahedron10" else CELLS[cell].first].points


def _extrapolation(mesh: Mesh) -> scipy.sparse.csr_matrix:
    """(N, P C) `recovery` of cells of second order, all cells' first points first."""
    cell, cells = CELLS[mesh.cell], len(mesh.cells)
    first = CELLS[cell.first]
    share = first.shapes(cell.places)[0] @ np.linalg.inv(first.shapes(_best(mesh.cell))[0])  # (n, P)
    many = np.maximum(np.bincount(mesh.cells.ravel(), minlength=len(mesh.points)), 1)
    row = np.repeat(mesh.cells[None], share.shape[1], axis=0)  # (P, C, n)
    column = np.broadcast_to(np.arange(share.shape[1] * cells).reshape(-1, cells, 1), row.shape)
    values = np.broadcast_to(share.T[:, None], row.shape) / many[row]
    return scipy.sparse.csr_matrix((values.ravel(), (row.ravel(), column.ravel())), shape=(len(mesh.points), share.shape[1] * cells))
