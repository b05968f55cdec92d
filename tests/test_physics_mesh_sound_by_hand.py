"""The geometry behind the judgement of a mesh, against determinants, differences, literal searches and closed forms."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from physics.mesh.cell import CELLS
from physics.mesh.files import _mesh
from physics.mesh.formats.raw import VTK_MIDDLES, CellBlock, Raw
from physics.mesh.shapes.boxes import box
from physics.mesh.sound import cells as sound
from physics.mesh.sound import curved, fit
from physics.scene import Body
from physics.schema import InputError

LOCAL = {"triangle": [(0, 0), (1, 0), (0, 1)], "quadrilateral": [(0, 0), (1, 0), (1, 1), (0, 1)],
         "tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
         "prism": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
         "hexahedron": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]}
BEND = np.array([[2.0, 0.3, 0.1], [0.2, 1.5, -0.4], [-0.1, 0.25, 3.0]])


def placed(kind, power=0.0):
    """The corners of one cell, (n, 3), by a linear map, and something of second order; none of them in the origin."""
    x = np.zeros((len(LOCAL[kind]), 3))
    x[:, :len(LOCAL[kind][0])] = LOCAL[kind]
    x = x @ BEND + power * x[:, [1, 2, 0]] * x + (7, -5, 3)
    return x * (1, 1, CELLS[kind].dimension == 3)


@pytest.mark.parametrize("kind", LOCAL)
def test_at_each_corner_a_cells_edges_span_the_determinant_over_the_product_of_their_lengths(kind):
    d = CELLS[kind].dimension
    for power in (0.0, 0.4):
        x = placed(kind, power)
        wanted = []
        for i in range(len(x)):
            ends = [a + b - i for a, b in CELLS[kind].edges if i in (a, b)]
            edges = (x[ends] - x[i])[:, :d]
            wanted.append(abs(np.linalg.det(edges)) / np.linalg.norm(edges, axis=1).prod())
        cells = np.arange(len(x))[None]
        assert sound.corners(x, cells, kind)[0] == pytest.approx(wanted)
        assert sound.corners(x * (1, -1, 1), cells, kind)[0] == pytest.approx(-np.array(wanted))


def test_the_determinant_of_three_rows():
    rows = np.random.default_rng(0).normal(size=(4, 2, 3, 3))
    assert sound._triple(rows) == pytest.approx(np.linalg.det(rows))


@pytest.mark.parametrize("kind, share", [("triangle", 1), ("quadrilateral", 2), ("tetrahedron", 1), ("prism", 1), ("hexahedron", 1)])
def test_the_size_of_a_cell_is_the_determinant_of_its_sides_beside_their_product(kind, share):
    """Of a quadrilateral the sides are its diagonals, (1, 1) and (-1, 1) in its own coordinates, which span 2."""
    d = CELLS[kind].dimension
    x = placed(kind)
    size, product = sound._volume(x, np.arange(len(x))[None], kind)
    sides = BEND[:d] if kind != "quadrilateral" else np.array([[1, 1], [-1, 1]]) @ BEND[:2]
    assert size == pytest.approx([share * np.linalg.det(BEND[:d, :d])])
    assert product == pytest.approx([np.linalg.norm(sides[:, :d], axis=1).prod()])


@pytest.mark.parametrize("kind", LOCAL)
def test_the_smallest_determinant_inside_is_that_of_the_straight_map(kind):
    """Of a quadrilateral x + a (xy, 0) it is 1 + a y at the lower point of Gauss, y = 1/2 - 1/sqrt(12), or, where a < 0, the upper."""
    x = placed(kind)
    cells = np.arange(len(x))[None]
    d = CELLS[kind].dimension
    whole = np.linalg.det(BEND[:d, :d])
    assert sound._inside(x, cells, kind) == pytest.approx([whole])
    assert sound._inside(x * (1, -1, 1), cells, kind) == pytest.approx([-whole])
    if kind in ("quadrilateral", "hexahedron", "prism"):
        first = np.array([[*place, 0.0][:3] for place in LOCAL[kind]], float)
        for a in (0.5, -0.5):
            low, high = 0.5 - 12**-0.5, 0.5 + 12**-0.5
            for i, j in itertools.permutations(range(d), 2) if kind != "prism" else [(0, 2), (1, 2)]:
                bent = first.copy()
                bent[:, i] += a * first[:, i] * first[:, j]
                assert sound._inside(bent, cells, kind) == pytest.approx([1 + a * (low if a > 0 else high)])


def literal_map(kind, local, factor, place):
    """The place of a point in a curved cell, from the functions in the module's first lines."""
    x = np.zeros(3)
    lambdas = (1 - sum(place[:CELLS[kind].dimension]), *place)
    for entity, value in zip(local, factor, strict=True):
        if kind in ("triangle", "tetrahedron"):
            weight = lambdas[entity[0]] if len(entity) == 1 else 4 * lambdas[entity[0]] * lambdas[entity[1]]
        else:
            weight = 1.0
            for axis in range(CELLS[kind].dimension):
                ends = {LOCAL[kind][corner][axis] for corner in entity}
                r = place[axis]
                weight *= 4 * r * (1 - r) if len(ends) == 2 else r if ends == {1} else 1 - r
        x += weight * value
    return x


@pytest.mark.parametrize("kind", [kind for kind in LOCAL if kind != "prism"])
def test_slopes_of_a_curved_cells_functions_are_their_differences(kind):
    d = CELLS[kind].dimension
    local = [(c,) for c in range(CELLS[kind].corners)] + [entity for group in curved.entities(kind) for entity in group]
    assert len(local) == {"triangle": 6, "quadrilateral": 9, "tetrahedron": 10, "hexahedron": 27}[kind]
    factor = np.random.default_rng(1).normal(size=(len(local), 3))
    at = np.array([[0.2, 0.3, 0.1], [0.45, 0.15, 0.25]]) * np.array([1, 1, d == 3])
    slopes = np.einsum("pne,nd->ped", curved._slopes(kind, local, at), factor)
    for place, found in zip(at, slopes, strict=True):
        for axis in range(3):
            step = 1e-5 * np.eye(3)[axis] * (axis < d)
            difference = (literal_map(kind, local, factor, place + step) - literal_map(kind, local, factor, place - step)) / 2e-5
            assert found[axis] == pytest.approx(difference, abs=1e-8)


@pytest.mark.parametrize("kind", [kind for kind in LOCAL if kind != "prism"])
def test_a_curved_cell_is_looked_at_corners_middles_and_points_of_gauss(kind):
    """All of 0, 1/2, 1 and the two points of Gauss in each coordinate, of a simplex those inside."""
    d = CELLS[kind].dimension
    ends = (0.0, 0.5, 1.0, 0.5 - 12**-0.5, 0.5 + 12**-0.5)
    wanted = [p for p in itertools.product(ends, repeat=d) if kind in ("quadrilateral", "hexahedron") or sum(p) <= 1]
    found = curved._samples(kind)
    assert found.shape == (len(wanted), 3) and {tuple(p[:d]) for p in found.tolist()} == set(wanted) and not found[:, d:].any()


@pytest.mark.parametrize("kind", ["triangle", "tetrahedron"])
def test_the_smallest_determinant_of_a_curved_simplex_is_that_of_its_map(kind):
    """X = x + a y^2, Y = y + a x^2 has det J = 1 - 4 a^2 x y, which on x + y = 1 is least in the middle: 1 - a^2."""
    def bend(x, a=0.6):
        return x + a * np.stack([x[..., 1]**2, x[..., 0]**2, 0 * x[..., 0]], axis=-1)
    x = np.array([[*place, 0.0][:3] for place in LOCAL[kind]])
    cells = np.arange(len(x))[None]
    rows = np.sort(np.array(CELLS[kind].edges), axis=1)
    rows = rows[np.lexsort(rows.T[::-1])]
    assert curved.smallest_jacobian(bend(x), cells, kind, {2: (rows, bend(x[rows].mean(axis=1)))}) == pytest.approx([1 - 0.36])


def one_curved(off, kind="triangle", more=()):
    """A file of one straight-sided cell of second order, whose first middle node lies off by so much of its edge's length."""
    x = np.array([[*place, 0.0][:3] for place in LOCAL[kind]]) * 4.0
    middle = np.array([x[list(local)].mean(axis=0) for local in VTK_MIDDLES[kind]])
    middle[0, 1] -= off * 4.0
    nodes = np.arange(len(x) + len(middle))[None]
    return Raw(np.concatenate([x, middle, *more]), [CellBlock(kind, nodes, None, VTK_MIDDLES[kind])])


@pytest.mark.parametrize("kind", ["triangle", "quadrilateral", "hexahedron"])
def test_a_side_is_curved_from_thirty_millionths_of_its_length(kind):
    for off, bent in ((2.9e-5, False), (3.1e-5, True), (-3.1e-5, True)):
        told = ("cells of second order: their sides are taken as straight; order = 2 keeps them curved",) if bent else ()
        assert _mesh(one_curved(off, kind), 1, 1.0).remarks == told and _mesh(one_curved(off, kind), 1, 1.0).middles == {}
        found = _mesh(one_curved(off, kind), 2, 0.5)
        assert found.remarks == () and bool(found.middles) == bent
        if bent:
            rows, at = found.middles[2]
            assert rows[0].tolist() == [0, 1] and at[0] == pytest.approx([1, -2 * off, 0], abs=1e-15) and found.points.max() == 2.0
    with pytest.raises(InputError, match="1 of 1 curved cells are inside out somewhere, the first one at"):
        _mesh(one_curved(-0.4 if kind == "triangle" else -0.6, kind), 2, 1.0)


def test_further_nodes_of_lines_and_of_other_kinds_of_sides_are_no_middles():
    """Of a body's own cells they are; those of cells of lower dimension count for nothing, not even a remark."""
    raw = one_curved(0.0)
    line = CellBlock("line", np.array([[0, 1, 3]]), None, VTK_MIDDLES["line"])
    without = Raw(raw.points, [line, CellBlock("triangle", raw.blocks[0].nodes[:, :3])])
    assert _mesh(without, 2, 1.0).remarks == ("2 nodes of no cell left out",)
    unknown = CellBlock("triangle", raw.blocks[0].nodes, None, ())
    assert _mesh(Raw(raw.points, [line, unknown]), 2, 1.0).remarks == ("cells of second order: their sides are taken as straight",)
    bad = raw.points.copy()
    bad[4, 0] = np.nan
    with pytest.raises(InputError, match="node coordinates that are not finite"):
        _mesh(Raw(bad, raw.blocks), 2, 1.0)
    two = CellBlock("triangle", np.array([[1, 6, 2, 7, 8, 9]]), None, VTK_MIDDLES["triangle"])
    for off, words in ((2.9e-5, None), (3.1e-5, "two cells have different middle nodes")):
        length = np.sqrt(2) * 4
        more = np.array([[4, 4, 0], [4, 2, 0], [2, 4, 0], [2 - off * 4, 2, 0]], float)
        both = Raw(np.concatenate([raw.points, more]), [*raw.blocks, two])
        assert length > 4  # sizes are those of a box around the side
        if words is None:
            assert _mesh(both, 2, 1.0).middles == {}
        else:
            with pytest.raises(InputError, match=words):
                _mesh(both, 2, 1.0)


def test_nodes_of_a_curved_mesh_are_its_corners_and_then_its_middles():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    cells = np.array([[0, 1, 2], [1, 3, 2]])
    rows = np.array([[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]])
    at = points[rows].mean(axis=1) + (0, 0, 0.5)
    nodes, number = curved.table(points, cells, {2: (rows, at)}, [(0, 1), (2, 1)])
    assert np.array_equal(nodes, np.concatenate([points, at])) and number.tolist() == [[4, 6], [7, 8]]


def literal_distance(corners, p):
    """How far a point is from a triangle or a line, by a search over its points."""
    steps = np.linspace(0, 1, 201)
    if len(corners) == 2:
        return np.linalg.norm(corners[0] + steps[:, None] * (corners[1] - corners[0]) - p, axis=1).min()
    s, t = np.meshgrid(steps, steps)
    inside = s + t <= 1 + 1e-12
    points = corners[0] + s[inside][:, None] * (corners[1] - corners[0]) + t[inside][:, None] * (corners[2] - corners[0])
    return np.linalg.norm(points - p, axis=1).min()


def test_distances_from_lines_triangles_and_the_triangles_of_a_quadrilateral():
    draw = np.random.default_rng(3)
    for k in (2, 3, 4):
        x, p = draw.normal(size=(12, k, 3)), 1.5 * draw.normal(size=(12, 3))
        p[:4] = x[:4].mean(axis=1) + (0, 0.1, 0.2)
        halves = {2: [(0, 1)], 3: [(0, 1, 2)], 4: [(0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3)]}[k]
        wanted = [min(literal_distance(corners[list(half)], at) for half in halves) for corners, at in zip(x, p, strict=True)]
        assert fit._distance(x, p) == pytest.approx(wanted, abs=0.02)
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float)  # a plane, a side, a corner
    for at, wanted in (((0.25, 0.25, 0.5), 0.5), ((0.5, 0.5, -2), 2), ((1, 1, 0), 0.5**0.5), ((-3, -4, 0), 5), ((0.5, -1, 0), 1),
                       ((-1, 0.5, 0), 1), ((0.5, 0.5, 0), 0), ((1, 0, 0), 0)):
        assert fit._distance(triangle, np.array([at], float)) == pytest.approx([wanted], abs=1e-15)


def test_two_ways_round_a_facet_are_opposite_wherever_they_begin():
    for k in (2, 3, 4):
        row = np.array([[7, 3, 9, 5][:k]])
        for turn in range(k):
            if k > 2 or turn == 0:  # of an edge the other turn is the other way
                assert fit._reversed(row, np.roll(row[:, ::-1], turn, axis=1)).all()
                assert not fit._reversed(row, np.roll(row, turn, axis=1)).any()
    unit = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, -1, 0]])
    assert fit.fitting(unit, np.array([[0, 1, 2], [1, 0, 3]]), "triangle", str, str) == []
    with pytest.raises(InputError, match="0 and 1 lie over one another: they are on the same side of a side that they share"):
        fit.fitting(unit * (1, -1, 1) ** (np.arange(4) == 3)[:, None], np.array([[0, 1, 2], [0, 1, 3]]), "triangle", str, str)


def test_cells_that_share_a_side_are_in_one_part_and_those_that_share_an_edge_are_not():
    cells = box(Body(length=0.3, width=0.1, height=0.1, cells=(3, 1, 1), cell="prism")).cells
    assert len(set(fit.joined(cells, "prism"))) == 1
    keep = np.delete(np.arange(len(cells)), [2, 3])  # of three pairs the middle one
    assert len(set(fit.joined(cells[keep], "prism"))) == 2
    hinge = np.array([[0, 1, 2, 3], [1, 2, 4, 5], [4, 1, 2, 6]])  # the first shares an edge only
    assert fit.joined(hinge, "tetrahedron").tolist() == [0, 1, 1]
    assert fit.piece_of(9, np.array([[0, 1, 2, 3], [5, 6, 7, 3]])).tolist() == [0, 0, 0, 0, 1, 0, 0, 0, 2]


@pytest.mark.parametrize("at, found", [((1, 0.5), True), ((1 - 0.9e-6 * 0.5, 0.5), True), ((1 + 0.9e-6 * 0.5, 0.25), True),
                                       ((1 + 1.2e-6 * 0.5, 0.25), False), ((1, 2.0), False), ((1, 1e-5), True)])
def test_a_node_is_on_a_side_up_to_a_millionth_of_half_its_length(at, found):
    """The side of a unit square from (1, 0) to (1, 1); the node belongs to a triangle beside it."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [*at, 0], [2, 0.2, 0], [2, 0.8, 0], [2, 1.4, 0]], float)
    cells = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
    outer, owner = [], []
    for facets, cell_of in fit._facets(cells, "quadrilateral"):
        outer.append(facets[cell_of == 0])
        owner.append(cell_of[cell_of == 0])
    outer[0], owner[0] = np.concatenate([outer[0], [[4, 5]]]), np.append(owner[0], 1)
    assert fit._on_sides(points, cells, outer, owner) == ([(4, 0)] if found else [])


def test_of_many_pieces_five_are_described_and_what_touches_is_counted():
    unit = np.array(LOCAL["tetrahedron"], float)
    names = SimpleNamespace(cell=str, node=str)

    def said(shifts):
        points = np.concatenate([unit + shift for shift in shifts])
        return fit.fitting(points, np.arange(len(points)).reshape(-1, 4), "tetrahedron", names.cell, names.node)

    apart = [(3.0 * i, 0, 0) for i in range(6)]
    assert said(apart[:1]) == []
    for many in (2, 5, 6):
        pieces = "; ".join(f"piece {i + 1} has 1 cell from ({3 * i}, 0, 0) to ({3 * i + 1}, 1, 1) m" for i in range(min(many, 5)))
        assert said(apart[:many]) == [f"the body is of {many} pieces that share no node: {pieces}{'; ...' if many > 5 else ''}"]
    beside, = said([(0, 0, 0), (1, 0, 0)])
    assert beside.endswith("; 1 nodes of one lie where another has one too: merge them if they belong together")
    on, = said([(0, 0, 0), (0.25, -1, 0)])  # its corner (0.25, 0, 0) lies on an edge of the first, whose origin lies on no side of it
    assert on.endswith("; 1 nodes of one lie on sides of another's cells, where they do not hang together") and "merge" not in on
