"""What a scene of a plane body may not ask for: the body lies in z = 0 and moves in that plane alone."""

from __future__ import annotations

from physics.scene.parts import Obstacle
from physics.scene.scene import Scene
from physics.schema import InputError


def check_plane(scene: Scene) -> None:
    """Raises `InputError` for what would act, or lie, across the plane."""
    for i, support in enumerate(scene.support):
        if support.displacement[2]:
            raise InputError(f"support[{i}].displacement: moves along z; a plane body stays in z = 0")
        if support.axis is not None and any(support.axis[:2]):
            raise InputError(f"support[{i}].axis = {list(support.axis)}: a plane body turns about [0, 0, 1]")
    for i, load in enumerate(scene.load):
        for key in ("traction", "acceleration"):
            vector = getattr(load, key)
            if vector is not None and vector[2]:
                raise InputError(f"load[{i}].{key}: acts along z; a plane body stays in z = 0")
    if scene.steps.velocity is not None and scene.steps.velocity[2]:
        raise InputError("steps.velocity: leads out of the plane; a plane body stays in z = 0")
    for obstacle in scene.obstacles:
        _check_obstacle(obstacle)


def _check_obstacle(obstacle: Obstacle) -> None:
    """An obstacle must look the same from both sides of the plane."""
    if any(point[2] for point in obstacle.path):
        raise InputError("obstacle.path: leaves z = 0, where a plane body lies")
    if obstacle.shape == "mesh":
        raise InputError("obstacle.shape = 'mesh': a surface of triangles meets solid bodies only; take another shape for a plane one")
    if obstacle.angle and any(obstacle.axis[:2]):
        raise InputError(f"obstacle.axis = {list(obstacle.axis)}: beside a plane body a box turns about [0, 0, 1]")
    if obstacle.shape == "cylinder" and any(obstacle.axis[:2]):
        raise InputError(f"obstacle.axis = {list(obstacle.axis)}: beside a plane body a cylinder stands on its plane, axis = [0, 0, 1]")
    if obstacle.shape == "capsule" and obstacle.axis[2] and any(obstacle.axis[:2]):
        raise InputError(f"obstacle.axis = {list(obstacle.axis)}: beside a plane body a capsule lies in its plane or stands on it")
    if obstacle.normal is not None and obstacle.normal[2]:
        raise InputError(f"obstacle.normal = {list(obstacle.normal)}: beside a plane body it lies in its plane")
