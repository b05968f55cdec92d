"""Time of one step of the equilibrium solver: ours against plain full Newton, its growth with the mesh, and where it goes.

    .venv/bin/python benchmarks/equilibrium.py                     the press scene, ours and plain in turn; parts and floor
    .venv/bin/python benchmarks/equilibrium.py --growth            1.5 k to 15 k nodes
    .venv/bin/python benchmarks/equilibrium.py --growth --large    60 k nodes as well

One process, one thread, the same BLAS for both. "Plain" is full Newton as a good program does it: forces and tangent assembled by
dolfinx at every iteration, forms compiled with -O3 -march=native, every tangent factored by MUMPS's LDL^T in one matrix whose sparsity
and symbolic factorisation are kept, from the last state, in whole steps. It knows contact as a penalty, a thousand times softer than
ours: with ours it would have to halve its steps and need many times as long. Times are those of the processor (a shared machine's clock
says nothing); ratios are of medians of runs made in turn. Growth takes the first steps of the same 400 at every size, after the
obstacle has touched, without setting up.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np
from petsc4py import PETSc

from physics.equilibrium import newton
from physics.equilibrium.balance import Balance
from physics.equilibrium.path import LoadPath
from physics.mesh.build import build_mesh
from physics.scene import Scene, Steps, read_scene
from physics.solution import Solution, solve
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


def ours(scene: Scene) -> tuple[float, np.ndarray, Solution]:
    """Seconds, displacements and report of our solver, set-up included."""
    start = time.process_time()
    solution = solve(scene, partial=True)
    if solution.failure:
        raise SystemExit(solution.failure)
    return time.process_time() - start, solution.displacement, solution


def plain(scene: Scene, steps: int) -> tuple[float, np.ndarray, int]:
    """Seconds, displacements and iterations of the first steps by plain full Newton with dolfinx's assembly."""
    start = time.process_time()
    balance = Balance(scene, build_mesh(scene.body))
    body, contact = DolfinxElasticity(balance.elasticity), balance.contact
    softness, dofs, free = SOFTEN * contact.softness, body.space.dofs, ~balance.fixed
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    u, frames, taken = np.zeros_like(balance.mesh.points), [np.zeros_like(balance.mesh.points)], 0
    vectors = None
    for step in range(1, steps + 1):
        centre = contact.obstacle.position(step / scene.steps.count)
        for _ in range(60):
            gap, normal = contact.gaps(u, centre)
            pressed = np.flatnonzero(gap < 0)
            pressure = -gap[pressed] / softness[pressed]
            weights = contact.surface.weights[pressed]
            out = body.force(u) - weights.T @ (pressure[:, None] * normal[pressed])
            scale = np.linalg.norm(pressure @ normal[pressed])
            if np.linalg.norm(out[free]) <= max(newton.TOLERANCE * scale, balance.floor):
                break
            matrix = body.stiffness(u)
            if len(pressed):
                nodes = np.unique(weights.indices)
                rows = (weights[:, nodes].toarray()[:, :, None] * normal[pressed][:, None, :]).reshape(len(pressed), -1)
                matrix.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
                at = dofs[nodes].ravel().astype(np.int32)
                matrix.setValues(at, at, rows.T @ (rows / softness[pressed, None]), addv=PETSc.InsertMode.ADD)
                matrix.assemble()
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
            pc.setOperators(matrix)
            vectors = vectors or matrix.createVecs()
            vectors[0].array[:] = body.space.to_dofs(np.where(free, -out, 0.0))
            pc.apply(*vectors)
            u, taken = u + body.space.from_dofs(vectors[1].array), taken + 1
        else:
            raise SystemExit(f"plain Newton found no equilibrium at step {step}")
        frames.append(u)
    return time.process_time() - start, np.array(frames), taken


def versus(repeats: int, steps: int) -> dict:
    scene = read_scene(PRESS)
    ours(replace(scene, steps=Steps(count=4))), plain(scene, 1)  # compile
    times = []
    for _ in range(repeats):
        a, u, solution = ours(scene)
        b, v, taken = plain(scene, steps)
        times.append((1e3 * a / 400, 1e3 * b / steps))
    mine, other = np.median(times, axis=0)
    return {"nodes": len(solution.mesh.points), "ours_ms_per_step": mine, "plain_ms_per_step": other, "ratio": other / mine,
            "largest_difference": abs(u[:steps + 1] - v).max() / abs(v).max(), "newton_steps": int(solution.newton_iterations.sum()),
            "factorisations": solution.factorisations, "plain_newton_steps_per_step": taken / steps,
            "largest_relative_residual": solution.relative_residual.max(), "largest_penetration_m": solution.penetration.max()}


def growth(sizes: list[tuple[tuple[int, int, int], int]]) -> list[dict]:
    """Each size in a process of its own, whose peak memory is then its own as well."""
    rows = []
    for cells, steps in sizes:
        command = [sys.executable, __file__, "--size", *map(str, cells), "--steps", str(steps)]
        rows.append(json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout))
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    nodes = np.log([row["nodes"] for row in rows])
    return [*rows, {f"exponent of {name}": np.polyfit(nodes, np.log([row[name] for row in rows]), 1)[0]
                    for name in ("ms_per_step", "peak_MB")}]


def one_size(cells: list[int], steps: int) -> dict:
    """The first steps of the press scene's 400 on another mesh; the first touches."""
    scene = read_scene({**PRESS, "body": {**PRESS["body"], "cells": cells}})
    path = LoadPath(scene, build_mesh(scene.body))
    start, taken = time.process_time(), 0
    for step in range(1, steps + 1):
        taken += path.advance(step / 400).iterations
    seconds = time.process_time() - start
    return {"nodes": len(path.balance.mesh.points), "steps": steps, "ms_per_step": 1e3 * seconds / steps, "newton_steps": taken,
            "factorisations": path.newton.factorisations, "factor": path.newton.tangent.solver.name,
            "peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def parts() -> dict:
    """Milliseconds of each part on the press scene at its last state, how often a step needs it, and the machine's floor."""
    scene = read_scene(PRESS)
    mesh = build_mesh(scene.body)
    path, spent = LoadPath(scene, mesh), {}

    def watched(owner, name: str, label: str) -> None:
        run = getattr(owner, name)

        def timed(*arguments, **named):
            start = time.process_time()
            try:
                return run(*arguments, **named)
            finally:
                spent[label] = spent.get(label, 0.0) + time.process_time() - start

        setattr(owner, name, timed)

    factor, body = path.newton.tangent.solver, path.balance.elasticity
    watched(body, "force", "forces")
    watched(body, "add_stiffness", "stiffness")
    watched(factor, "update", "stiffness and factor")
    for name in ("begin", "finish"):
        watched(factor, name, "solution")
    watched(path.newton.tangent, "_condense", "contact")
    watched(path.newton, "_touch", "contact")
    start = time.process_time()
    for step in range(1, 401):
        path.advance(step / 400)
    total = time.process_time() - start
    shares = {label: 2.5 * seconds for label, seconds in spent.items()}
    shares["factor"] = shares.pop("stiffness and factor") - shares["stiffness"]
    shares["rest"] = 2.5 * total - sum(shares.values())
    u = path.states[-1].u
    slow, force = DolfinxElasticity(body), body.force(u)
    work = {"forces": lambda: body.force(u), "forces, dolfinx": lambda: slow.force(u), "stiffness, dolfinx": lambda: slow.stiffness(u),
            "stiffness and factor": lambda: factor.update(u), "solution": lambda: factor.solve(force)}
    return {"ms_per_step": {name: round(value, 3) for name, value in shares.items()},
            "ms_each": {name: round(1e3 * median(run), 3) for name, run in work.items()}, "floor": floor(factor, len(mesh.cells))}


def floor(factor, cells: int) -> dict:
    """Bytes and operations of one solution and one factorisation, and what this core makes of such work at best."""
    unknowns = factor.elasticity.mesh.points.size
    matrix, square, large = np.empty(unknowns * (factor.band + 1)), np.random.default_rng(0).random((1500, 1500)), np.ones(2**25)
    peak, near = 2 * 1500**3 / median(lambda: square @ square, 5), matrix.nbytes / median(matrix.sum)
    far = large.nbytes / median(large.sum, 5)
    # 54 multiply-adds for each of 6 points of a prism give F, as many give the forces, and the law's stress takes about 150 operations.
    force_operations, force_bytes = cells * 6 * (4 * 54 + 150), cells * 6 * 19 * 8 + 3 * 8 * unknowns
    return {"matrix product [Gflop/s]": peak / 1e9, "reading the factor [GB/s]": near / 1e9, "reading far memory [GB/s]": far / 1e9,
            "forces [Mflop]": force_operations / 1e6, "forces [MB]": force_bytes / 1e6,
            "forces at best [ms]": 1e3 * max(force_operations / peak, force_bytes / far),
            "solution [MB]": 2 * matrix.nbytes / 1e6, "solution at best [ms]": 2e3 * matrix.nbytes / near,
            "factorisation [Mflop]": unknowns * factor.band**2 / 1e6, "factorisation at best [ms]": 1e3 * unknowns * factor.band**2 / peak}


def median(run, laps: int = 30) -> float:
    """Seconds of the processor."""
    found = []
    for _ in range(laps):
        start = time.process_time()
        run()
        found.append(time.process_time() - start)
    return float(np.median(found))


if __name__ == "__main__":
    options = argparse.ArgumentParser()
    options.add_argument("--growth", action="store_true")
    options.add_argument("--large", action="store_true", help="60 k nodes as well")
    options.add_argument("--size", type=int, nargs=3, help="one mesh alone")
    options.add_argument("--steps", type=int, default=100, help="of --size")
    options.add_argument("--repeats", type=int, default=3)
    options.add_argument("--plain-steps", type=int, default=60, help="steps of the plain method (it is slow)")
    chosen = options.parse_args()
    if chosen.size:
        result = one_size(chosen.size, chosen.steps)
    elif chosen.growth:
        result = growth([((40, 5, 5), 100), ((58, 8, 8), 100), ((90, 12, 12), 60), *([((143, 19, 19), 40)] if chosen.large else [])])
    else:
        result = {**versus(chosen.repeats, chosen.plain_steps), **parts()}
    print(json.dumps(result, indent=None if chosen.size else 1))
