"""Laplacian modes without a solver library, against exact ones and against finite elements by dolfinx."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.trajectory import HANDLE, WALL, at_rest
from learning.harmonics import harmonics, laplacian
from physics.laplacian import laplacian_modes
from physics.mesh import build_mesh
from physics.scene import Body
from physics.schema import InputError


def block(cell, cells, held=None, height=0.5):
    """A body of 1 x 1 (x height) at rest; on held places phi = 0."""
    plane = len(cells) == 2
    thick = 0.0 if plane else height
    mesh = build_mesh(Body(shape="plate" if plane else "beam", length=1.0, width=1.0, height=thick, cells=cells, cell=cell))
    trajectory = at_rest(mesh, np.zeros((0, len(mesh.points), 3)))
    kind = trajectory.node_kind.copy()
    for name, value in (held or {}).items():
        kind[mesh.places[name]] = value
    return replace(trajectory, node_kind=kind)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "prism", "tetrahedron", "hexahedron"])
def test_eigenvalues_converge_to_the_exact_ones_with_the_square_of_the_cell_size(cell):
    plane = cell in ("triangle", "quadrilateral")
    exact = np.pi**2 * np.array([1.0, 1.0, 2.0])  # free square: (1, 0), (0, 1), (1, 1); half as high a block has no other below 4
    errors = []
    for n in (6, 12):
        values, _ = harmonics(block(cell, (n, n) if plane else (n, n, n // 2)), count=3)
        errors.append(np.abs(values / exact - 1).max())
    assert errors[1] < 0.02
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2  # second order


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "prism", "tetrahedron", "hexahedron"])
def test_stiffness_is_exact_for_linear_fields_and_the_mass_is_the_volume(cell):
    mesh = block(cell, (4, 3) if cell in ("triangle", "quadrilateral") else (4, 3, 2)).mesh
    volume = 1.0 if mesh.dimension == 2 else 0.5
    stiffness, mass = laplacian(mesh)
    assert mass.sum() == pytest.approx(volume) and abs(stiffness - stiffness.T).max() < 1e-14
    x = mesh.points @ [2.0, -1.0, 0.0]
    assert x @ stiffness @ x == pytest.approx(5 * volume)  # the integral of |grad x|^2


def test_modes_are_those_of_finite_elements():
    body = Body(length=0.1, width=0.02, height=0.014, cells=(20, 4, 3))
    reference = laplacian_modes(body, count=3, dirichlet=("x-min",))
    mesh = build_mesh(body)
    kind = np.zeros(len(mesh.points), np.uint8)
    kind[mesh.places["x-min"]] = HANDLE
    values, shapes = harmonics(replace(at_rest(mesh, np.zeros((0, len(mesh.points), 3))), node_kind=kind), count=3)
    # lumped and consistent mass differ by (k h)^2 / 12 each way: 2 % for the third mode, 5 pi / 2 over 20 cells
    assert values == pytest.approx(reference.eigenvalues, rel=0.03)
    for one, other in zip(shapes, reference.shapes, strict=True):
        assert abs(one @ other) / np.linalg.norm(one) / np.linalg.norm(other) > 0.9999


def test_held_nodes_stay_at_zero_and_copies_of_the_last_come_on_top():
    held = {name: WALL for name in ("x-min", "x-max", "y-min", "y-max")}
    trajectory = block("quadrilateral", (24, 24), held)
    values, shapes = harmonics(trajectory, count=2, cluster=1.04)  # half waves along x and y: 1 1, 1 2, 2 1
    assert len(values) == 3 and values == pytest.approx(np.pi**2 * np.array([2, 5, 5]), rel=0.03)
    assert not shapes[:, trajectory.node_kind == WALL].any()
    assert np.array_equal(harmonics(trajectory, count=2, cluster=1.04)[1], shapes)  # the same bits every time
    with pytest.raises(InputError, match="1000 Laplacian modes asked for, the mesh has 529"):
        harmonics(trajectory, count=1000)
