"""Predictors that know all frames of a path at once: of beams by sections, of bodies by shapes.

Legend: T frames, N nodes.
"""

from __future__ import annotations

from pathlib import Path as Path_
from typing import Any

import numpy as np
from numpy.typing import NDArray

import learning.bodies.path
import learning.slender.path
from datagen.files.solved import solved_on
from datagen.files.trajectory import Trajectory
from learning.bodies.model import Bodies, load_bodies
from learning.config import KINDS, BodiesConfig
from learning.slender.model import Slender, load_slender
from learning.slender.path import Path
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError

AtOnce = Slender | Bodies


def load_at_once(run: str | Path_, about: dict[str, Any]) -> AtOnce:
    """The best predictor of a run folder, of the kind that a checkpoint's header names. Raises `InputError`."""
    return load_bodies(run) if KINDS[about["config"]["network"]["kind"]] is BodiesConfig else load_slender(run)


def is_at_once(about: dict[str, Any]) -> bool:
    """Whether a checkpoint's header is that of such a predictor."""
    config = about.get("config")
    network = config.get("network") if isinstance(config, dict) else None
    return isinstance(network, dict) and network.get("kind") in KINDS


def predict(model: AtOnce, scene: Scene, mesh: Mesh) -> Path:
    """The path of a scene's body. Raises `InputError` for a scene of which the model knows nothing."""
    if isinstance(model, Bodies):
        return learning.bodies.path.predict(model, scene, mesh)
    return learning.slender.path.predict(model, scene, mesh.points)


def path_of(model: AtOnce, trajectory: Trajectory) -> Path:
    """The path of a trajectory file's scene. Raises `InputError` as `predict` does, and where the file holds no scene."""
    if not trajectory.scene:
        raise InputError("holds no scene, which tells the predictor what presses on what")
    scene = Scene.from_toml(trajectory.scene)
    mesh = solved_on(scene, trajectory)
    path = predict(model, scene, mesh)
    if not np.array_equal(mesh.points, trajectory.points[trajectory.body]):
        raise InputError("the mesh is not the one that its scene builds")
    if len(path.bar) != len(trajectory.displacement):
        raise InputError(f"has {len(trajectory.displacement)} frames, its scene {len(path.bar)}")
    return path


def rolled_out(trajectory: Trajectory, path: Path) -> NDArray[np.float32]:
    """(T, nodes, 3) displacement of all nodes: free ones as predicted, the others as given."""
    displacement = trajectory.displacement.copy()
    displacement[:, trajectory.free] = path.displacement[:, trajectory.free[trajectory.body]]
    return displacement
