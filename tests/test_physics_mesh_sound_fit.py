"""How near nodes and sides of different cells have to be to count as touching, and who is told of cells that do not fit."""

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.sound import fit
from physics.scene import Body
from physics.schema import InputError

UNIT = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float) + (3, -2, 5)


def fitting(points, cells, kind):
    return fit.fitting(np.array(points, float), np.array(cells), kind, lambda i: f"cell {i}", lambda node: f"[{node}]")


@pytest.mark.parametrize("apart, touching", [(0.0, True), (0.98e-6, True), (1.02e-6, False)])
def test_nodes_of_two_pieces_touch_within_a_millionth_of_a_cells_share_of_the_extent(apart, touching):
    """8 nodes in a box of length 2: 1e-6 x 2 / 8^(1/3). The sides, of radius sqrt(5) / 3, reach 0.75e-6."""
    said, = fitting(np.concatenate([UNIT, UNIT + (1 + apart, 0, 0)]), [[0, 1, 2, 3], [4, 5, 6, 7]], "tetrahedron")
    assert ("; 1 nodes of one lie where another has one too" in said) == touching and "lie on sides" not in said
    assert said.startswith("the body is of 2 pieces that share no node: piece 1 has 1 cell from (3, -2, 5) to (4, -1, 6) m; piece 2 has")


def test_nodes_of_one_piece_never_touch():
    fan = [*UNIT, *(UNIT[:1] + [(1, 1e-9, 0), (0, 1, 1e-9), (-1, 0, 0)])]  # two cells at one node, two of whose others nearly meet
    said, = fitting([*fan, *(UNIT + 9)], [[0, 2, 1, 3], [0, 5, 4, 6], [7, 8, 9, 10]], "tetrahedron")
    assert "another has one too" not in said and "piece 1 has 2 cells" in said


@pytest.mark.parametrize("off, on", [(0.9e-7, True), (1.1e-7, False)])
def test_a_node_is_on_a_side_within_a_thousandth_of_the_shortest_side(off, on):
    """A unit square, and beside it two triangles that have a side of 1e-4; a millionth of half the square's side would be 5e-7."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1 + off, 0.5, 0], [2, 0.3, 0], [2, 0.3001, 0], [1.5, 0.9, 0]])
    points[:, 2] += 4
    square, small = np.array([[0, 1, 2, 3]]), np.array([[4, 5, 6, 7]])
    cells = np.concatenate([square, small])
    facets, owner = fit._facets(cells, "quadrilateral")[0]
    assert fit._on_sides(points, cells, [facets], [owner]) == ([(4, 0)] if on else [])


def test_sides_of_three_cells_are_told_as_edges_or_faces():
    """The numbers are those of the cells, in rising order, however they stand."""
    plane = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0.5, -1, 0), (2, 2, 0), (9, 9, 0), (9, 8, 0), (8, 8, 0)]
    cells = [[5, 6, 7], [0, 1, 2], [1, 0, 3], [0, 1, 4]]
    with pytest.raises(InputError, match="cell 1, cell 2, cell 3 share one side; an edge has cells on two sides at most"):
        fitting(plane, cells, "triangle")
    with pytest.raises(InputError, match="cell 1 and cell 2 lie over one another: they are on the same side of a side that they share"):
        fitting(plane, [cells[0], cells[3], cells[1]], "triangle")
    assert len(fitting(plane, cells[:3], "triangle")) == 1  # of two pieces, and no more


def test_a_node_on_a_side_is_told_where_both_hang_together_and_counted_where_they_do_not():
    points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (2, 1, 0), (3, 0, 0), (3, 1, 0), (3, 2, 0)]
    torn = [[0, 1, 2, 3], [1, 5, 6, 4], [4, 6, 7, 2]]
    with pytest.raises(InputError, match=r"node \[4\] lies on a side of cell 0 and is none of its corners: the cells do not fit"):
        fitting(points, torn, "quadrilateral")
    beside = [(2, 0.5, 0), (3, 0.5, 0), (3, 1.5, 0), (2, 1.5, 0)]
    said, = fitting([*points[:4], *beside], [[0, 1, 2, 3], [4, 5, 6, 7]], "quadrilateral")
    assert said.endswith("; 2 nodes of one lie on sides of another's cells, where they do not hang together")


@pytest.mark.parametrize("cell, kind", [("tetrahedron", "tetrahedron10"), ("hexahedron", "hexahedron27"), ("hexahedron", "hexahedron")])
def test_cells_of_either_order_that_share_a_facet_are_in_one_part(cell, kind):
    mesh = build_mesh(Body(length=0.3, width=0.1, height=0.1, cells=(3, 1, 1), cell=cell, order=2 if CELLS[kind].first else 1))
    assert mesh.cell == kind and fit.joined(mesh.cells, kind).tolist() == [0] * len(mesh.cells)
    apart = mesh.cells[(mesh.points[mesh.cells[:, :CELLS[kind].corners], 0].mean(axis=1) // 0.1) != 1]
    assert len(apart) < len(mesh.cells) and len(set(fit.joined(apart, kind))) == 2
    assert sum(len(facets) for facets, _ in fit._facets(mesh.cells, kind)) == len(mesh.cells) * len(CELLS[kind].facets)
