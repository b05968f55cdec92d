"""What a run of generate makes, keeps, repeats and reports, with a stand-in for the solver; and what it puts into a trajectory."""

import dataclasses
import math
import tomllib
import types

import numpy as np
import pytest

from datagen.family.family import Family, Splits, draw
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets import dataset, generate
from physics.mesh.build import build_mesh
from physics.schema import InputError
from tests.five_nodes import tiny
from tests.scenes import beam, pressed

TEXT = """
[body]
length = { uniform = [0.1, 0.2] }
width = 0.02
height = 0.02
cells = [2, 1, 1]
[material]
young_modulus = 1e6
poisson_ratio = 0.4
"""
FAMILY = Family("x", TEXT, tomllib.loads(TEXT), Splits())
SPLITS = {"train": 2, "test": 2}
FILES = ["train/0000.vtkhdf", "train/0001.vtkhdf", "test/0000.vtkhdf", "test/0001.vtkhdf"]


class Solver:
    """In the place of `trajectory_of`: tiny trajectories that differ by their scenes; what `faults` says of (index, attempt) goes wrong."""

    def __init__(self):
        self.faults, self.made, self.processes = {}, [], []

    def __call__(self, scene, *, seed, index, on_step, stress=False, snaps=True):
        assert not snaps  # which are refused: no time is to go into them
        attempt = next(k for k in range(9) if draw(FAMILY, seed, index, k) == scene)
        self.made.append((index, attempt))
        made = tiny(scene=scene.to_toml(), seed=seed, index=index, points=tiny().points * scene.body.length,
                    per_frame=tiny().per_frame | {"snap": np.zeros(3)})
        fault = self.faults.get((index, attempt), self.faults.get(index))
        if isinstance(fault, Exception):
            raise fault
        return dataclasses.replace(made, **(fault or {}))

    def here(self, function, jobs, processes, *, kept):
        """In the place of `on_this_machine`: the last job first, in this process."""
        self.processes.append((processes, kept))
        for job in reversed(jobs):
            yield job, function(job)


@pytest.fixture
def solver(monkeypatch):
    stand_in = Solver()
    monkeypatch.setattr(generate, "trajectory_of", stand_in)
    monkeypatch.setattr(generate, "on_this_machine", stand_in.here)
    monkeypatch.setattr(generate, "compile_forms", lambda scenes: None)
    return stand_in


def run(folder, splits=SPLITS, **given):
    return generate.generate(FAMILY, splits, folder, **given)


def test_a_run_makes_every_file_once_and_the_next_one_none(solver, tmp_path):
    report = run(tmp_path, workers=3)
    assert report.pop("seconds") >= 0 and report == {"trajectories": 4, "new": 4, "failed_attempts": 0}
    assert sorted(solver.made) == [(0, 0), (1, 0), (2_000_000, 0), (2_000_001, 0)] and solver.processes == [(3, 0)]
    manifest = dataset.read_manifest(tmp_path)
    assert [entry.file for entry in manifest.trajectories] == FILES and (manifest.family, manifest.seed) == (TEXT, 0)
    for entry, index in zip(manifest.trajectories, (0, 1, 2_000_000, 2_000_001), strict=True):
        found = read_trajectory(tmp_path / entry.file)
        assert (entry.index, entry.sha256, found.scene) == (index, dataset.digest(found), draw(FAMILY, 0, index).to_toml())
    report = run(tmp_path, workers=3)
    assert report["new"] == 0 and report["trajectories"] == 4 and len(solver.made) == 4 and len(solver.processes) == 1
    assert dataset.read_manifest(tmp_path) == manifest


@pytest.mark.parametrize("damage", ["gone", "cut", "other scene", "other index", "other seed", "other arrays", "not sound"])
def test_what_is_not_as_it_was_is_made_again_and_nothing_else(solver, tmp_path, damage):
    run(tmp_path, workers=1)
    before, path = dataset.read_manifest(tmp_path), tmp_path / FILES[1]
    if damage == "gone":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:-100])
    else:
        found = read_trajectory(path)
        change = {"other scene": {"scene": draw(FAMILY, 0, 1, 1).to_toml()}, "other index": {"index": 0}, "other seed": {"seed": 1},
                  "other arrays": {"displacement": 2 * found.displacement}, "not sound": {"complete": False}}[damage]
        write_trajectory(path, dataclasses.replace(found, **change))
    solver.made.clear()
    assert run(tmp_path, workers=7)["new"] == 1 and solver.made == [(1, 0)] and solver.processes[-1] == (1, 3)
    assert dataset.read_manifest(tmp_path) == before


def test_a_file_that_the_manifest_does_not_know_is_taken_as_it_is(solver, tmp_path):
    """A run killed between a file and the manifest."""
    run(tmp_path, workers=1)
    before = dataset.read_manifest(tmp_path)
    dataset.write_manifest(tmp_path, dataclasses.replace(before, trajectories=before.trajectories[:1]))
    (tmp_path / "test" / ".0001.vtkhdf.77.part").touch()
    assert run(tmp_path, workers=1)["new"] == 0 and dataset.read_manifest(tmp_path) == before
    assert not list(tmp_path.rglob("*.part"))


def test_failed_attempts_are_recorded_one_by_one_and_found_again(solver, tmp_path):
    """Refused, stuck, incomplete, damaged and snapping: each the first line of its reason; what is fifth is made."""
    snap = tiny().per_frame | {"snap": np.array([0, 0, 1e-3])}
    solver.faults = {(1, 0): InputError("wrong\nand more"), (1, 1): RuntimeError("stuck\nhere"), (1, 2): {"per_frame": snap},
                     (1, 3): {"complete": False, "extra": {"failure": "no equilibrium"}},
                     (0, 0): {"displacement": tiny().displacement * np.float32(np.nan)}}
    report = run(tmp_path, workers=1)
    assert report["failed_attempts"] == 5 and report["new"] == 4
    first, second = dataset.read_manifest(tmp_path).trajectories[:2]
    assert second.failed_attempts == ("wrong", "stuck", "the body snaps at step 2", "no equilibrium")
    assert first.failed_attempts == ("displacement is not finite everywhere",)
    found = read_trajectory(tmp_path / FILES[1])
    assert found.scene == draw(FAMILY, 0, 1, 4).to_toml()
    assert found.extra == {"seconds": 6.0, "failed_attempts": list(second.failed_attempts)}
    solver.made.clear()
    assert run(tmp_path, workers=1)["failed_attempts"] == 5 and not solver.made


def test_a_scene_in_which_a_cell_turns_inside_out_is_drawn_again(solver, tmp_path):
    """As the check of a set asks for det F > 0: one of exactly 0 does not pass, nor one that is no number."""
    solver.faults = {(0, k): {"per_frame": tiny().per_frame | {"snap": np.zeros(3), "smallest_det_f": np.array([1.0, *of])}}
                     for k, of in enumerate([(-0.1, 0.5), (0.5, 0.0), (0.5, 1e-9)])}
    solver.faults[(1, 0)] = {"per_frame": tiny().per_frame | {"snap": np.zeros(3), "smallest_det_f": np.array([1.0, 1.0, np.nan])}}
    run(tmp_path, workers=1)
    first, second = dataset.read_manifest(tmp_path).trajectories[:2]
    assert first.failed_attempts == ("a cell turns inside out at step 1", "a cell turns inside out at step 2")
    assert second.failed_attempts == ("smallest_det_f is not finite everywhere",)


def test_a_scene_that_the_check_would_find_too_deeply_penetrated_is_drawn_again(solver, tmp_path):
    """A thousandth of the smallest side, 0.1 of the length here: a hundredth less passes."""
    for attempt, of in enumerate((1.01, 0.99)):
        deep = 1e-4 * draw(FAMILY, 0, 0, attempt).body.length * np.array([0.0, 0.5, of])
        solver.faults[(0, attempt)] = {"per_frame": tiny().per_frame | {"snap": np.zeros(3), "penetration": deep}}
    run(tmp_path, workers=1)
    assert dataset.read_manifest(tmp_path).trajectories[0].failed_attempts == ("the obstacle penetrates too far at step 2",)


def test_after_five_attempts_the_rest_is_kept_and_another_run_goes_on(solver, tmp_path):
    solver.faults = {1: RuntimeError("no way"), 2_000_000: RuntimeError("nowhere\nat all")}
    with pytest.raises(RuntimeError) as error:
        run(tmp_path, workers=2)
    assert str(error.value) == "2 of 4 trajectories could not be made, the first: test/0000.vtkhdf after 5 attempts: nowhere"
    assert sorted(solver.made) == [(0, 0), *((1, k) for k in range(5)), *((2_000_000, k) for k in range(5)), (2_000_001, 0)]
    assert [entry.file for entry in dataset.read_manifest(tmp_path).trajectories] == [FILES[0], FILES[3]]
    solver.faults.clear()
    solver.made.clear()
    assert run(tmp_path, workers=2)["new"] == 2 and sorted(solver.made) == [(1, 0), (2_000_000, 0)]


def test_what_was_finished_before_a_worker_is_killed_is_in_the_manifest(solver, tmp_path, monkeypatch):
    def killed(function, jobs, processes, *, kept):
        yield jobs[0], function(jobs[0])
        raise RuntimeError("a worker process was killed")

    monkeypatch.setattr(generate, "on_this_machine", killed)
    with pytest.raises(RuntimeError, match="was killed"):
        run(tmp_path, workers=1)
    assert [entry.file for entry in dataset.read_manifest(tmp_path).trajectories] == FILES[:1]
    monkeypatch.setattr(generate, "on_this_machine", solver.here)
    assert run(tmp_path, workers=1)["new"] == 3 and solver.processes == [(1, 1)]


def test_a_set_grows_split_by_split_in_the_order_of_its_indices(solver, tmp_path):
    run(tmp_path, {"test": 1}, workers=1)
    run(tmp_path, {"train": 1}, workers=1)
    assert run(tmp_path, {"test": 2}, workers=1)["new"] == 1
    assert [entry.file for entry in dataset.read_manifest(tmp_path).trajectories] == [FILES[0], FILES[2], FILES[3]]


def test_a_cluster_is_asked_where_one_is_named(solver, tmp_path, monkeypatch):
    asked = []

    def on_cluster(function, jobs, address, **given):
        asked.append((address, [job.file for job in jobs], given["kept"], given["folder"], len(given["prepare"][1])))
        return solver.here(function, jobs, 0, kept=0)

    monkeypatch.setattr(generate, "on_cluster", on_cluster)
    run(tmp_path, {"train": 1}, workers=1)
    run(tmp_path, cluster="tcp://there")
    assert asked == [("tcp://there", FILES[1:], 1, tmp_path, 4)]


def test_wrong_numbers_and_other_sets_are_refused(solver, tmp_path):
    for wrong in ({"workers": 0}, {"workers": -1}, {"time_limit": 0.0}, {"time_limit": -1.0}, {"time_limit": math.nan}, {"seed": -1}):
        with pytest.raises(InputError):
            run(tmp_path / "new", **wrong)
    assert not (tmp_path / "new").exists()
    run(tmp_path, {"test": 1}, workers=1)
    with pytest.raises(InputError, match="another family or seed"):
        run(tmp_path, {"test": 1}, seed=1)
    other = dataclasses.replace(FAMILY, text=TEXT + "[splits]\ntest = 7\n")  # only how many: the same set
    assert generate.generate(other, {"test": 1}, tmp_path, workers=1)["new"] == 0
    assert dataset.read_manifest(tmp_path).family == other.text


def test_every_core_that_this_process_may_use_works_unless_told_otherwise(solver, tmp_path, monkeypatch):
    monkeypatch.setattr(generate.os, "sched_getaffinity", lambda _: {0, 3, 5})
    run(tmp_path)
    assert solver.processes == [(3, 0)]


def test_a_scene_ends_at_the_first_step_past_its_time_but_not_at_the_last(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(generate.time, "monotonic", lambda: now[0])
    on_step = generate._clock(10.0, 6)
    now[0] = 110.0
    on_step(1)  # not past it
    now[0] = 110.5
    on_step(6)  # done in any case
    with pytest.raises(generate.OverTime, match="over its time limit of 10 s at step 5 of 6"):
        on_step(5)


# ---- what is put into a trajectory


def solution(scene, **changes):
    """A made-up solution of three frames for a scene."""
    mesh = build_mesh(scene.body)
    nodes = len(mesh.points)
    rows = {"reaction": np.arange(9.0).reshape(3, 3), **{name: 10.0 * k + np.arange(3) for k, name in enumerate(
        ("energy", "penetration", "smallest_det_f", "newton_iterations", "relative_residual", "snap", "released"))}}
    return types.SimpleNamespace(**{
        "mesh": mesh, "displacement": np.arange(9.0 * nodes).reshape(3, nodes, 3) / 1024, "kinetic_energy": None, "model": {"law": "x"},
        "seconds": 2.5, "linear_steps": 4, "factorisations": 5, "failure": "", "reactions": None,
        "steps_of_time": None, **rows, **changes})


@pytest.fixture
def modes(monkeypatch):
    """Four modes at 10, 10.2, 10.2001 and 20 Hz, of the size of their number."""
    asked = []

    def elastic_modes(scene, *, count, mesh):
        asked.append(count)
        pictured = np.ones((4, len(mesh.points), 3)) * np.arange(1, 5)[:, None, None]
        return types.SimpleNamespace(frequencies_hz=(10.0, 10.2, 10.2001, 20.0), pictured=pictured)

    monkeypatch.setattr(generate, "elastic_modes", elastic_modes)
    return asked


SMALL = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [2, 1, 1], "cell": "hexahedron"}


def test_what_a_solution_becomes(modes):
    scene = pressed(body=SMALL, steps={"count": 4}, support=[{"where": "x-min"}, {"where": "x-max", "fixed": "xz"}])
    given = solution(scene)
    made = generate.trajectory_of(scene, solution=given, seed=3, index=9)
    assert modes == [4] and made.frequencies_hz == (10.0, 10.2)  # within 2 %
    assert made.modes.shape == (2, len(made.points), 3) and (made.modes[:, :12] == np.array([1, 2])[:, None, None]).all()
    assert not made.modes[:, 12:].any()
    assert made.node_kind[:12].tolist() == [3 if x == 0 else 0 for x in made.points[:12, 0]]  # what is held in part moves
    assert (made.node_kind[12:] == 1).all() and len(made.points) > 12
    assert made.types[:2].tolist() == [12, 12] and (made.types[2:] == 5).all()
    assert np.array_equal(made.displacement[:, :12], given.displacement)
    # The cylinder moves down by 15 mm in four steps; three frames are known.
    for frame in range(3):
        assert np.allclose(made.displacement[frame, 12:], [0, 0, -0.015 * frame / 4], rtol=0, atol=1e-9)
    assert made.connectivity[:16].tolist() == given.mesh.cells.ravel().tolist() and made.connectivity[16:].min() == 12
    assert made.offsets[:4].tolist() == [0, 8, 16, 19] and made.offsets[-1] == len(made.connectivity)
    for name in ("reaction", "energy", "penetration", "smallest_det_f", "newton_iterations", "relative_residual", "snap", "released"):
        assert np.array_equal(made.per_frame[name], getattr(given, name)), name
    assert np.allclose(made.per_frame["obstacle"], scene.obstacle.path[0] - np.outer(np.arange(3), [0, 0, 0.015 / 4]), rtol=0, atol=1e-15)
    assert len(made.per_frame) == 9 and (made.seed, made.index, made.complete, made.scene) == (3, 9, True, scene.to_toml())
    assert made.extra["model"].keys() == {"law", "inertia"} and made.extra["model"]["law"] == "x"
    assert {name: made.extra[name] for name in made.extra if name != "model"} == {
        "seconds": 2.5, "linear_steps": 4, "factorisations": 5, "failure": ""}


def test_a_solution_that_failed_is_not_complete(modes):
    scene = beam(body=SMALL)
    made = generate.trajectory_of(scene, solution=solution(scene, failure="no way"))
    assert not made.complete and made.extra["failure"] == "no way" and len(made.points) == 12 and len(made.types) == 2


def test_a_body_in_motion_has_kinetic_energy_and_times(modes):
    scene = beam(body=SMALL, steps={"count": 8, "duration": 2.0, "dynamic": True})
    made = generate.trajectory_of(scene, solution=solution(scene, kinetic_energy=np.array([1.0, 2, 3])))
    assert made.per_frame["kinetic_energy"].tolist() == [1, 2, 3] and made.extra["step_seconds"] == 0.25
    still = beam(body=SMALL, steps={"count": 8, "duration": 2.0})
    assert "step_seconds" not in generate.trajectory_of(still, solution=solution(still)).extra


def test_forms_are_compiled_once_for_each_cell_and_law(monkeypatch):
    asked = []

    def solve(scene):
        asked.append((scene.body.cell, scene.material.law, scene.steps.count, scene.body.cells))

    monkeypatch.setattr(generate, "solve", solve)
    monkeypatch.setattr(generate, "elastic_modes", lambda scene, count: asked.append((scene.body.cell, count)))
    scenes = [beam(body=SMALL | {"cell": cell}, material={"young_modulus": 1e6, "poisson_ratio": 0.3, "law": law})
              for cell, law in (("prism", "linear"), ("prism", "neo-hookean"), ("prism", "linear"), ("hexahedron", "linear"))]
    generate.compile_forms(scenes)
    one = (1, (1, 1, 1))
    assert sorted(asked, key=str) == sorted([("prism", "linear", *one), ("prism", 1), ("prism", "neo-hookean", *one), ("prism", 1),
                                             ("hexahedron", "linear", *one), ("hexahedron", 1)], key=str)
