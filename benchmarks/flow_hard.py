"""The hard cases of the flow solver, and what comes of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physics.flow.conditions import conditions_of
from physics.flow.frames import NoFlow, advance
from physics.flow.solution import FlowSolution, solve_flow
from physics.flow.space import FlowSpace
from physics.flow.stepping import Memory, Stepper
from physics.flow.stored import computed_mesh
from physics.scene import FlowScene, read_any

BODY = {"shape": "channel", "length": 1.6, "hole_centre": [0.3, 0.2], "hole_radius": 0.05, "cell_size": 0.025, "hole_cell_size": 0.008}


def flow(speed: float, frames: int = 60, body: dict[str, object] | None = None, **inflow: object) -> FlowScene:
    scene: FlowScene = read_any({
        "body": BODY | (body or {}), "fluid": {"density": 1.0, "viscosity": 1e-3}, "inflow": [{"speed": speed, **inflow}], "outflow": [{}],
        "steps": {"count": frames, "duration": 0.01 * frames}})
    return scene


def outcome(scene: FlowScene, found: FlowSolution | None = None) -> str:
    """What was reached, how fast the fluid is over the inflow, and the range of the drag in the second half."""
    found = found or solve_flow(scene, partial=True)
    if found.failure:
        return f"refused after {len(found.velocity) - 1} frames: {found.failure}"
    half = len(found.velocity) // 2
    fastest = float(np.linalg.norm(found.velocity, axis=2).max()) / max(abs(scene.inflow[0].speed), 1e-12)
    drag = found.coefficients("drag")
    assert drag is not None
    frames = len(found.velocity) - 1
    return (f"{frames} frames, {found.per_frame['iterations'].sum() / frames:.0f} steps a frame, fastest {fastest:.2f} of the inflow, "
            f"c_D {drag[half:].min():.3g} to {drag[half:].max():.3g}, divergence {found.per_frame['divergence'][1:].max():.1e} 1/s"
            + "".join(f"; said: {text.partition(':')[0]}" for text in found.remarks))


def finer(scene: FlowScene) -> str:
    """The same on cells of 0.7 of the size, and by how much the mean drag of the second half changes."""
    coarse = solve_flow(scene, partial=True)
    assert scene.body.cell_size is not None and scene.body.hole_cell_size is not None
    body = replace(scene.body, cell_size=0.7 * scene.body.cell_size, hole_cell_size=0.7 * scene.body.hole_cell_size)
    fine = solve_flow(replace(scene, body=body), partial=True)
    said = outcome(scene, coarse)
    if coarse.failure or fine.failure:
        return said
    means = [float(found.coefficients("drag")[len(found.velocity) // 2:].mean()) for found in (coarse, fine)]  # type: ignore[index]
    return f"{said}; on finer cells the mean drag changes by {means[1] / means[0] - 1:+.2%}"


def too_long() -> str:
    """Ten times the stable step, forced."""
    scene = flow(1.5)
    space = FlowSpace(computed_mesh(scene), 3)
    rest = Memory(0.0, np.zeros((len(space.velocity.points), 2)), np.zeros(len(space.pressure.points)))
    stepper = Stepper(space, conditions_of(scene, space), 1e-3, rest)
    for frame in range(1, 31):
        advance(stepper, 0.01 * frame)
    before = stepper.memory
    with np.errstate(all="ignore"):
        stepper.advance(0.4, max(1, round(0.1 / before.size / 10)))
    wild = float(np.nanmax(abs(stepper.memory.u))) / float(abs(before.u).max())
    stepper.memory = before
    try:
        advance(stepper, 0.4)
    except NoFlow as error:
        return f"refused: {error}"
    return f"forced by hand {wild:.1e} of the largest speed; `advance` takes {stepper.memory.steps - before.steps} steps instead"


def slivers() -> str:
    """The same flow on a mesh with ten cells pressed flat to 1 % of their height."""
    scene = flow(0.3)
    mesh = computed_mesh(scene)
    random, points = np.random.default_rng(0), mesh.points.copy()
    inside = np.setdiff1d(np.arange(len(points)), np.concatenate(list(mesh.places.values())))
    for cell in random.permutation(mesh.cells)[:200]:
        movable = np.intersect1d(cell, inside)
        if len(movable) == 3 and np.hypot(*(points[cell[0], :2] - (0.3, 0.2))) > 0.15:
            edge = points[cell[1:]].mean(axis=0)
            points[cell[0]] = edge + 0.03 * (points[cell[0]] - edge)
            inside = np.setdiff1d(inside, cell)
    bad = replace(mesh, points=points, middles={})
    a, b, c = (points[bad.cells[:, i], :2] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    if area.min() <= 0:
        bad = replace(bad, points=mesh.points)
    good = solve_flow(scene, mesh=replace(mesh, middles={}), partial=True)
    found = solve_flow(scene, mesh=bad, partial=True)
    if found.failure:
        return f"refused: {found.failure}"
    drags = [s.coefficients("drag")[-1] for s in (good, found)]  # type: ignore[index]
    return (f"{outcome(scene, found)}; the flattest cell has {area.min() / np.median(area):.1e} of the usual area; "
            f"c_D {drags[1] / drags[0] - 1:+.2%}")


CASES = {
    "Reynolds number 1000 in the channel: 15 m/s, ramp of 0.05 s": lambda: finer(flow(15.0, 20, ramp=0.05)),
    "blockage of 60 %": lambda: finer(flow(0.6, 80, {"hole_centre": [0.4, 0.205], "hole_radius": 0.123}, ramp=0.2)),
    "cylinder 0.02 m from a wall": lambda: finer(flow(1.25, 80, {"hole_centre": [0.3, 0.1], "hole_radius": 0.08})),
    "vortices through the outflow, 0.2 m behind the cylinder": lambda: finer(flow(1.5, 200, {"length": 0.55})),
    "inflow that reverses, period 1 s": lambda: finer(flow(1.0, 100, period=1.0)),
    "impulsive start at 2.25 m/s": lambda: finer(flow(2.25, 40)),
    "a mesh with slivers": slivers,
    "a step ten times too long": too_long,
}
