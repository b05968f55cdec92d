"""Sets in DeepMind's format through the command line: cloths, plane meshes, flows in which nothing moves, and records that do not fit."""

import json

import numpy as np
import pytest

import fidelity
from datagen.files.tfrecord import write_example, write_records
from datagen.files.trajectory import read_trajectory
from learning.segments.harmonics import harmonics
from physics.mesh.shapes.boxes import rectangle
from physics.scene import Body
from tests.test_cli_file_body import CONFIG

FRAMES = 4
PLATE = rectangle(Body(shape="plate", length=1.0, width=0.5, cells=(6, 4), cell="triangle"))


def write_set(folder, fields, splits=("train", "valid", "test")):
    """A set of one record for each split."""
    folder.mkdir()
    for split in splits:
        write_records(folder / f"{split}.tfrecord", [write_example({name: array.tobytes() for name, array in fields.items()})])
    static = ("cells", "mesh_pos", "node_type")
    features = {name: {"type": "static" if name in static else "dynamic", "shape": [len(array), -1, array.shape[2]],
                       "dtype": array.dtype.name} for name, array in fields.items()}
    (folder / "meta.json").write_text(json.dumps({"features": features, "trajectory_length": FRAMES}))
    return folder


def plane(cell="triangle", **more):
    """A plate's fields with a mesh_pos of two components, its left edge held."""
    mesh = rectangle(Body(shape="plate", length=1.0, width=0.5, cells=(6, 4), cell=cell))
    kind = np.zeros((1, len(mesh.points), 1), np.int32)
    kind[0, mesh.places["x-min"]] = 3
    return {"cells": mesh.cells[None].astype(np.int32), "mesh_pos": mesh.points[None, :, :2].astype(np.float32), "node_type": kind, **more}


def hanging():
    """(T, N, 3) positions of the plate as a cloth that hangs in the x-z plane and swings out along y."""
    x, y, _ = PLATE.points.T
    out = [np.stack([x, 0.05 * t * x**2, y], axis=1) for t in range(FRAMES)]
    return np.array(out, np.float32)


def run(capsys, *words):
    status = fidelity.main([str(word) for word in words])
    out, err = capsys.readouterr()
    return status, out, err


def refused(capsys, words, *command):
    status, out, err = run(capsys, *command)
    assert status == 2 and out == "" and err.count("\n") == 1 and words in err, err


@pytest.mark.parametrize(("cell", "vtk"), [("triangle", 5), ("quadrilateral", 9)])
def test_cells_of_a_plane_mesh_are_plane(capsys, tmp_path, cell, vtk):
    write_set(tmp_path / "in", plane(cell, velocity=np.ones((FRAMES, 35, 2), np.float32)), ["train"])
    assert run(capsys, "dataset", "import", tmp_path / "in", "--out", tmp_path / "out")[0] == 0
    made = read_trajectory(tmp_path / "out" / "train" / "0000.vtkhdf")
    assert set(made.types.tolist()) == {vtk} and made.mesh.cell == cell and made.mesh.dimension == 2
    assert run(capsys, "dataset", "export", tmp_path / "out", "--out", tmp_path / "back")[0] == 0
    again = json.loads((tmp_path / "back" / "meta.json").read_text())["features"]
    assert again["mesh_pos"]["shape"] == [1, -1, 2] and again["cells"]["shape"][2] == made.mesh.cells.shape[1]
    (tmp_path / "config.toml").write_text(CONFIG)
    refused(capsys, "nothing moves in this set", "train", tmp_path / "config.toml", "--data", tmp_path / "out", "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_four_nodes_in_space_are_a_tetrahedron_with_a_volume_whichever_way_round():
    from datagen.sets.deepmind import from_fields
    from physics.mesh.quality import cell_volumes

    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]], np.float32)
    for cell in ([0, 1, 2, 3], [0, 2, 1, 3]):
        made = from_fields({"cells": np.array([[cell]], np.int32), "mesh_pos": corners, "node_type": np.zeros((1, 4, 1), np.int32)})
        assert made.mesh.cell == "tetrahedron" and cell_volumes(made.points, made.mesh.cells, "tetrahedron") == pytest.approx([1 / 6])


SOLID = {"cells": np.array([[[0, 1, 2, 3]]], np.int32), "mesh_pos": np.eye(4, 3, dtype=np.float32)[None],
         "node_type": np.zeros((1, 4, 1), np.int32), "world_pos": np.zeros((FRAMES, 4, 3), np.float32)}


@pytest.mark.parametrize(("changes", "words"), [
    ({"world_pos": np.zeros((2 * FRAMES, 2, 3), np.float32)}, "world_pos has 2 nodes, mesh_pos has 4"),
    ({"node_type": np.zeros((1, 2, 1), np.int32)}, "node_type has 2 nodes, mesh_pos has 4"),
    ({"mesh_pos": np.zeros((1, 4, 3), np.float32)}, "cell 0, a tetrahedron, has no volume"),
    ({"mesh_pos": np.eye(4, 1, dtype=np.float32)[None]}, "mesh_pos has 1 numbers"),
    ({"mesh_pos": np.eye(4, 2, dtype=np.float32)[None], "cells": np.array([[[0, 1, 2, 3, 0, 1]]], np.int32)}, "has 2 components"),
    ({"cells": np.zeros((1, 1, 4), np.float32)}, "whole numbers are expected"),
    ({"node_type": np.full((1, 4, 1), 7, np.int32)}, "node_type has a 7"),
    ({"node_type": np.ones((1, 4, 1), np.int32)}, "none of a body"),
    ({"world_pos": np.full((FRAMES, 4, 3), np.nan, np.float32)}, "displacement is not finite"),
    ({"cells": np.zeros((1, 0, 4), np.int32)}, "no cells"),
    ({"mesh_pos": np.concatenate([SOLID["mesh_pos"]] * 2), "node_type": SOLID["node_type"]}, "mesh_pos has 2 rows")])
def test_fields_that_do_not_fit_each_other_are_refused_in_a_line(capsys, tmp_path, changes, words):
    write_set(tmp_path / "in", SOLID | changes, ["train"])
    refused(capsys, words, "dataset", "import", tmp_path / "in", "--out", tmp_path / "out")


def test_a_cloth_is_segmented_trained_and_held_against_its_data_without_equations(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_set(tmp_path / "in", plane(world_pos=hanging()))
    truth = "cloth/test/0000.vtkhdf"
    (tmp_path / "config.toml").write_text('modes = "laplacian"\n' + CONFIG)
    for command in (["dataset", "import", "in", "--out", "cloth"], ["dataset", "check", "cloth"],
                    ["dataset", "stats", "cloth", "--refined", "1"],
                    ["segment", truth, "--segments", "3", "--method", "slic-md", "--modes", "laplacian"],
                    ["train", "config.toml", "--data", "cloth", "--out", "run"], ["rollout", "run", truth, "--out", "p.vtkhdf"]):
        assert run(capsys, *command)[0] == 0, command
    status, out, _ = run(capsys, "verify", "p.vtkhdf", "--reference", truth, "--json")
    found, free = json.loads(out), read_trajectory(truth).free
    off = (read_trajectory("p.vtkhdf").displacement.astype(float) - read_trajectory(truth).displacement)[1:, free]
    assert status == 0 and found["rmsd_all"] == pytest.approx(np.sqrt((off**2).sum(axis=2).mean()), rel=1e-12)
    assert found["relative_residual"] is None and found["smallest_det_f"] is None and found["mc"] is not None
    status, out, _ = run(capsys, "evaluate", "run", "--data", "cloth", "--out", "report", "--json")
    rows = {row["name"]: row for row in json.loads(out)["rows"]}
    assert status == 0 and rows.keys() == {"M4GN", "nothing moves", "keep the last velocity", "quadratic extrapolation"}
    moved = np.linalg.norm(read_trajectory(truth).displacement[1:, free].astype(float), axis=2)
    assert rows["nothing moves"]["scores"]["rmsd_all"] == pytest.approx(np.sqrt((moved**2).mean()), rel=1e-9)
    refused(capsys, "holds no scene", "rollout", "run", truth, "--out", "c.vtkhdf", "--correct", "1")


def test_a_cloth_has_the_laplacian_modes_of_the_plate_that_it_is_wherever_it_hangs():
    from datagen.sets.deepmind import from_fields

    lying, swinging = (harmonics(from_fields(plane(world_pos=position)), count=3)
                       for position in (np.repeat(PLATE.points[None].astype(np.float32), 2, axis=0), hanging()))
    np.testing.assert_allclose(swinging[0], lying[0], rtol=1e-5)  # positions are of single precision
    exact = (np.pi / 2) ** 2  # held at x = 0 of a length of 1 m and free elsewhere: sin(pi x / 2)
    assert lying[0][0] == pytest.approx(exact, rel=0.02)


def test_a_mesh_of_triangles_with_an_obstacle_of_triangles_keeps_them_apart():
    from datagen.sets.deepmind import from_fields, to_fields

    points = np.concatenate([PLATE.points, PLATE.points[:3] + [0.0, 0.0, 1.0]]).astype(np.float32)
    n = len(PLATE.points)
    kind = np.zeros((1, n + 3, 1), np.int32)
    kind[0, n:] = 1
    made = from_fields({"cells": np.concatenate([PLATE.cells, [[n, n + 1, n + 2]]])[None].astype(np.int32), "node_type": kind,
                        "mesh_pos": points[None, :, :2], "world_pos": np.repeat(points[None], 2, axis=0)})
    assert np.array_equal(made.mesh.cells, PLATE.cells) and made.obstacle[1].tolist() == [[0, 1, 2]]
    assert to_fields(made)["cells"].shape == (1, len(PLATE.cells), 3)
    assert to_fields(made)["obstacle_cells"].tolist() == [[[n, n + 1, n + 2]]]
