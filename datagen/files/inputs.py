"""What a predictor may see of a trajectory: all but the motion of the free nodes, as arrays of the body alone.

    inputs = inputs_of(read_trajectory("press.vtkhdf"))
    points, edges, pose, held = map(torch.from_numpy, (inputs.points, inputs.edges, inputs.pose, inputs.held))
    target = torch.from_numpy(trajectory.displacement[:, trajectory.body])

Legend: T frames (the rest state first), N nodes of the body, C cells, E edges, P nodes of the obstacle, F its triangles, m modes.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from datagen.files.layout import displacements
from datagen.files.trajectory import Trajectory
from physics.contact.obstacles import Rigid
from physics.scene import Scene
from physics.whole import write_whole


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """One scene as a predictor sees it; lengths in metres."""

    points: NDArray[np.float64]  # (N, 3) at rest
    cells: NDArray[np.int64]  # (C, k) node numbers
    cell: str  # prism, tetrahedron, hexahedron, triangle or quadrilateral
    edges: NDArray[np.int64]  # (E, 2) of the cells, each once
    free: NDArray[np.bool_]  # (N,) the nodes that are to be predicted
    held: NDArray[np.float32]  # (T, N, 3) displacement of the others, which is given; 0 on free nodes
    pose: NDArray[np.float64] | None  # (T, 3) the obstacle's centre in each frame, of several (T, K, 3); None without one
    obstacle_points: NDArray[np.float64] | None  # (P, 3) its surface at frame 0; it moves without turning. Of several, one after the other
    obstacle_triangles: NDArray[np.int64] | None  # (F, 3)
    modes: NDArray[np.float32]  # (m, N, 3) elastic modes, as far as the file has them
    frames: int  # T
    scene: Scene | None  # material, supports, loads, steps; None for a set that tells none


def inputs_of(trajectory: Trajectory) -> Inputs:
    """The inputs of a trajectory. Raises `InputError` for a scene that is wrong."""
    mesh, body, surface = trajectory.mesh, trajectory.body, trajectory.obstacle
    free = trajectory.free[body]
    return Inputs(
        points=mesh.points, cells=mesh.cells, cell=mesh.cell, edges=mesh.edges, free=free,
        held=np.where(free[:, None], np.float32(0), trajectory.displacement[:, body]), pose=poses(trajectory),
        obstacle_points=None if surface is None else surface[0][0], obstacle_triangles=None if surface is None else surface[1],
        modes=trajectory.modes[:, body], frames=len(trajectory.displacement),
        scene=Scene.from_toml(trajectory.scene) if trajectory.scene else None)


def poses(trajectory: Trajectory) -> NDArray[np.float64] | None:
    """(T, 3) [m] the obstacle's centre in each frame, of several (T, K, 3), of a set without a scene the middle of its nodes; None
    without an obstacle."""
    surface = trajectory.obstacle
    if surface is None:
        return None
    if "obstacle" in trajectory.per_frame:
        return np.asarray(trajectory.per_frame["obstacle"], np.float64)
    scene = Scene.from_toml(trajectory.scene) if trajectory.scene else None
    if scene is None or not scene.obstacles:
        return np.asarray(surface[0].mean(axis=1))
    found = centres(scene, len(trajectory.displacement))
    return found[:, 0] if len(scene.obstacles) == 1 else found


def centres(scene: Scene, frames: int) -> NDArray[np.float64]:
    """(frames, K, 3) [m] where the centres of a scene's K obstacles are in its first frames."""
    rigid = [Rigid(obstacle) for obstacle in scene.obstacles]
    return np.array([[one.position(step / scene.steps.count) for one in rigid] for step in range(frames)]).reshape(frames, len(rigid), 3)


def numbered(name: str, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Values (T, K, 3) of each of K obstacles as a trajectory holds them: by their name, of several as name_1, name_2, ..."""
    return {name: values[:, 0]} if values.shape[1] == 1 else {f"{name}_{k + 1}": values[:, k] for k in range(values.shape[1])}


def predicted(trajectory: Trajectory, displacement: ArrayLike, *, name: str = "", seconds_per_step: float | None = None) -> Trajectory:
    """A prediction in the place of a trajectory's motion, ready for `write_trajectory`.

    Args:
        displacement: (T, N, 3) [m] of the body's nodes from their rest positions
        name: of what made it; seconds_per_step: what it took; both are shown where predictions are compared

    Raises:
        InputError: another shape
    """
    body = trajectory.body
    u = displacements(displacement, len(trajectory.displacement), int(body.sum()), "nodes of the body")
    whole = trajectory.displacement.copy()
    whole[:, body] = u
    extra: dict[str, Any] = {"name": name} if name else {}
    extra |= {} if seconds_per_step is None else {"seconds_per_step": float(seconds_per_step)}
    return replace(trajectory, displacement=whole, remainder=None, per_frame={}, extra=extra)


def write_table(path: str | Path, trajectory: Trajectory) -> None:
    """A CSV file of what a trajectory says of each frame, vectors as three columns; units as in the format's page. Raises OSError."""
    columns: dict[str, NDArray[Any]] = {"step": np.arange(len(trajectory.displacement))}
    for name, values in trajectory.per_frame.items():
        columns |= {f"{name}_{axis}": values[:, i] for i, axis in enumerate("xyz")} if values.ndim == 2 else {name: values}
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    write_whole(path, text.getvalue().encode())
