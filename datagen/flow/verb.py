"""What `simulate` does with a flow, wiring only."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from tqdm import tqdm

from datagen.files.inputs import write_table
from datagen.files.trajectory import unfinished, write_trajectory
from datagen.flow.trajectory import flow_trajectory
from physics.flow.solution import solve_flow
from physics.scene import FlowScene
from physics.schema import InputError, WorkError


def simulate_flow(scene: FlowScene, options: argparse.Namespace, *, say: Callable[[str], None], writable: Callable[..., Any],
                  processes: int) -> dict[str, Any]:
    """The frames of a flow, into a trajectory; what is returned is printed as JSON when that is asked for."""
    if processes > 1:
        raise InputError(f"{options.scene}: a flow runs as one process")
    for option, given in (("--fields", options.fields), ("--html", options.html)):
        if given:
            raise InputError(f"{option}: is for solids; a flow's velocity and pressure are in the trajectory, which ParaView shows")
    out, table = writable(options.out, ".vtkhdf"), writable(options.csv, ".csv", option="--csv")
    if out.exists() and unfinished(out) not in (None, scene.to_toml()):
        raise InputError(f"--out {out}: an unfinished run of another scene; choose another name, or delete it to start anew")
    part = out.with_name(out.name + ".part")
    with tqdm(total=scene.steps.count, disable=None, desc="simulate", unit="frame") as bar:
        solution = solve_flow(scene, on_step=lambda step: bar.update(step - bar.n), journal=part, partial=True)
    trajectory = flow_trajectory(scene, solution)
    write_trajectory(out, trajectory)
    if table is not None:
        write_table(table, trajectory)
    frames = len(solution.velocity) - 1
    if solution.resumed:
        say(f"went on after frame {solution.resumed}, which an earlier run had reached")
    if solution.failure:
        raise WorkError(f"{solution.failure}; the {frames} frames before it are in {out}; the same call tries again from there, without "
                        f"{part.name} from the start")
    part.unlink(missing_ok=True)
    last = {name: values[-1] for name, values in solution.per_frame.items()}
    drag, lift = solution.coefficients("drag"), solution.coefficients("lift")
    result: dict[str, Any] = {
        "frames": frames, "ms_per_frame": 1e3 * solution.seconds / frames, "steps": int(solution.per_frame["iterations"].sum()),
        "factorisations": solution.factorisations, "seconds": solution.seconds, "resumed_after_frame": solution.resumed,
        "nodes": len(solution.mesh.points), "per_frame": {name: values.tolist() for name, values in solution.per_frame.items()},
        "model": solution.model, "remarks": list(solution.remarks)}
    if drag is not None and lift is not None:
        result |= {"drag_coefficient": float(drag[-1]), "lift_coefficient": float(lift[-1]),
                   "largest_drag_coefficient": float(drag.max()), "largest_lift_coefficient": float(lift.max())}
    if "pressure_difference" in last:
        result["pressure_difference"] = float(last["pressure_difference"])
    say(f"{frames} frame{'s' * (frames != 1)} in {solution.seconds:.2f} s, {result['steps']} steps: {out}")
    for name in ("drag_coefficient", "lift_coefficient", "pressure_difference"):
        if name in result:
            say(f"  {name}: {result[name]:.8g}")
    for what, why in solution.model.items():
        say(f"  {what}: {why}")
    for text in result["remarks"]:
        say(text)
    return result
