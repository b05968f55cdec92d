"""Meshes of boxes, their facets, edges and places: against grids counted in plain loops and on paper."""

from collections import Counter
from dataclasses import replace
from itertools import product

import meshio
import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.files import write_mesh
from physics.mesh.mesh import Mesh, closure, pieces, unique_edges
from physics.mesh.shapes.boxes import faces
from physics.scene import Body, read_body
from physics.schema import InputError
from tests.full_disk import full_after

SOLID = ("prism", "tetrahedron", "hexahedron")
LENGTH, WIDTH, HEIGHT = 0.6, 0.2, 0.1  # [m] 3 x 2 x 4 cells of 0.2 x 0.1 x 0.025 m


def box(cell, shape="beam"):
    return build_mesh(Body(shape=shape, length=LENGTH, width=WIDTH, height=HEIGHT, cells=(3, 2, 4), cell=cell))


def rectangle(cell):
    return build_mesh(Body(shape="plate", length=LENGTH, width=WIDTH, cells=(3, 2), cell=cell))


@pytest.mark.parametrize("shape", ["beam", "plate"])
@pytest.mark.parametrize("cell, share", [("hexahedron", 1), ("prism", 2), ("tetrahedron", 6)])
def test_the_cells_of_a_box_are_all_of_the_same_volume(cell, share, shape):
    """A brick of 0.2 x 0.1 x 0.025 m in one hexahedron, two prisms or six tetrahedra; 24 bricks, 4 x 3 x 5 nodes."""
    mesh = box(cell, shape)
    x = mesh.points[mesh.cells]  # (C, k, 3)
    a, b, c = {"hexahedron": (1, 3, 4), "prism": (1, 2, 3), "tetrahedron": (1, 2, 3)}[cell]  # the neighbours of corner 0
    volume = np.linalg.det(x[:, (a, b, c)] - x[:, :1]) / {"hexahedron": 1, "prism": 2, "tetrahedron": 6}[cell]
    np.testing.assert_allclose(volume, np.full(24 * share, 0.2 * 0.1 * 0.025 / share), rtol=1e-12)  # rounding
    assert mesh.cell == cell and mesh.dimension == 3 and mesh.cells.dtype == np.int64
    grid = [(0.2 * i, 0.1 * j, 0.025 * k) for i, j, k in product(range(4), range(3), range(5))]
    order = np.lexsort(np.round(mesh.points, 9).T[::-1])  # by x, then y, then z, as the loop goes
    np.testing.assert_allclose(mesh.points[order], grid, atol=1e-15)


@pytest.mark.parametrize("shape, normal", [("beam", 0), ("plate", 2)])
def test_prisms_and_hexahedra_stand_on_layers_across_x_in_a_beam_and_across_z_in_a_plate(shape, normal):
    for cell, n in (("prism", 3), ("hexahedron", 4)):
        mesh = box(cell, shape)
        x = mesh.points[mesh.cells]
        step = np.zeros(3)
        step[normal] = (0.2, None, 0.025)[normal]
        np.testing.assert_allclose(x[:, n:] - x[:, :n], np.broadcast_to(step, x[:, :n].shape), atol=1e-15)
        assert np.ptp(x[:, :n, normal], axis=1).max() == 0


@pytest.mark.parametrize("shape, normal", [("beam", 0), ("plate", 2), ("rectangle", 2)])
def test_diagonals_alternate_like_a_chess_board(shape, normal):
    """On the square (i, j) from corner (i, j) to (i + 1, j + 1) where i + j is even; axes y, z of a beam, x, y of a plate."""
    mesh = rectangle("triangle") if shape == "rectangle" else box("prism", shape)
    sizes = np.array([0.2, 0.1, 0.025])
    across = [axis for axis in range(3) if axis != normal]
    for triangle in mesh.cells[:, :3]:
        at = np.round(mesh.points[triangle][:, across] / sizes[across]).astype(int)
        (i, j), corners = at.min(axis=0), {tuple(row) for row in at.tolist()}
        diagonal = {(i, j), (i + 1, j + 1)} if (i + j) % 2 == 0 else {(i + 1, j), (i, j + 1)}
        assert diagonal <= corners and len(corners) == 3
        side, other = at[1] - at[0], at[2] - at[0]
        assert side[0] * other[1] - side[1] * other[0] == 1  # counter-clockwise


def test_nodes_of_a_box_are_numbered_along_the_layers():
    """Beam: z fastest, then y, then x. Plate: its layers lie across z, so y is fastest, then x, then z."""
    beam, plate = box("hexahedron").points, box("hexahedron", "plate").points
    np.testing.assert_allclose(beam[[0, 1, 5, 15, 59]], [(0, 0, 0), (0, 0, 0.025), (0, 0.1, 0), (0.2, 0, 0), (0.6, 0.2, 0.1)], atol=1e-15)
    np.testing.assert_allclose(plate[[0, 1, 3, 12, 59]], [(0, 0, 0), (0, 0.1, 0), (0.2, 0, 0), (0, 0, 0.025), (0.6, 0.2, 0.1)], atol=1e-15)
    assert box("hexahedron").cells[0].tolist() == [0, 5, 6, 1, 15, 20, 21, 16]  # node (i, j, k) is 15 i + 5 j + k
    assert box("hexahedron").cells[-1].tolist() == [38, 43, 44, 39, 53, 58, 59, 54]  # from (2, 1, 3)


def test_three_tetrahedra_of_each_prism_meet_those_beside_it():
    """Facets inside are shared by two; what is left outside covers the box: two triangles for each square of its sides."""
    for shape in ("beam", "plate"):
        mesh = box("tetrahedron", shape)
        count = Counter(tuple(sorted(cell[k] for k in facet)) for cell in mesh.cells.tolist() for facet in CELLS["tetrahedron"].facets)
        assert set(count.values()) == {1, 2}
        assert sum(n == 1 for n in count.values()) == 2 * 2 * (3 * 2 + 2 * 4 + 4 * 3)


def test_a_plane_plate_is_a_grid_of_rectangles():
    mesh = rectangle("quadrilateral")
    assert mesh.cells.tolist() == [[3 * i + j, 3 * (i + 1) + j, 3 * (i + 1) + j + 1, 3 * i + j + 1] for i in range(3) for j in range(2)]
    np.testing.assert_allclose(mesh.points, [(0.2 * i, 0.1 * j, 0) for i in range(4) for j in range(3)], atol=1e-15)
    triangles = rectangle("triangle")
    assert triangles.dimension == mesh.dimension == 2 and len(triangles.cells) == 12
    assert np.array_equal(triangles.points, mesh.points)
    x = triangles.points[triangles.cells]
    area = np.linalg.det(x[:, 1:, :2] - x[:, :1, :2]) / 2
    np.testing.assert_allclose(area, 0.2 * 0.1 / 2, rtol=1e-12)
    assert triangles.surface[0] is triangles.cells and len(triangles.surface) == 1  # all of it is seen
    assert triangles.boundary[0].shape == (10, 2)  # 3 + 2 + 3 + 2 edges around it


def test_places_of_a_box_are_its_sides():
    mesh = box("prism")
    for name, axis, end in (("x-min", 0, 0), ("x-max", 0, LENGTH), ("y-min", 1, 0), ("y-max", 1, WIDTH), ("z-min", 2, 0),
                            ("z-max", 2, HEIGHT)):
        assert mesh.places[name].tolist() == [i for i, point in enumerate(mesh.points) if abs(point[axis] - end) < 1e-6]
    assert list(mesh.places) == ["x-min", "x-max", "y-min", "y-max", "z-min", "z-max"]
    plane = rectangle("triangle")
    assert list(plane.places) == ["x-min", "x-max", "y-min", "y-max"]
    assert [len(nodes) for nodes in plane.places.values()] == [3, 3, 4, 4]


def test_a_node_is_on_a_side_up_to_a_billionth_of_the_largest_side():
    extent = (4.0, 1.0, 2.0)  # so up to 4e-9 m
    points = np.array([(3e-9, 0.5, 0.5), (5e-9, 0.5, 0.5), (-3e-9, 0.5, 0.5), (-5e-9, 0.5, 0.5), (4 - 3e-9, 0.5, 0.5), (4 - 5e-9, 0.5, 0.5),
                       (1, 1 + 3e-9, 1), (1, 1 + 5e-9, 1), (1, 0.5, 2 + 3e-9), (1, 0.5, 2 - 5e-9)])
    assert {name: nodes.tolist() for name, nodes in faces(points, extent).items()} == {
        "x-min": [0, 2], "x-max": [4], "y-min": [], "y-max": [6], "z-min": [], "z-max": [8]}


@pytest.mark.parametrize("cell", SOLID)
def test_the_boundary_is_what_one_cell_alone_has_as_that_cell_lists_it(cell):
    mesh = box(cell)
    for found, n in zip(mesh.boundary, {"prism": (3, 4), "tetrahedron": (3,), "hexahedron": (4,)}[cell], strict=True):
        all_of_them = [tuple(row[k] for k in facet) for facet in CELLS[cell].facets if len(facet) == n for row in mesh.cells.tolist()]
        count = Counter(tuple(sorted(facet)) for facet in all_of_them)
        assert found.tolist() == [list(facet) for facet in all_of_them if count[tuple(sorted(facet))] == 1]
    # By the divergence theorem the outward surface holds the volume: 1/3 of the sum of x . n A, A n the facet's area.
    volume = 0.0
    for facets in mesh.surface:
        x = mesh.points[facets]
        last = x[:, 3] if facets.shape[1] == 4 else x[:, 0]  # area of a quadrilateral: half the product of its diagonals
        volume += (x.mean(axis=1) * np.cross(x[:, 2] - x[:, 0], last - x[:, 1])).sum() / 6
    assert volume == pytest.approx(LENGTH * WIDTH * HEIGHT, rel=1e-12)


def test_edges_are_each_once_the_smaller_node_first():
    for mesh in (box("tetrahedron"), rectangle("quadrilateral")):
        expected = sorted({tuple(sorted((row[i], row[j]))) for row in mesh.cells.tolist() for i, j in CELLS[mesh.cell].edges})
        assert mesh.edges.tolist() == [list(pair) for pair in expected]
    assert unique_edges(np.array([[7, 4, 5]]), "triangle").tolist() == [[4, 5], [4, 7], [5, 7]]


def test_places_in_common():
    mesh = box("hexahedron")
    assert mesh.place("y-max").tolist() == mesh.places["y-max"].tolist()
    for where, at in (("x-max z-min", (LENGTH, None, 0)), ("z-max  x-min y-max", (0, WIDTH, HEIGHT))):
        expected = [i for i, p in enumerate(mesh.points) if all(w is None or abs(c - w) < 1e-9 for c, w in zip(p, at, strict=True))]
        assert mesh.place(where).tolist() == expected and len(expected) in (3, 1)
    with pytest.raises(InputError, match="the places 'x-min x-max' have no node in common"):
        mesh.place("x-min x-max")
    with pytest.raises(InputError, match=r"no place named 'x-mim' in the mesh: there are x-min, x-max, .*z-max; did you mean 'x-min'"):
        mesh.place("x-mim")
    with pytest.raises(InputError, match="no place named 'left'"):
        mesh.place("x-min left")
    with pytest.raises(InputError, match="no place named ''"):
        mesh.place("")
    with pytest.raises(InputError, match="there are none at all, so say where it lies"):
        Mesh(mesh.points, mesh.cells, "hexahedron", {}).place("x-min")
    assert Mesh(mesh.points, mesh.cells, "hexahedron", {"two words": np.array([3])}).place("two words").tolist() == [3]


def test_facets_of_a_side_are_its_squares_and_no_others():
    """The nodes of an inner facet may all lie on the boundary: one brick thick, z-min and z-max have all nodes of it."""
    mesh = build_mesh(Body(length=2.0, width=1.0, height=1.0, cells=(2, 1, 1), cell="hexahedron"))
    assert np.sort(mesh.facets("x-min")[0]).tolist() == [[0, 1, 2, 3]]
    assert np.sort(mesh.facets("y-max")[0]).tolist() == [[2, 3, 6, 7], [6, 7, 10, 11]]
    prisms = box("prism")
    triangles, rectangles = prisms.facets("x-max")
    assert len(triangles) == 2 * 2 * 4 and len(rectangles) == 0 and np.isin(triangles, prisms.places["x-max"]).all()
    triangles, rectangles = prisms.facets("z-min")
    assert len(triangles) == 0 and len(rectangles) == 3 * 2


def test_what_a_place_of_a_shape_is_made_of():
    mesh = build_mesh(Body(length=2.0, width=1.0, height=1.0, cells=(2, 1, 1), cell="prism"))  # node (i, j, k): 4 i + 2 j + k
    found = mesh.entities("x-min")  # one square in two triangles, cut from (0, 0) to (1, 1)
    assert {k: rows.tolist() for k, rows in found.items() if len(rows)} == {
        1: [[0], [1], [2], [3]], 2: [[0, 1], [0, 2], [0, 3], [1, 3], [2, 3]], 3: [[0, 1, 3], [0, 2, 3]]}
    edge = mesh.entities("x-min z-max")
    assert {k: rows.tolist() for k, rows in edge.items() if len(rows)} == {1: [[1], [3]], 2: [[1, 3]]}
    side = mesh.entities("y-max")
    assert side[2].tolist() == [[2, 3], [2, 6], [3, 7], [6, 7], [6, 10], [7, 11], [10, 11]]
    assert side[4].tolist() == [[2, 3, 6, 7], [6, 7, 10, 11]]


def test_groups_of_a_file_are_what_the_file_says():
    """A square of the side x-min only, and a line: facets and entities are those of the parts, not all between their nodes."""
    built = box("hexahedron")
    square, line = np.array([[1, 0, 5, 6]]), np.array([[0, 1], [1, 2]])
    mesh = Mesh(built.points, built.cells, "hexahedron", {"patch": np.array([0, 1, 5, 6]), "wire": np.array([0, 1, 2]),
                                                          "all": np.arange(60)},
                {"patch": [("quadrilateral", square)], "wire": [("line", line)], "all": [("hexahedron", built.cells)]})
    assert np.sort(mesh.facets("patch")[0]).tolist() == [[0, 1, 5, 6]]
    assert [len(facets) for facets in mesh.facets("wire")] == [0]
    assert len(mesh.facets("all")[0]) == 2 * (3 * 2 + 2 * 4 + 4 * 3)
    assert {k: rows.tolist() for k, rows in mesh.entities("patch").items()} == {
        1: [[0], [1], [5], [6]], 2: [[0, 1], [0, 5], [1, 6], [5, 6]], 4: [[0, 1, 5, 6]]}
    assert {k: rows.tolist() for k, rows in mesh.entities("wire").items()} == {1: [[0], [1], [2]], 2: [[0, 1], [1, 2]]}
    assert {k: rows.tolist() for k, rows in mesh.entities("wire patch").items()} == {1: [[0], [1]], 2: [[0, 1]]}
    assert {k: len(rows) for k, rows in mesh.entities("all").items()} == {1: 60, 2: 133, 4: 98, 8: 24}  # Euler: 60 - 133 + 98 - 24 = 1


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron", "triangle", "quadrilateral"])
def test_a_set_of_nodes_is_made_of_all_that_lies_between_them_on_the_boundary(cell):
    """Of the outer facets, their edges and their nodes those whose every node is in the set, also where no facet is."""
    plane = cell in ("triangle", "quadrilateral")
    body = Body(length=3.0, width=2.0, cells=(3, 2) if plane else (3, 2, 2), cell=cell, **{"shape": "plate"} if plane else {"height": 2.0})
    mesh, draw = build_mesh(body), np.random.default_rng(0)
    facets = [facet for some in mesh.boundary for facet in some.tolist()]
    edges = [{*pair} for pair in zip(*(np.concatenate([np.roll(some, shift, axis=1).ravel().tolist() for some in mesh.boundary])
                                       for shift in (0, 1)), strict=True)]
    chosen = [np.sort(draw.permutation(len(mesh.points))[:count]) for count in (2, len(mesh.points) // 3, len(mesh.points) // 2)]
    chosen.append(np.flatnonzero((mesh.points[:, 1:] == 0).all(axis=1)))  # an edge of the body
    for nodes in chosen:
        inside, expected = set(nodes.tolist()), {}
        for rows in (map(set, facets), edges):
            for row in rows:
                if row <= inside:
                    expected.setdefault(len(row), set()).add(tuple(sorted(row)))
        found = replace(mesh, places={"some": nodes}).entities("some")
        assert found[1].ravel().tolist() == nodes.tolist()
        assert {k: rows.tolist() for k, rows in found.items() if k > 1 and len(rows)} == {
            k: sorted(map(list, rows)) for k, rows in expected.items()}


def test_all_that_a_prism_is_made_of():
    found = closure([("prism", np.array([[9, 7, 5, 3, 2, 1]])), ("vertex", np.array([[4]]))])
    assert {k: rows.tolist() for k, rows in found.items()} == {
        1: [[1], [2], [3], [4], [5], [7], [9]], 2: [[1, 2], [1, 3], [1, 5], [2, 3], [2, 7], [3, 9], [5, 7], [5, 9], [7, 9]],
        3: [[1, 2, 3], [5, 7, 9]], 4: [[1, 2, 5, 7], [1, 3, 5, 9], [2, 3, 7, 9]], 6: [[1, 2, 3, 5, 7, 9]]}


def test_pieces_hang_together_by_cells():
    """Two cells that share one corner are one piece; a node of no cell is a piece of its own."""
    points = np.zeros((9, 3))
    cells = np.array([[0, 5, 2], [7, 1, 4], [2, 3, 8]])
    assert [piece.tolist() for piece in pieces(Mesh(points, cells, "triangle", {}))] == [[0, 2, 3, 5, 8], [1, 4, 7], [6]]
    assert [piece.tolist() for piece in pieces(box("prism"))] == [list(range(60))]


@pytest.mark.parametrize("cell, kind", [("prism", "wedge"), ("tetrahedron", "tetra"), ("hexahedron", "hexahedron"),
                                        ("quadrilateral", "quad"), ("triangle", "triangle")])
def test_a_written_mesh_is_read_by_meshio(tmp_path, cell, kind):
    mesh = box(cell) if cell in SOLID else rectangle(cell)
    values = {"one": np.arange(len(mesh.points)) * 0.5, "three": 2.0 * mesh.points + 1}
    write_mesh(tmp_path / "new" / "folder" / "part.vtu", mesh, values)
    write_mesh(tmp_path / "new" / "folder" / "part.vtu", mesh, values)  # a folder that is there already does not matter
    found = meshio.read(tmp_path / "new" / "folder" / "part.vtu")
    assert [block.type for block in found.cells] == [kind] and np.array_equal(found.cells[0].data, mesh.cells)
    assert np.array_equal(found.points, mesh.points)
    assert set(found.point_data) == {"one", "three"} and all(np.array_equal(found.point_data[key], values[key]) for key in values)


def test_on_a_full_disk_a_mesh_is_not_there_and_the_error_says_its_name(tmp_path):
    with full_after(200), pytest.raises(OSError) as error:
        write_mesh(tmp_path / "part.vtu", box("prism"), {})
    assert error.value.filename == str(tmp_path / "part.vtu") and not list(tmp_path.iterdir())


def test_every_shape_is_built_by_its_own_rules(tmp_path):
    assert "hole" in build_mesh(read_body({"body": {"shape": "channel", "cell_size": 0.1}})).places
    write_mesh(tmp_path / "part.vtu", box("prism"), {})
    assert np.array_equal(build_mesh(Body(shape="file", path=str(tmp_path / "part.vtu"))).points, box("prism").points)
    with pytest.raises(InputError, match="prisms are of first order only"):
        build_mesh(Body(shape="file", path=str(tmp_path / "part.vtu"), order=2))
