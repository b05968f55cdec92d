"""Laplacian modes without a solver library, against exact ones and against finite elements by dolfinx."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from datagen.files.trajectory import AIRFOIL, HANDLE, INFLOW, OUTFLOW, WALL, at_rest
from learning.segments.harmonics import _laid_flat, harmonics, laplacian
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.modes.laplacian import laplacian_modes
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


# on meshes small enough for dense matrices

def line(h):
    """Stiffness and mass of a linear element of length h."""
    return np.array([[1, -1], [-1, 1]]) / h, np.array([[2, 1], [1, 2]]) * h / 6


def of_simplices(points, cells):
    """Stiffness and lumped mass of triangles or tetrahedra: gradients are the rows of the inverse of their sides."""
    nodes, corners = len(points), len(cells[0])
    stiffness, mass = np.zeros((nodes, nodes)), np.zeros(nodes)
    for cell in cells:
        sides = (points[cell[1:]] - points[cell[0]])[:, :corners - 1]  # rows
        gradient = np.linalg.inv(sides).T
        gradient = np.concatenate([[-gradient.sum(axis=0)], gradient])
        volume = abs(np.linalg.det(sides)) / (2 if corners == 3 else 6)
        for a in range(corners):
            mass[cell[a]] += volume / corners
            for b in range(corners):
                stiffness[cell[a], cell[b]] += volume * gradient[a] @ gradient[b]
    return stiffness, mass


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_matrices_of_simplices_are_their_definition(cell):
    mesh = block(cell, (3, 2) if cell == "triangle" else (3, 2, 1)).mesh
    bent = mesh.points + 0.05 * np.sin(7 * mesh.points[:, ::-1]) * ([1, 1, 0] if cell == "triangle" else [1, 1, 1]) + [3, -2, 0]
    for cells in (mesh.cells, mesh.cells[:, [1, 0, *range(2, mesh.cells.shape[1])]] if cell == "triangle" else mesh.cells):
        stiffness, mass = laplacian(Mesh(bent, cells, cell, {}))  # plane cells in either sense
        expected = of_simplices(bent, cells)
        assert np.allclose(stiffness.toarray(), expected[0], rtol=0, atol=1e-12) and np.allclose(mass, expected[1], rtol=1e-12)


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron", "prism"])
def test_matrices_of_one_box_are_products_of_those_of_its_sides(cell):
    # 0.5 x 0.25 x 0.2 m
    (kx, mx), (ky, my), (kz, mz) = line(0.5), line(0.25), line(0.2)
    corners = np.array([(i, j, k) for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    points = corners * [0.5, 0.25, 0.2] + [1, 2, 3]
    if cell == "prism":  # half of it: a triangle's matrices times those of a line
        keep = [0, 1, 3, 4, 5, 7]
        k3, _ = of_simplices(points[[0, 1, 3]], np.array([[0, 1, 2]]))
        m3 = (np.ones((3, 3)) + np.eye(3)) * 0.5 * 0.25 / 2 / 12
        expected, volume = np.kron(mz, k3) + np.kron(kz, m3), 0.0125
    elif cell == "hexahedron":
        keep, volume = list(range(8)), 0.025
        at = [(i, j, k) for i, j, k in corners]
        expected = np.array([[kx[a[0], b[0]] * my[a[1], b[1]] * mz[a[2], b[2]] + mx[a[0], b[0]] * ky[a[1], b[1]] * mz[a[2], b[2]]
                              + mx[a[0], b[0]] * my[a[1], b[1]] * kz[a[2], b[2]] for b in at] for a in at])
    else:
        keep, volume = [0, 1, 2, 3], 0.125
        points = points * [1, 1, 0]
        expected = np.array([[kx[a[0], b[0]] * my[a[1], b[1]] + mx[a[0], b[0]] * ky[a[1], b[1]] for b in corners[:4]] for a in corners[:4]])
    stiffness, mass = laplacian(Mesh(points[keep], np.arange(len(keep))[None], cell, {}))
    assert np.allclose(stiffness.toarray(), expected, rtol=0, atol=1e-12)
    assert np.allclose(mass, volume / len(keep), rtol=1e-12)  # lumped in equal parts


@pytest.mark.parametrize("kind, held", [(None, False), (HANDLE, True), (AIRFOIL, True), (INFLOW, True), (WALL, True), (OUTFLOW, False)])
def test_modes_are_those_of_the_dense_matrices(kind, held):
    trajectory = block("tetrahedron", (3, 2, 1), {} if kind is None else {"x-min": kind})
    stiffness, mass = of_simplices(trajectory.points, trajectory.mesh.cells)
    free = trajectory.points[:, 0] > 1e-9 if held else np.ones(24, bool)
    exact, vectors = eigh(stiffness[np.ix_(free, free)], np.diag(mass[free]))
    first = 0 if held else 1  # without the constant
    values, shapes = harmonics(trajectory, count=3)
    assert len(values) == 3 and values == pytest.approx(exact[first:first + 3], rel=1e-9) and (exact[0] > 1) == held
    assert not shapes[:, ~free].any() and np.allclose(shapes @ np.diag(mass) @ shapes.T, np.eye(3), atol=1e-9)
    for shape, vector in zip(shapes, vectors.T[first:], strict=False):
        assert abs(shape[free] * mass[free] @ vector) == pytest.approx(1, rel=1e-9)


def test_how_many_modes_there_are():
    trajectory = block("quadrilateral", (3, 2))  # 12 nodes, all free: 11 modes besides the constant, of which the solver finds 10
    assert len(harmonics(trajectory, count=10)[0]) == 10
    with pytest.raises(InputError, match="11 Laplacian modes asked for, the mesh has 12 nodes that are not held"):
        harmonics(trajectory, count=11)
    held = block("quadrilateral", (3, 2), {"x-min": WALL})  # 9 free nodes: 8 of their modes
    assert len(harmonics(held, count=8)[0]) == 8
    with pytest.raises(InputError, match="9 Laplacian modes asked for, the mesh has 9 nodes"):
        harmonics(held, count=9)
    square = block("quadrilateral", (4, 4))
    assert len(harmonics(square)[0]) == 2  # one across and one along, of the same eigenvalue
    assert len(harmonics(square, count=3)[0]) == 3 and len(harmonics(square, cluster=1e9)[0]) == 1 + 6


def test_a_warped_quadrilateral_is_laid_along_both_of_its_diagonals():
    """The unit square, its corners a tenth above and below in turn: seen along the normal of both diagonals it is the unit square."""
    corners = np.array([[0, 0, 0.1], [1, 0, -0.1], [1, 1, 0.1], [0, 1, -0.1]])
    turn = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3
    flat = _laid_flat((corners @ turn.T + [5, 6, 7])[None])[0]
    assert np.linalg.norm(flat[:, None] - flat, axis=2) == pytest.approx(np.linalg.norm(corners[:, None, :2] - corners[:, :2], axis=2))
    assert not flat[:, 2].any() and flat.mean(axis=0) == pytest.approx(0, abs=1e-15)


def test_a_cell_without_area_is_named():
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 1, 1], [2, 2, 2]]])
    with pytest.raises(InputError, match="cell 1 of the mesh has no area"):
        _laid_flat(flat)
    thin = flat.copy()
    thin[1, 2] += [1e-11, -1e-11, 0]
    assert _laid_flat(thin).shape == (2, 3, 3)


@pytest.mark.parametrize("unit", [2.0**-20, 2.0**20])
def test_the_unit_of_length_makes_no_difference(unit):
    plain = block("tetrahedron", (3, 2, 1))
    values, _ = harmonics(plain, count=3)
    other, _ = harmonics(replace(plain, points=unit * plain.points), count=3)
    assert unit**2 * other == pytest.approx(values, rel=1e-9)
