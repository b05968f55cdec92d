"""Orders of convergence at finite strain, of both orders of cells, against a displacement that is known because it was chosen."""

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.scene import Body
from tests.chosen_displacement import errors_against


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
    held = ((mesh.points < 1e-9) | (mesh.points > 1 - 1e-9)).any(axis=1)
    return errors_against(chosen, mesh, np.repeat(held[:, None], 3, axis=1), *rule(cell))


@pytest.mark.parametrize("cell, order, coarse, fine", [
    ("tetrahedron", 1, 3, 6), ("prism", 1, 3, 6), ("hexahedron", 1, 3, 6), ("tetrahedron", 2, 2, 4), ("hexahedron", 2, 2, 4)])
def test_displacements_and_potential_converge_with_the_orders_of_their_cells(cell, order, coarse, fine):
    far, near = errors(cell, order, coarse), errors(cell, order, fine)
    of_u, of_energy = np.log2(np.array(far) / near) / np.log2(fine / coarse)
    assert of_u > order + 1 - 0.1 and of_energy > 2 * order - 0.1, (of_u, of_energy)
