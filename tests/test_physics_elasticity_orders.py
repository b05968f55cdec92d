"""Orders of convergence at finite strain, of both orders of cells, against a displacement that is known because it was chosen.

Of a chosen u the first Piola-Kirchhoff stress P(u) is written down by hand; loads b_a = integral of P : grad N_a then hold the body at u.
With every outer node led as u says, displacements are off by h^(p + 1) in the mean square, the potential by h^(2 p).
"""

import numpy as np
import pytest
import scipy.sparse.linalg

from physics.body.elasticity import Elasticity
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.scene import Body, Material

LAMBDA, MU = 1.2, 0.8  # of E = 2.08, nu = 0.3


def chosen(x):
    """u (..., 3), its gradient (..., 3, 3); stretches from 0.6 to 1.5."""
    a, b, c = np.moveaxis(x, -1, 0)
    k, zero = np.pi / 2, np.zeros_like(a)
    u = 0.2 * np.stack([np.sin(k * b) * np.cos(k * c), a * b**3, np.cos(k * a) * (1 + c) ** 2 / 2], axis=-1)
    rows = [[zero, k * np.cos(k * b) * np.cos(k * c), -k * np.sin(k * b) * np.sin(k * c)], [b**3, 3 * a * b**2, zero],
            [-k * np.sin(k * a) * (1 + c) ** 2 / 2, zero, np.cos(k * a) * (1 + c)]]
    return u, 0.2 * np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rule(cell):
    """Gauss's rule of four points a line on a cube or, squeezed (Duffy), on a prism or a tetrahedron."""
    at, weight = np.polynomial.legendre.leggauss(4)
    r, s, t = (grid.ravel() for grid in np.meshgrid(*[(at + 1) / 2] * 3, indexing="ij"))
    w = np.einsum("i,j,k->ijk", weight, weight, weight).ravel() / 8
    if cell == "hexahedron":
        return np.column_stack([r, s, t]), w
    if cell == "prism":
        return np.column_stack([r, s * (1 - r), t]), w * (1 - r)
    return np.column_stack([r, s * (1 - r), t * (1 - r) * (1 - s)]), w * (1 - r) ** 2 * (1 - s)


def errors(cell, order, n):
    """Of the displacement, root of the mean square, and of the potential."""
    mesh = build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=(n, n, n), cell=cell, order=order))
    young = MU * (3 * LAMBDA + 2 * MU) / (LAMBDA + MU)
    held = ((mesh.points < 1e-9) | (mesh.points > 1 - 1e-9)).any(axis=1)
    fixed = np.repeat(held[:, None], 3, axis=1)
    material = Material(law="neo-hookean-log", young_modulus=young, poisson_ratio=LAMBDA / (2 * (LAMBDA + MU)))
    body = Elasticity(mesh, material, fixed)
    points, weights = rule(cell)
    values, slopes = CELLS[mesh.cell].shapes(points)
    x = values @ mesh.points[mesh.cells]  # (C, P, 3)
    jacobian = np.einsum("pnk,cni->cpki", slopes, mesh.points[mesh.cells])
    volume = np.linalg.det(jacobian) * weights
    gradients = np.linalg.solve(jacobian, slopes.swapaxes(1, 2)[None]).swapaxes(2, 3)  # (C, P, n, 3)
    u, H = chosen(x)
    F = np.eye(3) + H
    J, inverse = np.linalg.det(F), np.linalg.inv(F).swapaxes(2, 3)
    P = MU * (F - inverse) + LAMBDA * np.log(J)[..., None, None] * inverse
    W = MU / 2 * ((F**2).sum(axis=(2, 3)) - 3) - MU * np.log(J) + LAMBDA / 2 * np.log(J) ** 2
    load = np.zeros_like(mesh.points)
    np.add.at(load, mesh.cells, np.einsum("cpij,cpnj,cp->cni", P, gradients, volume))
    found, _ = chosen(mesh.points)
    for _ in range(8):
        missing = np.where(fixed, 0.0, load - body.force(found))
        if np.linalg.norm(missing) < 1e-10 * np.linalg.norm(load):
            break
        indptr, indices, entries = body.stiffness(found).getValuesCSR()
        matrix = scipy.sparse.csr_matrix((entries, indices, indptr)).tocsc()
        found = found + body.space.from_dofs(scipy.sparse.linalg.spsolve(matrix, body.space.to_dofs(missing)))
    else:
        raise AssertionError("no equilibrium")
    off = values @ found[mesh.cells] - u
    exact = ((W - (P * H).sum(axis=(2, 3))) * volume).sum()
    return np.sqrt((off**2).sum(axis=2).ravel() @ volume.ravel()), abs(body.energy(found) - (load * found).sum() - exact)


@pytest.mark.parametrize("cell, order, coarse, fine", [
    ("tetrahedron", 1, 3, 6), ("prism", 1, 3, 6), ("hexahedron", 1, 3, 6), ("tetrahedron", 2, 2, 4), ("hexahedron", 2, 2, 4)])
def test_displacements_and_potential_converge_with_the_orders_of_their_cells(cell, order, coarse, fine):
    far, near = errors(cell, order, coarse), errors(cell, order, fine)
    of_u, of_energy = np.log2(np.array(far) / near) / np.log2(fine / coarse)
    assert of_u > order + 1 - 0.1 and of_energy > 2 * order - 0.1, (of_u, of_energy)
