"""Whether the trajectory of a flow is what its scene gives, a line for each thing that is not.

At every frame the velocity at inlets and walls is that of the scene. At some frames the flux through the outflow is what flows in,
and the velocity has no divergence in the mean: with the stored nodes as those of quadratic functions on the cells that were
computed on, against the linear functions of those. The first frames are computed anew from rest, step by step as they were.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from datagen.files.layout import HALF_ULP
from datagen.files.trajectory import Trajectory
from physics.flow.conditions import conditions_of
from physics.flow.solution import solve_flow
from physics.flow.space import FlowSpace
from physics.flow.stored import computed_mesh, stored
from physics.scene import FlowScene

ANEW = 1e-5  # of the largest value: how far a frame that is computed again may be off, on another processor too
LEAK = 0.05  # of the fastest fluid over the cells' size, root mean square over the domain: solved frames of coarse cells have 0.02


def against_flow(trajectory: Trajectory, scene: FlowScene, *, steps: int = 5) -> list[str]:
    """What contradicts the flow that a trajectory is said to be of. Raises `InputError` for a bad scene.

    Args:
        steps: how many frames are computed anew, the first ones, and looked at for divergence, evenly spaced
    """
    if missing := {"velocity", "pressure"} - trajectory.fields.keys():
        return [f"has no {' and no '.join(sorted(missing))}"]
    space = FlowSpace(computed_mesh(scene), scene.order)
    where = stored(scene, space)
    frames = len(trajectory.displacement)
    if frames != scene.steps.count + 1:
        return [f"{frames} frames for {scene.steps.count}"]
    if not np.array_equal(trajectory.points, where.mesh.points) or not np.array_equal(trajectory.connectivity, where.mesh.cells.ravel()):
        return ["the mesh is not that of its scene"]
    velocity = trajectory.fields["velocity"][..., :2].astype(np.float64)
    fastest = max(float(abs(velocity).max()), 1e-12)
    off = max(4 * HALF_ULP * fastest, tolerance_of(trajectory, "velocity"))
    return (_boundary(velocity, scene, space, where.halved, off) or _leaks(velocity, scene, space, where.halved, steps, fastest)
            or _anew(trajectory, scene, steps))


def tolerance_of(trajectory: Trajectory, name: str) -> float:
    """What packing may have changed of a field."""
    found = trajectory.extra.get("field_tolerance", {})
    return float(found.get(name, 0.0)) if isinstance(found, dict) else 0.0


def _boundary(velocity: NDArray[np.float64], scene: FlowScene, space: FlowSpace, halved: bool, off: float) -> list[str]:
    conditions = conditions_of(scene, space)
    coarse = FlowSpace(space.mesh, 2) if halved else space
    there = conditions_of(scene, coarse)  # nodes of order two are those that are stored
    vertices = len(space.mesh.points)
    chosen = np.ones(len(there.fixed), bool) if halved else there.fixed < vertices
    assert len(conditions.fixed) >= int(chosen.sum())
    for frame, u in enumerate(velocity):
        time = frame * (scene.steps.duration or 0.0) / scene.steps.count
        miss = float(abs(u[there.fixed[chosen]] - there.values(time)[chosen]).max(initial=0.0))
        if miss > off:
            return [f"the velocity at inlets and walls is off by {miss:.2g} m/s in frame {frame}"]
    return []


def _leaks(velocity: NDArray[np.float64], scene: FlowScene, space: FlowSpace, halved: bool, steps: int, fastest: float) -> list[str]:
    if not halved:
        return []
    coarse = FlowSpace(space.mesh, 2)
    mass = coarse.mass.sum()
    share = np.bincount(coarse.pressure.cells.ravel(), coarse.mass_of_pressure().sum(axis=2).ravel())
    for frame in np.unique(np.linspace((len(velocity) - 1) / steps, len(velocity) - 1, steps).round().astype(int)):
        leak = coarse.divergence(velocity[frame])
        rate = float(np.sqrt((leak**2 / share).sum() / mass))
        allowed = LEAK * fastest / float(np.sqrt(mass / len(space.mesh.cells)))
        if rate > allowed:
            return [f"the divergence in frame {frame} is {rate:.2g} 1/s, where {allowed:.2g} 1/s is allowed"]
    return []


def _anew(trajectory: Trajectory, scene: FlowScene, steps: int) -> list[str]:
    if scene.steps.stationary:
        found = solve_flow(scene)
    else:
        count = min(steps, scene.steps.count)
        assert scene.steps.duration is not None
        if any(part.steps is not None for part in scene.inflow):
            count = scene.steps.count  # their factors are shares of the whole duration
        short = replace(scene.steps, count=count, duration=scene.steps.duration * count / scene.steps.count)
        found = solve_flow(replace(scene, steps=short))
    for name, again in (("velocity", found.velocity), ("pressure", found.pressure)):
        there = trajectory.fields[name][:len(again)]
        miss, allowed = float(abs(there - again).max()), ANEW * float(abs(again).max()) + tolerance_of(trajectory, name)
        if miss > allowed:
            return [f"the {name} of the first frames, computed anew, differs by {miss:.2g}, where {allowed:.2g} is allowed"]
    for name, figures in found.per_frame.items():
        kept = trajectory.per_frame.get(name)
        if kept is not None and not np.allclose(kept[:len(figures)], figures, rtol=1e-3, atol=1e-6 * float(abs(figures).max())):
            return [f"{name} of the first frames, computed anew, is another"]
    return []
