"""Which equations a trajectory answers: the scene as its solver took it, on the mesh that it was solved on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from datagen.files.places import mesh_file
from datagen.files.trajectory import Trajectory
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Scene, scene_of
from physics.scene.parts import QUANTITIES
from physics.scene.rules import chosen_keys
from physics.schema import InputError


def as_solved(scene: Scene, trajectory: Trajectory, step: int) -> Scene:
    """The scene whose equations a step of its trajectory solves: under the linear law where the solver saw that it is enough."""
    if step > trajectory.extra.get("linear_steps", 0):
        return scene
    return scene.under("linear")


def solved_on(scene: Scene, trajectory: Trajectory) -> Mesh:
    """The mesh that a trajectory's scene was solved on: that of the file as it was then, or the one that the scene builds.

    Raises:
        InputError: the body is of a file, of which an older trajectory kept no places, and the file is not there
    """
    if scene.body.shape == "file" and trajectory.places is not None:
        return trajectory.mesh
    return build_mesh(scene.body)


def answers(scene: Any, found: Trajectory) -> bool:
    """Whether a trajectory is of this very scene, a solid or a flow.

    A mesh file may go by another path if it is the same file; a scene that asks for an error has the mesh that was chosen for it.
    """
    of_file, asks = scene.body.shape == "file", getattr(scene.steps, "error", None) is not None
    if not (of_file or asks):
        return found.scene == scene.to_toml()
    try:
        there: Any = scene_of(found.scene)
    except InputError:
        return False
    body: dict[str, Any] = {"path": scene.body.path}
    if asks:
        accuracy = found.extra.get("accuracy", {})
        if (accuracy.get("asked"), accuracy.get("quantity")) != (scene.steps.error, scene.steps.quantity or QUANTITIES[0]):
            return False
        body |= {key: getattr(scene.body, key) for key in chosen_keys({})}
        there = replace(there, steps=replace(there.steps, error=scene.steps.error, quantity=scene.steps.quantity))
    if replace(there, body=replace(there.body, **body)) != scene:
        return False
    return not of_file or (found.places is not None and found.extra.get("mesh_file", {}).get("sha256") == mesh_file(scene)["sha256"])
