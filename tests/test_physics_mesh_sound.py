"""Meshes with one thing wrong: what is beyond doubt is put right and said, the rest is refused in a line that names the cell."""

import meshio
import numpy as np
import pytest

from physics.mesh import files as meshfile
from physics.mesh.files import read_mesh
from physics.mesh.formats.others import of_meshio
from physics.mesh.quality import det_f
from physics.mesh.shapes.boxes import box, rectangle
from physics.mesh.sound.cells import by_shape
from physics.modes.elastic import elastic_modes
from physics.scene import Body, read_scene
from physics.schema import InputError
from physics.solution import solve

KINDS = {"hexahedron": "hexahedron", "prism": "wedge", "tetrahedron": "tetra", "quadrilateral": "quad", "triangle": "triangle"}
TENSOR = [0, 1, 3, 2, 4, 5, 7, 6]
X_MIN = {"plane": [0, 0, 0], "normal": [1, 0, 0], "within": 1e-9}
X_MAX = {"plane": [0.4, 0, 0], "normal": [1, 0, 0], "within": 1e-9}


def beam(cell="hexahedron", cells=(4, 1, 1)):
    return box(Body(length=0.4, width=0.1, height=0.1, cells=cells, cell=cell))


@pytest.fixture
def read(monkeypatch):
    """`read_mesh` of points and cells in memory."""
    def of(points, cells, kind="hexahedron", order=1, **more):
        monkeypatch.setattr(meshfile, "_read", lambda path: of_meshio(meshio.Mesh(points, [(KINDS[kind], cells)], **more)))
        return read_mesh("a.vtu", order=order)
    return of


def frequencies(path_mesh, count=4):
    scene = read_scene({"body": {"length": 1.0, "width": 1.0, "height": 1.0, "cells": [1, 1, 1]}, "support": [{"where": X_MIN}],
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}})
    return elastic_modes(scene, mesh=path_mesh, count=count)


@pytest.mark.parametrize("kind", KINDS)
def test_a_cell_that_is_listed_twice_is_taken_once(read, kind):
    plane = kind in ("quadrilateral", "triangle")
    mesh = rectangle(Body(shape="plate", length=0.4, width=0.1, cells=(4, 1), cell=kind)) if plane else beam(kind)
    found = read(mesh.points, np.concatenate([mesh.cells, np.roll(mesh.cells[1:3], 1, axis=1) if kind == "triangle" else mesh.cells[1:3]]),
                 kind)
    assert np.array_equal(found.cells, mesh.cells) and found.remarks == ("2 cells are listed twice and taken once",)


def test_two_groups_of_the_same_cells_have_the_modes_of_one(read):
    mesh = beam()
    assert frequencies(read(mesh.points, np.concatenate([mesh.cells] * 2))).frequencies_hz == pytest.approx(
        [3.82586, 3.82586, 12.3362, 20.3992], rel=4e-6)


def test_hexahedra_that_are_folded_to_prisms_are_prisms(read):
    """Each hexahedron in two, as programs without prisms write them; the values are those of a file of prisms."""
    mesh = beam()
    a, b = mesh.cells[:, [0, 1, 2, 2, 4, 5, 6, 6]], mesh.cells[:, [0, 2, 3, 3, 4, 6, 7, 7]]
    found = read(mesh.points, np.concatenate([a, b]))
    assert found.cell == "prism" and found.remarks == ("cells with corners named twice are taken as prisms",)
    prisms = read(mesh.points, np.concatenate([mesh.cells[:, [0, 1, 2, 4, 5, 6]], mesh.cells[:, [0, 2, 3, 4, 6, 7]]]), "prism")
    assert sorted(map(sorted, found.cells.tolist())) == sorted(map(sorted, prisms.cells.tolist()))
    assert frequencies(found).frequencies_hz == pytest.approx(frequencies(prisms).frequencies_hz, rel=1e-9)
    with pytest.raises(InputError, match="cell 1 of 2 names a corner twice and is a prism; a body must be of one kind"):
        read(mesh.points, [mesh.cells[0], mesh.cells[1][[0, 1, 2, 2, 4, 5, 6, 6]]])


@pytest.mark.parametrize("kind, corners, shape", [
    ("hexahedron", [0, 1, 2, 2, 4, 5, 6, 6], "prism"), ("hexahedron", [0, 1, 2, 3, 0, 5, 6, 3], "prism"),
    ("hexahedron", [0, 1, 2, 2, 4, 4, 4, 4], "tetrahedron"), ("hexahedron", [0, 1, 2, 3, 4, 4, 4, 4], ""),
    ("prism", [0, 1, 2, 3, 3, 3], "tetrahedron"),
    ("hexahedron", [0, 1, 2, 3, 4, 5, 6, 0], ""), ("hexahedron", [0, 0, 0, 0, 4, 5, 6, 7], ""), ("prism", [0, 1, 1, 3, 4, 5], ""),
    ("quadrilateral", [0, 1, 2, 2], "triangle"), ("quadrilateral", [0, 1, 0, 3], ""), ("quadrilateral", [0, 0, 2, 3], "triangle"),
    ("triangle", [0, 1, 1], ""), ("tetrahedron", [0, 1, 2, 2], "")])
def test_what_a_cell_with_corners_named_twice_is(kind, corners, shape):
    (found, rows, cells), = by_shape(kind, np.array([corners]) + 10)
    assert found == shape and rows.tolist() == [0]
    if shape:
        assert sorted(cells[0]) == sorted(set(np.array(corners) + 10))


def test_the_folded_prism_keeps_its_volume_whichever_edge_is_folded(read):
    """Of a unit cube one edge of a face is folded onto the opposite one: half of it is left."""
    cube = box(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="hexahedron"))
    points, cell = cube.points, cube.cells[0]
    for face in ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)):
        folded = cell.copy()
        folded[[face[0], face[1]]] = cell[[face[3], face[2]]]
        found = read(points, [folded])
        x = found.points[found.cells[0]]
        assert found.cell == "prism" and np.linalg.det([x[1] - x[0], x[2] - x[0], x[3] - x[0]]) == pytest.approx(1.0)


def test_corners_in_a_wrong_order_are_refused_by_cell_and_node(read):
    mesh = beam()
    with pytest.raises(InputError, match=r"a.vtu: cell 0 of 4 is inside out at node \d+ \(4 of 4 cells are\): its corners seem to be "
                                         "listed row by row"):
        read(mesh.points, mesh.cells[:, TENSOR])
    wrong = mesh.cells.copy()
    wrong[2] = wrong[2][[1, 0, 2, 3, 4, 5, 6, 7]]
    with pytest.raises(InputError, match=r"cell 2 of 4 is inside out at node \d+: its corners are in a wrong order, or one of them"):
        read(mesh.points, wrong)


def test_a_node_pulled_through_a_cell_is_refused_and_one_on_a_line_is_said(read):
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    for place, words in ((0.6, None), (0.5, "flat corner"), (0.4, "inside out at node 2")):
        square[2, :2] = place
        if words and "inside" in words:
            with pytest.raises(InputError, match=words):
                read(square, [[0, 1, 2, 3]], "quadrilateral")
        else:
            assert [words in text for text in read(square, [[0, 1, 2, 3]], "quadrilateral").remarks] == ([True] if words else [])


def test_a_flat_corner_has_no_ratio_and_the_rest_of_the_cell_has(read):
    cube = box(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="hexahedron"))
    points = cube.points.copy()
    points[(points[:, :2] == 1).all(axis=1), :2] = 0.5  # an upright edge moves into the plane of two others
    found = read(points, cube.cells)
    assert "cell 0 of 1 has a flat corner" in found.remarks
    assert det_f(found.points, found.points * 0.1, found.cells, found.cell) == pytest.approx([1.331])


def test_nodes_at_one_place_are_no_side(read):
    mesh = beam()
    points = mesh.points.copy()
    points[mesh.cells[3, 6]] = points[mesh.cells[3, 5]]
    with pytest.raises(InputError, match=r"cell 3 of 4 has two corners in one place, nodes \d+ and \d+: a side without length"):
        read(points, mesh.cells)


def test_three_cells_at_one_face_and_cells_over_one_another_are_refused(read):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0.1, 0.1, 2]], float)
    cells = [[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 2, 5]]
    assert len(read(points, cells[:2], "tetrahedron").cells) == 2
    with pytest.raises(InputError, match="cell 0 of 3, cell 1 of 3, cell 2 of 3 share one side; a face has cells on two sides at most"):
        read(points, cells, "tetrahedron")
    with pytest.raises(InputError, match="cell 0 of 2 and cell 1 of 2 lie over one another"):
        read(points, [cells[0], cells[2]], "tetrahedron")


def test_a_node_on_the_side_of_another_cell_is_refused(read):
    """Two half squares beside a whole one: the node between them hangs on its side. Moved into the middle of nowhere it does not."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0.5, 0], [2, 0, 0], [2, 0.5, 0], [2, 1, 0]], float)
    cells = [[0, 1, 2, 3], [1, 5, 6, 4], [4, 6, 7, 2]]
    with pytest.raises(InputError, match="node 4 lies on a side of cell 0 of 3 and is none of its corners"):
        read(points, cells, "quadrilateral")
    points[4, 0] = 1.01
    assert len(read(points, cells, "quadrilateral").cells) == 3


def test_pieces_are_named_with_size_place_and_what_holds_them(read):
    mesh = beam()
    points = np.concatenate([mesh.points, mesh.points[8:12]])  # the middle section a second time
    cells = mesh.cells.copy()
    for row in (2, 3):
        cells[row] = np.where((cells[row] >= 8) & (cells[row] < 12), cells[row] + 12, cells[row])
    found = read(points, cells)
    assert found.remarks == (
        "the body is of 2 pieces that share no node: piece 1 has 2 cells from (0, 0, 0) to (0.2, 0.1, 0.1) m; piece 2 has 2 cells from "
        "(0.2, 0, 0) to (0.4, 0.1, 0.1) m; 4 nodes of one lie where another has one too: merge them if they belong together",)
    modes = frequencies(found, count=8)
    assert modes.rigid == modes.rigid_expected == 6
    at = "{ plane = [0.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0], within = 1e-09 }"
    assert f"held are piece 1 by {at}; piece 2 by nothing" in modes.remarks
    scene = read_scene({"body": {"length": 1.0, "width": 1.0, "height": 1.0, "cells": [1, 1, 1]}, "steps": {"count": 1},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "support": [{"where": X_MIN}],
                        "load": [{"where": X_MAX, "traction": [0, 0, 100.0]}]})
    with pytest.raises(InputError, match="6 rigid motions of one of 2 pieces left free: piece 2 has 2 cells"):
        solve(scene, mesh=found)
    assert solve(scene, mesh=mesh).failure == ""


def test_a_body_that_hinges_on_an_edge_is_not_loaded(read):
    """Two cubes that share one edge: the free one turns about it, which no rigid motion of the whole is."""
    cube = box(Body(length=0.1, width=0.1, height=0.1, cells=(1, 1, 1), cell="hexahedron"))
    points = np.concatenate([cube.points, cube.points + (0.1, 0.1, 0)])
    edge = {8 + i: j for i, x in enumerate(cube.points + (0.1, 0.1, 0)) for j, y in enumerate(cube.points) if np.allclose(x, y)}
    cells = np.concatenate([cube.cells, [[edge.get(node + 8, node + 8) for node in cube.cells[0]]]])
    found = read(points, cells)
    scene = read_scene({"body": {"length": 1.0, "width": 1.0, "height": 1.0, "cells": [1, 1, 1]}, "steps": {"count": 1},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "support": [{"where": X_MIN}],
                        "load": [{"acceleration": [0, 1.0, 0]}]})
    assert len(edge) == 2 and len(found.cells) == 2
    with pytest.raises(InputError, match="1 motion left free: parts of the mesh hang together at single nodes or edges"):
        solve(scene, mesh=found)


@pytest.mark.parametrize("scale, words", [(1e10, "a node lies 4e"), (1e-11, "a body of 4e-12 m"), (1e300, "a node lies 4e"),
                                          (np.inf, "not finite")])
def test_bodies_of_no_size_are_refused(read, scale, words):
    mesh = beam()
    with np.errstate(invalid="ignore"), pytest.raises(InputError, match=words):
        read(mesh.points * scale, mesh.cells)
