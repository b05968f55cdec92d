"""Places: names that stand for several things, faces for tractions, and places by coordinates."""

import numpy as np
import pytest

import fidelity
from physics.body.supports import nodal_areas, traction_load
from physics.mesh.files import read_mesh
from physics.mesh.mesh import Mesh
from physics.mesh.places import called
from physics.mesh.shapes.boxes import box
from physics.modes.elastic import elastic_modes
from physics.scene import Body, Where, load_scene, read_scene
from physics.schema import InputError
from physics.solution import solve

MATERIAL = {"young_modulus": 1e6, "poisson_ratio": 0.3}
BODY = {"length": 0.4, "width": 0.1, "height": 0.1, "cells": [4, 1, 1], "cell": "hexahedron"}


def gmsh_text(mesh, groups, names=""):
    """A .msh file of version 2.2: each group a type of gmsh's, a tag, and cells."""
    rows = [(kind, tag, row + 1) for kind, tag, rows in groups for row in rows]
    nodes = [f"{i + 1} {x[0]!r} {x[1]!r} {x[2]!r}" for i, x in enumerate(mesh.points.tolist())]
    cells = [f"{i + 1} {kind} 2 {tag} {tag} {' '.join(map(str, row))}" for i, (kind, tag, row) in enumerate(rows)]
    return "\n".join(["$MeshFormat", "2.2 0 8", "$EndMeshFormat", *names.splitlines(), "$Nodes", str(len(nodes)), *nodes, "$EndNodes",
                      "$Elements", str(len(cells)), *cells, "$EndElements", ""])


@pytest.fixture
def one_number(tmp_path):
    """A beam whose wall, one of whose edges and which itself are all number 1, its tip number 2, and a face inside number 3."""
    mesh = box(Body(**BODY | {"cells": (4, 1, 1)}))
    wall, tip, inside = mesh.cells[0, [0, 1, 2, 3]], mesh.cells[3, [4, 5, 6, 7]], mesh.cells[1, [4, 5, 6, 7]]
    path = tmp_path / "part.msh"
    path.write_text(gmsh_text(mesh, [(5, 1, mesh.cells), (3, 1, [wall]), (1, 1, [wall[:2]]), (3, 2, [tip]), (3, 3, [inside])]))
    return path


def scene(path, **more):
    return read_scene({"body": {"shape": "file", "path": str(path)}, "material": MATERIAL, "steps": {"count": 1}} | more)


def test_a_number_that_is_a_face_and_a_region_is_neither_alone(one_number):
    mesh = read_mesh(one_number)
    assert set(mesh.places) == {"region-1", "face-1", "edge-1", "2", "3"}
    with pytest.raises(InputError, match="'1' stands for several places of the mesh: write 'edge-1' or 'face-1' or 'region-1'"):
        elastic_modes(scene(one_number, support=[{"where": "1"}]))
    found = elastic_modes(scene(one_number, support=[{"where": "face-1"}]), count=4)
    assert found.frequencies_hz == pytest.approx([3.82586, 3.82586, 12.3362, 20.3992], rel=4e-6)
    assert len(mesh.place("edge-1")) == 2 and len(mesh.place("region-1")) == 20


def test_what_has_the_same_nodes_goes_by_its_name_whatever_it_is():
    """Abaqus's programs write a set of nodes and one of cells under one name; only if they are the same place is it one."""
    cells = np.array([[0, 1, 2, 3]])
    places, parts, mixed = called({("A", 3): [("tetrahedron", cells)], ("B", 3): [("tetrahedron", cells)]},
                                  {"A": np.array([3, 2, 1, 0]), "B": np.array([0, 1])}, 3)
    assert places["A"].tolist() == [0, 1, 2, 3] and mixed == {"B": ("nodes-B", "region-B")}
    assert places["nodes-B"].tolist() == [0, 1] and set(parts) == {"A", "region-B"}
    assert set(called({("1", 2): [("triangle", cells[:, :3])], ("1", 1): [("line", cells[:, :2])]}, {}, 2)[0]) == {"region-1", "edge-1"}


@pytest.mark.parametrize("where, words", [
    ("edge-1", "load[0].where = 'edge-1': has no facet; a traction needs a face"),
    ("region-1", "load[0].where = 'region-1': is a region, and which of its facets are meant is not said; a traction needs a face"),
    ("face-1 edge-1", "has no facet"), ("region-1 2", None), ("face-1 2", "have no node in common"), ("2", None), ("3", None),
    ({"near": [0.4, 0, 0], "within": 0.01}, "load[0].where = { near = [0.4, 0.0, 0.0], within = 0.01 }: has no facet")])
def test_a_traction_needs_a_face_and_an_inner_one_will_do(one_number, where, words):
    given = scene(one_number, support=[{"where": "face-1"}], load=[{"where": where, "traction": [0, 0, 100.0]}])
    if words:
        with pytest.raises(InputError) as caught:
            solve(given)
        assert words in str(caught.value)
    else:
        force = traction_load(given, read_mesh(one_number))
        assert force.sum(axis=0) == pytest.approx([0, 0, 1.0]) and np.count_nonzero(force[:, 2]) == 4
        assert solve(given).displacement[-1, :, 2].max() > 1e-4


def test_a_face_that_a_group_lists_twice_bears_a_traction_once(tmp_path):
    """As where gmsh keeps a face for each of two volumes: round it one way and the other."""
    mesh = box(Body(**BODY | {"cells": (4, 1, 1)}))
    end = mesh.cells[3, 4:]
    (tmp_path / "part.msh").write_text(gmsh_text(mesh, [(5, 9, mesh.cells), (3, 2, [mesh.cells[0, :4]]), (3, 4, [end, end[::-1]])]))
    given = scene(tmp_path / "part.msh", support=[{"where": "2"}], load=[{"where": "4", "traction": [0, 0, 1.0]}])
    assert traction_load(given, read_mesh(tmp_path / "part.msh")).sum(axis=0) == pytest.approx([0, 0, 0.01])  # of 0.1 m by 0.1 m


def test_faces_of_a_group_that_are_no_sides_of_the_body_are_not_dropped(tmp_path):
    mesh = box(Body(**BODY | {"cells": (4, 1, 1)}))
    across = mesh.cells[0, [0, 1, 6, 7]]  # from one side of the first cell to the other
    groups = [(5, 9, mesh.cells), (3, 2, [mesh.cells[0, :4]]), (3, 4, [mesh.cells[3, 4:], across])]
    (tmp_path / "part.msh").write_text(gmsh_text(mesh, groups))
    with pytest.raises(InputError, match=r"load\[0\].where = '4': 1 of its 2 faces are no sides of the body's cells"):
        solve(scene(tmp_path / "part.msh", support=[{"where": "2"}], load=[{"where": "4", "traction": [0, 0, 1.0]}]))


def test_a_traction_on_an_edge_of_a_shape_is_refused_before_any_work(tmp_path, capsys):
    text = read_scene({"body": BODY, "material": MATERIAL, "support": [{"where": "x-min"}], "steps": {"count": 1},
                       "load": [{"where": "x-max z-max", "traction": [0, 0, 1.0]}]}).to_toml()
    (tmp_path / "scene.toml").write_text(text)
    assert fidelity.main(["simulate", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "a.vtkhdf")]) == 2
    assert capsys.readouterr().err == "fidelity: load[0].where = 'x-max z-max': has no facet; a traction needs a face\n"
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.parametrize("where, nodes", [
    ({"near": [0.0, 0.0, 0.0], "within": 0.1}, [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]),
    ({"near": [0.0, 0.0, 0.0], "within": 0.0}, [(0, 0, 0)]),
    ({"plane": [7.0, 0.1, 0.1], "normal": [0.0, 3.0, 3.0], "within": 1e-9}, [(x / 10, 0.1, 0.1) for x in range(5)]),
    ({"plane": [0.2, 0.0, 0.0], "normal": [-2.0, 0.0, 0.0], "within": 1e-9}, [(0.2, y, z) for y in (0, 0.1) for z in (0, 0.1)]),
    ({"box": [[0.3, 0.1, -1.0], [0.4, 0.1, 0.05]]}, [(0.3, 0.1, 0), (0.4, 0.1, 0)])])
def test_places_by_coordinates(where, nodes):
    given = read_scene({"body": BODY, "material": MATERIAL, "support": [{"where": where}]})
    mesh = box(given.body)
    assert sorted(map(tuple, mesh.points[mesh.place(given.support[0].where)].round(9).tolist())) == sorted(
        tuple(float(x) for x in node) for node in nodes)
    assert read_scene({"body": BODY, "material": MATERIAL, "support": [{"where": where}]}) == given.from_toml(given.to_toml())


def test_a_plane_is_the_face_that_a_shape_calls_by_name(tmp_path):
    plane = {"plane": [0.4, 0.0, 0.0], "normal": [1.0, 0.0, 0.0], "within": 1e-6}
    mesh = box(Body(**BODY | {"cells": (4, 1, 1)}))
    assert nodal_areas(mesh, Where(plane=(0.4, 0, 0), normal=(1, 0, 0), within=1e-6)) == pytest.approx(nodal_areas(mesh, "x-max"))
    table = {"body": BODY, "material": MATERIAL, "steps": {"count": 1}}
    one, other = (solve(read_scene(table | {"support": [{"where": "x-min"}], "load": [{"where": at, "traction": [0, 0, 50.0]}]}))
                  for at in (plane, "x-max"))
    assert np.array_equal(one.displacement, other.displacement)


@pytest.mark.parametrize("where, words", [
    ({}, "support[0].where: give exactly one of near, plane and box"),
    ({"near": [0, 0, 0], "box": [[0, 0, 0], [1, 1, 1]], "within": 1.0}, "give exactly one of near, plane and box"),
    ({"near": [0, 0, 0]}, "support[0].where.within: missing; near needs it"),
    ({"plane": [0, 0, 0], "within": 1.0}, "where.normal: missing"),
    ({"plane": [0, 0, 0], "normal": [0, 0, 0], "within": 1.0}, "where.normal must not be the zero vector"),
    ({"box": [[0, 0, 0], [1, 1, 1]], "within": 1.0}, "where.within: box takes nothing else"),
    ({"near": [0, 0, 0], "within": -1.0}, "where.within = -1.0: must be at least 0 m"), ({"nea": [0, 0, 0]}, "did you mean 'near'"),
    ({"box": [[0, 0, 0], [1, -1, 1]]}, "its first corner must have the smaller coordinates"), (3, "where must be a string"),
    ({"near": [0, 0], "within": 1.0}, "where.near must have 3 entries, not 2")])
def test_wrong_places_by_coordinates(where, words):
    with pytest.raises(InputError) as caught:
        read_scene({"body": BODY, "material": MATERIAL, "support": [{"where": where}]})
    assert words in str(caught.value)


def test_no_node_at_a_place_is_refused_with_where_the_body_is():
    mesh = box(Body(**BODY | {"cells": (4, 1, 1)}))
    with pytest.raises(InputError, match=r"no node at where = \{ near = .* \}; the body lies from \(0, 0, 0\) to \(0.4, 0.1, 0.1\) m"):
        mesh.place(Where(near=(400.0, 0, 0), within=1.0))


def test_a_file_in_millimetres_is_scaled(tmp_path):
    mesh = box(Body(**BODY | {"cells": (4, 1, 1)}))
    text = gmsh_text(Mesh(mesh.points * 1000, mesh.cells, mesh.cell, {}), [(5, 1, mesh.cells)])
    (tmp_path / "part.msh").write_text(text)
    (tmp_path / "scene.toml").write_text('[body]\nshape = "file"\npath = "part.msh"\nscale = 0.001\n[material]\nyoung_modulus = 1e6\n'
                                         'poisson_ratio = 0.3\n[[support]]\nwhere = { box = [[0, 0, 0], [0, 1, 1]] }\n')
    found = elastic_modes(load_scene(tmp_path / "scene.toml"), count=3)
    assert found.frequencies_hz == pytest.approx([3.82586, 3.82586, 12.3362], rel=4e-6)
    with pytest.raises(InputError, match=r"body.scale: a beam takes"):
        read_scene({"body": BODY | {"scale": 2.0}, "material": MATERIAL})
