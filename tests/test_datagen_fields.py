"""`simulate --fields stress`: what stands in the file, as VTK and h5py read it, and that it outlives check, pack and unpack."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
import pyvista
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

import fidelity
from datagen.files.fields import stress_fields
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets import dataset
from datagen.sets.check import against_scene, check
from datagen.sets.generate import trajectory_of
from datagen.sets.pack import pack, unpack
from physics.body.stress import nodal_stress
from physics.scene import Scene
from physics.solution import solve
from tests.scenes import beam, pressed

# A bar that is pulled to a stretch of 1.2 between slippery supports: uniaxial stress, so sigma = (s, 0, 0) and von Mises = s.
PULLED = {"body": {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [3, 2, 2]},
          "material": {"law": "saint-venant-kirchhoff", "young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 2},
          "support": [{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"}, {"where": "z-min", "fixed": "z"},
                      {"where": "x-max", "fixed": "x", "displacement": [0.012, 0, 0]}]}


def uniaxial(stretch):
    """Cauchy stress of Saint-Venant-Kirchhoff: S = E (stretch^2 - 1) / 2, sigma = stretch S / (lateral stretch)^2."""
    strain = (stretch**2 - 1) / 2
    return stretch * 1e6 * strain / (1 - 2 * 0.3 * strain)


@pytest.fixture(scope="module")
def pulled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pulled")
    (folder / "pulled.toml").write_text(beam(**PULLED).to_toml())
    assert fidelity.main(["simulate", str(folder / "pulled.toml"), "--out", str(folder / "p.vtkhdf"), "--fields", "stress"]) == 0
    assert fidelity.main(["simulate", str(folder / "pulled.toml"), "--out", str(folder / "plain.vtkhdf")]) == 0
    return folder


def test_a_pulled_bar_has_the_uniaxial_stress_of_its_law_in_vtk(pulled):
    reader = vtkHDFReader()
    reader.SetFileName(str(pulled / "p.vtkhdf"))
    for step, stretch in ((0, 1.0), (1, 1.1), (2, 1.2)):
        reader.SetStep(step)
        reader.Update()
        data = reader.GetOutput().GetPointData()
        tensor, measure = (vtk_to_numpy(data.GetArray(name)) for name in ("stress", "von_mises"))
        np.testing.assert_allclose(tensor, np.tile([uniaxial(stretch), 0, 0, 0, 0, 0], (len(tensor), 1)), atol=1.0)  # the solver's 1e-6
        np.testing.assert_allclose(measure.ravel(), uniaxial(stretch), atol=1.0)
    grid = pyvista.wrap(reader.GetOutput())
    assert grid.point_data["stress"].shape == (grid.n_points, 6) and grid.point_data["von_mises"].shape == (grid.n_points,)


def test_without_the_flag_the_file_is_as_before(pulled):
    with h5py.File(pulled / "plain.vtkhdf") as file:
        assert "stress" not in file["VTKHDF/PointData"] and "fields" not in file.attrs
    plain, asked = (read_trajectory(pulled / name) for name in ("plain.vtkhdf", "p.vtkhdf"))
    assert np.array_equal(plain.displacement, asked.displacement) and list(asked.fields) == ["stress", "von_mises"]


def test_the_components_stand_in_the_order_of_vtk():
    """xx, yy, zz, xy, yz, xz: VTK's own symmetric tensor, made full by its filter, gives back the one that was put in."""
    solution = solve(beam(load=[{"where": "x-max", "traction": [10.0, 20.0, -30.0]}], steps={"count": 1}))
    scene = beam(load=[{"where": "x-max", "traction": [10.0, 20.0, -30.0]}], steps={"count": 1})
    trajectory = trajectory_of(scene, solution=solution)
    stress = stress_fields(scene, solution, trajectory)["stress"][1]
    full = np.empty((len(stress), 3, 3))
    for place, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))):
        full[:, i, j] = full[:, j, i] = stress[:, place]
    middle = (abs(solution.mesh.points[:, 0] - 0.03) < 1e-9)
    # The mean over the section is the traction, in each component: sigma . e_x.
    mean = full[middle].mean(axis=0)
    assert mean[0, 1] == pytest.approx(20, rel=0.3) and mean[0, 2] == pytest.approx(-30, rel=0.3) and abs(mean[1, 2]) < 2


def test_stress_is_zero_on_the_obstacle_and_outlives_check_pack_and_unpack(tmp_path):
    scene = pressed(steps={"count": 6})
    solution = solve(scene)
    made = trajectory_of(scene, solution=solution)
    made = replace(made, fields=stress_fields(scene, solution, made), index=0)
    assert not made.fields["stress"][:, ~made.body].any() and made.fields["stress"][-1, made.body].any(axis=1).all()
    assert against_scene(made) == []
    folder = tmp_path / "set"
    write_trajectory(folder / "train/0000.vtkhdf", made)
    dataset.write_manifest(folder, dataset.Manifest(schema=dataset.SCHEMA, family="", seed=0,
                                                    trajectories=(dataset.entry_of("train/0000.vtkhdf", made),)))
    assert check(folder) == []
    pack(folder, tmp_path / "set.pack")
    unpack(tmp_path / "set.pack", tmp_path / "again")
    assert check(tmp_path / "again") == []
    read = read_trajectory(tmp_path / "again/train/0000.vtkhdf")
    for name, field in made.fields.items():
        assert np.array_equal(read.fields[name], field)


def test_a_set_is_made_with_stress_and_its_stress_is_that_of_its_displacements(tmp_path, family, capsys):
    """The set without it has the same motion; asked for again with stress, its files are made anew, and not a second time."""
    (tmp_path / "family.toml").write_text(family.text)
    words = ["generate", str(tmp_path / "family.toml"), "--out", str(tmp_path / "set"), "--count", "1", "--split", "test", "--workers", "1"]
    assert fidelity.main(words) == 0
    path = tmp_path / "set/test/0000.vtkhdf"
    plain = read_trajectory(path)
    for new in (1, 0):
        assert fidelity.main([*words, "--fields", "stress", "--json"]) == 0
        assert json.loads(capsys.readouterr().out.splitlines()[-1])["new"] == new
    asked = read_trajectory(path)
    assert not plain.fields and np.array_equal(plain.displacement, asked.displacement)
    scene, mesh = Scene.from_toml(asked.scene), asked.mesh
    for t in (2, 6):
        sigma = nodal_stress(mesh, asked.displacement[t, asked.body].astype(float), scene.material)
        stored = asked.fields["stress"][t, asked.body]
        assert abs(stored - sigma[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]).max() < 1e-3 * abs(sigma).max()
    assert check(tmp_path / "set") == [] and not asked.fields["von_mises"][:, ~asked.body].any()
    for name, wrong in (("stress", 1.001), ("von_mises", 0.999)):
        other = replace(asked, fields=asked.fields | {name: asked.fields[name] * np.float32(wrong)})
        assert "stress at step" in against_scene(other)[0]


def test_another_field_is_refused(pulled, capsys):
    with pytest.raises(SystemExit) as error:
        fidelity.main(["simulate", str(pulled / "pulled.toml"), "--out", str(pulled / "x.vtkhdf"), "--fields", "strain"])
    assert error.value.code == 2 and not (pulled / "x.vtkhdf").exists()
    assert json.dumps(capsys.readouterr().err).count("--fields") >= 1


def test_a_prediction_of_which_stress_is_asked_must_have_it(pulled, capsys):
    plain, truth = (str(pulled / name) for name in ("plain.vtkhdf", "p.vtkhdf"))
    assert fidelity.main(["verify", truth, "--reference", truth, "--fields", "stress"]) == 0
    assert "von_mises" in capsys.readouterr().out
    assert fidelity.main(["verify", plain, "--reference", truth, "--fields", "stress"]) == 2
    assert "plain.vtkhdf: has no stress" in capsys.readouterr().err
    assert fidelity.main(["verify", plain, "--reference", truth]) == 0
