"""The tables of the mesh formats against VTK's and meshio's, and against the node orders printed in the manuals of Abaqus and Nastran."""

import numpy as np
import pytest
from meshio._common import num_nodes_per_cell
from meshio.abaqus._abaqus import abaqus_to_meshio_type
from meshio.gmsh.common import _gmsh_to_meshio_order, _gmsh_to_meshio_type
from meshio.nastran._nastran import _convert_to_vtk_ordering, nastran_to_meshio_type
from meshio.xdmf.common import xdmf_to_meshio_type
from vtkmodules import vtkCommonDataModel as vtk

from physics.mesh.cell import CELLS, OF_MESHIO
from physics.mesh.formats import abaqus, gmsh, nastran, xdmf
from physics.mesh.formats.raw import VTK_MIDDLES, block, numbered
from physics.schema import InputError

SECOND_ORDER = {"line": vtk.vtkQuadraticEdge, "triangle": vtk.vtkQuadraticTriangle, "tetrahedron": vtk.vtkQuadraticTetra,
                "quadrilateral": vtk.vtkBiQuadraticQuad, "hexahedron": vtk.vtkTriQuadraticHexahedron}
NAMES = {kind: cell.meshio for kind, cell in CELLS.items()} | {"pyramid": "pyramid"}


def places(kind):
    """Where VTK has the nodes of a cell of second order in the cell's own coordinates, corners first."""
    return np.reshape(SECOND_ORDER[kind]().GetParametricCoords(), (-1, 3))


def lie_between(kind, middles, at):
    """Each of some middle nodes lies in the centre of corners that go round an edge, a face or the cell."""
    corners = places(kind)[:CELLS[kind].corners]
    assert [corners[list(local)].mean(axis=0).tolist() for local in middles] == at.tolist()
    edges = {frozenset(edge) for edge in CELLS[kind].edges}
    for local in middles:
        assert len(local) == len(set(local)) and len(local) in (2, 4, 8)
        if len(local) == 4:
            assert {frozenset(pair) for pair in zip(local, local[1:] + local[:1], strict=True)} <= edges


@pytest.mark.parametrize("kind", SECOND_ORDER)
def test_further_nodes_of_vtk_lie_where_vtk_puts_them(kind):
    lie_between(kind, VTK_MIDDLES[kind], places(kind)[CELLS[kind].corners:])
    assert set(VTK_MIDDLES) == set(SECOND_ORDER)


@pytest.mark.parametrize("kind, number", [("tetrahedron", 10), ("hexahedron", 20), ("hexahedron", 27)])
def test_further_nodes_of_gmsh_are_those_that_meshio_brings_into_vtks_order(kind, number):
    order = _gmsh_to_meshio_order(f"{NAMES[kind]}{number}", np.arange(number)[None])[0]
    corners = CELLS[kind].corners
    middles = [gmsh.MIDDLES[kind][node - corners] for node in order[corners:]]
    assert sorted(order[corners:]) == list(range(corners, number))
    lie_between(kind, middles, places(kind)[corners:number])
    assert {other: gmsh.MIDDLES[other] for other in ("line", "triangle", "quadrilateral")} == {
        other: VTK_MIDDLES[other] for other in ("line", "triangle", "quadrilateral")}


def test_further_nodes_of_nastran_are_those_that_meshio_brings_into_vtks_order():
    """A CHEXA goes round the bottom, up the four sides, and round the top."""
    order = _convert_to_vtk_ordering(list(range(20)), "CHEXA_")
    lie_between("hexahedron", [nastran.MIDDLES["hexahedron"][node - 8] for node in order[8:]], places("hexahedron")[8:20])
    assert nastran.MIDDLES["tetrahedron"] == VTK_MIDDLES["tetrahedron"]


def test_numbers_of_gmsh_are_those_of_meshio():
    for number, (kind, size) in gmsh.TYPES.items():
        name = (_gmsh_to_meshio_type | {20: "triangle9"})[number]
        assert (NAMES[kind], size) == (name.rstrip("0123456789"), (num_nodes_per_cell | {"triangle9": 9})[name])
    assert set(gmsh.TYPES) >= set(range(1, 20))  # those of first and second order


def test_names_of_xdmf_are_those_of_meshio():
    lower = {name.lower(): of for name, of in xdmf_to_meshio_type.items()}
    for name, (kind, size) in xdmf.KINDS.items():
        assert NAMES[kind] == lower[name].rstrip("0123456789")
        assert size == (2 if name == "polyline" else num_nodes_per_cell[lower[name]])


@pytest.mark.parametrize("card", nastran.CARDS)
def test_cards_of_nastran_are_those_of_meshio(tmp_path, card):
    """Whole, with its first middle node left out, which leaves the corners, and one corner short, which is no cell."""
    small = nastran_to_meshio_type[card]
    large = {"CQUAD8": "quad8", "CTRIA6": "triangle6"}.get(card, nastran_to_meshio_type.get(f"{card}_", small))
    kind = next(kind for kind, name in NAMES.items() if name == small.rstrip("0123456789"))
    corners = num_nodes_per_cell[NAMES[kind]]
    size = num_nodes_per_cell[large]
    grid = [f"GRID,{i + 1},,{i}.,0.,0." for i in range(size)]

    def read(nodes):
        words = ["71", "4", *nodes]
        rows = [",".join([card if not at else "", *words[at:at + 8]]) for at in range(0, len(words), 8)]
        (tmp_path / "a.bdf").write_text("\n".join([*grid, *rows]) + "\n")
        return nastran.read(tmp_path / "a.bdf")

    nodes = [str(size - i) for i in range(size)]
    with pytest.raises(InputError, match=f"cell 71: a {card} has {corners - 1} nodes"):
        read(nodes[:corners - 1])
    if kind == "pyramid":
        with pytest.raises(InputError, match="has cells of kind 'pyramid'; known are vertex, line"):
            read(nodes)
        return
    found, = read(nodes).blocks
    assert found.kind == kind and found.labels.tolist() == [71] and found.nodes.tolist() == [list(range(size))[::-1]]
    if size > corners:
        found, = read([*nodes[:corners], "", *nodes[corners + 1:]]).blocks
        assert found.nodes.tolist() == [list(range(size))[::-1][:corners]] and found.middles == ()


OF_ABAQUS = {name: (of.rstrip("0123456789"), num_nodes_per_cell[of]) for name, of in abaqus_to_meshio_type.items() if of != "tetra4"}
OF_ABAQUS |= {"C3D4H": ("tetra", 4), "C3D27R": ("hexahedron", 27), "B33": ("line", 2), "B33H": ("line", 2),  # of two nodes, cubic
              "SC6R": ("wedge", 6), "SC8R": ("hexahedron", 8), "CSS8": ("hexahedron", 8), "DC3D20": ("hexahedron", 20),
              "DC3D8": ("hexahedron", 8), "DC3D10": ("tetra", 10), "DC3D4": ("tetra", 4), "DC3D15": ("wedge", 15), "DC3D6": ("wedge", 6),
              "CPE8R": ("quad", 8), "CAX8": ("quad", 8), "DC2D8": ("quad", 8), "M3D9R": ("quad", 9), "M3D6": ("triangle", 6),
              "CPEG3": ("triangle", 3), "CPS6M": ("triangle", 6), "SAX2": ("line", 3), "R3D4": ("quad", 4), "DS3": ("triangle", 3),
              "STRI65": ("triangle", 6), "CONN3D2": ("line", 2)}


@pytest.mark.parametrize("name", OF_ABAQUS)
def test_types_of_abaqus_are_those_of_meshio_and_of_the_manual(tmp_path, name):
    kind, size = OF_ABAQUS[name]
    rows = [f"{i + 1}, {i}., 0., 0." for i in range(size)]
    words = ["8", *(str(size - i) for i in range(size))]
    cells = [", ".join(words[at:at + 16]) + ("," if at + 16 < len(words) else "") for at in range(0, len(words), 16)]
    (tmp_path / "a.inp").write_text("\n".join(["*NODE", *rows, f"*ELEMENT, TYPE={name}", *cells]) + "\n")
    found, = abaqus.read(tmp_path / "a.inp").blocks
    wanted = list(range(size))[::-1]
    if kind == "line" and size == 3:
        wanted = [2, 0, 1]  # Abaqus has the middle node second
    assert NAMES[found.kind] == kind and found.nodes.tolist() == [wanted] and found.labels.tolist() == [8]
    assert found.middles == () if kind == "wedge" or size in (27, CELLS[found.kind].corners) else len(found.middles) == len(wanted) - CELLS[
        found.kind].corners


SIDES_OF_ABAQUS = {  # Abaqus Analysis User's Manual, "Element faces" of the solid elements: nodes of faces 1, 2, ..
    "C3D4": ("1-2-3", "1-4-2", "2-4-3", "3-4-1"),
    "C3D6": ("1-2-3", "4-6-5", "1-4-5-2", "2-5-6-3", "3-6-4-1"),
    "C3D8": ("1-2-3-4", "5-8-7-6", "1-5-6-2", "2-6-7-3", "3-7-8-4", "4-8-5-1"),
    "CPS3": ("1-2", "2-3", "3-1"), "CPS4": ("1-2", "2-3", "3-4", "4-1")}


@pytest.mark.parametrize("name", SIDES_OF_ABAQUS)
def test_sides_of_abaqus_are_those_of_its_manual(tmp_path, name):
    sides, size = SIDES_OF_ABAQUS[name], int(name[-1])
    rows = [f"{i + 1}, {i}., 0., 0." for i in range(size)]
    surfaces = [f"*SURFACE, NAME=F{i + 1}\n5, S{i + 1}" for i in range(len(sides))]
    text = "\n".join(["*NODE", *rows, f"*ELEMENT, TYPE={name}, ELSET=E", f"5, {', '.join(str(i + 1) for i in range(size))}"])
    (tmp_path / "a.inp").write_text("\n".join([text, *surfaces, "*SURFACE, NAME=ALL", *(f"E, S{i + 1}" for i in range(len(sides)))]) + "\n")
    found = abaqus.read(tmp_path / "a.inp")
    dimension = 1 if name.startswith("CPS") else 2
    asked = [[int(node) - 1 for node in side.split("-")] for side in sides]
    for i, nodes in enumerate(asked):
        (number, which), = found.groups[f"F{i + 1}", dimension]
        assert found.blocks[number].nodes[which].tolist() == [nodes]
        assert len(found.blocks[number].nodes[0]) == CELLS[found.blocks[number].kind].corners
    together = [row for number, which in found.groups["ALL", dimension] for row in found.blocks[number].nodes[which].tolist()]
    assert sorted(together) == sorted(asked) and set(found.groups) == {
        ("E", dimension + 1), ("ALL", dimension), *((f"F{i + 1}", dimension) for i in range(len(sides)))}
    (tmp_path / "a.inp").write_text(f"{text}\n*SURFACE, NAME=NONE\n5, S{len(sides) + 1}\n")
    if len(sides) < 6:
        with pytest.raises(InputError, match=f"surface NONE: a {found.blocks[0].kind} has no side S{len(sides) + 1}"):
            abaqus.read(tmp_path / "a.inp")


@pytest.mark.parametrize("kind, sizes", [("line", {2: 0, 3: 1, 4: 0}), ("triangle", {3: 0, 6: 3, 7: 0, 10: 0}),
                                         ("quadrilateral", {4: 0, 8: 4, 9: 5, 16: 0}), ("tetrahedron", {4: 0, 10: 6, 11: 0, 20: 0}),
                                         ("hexahedron", {8: 0, 20: 12, 24: 0, 27: 19, 64: 0}), ("prism", {6: 0, 15: 0, 18: 0})])
def test_further_nodes_are_known_of_cells_of_second_order_and_no_others(kind, sizes):
    for size, many in sizes.items():
        assert block(kind, np.zeros((1, size), np.int64)).middles == VTK_MIDDLES.get(kind, ())[:many]
    other = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
    assert block("tetrahedron", np.zeros((1, 10), np.int64), None, other).middles == other
    assert block("tetrahedron", np.zeros((1, 10), np.int64), None, ()).middles == ()


def test_a_label_is_where_it_stood_last():
    labels = np.array([7, 3, 9, 3, 5])
    assert numbered(labels, np.array([[3, 9], [5, 7]])).tolist() == [[3, 2], [4, 0]]
    assert numbered(labels, np.array([2, 4, 8, 10, -1])).tolist() == [-1] * 5
    assert numbered(np.array([], np.int64), np.array([[1, 2]])).tolist() == [[-1, -1]]


def test_every_kind_of_meshio_is_one_of_ours():
    assert set(OF_MESHIO) == {"vertex", "line", "triangle", "quad", "tetra", "hexahedron", "wedge"}
