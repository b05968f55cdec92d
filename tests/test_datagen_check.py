"""The check of a data set finds each kind of damage, names the file, and ends with status 1."""

import dataclasses
import json
import shutil

import h5py
import numpy as np
import pytest

import fidelity
from datagen.family.family import load_family
from datagen.files.trajectory import OBSTACLE, read_trajectory, write_trajectory
from datagen.sets import check, dataset
from datagen.sets.generate import generate, trajectory_of
from physics.scene import read_scene
from physics.schema import InputError
from tests.small_set import FILES


def damage_displacement(path, change):
    found = read_trajectory(path)
    displacement = found.displacement.copy()
    change(displacement, found)
    write_trajectory(path, dataclasses.replace(found, displacement=displacement))


def free_node_moves(u, found):
    u[3, np.flatnonzero(found.free)[0], 0] += 1e-6


def held_node_moves(u, found):
    u[3, 0, 0] += 1e-6


def obstacle_moves(u, found):
    u[3, found.node_kind == OBSTACLE] += 1e-6


def steps_swapped(u, found):
    u[[4, 5]] = u[[5, 4]]


def cell_inverts(u, found):
    u[6, np.flatnonzero(found.free)[0]] += 0.05


def body_stays(u, found):
    u[:, found.free] = 0


@pytest.mark.parametrize(("change", "message"), [
    (free_node_moves, "checksum"), (held_node_moves, "held nodes leave"), (obstacle_moves, "leaves its path"),
    (steps_swapped, "leaves its path"), (cell_inverts, "inverted"), (body_stays, "penetrates")])
def test_the_check_names_the_file_and_what_is_wrong(folder, change, message):
    damage_displacement(folder / FILES[1], change)
    found = check.check(folder)
    assert any(message in line for line in found) and all(FILES[1] in line for line in found), found


def test_the_check_sees_bad_and_missing_and_unlisted_files(folder):
    (folder / FILES[0]).write_bytes((folder / FILES[0]).read_bytes()[:-2000])
    (folder / FILES[2]).unlink()
    (folder / "train" / "0007.vtkhdf").write_bytes((folder / FILES[1]).read_bytes())
    with h5py.File(folder / FILES[3], "r+") as file:
        file["VTKHDF/FieldData/energy"][2] *= 1.001
    found = check.check(folder)
    for file, words in ((FILES[0], "not a whole"), (FILES[2], "no such file"), ("train/0007.vtkhdf", "not in the manifest"),
                        (FILES[3], "checksum"), (FILES[3], "energy")):
        assert sum(file in line and words in line for line in found) == 1, found
    assert len(found) == 5


def test_a_folder_without_a_manifest_is_refused(folder):
    (folder / "manifest.json").write_text(json.dumps({"schema": 1}))
    with pytest.raises(InputError, match="family: missing"):
        check.check(folder)
    (folder / "manifest.json").unlink()
    with pytest.raises(InputError, match="No such file"):
        check.check(folder)
    with pytest.raises(InputError, match="no trajectory files"):
        dataset.files(folder / "nowhere", "train")


@pytest.fixture(scope="module")
def pressed_far(tmp_path_factory):
    """Two trajectories with large strains in the smallest number of cells, so that a wrong law shows."""
    folder = tmp_path_factory.mktemp("far")
    text = open("datagen/families/demo.toml").read().replace("cell_size = 0.006", "cell_size = 0.011").replace("count = 100", "count = 20")
    (folder / "far.toml").write_text(text)
    generate(load_family(folder / "far.toml"), {"test": 2}, folder / "data", workers=1)
    return folder / "data"


@pytest.fixture
def far(pressed_far, tmp_path):
    shutil.copytree(pressed_far, tmp_path / "far")
    return tmp_path / "far"


def resealed(folder, file, change):
    """A file changed by someone who also corrects its checksum."""
    trajectory = change(read_trajectory(folder / file))
    write_trajectory(folder / file, trajectory)
    manifest = dataset.read_manifest(folder)
    entries = tuple(dataclasses.replace(entry, sha256=dataset.digest(trajectory)) if entry.file == file else entry
                    for entry in manifest.trajectories)
    dataset.write_manifest(folder, dataclasses.replace(manifest, trajectories=entries))


def other_law(trajectory):
    return dataclasses.replace(trajectory, scene=trajectory.scene.replace('"neo-hookean"', '"neo-hookean-log"'))


def other_modulus(trajectory):
    return dataclasses.replace(trajectory, scene=trajectory.scene.replace("1000000.0", "1000100.0"))


def other_energy(trajectory):
    return dataclasses.replace(trajectory, per_frame=trajectory.per_frame | {"energy": trajectory.per_frame["energy"] * (1 + 1e-6)})


def other_reaction(trajectory):
    return dataclasses.replace(trajectory, per_frame=trajectory.per_frame | {"reaction": trajectory.per_frame["reaction"] * 1.001})


def body_swapped(trajectory):
    u = trajectory.displacement.copy()
    body = trajectory.body
    u[15, body], u[16, body] = u[16, body].copy(), u[15, body].copy()
    return dataclasses.replace(trajectory, displacement=u)


def node_nudged(trajectory):
    u = trajectory.displacement.copy()
    u[20, np.flatnonzero(trajectory.free)[7]] += 1e-6
    return dataclasses.replace(trajectory, displacement=u)


@pytest.mark.parametrize(("change", "message"), [
    (other_law, "no equilibrium"), (other_modulus, "energy"), (other_energy, "energy"), (other_reaction, "reaction"),
    (body_swapped, "at step 16;"), (node_nudged, "no equilibrium at step 20")])
def test_physics_is_computed_anew(far, capsys, change, message):
    """Nothing but the equations tells that these are wrong: layout and checksum are right."""
    assert check.check(far) == []
    resealed(far, "test/0001.vtkhdf", change)
    found = check.check(far)
    assert len(found) == 1 and message in found[0] and "test/0001.vtkhdf" in found[0]
    assert fidelity.main(["dataset", "check", str(far)]) == 1
    assert "test/0001.vtkhdf" in capsys.readouterr().err


def test_every_flipped_byte_of_the_results_is_found(folder):
    """Bytes flipped in arrays, wherever they lie in the file."""
    path = folder / FILES[0]
    data = path.read_bytes()
    with h5py.File(path) as file:
        places = [file["VTKHDF/PointData/displacement"].id.get_chunk_info(3).byte_offset + 5]
        places += [file[f"VTKHDF/{name}"].id.get_offset() + 3
                   for name in ("Points", "Connectivity", "FieldData/energy", "PointData/mode_1")]
    for place in places:
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x40]) + data[place + 1:])
        found = check.check(folder)
        assert found and all(FILES[0] in line for line in found), place


@pytest.mark.parametrize("law", ["neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"])
@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
def test_honest_trajectories_pass(law, cell):
    """The bound on what rounding may do has room for every law and cell, at small and at large forces."""
    scene = read_scene({
        "body": {"length": 0.05, "width": 0.02, "height": 0.02, "cells": [4, 1, 1], "cell": cell},
        "material": {"law": law, "young_modulus": 3e4, "poisson_ratio": 0.3}, "support": [{"where": "x-min"}],
        "obstacle": {"shape": "sphere", "radius": 0.01, "path": [[0.04, 0.01, 0.031], [0.04, 0.01, 0.027]]}, "steps": {"count": 6}})
    trajectory = trajectory_of(scene)
    assert check.against_scene(trajectory, steps=6) == []
    blurred = trajectory.displacement + 1e-8 * np.random.default_rng(0).normal(size=trajectory.displacement.shape).astype(np.float32)
    blurred[:, ~trajectory.free] = trajectory.displacement[:, ~trajectory.free]
    # A tenth of what a packed set may be off by, yet many times the rounding: seen, and allowed when the file says so.
    blurred = dataclasses.replace(trajectory, displacement=blurred.astype(np.float32))
    assert check.against_scene(blurred, steps=6) != []
    assert check.against_scene(dataclasses.replace(blurred, extra={"tolerance": 1e-7}), steps=6) == []
