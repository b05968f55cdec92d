"""Time of one step of the equilibrium solver: ours against plain full Newton, its growth with the mesh, and where it goes.

    .venv/bin/python benchmarks/equilibrium.py            the press scene, ours and plain in turn, about two minutes
    .venv/bin/python benchmarks/equilibrium.py --growth   1.5 k to 15 k nodes

One process, one thread, the same BLAS for both. "Plain" assembles forces and tangent with dolfinx at every iteration, factors the
tangent anew with MUMPS, starts from the last state, takes whole steps and knows contact as a penalty (tests/plain_newton.py), a
thousand times softer than ours: with ours it would have to halve its steps and need many times as long.
Ratios are of medians of runs made in turn, so the machine's mood is in both.
"""

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np

from physics import equilibrium, newton
from physics.scene import Scene, Steps, read_scene
from tests import plain_newton
from tests.dolfinx_elasticity import DolfinxElasticity

PRESS = {
    "name": "press",
    "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [40, 5, 5]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
    "support": [{"where": "x-min", "fixed": "xyz"}],
    "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.08, 0.01, 0.03], [0.08, 0.01, 0.0]]},
    "steps": {"count": 400},
}


SOFTEN = 1000.0


def ours(scene: Scene) -> tuple[float, np.ndarray, equilibrium.Solution]:
    """Seconds, displacements and report of our solver, set-up included."""
    start = time.perf_counter()
    solution = equilibrium.solve(scene)
    if solution.failure:
        raise SystemExit(solution.failure)
    return time.perf_counter() - start, solution.displacement, solution


def plain(scene: Scene, steps: int) -> tuple[float, np.ndarray]:
    """Seconds and displacements of the first steps by plain full Newton with dolfinx's assembly."""
    start = time.perf_counter()
    u = plain_newton.solve(scene, tolerance=newton.TOLERANCE, elasticity=DolfinxElasticity, steps=steps, soften=SOFTEN, halve=False)
    return time.perf_counter() - start, u


def versus(repeats: int, steps: int) -> dict:
    scene = read_scene(PRESS)
    ours(replace(scene, steps=Steps(count=4))), plain(scene, 1)  # compile
    times = []
    for _ in range(repeats):
        a, u, solution = ours(scene)
        b, v = plain(scene, steps)
        times.append((1e3 * a / 400, 1e3 * b / steps))
    mine, other = np.median(times, axis=0)
    difference = abs(u[:steps + 1] - v).max() / abs(v).max()
    return {"nodes": len(solution.mesh.points), "ours_ms_per_step": mine, "plain_ms_per_step": other, "ratio": other / mine,
            "largest_difference": difference, "newton_steps": int(solution.newton_iterations.sum()),
            "factorisations": solution.factorisations, "largest_relative_residual": solution.relative_residual.max(),
            "largest_penetration_m": solution.penetration.max()}


def growth() -> list[dict]:
    rows = []
    for cells in ((40, 5, 5), (60, 8, 8), (90, 12, 12)):
        scene = read_scene({**PRESS, "body": {**PRESS["body"], "cells": list(cells)}, "steps": {"count": 100}})
        seconds, _, solution = ours(scene)
        rows.append({"nodes": len(solution.mesh.points), "ms_per_step": 10 * seconds,
                     "newton_steps": int(solution.newton_iterations.sum()), "factorisations": solution.factorisations,
                     "factor": solution.model["factor"]})
    slope = np.polyfit(np.log([r["nodes"] for r in rows]), np.log([r["ms_per_step"] for r in rows]), 1)[0]
    return [*rows, {"exponent": slope}]


def parts() -> dict:
    """Milliseconds of each part on the press scene at its last state."""
    scene = read_scene(PRESS)
    u = ours(replace(scene, steps=Steps(count=100)))[1][-1]
    path = equilibrium.Path(scene, equilibrium.build_mesh(scene.body))
    path.newton.factor.update(u)
    slow, force = DolfinxElasticity(path.balance.elasticity), path.balance.elasticity.force(u)
    work = {"force": lambda: path.balance.elasticity.force(u), "force, dolfinx": lambda: slow.force(u),
            "energy": lambda: path.balance.elasticity.energy(u), "stiffness and factor": lambda: path.newton.factor.update(u),
            "stiffness, dolfinx": lambda: slow.stiffness(u), "solve": lambda: path.newton.factor.solve(force)}
    found = {}
    for name, run in work.items():
        laps = []
        for _ in range(30):
            start = time.perf_counter()
            run()
            laps.append(time.perf_counter() - start)
        found[f"{name} [ms]"] = 1e3 * float(np.median(laps))
    factor = np.empty(force.size * (path.newton.factor.band + 1))
    start = time.perf_counter()
    for _ in range(20):
        factor.sum()
    reading = (time.perf_counter() - start) / 20
    return {**found, "floor of a solve: reading the factor twice [ms]": 2e3 * reading, "factor [MB]": factor.nbytes / 1e6}


if __name__ == "__main__":
    options = argparse.ArgumentParser()
    options.add_argument("--growth", action="store_true")
    options.add_argument("--repeats", type=int, default=3)
    options.add_argument("--plain-steps", type=int, default=60, help="steps of the plain method (it is slow)")
    chosen = options.parse_args()
    result = growth() if chosen.growth else {**versus(chosen.repeats, chosen.plain_steps), **parts()}
    print(json.dumps(result, indent=1))
