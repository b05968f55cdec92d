"""The trajectory file of a flow: its mesh at rest, velocity and pressure at the nodes, forces and the solver's figures for each frame.

Node kinds are those of CylinderFlow: the nodes of inlets and outlets, without their corners, are INFLOW and OUTFLOW, those of every
wall, the cylinder's too, are WALL. `displacement` is zero. What users of that set miss stands in `extra` under "flow": density,
viscosity, inflow, the cylinder's centre and radius, the Reynolds number with its definition.
"""

from __future__ import annotations

import numpy as np

from datagen.files.places import mesh_file, places_of
from datagen.files.provenance import commit, versions
from datagen.files.trajectory import INFLOW, NORMAL, OUTFLOW, WALL, Trajectory
from physics.flow.solution import FlowSolution
from physics.mesh.cell import CELLS
from physics.scene import FlowScene
from physics.schema import to_table

KIND = np.array([NORMAL, INFLOW, OUTFLOW, WALL], np.uint8)  # by physics.flow.solution's FLUID, INLET, OUTLET, WALL


def flow_trajectory(scene: FlowScene, solution: FlowSolution, *, seed: int = 0, index: int = 0) -> Trajectory:
    """The frames of a flow as a file holds them; not `complete` when the solver stopped early, and `extra` says why under "failure"."""
    mesh, frames = solution.mesh, len(solution.velocity)
    extra = {"model": solution.model, "seconds": solution.seconds, "factorisations": solution.factorisations, "failure": solution.failure,
             "flow": facts(scene, solution)}
    if scene.steps.duration is not None:
        extra["step_seconds"] = scene.steps.duration / scene.steps.count
    from_file = scene.body.shape == "file"
    if from_file:
        extra["mesh_file"] = mesh_file(scene)
    return Trajectory(
        points=mesh.points, connectivity=mesh.cells.ravel(), offsets=3 * np.arange(len(mesh.cells) + 1),
        types=np.full(len(mesh.cells), CELLS["triangle"].vtk, np.uint8), node_kind=KIND[solution.node_place],
        displacement=np.zeros((frames, len(mesh.points), 3), np.float32), modes=np.empty((0, len(mesh.points), 3), np.float32),
        per_frame=solution.per_frame, fields={"velocity": solution.velocity, "pressure": solution.pressure},
        scene=scene.to_toml(), seed=seed, index=index, versions=versions(), commit=commit(), complete=not solution.failure,
        extra=extra, places=places_of(mesh) if from_file else None)


def facts(scene: FlowScene, solution: FlowSolution) -> dict[str, object]:
    """What a flow is, in numbers with units in their names."""
    body, force = scene.body, scene.force
    found: dict[str, object] = {
        "density_kg_m3": scene.fluid.density, "viscosity_Pa_s": scene.fluid.viscosity,
        "inflow": [to_table(inflow) for inflow in scene.inflow]}
    if body.shape == "channel" and body.hole_centre and body.hole_radius:
        found |= {"centre_m": list(body.hole_centre), "radius_m": body.hole_radius}
    if force is not None and scene.reynolds_number is not None:
        found |= {"reynolds_number": scene.reynolds_number,
                  "reynolds_number_is": "density x mean speed of the inflow's profile x diameter / viscosity" if body.shape == "channel"
                  else "density x force.speed x force.length / viscosity",
                  "coefficient_is": "force / (density speed^2 length / 2)", "force_of_coefficient_1_N_m": solution.scale}
    return found
