"""The flow solver against known values, and how fast it is: the tables in docs/flow.md.

    .venv/bin/python -m benchmarks.flow --verify    known values and orders, some four minutes of processor time
    .venv/bin/python -m benchmarks.flow             what a frame of 0.01 s costs
    .venv/bin/python -m benchmarks.flow --ngsolve PYTHON   the same flow by NGSolve, whose interpreter that is, in the same run
    .venv/bin/python -m benchmarks.flow --ipcs      2D-3 beside the scheme of dolfinx's tutorial, in the same run
    .venv/bin/python -m benchmarks.flow --parts     what a step is made of, beside the bytes of its factors
    .venv/bin/python -m benchmarks.flow --growth    with the number of nodes
    .venv/bin/python -m benchmarks.flow --hard      the hard cases
    .venv/bin/python -m benchmarks.flow --courant   the largest stable step

Schäfer and Turek's flows around a cylinder (1996), with the values of Nabh (2D-1, 1998), FeatFlow's finest series (2D-2) and John (2D-3,
Int. J. Numer. Methods Fluids 44, 2004); extremes are those of parabolas through three frames. The lid-driven cavity is Botella and Peyret's
(1998).
"""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import footing
from benchmarks.flow_hard import CASES
from benchmarks.flow_ipcs import tutorial
from physics.flow.conditions import conditions_of
from physics.flow.frames import COURANT, advance
from physics.flow.solution import FlowSolution, solve_flow
from physics.flow.space import FlowSpace
from physics.flow.stationary import stationary
from physics.flow.stepping import Memory, Stepper
from physics.flow.stored import computed_mesh
from physics.scene import FlowScene, load_scene, read_any
from tests import flows
from tests.test_physics_flow_stationary import LAMBDA, RE, kovasznay

DFG = {"length": 2.2, "height": 0.41, "hole_centre": [0.2, 0.2], "hole_radius": 0.05}
U_MIDDLE = {0.0547: -.1812881, 0.0703: -.2228955, 0.1016: -.3004561, 0.1719: -.3885691, 0.2813: -.2803696, 0.4531: -.1081999,
            0.5: -.0620561, 0.6172: .0570178, 0.7344: .1886747, 0.8516: .3372212, 0.9531: .4723329, 0.9688: .5808359, 0.9766: .6644227}


def cylinder(cell_size: float, hole_cell_size: float, frames: int, duration: float, order: int = 3, **inflow: float) -> FlowScene:
    """The channel of the benchmark with an inflow of at most 1.5 m/s."""
    scene: FlowScene = read_any({
        "body": {"shape": "channel", "cell_size": cell_size, "hole_cell_size": hole_cell_size, **DFG},
        "fluid": {"density": 1.0, "viscosity": 1e-3, "order": order}, "inflow": [{"speed": 1.5, **inflow}], "outflow": [{}],
        "steps": {"count": frames, "duration": duration}})
    return scene


def peak(times: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """When the largest value is reached, and what it is, by a parabola."""
    i = int(np.clip(np.argmax(values), 1, len(values) - 2))
    a, b, c = np.polyfit(times[i - 1:i + 2] - times[i], values[i - 1:i + 2], 2)
    return float(times[i] - b / (2 * a)), float(c - b**2 / (4 * a))


def peaks(times: np.ndarray, values: np.ndarray) -> list[tuple[float, float]]:
    """All that are larger than both neighbours."""
    inside = 1 + np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:]))
    return [peak(times[i - 1:i + 2], values[i - 1:i + 2]) for i in inside]


class Verified(footing.Table):
    """A table of values against known ones."""

    def hold(self, case: str, what: str, found: float, known: float, limit: float) -> None:
        """limit: of the relative error"""
        error = found / known - 1
        self.add({"case": case, "what": what, "found": f"{found:.8g}", "known": f"{known:.8g}", "error": f"{error:+.3%}",
                  "limit": f"{limit:.2%}", "holds": "yes" if abs(error) <= limit else "**no**"})

    def least(self, case: str, what: str, found: float, known: float) -> None:
        self.add({"case": case, "what": what, "found": f"{found:.3g}", "known": f"{known:g}", "error": "–", "limit": "at least",
                  "holds": "yes" if found >= known else "**no**"})


def verify() -> None:
    table = Verified()
    found = solve_flow(load_scene(footing.ROOT / "examples" / "dfg_2d_1.toml"))
    for what, value, known in (("c_D", found.coefficients("drag"), 5.57953523384), ("c_L", found.coefficients("lift"), 0.010618948146),
                               ("dp [Pa]", found.per_frame["pressure_difference"], 0.11752016697)):
        table.hold("2D-1, examples/dfg_2d_1.toml", what, float(value[-1]), known, 5e-4)  # type: ignore[index]
    periodic(table)
    swelling(table)
    vortex(table)
    stationary_orders(table)
    cavity(table)


def periodic(table: Verified) -> None:
    """2D-2, the last second of seven."""
    found = solve_flow(cylinder(0.02, 0.006, 1400, 7.0, ramp=0.5))
    times = np.linspace(0, 7, 1401)
    late = times >= 5.8
    drag, lift = (found.coefficients(name)[late] for name in ("drag", "lift"))  # type: ignore[index]
    tops = peaks(times[late], lift)
    pressure = np.interp([t for t, _ in tops], times, found.per_frame["pressure_difference"])
    case = f"2D-2, {len(found.mesh.points)} nodes"
    table.hold(case, "c_D, largest", max(v for _, v in peaks(times[late], drag)), 3.22739, 3e-3)
    table.hold(case, "c_L, largest", float(np.mean([v for _, v in tops])), 0.98658, 5e-3)
    table.hold(case, "period [s]", float(np.diff([t for t, _ in tops]).mean()), 0.33130, 5e-3)
    table.hold(case, "dp at the largest c_L [Pa]", float(pressure.mean()), 2.4829, 5e-3)


def swelling(table: Verified) -> None:
    """2D-3."""
    found = solve_flow(cylinder(0.02, 0.006, 800, 8.0, period=16.0))
    case, times = f"2D-3, {len(found.mesh.points)} nodes", np.linspace(0, 8, 801)
    drag, lift = (peak(times, found.coefficients(name)) for name in ("drag", "lift"))  # type: ignore[arg-type]
    table.hold(case, "c_D, largest", drag[1], 2.950921575, 3e-3)
    table.hold(case, "c_L, largest", lift[1], 0.47795, 2e-2)
    table.hold(case, "when c_L is largest [s]", lift[0], 5.693125, 5e-3)
    table.hold(case, "dp at 8 s [Pa]", float(found.per_frame["pressure_difference"][-1]), -0.1116, 1e-2)


def vortex(table: Verified) -> None:
    """Orders of Taylor and Green's vortex, and of what splits the splitting from the coupled scheme."""
    velocity, pressure = flows.vortex(0.2)
    for order in (2, 3):
        errors = []
        for n in (7, 14):
            space = FlowSpace(flows.rectangle(n, (-1, -1), (1, 1), seed=1), order)
            stepper = flows.started(space, flows.given_all_around(space, velocity), 0.2, velocity, pressure)
            stepper.advance(0.1, 160)
            errors.append((flows.norm(space, stepper.memory.u - velocity(space.velocity.points, 0.1)),
                           float(np.std(stepper.memory.p - pressure(space.pressure.points, 0.1)))))
        for what, a, b, least in (("velocity", *np.array(errors)[:, 0], order + 0.5), ("pressure", *np.array(errors)[:, 1], order - 0.5)):
            table.least(f"Taylor-Green, velocity of order {order}", f"order in space of the {what}", float(np.log2(a / b)), least)
    velocity, pressure = flows.vortex(0.02)
    space = FlowSpace(flows.rectangle(5, (-1, -1), (1, 1), seed=1), 3)
    conditions, states, gaps = flows.given_all_around(space, velocity), [], []
    for steps in (40, 80, 640):
        stepper = flows.started(space, conditions, 0.02, velocity, pressure)
        stepper.advance(0.5, steps)
        states.append(stepper.memory)
        if steps < 100:
            coupled = flows.Coupled(space, conditions, 0.02, velocity(space.velocity.points, 0.0))
            for _ in range(steps):
                coupled.step(0.5 / steps)
            gaps.append(flows.norm(space, coupled.u - stepper.memory.u))
    for what, (a, b) in (("velocity", (flows.norm(space, s.u - states[2].u) for s in states[:2])),
                         ("pressure", (float(np.std(s.p - states[2].p)) for s in states[:2])), ("gap to the coupled scheme", gaps)):
        table.least("Taylor-Green", f"order in time of the {what}", float(np.log2(a / b)), 1.8)


def stationary_orders(table: Verified) -> None:
    for order in (2, 3):
        errors = []
        for n in (8, 16):
            space = FlowSpace(flows.rectangle(n, (-0.5, -0.5), (1.0, 0.5)), order)
            found = stationary(space, flows.given_all_around(space, kovasznay), 1 / RE)
            errors.append((flows.norm(space, found.u - kovasznay(space.velocity.points, 0)),
                           float(np.std(found.p + np.exp(2 * LAMBDA * space.pressure.points[:, 0]) / 2))))
        for what, a, b, least in (("velocity", *np.array(errors)[:, 0], order + 0.5), ("pressure", *np.array(errors)[:, 1], order - 0.5)):
            table.least(f"Kovasznay, velocity of order {order}", f"order in space of the {what}", float(np.log2(a / b)), least)


def cavity(table: Verified) -> None:
    """On 32 x 32 squares in halves, moved towards the walls."""
    scene = read_any({"body": {"shape": "plate", "length": 1.0, "width": 1.0, "cells": [64, 64]}, "steps": {"stationary": True},
                      "fluid": {"density": 1.0, "viscosity": 1e-3}, "wall": [{"where": "y-max", "velocity": [1.0, 0.0]}]})
    mesh = computed_mesh(scene)
    mesh.points[:, :2] = (1 - np.cos(np.pi * mesh.points[:, :2])) / 2
    space = FlowSpace(mesh, 3)
    found = stationary(space, conditions_of(scene, space), 1e-3)
    nodes = space.velocity.points

    def line(axis: int, component: int) -> tuple[np.ndarray, np.ndarray]:
        on = np.flatnonzero(abs(nodes[:, axis] - 0.5) < 1e-9)
        on = on[np.argsort(nodes[on, 1 - axis])]
        return nodes[on, 1 - axis], found.u[on, component]

    y, u = line(0, 0)
    x, v = line(1, 1)
    case = f"lid-driven cavity, Reynolds number 1000, {len(nodes)} velocity nodes"
    table.hold(case, "u, least on x = 1/2", -peak(y, -u)[1], -0.3885698, 1e-3)
    table.hold(case, "v, largest on y = 1/2", peak(x, v)[1], 0.3769447, 1e-3)
    table.hold(case, "v, least on y = 1/2", -peak(x, -v)[1], -0.5270771, 1e-3)
    from scipy.interpolate import CubicSpline

    off = max(abs(CubicSpline(y, u)(at) - known) for at, known in U_MIDDLE.items())
    table.add({"case": case, "what": f"u at {len(U_MIDDLE)} places of x = 1/2: largest error, of the lid's speed", "found": f"{off:.2e}",
               "known": "0", "error": "–", "limit": "1.0e-03", "holds": "yes" if off <= 1e-3 else "**no**"})


def speed(python: str | None) -> None:
    """2D-3 at about 1900 nodes, and a flow from the middle of a data set's draws."""
    table = footing.Table()
    times = np.linspace(0, 8, 801)
    ours: dict[str, Any] = {}
    for name, scene in (("2D-3", cylinder(0.0265, 0.009, 800, 8.0, period=16.0)), ("inflow of 1.25 m/s, 6 s", middle())):
        seconds, found = footing.cost(solve_flow, scene)
        row = row_of(name, found, seconds)
        if name == "2D-3":
            row |= {f"{what}, largest": f"{peak(times, found.coefficients(key))[1] / known - 1:+.2%}"  # type: ignore[arg-type]
                    for what, key, known in (("c_D", "drag", 2.950921575), ("c_L", "lift", 0.47795))}
            ours = row
        table.add(row)
    rivals = {"IMEX, order 2": ["2", "0.0245", "0.0075", "6.6667e-4"], "IMEX, order 3": ["3", "0.045", "0.015", "8e-4"]}
    for program, settings in rivals.items():
        if python:
            script = str(Path(__file__).with_name("flow_ngsolve.py"))
            done = subprocess.run([python, script, *settings], stdout=subprocess.PIPE, text=True, check=True)
            said = json.loads(done.stdout.splitlines()[-1])
            table.add({"flow": f"2D-3, NGSolve {program}", "nodes": said["vertices"], "cells": said["cells"],
                       "steps a frame": said["steps"],
                       "ms a frame": said["ms"], "ms a step": said["ms"] / said["steps"],
                       "c_D, largest": f"{said['drag'] / 2.950921575 - 1:+.2%}",
                       "c_L, largest": f"{said['lift'] / 0.47795 - 1:+.2%}"})
            footing.say(f"NGSolve {program}: {said['ms'] / ours['ms a frame']:.1f} times the time of ours")


def ipcs() -> None:
    """The first seconds of 2D-3, ours and dolfinx's tutorial's, whose first 200 steps stand for it."""
    table, scene = footing.Table(), cylinder(0.0265, 0.009, 800, 8.0, period=16.0)
    seconds, found = footing.cost(solve_flow, replace(scene, steps=replace(scene.steps, count=200, duration=2.0)))
    table.add(row_of("2D-3, the first 2 s", found, seconds))
    said = tutorial(found.mesh, 200)
    table.add({"flow": "2D-3, dolfinx's tutorial (IPCS), its first 200 steps", "nodes": said["vertices"], "cells": said["cells"],
               "steps a frame": said["steps"], "ms a frame": said["ms"], "ms a step": said["ms"] / said["steps"]})
    footing.say(f"the tutorial: {said['ms'] / (1e3 * seconds / 200):.1f} times the time of ours")


def row_of(name: str, found: FlowSolution, seconds: float) -> dict[str, Any]:
    frames = len(found.velocity) - 1
    steps = float(found.per_frame["iterations"].sum())
    return {"flow": name, "nodes": len(found.mesh.points), "cells": len(found.mesh.cells) // 4, "steps a frame": steps / frames,
            "ms a frame": 1e3 * seconds / frames, "ms a step": 1e3 * (seconds - found.set_up) / steps, "set-up [s]": found.set_up}


def middle() -> FlowScene:
    """The middle of the data set's draws: radius, place and speed."""
    scene: FlowScene = read_any({
        "body": {"shape": "channel", "length": 1.6, "hole_centre": [0.325, 0.2], "hole_radius": 0.05, "cell_size": 0.023,
                 "hole_cell_size": 0.0075},
        "fluid": {"density": 1.0, "viscosity": 1e-3}, "inflow": [{"speed": 1.25}], "outflow": [{}],
        "steps": {"count": 600, "duration": 6.0}})
    return scene


def ready(scene: FlowScene, frames: int = 20) -> Stepper:
    """A flow some frames on."""
    space = FlowSpace(computed_mesh(scene), scene.order)
    rest = Memory(0.0, np.zeros((len(space.velocity.points), 2)), np.zeros(len(space.pressure.points)))
    stepper = Stepper(space, conditions_of(scene, space), scene.fluid.viscosity / scene.fluid.density, rest)
    for frame in range(1, frames + 1):
        advance(stepper, 0.01 * frame)
    return stepper


def parts() -> None:
    """What a step is made of, the fastest of many, beside the time that the bytes of its factors take from memory."""
    stepper = ready(cylinder(0.0265, 0.009, 800, 8.0, ramp=0.1))
    space, m = stepper.space, stepper.memory
    factor = stepper.factor(1.5 / m.size)
    table = footing.Table()
    big = np.ones(4_000_000)
    speed = big.nbytes / footing.least(lambda: big.sum(), 9)
    for name, run, size in (
            ("momentum, all terms", lambda: space.momentum(m.u, m.u, m.p), 0), ("divergence", lambda: space.divergence(m.u), 0),
            ("velocity, both components", lambda: factor.solve(m.u), factor.bytes),
            ("pressure's Laplacian", lambda: stepper._laplacian.solve(m.p), stepper._laplacian.bytes),
            ("pressure's mass", lambda: stepper.pressure_mass.solve(m.p), stepper.pressure_mass.bytes),
            ("a whole step", lambda: stepper._step(m.time + m.size, m.size), stepper.bytes)):
        table.add({"part": name, "ms": 1e3 * footing.least(run, 200), "MB of factors": size / 1e6 if size else None,
                   "ms to read them twice": 2e3 * size / speed if size else None})


def growth() -> None:
    table = footing.Table()
    for size in (0.027, 0.0135, 0.00675, 0.0045):
        stepper = ready(cylinder(size, size / 3, 1, 1.0, ramp=0.1), 1)
        m, nodes = stepper.memory, len(stepper.space.pressure.points)
        blocks = stepper.space.mass + stepper.space.viscosity
        table.add({"nodes": nodes, "velocity unknowns": 2 * len(stepper.space.velocity.points),
                   "ms a step": 1e3 * footing.median(lambda s=stepper, m=m: s._step(m.time + m.size, m.size), 15),
                   "s to factor": footing.least(lambda s=stepper, b=blocks: s._numbering.factor(b), 2),
                   "MB of factors": stepper.bytes / 1e6, "MB at most": footing.peak_memory()})
    table.fit("ms a step", "s to factor", "MB of factors")


def courant() -> None:
    """The largest dt times rate at which half a second is stable, and the smallest that is not, by steps a frame."""
    table = footing.Table()
    for order, size, hole in ((3, 0.027, 0.00925), (3, 0.025, 0.011), (2, 0.0265, 0.0085)):
        stepper = ready(cylinder(size, hole, 1, 1.0, order, ramp=0.3), 80)
        base, energy, stable = stepper.memory, stepper.energy(), 0.0
        for steps in range(20, 5, -1):
            stepper.memory, largest = base, stepper.space.rate(base.u)
            with np.errstate(all="ignore"):
                for frame in range(81, 131):
                    stepper.advance(0.01 * frame, steps)
                    if not stepper.energy() < 2 * energy:
                        break
                    largest = max(largest, stepper.space.rate(stepper.memory.u))
            if not stepper.energy() < 2 * energy:
                break
            stable = 0.01 / steps * largest
        table.add({"order": order, "cells": len(stepper.space.mesh.cells), "largest stable": stable, "unstable": 0.01 / steps * largest,
                   "limit in use": COURANT[order]})


def hard() -> None:
    table = footing.Table()
    for name, run in CASES.items():
        table.add({"case": name, "outcome": run()})


def main() -> None:
    parser = footing.parser(__doc__)
    for flag in ("--verify", "--ipcs", "--parts", "--growth", "--hard", "--courant"):
        parser.add_argument(flag, action="store_true")
    parser.add_argument("--ngsolve", metavar="PYTHON")
    options = parser.parse_args()
    for name, run in (("verify", verify), ("ipcs", ipcs), ("parts", parts), ("growth", growth), ("hard", hard), ("courant", courant)):
        if getattr(options, name):
            run()
            return
    speed(options.ngsolve)


if __name__ == "__main__":
    main()
