"""A predicted flow's file held against that of the flow it predicts: whoever made it, in the same format.

A prediction has the mesh and the frames of its truth, `velocity` and, where it is predicted, `pressure`. Frames up to the first one
in which the fluid moves are shown to it (figures.py).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.places import remarks_on_file
from datagen.files.prediction import ending, over_files, together
from datagen.files.prediction import verify_files as verify_solids
from datagen.files.trajectory import Trajectory, read_sound, read_trajectory
from datagen.flow.figures import predicted_nodes, resting
from physics.fidelity.figures import FLOW, shown, verdict_of_flow
from physics.fidelity.flow import FlowReference, nothing_changes
from physics.flow.space import FlowSpace
from physics.flow.stored import computed_mesh, stored
from physics.mesh.mesh import Mesh
from physics.scene import FlowScene, scene_of
from physics.schema import InputError, finite
from physics.whole import write_whole

Floats = NDArray[np.float64]
SAMPLE = 60  # frames whose equations are looked at


@dataclass(frozen=True)
class FlowTruth:
    """A flow that predictions can be held against: its file, its scene where it has one, and what is asked of predictions."""

    trajectory: Trajectory
    scene: FlowScene | None
    reference: FlowReference

    @property
    def first(self) -> int:
        """The frame that predictions begin at."""
        return self.reference.first


def read_flow_truth(path: str | Path, *, sample: int | None = SAMPLE) -> FlowTruth:
    """A flow's file. Raises `InputError` when something is wrong in it, or nothing in it can be predicted."""
    trajectory = read_sound(path)
    scene = _scene(trajectory, path)
    if not trajectory.flows:
        raise InputError(f"{path}: no flow: it has no velocity, or its mesh moves")
    first, steps = resting(trajectory), len(trajectory.displacement) - 1
    if steps <= first:
        raise InputError(f"{path}: {steps + 1} frame{'s' * (steps > 0)}, so there is no step to predict")
    if scene is not None and not scene.steps.dynamic:
        raise InputError(f"{path}: a stationary flow, so there is no step to predict")
    chosen = predicted_nodes(trajectory)
    if not chosen.any():
        raise InputError(f"{path}: the velocity is given at every node, so there is nothing to predict")
    computed = None if scene is None else _computed(scene, trajectory, path)
    span = float(trajectory.extra.get("step_seconds", 1.0))
    velocity, pressure = fields_of(trajectory)
    return FlowTruth(trajectory, scene, FlowReference(velocity, pressure, chosen, trajectory.mesh, scene, span, first, sample, computed))


def _scene(trajectory: Trajectory, path: str | Path) -> FlowScene | None:
    try:
        scene = scene_of(trajectory.scene) if trajectory.scene else None
    except InputError as error:
        raise InputError(f"{path}: its scene is wrong: {error}") from None
    if scene is not None and not isinstance(scene, FlowScene):
        raise InputError(f"{path}: the scene of a solid")
    return scene


def _computed(scene: FlowScene, trajectory: Trajectory, path: str | Path) -> Mesh:
    """The mesh that a flow was computed on: that of a file as it was then. Raises `InputError` when its nodes are not those stored."""
    mesh = trajectory.mesh if scene.body.shape == "file" and trajectory.places is not None else computed_mesh(scene)
    if not np.array_equal(stored(scene, FlowSpace(mesh, scene.order)).mesh.points, trajectory.points):
        raise InputError(f"{path}: its mesh is not the one that its scene builds")
    return mesh


def fields_of(trajectory: Trajectory) -> tuple[Floats, Floats | None]:
    """Velocity (T, S, 2) [m/s] and pressure (T, S) [Pa], None where there is none."""
    pressure = trajectory.fields.get("pressure")
    return trajectory.fields["velocity"][..., :2].astype(np.float64), None if pressure is None else pressure[..., 0].astype(np.float64)


def read_flow_prediction(path: str | Path, truth: Trajectory, reference: str | Path) -> tuple[Floats, Floats | None]:
    """Velocity and pressure of a prediction. Raises `InputError` when it is damaged, not finite, or of another mesh or other frames."""
    made = read_trajectory(path)
    if "velocity" not in made.fields:
        raise InputError(f"{path}: has no velocity")
    if len(made.displacement) != len(truth.displacement) or not np.array_equal(made.points, truth.points):
        frames, nodes = made.displacement.shape[:2]
        raise InputError(f"{path}: its mesh or number of frames is not that of {reference}: {frames} frames of {nodes} nodes, there "
                         f"{len(truth.displacement)} frames of {len(truth.points)} nodes")
    velocity, pressure = fields_of(made)
    for name, values in (("velocity", velocity), ("pressure", pressure)):
        if values is not None and not np.isfinite(values).all():
            bad = int((~np.isfinite(values.reshape(len(values), -1)).all(axis=1)).argmax())
            raise InputError(f"{path}: its {name} is not finite at frame {bad}")
    return velocity, pressure


def verify_files(prediction: str | Path, reference: str | Path, out: Path | None = None) -> dict[str, Any]:
    """Predictions of solids or of flows held against their truths: see `datagen.files.prediction.verify_files` and `verify_flows`."""
    files = together(Path(prediction), Path(reference))
    flows = [read_trajectory(truth).flows for _, _, truth in files]
    if any(flows) and not all(flows):
        raise InputError(f"{reference}: holds flows and solids; hold them against their truths apart")
    return verify_flows(files, out) if all(flows) else verify_solids(prediction, reference, out)


def verify_flows(files: list[tuple[str, Path, Path]], out: Path | None = None) -> dict[str, Any]:
    """Names, predictions and truths of flows; with a folder for it, verify.json and the vorticity of the worst frame.

    Returns:
        the figures of `physics.fidelity.flow.FlowFidelity` in SI units, of several files their means; "nothing_changes": those of a flow
        that stays as it is shown; "data": those of the truth itself, which its storage makes; "units", "verdict", "remarks", and for
        several "files": the figures of each

    Raises:
        InputError: a file is damaged or not finite, or they are not of the same mesh and frames
    """
    each, idle, own, worst = {}, [], [], None
    remarks: dict[str, None] = {}
    for name, file, truth_file in files:
        truth = read_flow_truth(truth_file)
        u, p = read_flow_prediction(file, truth.trajectory, truth_file)
        reference = truth.reference
        remarks |= dict.fromkeys(remarks_on_file(truth.trajectory.extra))
        each[name] = vars(reference.verify(u, p))
        own.append(vars(reference.verify(reference.velocity, reference.pressure)))
        kept = None if reference.pressure is None else nothing_changes(reference.pressure, truth.first, np.ones(u.shape[1], bool))
        idle.append(vars(reference.verify(nothing_changes(reference.velocity, truth.first, reference.predicted), kept)))
        if worst is None or each[name]["velocity_rmse_all"] > worst[0]:
            worst = each[name]["velocity_rmse_all"], truth.trajectory, file, each[name]["worst_step"]
    several = len(files) > 1
    figures = over_files(list(each.values())) if several else next(iter(each.values()))
    still = over_files(idle)
    result = {**figures, "nothing_changes": still, "data": over_files(own),
              "units": {name: column.si for name, column in FLOW.items()}, "verdict": verdict_of_flow(figures, still),
              "remarks": list(remarks)} | ({"files": each} if several else {})
    if out is not None and worst is not None:
        from physics.view import flow_picture

        write_whole(out / "verify.json", json.dumps(finite(result), indent=1).encode())
        flow_picture(out / "worst.png", worst[1].mesh, read_trajectory(worst[2]).fields["velocity"], worst[3],
                     truth=worst[1].fields["velocity"])
    return result


def flow_lines(result: dict[str, Any]) -> list[str]:
    """What `verify_flows` found, for a terminal: each figure beside that of a flow that does not change, and of the data themselves."""
    said = [f"{'':30s} {'prediction':>12s} {'nothing changes':>16s} {'the data':>12s}"]
    for name, column in FLOW.items():
        head = f"{column.head} [{column.unit}]" if column.unit else column.head
        values = [shown(of[name]) for of in (result, result["nothing_changes"], result["data"])]
        said.append(f"{head:30s} {values[0]:>12s} {values[1]:>16s} {values[2]:>12s}")
    return said + ending(result, 30, lambda of: f"RMSE-all {shown(of['velocity_rmse_all'])} m/s, residual {shown(of['momentum_residual'])}")
