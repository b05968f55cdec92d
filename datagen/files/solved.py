"""Which equations a trajectory answers: the scene as its solver took it, on the mesh that it was solved on."""

from __future__ import annotations

from datagen.files.trajectory import Trajectory
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Scene


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
