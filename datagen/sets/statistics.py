"""What a data set holds, in numbers: sizes, motion, forces, cost, failures, and the error that its own numbers carry.

Three things blur a trajectory, and an error of a surrogate below them says nothing:
- storage: displacements are rounded to single precision (or to a packed set's tolerance);
- the solver's tolerance: |R| is at most some small part of the reaction, so displacements are off by about the same part
  (the reaction R moved the body by u, what is left of it moves it by |R|/|reaction| u);
- the mesh: the same scene on cells of half the size moves differently. That is measured, for a sample.

Legend: T frames, N nodes.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from datagen.files.layout import HALF_ULP
from datagen.files.solved import solved_on
from datagen.files.trajectory import Trajectory, read_trajectory
from datagen.flow.check import tolerance_of
from datagen.flow.figures import flow_figures
from datagen.flow.refined import flow_mesh_error
from datagen.sets import dataset
from datagen.sets.check import precision
from datagen.sets.plan import graph_diameter, summary
from datagen.sets.workers import progress
from physics.fem import release
from physics.mesh.mesh import Mesh
from physics.mesh.refine import halved
from physics.scene import FlowScene, Scene, Steps, scene_of
from physics.schema import InputError
from physics.solution import solve
from physics.whole import write_whole

FRAMES = 40  # steps of the refined solutions, or fewer: equilibria do not depend on how many lead to them


def rows_of(folder: str | Path) -> list[dict[str, Any]]:
    """The numbers of each trajectory of a data set, in the manifest's order, with its file, split and size.

    Raises:
        InputError: the folder holds no data set, or a file of it cannot be read
    """
    folder, manifest = Path(folder), dataset.read_manifest(folder)
    if not manifest.trajectories:
        raise InputError(f"{folder}: no trajectories")
    return [{"file": entry.file, "split": entry.split, **of_trajectory(read_trajectory(folder / entry.file)),
             "megabytes": (folder / entry.file).stat().st_size / 1e6} for entry in progress(manifest.trajectories, "reading")]


def statistics(folder: str | Path, rows: list[dict[str, Any]] | None = None, *, refined: int = 0, seed: int = 0) -> dict[str, Any]:
    """The numbers of a data set; `spread` of each over its trajectories.

    Args:
        rows: what `rows_of` gives, when it is known already
        refined: how many trajectories are solved again on cells of half the size; results are kept in FOLDER/refined.json
        seed: of the choice of these

    Raises:
        InputError: the folder holds no data set, or a file of it cannot be read
    """
    folder, manifest, rows = Path(folder), dataset.read_manifest(folder), rows or rows_of(folder)
    reasons = [reason for entry in manifest.trajectories for reason in entry.failed_attempts]
    found: dict[str, Any] = {
        **summary([{name: value for name, value in row.items() if name != "file"} for row in rows]),
        "failed_attempts": len(reasons), "reasons": reasons, "solver_hours": sum(row["seconds"] for row in rows) / 3600,
        "gigabytes": sum(row["megabytes"] for row in rows) / 1e3}
    if refined:
        found["refined"] = _refined(folder, manifest, min(refined, len(rows)), seed)
    return found


def of_trajectory(trajectory: Trajectory) -> dict[str, Any]:
    """The numbers of one trajectory; lengths in metres, forces in newtons."""
    scene = scene_of(trajectory.scene) if trajectory.scene else None
    if trajectory.flows and not isinstance(scene, Scene):
        return _of_flow(trajectory, scene)
    if isinstance(scene, FlowScene):
        raise InputError("a flow without a velocity")
    u, free, body = trajectory.displacement, trajectory.free, trajectory.body
    moving, mesh = u[:, free].astype(np.float64), trajectory.mesh
    change = np.diff(moving, axis=0)
    length, width = np.ptp(trajectory.points[body][:, :2], axis=0)
    row: dict[str, Any] = {
        "nodes": len(trajectory.points), "obstacle_nodes": int((~body).sum()), "cells": len(mesh.cells),
        "graph_diameter": graph_diameter(mesh.edges, len(mesh.points)), "steps": len(u) - 1, "xy_extent": float(length * width),
        "displacement_rms": _rms(moving[1:]), "displacement_largest": float(np.linalg.norm(moving, axis=2).max(initial=0.0)),
        "change_rms": _rms(change), "change_of_change_rms": _rms(np.diff(change, axis=0)) if len(u) > 2 else 0.0,
        "storage_noise": _rms(precision(trajectory)[:, free])}
    if scene is not None:
        row |= {"support": " and ".join(str(support.where) for support in scene.support) or "none",
                "obstacle": scene.pressed_by}
    for name, value in trajectory.per_frame.items():
        if name == "reaction":
            row["reaction_largest"] = float(np.linalg.norm(value, axis=1).max())
        elif name == "smallest_det_f":
            row[name] = float(value.min())
        elif name == "newton_iterations":
            row[name] = float(value[1:].mean()) if len(value) > 1 else 0.0
        elif name.startswith("reaction_"):
            row[f"{name}_largest"] = float(np.linalg.norm(value, axis=1).max())
        elif not name.startswith("obstacle"):
            row[f"{name}_largest"] = float(value.max())
    if "relative_residual" in trajectory.per_frame:
        row["solver_noise"] = float(trajectory.per_frame["relative_residual"].max()) * row["displacement_rms"]
    seconds = float(trajectory.extra.get("seconds", 0.0))
    return row | {"seconds": seconds, "ms_per_step": 1e3 * seconds / max(1, len(u) - 1)}


def _of_flow(trajectory: Trajectory, scene: FlowScene | None) -> dict[str, Any]:
    """The numbers of one flow."""
    mesh, frames = trajectory.mesh, len(trajectory.displacement) - 1
    length, width = np.ptp(trajectory.points[:, :2], axis=0)
    seconds = float(trajectory.extra.get("seconds", 0.0))
    return {"nodes": len(trajectory.points), "cells": len(mesh.cells), "graph_diameter": graph_diameter(mesh.edges, len(mesh.points)),
            "steps": frames, "xy_extent": float(length * width), **flow_figures(trajectory, scene),
            "storage_noise": _rms(np.maximum(HALF_ULP * abs(trajectory.fields["velocity"]), tolerance_of(trajectory, "velocity"))),
            **{f"{name}_largest": float(abs(value).max()) for name, value in trajectory.per_frame.items()},
            "seconds": seconds, "ms_per_step": 1e3 * seconds / max(1, frames)}


def mesh_error(trajectory: Trajectory) -> dict[str, Any]:
    """How far a trajectory is from the same scene on cells of half the size, and from itself in fewer, larger steps.

    Returns:
        mesh_rmse: root mean square over the nodes that are free and the frames compared [m]; mesh_largest: the largest length
        mesh_relative: mesh_rmse over the root mean square displacement of the same frames
        solver_largest: largest length of the difference to the same mesh solved in other steps [m]
        seconds: of the refined solution
        of a flow what `flow_mesh_error` gives

    Raises:
        RuntimeError: one of the two solutions failed, there is no scene, or its body is in motion
    """
    if not trajectory.scene:
        raise RuntimeError("a trajectory without a scene cannot be solved again")
    scene = scene_of(trajectory.scene)
    if isinstance(scene, FlowScene):
        return flow_mesh_error(trajectory, scene)
    every = _every(scene)
    body = trajectory.body
    mine = trajectory.displacement[::every, body].astype(np.float64)  # (F, N, 3)
    free = trajectory.free[body]
    mesh = solved_on(scene, trajectory)
    again, seconds = _solved(scene, every, mesh, 1)
    _, fine, seconds = finer(scene, mesh)
    off = np.linalg.norm(fine - mine, axis=2)[1:, free]
    rms = float(np.sqrt((off**2).mean()))
    return {"mesh_rmse": rms, "mesh_largest": float(off.max()), "mesh_relative": rms / (_rms(mine[1:, free]) or np.inf),
            "solver_largest": float(np.linalg.norm(again - mine, axis=2).max()), "seconds": seconds}


def finer(scene: Scene, mesh: Mesh) -> tuple[int, NDArray[np.float64], float]:
    """A scene on cells of half the size: every how manyth frame is solved, displacements (F, N, 3) at the mesh's nodes, and seconds.

    Raises:
        RuntimeError: the solution failed, or the body is in motion
    """
    if scene.steps.dynamic:
        raise RuntimeError("a body in motion is not solved again: in other steps it moves otherwise")
    every = _every(scene)
    return every, *_solved(scene, every, mesh, 2)


def _every(scene: Scene) -> int:
    """The number of steps taken as one, which divides all of them and leaves about FRAMES."""
    return next(k for k in range(max(1, scene.steps.count // FRAMES), scene.steps.count + 1) if scene.steps.count % k == 0)


def _solved(scene: Scene, every: int, mesh: Mesh, times: int) -> tuple[NDArray[np.float64], float]:
    """Displacements (F, N, 3) at the mesh's nodes of a scene in fewer steps, on one or two times the cells each way, and seconds."""
    scene = dataclasses.replace(scene, steps=Steps(count=scene.steps.count // every))
    release()
    if scene.body.shape in ("file", "channel", "panel"):
        of_file = mesh if times == 1 else halved(mesh)
        solution, number = solve(scene, mesh=of_file, partial=True), f"{len(of_file.cells)}"
    else:
        cells = tuple(times * n for n in scene.body.divisions)
        body = dataclasses.replace(scene.body, cells=cells, cell_size=None)
        solution, number = solve(dataclasses.replace(scene, body=body), partial=True), " x ".join(map(str, cells))
    if solution.failure:
        raise RuntimeError(f"the scene with {number} cells: {solution.failure}")
    distance, node = cKDTree(solution.mesh.points).query(mesh.points)
    assert distance.max() < 1e-9, "halved cells keep the nodes"
    return solution.displacement[:, node], solution.seconds


def _refined(folder: Path, manifest: dataset.Manifest, count: int, seed: int) -> dict[str, Any]:
    """`mesh_error` of a sample, kept in refined.json between calls."""
    path = folder / "refined.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    chosen = np.random.default_rng(seed).permutation(len(manifest.trajectories))
    rows: list[dict[str, Any]] = []
    for number in progress(chosen.tolist(), "solving on finer cells"):
        entry = manifest.trajectories[number]
        if entry.sha256 not in known:
            try:
                known[entry.sha256] = mesh_error(read_trajectory(folder / entry.file))
            except RuntimeError as error:  # recorded, and another one takes its place
                known[entry.sha256] = {"failure": str(error)}
            write_whole(path, json.dumps(known, indent=1).encode())
        if "failure" not in known[entry.sha256]:
            rows.append(known[entry.sha256])
        if len(rows) == count:
            break
    failures = [row["failure"] for row in known.values() if "failure" in row]
    return {**(summary(rows) if rows else {"count": 0}), "failures": failures}


def _rms(vectors: NDArray[np.float64]) -> float:
    """Root mean square length of vectors (..., 3); 0 of none."""
    return 0.0 if not vectors.size else float(np.sqrt((vectors**2).sum(axis=-1).mean()))


def lines(found: dict[str, Any], indent: str = "") -> list[str]:
    """The numbers as lines for a reader."""
    said = []
    for name, value in found.items():
        if isinstance(value, dict) and any(isinstance(entry, dict | list) for entry in value.values()):
            said += [f"{indent}{name}", *lines(value, indent + "  ")]
        elif isinstance(value, dict):
            said.append(f"{indent}{name:22s} " + ", ".join(f"{key} {number:.4g}" for key, number in value.items()))
        elif name == "failures":
            said += [f"{indent}not solved: {reason}" for reason in dict.fromkeys(value)]
        elif not isinstance(value, list):
            said.append(f"{indent}{name:22s} {value:.5g}" if isinstance(value, float) else f"{indent}{name:22s} {value}")
    return said
