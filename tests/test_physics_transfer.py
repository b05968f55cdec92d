"""Carrying displacements between meshes: exact for what the shape functions span."""

import numpy as np
import pytest

from physics.mesh import Mesh, build_mesh
from physics.scene import Body
from physics.transfer import interpolate


def beam(cell: str, cells: tuple[int, int, int]) -> Mesh:
    return build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=cells, cell=cell))


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
def test_interpolation_is_exact_for_linear_fields_and_at_the_nodes(cell):
    coarse, fine = beam(cell, (4, 2, 2)), beam(cell, (11, 5, 7))
    inner = ((coarse.points > 1e-9) & (coarse.points < np.array([0.1, 0.02, 0.03]) - 1e-9)).all(axis=1)
    rng = np.random.default_rng(0)
    coarse.points[inner] += 0.002 * rng.uniform(-1, 1, (inner.sum(), 3))  # cells that are no parallelepipeds
    gradient = rng.normal(size=(5, 3, 3))
    linear = np.einsum("tij,nj->tni", gradient, coarse.points) + 1
    expected = np.einsum("tij,nj->tni", gradient, fine.points) + 1
    # Newton's iteration ends at rounding, in lengths of 1e-2 m and gradients of some units.
    np.testing.assert_allclose(interpolate(coarse, linear, fine.points), expected, atol=1e-13)
    anything = rng.normal(size=(2, *coarse.points.shape))  # would show a wrong cell, which linear fields do not
    np.testing.assert_allclose(interpolate(coarse, anything, coarse.points), anything, atol=1e-12)
    with pytest.raises(ValueError, match="1 of 2 points lie outside"):
        interpolate(coarse, linear, np.array([[0.05, 0.01, 0.01], [0.05, 0.01, 0.031]]))


def test_interpolation_within_a_prism_is_linear_along_it_and_across_it():
    mesh = beam("prism", (1, 1, 1))
    field = np.zeros((1, len(mesh.points), 3))
    field[0, :, 0] = mesh.points[:, 0] * mesh.points[:, 1]  # in the span of the prism's shape functions
    points = np.random.default_rng(1).uniform(0, 1, (50, 3)) * [0.1, 0.02, 0.03]
    np.testing.assert_allclose(interpolate(mesh, field, points)[0, :, 0], points[:, 0] * points[:, 1], atol=1e-16)
