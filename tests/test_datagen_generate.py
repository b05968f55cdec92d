"""Generation: the same arrays from any number of workers, whole files kept, failures recorded; the check sees damage."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from datagen import dataset, generate
from datagen.family import draw, load_family
from datagen.trajectory import HANDLE, OBSTACLE, PER_FRAME, problems, read_trajectory, write_trajectory
from physics.obstacle import Rigid
from physics.schema import InputError

ROOT = Path(__file__).parents[1]
SMALL = """
name = "small"
[body]
length = { uniform = [0.08, 0.1] }
width = 0.02
height = 0.02
cells = [6, 2, 2]
[material]
young_modulus = 1e6
poisson_ratio = 0.4
[[support]]
where = "x-min"
[obstacle]
shape = "cylinder"
radius = 0.01
place = { along = 0.8, gap = 0.001, depth = 0.01 }
[steps]
count = 6
[splits]
train = 2
valid = 1
test = 1
"""
COUNTS = {"train": 2, "valid": 1, "test": 1}
FILES = ["train/0000.vtkhdf", "train/0001.vtkhdf", "valid/0000.vtkhdf", "test/0000.vtkhdf"]


@pytest.fixture(scope="module")
def family(tmp_path_factory):
    path = tmp_path_factory.mktemp("family") / "small.toml"
    path.write_text(SMALL)
    return load_family(path)


@pytest.fixture(scope="module")
def original(family, tmp_path_factory):
    """A small data set made by two workers; tests copy it before they change it."""
    folder = tmp_path_factory.mktemp("original")
    report = generate.generate(family, COUNTS, folder, workers=2)
    assert (report["trajectories"], report["new"], report["failed_attempts"]) == (4, 4, 0)
    return folder


@pytest.fixture
def folder(original, tmp_path):
    subprocess.run(["cp", "-r", original, tmp_path / "data"], check=True)
    return tmp_path / "data"


def sums(folder):
    return {entry.file: entry.sha256 for entry in dataset.read_manifest(folder).trajectories}


def test_a_trajectory_holds_its_scene(family):
    scene = draw(family, 0, 0)
    assert scene.obstacle is not None
    made = generate.trajectory_of(scene, seed=0, index=0)
    assert problems(made) == [] and dataset.against_scene(made) == []
    assert made.displacement.shape == (7, len(made.points), 3)
    held = made.points[made.node_kind == HANDLE]
    assert len(held) == 9 and not held[:, 0].any()  # the 3 x 3 nodes of x-min
    # The obstacle's nodes lie on the cylinder and, at the end, where its centre is.
    surface = (made.points + made.displacement[-1])[made.node_kind == OBSTACLE]
    rigid = Rigid(scene.obstacle)
    distance, _ = rigid.gap(surface, rigid.position(1.0))
    assert distance.max() < 1e-8 and abs(distance).min() < 1e-8  # single precision of 1e-2 m; the ends have a middle node
    # Its triangles look outwards: the closed surface holds a positive volume, the cylinder's less what its polygon cuts off.
    corners = surface[made.cells_of(5) - len(made.points) + len(surface)]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert 0.8 < volume / (np.pi * 0.01**2 * np.ptp(surface[:, 1])) < 1
    assert np.linalg.norm(made.modes[0], axis=1).max() == pytest.approx(1)
    assert not made.modes[0][made.node_kind == OBSTACLE].any()
    assert {"dolfinx", "petsc4py", "slepc4py", "h5py", "numpy"} <= made.versions.keys()


def test_a_path_that_ends_early_is_kept_and_says_so(family):
    scene = draw(family, 0, 0)
    solution = generate.solve(scene)
    rows = {name: getattr(solution, name)[:3] for name in ("displacement", *PER_FRAME)}
    early = generate.trajectory_of(scene, solution=dataclasses.replace(solution, **rows, failure="no equilibrium at step 3"))
    whole = generate.trajectory_of(scene, solution=solution)
    assert not early.complete and early.extra["failure"] == "no equilibrium at step 3"
    assert np.array_equal(early.displacement, whole.displacement[:3])


def test_one_worker_makes_the_same_arrays_as_two(family, original, tmp_path):
    generate.generate(family, COUNTS, tmp_path, workers=1)
    assert sums(tmp_path) == sums(original) and sorted(sums(tmp_path)) == sorted(FILES)
    assert dataset.check(original) == []
    assert [path.name for path in dataset.files(original, "train")] == ["0000.vtkhdf", "0001.vtkhdf"]


def test_what_is_there_is_kept_and_what_is_missing_is_made(family, original, folder):
    (folder / FILES[1]).unlink()
    (folder / FILES[2]).write_bytes((folder / FILES[2]).read_bytes()[:5000])
    (folder / "train" / ".0001.vtkhdf.1.part").touch()
    before = {file: (folder / file).stat().st_mtime_ns for file in (FILES[0], FILES[3])}
    assert generate.generate(family, COUNTS, folder, workers=1)["new"] == 2
    assert before == {file: (folder / file).stat().st_mtime_ns for file in before}
    assert sums(folder) == sums(original) and dataset.check(folder) == [] and not list(folder.rglob("*.part"))


def test_a_data_set_can_grow(family, original, folder):
    generate.generate(family, {"train": 3}, folder, workers=1)
    assert sums(original).items() < sums(folder).items() and len(sums(folder)) == 5


def test_a_folder_of_something_else_is_refused(family, folder):
    with pytest.raises(InputError, match="another family or seed"):
        generate.generate(family, COUNTS, folder, seed=1)
    with pytest.raises(InputError, match="workers = 0"):
        generate.generate(family, COUNTS, folder, workers=0)


def test_a_failed_scene_is_recorded_and_replaced(family, tmp_path, monkeypatch):
    def fails_at_first(scene, **given):
        made = honest(scene, **given)
        failed = dataclasses.replace(made, complete=False, extra={"failure": "no way"})
        return failed if scene == draw(family, 0, 0) else made

    honest = generate.trajectory_of
    monkeypatch.setattr(generate, "trajectory_of", fails_at_first)
    job = generate.Job(family, tmp_path, FILES[0], 0, 0)
    entry, reasons = generate._make(job)
    assert reasons == ["no way"] and entry is not None and entry.failed_attempts == ("no way",)
    assert read_trajectory(tmp_path / FILES[0]).scene == draw(family, 0, 0, attempt=1).to_toml()
    assert generate._made(job, {}) == entry


def test_a_family_that_cannot_be_solved_ends_with_the_reason(family, tmp_path):
    table = {**family.table, "support": []}
    with pytest.raises(RuntimeError, match="rigid motions"):
        generate.generate(dataclasses.replace(family, table=table), {"test": 1}, tmp_path, workers=1)


def test_a_killed_run_goes_on(family, original, tmp_path):
    """Killed outright, with its workers in the middle of their work: they end too, and another call completes the set."""
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "go.py").write_text(f"""
from datagen import generate, family
if __name__ == '__main__':
    generate.generate(family.load_family({str(tmp_path / "small.toml")!r}), {COUNTS}, {str(tmp_path / "data")!r}, workers=2)
""")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MARK": str(tmp_path)}
    started = subprocess.Popen([sys.executable, tmp_path / "go.py"], env=environment)
    assert soon(lambda: len(marked(tmp_path)) >= 3)  # itself and two workers
    started.send_signal(signal.SIGKILL)
    started.wait()
    assert soon(lambda: not marked(tmp_path)), "workers outlive the process that started them"
    generate.generate(family, COUNTS, tmp_path / "data", workers=1)
    assert sums(tmp_path / "data") == sums(original)


def marked(folder):
    """The processes that were started with MARK set to a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            ours = f"MARK={folder}\0".encode() in (path / "environ").read_bytes()
            if ours and b"resource_tracker" not in (path / "cmdline").read_bytes():
                found.append(path.name)
        except OSError:  # gone in the meantime
            continue
    return found


def soon(condition):
    """True when a condition comes true within a minute."""
    deadline = time.monotonic() + 60
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)
    return condition()


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
    found = dataset.check(folder)
    assert any(message in line for line in found) and all(FILES[1] in line for line in found), found


def test_the_check_sees_bad_and_missing_and_unlisted_files(folder):
    (folder / FILES[0]).write_bytes((folder / FILES[0]).read_bytes()[:-2000])
    (folder / FILES[2]).unlink()
    (folder / "train" / "0007.vtkhdf").write_bytes((folder / FILES[1]).read_bytes())
    with h5py.File(folder / FILES[3], "r+") as file:
        file["VTKHDF/FieldData/energy"][2] *= 1.001
    found = dataset.check(folder)
    for file, words in ((FILES[0], "not a whole"), (FILES[2], "no such file"), ("train/0007.vtkhdf", "not in the manifest"),
                        (FILES[3], "checksum")):
        assert sum(file in line and words in line for line in found) == 1, found
    assert len(found) == 4


def test_a_folder_without_a_manifest_is_refused(folder):
    (folder / "manifest.json").write_text(json.dumps({"schema": 1}))
    with pytest.raises(InputError, match="family: missing"):
        dataset.check(folder)
    (folder / "manifest.json").unlink()
    with pytest.raises(InputError, match="No such file"):
        dataset.check(folder)
    with pytest.raises(InputError, match="no trajectory files"):
        dataset.files(folder / "nowhere", "train")
