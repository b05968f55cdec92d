"""Cells of second order with curved sides, held against closed forms: a ring's Laplacian modes by Bessel functions, its area and volume."""

import meshio
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv, jvp, yv, yvp

from physics.mesh.cell import CELLS
from physics.mesh.files import read_mesh
from physics.mesh.formats.raw import VTK_MIDDLES
from physics.mesh.shapes.boxes import box, rectangle
from physics.mesh.sound.curved import complete, entities, smallest_jacobian
from physics.modes.elastic import elastic_modes
from physics.modes.laplacian import laplacian_modes
from physics.scene import Body, read_scene
from physics.schema import InputError

NAMES = {"triangle": "triangle6", "quadrilateral": "quad9", "tetrahedron": "tetra10", "hexahedron": "hexahedron27"}


def bent(x):
    """A half ring of radii 0.5 and 1 from the unit square (x to the angle, y to the radius); z stays."""
    angle, radius = np.pi * (1 - x[..., 0]), 0.5 + 0.5 * x[..., 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), x[..., 2]], axis=-1)


def half_ring(cell, path, *, faces=True, along=12, across=3):
    """The file of a half ring whose middle nodes lie where they should; returns it."""
    plane = CELLS[cell].dimension == 2
    body = Body(shape="plate" if plane else "beam", length=1.0, width=1.0, height=None if plane else 0.2, cell=cell,
                cells=(along, across) if plane else (along, across, 1))
    mesh = rectangle(body) if plane else box(body)
    local = VTK_MIDDLES[cell] if faces else VTK_MIDDLES[cell][:len(CELLS[cell].edges)]
    middle = np.stack([mesh.points[mesh.cells[:, list(corners)]].mean(axis=1) for corners in local], axis=1)  # (C, m, 3)
    places, number = np.unique(middle.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    cells = np.concatenate([mesh.cells, len(mesh.points) + number.reshape(len(mesh.cells), -1)], axis=1)
    name = NAMES[cell] if faces else {"quadrilateral": "quad8", "hexahedron": "hexahedron20"}[cell]
    meshio.Mesh(bent(np.concatenate([mesh.points, places])), [(name, cells)]).write(path)
    return path


def bessel():
    """The lowest k^2 with d phi / dr = 0 at r = 0.5 and 1: phi = (A J_1 + B Y_1)(k r) cos(angle), also of the half ring."""
    return brentq(lambda k: jvp(1, k) * yvp(1, k / 2) - jvp(1, k / 2) * yvp(1, k), 1.0, 1.6) ** 2


@pytest.mark.parametrize("cell, faces", [("triangle", True), ("quadrilateral", True), ("quadrilateral", False), ("tetrahedron", True),
                                         ("hexahedron", True), ("hexahedron", False)])
def test_curved_sides_have_the_modes_of_the_ring_and_straight_ones_those_of_a_polygon(tmp_path, cell, faces):
    path = half_ring(cell, tmp_path / "ring.vtu", faces=faces)
    curved, straight = (laplacian_modes(Body(shape="file", path=str(path), order=2), count=2, dirichlet=[], mesh=mesh)
                        for mesh in (read_mesh(path, order=2), read_mesh(path)))
    assert curved.eigenvalues[1] == pytest.approx(bessel(), rel=4e-4)
    assert abs(straight.eigenvalues[1] / bessel() - 1) > 10 * abs(curved.eigenvalues[1] / bessel() - 1)
    told = "cells of second order: their sides are taken as straight; order = 2 keeps them curved"
    assert told in straight.remarks and told not in curved.remarks


def breathing(young, poisson, density):
    """[Hz] of a ring of radii 0.5 and 1 that grows and shrinks in plane strain: u = A J_1(k r) + B Y_1(k r), no stress at its sides."""
    lmbda, mu = young * poisson / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)

    def stress(function, slope, k, r):
        return (lmbda + 2 * mu) * k * slope(1, k * r) + lmbda * function(1, k * r) / r

    def both(k):
        (ja, ya), (jb, yb) = ((stress(jv, jvp, k, r), stress(yv, yvp, k, r)) for r in (0.5, 1.0))
        return ja * yb - jb * ya

    return brentq(both, 1.0, 1.8) * np.sqrt((lmbda + 2 * mu) / density) / 2 / np.pi


@pytest.mark.parametrize("cell", list(NAMES))
def test_a_curved_ring_breathes_at_the_frequency_of_theory_and_one_of_straight_sides_faster(tmp_path, cell):
    """Half of it, held by its mirror plane, and across."""
    path = half_ring(cell, tmp_path / "ring.vtu", along=6, across=2)
    planes = [([0, 0, 0], [0, 1, 0], "y")] + [([0, 0, z], [0, 0, 1], "z") for z in (0.0, 0.2)] * (CELLS[cell].dimension == 3)
    held = [{"where": {"plane": at, "normal": normal, "within": 1e-9}, "fixed": axis} for at, normal, axis in planes]
    scene = read_scene({"body": {"shape": "file", "path": str(path), "order": 2}, "material": {"young_modulus": 2e6, "poisson_ratio": 0.3},
                        "support": held})
    off = []
    for mesh in (read_mesh(path, order=2), read_mesh(path)):
        modes = elastic_modes(scene, count=6, mesh=mesh)
        radial = mesh.points * [1, 1, 0] / np.linalg.norm(mesh.points[:, :2], axis=1)[:, None]
        alike = abs((modes.shapes * radial).sum(axis=(1, 2))) / np.linalg.norm(modes.shapes, axis=(1, 2)) / np.linalg.norm(radial)
        assert alike.max() > 0.95
        off.append(modes.frequencies_hz[int(alike.argmax())] / breathing(2e6, 0.3, 1000.0) - 1)
    assert abs(off[0]) < 1e-3 and off[1] > 0.01, off


def test_a_middle_node_in_a_wrong_place_turns_a_curved_cell_over(tmp_path):
    found = meshio.read(half_ring("quadrilateral", tmp_path / "ring.vtu"))
    found.points[found.cells[0].data[0, 4]] = found.points[found.cells[0].data[0, 1]] * 1.5
    found.write(tmp_path / "ring.vtu")
    with pytest.raises(InputError, match="of 36 curved cells are inside out somewhere, the first one at"):
        read_mesh(tmp_path / "ring.vtu", order=2)
    assert read_mesh(tmp_path / "ring.vtu").middles == {}


def test_two_cells_with_different_middles_on_one_side_are_refused(tmp_path):
    found = meshio.read(half_ring("triangle", tmp_path / "ring.vtu"))
    cells, points = found.cells[0].data.copy(), found.points
    points = np.concatenate([points, points[[cells[0, 4]]] + 0.01])
    cells[0, 4] = len(points) - 1
    shared = sum((np.isin(cells[:, :3], cells[0, [1, 2]])).sum(axis=1) == 2)
    meshio.Mesh(points, [("triangle6", cells)]).write(tmp_path / "ring.vtu")
    assert shared == 2
    with pytest.raises(InputError, match="two cells have different middle nodes on a side that they share"):
        read_mesh(tmp_path / "ring.vtu", order=2)


@pytest.mark.parametrize("cell", list(NAMES))
def test_the_jacobian_of_a_curved_cell_is_the_slope_of_its_map(tmp_path, cell):
    """Of one cell the smallest determinant is about its share of the ring, and with straight sides exactly the straight cell's."""
    mesh = read_mesh(half_ring(cell, tmp_path / "ring.vtu", along=20, across=4), order=2)
    least = smallest_jacobian(mesh.points, mesh.cells, cell, mesh.middles)
    whole = np.pi * 0.5 / 80 / 2 * 0.75 * 2 * (0.2 if CELLS[cell].dimension == 3 else 1.0)  # [m2] or [m3] of a cell at radius 0.75
    assert (least > 0.5 * whole).all() and (least < 1.5 * whole).all()


def one_cube(bend):
    """A unit cube of one hexahedron, moved by a function of places, and what its edges, faces and inside have for middles."""
    mesh = box(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="hexahedron"))
    middles = {}
    for group in entities("hexahedron"):
        rows = np.unique(np.sort(mesh.cells[0, np.array(group)], axis=1), axis=0)
        middles[rows.shape[1]] = rows, bend(mesh.points[rows].mean(axis=1))
    return bend(mesh.points), mesh.cells, middles


def test_the_smallest_determinant_is_that_of_a_map_which_the_cell_has_exactly():
    """X = x + a y^2 z^2, Y = y + a x^2, Z = z has det J = 1 - 4 a^2 x y z^2, which is least at the far corner."""
    for a in (0.2, 0.45):
        def bend(x, a=a):
            return x + a * np.stack([x[..., 1]**2 * x[..., 2]**2, x[..., 0]**2, 0 * x[..., 0]], axis=-1)
        points, cells, middles = one_cube(bend)
        assert smallest_jacobian(points, cells, "hexahedron", middles) == pytest.approx([1 - 4 * a**2])


def test_faces_without_a_node_lie_where_the_edges_put_them():
    """A serendipity cell: its map x + 0.3 (y^2 + y z^2, x^2 z, x y) is one of the functions of twenty nodes."""
    def bend(x):
        return x + 0.3 * np.stack([x[..., 1]**2 + x[..., 1] * x[..., 2]**2, x[..., 0]**2 * x[..., 2], x[..., 0] * x[..., 1]], axis=-1)
    points, cells, middles = one_cube(bend)
    found = complete(points, cells, "hexahedron", {2: middles[2]})
    for k in (2, 4, 8):
        assert np.array_equal(found[k][0], middles[k][0]) and found[k][1] == pytest.approx(middles[k][1])
