"""A prediction's file held against that of the trajectory it predicts: whoever made it, in the same format."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from datagen.files.trajectory import Trajectory, as_solved, read_sound, read_trajectory, solved_on
from physics.fidelity.verify import as_table, verify
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError


def finite(value: Any) -> Any:
    """The same value with None for numbers that JSON has no word for."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_truth(path: str | Path) -> tuple[Trajectory, Scene, Mesh]:
    """A trajectory that predictions can be held against, with the scene as its last step was solved, and the mesh of this.

    Raises:
        InputError: something is wrong in the file, it holds no scene or a dynamic one, or its mesh is not the one that its scene builds
    """
    trajectory, scene, mesh = read_reference(path)
    if scene is None:
        raise InputError(f"{path}: holds no scene, so there are no equations to hold a prediction against")
    return trajectory, scene, mesh


def read_reference(path: str | Path) -> tuple[Trajectory, Scene | None, Mesh]:
    """The same, with None for the scene of a trajectory that holds none, such as an imported one: errors can be told, no more."""
    trajectory = read_sound(path)
    if len(trajectory.displacement) < 2:
        raise InputError(f"{path}: a single frame, so there is no step to predict")
    if not trajectory.free[trajectory.body].any():
        raise InputError(f"{path}: no node is free to move, so there is nothing to predict")
    if not trajectory.scene:
        return trajectory, None, trajectory.mesh
    try:
        scene = Scene.from_toml(trajectory.scene)
    except InputError as error:
        raise InputError(f"{path}: its scene is wrong: {error}") from None
    if scene.steps.dynamic:
        raise InputError(f"{path}: a body in motion; predictions are held against the equations of equilibrium, which it does not obey")
    mesh, own = solved_on(scene, trajectory), trajectory.mesh
    if not (np.array_equal(own.points, mesh.points) and np.array_equal(own.cells, mesh.cells)):
        raise InputError(f"{path}: its mesh is not the one that its scene builds")
    return trajectory, as_solved(scene, trajectory, len(trajectory.displacement) - 1), mesh


def verify_files(prediction: str | Path, reference: str | Path, out: Path | None = None) -> dict[str, Any]:
    """The figures of `physics.fidelity.verify.Fidelity`; with a folder, verify.json and a picture of the worst frame in it.

    Where the reference has no scene, those of the equations are not numbers.

    Raises:
        InputError: a file is damaged or not finite, or they are not of the same mesh and steps
    """
    predicted, (truth, scene, mesh) = read_trajectory(prediction), read_reference(reference)
    if predicted.displacement.shape != truth.displacement.shape or not np.array_equal(predicted.points, truth.points):
        raise InputError(f"{prediction}: its mesh or number of frames is not that of {reference}")
    finite_frames = np.isfinite(predicted.displacement).all(axis=(1, 2))
    if not finite_frames.all():
        raise InputError(f"{prediction}: its displacement is not finite at frame {int(finite_frames.argmin())}")
    body = truth.body
    u, v = predicted.displacement[:, body], truth.displacement[:, body]
    found = verify(u, v, scene=scene, mesh=mesh, free=truth.free[body])
    result = as_table(found)
    if out is not None:
        from physics.view import frame_picture

        out.mkdir(parents=True, exist_ok=True)
        (out / "verify.json").write_text(json.dumps(finite(result), indent=1))
        step = found.worst_step
        frame_picture(out / "worst.png", mesh, prediction=u[step], truth=v[step], step=step, steps=len(v) - 1)
    return result
