"""How far elastic bodies are off, at finite strain, a displacement that is known because it was chosen.

Of a chosen u the first Piola-Kirchhoff stress P(u) is written down by hand; loads b_a = integral of P : grad N_a then hold the body at u.
With every outer node led as u says, displacements are off by h^(p + 1) in the mean square, the potential by h^(2 p).
"""

import numpy as np
import scipy.sparse.linalg

from physics.body.elasticity import Elasticity
from physics.mesh.cell import CELLS
from physics.scene import Material

LAMBDA, MU = 1.2, 0.8  # of E = 2.08, nu = 0.3
MATERIAL = Material(law="neo-hookean-log", young_modulus=MU * (3 * LAMBDA + 2 * MU) / (LAMBDA + MU),
                    poisson_ratio=LAMBDA / (2 * (LAMBDA + MU)))


def errors_against(chosen, mesh, fixed, points, weights):
    """Of the displacement, root of the mean square, and of the potential.

    chosen: gives u (..., 3) and its gradient (..., 3, 3) at places (..., 3), of a plane body in plane strain
    fixed: (N, 3) components that are led as u says; points, weights: a rule in a cell, (P, 3) and (P,)
    """
    body = Elasticity(mesh, MATERIAL, fixed)
    values, slopes = CELLS[mesh.cell].shapes(points)
    x = values @ mesh.points[mesh.cells]  # (C, P, 3)
    jacobian = np.einsum("pnk,cni->cpki", slopes, mesh.points[mesh.cells])
    if mesh.dimension == 2:
        jacobian[..., 2, 2] = 1.0
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
