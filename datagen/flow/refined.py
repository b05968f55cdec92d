"""How far a stored flow is from the same flow on cells half as large: the error of its mesh, and of the steps that go with it.

The finer flow is read off at the stored nodes by the functions that its own nodes stand for. Where vortices are shed both flows drift
apart in phase: over many periods a frequency that is off by a share s shows as 2 pi s times the number of periods, times the amplitude.
So the early frames are told beside all of them, forces by their ranges beside the differences at each moment, and the frequency alone.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from datagen.files.trajectory import Trajectory
from datagen.flow.figures import SHEDDING, predicted_nodes, resting
from physics.fidelity.carried import reader
from physics.fidelity.flow import frequency
from physics.flow.solution import solve_flow
from physics.scene import FlowScene

EARLY = 50  # frames


def flow_mesh_error(trajectory: Trajectory, scene: FlowScene) -> dict[str, float | str]:
    """How far a flow is from that on cells of half the size.

    Returns:
        velocity_rmse_50, velocity_rmse_all: root mean square difference of a component [m/s] inside and at the outflow, in the first
            frames once the fluid moves, and in all; velocity_relative: the latter over the root mean square component
        drag_rmse, lift_rmse: of the coefficients, or of the forces [N/m] where there are none, after the first tenth of the frames
        drag_mean, lift_range: change of the mean drag, and of the lift from trough to peak, over the finer one's, second half
        frequency: change of the lift's, over the finer one's; 0 where no vortices are shed
        wake: shedding or steady
        seconds: of the finer solution

    Raises:
        RuntimeError: the finer solution failed, or the mesh is that of a file
    """
    if scene.body.shape == "file":
        raise RuntimeError("a flow on the mesh of a file is not solved again")
    fine = coarser(scene, 0.5)
    start = time.process_time()
    found = solve_flow(fine, partial=True)
    seconds = time.process_time() - start
    if found.failure:
        raise RuntimeError(f"the flow on finer cells: {found.failure}")
    first, inside = resting(trajectory), predicted_nodes(trajectory)
    carry = reader(fine, trajectory.points[:, :2].astype(np.float64))[inside]
    true = carried(carry, found.velocity[..., :2].astype(np.float64))
    off = (trajectory.fields["velocity"][:, inside, :2] - true)[first:]
    scale = float(trajectory.extra.get("flow", {}).get("force_of_coefficient_1_N_m") or 1.0)
    own, finer = ({name: per_frame[name] / scale for name in ("drag", "lift") if name in per_frame}
                  for per_frame in (trajectory.per_frame, found.per_frame))
    begun, late = len(true) // 10, len(true) // 2
    row: dict[str, float | str] = {"velocity_rmse_50": _rms(off[1:EARLY + 1]), "velocity_rmse_all": _rms(off[1:]),
                                   "velocity_relative": _rms(off[1:]) / (_rms(true[first + 1:]) or np.inf)}
    if finer and own:
        lift, lift_fine = own["lift"][late:], finer["lift"][late:]
        sheds = np.ptp(lift_fine) > SHEDDING
        row |= {f"{name}_rmse": _rms(own[name][begun:] - finer[name][begun:]) for name in ("drag", "lift")}
        row |= {"drag_mean": float(own["drag"][late:].mean() / finer["drag"][late:].mean() - 1),
                "lift_range": float(np.ptp(lift) / np.ptp(lift_fine) - 1) if sheds else 0.0,
                "frequency": float(np.nan_to_num(frequency(lift) / frequency(lift_fine) - 1)) if sheds else 0.0,
                "wake": "shedding" if sheds else "steady"}
    return row | {"seconds": seconds}


def coarser(scene: FlowScene, larger: float) -> FlowScene:
    """The scene on cells so many times as large."""
    if larger == 1.0:
        return scene
    body = scene.body
    if body.cell_size is not None:
        hole = None if body.hole_cell_size is None else larger * body.hole_cell_size
        return replace(scene, body=replace(body, cell_size=larger * body.cell_size, hole_cell_size=hole))
    return replace(scene, body=replace(body, cells=tuple(max(1, round(n / larger)) for n in body.divisions), cell_size=None))


def carried(carry: scipy.sparse.csr_matrix, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, M, ...) of values (T, S, ...)."""
    frames, nodes = values.shape[:2]
    found = carry @ np.moveaxis(values, 1, 0).reshape(nodes, -1)
    return np.moveaxis(found.reshape(len(found), frames, *values.shape[2:]), 0, 1)


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt((values.astype(np.float64) ** 2).mean())) if values.size else 0.0
