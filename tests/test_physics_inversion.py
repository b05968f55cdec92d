"""The smallest det F of a path in one compiled pass, held against numpy's way to it, whose own tests know it from elsewhere."""

import numpy as np
import pytest

from physics.inversion import smallest_det_f
from physics.mesh import quality
from physics.mesh.build import build_mesh, of_order
from physics.mesh.mesh import Mesh
from physics.scene import Body

BODIES = [Body(length=0.03, width=0.01, height=0.01, cells=(3, 1, 1), cell=cell, order=order)
          for cell, order in (("prism", 1), ("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2))]
BODIES += [Body(shape="plate", length=0.03, width=0.01, cells=(3, 1), cell=cell) for cell in ("triangle", "quadrilateral")]


@pytest.mark.parametrize("body", BODIES, ids=lambda body: f"{body.cell}, order {body.order}")
def test_each_frame_has_the_smallest_of_all_cells(body):
    """Numbers of cells that fill no pack; in the last frame they are mirrored."""
    mesh = of_order(build_mesh(body), body)
    u = np.array([0.0, 1e-4, 2e-4, 1e-4])[:, None, None] * np.random.default_rng(1).normal(size=(4, *mesh.points.shape))
    u[..., mesh.dimension:] = 0.0
    u[3] -= mesh.points * [2, 0, 0]
    found = smallest_det_f(mesh, u)
    assert found == pytest.approx(quality.smallest_det_f(mesh.points, u, mesh.cells, mesh.cell), rel=1e-11)
    assert found[0] == pytest.approx(1) and 0 < found[1] < 1 and found[3] < 0


def test_a_stretch_is_its_own_determinant():
    """x = F X with det F = 1.1 0.9 0.8 in a body of 12 cells, one of them pressed to a half of its height in the second frame."""
    mesh = build_mesh(Body(length=0.03, width=0.01, height=0.02, cells=(3, 1, 2), cell="hexahedron"))
    stretched = mesh.points * [0.1, -0.1, -0.2]
    pressed = np.where((mesh.points[:, [0]] > 0.0299) & (mesh.points[:, [2]] > 0.0199), [0, 0, -0.005], [0, 0, 0.0])
    assert smallest_det_f(mesh, np.array([stretched, pressed])) == pytest.approx([1.1 * 0.9 * 0.8, 0.5])


def test_a_corner_that_is_flat_at_rest_says_nothing():
    """A quadrilateral with a corner on the line between its neighbours, and what it does when it is moved into the cell."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0, 1, 0]])
    mesh = Mesh(points, np.array([[0, 1, 2, 3]]), "quadrilateral", {})
    still = np.zeros((1, 4, 3))
    assert smallest_det_f(mesh, still) == pytest.approx([1.0])
    moved = still.copy()
    moved[0, 2] = [-0.1, -0.1, 0]
    expected = quality.smallest_det_f(points, moved, mesh.cells, mesh.cell)
    assert smallest_det_f(mesh, moved) == pytest.approx(expected) and expected > 0
