"""The checkpoint of plates on bodies of a file's mesh: an answer with a bar within the ranges of its training, unsure outside of them."""

from dataclasses import replace
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from scipy.spatial import cKDTree

import fidelity
from datagen.files.trajectory import read_trajectory
from learning.bodies.path import predict
from learning.prediction.checkpoint import load_model
from physics import build_mesh, load_scene
from physics.mesh.shapes.boxes import box
from physics.scene import Body

RUN = Path(__file__).parent.parent / "assets" / "plate-fast"
SCENE = """
[body]
shape = "file"
path = "plate.msh"
[material]
young_modulus = 1e6
poisson_ratio = {ratio}
[[support]]
where = "wall"
[obstacle]
shape = "sphere"
radius = 0.015
{path}
[steps]
count = 8
"""
PLACE = 'place = { face = "z-max", along = 0.7, across = 0.45, gap = 0.001, depth = 0.014 }'  # which sweeps take


def write(folder, *, height=0.01, cells=(14, 11, 2), cell="hexahedron", ratio=0.4, path=""):
    """A plate of 100 x 80 mm in gmsh's format, its end at x = 0 named "wall", and a scene in which a sphere presses it by 14 mm."""
    mesh = box(Body(shape="plate", length=0.1, width=0.08, height=height, cells=cells, cell=cell))
    wall = next(facets for facets in mesh.facets("x-min") if len(facets))
    tags = [np.full(len(mesh.cells), 2), np.full(len(wall), 1)]
    kinds = {"hexahedron": ("hexahedron", "quad"), "tetrahedron": ("tetra", "triangle")}
    meshio.Mesh(mesh.points, list(zip(kinds[cell], (mesh.cells, wall), strict=True)),
                cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
                field_data={"wall": np.array([1, 2]), "body": np.array([2, 3])}
                ).write(folder / "plate.msh", file_format="gmsh22", binary=False)
    path = path or f"path = [[0.07, 0.036, {height + 0.016}], [0.07, 0.036, {height + 0.001}]]"
    (folder / "press.toml").write_text(SCENE.format(ratio=ratio, path=path))
    return folder / "press.toml"


def test_a_plate_of_a_file_is_rolled_out_within_the_bar_and_near_finite_elements(tmp_path, monkeypatch):
    write(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert fidelity.main(["simulate", "press.toml", "--out", "t.vtkhdf"]) == 0
    assert fidelity.main(["rollout", str(RUN), "t.vtkhdf", "--out", "p.vtkhdf"]) == 0
    truth, found = read_trajectory("t.vtkhdf"), read_trajectory("p.vtkhdf")
    off, motion = (np.sqrt((u[:, truth.free] ** 2).sum(axis=2).mean(axis=1))
                   for u in (found.displacement - truth.displacement, truth.displacement))
    assert off[2:].mean() < 0.04 * motion[2:].mean() and motion[-1] > 5e-3
    assert not found.per_frame["unsure"].any() and (off < 2 * found.per_frame["error_bar"] + 1e-5).all()


def predicted(folder, **changes):
    scene = load_scene(write(folder, **changes))
    mesh = build_mesh(scene.body)
    return predict(load_model(RUN), scene, mesh), mesh.points


def test_other_cells_of_a_file_are_told_the_same_and_what_was_never_seen_is_unsure(tmp_path):
    """The last frame at nodes that both meshes have; a plate of twice the thickness, and another Poisson's ratio."""
    (one, points), (other, places) = predicted(tmp_path), predicted(tmp_path, cells=(7, 11, 3), cell="tetrahedron")
    assert not one.unsure.any() and not other.unsure.any()
    away, twin = cKDTree(places).query(points)
    both = away < 1e-9
    assert both.sum() == 8 * 12 * 2
    off = abs(one.displacement[-1, both] - other.displacement[-1, twin[both]])
    assert off.max() < 5e-4 and abs(one.displacement[-1]).max() > 1e-2  # contact is felt at other points
    for changes in ({"height": 0.02}, {"ratio": 0.3}):
        assert predicted(tmp_path, **changes)[0].unsure[2:].all()


def test_many_paths_over_a_plate_of_a_file_are_what_each_is_alone(tmp_path):
    """Within the ranges and, under a sphere of 5 cm, outside of them; of the force nothing is known."""
    scene = write(tmp_path, path=PLACE)
    asked = ["sweep", str(scene), "--vary", "obstacle.radius=0.011,0.018,0.05", "--frames", "8,3,5", "--predictor", str(RUN)]
    assert fidelity.main([*asked, "--out", str(tmp_path / "s.h5")]) == 0
    with h5py.File(tmp_path / "s.h5") as file:
        assert file["unsure"][:, 0].tolist() == [False, False, True] and np.isnan(file["force"][:]).all()
        assert file["varied/obstacle.radius"][:].tolist() == [0.011, 0.018, 0.05]
        for number, radius in enumerate((0.011, 0.018)):
            alone = load_scene(write(tmp_path, path=f"path = [[0.07, 0.036, {0.011 + radius}], [0.07, 0.036, {radius - 0.004}]]"))
            alone = replace(alone, obstacle=replace(alone.obstacle, radius=radius))
            path = predict(load_model(RUN), alone, build_mesh(alone.body))
            assert np.allclose(file["displacement"][number], path.displacement[[8, 3, 5]], atol=1e-7)
            assert np.allclose(file["bar"][number], path.bar[[8, 3, 5]], rtol=1e-4)
            assert file["largest"][number, 0] == pytest.approx(np.linalg.norm(path.displacement[8], axis=1).max(), rel=1e-5)
