"""What a trajectory of a flow holds, in numbers. Legend: T frames, N nodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from datagen.files.trajectory import NORMAL, OUTFLOW, Trajectory
from physics.scene import FlowScene

SHEDDING = 0.02  # peak to peak of the lift coefficient in the last third


def flow_figures(trajectory: Trajectory, scene: FlowScene) -> dict[str, Any]:
    """The numbers of one flow: velocities [m/s] at the nodes that a network predicts, those inside and at the outflow; forces [N/m]."""
    inside = np.isin(trajectory.node_kind, (NORMAL, OUTFLOW))
    velocity = trajectory.fields["velocity"][:, inside, :2].astype(np.float64)
    change = np.diff(velocity, axis=0)
    row: dict[str, Any] = {
        "reynolds_number": scene.reynolds_number or 0.0, "velocity_rms": _rms(velocity), "velocity_change_rms": _rms(change),
        "velocity_largest": float(np.linalg.norm(velocity, axis=2).max(initial=0.0)),
        "pressure_rms": float(np.sqrt((trajectory.fields["pressure"].astype(np.float64) ** 2).mean()))}
    late, scale = 2 * len(velocity) // 3, trajectory.extra.get("flow", {}).get("force_of_coefficient_1_N_m")
    if scale and "lift" in trajectory.per_frame:
        lift = trajectory.per_frame["lift"][late:] / scale
        row["drag_coefficient"] = float(trajectory.per_frame["drag"][late:].mean() / scale)
        row["wake"] = "shedding" if np.ptp(lift) > SHEDDING else "steady"
    return row


def _rms(vectors: np.ndarray[Any, Any]) -> float:
    return 0.0 if not vectors.size else float(np.sqrt((vectors**2).sum(axis=-1).mean()))
