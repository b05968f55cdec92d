"""What a trajectory of a flow holds, in numbers, and from which frame on it can be predicted. Legend: T frames, N nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import NORMAL, OUTFLOW, Trajectory
from physics.scene import FlowScene

SHEDDING = 0.02  # peak to peak of the lift coefficient in the last third


def resting(trajectory: Trajectory) -> int:
    """1 when the fluid is at rest in the first of several frames, but where its velocity is given, else 0: the first frame that moves.

    An impulsive start gives the fluid its velocity in no time, by a pressure without bounds; so predictions begin at that frame.
    """
    velocity = trajectory.fields["velocity"]
    speed = abs(velocity[0, predicted_nodes(trajectory)]).max(axis=1)  # beside an inlet a cubic overshoots at rest
    return int(len(velocity) > 2 and np.median(speed) == 0)


def predicted_nodes(trajectory: Trajectory) -> NDArray[np.bool_]:
    """(N,) True inside and at the outflow: where the velocity of a flow is not given."""
    return np.isin(trajectory.node_kind, (NORMAL, OUTFLOW))


def flow_figures(trajectory: Trajectory, scene: FlowScene | None) -> dict[str, Any]:
    """The numbers of one flow: velocities [m/s] at the nodes that a network predicts, changes once the fluid moves; forces [N/m]."""
    velocity = trajectory.fields["velocity"][:, predicted_nodes(trajectory), :2].astype(np.float64)
    change = np.diff(velocity[resting(trajectory):], axis=0)
    row: dict[str, Any] = {} if scene is None else {"reynolds_number": scene.reynolds_number or 0.0}
    row |= {
        "velocity_rms": _rms(velocity), "velocity_change_rms": _rms(change),
        "velocity_largest": float(np.linalg.norm(velocity, axis=2).max(initial=0.0))}
    if "pressure" in trajectory.fields:
        row["pressure_rms"] = float(np.sqrt((trajectory.fields["pressure"].astype(np.float64) ** 2).mean()))
    late, scale = 2 * len(velocity) // 3, trajectory.extra.get("flow", {}).get("force_of_coefficient_1_N_m")
    if scale and "lift" in trajectory.per_frame:
        lift = trajectory.per_frame["lift"][late:] / scale
        row["drag_coefficient"] = float(trajectory.per_frame["drag"][late:].mean() / scale)
        row["wake"] = "shedding" if np.ptp(lift) > SHEDDING else "steady"
    return row


def _rms(vectors: np.ndarray[Any, Any]) -> float:
    return 0.0 if not vectors.size else float(np.sqrt((vectors**2).sum(axis=-1).mean()))
