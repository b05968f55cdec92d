"""Mesh files of all kinds, written here by meshio: the same body gives the same modes, and groups name places."""

import json

import meshio
import numpy as np
import pytest

import fidelity
from physics.mesh.build import build_mesh
from physics.mesh.files import read_mesh
from physics.modes.elastic import elastic_modes
from physics.modes.laplacian import laplacian_modes
from physics.scene import load_scene, read_body, read_scene
from physics.schema import InputError

MATERIAL = {"young_modulus": 1e6, "poisson_ratio": 0.3, "density": 1000.0}
MESHIO = {"prism": "wedge", "tetrahedron": "tetra", "quadrilateral": "quad", "hexahedron": "hexahedron", "triangle": "triangle"}
FACET = {2: "line", 3: "triangle", 4: "quad"}


def shape(cell):
    plane = cell in ("triangle", "quadrilateral")
    sides = {"length": 0.4, "width": 0.1} | ({} if plane else {"height": 0.1})
    return {"shape": "plate" if plane else "beam", "cell": cell, "cells": [8, 2] if plane else [8, 2, 2]} | sides


def write(path, cell, *, named=True, **options):
    """A cantilever with its two ends as physical groups, as gmsh would write it."""
    mesh = build_mesh(read_body({"body": shape(cell)}))
    blocks, tags = [(MESHIO[cell], mesh.cells)], [np.full(len(mesh.cells), 3)]
    data = {}
    if named:
        for tag, place in ((1, "x-min"), (2, "x-max")):
            for facets in filter(len, mesh.facets(place)):
                blocks.append((FACET[facets.shape[1]], facets))
                tags.append(np.full(len(facets), tag))
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    names = {"wall": [1, mesh.dimension - 1], "tip": [2, mesh.dimension - 1], "body": [3, mesh.dimension]} if named else {}
    points = np.concatenate([mesh.points, [[9.0, 9.0, 0.0]]])  # a node of no cell, as gmsh leaves them
    entity = np.tile([mesh.dimension, 3], (len(points), 1))  # format 4 knows which geometry each node lies on
    for tag, place in ((1, "x-min"), (2, "x-max")):
        entity[mesh.places[place]] = mesh.dimension - 1, tag
    meshio.Mesh(points, blocks, cell_data=data, point_data={"gmsh:dim_tags": entity} if path.suffix == ".msh" else {},
                field_data={k: np.array(v) for k, v in names.items()}).write(path, **options)
    return mesh


def reference(cell):
    return elastic_modes(read_scene({"body": shape(cell), "material": MATERIAL,
                                     "support": [{"where": "x-min", "fixed": "xyz"}]}), count=4).frequencies_hz


@pytest.mark.parametrize("cell", list(MESHIO))
@pytest.mark.parametrize("file_format", ["gmsh22", "gmsh"])
def test_gmsh_groups_are_places(tmp_path, cell, file_format):
    write(tmp_path / "part.msh", cell, file_format=file_format)
    (tmp_path / "scene.toml").write_text('[body]\nshape = "file"\npath = "part.msh"\n[material]\nyoung_modulus = 1e6\n'
                                         'poisson_ratio = 0.3\n[[support]]\nwhere = "wall"\nfixed = "xyz"\n')
    modes = elastic_modes(load_scene(tmp_path / "scene.toml"), count=4)
    assert {"wall", "tip", "body"} <= set(modes.mesh.places)
    assert modes.frequencies_hz == pytest.approx(reference(cell), rel=1e-7)


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".xdmf", ".inp", ".msh"])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron", "prism"])
def test_files_without_names_have_their_whole_boundary_held(tmp_path, ending, cell):
    mesh = write(tmp_path / f"part{ending}", cell, named=False)
    modes = laplacian_modes(read_body({"body": {"shape": "file", "path": str(tmp_path / f"part{ending}")}}), count=2)
    expected = laplacian_modes(read_body({"body": shape(cell)}), count=2)
    assert len(modes.mesh.points) == len(mesh.points) and modes.mesh.cell == cell
    assert modes.eigenvalues == pytest.approx(expected.eigenvalues, rel=1e-9)


@pytest.mark.parametrize("ending", [".vtu", ".xdmf"])
def test_groups_without_names_go_by_their_number(tmp_path, ending):
    write(tmp_path / f"part{ending}", "tetrahedron")
    mesh = read_mesh(tmp_path / f"part{ending}")
    assert {"1", "2", "3"} <= set(mesh.places)
    assert (mesh.points[mesh.places["1"], 0] < 1e-9).all() and (mesh.points[mesh.places["2"], 0] > 0.4 - 1e-9).all()


def test_point_sets_of_abaqus(tmp_path):
    whole = build_mesh(read_body({"body": shape("hexahedron")}))
    meshio.Mesh(whole.points, [("hexahedron", whole.cells)], point_sets={"WALL": whole.places["x-min"]}).write(tmp_path / "part.inp")
    table = {"body": {"shape": "file", "path": str(tmp_path / "part.inp")}, "material": MATERIAL,
             "support": [{"where": "WALL", "fixed": "xyz"}]}
    assert elastic_modes(read_scene(table), count=4).frequencies_hz == pytest.approx(reference("hexahedron"), rel=1e-9)


def test_second_order_on_a_file_holds_the_edges_of_a_group_and_no_others(tmp_path):
    """The corner cells of a cube have edges inside whose ends both lie on the boundary: these stay free."""
    write(tmp_path / "part.msh", "tetrahedron", file_format="gmsh22")
    table = {"body": {"shape": "file", "path": str(tmp_path / "part.msh"), "order": 2}}
    built = read_body({"body": shape("tetrahedron") | {"order": 2}})
    for names, faces in ((["wall", "tip"], ["x-min", "x-max"]), (None, None)):
        found, expected = (laplacian_modes(body, count=3, dirichlet=where) for body, where in ((read_body(table), names), (built, faces)))
        assert found.eigenvalues == pytest.approx(expected.eigenvalues, rel=1e-9) and found.dofs == expected.dofs


def test_lines_and_points_of_a_file_are_places(tmp_path):
    """FV52's kind of support: an edge; the groups may have any dimension."""
    mesh = build_mesh(read_body({"body": shape("hexahedron")}))
    edge, corner = mesh.place("x-min z-min"), mesh.place("x-min z-min y-min")
    lines = np.stack([edge[:-1], edge[1:]], axis=1)
    blocks = [("hexahedron", mesh.cells), ("line", lines), ("vertex", corner[:, None])]
    tags = [np.full(len(data), i + 1) for i, (_, data) in enumerate(blocks)]
    meshio.Mesh(mesh.points, blocks, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
                field_data={"all": np.array([1, 3]), "edge": np.array([2, 1]), "corner": np.array([3, 0])}
                ).write(tmp_path / "part.msh", file_format="gmsh22")
    support = [{"where": "edge", "fixed": "xz"}, {"where": "corner", "fixed": "y"}]
    shaped = [{"where": "x-min z-min", "fixed": "xz"}, {"where": "x-min y-min z-min", "fixed": "y"}]
    for order in (1, 2):
        found = elastic_modes(read_scene({"body": {"shape": "file", "path": str(tmp_path / "part.msh"), "order": order},
                                          "material": MATERIAL, "support": support}), count=3)
        expected = elastic_modes(read_scene({"body": shape("hexahedron") | {"order": order}, "material": MATERIAL,
                                             "support": shaped}), count=3)
        assert found.rigid == found.rigid_expected == 1  # it turns about the edge
        assert found.eigenvalues[1:] == pytest.approx(expected.eigenvalues[1:], rel=1e-8) and found.dofs == expected.dofs


def test_cells_inside_out_and_of_second_order_are_read(tmp_path):
    mesh = build_mesh(read_body({"body": shape("tetrahedron")}))
    pairs = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    keys = np.sort(mesh.cells[:, pairs].reshape(-1, 2), axis=1)
    edges, number = np.unique(keys, axis=0, return_inverse=True)
    points = np.concatenate([mesh.points, mesh.points[edges].mean(axis=1)])
    cells = np.concatenate([mesh.cells, len(mesh.points) + number.reshape(-1, 6)], axis=1)
    cells[::2] = cells[::2][:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]  # mirrored: negative volume
    meshio.Mesh(points, [("tetra10", cells)]).write(tmp_path / "part.vtu")
    found = read_mesh(tmp_path / "part.vtu")
    x = found.points[found.cells]
    assert len(found.points) == len(mesh.points) and (np.linalg.det(x[:, 1:] - x[:, :1]) > 0).all()
    assert found.remarks == ("96 of 192 cells were inside out and have been turned",)  # their sides are straight


@pytest.mark.parametrize("content, words", [
    ("nonsense", "not a mesh file"),
    (None, "no such file"),
    (meshio.Mesh(np.eye(3), [("line", [[0, 1]])]), "points and lines only"),
    (meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]), "a surface in space"),
    (meshio.Mesh(np.eye(3) * [1, 1, 0], [("triangle", [[0, 1, 1]])]), "it has no area"),
    (meshio.Mesh(np.random.default_rng(0).random((5, 3)), [("pyramid", [[0, 1, 2, 3, 4]])]), "pyramid"),
    (meshio.Mesh(np.random.default_rng(0).random((9, 2)) @ np.eye(2, 3), [("triangle", [[0, 1, 2]]), ("quad", [[3, 4, 5, 6]])]),
     "quadrilateral and triangle cells"),
])
def test_files_that_are_no_body_end_in_one_line_and_status_2(tmp_path, capsys, content, words):
    path = tmp_path / "part.vtu"
    if isinstance(content, str):
        path.write_text(content)
    elif content is not None:
        content.write(path)
    (tmp_path / "scene.toml").write_text('[body]\nshape = "file"\npath = "part.vtu"\n')
    status = fidelity.main(["modes", str(tmp_path / "scene.toml"), "--kind", "laplacian", "--json"])
    out, err = capsys.readouterr()
    assert status == 2 and out == "" and err.count("\n") == 1 and words in err


def test_unknown_groups_are_refused_by_name(tmp_path):
    write(tmp_path / "part.msh", "tetrahedron", file_format="gmsh")
    table = {"body": {"shape": "file", "path": str(tmp_path / "part.msh")}, "material": MATERIAL, "support": [{"where": "wal"}]}
    with pytest.raises(InputError, match=r"no place named 'wal' in the mesh: .*did you mean 'wall'"):
        elastic_modes(read_scene(table))


def test_a_mesh_file_alone_has_laplacian_modes(tmp_path, capsys):
    write(tmp_path / "part.msh", "triangle", file_format="gmsh")
    assert fidelity.main(["modes", str(tmp_path / "part.msh"), "--kind", "laplacian", "--dirichlet", "wall", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["eigenvalues"][0] == pytest.approx((np.pi / 0.8) ** 2, rel=1e-2)  # open everywhere else
    assert fidelity.main(["modes", str(tmp_path / "part.msh")]) == 2
    assert "need a scene" in capsys.readouterr().err
