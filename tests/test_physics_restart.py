"""A path that was broken off and gone on with is the path that was never broken off, bit for bit."""

import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import read_trajectory
from physics import journal
from physics.equilibrium.snap import Relaxation
from physics.schema import InputError, WorkError
from physics.solution import Solution, solve
from tests.scenes import arch, beam, pressed

ROOT = Path(__file__).parent.parent
SCENES = {
    "pressed": lambda: pressed(),
    "halved": lambda: beam(load=[{"where": "x-max", "traction": [0.0, 0.0, -3e4]}], steps={"count": 3}),
    "small strain": lambda: beam(load=[{"where": "x-max", "traction": [0.0, 0.0, -1.0]}], steps={"count": 6}),
    "linear law": lambda: pressed(material={"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.4}, steps={"count": 12}),
    "second order": lambda: pressed(
        body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [6, 2, 2], "cell": "tetrahedron", "order": 2}, steps={"count": 9}),
    "indefinite": lambda: beam(  # the stiffness of the block alone is indefinite in the end
        body={"length": 0.02, "width": 0.02, "height": 0.02, "cells": [3, 3, 3]}, support=[{"where": "z-min", "fixed": "xyz"}],
        obstacle={"shape": "half-space", "normal": [0.0, 0.0, -1.0], "path": [[0.0, 0.0, 0.0201], [0.0, 0.0, 0.01]]},
        steps={"count": 24}),
}
FAILING = {"body": {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [2, 2, 2]}, "steps": {"count": 6},
           "support": [{"where": "z-min", "fixed": "xyz"}, {"where": "z-max", "fixed": "xyz", "displacement": [0.0, 0.0, -0.03]}]}


class Stop(Exception):
    """The run is broken off here."""


def broken_off(scene, path, at):
    def on_step(step):
        if step == at:
            raise Stop

    with pytest.raises(Stop):
        solve(scene, journal=path, on_step=on_step)


def assert_same(one, other):
    for field in fields(Solution):
        if field.name not in ("mesh", "seconds", "set_up", "resumed"):
            assert np.array_equal(getattr(one, field.name), getattr(other, field.name)), field.name


@pytest.fixture
def save_always(monkeypatch):
    monkeypatch.setattr(journal, "EVERY", 0.0)


@pytest.mark.parametrize("name", SCENES)
def test_going_on_gives_the_same_bits(name, tmp_path, save_always):
    scene = SCENES[name]()
    whole, count = solve(scene), scene.steps.count
    assert name != "halved" or whole.halvings
    for at in sorted({1, count // 3, 2 * count // 3, count - 1}):
        broken_off(scene, tmp_path / "part", at)  # each goes on from the one before
    again = solve(scene, journal=tmp_path / "part")
    assert again.resumed == count - 1
    assert_same(again, whole)


@pytest.mark.parametrize("where", ["before", "in the midst", "after"])
def test_a_path_that_snaps_goes_on_with_the_same_bits(where, tmp_path, save_always, monkeypatch):
    """Broken off before the step in which an arch snaps, in the midst of its motion, or right after it."""
    scene, mesh, _ = arch()
    whole = solve(scene, mesh=mesh)
    (step,) = np.flatnonzero(whole.snap)
    assert 1 < step < 10 and whole.snap[step] > 0.012 and whole.released[step] > 0
    judged, real = [], Relaxation._judge

    def judge(*args):
        judged.append(1)
        if where == "in the midst" and len(judged) == 8:
            raise Stop
        return real(*args)

    def on_step(at):
        if at == step + {"before": -1, "in the midst": 5, "after": 0}[where]:
            raise Stop

    with monkeypatch.context() as patch:
        patch.setattr(Relaxation, "_judge", judge)
        with pytest.raises(Stop):
            solve(scene, mesh=mesh, journal=tmp_path / "part", on_step=on_step)
    again = solve(scene, mesh=mesh, journal=tmp_path / "part")
    assert again.resumed == (step if where == "after" else step - 1)
    assert_same(again, whole)


def test_half_a_block_at_the_end_is_dropped(tmp_path, save_always):
    scene, part = pressed(steps={"count": 8}), tmp_path / "part"
    whole = solve(scene)
    broken_off(scene, part, 7)
    data = part.read_bytes()
    for cut in (len(data) - 1, len(data) - 5000, len(data) // 2, 40, 7, 0):
        part.write_bytes(data[:cut])
        assert_same(solve(scene, journal=part), whole)
    part.write_bytes(data[:-3000] + bytes(3000))  # a block that is there, but not what was written
    again = solve(scene, journal=part)
    assert 0 < again.resumed < 7
    assert_same(again, whole)


def test_the_journal_does_not_grow_by_what_it_no_longer_needs(tmp_path, save_always, monkeypatch):
    scene, part = pressed(steps={"count": 40}), tmp_path / "part"
    broken_off(scene, part, 39)
    long = part.stat().st_size
    part.unlink()
    monkeypatch.setattr(journal, "WASTE", 0)
    broken_off(scene, part, 39)
    frame = solve(scene).displacement[0].nbytes
    # At most as much again as the frames, the memory of two blocks of some ten frames each, and the heads of arrays.
    assert part.stat().st_size < 2 * 40 * frame + 2 * 20 * frame + 400_000 < long
    assert [path.name for path in tmp_path.iterdir()] == ["part"]
    again = solve(scene, journal=part)
    assert again.resumed == 39
    assert_same(again, solve(scene))


def test_another_scene_is_refused_and_nothing_is_touched(tmp_path, save_always, capsys):
    part = tmp_path / "t.vtkhdf.part"
    broken_off(pressed(), part, 3)
    data = part.read_bytes()
    (tmp_path / "other.toml").write_text(pressed(steps={"count": 21}).to_toml())
    assert fidelity.main(["simulate", str(tmp_path / "other.toml"), "--out", str(tmp_path / "t.vtkhdf")]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "another scene" in err
    assert part.read_bytes() == data
    part.write_text("something else")
    with pytest.raises(InputError, match="not an unfinished run"):
        solve(pressed(), journal=part)
    assert part.read_text() == "something else"


def test_a_looser_tolerance_takes_fewer_steps_and_does_not_go_on_with_a_stricter_path(tmp_path, save_always):
    strict, loose = solve(pressed()), solve(pressed(), tolerance=1e-3)
    assert loose.newton_iterations.sum() < strict.newton_iterations.sum() and 1e-6 < loose.relative_residual.max() <= 1e-3
    broken_off(pressed(), tmp_path / "part", 3)
    with pytest.raises(InputError, match="another scene"):
        solve(pressed(), journal=tmp_path / "part", tolerance=1e-3)


def test_two_runs_do_not_write_into_one_journal(tmp_path):
    def on_step(step):
        with pytest.raises(WorkError, match="another process"):
            solve(pressed(), journal=tmp_path / "part")

    solve(pressed(steps={"count": 1}), journal=tmp_path / "part", on_step=on_step)


def test_after_a_failure_the_step_that_failed_is_tried_again(tmp_path, capsys):
    scene, out = tmp_path / "scene.toml", tmp_path / "t.vtkhdf"
    scene.write_text(beam(**FAILING).to_toml())
    call = ["simulate", str(scene), "--out", str(out)]
    assert fidelity.main(call) == 1
    first = capsys.readouterr().err.splitlines()[-1]
    assert "tries again from there" in first and (tmp_path / "t.vtkhdf.part").exists()
    assert fidelity.main(call) == 1
    said, err = capsys.readouterr()
    reached = len(read_trajectory(out).displacement) - 1
    assert f"went on after step {reached}" in said and err.splitlines()[-1] == first
    (tmp_path / "scene.toml").write_text(pressed().to_toml())
    (tmp_path / "t.vtkhdf.part").unlink()
    assert fidelity.main(call) == 2  # what is in the file is not lost to another scene
    assert "unfinished run of another scene" in capsys.readouterr().err


def start(scene, out, *, limit=0):
    """`fidelity simulate` in a process of its own that saves every step; limit [bytes] on the size of files, as a disk has."""
    code = ("import sys, resource, fidelity; from physics import fem, journal; journal.EVERY = 0.0\n"  # with MPI begun
            f"if {limit}: resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY))\n"
            "sys.exit(fidelity.main(sys.argv[1:]))")
    return subprocess.Popen([sys.executable, "-c", code, "simulate", scene, "--out", out], cwd=ROOT, stderr=subprocess.PIPE, text=True,
                            stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(ROOT)})


def test_killed_and_started_again(tmp_path):
    scene = pressed(steps={"count": 150})
    file, out, part = tmp_path / "scene.toml", tmp_path / "t.vtkhdf", tmp_path / "t.vtkhdf.part"
    file.write_text(scene.to_toml())
    whole = solve(scene)
    size = 0
    for _ in range(2):  # twice, each time when something new is on disk
        process, waited = start(file, out), time.monotonic() + 60
        while (not part.exists() or part.stat().st_size < size + 2_000_000) and process.poll() is None and time.monotonic() < waited:
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL and not out.exists()
        size = part.stat().st_size
    process = start(file, out)
    said, _ = process.communicate()
    assert process.returncode == 0 and "went on after step" in said
    assert 1 < int(said.split("went on after step ")[1].split(",")[0]) < 150
    assert not part.exists()
    with h5py.File(out) as stored:
        body = len(whole.mesh.points)
        moved = stored["VTKHDF/PointData/displacement"][()].reshape(151, -1, 3)[:, :body]
        assert np.array_equal(moved, whole.displacement.astype(np.float32))
        assert np.array_equal(stored["VTKHDF/FieldData/reaction"], whole.reaction)


def test_a_full_disk_ends_in_one_line_and_damages_nothing(tmp_path):
    scene = pressed(steps={"count": 10})
    file, out = tmp_path / "scene.toml", tmp_path / "t.vtkhdf"
    file.write_text(scene.to_toml())
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
    process = start(file, out, limit=400_000)
    _, err = process.communicate()
    assert process.returncode == 1 and not out.exists()
    assert err.splitlines()[-1].startswith(f"fidelity: {out}.part: ") and "Traceback" not in err
    again = solve(scene, journal=tmp_path / "t.vtkhdf.part")
    assert again.resumed > 0
    assert_same(again, solve(scene))
