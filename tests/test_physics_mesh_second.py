"""Meshes made of second order: their nodes, places and surface, and files whose curved sides a solved body keeps."""

from dataclasses import replace

import meshio
import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.quality import cell_volumes
from physics.mesh.second import corners_only, cut_into_eight, is_curved, middle_nodes, second_order
from physics.mesh.shapes.boxes import box
from physics.scene import Body, read_scene
from physics.solution import solve
from tests.test_physics_mesh_curved import half_ring

SIDES = {"length": 2.0, "width": 1.0, "height": 3.0, "cells": (2, 1, 3)}


def test_ten_nodes_make_eight_tetrahedra_of_an_eighth_each_whose_sides_match():
    mesh = build_mesh(Body(**SIDES, cell="tetrahedron", order=2))
    small = cut_into_eight(mesh.cells)
    volumes = cell_volumes(mesh.points, small, "tetrahedron").reshape(-1, 8)
    np.testing.assert_allclose(volumes, cell_volumes(mesh.points, mesh.cells[:, :4], "tetrahedron")[:, None] / 8 * np.ones(8), rtol=1e-12)
    sides = np.sort(small[:, [(1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)]].reshape(-1, 3), axis=1)
    sides, count = np.unique(sides, axis=0, return_counts=True)
    assert set(count) == {1, 2}
    outside = mesh.points[sides[count == 1]]  # each lies in one of the six faces of the box
    flat = [(abs(outside[..., k] - at) < 1e-12).all(axis=1) for k, top in enumerate((2.0, 1.0, 3.0)) for at in (0.0, top)]
    assert np.any(flat, axis=0).all() and len(outside) == 2 * (2 * 1 + 1 * 3 + 2 * 3) * 2 * 4


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_the_node_in_the_middle_of_some_corners_lies_there_and_there_is_none_where_no_side_is(cell):
    mesh = build_mesh(Body(**SIDES, cell=cell, order=2))
    for local in CELLS[mesh.cell].middles:
        rows = mesh.cells[:, list(local)][::-1, ::-1]
        np.testing.assert_allclose(mesh.points[middle_nodes(mesh, rows)], mesh.points[rows].mean(axis=1), atol=1e-12)
        assert middle_nodes(mesh, rows * 0).tolist() == [-1] * len(rows)
    assert middle_nodes(corners_only(mesh), rows).tolist() == [-1] * len(rows)


def ordered(points):
    return points[np.lexsort(points.round(9).T)]


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_middles_lie_half_way_and_every_node_is_there_once(cell):
    """A lattice of half the distance: of hexahedra all of it, of tetrahedra where an edge has its middle."""
    first, mesh = box(Body(**SIDES, cell=cell)), build_mesh(Body(**SIDES, cell=cell, order=2))
    assert np.array_equal(mesh.points[:len(first.points)], first.points)
    assert np.array_equal(mesh.cells[:, :first.cells.shape[1]], first.cells)
    lattice = np.stack(np.meshgrid(np.linspace(0, 2, 5), np.linspace(0, 1, 3), np.linspace(0, 3, 7), indexing="ij"), axis=-1).reshape(-1, 3)
    assert len(mesh.points) == (len(lattice) if cell == "hexahedron" else len(first.points) + len(first.edges))
    places = CELLS[mesh.cell].places
    np.testing.assert_allclose(mesh.points[mesh.cells], CELLS[first.cell].shapes(places)[0] @ first.points[first.cells], atol=1e-14)
    if cell == "hexahedron":
        np.testing.assert_allclose(ordered(mesh.points), ordered(lattice), atol=1e-14)
    assert not is_curved(mesh) and np.array_equal(corners_only(mesh).cells, first.cells)
    assert {name: nodes.tolist() for name, nodes in corners_only(mesh).places.items()} == {
        name: nodes.tolist() for name, nodes in first.places.items()}


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_places_have_the_middles_and_facets_look_outward(cell):
    mesh = build_mesh(Body(**SIDES, cell=cell, order=2))
    for name, (axis, value) in {"x-min": (0, 0.0), "x-max": (0, 2.0), "z-max": (2, 3.0)}.items():
        assert set(mesh.place(name).tolist()) == set(np.flatnonzero(abs(mesh.points[:, axis] - value) < 1e-12).tolist())
        facets, = (part for part in mesh.facets(name) if len(part))
        assert facets.shape[1] == (6 if cell == "tetrahedron" else 9)
        x = mesh.points[facets]
        normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        assert (normal[:, axis] * (1 if name.endswith("max") else -1) > 0).all()
    assert set(mesh.place("x-min z-min").tolist()) == set(np.flatnonzero((mesh.points[:, [0, 2]] == 0).all(axis=1)).tolist())


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_what_can_be_seen_is_four_facets_for_each_and_has_all_nodes_of_the_surface(cell):
    mesh = build_mesh(Body(**SIDES, cell=cell, order=2))
    shown, = mesh.surface
    assert len(shown) == 4 * sum(map(len, mesh.boundary))
    x = mesh.points[shown]
    i, j = (1, 0) if cell == "tetrahedron" else (2, 0)
    area = np.cross(x[:, i] - x[:, j], x[:, -1] - x[:, 1 if cell == "hexahedron" else 0]) / 2
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(22.0)
    assert (x[:, :, 0] * area[:, None, 0]).mean(axis=1).sum() == pytest.approx(6.0)  # the volume, by Gauss's theorem: outward
    assert set(np.unique(shown)) == set(np.unique(np.concatenate([facets.ravel() for facets in mesh.boundary])))


def test_what_a_place_of_a_file_is_made_of_gets_middles_and_rows_that_are_no_sides_stay_counted():
    first = box(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="hexahedron"))
    first = replace(first, places={"face": np.arange(4, 8), "edge": first.cells[0, [0, 1]], "body": np.arange(8), "odd": np.arange(4)},
                    parts={"face": [("quadrilateral", first.cells[:, [4, 5, 6, 7]])], "edge": [("line", first.cells[:, [0, 1]])],
                           "body": [("hexahedron", first.cells)], "odd": [("quadrilateral", first.cells[:, [0, 2, 4, 6]])]})
    mesh = second_order(first)
    assert [(kind, rows.shape) for made in mesh.parts.values() for kind, rows in made] == [
        ("quadrilateral9", (1, 9)), ("line3", (1, 3)), ("hexahedron27", (1, 27)), ("quadrilateral9", (1, 9))]
    assert [len(mesh.place(name)) for name in ("face", "edge", "body")] == [9, 3, 27]
    assert [len(part) for part in mesh.facets("face")] == [1] and not sum(map(len, mesh.facets("odd")))
    assert mesh.region("body").all() and corners_only(mesh).parts["edge"][0][1].tolist() == first.parts["edge"][0][1].tolist()


@pytest.mark.parametrize("cell, faces", [("tetrahedron", True), ("hexahedron", True), ("hexahedron", False)])
def test_curved_sides_of_a_file_are_kept(tmp_path, cell, faces):
    """Half a ring of radii 0.5 and 1, 0.2 high; with straight sides its volume is that of a polygon."""
    path = half_ring(cell, tmp_path / "ring.vtu", faces=faces)
    mesh = build_mesh(Body(shape="file", path=str(path), order=2))
    exact = np.pi * 0.75 / 2 * 0.2
    assert is_curved(mesh) and cell_volumes(mesh.points, mesh.cells, mesh.cell).sum() == pytest.approx(exact, rel=2e-5)
    straight = build_mesh(Body(shape="file", path=str(path)))
    assert cell_volumes(straight.points, straight.cells, cell).sum() < (1 - 0.005) * exact


YOUNG, POISSON, PRESSURE, A, B = 1e6, 0.3, 1e3, 0.5, 1.0


def widened(radius):
    """Lame: u(r) = p a^2 r / (E (b^2 - a^2)) (1 + nu) (1 - 2 nu + b^2 / r^2) of a ring in plane strain under a pressure from inside."""
    return PRESSURE * A**2 * radius / (YOUNG * (B**2 - A**2)) * (1 + POISSON) * (1 - 2 * POISSON + B**2 / radius**2)


def pressed_ring(path, cell, along, across):
    """The solution of half of the ring on a file of curved cells."""
    half_ring(cell, path, along=along, across=across)
    scene = read_scene({
        "body": {"shape": "file", "path": str(path), "order": 2}, "steps": {"count": 1},
        "material": {"law": "linear", "young_modulus": YOUNG, "poisson_ratio": POISSON},
        "support": [{"where": {"plane": [0, 0, 0], "normal": [0, 1, 0], "within": 1e-9}, "fixed": "y"},
                    {"where": {"plane": [0, 0, 0], "normal": [0, 0, 1], "within": 1e-9}, "fixed": "z"},
                    {"where": {"plane": [0, 0, 0.2], "normal": [0, 0, 1], "within": 1e-9}, "fixed": "z"},
                    {"where": {"near": [0, 1, 0], "within": 1e-6}, "fixed": "x"}],
        "load": [{"where": "inner", "pressure": PRESSURE}]})
    mesh = build_mesh(scene.body)
    assert len(meshio.read(path).points) == len(mesh.points)
    inner = np.flatnonzero(abs(np.linalg.norm(mesh.points[:, :2], axis=1) - A) < 1e-6)
    return solve(scene, mesh=replace(mesh, places={"inner": inner}))


def error(solution):
    """Of the displacement, as the root of the mean square over the volume over that of all of it, and of the energy."""
    mesh, cell = solution.mesh, CELLS[solution.mesh.cell]
    values, slopes = cell.shapes(cell.points)
    x, u = (np.einsum("pn,cni->cpi", values, field[mesh.cells]) for field in (mesh.points, solution.displacement[-1]))
    volume = np.linalg.det(np.einsum("pnk,cni->cpik", slopes, mesh.points[mesh.cells])) * cell.weights
    radius = np.linalg.norm(x[..., :2], axis=-1)
    exact = x * [1, 1, 0] / radius[..., None] * widened(radius)[..., None]
    off, whole = (float(np.sqrt((((field) ** 2).sum(axis=-1) * volume).sum())) for field in (u - exact, exact))
    return off / whole, abs(solution.energy[-1] / (PRESSURE * widened(A) / 2 * np.pi * A * 0.2) - 1)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_a_ring_under_pressure_from_inside_widens_as_lame_says(tmp_path, cell):
    """Displacements are off by the third power of the size of the cells, the energy by the fourth."""
    coarse, fine = (error(pressed_ring(tmp_path / "ring.vtu", cell, 8 * n, 2 * n)) for n in (1, 2))
    assert fine[0] < 1e-3 and fine[1] < 2e-4
    assert np.log2(coarse[0] / fine[0]) > 2.6 and np.log2(coarse[1] / fine[1]) > 3.4, (coarse, fine)
