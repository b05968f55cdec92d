"""What the readers of Abaqus's, Nastran's, SU2's and XDMF's files take from each line, and what they refuse."""

import h5py
import meshio
import numpy as np
import pytest

from physics.mesh.files import read_mesh
from physics.mesh.formats import abaqus, nastran, others, su2, xdmf
from physics.schema import InputError

NODES = "*NODE\n" + "".join(f"{i}, {i}., {i * i}., {i % 2}.\n" for i in range(1, 10))


def groups(raw):
    """Of each group the labels of its cells, block by block."""
    return {key: [raw.blocks[number].labels[rows].tolist() for number, rows in members] for key, members in raw.groups.items()}


@pytest.fixture
def deck(tmp_path):
    def read(*lines, name="a.inp"):
        (tmp_path / name).write_text("\n".join(lines) + "\n")
        return abaqus.read(tmp_path / name)
    return read


def test_rows_of_labels_stop_at_the_last_one_and_skip_those_that_are_not_there(deck):
    cells = [f"{label}, 1, 2, 3, 4" for label in (11, 12, 14, 15, 17, 19)]
    raw = deck(NODES, "*ELEMENT, TYPE=C3D4", *cells, "*ELSET, ELSET=A, GENERATE", "11, 17, 3",
               "*ELSET, ELSET=B, GENERATE", "14, 15", "19, 30",
               "*NSET, NSET=N, GENERATE", "2, 9, 3", "*NSET, NSET=L", "9, 3, 77", "3, 1", "*ELSET, ELSET=C", "A, B, 12")
    assert groups(raw) == {("A", 3): [[11, 14, 17]], ("B", 3): [[14, 15, 19]], ("C", 3): [[11, 14, 17, 15, 19, 12]]}
    assert {name: (1 + nodes).tolist() for name, nodes in raw.node_sets.items()} == {"N": [2, 5, 8], "L": [9, 3, 1]}
    for line in ("3, 1, 0", "3, 1, -1"):
        with pytest.raises(InputError, match=f"GENERATE: {line} is no row of numbers"):
            deck(NODES, "*NSET, NSET=N, GENERATE", line)
    for line in ("3", "3, 4, 1, 1", "a, 4"):
        with pytest.raises(InputError, match="a line must have a first, a last and perhaps a step"):
            deck(NODES, "*NSET, NSET=N, GENERATE", line)


def test_parts_have_labels_of_their_own(deck):
    """Two parts whose nodes and cells have the same labels; sets name them by INSTANCE or as PART-1.label."""
    part = ["*NODE", *(f"{i}, {i}., 0., 0." for i in range(1, 5)), "*ELEMENT, TYPE=C3D4, ELSET=ALL", "7, 1, 2, 3, 4"]
    raw = deck("*PART, NAME=One", *part, "*NSET, NSET=LOW", "1, 2", "*END PART", "*PART, NAME=Two", *part, "8, 4, 3, 2, 1", "*END PART",
               "*INSTANCE, NAME=One-1, PART=One", "*END INSTANCE", "*INSTANCE, NAME=Two, PART=TWO", "0., 0., 0.", "*END INSTANCE",
               "*NSET, NSET=A, INSTANCE=Two", "4, 1", "*NSET, NSET=B", "One-1.3, two.2", "*ELSET, ELSET=E, INSTANCE=ONE-1", "7",
               "*ELSET, ELSET=F, INSTANCE=Two, GENERATE", "1, 99")
    assert raw.points[:, 0].tolist() == [1, 2, 3, 4] * 2 and raw.labels.tolist() == [1, 2, 3, 4] * 2
    block, = raw.blocks
    assert block.nodes.tolist() == [[0, 1, 2, 3], [4, 5, 6, 7], [7, 6, 5, 4]] and block.labels.tolist() == [7, 7, 8]
    assert {name: nodes.tolist() for name, nodes in raw.node_sets.items()} == {"LOW": [0, 1], "A": [7, 4], "B": [2, 5]}
    assert {key: rows.tolist() for key, ((_, rows),) in raw.groups.items()} == {("ALL", 3): [0, 1, 2], ("E", 3): [0], ("F", 3): [1, 2]}
    with pytest.raises(InputError, match="two instances of part One: export the mesh as one part"):
        deck("*PART, NAME=One", *part, "*END PART", *["*INSTANCE, PART=One", "*END INSTANCE"] * 2)
    with pytest.raises(InputError, match="an \\*INSTANCE is moved"):
        deck("*PART, NAME=One", *part, "*END PART", "*INSTANCE, PART=One", "0., 0., -0.5", "*END INSTANCE")
    one = deck("*PART, NAME=P", *part, "*END PART", "*NSET, NSET=A, INSTANCE=what", "2")  # of one part there can be no doubt
    assert one.node_sets["A"].tolist() == [1]


def test_lines_go_on_names_have_quotes_and_coordinates_may_be_missing(deck):
    raw = deck("*Heading", "a beam, of four", "** a remark", "*NODE, NSET=ALL", "1, 5.", "2,,6.", "3, 0., 0., 7.", "", "4, 1., 2., 3.",
               "*Element , type = c3d4 ,", " ELSET = \"my cells\"", "2, 1, 2,", "3, 4", "*MASS, ELSET=X", "3.",
               "*ELEMENT, TYPE=MASS, ELSET=X", "90, 1", "*ELEMENT, TYPE=SPRINGA", "91, 1, 2")
    assert raw.points.tolist() == [[5, 0, 0], [0, 6, 0], [0, 0, 7], [1, 2, 3]] and raw.node_sets["ALL"].tolist() == [0, 1, 2, 3]
    assert groups(raw) == {("my cells", 3): [[2]]} and raw.blocks[0].nodes.tolist() == [[0, 1, 2, 3]] and len(raw.blocks) == 1
    with pytest.raises(InputError, match="a.inp is included by itself"):
        deck("*INCLUDE, INPUT=a.inp")
    with pytest.raises(InputError, match="TYPE=B31: 5 numbers are not cells of a label and 2 nodes"):
        deck(NODES, "*ELEMENT, TYPE=B31", "1, 2, 3", "2, 3")
    with pytest.raises(InputError, match="cell 6 names node 44, which is not there"):
        deck(NODES, "*ELEMENT, TYPE=C3D4", "5, 1, 2, 3, 4", "6, 1, 2, 44, 55")
    with pytest.raises(InputError, match="NSET without a name"):
        deck(NODES, "*NSET", "1")


def test_a_set_of_cells_of_several_kinds_has_the_dimension_of_the_highest(deck):
    raw = deck(NODES, "*ELEMENT, TYPE=T3D2, ELSET=L", "1, 1, 2", "*ELEMENT, TYPE=S3", "2, 1, 2, 3", "3, 2, 3, 4", "*ELEMENT, TYPE=C3D6",
               "4, 1, 2, 3, 4, 5, 6", "*ELEMENT, TYPE=S4", "5, 1, 2, 3, 4", "*ELSET, ELSET=M", "L, 3, 5", "*SURFACE, NAME=S", "4, S2",
               "4, S3", "3, S2", "77, S1", "nobody, S1", "*SURFACE, TYPE=NODE, NAME=N", "L2", "4", "*NSET, NSET=L2", "1, 2")
    found = {key: sorted((raw.blocks[number].kind, raw.blocks[number].nodes[rows].tolist()) for number, rows in members)
             for key, members in raw.groups.items()}
    assert found == {("L", 1): [("line", [[0, 1]])],
                     ("M", 2): [("line", [[0, 1]]), ("quadrilateral", [[0, 1, 2, 3]]), ("triangle", [[1, 2, 3]])],
                     ("S", 2): [("quadrilateral", [[0, 3, 4, 1]]), ("triangle", [[3, 5, 4]])], ("S", 1): [("line", [[2, 3]])]}
    assert sorted(raw.node_sets["N"].tolist()) == [0, 1, 3]


def bulk(tmp_path, *lines):
    (tmp_path / "a.bdf").write_text("\n".join(lines) + "\n")
    return nastran.read(tmp_path / "a.bdf")


def test_cards_of_nastran_in_each_way_of_writing(tmp_path):
    """Before BEGIN BULK and behind ENDDATA nothing counts; a tenth field names the continuation."""
    raw = bulk(tmp_path, "GRID,9,,9.,9.,9.", "begin bulk", "GRID,1,,1.,2.,3.,,,,+A",
               "GRID*   " + f"{2:<16}{'':16}{'1.5':16}{'-2.5+1':16}*B",
               "*B      " + f"{'3.E-1':16}", "grid    3       0       4.      5.      6.      $ here", "GRID,4,,7.",
               "GRID\t5\t\t1.\t0.\t1.",
               "CTETRA,1,7,1,2,3,4,,,+C", "CTETRA  2               2       3       4       5", "CQUAD4,3,7,1,2,3,4", "CTRIA3,4,7,1,2,3",
               "CTRIA3,6,8,1,2,3", "SPC1,6,123,1,THRU,4", "SPC1,7,123,5,,3", "SPC1,7,3,1", "GRAV,1,,9.81", "ENDDATA", "GRID,8,,8.,8.,8.")
    assert raw.labels.tolist() == [1, 2, 3, 4, 5]
    assert raw.points.tolist() == [[1, 2, 3], [1.5, -25, 0.3], [4, 5, 6], [7, 0, 0], [1, 0, 1]]
    assert [(block.kind, block.labels.tolist(), block.nodes.tolist()) for block in raw.blocks] == [
        ("tetrahedron", [1, 2], [[0, 1, 2, 3], [1, 2, 3, 4]]), ("quadrilateral", [3], [[0, 1, 2, 3]]),
        ("triangle", [4, 6], [[0, 1, 2], [0, 1, 2]])]
    assert groups(raw) == {("7", 3): [[1]], ("7", 2): [[3], [4]], ("8", 2): [[6]]}
    assert {name: nodes.tolist() for name, nodes in raw.node_sets.items()} == {"spc-6": [0, 1, 2, 3], "spc-7": [0, 2, 4]}


@pytest.mark.parametrize("rest", ["CHEXA,9,1,1,2,3,4,5,6,+X\n+X,7,8", "CHEXA,9,1,1,2,3,4,5,6\n,7,8", "CHEXA*,9,1,1,2\n*,3,4,5,6\n*,7,8",
                                  "CHEXA          9       1       1       2       3       4       5       6+\n+              7       8"])
def test_a_cell_of_nastran_goes_on_over_lines(tmp_path, rest):
    grid = [f"GRID,{i},,{i}.,0.,0." for i in range(1, 9)]
    assert bulk(tmp_path, *grid, rest).blocks[0].nodes.tolist() == [list(range(8))]


def test_su2_in_the_plane_and_what_it_refuses(tmp_path):
    def read(cells="NELEM= 2\n5 0 1 2\n5 1 3 2 1\n", points="NPOIN= 4 4\n0 0 0\n1 0 1\n0 1 2\n1 1 3\n",
             marks="NMARK= 2\nMARKER_TAG= low\nMARKER_ELEMS= 1\n3 0 1\nMARKER_TAG= side\nMARKER_ELEMS= 2\n3 1 3\n3 0 2\nSEND_RECV= 1\n"):
        (tmp_path / "a.su2").write_text(f"% plane\nNDIME= 2\n{cells}{points}{marks}")
        return su2.read(tmp_path / "a.su2")

    raw = read()
    assert raw.points.tolist() == [[0, 0], [1, 0], [0, 1], [1, 1]]
    assert [(block.kind, block.nodes.tolist()) for block in raw.blocks] == [("triangle", [[0, 1, 2], [1, 3, 2]]),
                                                                            ("line", [[0, 1], [1, 3], [0, 2]])]
    assert {key: [(number, rows.tolist()) for number, rows in members] for key, members in raw.groups.items()} == {
        ("low", 1): [(1, [0])], ("side", 1): [(1, [1, 2])]}
    for marks, words in (("MARKER_ELEMS= 1\n", "a section is shorter than it says"), ("MARKER_ELEMS= -1\n", "a section is shorter"),
                         ("MARKER_ELEMS= 1\n3 0\n", "a line has 1 nodes: 3 0"), ("MARKER_ELEMS= 1\n14 0\n", "cells of VTK's type 14")):
        with pytest.raises(InputError, match=words):
            read(marks=marks)
    assert len(read(points="NPOIN= 4\n0 0\n1 0\n0 1\n1 1", marks="").points) == 4  # up to the last line


def grid(kind, cells, *attributes, nodes=None):
    item = '<DataItem Dimensions="{} {}" Format="XML">{}</DataItem>'
    rows = item.format(len(cells), len(cells[0]), " ".join(map(str, np.ravel(cells))))
    more = "".join(f'<Attribute Name="{name}" Center="{centre}">{item.format(len(values), 1, " ".join(map(str, values)))}</Attribute>'
                   for name, centre, values in attributes)
    place = "" if nodes is None else f"<Geometry>{item.format(len(nodes), 3, ' '.join(map(str, np.ravel(nodes))))}</Geometry>"
    return f'<Grid>{place}<Topology TopologyType="{kind}">{rows}</Topology>{more}</Grid>'


def test_whole_numbers_on_the_cells_of_an_xdmf_grid_are_tags_and_nothing_else_is(tmp_path):
    x = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]
    body = grid("Tetrahedron", [[0, 1, 2, 3], [1, 2, 3, 4]], ("part", "Cell", [4, 2]), ("heat", "Cell", [0.5, 2]), ("some", "Cell", [1]),
                ("u", "Node", [3, 3, 3, 3, 3]), ("kind", "Cell", [2.0, 2.0]), nodes=x)
    sides = grid("Triangle", [[0, 2, 1], [0, 1, 3], [0, 3, 2]], ("side", "Cell", [2, 4, 2]), ("odd", "Face", [7, 7, 7]))

    def read(*grids):
        (tmp_path / "a.xdmf").write_text(f"<Xdmf><Domain>{''.join(grids)}</Domain></Xdmf>")
        return xdmf.read(tmp_path / "a.xdmf")

    raw = read(body, sides)
    assert raw.points.tolist() == x and [block.kind for block in raw.blocks] == ["tetrahedron", "triangle"]
    assert {key: [(number, rows.tolist()) for number, rows in members] for key, members in raw.groups.items()} == {
        ("4", 3): [(0, [0])], ("part-2", 3): [(0, [1])], ("kind-2", 3): [(0, [0, 1])], ("2", 2): [(1, [0, 2])], ("4", 2): [(1, [1])]}
    assert read(body, grid("Triangle", [[0, 2, 1]], nodes=x)).blocks[1].nodes.tolist() == [[0, 2, 1]]
    for others_, words in (((body, grid("Triangle", [[0, 2, 1]], nodes=[*x[:4], [1, 1, 2]])), "its grids have different nodes"),
                           ((sides, sides), "no grid with nodes of its own"),
                           ((body, grid("Pyramid", [[0, 1, 2, 3, 4]])), "of pyramid cells")):
        with pytest.raises(InputError, match=words):
            read(*others_)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["in/side"] = np.array([[0, 2, 1], [0, 1, 3]])
    heavy = ('<Grid><Topology Type="Triangle"><DataItem Dimensions="6" Format="HDF">b.h5:/in/side</DataItem></Topology></Grid>')
    assert read(body, heavy).blocks[1].nodes.tolist() == [[0, 2, 1], [0, 1, 3]]
    with pytest.raises(InputError, match="data of format Binary, which is not known here"):
        read(body, heavy.replace("HDF", "Binary"))


def test_pixels_are_listed_row_by_row(tmp_path):
    x = [(x, y, 0) for y in (0, 1) for x in (0, 1, 2)]
    text = "\n".join(["# vtk DataFile Version 3.0", "a", "ASCII", "DATASET UNSTRUCTURED_GRID", "POINTS 6 double",
                      *(" ".join(map(str, row)) for row in x), "CELLS 2 10", "4 0 1 3 4", "4 1 2 4 5", "CELL_TYPES 2", "8", "8"])
    (tmp_path / "a.vtk").write_text(text + "\n")
    found = read_mesh(tmp_path / "a.vtk")
    assert found.cell == "quadrilateral" and found.cells.tolist() == [[0, 1, 4, 3], [1, 2, 5, 4]]


def test_further_nodes_of_vtks_lagrange_cells_have_no_one_order(tmp_path):
    def middles(name, size):
        raw = others.of_meshio(meshio.Mesh(np.zeros((30, 3)), [(name, [list(range(size))])]))
        return raw.blocks[0].kind, len(raw.blocks[0].middles)

    assert [middles(name, size) for name, size in (("VTK_LAGRANGE_TRIANGLE", 6), ("VTK_LAGRANGE_TETRAHEDRON", 10), ("hexahedron27", 27),
                                                   ("VTK_LAGRANGE_QUADRILATERAL", 9), ("VTK_LAGRANGE_HEXAHEDRON", 27), ("quad9", 9))] == [
        ("triangle", 3), ("tetrahedron", 6), ("hexahedron", 19), ("quadrilateral", 0), ("hexahedron", 0), ("quadrilateral", 5)]


def test_zero_is_no_tag_and_of_vtks_own_ids_neither_is_what_is_negative():
    cells = [("tetra", [[0, 1, 2, 3]] * 4)]
    for key, wanted in (("medit:ref", {"-1": [0], "2": [2, 3]}), ("CellEntityIds", {"2": [2, 3]})):
        raw = others.of_meshio(meshio.Mesh(np.eye(4, 3), cells, cell_data={key: [np.array([[-1], [0], [2], [2]])]}))
        assert {name: rows.tolist() for (name, _), ((_, rows),) in raw.groups.items()} == wanted
