"""Small mesh files, in memory as meshio gives them: what becomes of each cell, node and group."""

import meshio
import numpy as np
import pytest

from physics.mesh import files as meshfile
from physics.mesh.files import read_mesh
from physics.mesh.formats.others import of_meshio
from physics.schema import InputError

CUBE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
CELLS = {  # meshio's name, our name, nodes of the cube in gmsh's order
    "triangle": ("triangle", [0, 1, 3]), "quad": ("quadrilateral", [0, 1, 2, 3]), "tetra": ("tetrahedron", [0, 1, 3, 4]),
    "wedge": ("prism", [0, 1, 3, 4, 5, 7]), "hexahedron": ("hexahedron", list(range(8)))}
MORE = {"triangle": "triangle6", "quad": "quad9", "tetra": "tetra10", "wedge": "wedge18", "hexahedron": "hexahedron27"}


@pytest.fixture
def read(monkeypatch):
    """`read_mesh` of a mesh in memory."""
    def of(points, blocks, order=1, **more):
        monkeypatch.setattr(meshfile, "_read", lambda path: of_meshio(meshio.Mesh(points, blocks, **more)))
        return read_mesh("a.msh", order=order)
    return of


def refused(read, words, *mesh, **more):
    with pytest.raises(InputError) as caught:
        read(*mesh, **more)
    assert str(caught.value).startswith("a.msh: ") and words in str(caught.value), str(caught.value)


@pytest.mark.parametrize("kind", CELLS)
def test_cells_stay_as_they_are_and_those_inside_out_are_mirrored(read, kind):
    """Of a mirrored cell the corners opposite to the first one of each face change places."""
    cell, nodes = CELLS[kind]
    found = read(CUBE, [(kind, [nodes])])
    assert found.cell == cell and len(found.points) == len(nodes) and np.array_equal(found.points[found.cells[0]], CUBE[nodes])
    idle = len(CUBE) - len(nodes)
    assert found.remarks == ((f"{idle} nodes of no cell left out",) if idle else ()) and found.places == {} and found.parts == {}
    mirror = CUBE * (-1, 1, 1)
    over = read(mirror, [(kind, [nodes, nodes])])
    assert len(over.cells) == 1 and over.remarks[0] == "1 cells are listed twice and taken once"
    assert "1 of 1 cells were inside out and have been turned" in over.remarks
    swapped = {"triangle": [0, 2, 1], "quad": [0, 3, 2, 1], "tetra": [0, 2, 1, 3], "wedge": [0, 2, 1, 3, 5, 4],
               "hexahedron": [0, 3, 2, 1, 4, 7, 6, 5]}[kind]
    for row in over.cells:
        assert np.array_equal(over.points[row], mirror[nodes][swapped])
    both = np.concatenate([CUBE + (5, 5, 0), mirror])  # each by itself
    mixed = read(both, [(kind, [nodes]), (kind, [[n + 8 for n in nodes]])])
    assert np.array_equal(mixed.points[mixed.cells[0]], both[nodes])
    assert np.array_equal(mixed.points[mixed.cells[1]], mirror[nodes][swapped])


@pytest.mark.parametrize("kind", CELLS)
def test_of_cells_of_second_order_the_corners_are_kept(read, kind):
    cell, nodes = CELLS[kind]
    extra = int("".join(filter(str.isdigit, MORE[kind]))) - len(nodes)
    points = np.concatenate([CUBE, np.full((extra, 3), 0.5) * (1, 1, cell not in ("triangle", "quadrilateral"))])
    found = read(points, [(MORE[kind], [nodes + list(range(8, 8 + extra))])])
    assert found.cell == cell and np.array_equal(found.points[found.cells[0]], CUBE[nodes])
    more = "" if cell == "prism" else "; order = 2 keeps them curved"
    assert found.remarks[-1] == f"cells of second order: their sides are taken as straight{more}"


@pytest.mark.parametrize("kind", CELLS)
def test_a_cell_without_volume_is_refused_and_a_thin_one_is_not(read, kind):
    """Volume over the product of its sides: 1e-11 is thin, 1e-13 is none."""
    cell, nodes = CELLS[kind]
    plane = cell in ("triangle", "quadrilateral")
    lean = np.array([(1, 0, 0), (2, 0, 0), (0, 0, 1)]) if plane else np.array([(1, 0, 0), (0, 1, 0), (0, 1, 0)])
    small = np.diag([0, 1, 0] if plane else [0, 0, 1])  # y, or z, leans over to x, or y, but for so much
    thin, none = (CUBE @ (lean + share * small) for share in (1e-11, 1e-13))
    for k, points in enumerate((thin, none)):
        points = np.concatenate([CUBE, points]) * 1e-3  # small cells: it is their own size that counts
        blocks = [(kind, [nodes, [n + 8 for n in nodes]])]
        if k == 0:
            found = read(points, blocks)
            assert np.array_equal(found.points[found.cells], points[[nodes, [n + 8 for n in nodes]]])
        else:
            refused(read, f"cell 1 of 2 has no {'area' if plane else 'volume'}", points, blocks)


def test_nodes_that_no_cell_of_the_body_has_are_dropped_and_the_others_move_up(read):
    points = np.concatenate([[(9, 9, 9)], CUBE[:4], [(8, 8, 8)], CUBE[4:]])
    found = read(points, [("line", [[0, 5]]), ("hexahedron", [[1, 2, 3, 4, 6, 7, 8, 9]])])
    assert np.array_equal(found.points, CUBE) and found.cells.tolist() == [list(range(8))]
    assert read(CUBE[:, :2], [("quad", [[0, 1, 2, 3]])]).points.tolist() == CUBE[:4].tolist()  # two coordinates: z = 0


def test_the_body_is_what_has_the_highest_dimension(read):
    blocks = [("triangle", [[0, 1, 2]]), ("tetra", [[0, 1, 3, 4]]), ("vertex", [[2]]), ("tetra", [[1, 2, 3, 6]])]
    found = read(CUBE, blocks)
    assert found.cell == "tetrahedron" and len(found.cells) == 2 and found.dimension == 3
    refused(read, "has hexahedron and tetrahedron cells; a body must be of one kind", CUBE, [*blocks, ("hexahedron", [list(range(8))])])
    refused(read, "has cells of kind 'pyramid'; known are vertex, line, triangle, quad, tetra, hexahedron, wedge", CUBE,
            [("pyramid", [[0, 1, 2, 3, 4]])])
    refused(read, "no cells in it", CUBE, [])
    refused(read, "has points and lines only", CUBE, [("vertex", [[0]]), ("line", [[0, 1]])])
    refused(read, "body.order = 2: prisms are of first order only", CUBE, [("wedge", [CELLS["wedge"][1]])], order=2)
    assert read(CUBE, blocks, order=2).cell == "tetrahedron" and read(CUBE, [("wedge", [CELLS["wedge"][1]])]).cell == "prism"


def test_nodes_that_are_not_there_or_nowhere_are_refused(read):
    for node, ok in ((7, True), (8, False), (-1, False)):
        blocks = [("tetra", [[0, 1, 3, node]])]
        if ok:
            assert len(read(CUBE, blocks).cells) == 1
        else:
            refused(read, "cell 0 of 1 names a node that is not there", CUBE, blocks)
    for value in (np.nan, np.inf):
        points = CUBE.copy()
        points[6, 1] = value
        refused(read, "node coordinates that are not finite", points, [("hexahedron", [list(range(8))])])
        assert len(read(points, [("tetra", [[0, 1, 3, 4]])]).cells) == 1  # of a node that is not used


def test_a_plane_body_lies_at_one_z(read):
    """Up to a billionth of its largest side, which is 4 m here."""
    for height, ok in ((3e-9, True), (5e-9, False), (1.0, False)):
        points = CUBE * (4, 1, 1) + (0, 0, 2)
        points[2, 2] += height
        if ok:
            assert len(read(points, [("quad", [[0, 1, 2, 3]])]).cells) == 1
        else:
            refused(read, f"a surface in space, from z = 2 to {2 + height:g}", points, [("quad", [[0, 1, 2, 3]])])


def test_groups_of_gmsh_by_name_by_number_and_of_any_dimension(read):
    """Tag 0 is no group; a name belongs to a tag and a dimension; one group may have several blocks."""
    far = np.concatenate([[(9, 9, 9)], CUBE])  # so all numbers move by one
    blocks = [("hexahedron", [list(range(1, 9))]), ("quad", [[1, 2, 3, 4], [5, 6, 7, 8]]), ("triangle", [[1, 2, 6], [2, 3, 7]]),
              ("line", [[1, 2], [0, 2]]),
              ("vertex", [[0], [7]])]
    tags = [np.array([4]), np.array([1, 2]), np.array([1, 0]), np.array([1, 3]), np.array([5, 5])]
    names = {"wall": np.array([1, 2]), "edge": np.array([1, 1]), "all": np.array([4, 3]), "other": np.array([2, 3]),
             "long": np.array([1, 2, 3])}
    for key in ("gmsh:physical", "medit:ref"):
        found = read(far, blocks, cell_data={key: tags}, field_data=names)
        assert {name: nodes.tolist() for name, nodes in found.places.items()} == {
            "all": list(range(8)), "wall": [0, 1, 2, 3, 5], "2": [4, 5, 6, 7], "edge": [0, 1], "5": [6]}
        assert [(kind, rows.tolist()) for kind, rows in found.parts["wall"]] == [("quadrilateral", [[0, 1, 2, 3]]),
                                                                                 ("triangle", [[0, 1, 5]])]
        assert [(kind, rows.tolist()) for kind, rows in found.parts["5"]] == [("vertex", [[6]])]
        assert found.remarks == ("no node of '3' belongs to the body",)  # a line half outside
    assert read(far, blocks, cell_data={"other:data": tags}).places == {}


def test_sets_of_cells_and_of_points(read):
    blocks = [("tetra", [[0, 1, 3, 4], [1, 2, 3, 6]]), ("triangle", [[0, 1, 3], [1, 2, 3]])]
    far = np.concatenate([CUBE, [(9, 9, 9)]])
    found = read(far, blocks, cell_sets={"some": [np.array([1]), np.array([0])], "gmsh:bounding": [np.array([0]), np.array([0])],
                                         "none": [np.array([], int), None], "faces": [None, np.array([1])]},
                 point_sets={"ends": np.array([6, 0, 6]), "outside": np.array([8, 5]), "half": np.array([8, 4]), "some": np.array([0])})
    # Nodes 0, 1, 2, 3, 4, 6 are used and become 0 .. 5; one name that stands for cells and for other nodes stands for neither.
    assert {name: nodes.tolist() for name, nodes in found.places.items()} == {
        "region-some": [0, 1, 2, 3, 5], "nodes-some": [0], "faces": [1, 2, 3], "ends": [0, 5], "half": [4]}
    assert found.mixed == {"some": ("nodes-some", "region-some")} and set(found.parts) == {"region-some", "faces"}
    assert found.remarks == ("3 nodes of no cell left out", "no node of 'outside' belongs to the body",
                             "1 of 2 nodes of 'half' belong to no cell of the body")
    assert [(kind, rows.tolist()) for kind, rows in found.parts["region-some"]] == [("tetrahedron", [[1, 2, 3, 5]]),
                                                                                    ("triangle", [[0, 1, 3]])]


def test_what_meshio_cannot_read_is_told_in_one_line(tmp_path, capfd):
    with pytest.raises(InputError, match=r"none.msh: no such file$"):
        read_mesh(tmp_path / "none.msh")
    with pytest.raises(InputError, match="no such file"):
        read_mesh(tmp_path)  # a folder
    for name, content in (("a.msh", "nonsense"), ("b.vtu", "<nonsense"), ("c.what", "x")):
        (tmp_path / name).write_text(content)
        with pytest.raises(InputError, match=f"{name}: not a mesh file that meshio can read") as caught:
            read_mesh(tmp_path / name)
        assert "\n" not in str(caught.value)
    out, err = capfd.readouterr()
    assert out == "" and err == ""


def test_what_meshio_wrote_is_read_to_the_last_bit(tmp_path):
    points = np.random.default_rng(0).random((8, 3)) * 0.1 + CUBE
    meshio.Mesh(points, [("wedge", [CELLS["wedge"][1]])]).write(tmp_path / "a.vtu")
    found = read_mesh(str(tmp_path / "a.vtu"))
    assert np.array_equal(found.points, points[[0, 1, 3, 4, 5, 7]]) and found.cells.tolist() == [[0, 1, 2, 3, 4, 5]]
