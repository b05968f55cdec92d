"""Generation: the same arrays from any number of workers, here or on a cluster; whole files kept, failures recorded."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import fidelity
from datagen.family.family import draw, load_family
from datagen.files.trajectory import HANDLE, OBSTACLE, problems, read_trajectory, write_trajectory
from datagen.sets import check, dataset, generate
from physics.contact.obstacles import Rigid
from physics.schema import InputError
from tests.full_disk import full_after
from tests.small_set import COUNTS, FILES, SMALL

ROOT = Path(__file__).parents[1]
PER_FRAME = ("reaction", "energy", "penetration", "smallest_det_f", "newton_iterations", "relative_residual", "snap", "released")


def sums(folder):
    return {entry.file: entry.sha256 for entry in dataset.read_manifest(folder).trajectories}


def test_a_trajectory_holds_its_scene(family):
    scene = draw(family, 0, 0)
    assert scene.obstacle is not None
    made = generate.trajectory_of(scene, seed=0, index=0)
    assert problems(made) == [] and check.against_scene(made) == []
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
    assert len(made.modes) == 2 and made.frequencies_hz[1] == pytest.approx(made.frequencies_hz[0], rel=0.02)  # a square section bends
    assert np.linalg.norm(made.modes, axis=2).max(axis=1) == pytest.approx(1)                                  # alike in two planes
    assert not made.modes[:, made.node_kind == OBSTACLE].any()
    assert {"dolfinx", "petsc4py", "slepc4py", "h5py", "numpy"} <= made.versions.keys()


def test_a_path_that_ends_early_is_kept_and_says_so(family):
    scene = draw(family, 0, 0)
    solution = generate.solve(scene)
    rows = {name: getattr(solution, name)[:3] for name in ("displacement", *PER_FRAME) if name != "smallest_det_f"}  # which follows
    early = generate.trajectory_of(scene, solution=dataclasses.replace(solution, **rows, failure="no equilibrium at step 3"))
    whole = generate.trajectory_of(scene, solution=solution)
    assert not early.complete and early.extra["failure"] == "no equilibrium at step 3"
    assert np.array_equal(early.displacement, whole.displacement[:3])
    assert np.array_equal(early.per_frame["smallest_det_f"], whole.per_frame["smallest_det_f"][:3])


def test_one_worker_makes_the_same_arrays_as_two(family, original, tmp_path):
    generate.generate(family, COUNTS, tmp_path, workers=1)
    assert sums(tmp_path) == sums(original) and sorted(sums(tmp_path)) == sorted(FILES)
    assert check.check(original) == []
    assert [path.name for path in dataset.files(original, "train")] == ["0000.vtkhdf", "0001.vtkhdf"]


def test_what_is_there_is_kept_and_what_is_missing_is_made(family, original, folder):
    (folder / FILES[1]).unlink()
    (folder / FILES[2]).write_bytes((folder / FILES[2]).read_bytes()[:5000])
    (folder / "train" / ".0001.vtkhdf.1.part").touch()
    before = {file: (folder / file).stat().st_mtime_ns for file in (FILES[0], FILES[3])}
    assert generate.generate(family, COUNTS, folder, workers=1)["new"] == 2
    assert before == {file: (folder / file).stat().st_mtime_ns for file in before}
    assert sums(folder) == sums(original) and check.check(folder) == [] and not list(folder.rglob("*.part"))


def test_a_data_set_can_grow(family, original, folder):
    generate.generate(family, {"train": 3}, folder, workers=1)
    assert sums(original).items() < sums(folder).items() and len(sums(folder)) == 5


def test_a_folder_of_something_else_is_refused(family, folder):
    with pytest.raises(InputError, match="another family or seed"):
        generate.generate(family, COUNTS, folder, seed=1)
    with pytest.raises(InputError, match="workers = 0"):
        generate.generate(family, COUNTS, folder, workers=0)


@pytest.mark.parametrize("reason, fault", [
    ("no way", lambda made: {"complete": False, "extra": {"failure": "no way"}}),
    ("the body snaps at step 2", lambda made: {"per_frame": {**made.per_frame, "snap": 1e-3 * (np.arange(len(made.displacement)) == 2)}}),
])
def test_a_failed_scene_is_recorded_and_replaced(family, tmp_path, monkeypatch, reason, fault):
    def fails_at_first(scene, **given):
        made = honest(scene, **given)
        return dataclasses.replace(made, **fault(made)) if scene == draw(family, 0, 0) else made

    honest = generate.trajectory_of
    monkeypatch.setattr(generate, "trajectory_of", fails_at_first)
    job = generate.Job(family, tmp_path, FILES[0], 0, 0)
    entry, reasons = generate._make(job)
    assert reasons == [reason] and entry is not None and entry.failed_attempts == (reason,)
    assert read_trajectory(tmp_path / FILES[0]).scene == draw(family, 0, 0, attempt=1).to_toml()
    assert generate._made(job, {}) == entry


def test_a_family_that_cannot_be_solved_ends_with_the_reason(family, tmp_path):
    table = {**family.table, "support": []}
    with pytest.raises(RuntimeError, match="rigid motions"):
        generate.generate(dataclasses.replace(family, table=table), {"test": 1}, tmp_path, workers=1)


def test_a_run_killed_twice_goes_on(family, original, tmp_path):
    """Killed outright, twice, with its workers in the middle of their work: they end too, and what was finished is kept."""
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "go.py").write_text(f"""
from datagen.family import family
from datagen.sets import generate  # a script without "if __name__ ...", as users write them
generate.generate(family.load_family({str(tmp_path / "small.toml")!r}), {COUNTS}, {str(tmp_path / "data")!r}, workers=2)
""")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MARK": str(tmp_path)}
    kept = {}
    for finished in (0, 1):
        started = subprocess.Popen([sys.executable, tmp_path / "go.py"], env=environment)
        # The first time as soon as two workers are there, the second time as soon as they have finished a file.
        assert soon(partial(under_way, tmp_path, finished))
        started.send_signal(signal.SIGKILL)
        started.wait()
        assert soon(lambda: not marked(tmp_path)), "workers outlive the process that started them"
        assert all(whole(tmp_path / "data")[file] == time for file, time in kept.items())
        kept = whole(tmp_path / "data")
    assert kept
    generate.generate(family, COUNTS, tmp_path / "data", workers=2)
    assert all(whole(tmp_path / "data")[file] == time for file, time in kept.items())
    assert sums(tmp_path / "data") == sums(original)


def under_way(folder, finished):
    return len(marked(folder)) >= 3 and len(whole(folder / "data")) >= finished


def whole(folder):
    """The finished files and when they were written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.rglob("[0-9]*.vtkhdf")}


def test_a_cluster_makes_the_same_arrays(family, original, tmp_path):
    """A real scheduler and two worker processes on this machine."""
    pytest.importorskip("distributed")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "MARK": str(tmp_path),
                   "DASK_DISTRIBUTED__WORKER__DAEMON": "False"}
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
               "--scheduler-file", tmp_path / "scheduler.json"]
    quiet = {"env": environment, "cwd": tmp_path, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    started = [subprocess.Popen(command, **quiet)]
    try:
        assert soon(lambda: (tmp_path / "scheduler.json").exists() and (tmp_path / "scheduler.json").stat().st_size > 0)
        address = json.loads((tmp_path / "scheduler.json").read_text())["address"]
        with pytest.raises(InputError, match="no workers"):
            generate.generate(family, COUNTS, tmp_path / "data", cluster=address)
        command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
        started += [subprocess.Popen(command, **quiet) for _ in range(2)]
        assert soon(lambda: cluster_size(address) == 2)
        report = generate.generate(family, COUNTS, tmp_path / "data", cluster=address)
        assert report["new"] == 4 and sums(tmp_path / "data") == sums(original)
        with pytest.raises(RuntimeError, match="rigid motions"):  # what a worker meets arrives here
            broken = dataclasses.replace(family, table={**family.table, "support": []})
            generate.generate(broken, {"test": 1}, tmp_path / "broken", cluster=address)
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


def cluster_size(address):
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        return len(client.nthreads())


def test_a_cluster_that_is_not_there_is_refused(family, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: distributed_client(*_, **{**__, "timeout": 0.5}))
    distributed_client = distributed.client.Client
    with pytest.raises(InputError, match="no Dask scheduler there"):
        generate.generate(family, COUNTS, tmp_path / "data", cluster="tcp://127.0.0.1:1")


def test_a_scene_over_its_time_is_recorded_and_replaced(family, tmp_path):
    """The first draw is given no time at all, the second all it wants."""
    limits = iter((1e-9, 100.0, 100.0))
    clock = generate._clock
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generate, "_clock", lambda _, steps: clock(next(limits), steps))
        entry, reasons = generate._make(generate.Job(family, tmp_path, FILES[0], 0, 0, 1e-9))
    assert reasons == ["over its time limit of 1e-09 s at step 1 of 6"] and entry.failed_attempts == tuple(reasons)
    assert read_trajectory(tmp_path / FILES[0]).scene == draw(family, 0, 0, attempt=1).to_toml()
    with pytest.raises(RuntimeError, match=r"1 of 1 .* after 5 attempts: over its time limit of 1e-09 s"):
        generate.generate(family, {"test": 1}, tmp_path / "none", workers=1, time_limit=1e-9)
    with pytest.raises(InputError, match="time limit"):
        generate.generate(family, COUNTS, tmp_path / "none", time_limit=0.0)


def test_a_full_disk_ends_in_one_line(tmp_path):
    """On a real file system that is full after a file or two."""
    (tmp_path / "small.toml").write_text(SMALL)
    small = tmp_path / "small"
    small.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=96k", "tmpfs", small], capture_output=True).returncode:
        pytest.skip("no right to mount a small file system")
    command = [sys.executable, ROOT / "fidelity.py", "generate", tmp_path / "small.toml", "--out", small / "data", "--workers", "1"]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
        kept, parts = whole(small / "data"), list(small.rglob("*.part"))
    finally:
        subprocess.run(["umount", small], check=True)
    assert done.returncode == 1 and 0 < len(kept) < 4 and not parts
    said = [line for line in done.stderr.splitlines() if line.startswith("fidelity: ")]
    assert len(said) == 1 and ".vtkhdf: No space left on device" in said[0] and "Traceback" not in done.stderr


def test_a_file_too_large_names_itself(original, tmp_path):
    """The same without the right to mount anything."""
    trajectory = read_trajectory(original / FILES[0])
    with full_after(20_000), pytest.raises(OSError, match="File too large") as error:
        write_trajectory(tmp_path / "t.vtkhdf", trajectory)
    assert error.value.filename == str(tmp_path / "t.vtkhdf") and not list(tmp_path.iterdir())


def test_an_unwritable_folder_ends_in_one_line(tmp_path, capsys):
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "file").touch()
    assert fidelity.main(["generate", str(tmp_path / "small.toml"), "--out", str(tmp_path / "file" / "data")]) == 2
    assert "Not a directory" in capsys.readouterr().err


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


@pytest.mark.slow
@pytest.mark.parametrize(("name", "indices"), [("beam", range(6)), ("beam-large", (0, 1))])
def test_the_families_of_the_package_can_be_solved(tmp_path, name, indices):
    """Real draws, whole, against their own equations at every tenth step."""
    family = load_family(name)
    for index in indices:
        entry, _ = generate._make(generate.Job(family, tmp_path, dataset.file_name("train", index), 0, index))
        assert entry is not None and entry.steps == 400
        assert check.against_scene(read_trajectory(tmp_path / entry.file), steps=40) == []
