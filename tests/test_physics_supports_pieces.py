"""Bodies of several pieces or of hinged parts: what holds them and what is free; faces of second order, and places that are none."""

from dataclasses import replace

import numpy as np
import pytest

from physics.body import supports
from physics.body.supports import loose, nodal_areas, outer_facets, pieces_held, traction_load
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body, Load, Support
from physics.schema import InputError
from tests.scenes import beam

CORNER = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def pieces(count):
    """Tetrahedra in a row along x, two metres apart."""
    points = np.concatenate([CORNER + [2.0 * k, 0, 0] for k in range(count)])
    return Mesh(points, np.arange(4 * count).reshape(-1, 4), "tetrahedron", {f"p{k}": np.arange(4 * k, 4 * k + 4) for k in range(count)})


def test_what_holds_each_piece_is_said_of_the_first_five():
    mesh = pieces(7)
    some = replace(beam(), support=(Support(where="p1"), Support(where="p3", fixed="x"), Support(where="p3")))
    words = ["piece 1 by nothing", "piece 2 by 'p1'", "piece 3 by nothing", "piece 4 by 'p3'", "piece 5 by nothing"]
    assert pieces_held(some, mesh) == (f"held are {'; '.join(words)}; ...",)
    five = Mesh(mesh.points[:20], mesh.cells[:5], "tetrahedron", {name: mesh.places[name] for name in ("p1", "p3")})
    assert pieces_held(some, five) == (f"held are {'; '.join(words)}",)
    both = replace(mesh, places={"p1": np.array([4, 12]), "p3": np.array([12])})
    assert pieces_held(some, both)[0].split("; ")[1:4] == ["piece 2 by 'p1'", "piece 3 by nothing", "piece 4 by 'p1' and 'p3'"]
    assert pieces_held(some, pieces(1)) == ()


def test_of_several_pieces_each_is_held_by_itself():
    mesh, fixed = pieces(3), np.zeros((12, 3), bool)
    fixed[[0, 1, 2, 4, 5, 6, 8]] = True
    fixed[9, 1] = True  # beyond the first point along x: what is left turns about x and about y
    said = "2 rigid motions of one of 3 pieces left free: piece 3 has 1 cell from (4, 0, 0) to (5, 1, 1) m; fix more components"
    assert loose(mesh, fixed) == said
    fixed[9, 2] = True
    assert loose(mesh, fixed).startswith("1 rigid motion of one of 3 pieces left free: piece 3")
    fixed[10, 2] = True
    assert loose(mesh, fixed) == ""
    fixed[4:8] = False
    assert loose(mesh, fixed).startswith("6 rigid motions of one of 3 pieces left free: piece 2")
    one = np.zeros((4, 3), bool)
    one[[0, 1]] = True
    assert loose(pieces(1), one) == "1 rigid motion of the body left free; fix more components"
    assert loose(pieces(1), 0 * one > 0) == "6 rigid motions of the body left free; fix more components"


def test_a_node_of_no_cell_is_held_by_itself_too():
    mesh, fixed = pieces(1), np.ones((5, 3), bool)
    mesh = replace(mesh, points=np.concatenate([mesh.points, [[9.0, 9, 9]]]))
    fixed[4] = False
    assert loose(mesh, fixed).startswith("6 rigid motions of one of 2 pieces left free: piece 2 has 0 cells from (9, 9, 9)")


def chain(count):
    """Tetrahedra that hang together at single nodes: the tip of each along x is the corner of the next."""
    points = [np.array([[0.0, 0, 0]])]
    points += [CORNER[1:] + [k, 0, 0] for k in range(count)]
    cells = [[3 * k - 2 if k else 0, 3 * k + 1, 3 * k + 2, 3 * k + 3] for k in range(count)]
    return Mesh(np.concatenate(points), np.array(cells), "tetrahedron", {})


@pytest.mark.parametrize("count", [2, 3, 5])
def test_links_of_a_chain_turn_about_their_nodes_in_three_ways_each(count):
    mesh = chain(count)
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[:4] = True  # the first one; a hinge is where the next begins
    free = 3 * (count - 1)
    said = "motions left free: parts of the mesh hang together at single nodes or edges and turn about them; let them share faces"
    assert loose(mesh, fixed).startswith(f"{free} {said}")
    fixed[mesh.cells[-1]] = True  # the last one too: between, each turns about the line, and each hinge goes two ways across it
    between = {2: 0, 3: 1, 5: 3 + 2 * 2}[count]
    found = loose(mesh, fixed)
    assert found.startswith(f"{between} motion{'s' if between > 1 else ''} left free: ") if between else found == ""


def test_hinges_are_looked_at_in_a_hundred_parts_at_most(monkeypatch):
    assert supports.MOST_PARTS == 100
    mesh = chain(3)
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[:4] = True
    monkeypatch.setattr(supports, "MOST_PARTS", 3)
    assert loose(mesh, fixed)
    monkeypatch.setattr(supports, "MOST_PARTS", 2)
    assert not loose(mesh, fixed)


@pytest.mark.parametrize(("cell", "shares"), [
    ("tetrahedron", {"corner": 0.0, "side": 1 / 3}), ("hexahedron", {"corner": 1 / 36, "side": 1 / 9, "middle": 4 / 9})])
def test_areas_of_second_order_are_in_the_middles_of_flat_triangles_and_by_simpsons_rule_on_squares(cell, shares):
    mesh = build_mesh(Body(length=0.4, width=0.3, height=0.2, cells=(2, 3, 2), cell=cell, order=2))
    areas, expected = nodal_areas(mesh, "z-max"), np.zeros(len(mesh.points))
    for facets in mesh.facets("z-max"):
        for facet in facets:
            corners = 4 if len(facet) == 9 else 3
            size = 0.2 * 0.1 / (1 if corners == 4 else 2)
            for k, node in enumerate(facet):
                expected[node] += size * (shares["corner"] if k < corners else shares["side"] if k < 2 * corners else shares["middle"])
    assert areas == pytest.approx(expected, abs=1e-15) and areas.sum() == pytest.approx(0.12)


def test_forces_need_a_face():
    made = beam(body={"length": 0.3, "width": 0.2, "height": 0.1, "cells": [3, 2, 1]})
    mesh = build_mesh(made.body)
    for load, needs in ((Load(where="x-max z-max", traction=(1.0, 0.0, 0.0)), "a traction needs a face"),
                        (Load(where="x-max z-max", pressure=1.0), "a pressure needs an outer face")):
        with pytest.raises(InputError, match=rf"^load\[1\]\.where = 'x-max z-max': has no facet; {needs}$"):
            traction_load(replace(made, load=(Load(acceleration=(0.0, 0.0, 1.0)), load)), mesh)
    dead, following = Load(where="y-max", pressure=50.0), Load(where="x-max", pressure=70.0, follower=True)
    pushed = traction_load(replace(made, load=(dead, following)), mesh)
    assert pushed.sum(axis=0) == pytest.approx([0, -50 * 0.03, 0]) and (pushed[mesh.points[:, 1] < 0.2 - 1e-9] == 0).all()
    assert sum(len(facets) for facets in outer_facets(mesh, "y-max", "load[0].where")) == 3


def test_a_pressure_on_a_side_of_a_plane_body_is_times_its_thickness():
    made = beam(body={"shape": "plate", "length": 0.3, "width": 0.2, "cells": [3, 2], "cell": "quadrilateral", "thickness": 0.05},
                support=[])
    mesh = build_mesh(made.body)
    for load, sum_ in ((Load(where="x-max", pressure=100.0), [-1, 0, 0]), (Load(where="x-max", traction=(0.0, 100.0, 0.0)), [0, 1, 0])):
        assert traction_load(replace(made, load=(load,)), mesh).sum(axis=0) == pytest.approx(sum_)
