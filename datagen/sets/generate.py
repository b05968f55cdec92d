"""Many trajectories of a family: in parallel, resumable, reproducible.

Every trajectory depends on (seed, index) alone, so any number of workers, in any order, makes the same arrays. Each worker
is a process of its own with one thread, spawned rather than forked because MPI does not survive a fork. A file appears only
when it is whole; what is there already is kept, so a run that was killed goes on where it was.

A scene without an equilibrium, or over its time, is replaced by the next attempt at the same index; the file that takes its
place carries the reason, and so does the manifest. So is a scene in which the body snaps (physics/equilibrium/snap.py): where it comes
to rest then depends on more than where the obstacle is, and no predictor could know; and one that is pressed harder than `check` allows.

Where a family asks for an error each scene is meshed for it (physics/accuracy/), and all its steps are solved to the tolerance of data,
for `check` holds them against the equations. One whose error is not promised stays in the set and is counted.
"""

from __future__ import annotations

import dataclasses
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datagen.family.family import LARGEST_SPLIT, SPLITS, Family, draw
from datagen.files.fields import stress_fields
from datagen.files.inputs import centres, numbered
from datagen.files.layout import remainder_of
from datagen.files.places import mesh_file, places_of
from datagen.files.provenance import commit, versions
from datagen.files.solved import answers
from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory, problems, read_trajectory, write_trajectory
from datagen.flow.trajectory import flow_trajectory
from datagen.sets import dataset
from datagen.sets.check import unfit
from datagen.sets.workers import on_cluster, on_this_machine, progress
from physics.accuracy.answer import answer
from physics.accuracy.meshes.ladder import meshed
from physics.body.supports import held
from physics.contact.obstacles import Rigid
from physics.equilibrium.balance import cell_size
from physics.fem import release
from physics.flow.solution import solve_flow
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.modes.elastic import elastic_modes
from physics.motion.inertia import inertia
from physics.scene import PLANE_CELLS, Body, FlowScene, Material, Scene, Steps
from physics.scene.flow import FlowSteps
from physics.schema import InputError
from physics.solution import Solution, solve

ATTEMPTS = 5
AT_ONCE, CLUSTER = 4, 1.02


class OverTime(RuntimeError):
    """A scene took longer than it may; the message says how far it came."""


def trajectory_of(scene: Any, *, solution: Solution | None = None, seed: int = 0, index: int = 0,
                  on_step: Callable[[int], None] | None = None, stress: bool = False, snaps: bool = True) -> Trajectory:
    """The solution of a scene, computed unless given, with its first elastic mode and the obstacles' surfaces moving along; or a flow.

    Modes within 2 % of the first frequency belong to it, as the two bending planes of a square beam do: all are kept, four at most.

    When the solver stops early the trajectory holds the steps before, is not `complete`, and `extra` says why under
    "failure". `extra` also holds what was modelled, the seconds it took, the number of factorisations, and under "accuracy" what was
    chosen where the scene asks for an error. `on_step` is called with the number of each step that is reached; with `stress` that at
    the nodes is kept (files/fields.py); without `snaps` the solver stops where the body snaps.

    Raises:
        InputError: the scene has no solution to look for
        RuntimeError: the elastic mode was not found
    """
    if isinstance(scene, FlowScene):
        return flow_trajectory(scene, solve_flow(scene, on_step=on_step, partial=True), seed=seed, index=index)
    accuracy: dict[str, Any] = {}
    if solution is None and scene.steps.error is not None:
        scene, solution, verdict = answer(scene, on_step=on_step, balanced=True, snaps=snaps)
        accuracy = {} if verdict is None else {"accuracy": verdict.table()}
    solution = solution or solve(scene, on_step=on_step, partial=True, snaps=snaps)
    mesh = solution.mesh
    fixed = held(scene, mesh)
    modes = elastic_modes(scene, count=min(AT_ONCE, int(np.count_nonzero(~fixed))), mesh=mesh)
    first = np.flatnonzero(np.array(modes.frequencies_hz) <= CLUSTER * modes.frequencies_hz[0])
    nodes, frames = len(mesh.points), len(solution.displacement)
    kind = np.where(fixed.all(axis=1), HANDLE, NORMAL)  # what is held in part moves by itself in the rest
    points, triangles, path = mesh.points, np.empty((0, 3), np.int64), [solution.displacement]
    way = centres(scene, frames)
    for obstacle, centre in zip(scene.obstacles, way.transpose(1, 0, 2), strict=True):
        rigid = Rigid(obstacle)
        around, facets = rigid.surface_mesh(mesh.points, size=cell_size(mesh), plane=mesh.dimension == 2)
        triangles = np.concatenate([triangles, facets + len(points) - nodes])
        path.append(np.repeat((centre - rigid.path[0])[:, None], len(around), axis=1))
        points = np.concatenate([points, around])
    of_each = (numbered("obstacle", way) if scene.obstacles else {}) | (
        {} if solution.reactions is None else numbered("reaction", solution.reactions))
    from_file = scene.body.shape == "file"
    corners = np.repeat([mesh.cells.shape[1], 3], [len(mesh.cells), len(triangles)])
    shapes = np.pad(modes.pictured[first], ((0, 0), (0, len(points) - nodes), (0, 0)))
    moving = {} if solution.kinetic_energy is None else {"kinetic_energy": solution.kinetic_energy}
    extra = {"model": solution.model | {"inertia": inertia(scene, float(modes.frequencies_hz[0]), solution.steps_of_time)},
             "seconds": solution.seconds, "linear_steps": solution.linear_steps, "factorisations": solution.factorisations,
             "failure": solution.failure} | accuracy
    if from_file:
        extra["mesh_file"] = mesh_file(scene)
    if scene.steps.dynamic and scene.steps.duration is not None:
        extra["step_seconds"] = scene.steps.duration / scene.steps.count
    u = np.concatenate(path, axis=1)
    trajectory = Trajectory(
        points=points,
        connectivity=np.concatenate([mesh.cells.ravel(), nodes + triangles.ravel()]),
        offsets=np.concatenate([[0], np.cumsum(corners)]),
        types=np.repeat([CELLS[mesh.cell].vtk, CELLS["triangle"].vtk], [len(mesh.cells), len(triangles)]).astype(np.uint8),
        node_kind=np.concatenate([kind, np.full(len(points) - nodes, OBSTACLE)]).astype(np.uint8),
        displacement=u.astype(np.float32), remainder=remainder_of(u) if CELLS[mesh.cell].middles else None,
        modes=shapes.astype(np.float32), frequencies_hz=tuple(float(modes.frequencies_hz[i]) for i in first),
        per_frame={"reaction": solution.reaction, "energy": solution.energy, "penetration": solution.penetration,
                   "smallest_det_f": solution.smallest_det_f, "newton_iterations": solution.newton_iterations,
                   "relative_residual": solution.relative_residual, "snap": solution.snap, "released": solution.released,
                   **moving, **of_each},
        scene=scene.to_toml(), seed=seed, index=index, versions=versions(), commit=commit(), complete=not solution.failure,
        extra=extra, places=places_of(mesh) if from_file else None)
    return dataclasses.replace(trajectory, fields=stress_fields(scene, solution, trajectory)) if stress else trajectory


@dataclass(frozen=True)
class Job:
    """One file to be made in a folder."""

    family: Family
    out: Path
    file: str
    seed: int
    index: int
    time_limit: float = math.inf  # [s] for one attempt
    stress: bool = False


def jobs_of(family: Family, splits: dict[str, int], out: Path, seed: int, time_limit: float = math.inf, stress: bool = False) -> list[Job]:
    """The files of a data set, in order. Raises `InputError` for a bad seed."""
    if seed < 0:
        raise InputError(f"seed = {seed}: must be at least 0")
    return [Job(family, out, dataset.file_name(split, number), seed, SPLITS.index(split) * LARGEST_SPLIT + number, time_limit, stress)
            for split, wanted in splits.items() for number in range(wanted)]


def generate(family: Family, splits: dict[str, int], out: str | Path, *, seed: int = 0, workers: int | None = None,
             cluster: str = "", tls: Sequence[str] = (), time_limit: float = math.inf, stress: bool = False) -> dict[str, Any]:
    """Make a folder of trajectories, or what is missing of it, and its manifest.

    Args:
        splits: how many trajectories of each split, as `family.counts` gives them
        out: the folder; when it holds a data set, then one of the same family and seed
        workers: processes on this machine, by default one for each core
        cluster: address of a Dask scheduler whose workers do it instead; they must see the folder under the same name
        tls: for one at tls://, the files of its authority's certificate, of our certificate and of its key
        time_limit: [s] for each attempt at a scene; one that takes longer counts as failed, so with a limit the set may
            depend on the machine
        stress: keep stress at the nodes in the files, too (files/fields.py)

    Returns:
        the numbers of trajectories asked for, of new ones, of failed attempts at them, and the seconds it took; where the family asks
        for an error also how many are there without the promise of it

    Raises:
        InputError: the family, the folder or a number is wrong; nothing was computed
        RuntimeError: not all could be made; what was made is kept, and another call goes on from there
        OSError: a file cannot be written
    """
    started, out = time.perf_counter(), Path(out).absolute()
    workers = len(os.sched_getaffinity(0)) if workers is None else workers
    if workers < 1:
        raise InputError(f"workers = {workers}: must be at least 1")
    if not time_limit > 0:
        raise InputError(f"time limit {time_limit:g} s: must be above 0")
    if cluster:  # its workers are at home elsewhere
        family = dataclasses.replace(family, folder=family.folder.absolute())
    jobs = jobs_of(family, splits, out, seed, time_limit, stress)
    scenes = [draw(family, seed, job.index) for job in jobs]
    manifest = _open(out, family, seed)
    known = {entry.file: entry.sha256 for entry in manifest.trajectories}
    entries = {job.file: _made(job, known) for job in progress(jobs, "looking at what is there")}
    manifest = _with(manifest, [entry for entry in entries.values() if entry])
    dataset.write_manifest(out, manifest)
    missing = [job for job in jobs if not entries[job.file]]
    failures = []
    if not missing:
        done: Any = ()
    elif cluster:
        done = on_cluster(_make, missing, cluster, prepare=(compile_forms, scenes), folder=out, kept=len(jobs) - len(missing),
                          tls=tls)
    else:
        compile_forms(scenes)
        done = on_this_machine(_make, missing, min(workers, len(missing)), kept=len(jobs) - len(missing))
    for job, (entry, reasons) in done:
        if entry is None:
            failures.append(f"{job.file} after {ATTEMPTS} attempts: {reasons[-1]}")
            continue
        entries[job.file] = entry
        manifest = _with(manifest, [entry])
        dataset.write_manifest(out, manifest)
    if failures:
        raise RuntimeError(f"{len(failures)} of {len(jobs)} trajectories could not be made, the first: {failures[0]}")
    made = [entry for entry in entries.values() if entry]
    asked = [not entry.promised for entry in made if entry.promised is not None]
    return {"trajectories": len(jobs), "new": len(missing), "seconds": time.perf_counter() - started,
            "failed_attempts": sum(len(entry.failed_attempts) for entry in made)} | ({"not_promised": sum(asked)} if asked else {})


def _open(out: Path, family: Family, seed: int) -> dataset.Manifest:
    """The manifest of a folder that may be new. Raises `InputError` when it holds another data set."""
    manifest = dataset.Manifest(schema=dataset.SCHEMA, family=family.text, seed=seed, trajectories=())
    if (out / "manifest.json").exists():
        there = dataset.read_manifest(out)
        if there.recipe != manifest.recipe:
            raise InputError(f"{out} holds a data set of another family or seed; choose another folder")
        manifest = dataclasses.replace(there, family=family.text)
    out.mkdir(parents=True, exist_ok=True)
    for part in out.rglob(".*.part"):  # left by a run that was killed
        part.unlink()
    return manifest


def _with(manifest: dataset.Manifest, entries: list[dataset.Entry]) -> dataset.Manifest:
    """A manifest with some entries new or replaced."""
    merged = {entry.file: entry for entry in (*manifest.trajectories, *entries)}
    ordered = sorted(merged.values(), key=lambda entry: entry.index)
    return dataclasses.replace(manifest, trajectories=tuple(ordered))


def _make(job: Job) -> tuple[dataset.Entry | None, list[str]]:
    """Make one file, in a worker."""
    reasons: list[str] = []
    for attempt in range(ATTEMPTS):
        release()
        try:
            scene = draw(job.family, job.seed, job.index, attempt)
            clock = _clock(job.time_limit, scene.steps.count)
            trajectory = trajectory_of(scene, seed=job.seed, index=job.index, on_step=clock, stress=job.stress, snaps=False)
        except (InputError, RuntimeError) as error:
            reasons.append(str(error).splitlines()[0])
            continue
        wrong = problems(trajectory) if trajectory.complete else [trajectory.extra["failure"]]
        wrong += unfit(trajectory)
        if wrong:
            reasons.append(wrong[0])
            continue
        trajectory = dataclasses.replace(trajectory, extra={**trajectory.extra, "failed_attempts": reasons})
        write_trajectory(job.out / job.file, trajectory)
        return dataset.entry_of(job.file, trajectory), reasons
    return None, reasons


def _clock(limit: float, steps: int) -> Callable[[int], None]:
    """What ends a solver after a time [s], at the next step that it reaches."""
    end = time.monotonic() + limit

    def on_step(step: int) -> None:
        if time.monotonic() > end and step < steps:
            raise OverTime(f"over its time limit of {limit:g} s at step {step} of {steps}")

    return on_step


def _made(job: Job, known: dict[str, str]) -> dataset.Entry | None:
    """The manifest entry of a file that is there, whole, of this very scene, and with its checksum if that is known."""
    try:
        found = read_trajectory(job.out / job.file)
    except InputError:
        return None
    scene = draw(job.family, job.seed, job.index, len(found.extra.get("failed_attempts", ())))
    if (found.seed, found.index) != (job.seed, job.index) or problems(found) or unfit(found) or not answers(scene, found):
        return None
    if job.stress and "stress" not in found.fields:
        return None
    entry = dataset.entry_of(job.file, found)
    return entry if known.get(job.file, entry.sha256) == entry.sha256 else None


def compile_forms(scenes: list[Any]) -> None:
    """Compile what the workers will need, before they start: at once they would race for the cache on disk."""
    for flow in {scene.order: scene for scene in scenes if isinstance(scene, FlowScene)}.values():
        solve_flow(dataclasses.replace(flow, steps=FlowSteps(count=1, duration=1e-3)))
    solids = [own for scene in scenes if isinstance(scene, Scene) for own in meshed(scene)]
    cell_of = {body: build_mesh(body).cell if body.shape == "file" else body.cell for body in {scene.body for scene in solids}}
    for cell, plane, order, element, law in {(cell_of[body], body.plane, body.order, body.element, material.law): None
                                             for scene in solids for body in [scene.body] for material in scene.materials}:
        body = Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell=CELLS[cell].first or cell, order=order, element=element)
        if body.cell in PLANE_CELLS:
            body = Body(shape="plate", length=1.0, width=1.0, cells=(1, 1), cell=body.cell, order=order, plane=plane)
        scene = Scene(body=body, material=Material(law=law, young_modulus=1.0, poisson_ratio=0.3), steps=Steps(count=1))
        solve(scene)
        elastic_modes(scene, count=1)
