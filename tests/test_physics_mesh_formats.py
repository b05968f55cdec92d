"""The same small beam of four hexahedra in each format, groups and all, as other programs write it."""

import meshio
import numpy as np
import pytest

from physics.fem import OLD
from physics.mesh.cell import CELLS
from physics.mesh.files import read_mesh
from physics.mesh.shapes.boxes import box
from physics.modes.elastic import elastic_modes
from physics.scene import Body, read_scene
from physics.schema import InputError

BEAM = box(Body(length=0.4, width=0.1, height=0.1, cells=(4, 1, 1), cell="hexahedron"))
WALL, TIP = BEAM.cells[0, :4], BEAM.cells[3, 4:]
KNOWN = [3.82586, 3.82586, 12.3362, 20.3992]  # [Hz], the same mesh by another program


def frequencies(path, where):
    return elastic_modes(read_scene({"body": {"shape": "file", "path": str(path)}, "support": [{"where": where}],
                                     "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}}), count=4).frequencies_hz


def lines(*rows):
    return "\n".join(rows) + "\n"


def deck(*more, nodes="*NODE", elements="*ELEMENT, TYPE=C3D8, ELSET=EALL"):
    """An .inp file with labels from 101 and 11."""
    return lines(nodes, *(f"{101 + i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(BEAM.points.tolist())), elements,
                 *(f"{11 + i}, {', '.join(str(101 + node) for node in row)}" for i, row in enumerate(BEAM.cells)), *more)


@pytest.mark.parametrize("more, where", [
    (("*NSET, NSET=WALL, GENERATE", "101, 104"), "WALL"), (("*NSET, NSET=WALL, GENERATE", "101, 103, 2", "102,104,2"), "WALL"),
    (("*nset, nset=Wall", "101, 102,", "103, 104"), "Wall"),
    (("*NSET,NSET=A", "101,102", "*NSET,NSET=B", "103,104", "*NSET,NSET=WALL", "A, B"), "WALL"),
    (("*NSET,NSET=A", "101,102", "*NSET,NSET=WALL", "a", "103, 104"), "WALL"),
    (("*SURFACE, NAME=WALL, TYPE=ELEMENT", "11, S1"), "WALL"),
    (("*ELSET,ELSET=FIRST", "11", "*SURFACE, TYPE=ELEMENT, NAME=WALL", "FIRST, S1"), "WALL"),
    (("*SURFACE, NAME=WALL, TYPE=NODE", "101", "102", "103", "104"), "WALL"),
    (("*ELEMENT, TYPE=S4R,", "ELSET=WALL", "90, 101, 102, 104, 103"), "WALL")])
def test_sets_and_surfaces_of_abaqus(tmp_path, more, where):
    (tmp_path / "part.inp").write_text(deck(*more))
    assert frequencies(tmp_path / "part.inp", where) == pytest.approx(KNOWN, rel=4e-6)
    faces = [facets for facets in read_mesh(tmp_path / "part.inp").facets(where) if len(facets)]
    assert [sorted(row.tolist()) for facets in faces for row in facets] == [[0, 1, 2, 3]]


def test_a_set_behind_the_nodes_themselves_and_parts_of_abaqus(tmp_path):
    head, tail = deck().split("*ELEMENT")
    rows = head.splitlines()
    text = lines("*PART, NAME=P", rows[0] + ", NSET=WALL", *rows[1:5], rows[0], *rows[5:], "*ELEMENT" + tail.rstrip(), "*END PART",
                 "*ASSEMBLY, NAME=A", "*INSTANCE, NAME=P-1, PART=P", "*END INSTANCE", "*NSET, NSET=TIP, INSTANCE=P-1", "117, 118, 119, 120",
                 "*END ASSEMBLY")
    (tmp_path / "part.inp").write_text(text)
    assert frequencies(tmp_path / "part.inp", "WALL") == pytest.approx(KNOWN, rel=4e-6)
    assert read_mesh(tmp_path / "part.inp").places["TIP"].tolist() == sorted(TIP)
    (tmp_path / "two.inp").write_text(text.replace("*END INSTANCE", "0.5, 0, 0\n*END INSTANCE"))
    with pytest.raises(InputError, match="an \\*INSTANCE is moved"):
        read_mesh(tmp_path / "two.inp")
    (tmp_path / "whole.inp").write_text("*INCLUDE, INPUT=part.inp\n")
    assert np.array_equal(read_mesh(tmp_path / "whole.inp").cells, BEAM.cells)


@pytest.mark.parametrize("kind", ["CPE4", "CPS4R", "CPE4H", "CAX4", "S4", "M3D4", "cpe4"])
def test_plane_cells_of_abaqus(tmp_path, kind):
    (tmp_path / "a.inp").write_text(lines("*NODE", "1, 0, 0", "2, 1, 0", "3, 1, 1", "4, 0, 1", f"*ELEMENT, TYPE={kind}, ELSET=E",
                                          "1, 1, 2, 3, 4"))
    found = read_mesh(tmp_path / "a.inp")
    assert found.cell == "quadrilateral" and found.cells.tolist() == [[0, 1, 2, 3]] and found.places["E"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("more, words", [
    (("*NSET, NSET=A, GENERATE", "101"), "GENERATE: a line must have a first, a last"),
    (("*NSET, NSET=A", "B"), "set A names set B, which is not there"),
    (("*NSET, NSET=A", "B", "*NSET, NSET=B", "A"), "names itself"), (("*ELEMENT, TYPE=QQ8", "1,1"), "TYPE=QQ8: not a type of cell"),
    (("*ELEMENT, TYPE=C3D8", "77, 101, 102, 103, 104, 105, 106, 107, 999"), "cell 77 names node 999, which is not there"),
    (("*NODE", "101, 0, 0, 0"), "node 101 is there twice"), (("*SURFACE, NAME=S", "11, S7"), None),
    (("*INCLUDE, INPUT=none.inp",), "no such file"),
    (("*ELEMENT, TYPE=C3D8", "77, 101, 102"), "3 numbers are not cells of a label and 8 nodes")])
def test_what_is_wrong_with_a_deck_is_said(tmp_path, more, words):
    (tmp_path / "a.inp").write_text(deck(*more))
    if words is None:
        assert read_mesh(tmp_path / "a.inp").cell == "hexahedron"
        return
    with pytest.raises(InputError) as caught:
        read_mesh(tmp_path / "a.inp")
    assert words in str(caught.value)


def entities_4(version):
    """A .msh file of version 4 in text: a surface in two groups, one in none, and a region in one, as SaveAll keeps them."""
    size = "0 0 0 1 1 1"
    head = (f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n"
            '$PhysicalNames\n3\n2 1 "wall"\n2 2 "both ends"\n3 1 "body"\n$EndPhysicalNames\n')
    entities = f"$Entities\n0 0 3 1\n4 {size} 2 1 2 0\n5 {size} 1 2 0\n6 {size} 0 0\n9 {size} 1 1 0\n$EndEntities\n"
    side = BEAM.cells[0, [0, 1, 5, 4]]
    points, cells = [[repr(float(x)) for x in row] for row in BEAM.points], [(4, [WALL]), (5, [TIP]), (6, [side]), (9, BEAM.cells)]
    if version == "4.1":
        nodes = ["1 20 1 20", "3 9 0 20", *(str(i + 1) for i in range(20)), *(" ".join(row) for row in points)]
        elements = ["4 7 1 7"]
    else:
        nodes = ["1 20", "9 3 0 20", *(f"{i + 1} {' '.join(row)}" for i, row in enumerate(points))]
        elements = ["4 7"]
    label = 0
    for tag, rows in cells:
        dimension, kind = (3, 5) if tag == 9 else (2, 3)
        elements.append(f"{dimension} {tag} {kind} {len(rows)}" if version == "4.1" else f"{tag} {dimension} {kind} {len(rows)}")
        for row in rows:
            label += 1
            elements.append(f"{label} {' '.join(str(node + 1) for node in row)}")
    return head + entities + lines("$Nodes", *nodes, "$EndNodes", "$Elements", *elements, "$EndElements")


@pytest.mark.parametrize("version", ["4.0", "4.1"])
def test_gmsh_saved_whole_keeps_every_group_of_an_entity(tmp_path, version):
    (tmp_path / "part.msh").write_text(entities_4(version))
    mesh = read_mesh(tmp_path / "part.msh")
    assert {name: nodes.tolist() for name, nodes in mesh.places.items()} == {
        "wall": sorted(WALL), "both ends": sorted([*WALL, *TIP]), "body": list(range(20))}
    assert frequencies(tmp_path / "part.msh", "wall") == pytest.approx(KNOWN, rel=4e-6)


@pytest.mark.parametrize("damage, words", [
    (("\n20\n", "\n20.5\n"), "not a sound .msh file"), (("$EndElements", ""), "$EndElements is missing: the file was cut off"),
    (("4 7 1 7", "5 7 1 7"), "a section is shorter than it says"), ((" 5 4\n", " 77 4\n"), "gmsh's type 77"),
    (("4.1 0 8", "5.0 0 8"), "version 5.0; known are 2.2, 4.0 and 4.1"), (("$Nodes", "$Knots"), "no $Nodes in it")])
def test_what_is_wrong_with_a_msh_file_is_said(tmp_path, damage, words):
    (tmp_path / "part.msh").write_text(entities_4("4.1").replace(*damage))
    with pytest.raises(InputError) as caught:
        read_mesh(tmp_path / "part.msh")
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_name_without_cells_is_told_where_it_is_asked_for(tmp_path):
    (tmp_path / "part.msh").write_text(entities_4("4.1").replace("2 1 \"wall\"", "2 8 \"wall\""))
    with pytest.raises(InputError, match="no place named 'wall' in the mesh: there are .*; no cell of the file is in 'wall'; gmsh keeps"):
        frequencies(tmp_path / "part.msh", "wall")


def test_groups_of_med_are_families_with_several_names(tmp_path):
    given = meshio.Mesh(BEAM.points, [("hexahedron", BEAM.cells), ("quad", np.array([WALL, TIP]))],
                        cell_data={"cell_tags": [np.full(4, -1), np.array([-2, -3])]}, point_data={"point_tags": np.arange(20) // 16})
    given.cell_tags, given.point_tags = {-1: ["body"], -2: ["wall", "both ends"], -3: ["both ends"]}, {1: ["last"]}
    given.write(tmp_path / "part.med")
    mesh = read_mesh(tmp_path / "part.med")
    assert {name: nodes.tolist() for name, nodes in mesh.places.items()} == {
        "body": list(range(20)), "wall": sorted(WALL), "both ends": sorted([*WALL, *TIP]), "last": sorted(TIP)}
    assert frequencies(tmp_path / "part.med", "wall") == pytest.approx(KNOWN, rel=4e-6)


def test_markers_of_su2_have_names(tmp_path):
    rows = [f"12 {' '.join(map(str, row))} {i}" for i, row in enumerate(BEAM.cells)]
    text = lines("% a beam", "NDIME= 3", "NELEM= 4", *rows, "NPOIN= 20", *(" ".join(map(str, x)) for x in BEAM.points.tolist()), "NMARK= 2",
                 "MARKER_TAG= wall", "MARKER_ELEMS= 1", f"9 {' '.join(map(str, WALL))}", "MARKER_TAG= tip", "MARKER_ELEMS= 1",
                 f"9 {' '.join(map(str, TIP))}")
    (tmp_path / "part.su2").write_text(text)
    assert frequencies(tmp_path / "part.su2", "wall") == pytest.approx(KNOWN, rel=4e-6)
    assert [len(facets) for facets in read_mesh(tmp_path / "part.su2").facets("tip")] == [1]


@pytest.mark.parametrize("fields", ["small", "large", "free"])
def test_property_numbers_of_nastran_are_groups(tmp_path, fields):
    def card(name, *words):
        words = [str(word) for word in words]
        if fields == "free":
            return ",".join([name, *words[:8]]) + "".join(f"\n+,{','.join(words[at:at + 8])}" for at in range(8, len(words), 8))
        wide, many = (16, 4) if fields == "large" else (8, 8)
        first = f"{name + ('*' if wide == 16 else ''):8s}"
        rows = ["".join(f"{word:{wide}s}" for word in words[at:at + many]) for at in range(0, len(words), many)]
        return first + f"\n{'*' if wide == 16 else '+':8s}".join(rows)

    cards = [card("GRID", i + 1, "", *(f"{c:.1f}" if c else "0.0" for c in x)) for i, x in enumerate(BEAM.points)]
    cards += [card("CHEXA", i + 1, 7, *(node + 1 for node in row)) for i, row in enumerate(BEAM.cells)]
    cards += [card("CQUAD4", 50, 3, *(node + 1 for node in WALL)), card("SPC1", 4, 123, *(node + 1 for node in WALL)), card("PSOLID", 7, 1)]
    (tmp_path / "part.bdf").write_text(lines("SOL 103", "CEND", "BEGIN BULK", "$ a beam", *cards, "ENDDATA"))
    mesh = read_mesh(tmp_path / "part.bdf")
    assert {name: nodes.tolist() for name, nodes in mesh.places.items()} == {
        "7": list(range(20)), "3": sorted(WALL), "spc-4": sorted(WALL)}
    assert frequencies(tmp_path / "part.bdf", "3") == pytest.approx(KNOWN, rel=4e-6)


def test_numbers_of_nastran_without_their_letter(tmp_path):
    (tmp_path / "a.bdf").write_text(lines("GRID    1               0.0     0.0     0.0", "GRID    2               1.5-3   0.0     0.0",
                                          "GRID    3               0.0     1.+1    0.0", "GRID    4               0.0     0.0     2.D0",
                                          "CTETRA  1       1       1       2       3       4"))
    assert read_mesh(tmp_path / "a.bdf").points.tolist() == [[0, 0, 0], [1.5e-3, 0, 0], [0, 10, 0], [0, 0, 2]]
    (tmp_path / "b.bdf").write_text("GRID,1,5,0.,0.,0.\n")
    with pytest.raises(InputError, match="grid point 1 is in coordinate system 5"):
        read_mesh(tmp_path / "b.bdf")


@pytest.mark.parametrize("ending", [".vtk", ".vtu"])
def test_voxels_and_pixels_are_listed_row_by_row(tmp_path, ending):
    order = [0, 1, 3, 2, 4, 5, 7, 6]
    if ending == ".vtk":
        cells = "\n".join(f"8 {' '.join(map(str, row[order]))}" for row in BEAM.cells)
        points = "\n".join(" ".join(map(str, x)) for x in BEAM.points.tolist())
        text = (f"# vtk DataFile Version 3.0\nbeam\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 20 double\n{points}\nCELLS 4 36\n{cells}\n"
                "CELL_TYPES 4\n11\n11\n11\n11\n")
        (tmp_path / "a.vtk").write_text(text)
    else:
        meshio.Mesh(BEAM.points, [("hexahedron", BEAM.cells[:, order])]).write(tmp_path / "a.vtu", binary=False)
        text = (tmp_path / "a.vtu").read_text()
        assert text.count("\n12\n") == 4
        (tmp_path / "a.vtu").write_text(text.replace("\n12\n12\n12\n12\n", "\n11\n11\n11\n11\n"))
    found = read_mesh(tmp_path / f"a{ending}")
    assert np.array_equal(found.cells, BEAM.cells) and np.allclose(found.points, BEAM.points)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron", "triangle", "quadrilateral"])
def test_meshes_with_tags_as_dolfinx_writes_them(tmp_path, cell):
    """Two tags on the ends of a box, and one on its cells; dolfinx's own reader finds the same entities."""
    from dolfinx import io, mesh
    from mpi4py import MPI

    kind = getattr(mesh.CellType, cell)
    plane = CELLS[cell].dimension == 2
    domain = (mesh.create_rectangle(MPI.COMM_SELF, [[0, 0], [0.4, 0.1]], [4, 2], kind) if plane else
              mesh.create_box(MPI.COMM_SELF, [[0, 0, 0], [0.4, 0.1, 0.1]], [4, 2, 1], kind))
    d = domain.topology.dim
    ends = [mesh.locate_entities_boundary(domain, d - 1, lambda x, end=end: np.isclose(x[0], end)) for end in (0.0, 0.4)]
    entities, values = np.concatenate(ends), np.repeat([5, 6], [len(end) for end in ends])
    order = np.argsort(entities)
    tags = mesh.meshtags(domain, d - 1, entities[order], values[order].astype(np.int32))
    tags.name = "facets"
    domain.topology.create_connectivity(d - 1, d)
    with io.XDMFFile(MPI.COMM_SELF, str(tmp_path / "a.xdmf"), "w") as file:
        file.write_mesh(domain)
        file.write_meshtags(tags, *([] if OLD else [domain.geometry]))
    found = read_mesh(tmp_path / "a.xdmf")
    assert found.cell == cell and set(found.places) == {"5", "6"}
    assert np.allclose(found.points[found.places["5"], 0], 0) and np.allclose(found.points[found.places["6"], 0], 0.4)
    assert [sum(map(len, found.facets(name))) for name in "56"] == [len(end) for end in ends]
    with io.XDMFFile(MPI.COMM_SELF, str(tmp_path / "a.xdmf"), "r") as file:
        again = file.read_mesh(name="mesh")
        again.topology.create_connectivity(d - 1, d)
        read = file.read_meshtags(again, name="facets")
    assert np.bincount(read.values)[5:].tolist() == [len(end) for end in ends]
    assert again.topology.index_map(d).size_local == len(found.cells)


def test_tags_of_two_names_with_one_number_are_two_places(tmp_path):
    """As dolfinx writes them, with the data in the XML: faces 1 of "walls" and of "loads", and cells 1."""
    def grid(name, kind, cells):
        item = f'<DataItem Dimensions="{len(cells)} {len(cells[0])}" Format="XML">{" ".join(map(str, np.ravel(cells)))}</DataItem>'
        tags = f'<DataItem Dimensions="{len(cells)} 1" Format="XML">{"1 " * len(cells)}</DataItem>'
        return (f'<Grid Name="{name}" GridType="Uniform"><xi:include xpointer="xpointer(/Xdmf/Domain/Grid/Geometry)"/>'
                f'<Topology TopologyType="{kind}">{item}</Topology>'
                f'<Attribute Name="{name}" AttributeType="Scalar" Center="Cell">{tags}</Attribute></Grid>')

    body = grid("cells", "Hexahedron", BEAM.cells)
    numbers = " ".join(map(str, BEAM.points.ravel()))
    nodes = f'<Geometry GeometryType="XYZ"><DataItem Dimensions="20 3" Format="XML">{numbers}</DataItem></Geometry>'
    grids = [body.replace("<Topology", nodes + "<Topology"), grid("walls", "Quadrilateral", [WALL]), grid("loads", "Quadrilateral", [TIP])]
    head = '<Xdmf Version="3.0" xmlns:xi="http://www.w3.org/2001/XInclude">'
    (tmp_path / "a.xdmf").write_text(f'{head}<Domain>{"".join(grids)}</Domain></Xdmf>')
    assert {name: nodes.tolist() for name, nodes in read_mesh(tmp_path / "a.xdmf").places.items()} == {
        "1": list(range(20)), "walls-1": sorted(WALL), "loads-1": sorted(TIP)}


def test_a_kind_of_file_that_nobody_knows_is_refused_with_meshios_own_reason(tmp_path):
    for name, content, words in (("a.what", "x", "Could not deduce file format"), ("a.med", "x", "nable to"),
                                 ("a.xdmf", "<Xdmf><Domain>", "not XML")):
        (tmp_path / name).write_text(content)
        with pytest.raises(InputError) as caught:
            read_mesh(tmp_path / name)
        assert words in str(caught.value) and "\n" not in str(caught.value)


def test_names_in_med_are_in_utf_8(tmp_path):
    """As gmsh and Salome write them: bytes above 127 are parts of a letter."""
    h5py = pytest.importorskip("h5py")
    meshio.Mesh(BEAM.points, [("hexahedron", BEAM.cells)]).write(tmp_path / "part.med")
    with h5py.File(tmp_path / "part.med", "a") as file:
        (mesh,) = file["ENS_MAA"].values()
        (step,) = mesh.values()
        step["MAI/HE8"].create_dataset("FAM", data=np.array([-1, -1, -1, -2]))
        step["MAI/HE8"].attrs["CGT"] = 1
        for number, name in ((-1, "Körper"), (-2, "端")):
            family = file.require_group(f"FAS/{next(iter(file['ENS_MAA']))}/ELEME/F{number}")
            family.attrs["NUM"] = number
            group = family.create_group("GRO")
            group.attrs["NBR"] = 1
            text = name.encode().ljust(80, b"\0")
            group.create_dataset("NOM", data=np.array([np.frombuffer(text, np.int8)]))
    assert {name: len(nodes) for name, nodes in read_mesh(tmp_path / "part.med").places.items()} == {"Körper": 16, "端": 8}


def test_cells_of_third_order_are_called_so(tmp_path):
    points = np.concatenate([BEAM.points[[0, 2, 1, 4]], np.tile(BEAM.points.mean(axis=0), (16, 1))])
    meshio.Mesh(points, [("tetra20", np.arange(20)[None])]).write(tmp_path / "a.msh", file_format="gmsh")
    assert read_mesh(tmp_path / "a.msh").remarks == ("cells of third order or more: their sides are taken as straight",)
