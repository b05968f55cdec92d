"""The answer to a flow scene: its frames, kept in a journal where one is wanted, or the stationary flow.

A path kept in a journal (journal.py) is gone on with after a kill, to the same bits as if nothing had happened. Legend: T frames, S
nodes stored.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.flow.conditions import Conditions, conditions_of
from physics.flow.forces import Forces
from physics.flow.frames import NoFlow, advance, figures
from physics.flow.space import FlowSpace
from physics.flow.stationary import NoStationaryFlow, stationary
from physics.flow.stepping import Memory, Stepper
from physics.flow.stored import Stored, computed_mesh, stored
from physics.journal import Arrays, digest_of, follow, unflatten
from physics.mesh.mesh import Mesh
from physics.mesh.sound.rows import rows_in
from physics.scene.flow import FlowScene
from physics.schema import WorkError

Floats = NDArray[np.float64]

RESOLVED = {2: 0.06, 3: 0.03}  # the largest share of the velocity that its highest order may hold, by order
TURNS = 5.0  # blocks of steps in the time in which the inflow passes the length that a force is of three times


@dataclass(frozen=True, kw_only=True)
class FlowSolution:
    """The frames of a flow; arrays have one row for each of the T frames that were reached, the first at t = 0."""

    mesh: Mesh  # that the frames are stored on
    velocity: NDArray[np.float32]  # (T, S, 3) [m/s]
    pressure: NDArray[np.float32]  # (T, S, 1) [Pa]
    per_frame: dict[str, Floats]  # (T,) each, as `frames.figures` says
    node_place: NDArray[np.int8]  # (S,) FLUID, INLET, OUTLET or WALL
    scale: float | None  # [N/m] of the coefficients; None where the scene has none
    model: dict[str, str]
    remarks: tuple[str, ...]  # what should be looked at
    seconds: float
    set_up: float  # [s] of the processor, before the first step
    factorisations: int = 0
    resumed: int = 0
    failure: str = ""

    def __repr__(self) -> str:
        end = self.failure or f"largest speed {np.linalg.norm(self.velocity[-1], axis=1).max():.4g} m/s"
        return f"FlowSolution({len(self.velocity) - 1} frames of {self.mesh}: {end})"

    def coefficients(self, name: str) -> Floats | None:
        """(T,) drag or lift over what the scene makes it a coefficient by."""
        return None if self.scale is None or name not in self.per_frame else self.per_frame[name] / self.scale


FLUID, INLET, OUTLET, WALL = range(4)


def solve_flow(scene: FlowScene, *, mesh: Mesh | None = None, on_step: Callable[[int], None] | None = None,
               journal: str | Path | None = None, partial: bool = False) -> FlowSolution:
    """The frames of a flow from rest, or its stationary flow.

    Args:
        mesh: to compute on, in place of the one that the scene's body describes
        on_step: called with the number of each frame that is reached
        journal: a file that keeps the frames as they come, to go on from after a kill; it is left for the caller to delete
        partial: give what was reached, and why no more in `failure`, in place of raising

    Raises:
        WorkError: the flow could not be followed, or no stationary one was found; another process has the journal open
        InputError: the scene does not fit its mesh, or the journal is of another scene
    """
    started, processor = time.perf_counter(), time.process_time()
    space = FlowSpace(mesh or computed_mesh(scene), scene.order)
    conditions = conditions_of(scene, space)
    forces = None if scene.force is None else Forces(scene, scene.force, space, conditions.open)
    where = stored(scene, space)
    rest = Memory(0.0, np.zeros((len(space.velocity.points), 2)), np.zeros(len(space.pressure.points)))
    rest.u[conditions.fixed] = conditions.values(0.0)
    stepper = Stepper(space, conditions, scene.fluid.viscosity / scene.fluid.density, rest)
    set_up = time.process_time() - processor

    def go(frame: int) -> dict[str, Any]:
        before = stepper.memory.steps
        if frame:
            _go_on(scene, stepper, frame)
        return {"velocity": where.velocity(stepper.memory.u), "pressure": where.pressure(stepper.memory.p, scene.fluid.density),
                **figures(stepper, forces, scene.fluid.density, stepper.memory.steps - before)}

    def recall(arrays: Arrays) -> None:
        stepper.memory = unflatten(Memory, arrays)

    way = follow(scene.steps.count, go, lambda: stepper.memory, recall, failures=(NoFlow, NoStationaryFlow), path=journal,
                 identity=f"flow {digest_of(scene.to_toml(), space.mesh.points, space.mesh.cells)}", started=started, on_step=on_step)
    failure = "" if way.failed is None else "frame {}: {}".format(*way.failed)
    rows = way.frames
    found = FlowSolution(
        mesh=where.mesh, velocity=rows.pop("velocity"), pressure=rows.pop("pressure"), per_frame=rows, set_up=set_up,
        node_place=_places(where, space, conditions, scene), scale=None if forces is None else forces.scale,
        model=_model(scene, space, rows), remarks=_remarks(scene, space, rows), factorisations=stepper.factorisations,
        seconds=way.seconds, resumed=way.resumed, failure=failure)
    if failure and not partial:
        raise WorkError(failure)
    return found


def _go_on(scene: FlowScene, stepper: Stepper, frame: int) -> None:
    """One frame further."""
    if scene.steps.stationary:
        found = stationary(stepper.space, stepper.conditions, stepper.viscosity)
        stepper.memory = Memory(0.0, found.u, found.p, steps=found.iterations)
        return
    assert scene.steps.duration is not None
    span = scene.steps.duration / scene.steps.count
    fastest = max((abs(inflow.speed) for inflow in scene.inflow), default=0.0)
    fastest = max([fastest, *(float(np.hypot(*wall.velocity)) for wall in scene.wall)])
    extent = float(np.ptp(stepper.space.mesh.points, axis=0).max())
    length = scene.force.length if scene.force is not None and scene.force.length else extent / 10
    advance(stepper, frame * span, blocks=max(1, min(10_000, math.ceil(span * TURNS * fastest / length / 3))))


def _places(where: Stored, space: FlowSpace, conditions: Conditions, scene: FlowScene) -> NDArray[np.int8]:
    """(S,) what each stored node is: walls count before inlets and outlets, corners too."""
    nodes = space.pressure if where.halved else None
    found = np.zeros(len(where.mesh.points), np.int8)

    def on(edges: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.unique(edges) if nodes is None else nodes.on_edges(space.mesh, edges)

    outer = space.mesh.boundary[0]
    inlet = [space.mesh.facets(inflow.where)[0] for inflow in scene.inflow]
    found[on(outer)] = WALL
    walls = np.ones(len(outer), bool)
    for edges in (conditions.open, *inlet):
        walls &= ~rows_in(outer, edges)
    for edges in inlet:
        found[on(edges)] = INLET
    found[on(conditions.open)] = OUTLET
    found[on(outer[walls])] = WALL
    return found


def _unresolved(rows: dict[str, Floats]) -> float:
    """The largest share of the velocity that only its highest order holds, past the start, over the fastest flow of all frames."""
    speed = np.sqrt(rows["kinetic_energy"] / max(float(rows["kinetic_energy"].max()), 1e-300))
    return float((rows["unresolved"] * speed)[len(speed) // 2:].max())


def _remarks(scene: FlowScene, space: FlowSpace, rows: dict[str, Floats]) -> tuple[str, ...]:
    """What a reader should not miss."""
    share = _unresolved(rows)
    if share <= RESOLVED[scene.order]:
        return space.mesh.remarks
    return (*space.mesh.remarks, f"the cells are too large for this flow: {share:.1%} of the velocity is in functions of order "
            f"{scene.order} alone, {RESOLVED[scene.order]:.0%} at most are fair; forces may be off by some per cent and more")


def _model(scene: FlowScene, space: FlowSpace, rows: dict[str, Floats]) -> dict[str, str]:
    """What was computed, what was left out, and when that is fair."""
    order, nodes = scene.order, len(space.velocity.points)
    said = {"elements": f"Taylor-Hood: velocity of order {order}, pressure of order {order - 1}, {2 * nodes} and "
                        f"{len(space.pressure.points)} unknowns on {len(space.mesh.cells)} triangles"
                        + (", curved sides" if space.mesh.middles else "")}
    if scene.steps.stationary:
        said["time"] = f"none: the stationary flow by Newton's method, {int(rows['iterations'].sum())} solves; it need not be stable"
    elif len(rows["step_size"]) > 1:
        sizes = rows["step_size"][1:]
        said["time"] = (f"backward differences of order 2, explicit convection, pressure correction: {int(rows['iterations'].sum())} steps "
                        f"of {sizes.min():.3g} to {sizes.max():.3g} s, as stability and error allow")
    force, kinematic, number = scene.force, scene.fluid.viscosity / scene.fluid.density, scene.reynolds_number
    if force is not None and number is not None:
        said["Reynolds number"] = f"{number:.4g} = speed {force.speed:.4g} m/s x length {force.length:.4g} m / {kinematic:.4g} m2/s"
        fair = "fair below about 190, where a cylinder's wake becomes three-dimensional" if number <= 190 else (
            "not fair: past about 190 a cylinder's wake is three-dimensional, and its forces are smaller than in the plane")
        said["two dimensions"] = f"{fair} (Williamson 1996)"
    share, most = _unresolved(rows), RESOLVED[order]
    said["resolution"] = (f"{share:.2%} of the velocity is in functions of order {order} alone, at most, past the start: "
                          + (f"fair up to {most:.0%}" if share <= most else f"not fair: past {most:.0%} the cells are too large"))
    said["fluid"] = "Newtonian and incompressible: fair below a tenth of the speed of sound; no turbulence model"
    return said
