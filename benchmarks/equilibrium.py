"""Time of one step of the equilibrium solver: ours against plain full Newton, where it goes, and its growth with the mesh.

    .venv/bin/python -m benchmarks.equilibrium                     the press scene, ours and plain in turn
    .venv/bin/python -m benchmarks.equilibrium --second            the same in hexahedra of 27 nodes, 2025 nodes, both
    .venv/bin/python -m benchmarks.equilibrium --parts             each part of a step, and the machine's floor
    .venv/bin/python -m benchmarks.equilibrium --growth            1.5 k to 15 k nodes, on one thread and on two
    .venv/bin/python -m benchmarks.equilibrium --growth --large    60 k nodes as well

One process, one thread, the same BLAS for both. "Plain" is full Newton as a good program does it: forces and tangent assembled by
dolfinx at every iteration, forms compiled with -O3 -march=native, every tangent factored by MUMPS's LDL^T in one matrix whose sparsity
and symbolic factorisation are kept, from the last state, in whole steps. It knows contact as a penalty, a thousand times softer than
ours: with ours it would have to halve its steps and need many times as long. Ratios are of medians of runs made in turn, set-up
included. Growth takes the same 400 steps at every size, without setting up; two threads are held against one by the clock, which says
something only where nothing else runs.
"""

import os
import time
from collections import defaultdict
from dataclasses import replace
from hashlib import sha256

import numpy as np
from petsc4py import PETSc

from benchmarks import footing
from benchmarks.footing import cost, median, press
from physics.equilibrium import newton
from physics.equilibrium.balance import Balance
from physics.equilibrium.path import LoadPath
from physics.mesh.build import build_mesh
from physics.scene import Scene, Steps
from physics.solution import Solution, solve
from tests.dolfinx_elasticity import DolfinxElasticity

SOFTEN = 1000.0
SIZES, STEPS = [(40, 5, 5), (58, 8, 8), (90, 12, 12), (143, 19, 19)], 400


def ours(scene: Scene) -> Solution:
    solution = solve(scene, partial=True)
    if solution.failure:
        raise SystemExit(solution.failure)
    return solution


def plain(scene: Scene, steps: int) -> tuple[np.ndarray, int]:
    """Displacements and iterations of the first steps by plain full Newton with dolfinx's assembly."""
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
    return np.array(frames), taken


def versus(table: footing.Table, scene: Scene, repeats: int, steps: int) -> None:
    ours(replace(scene, steps=Steps(count=4))), plain(scene, 1)  # compile
    times = []
    for _ in range(repeats):
        a, solution = cost(ours, scene)
        b, (frames, taken) = cost(plain, scene, steps)
        times.append((1e3 * a / 400, 1e3 * b / steps))
    mine, other = np.median(times, axis=0)
    far = abs(solution.displacement[:steps + 1] - frames).max() / abs(frames).max()
    footing.say(f"displacements differ by {far:.0e} of the largest; largest residual {solution.relative_residual.max():.0e} of the "
                f"reaction, largest penetration {solution.penetration.max():.0e} m")
    for name, ms, iterations, made in (("this one", mine, solution.newton_iterations.sum() / 400, solution.factorisations / 400),
                                       ("plain full Newton", other, taken / steps, taken / steps)):
        table.add({"solver": name, "ms a step": float(ms), "times as long": f"{ms / mine:.1f}", "Newton steps a step": float(iterations),
                   "factorisations a step": made})


def growth(table: footing.Table, large: bool) -> None:
    """Each size and number of threads in a process of its own, whose peak memory is then its own as well."""
    for cells in SIZES if large else SIZES[:-1]:
        one, two = (footing.child(one_size, cells, threads) for threads in (1, 2))
        if one.pop("path") != two.pop("path"):
            raise SystemExit(f"{one['nodes']} nodes: two threads give another path than one")
        clock, shared = one.pop("by the clock"), two["by the clock"]
        table.add(one | {"by the clock [ms]": clock, "two threads [ms]": shared, "times as fast": f"{clock / shared:.2f}",
                         "their peak memory [MB]": two["peak memory [MB]"]})
    table.fit("ms a step", "two threads [ms]", "peak memory [MB]", "their peak memory [MB]")


def one_size(cells: list[int], threads: int) -> dict:
    """The press scene on another mesh."""
    os.environ["OMP_NUM_THREADS"] = str(threads)
    path = LoadPath(press(cells), build_mesh(press(cells).body))
    start = time.perf_counter()
    seconds, taken = cost(lambda: sum(path.advance(step / STEPS).iterations for step in range(1, STEPS + 1)))
    clock = time.perf_counter() - start
    return {"nodes": len(path.balance.mesh.points), "ms a step": 1e3 * seconds / STEPS, "Newton steps": taken,
            "factorisations": path.newton.factorisations, "peak memory [MB]": round(footing.peak_memory()),
            "by the clock": 1e3 * clock / STEPS, "path": sha256(path.states[-1].u.tobytes()).hexdigest()}


def parts(table: footing.Table) -> None:
    """Each part of a step of the press scene; once: at its last state; at best: what this core could make of such work."""
    path, spent = LoadPath(press(), build_mesh(press().body)), defaultdict(float)

    def watched(owner, name: str, label: str) -> None:
        run = getattr(owner, name)

        def timed(*arguments, **named):
            seconds, found = cost(run, *arguments, **named)
            spent[label] += seconds
            return found

        setattr(owner, name, timed)

    factor, body, tangent = path.newton.tangent.solver, path.balance.elasticity, path.newton.tangent
    for owner, name, label in ((body, "force", "forces"), (factor, "update", "stiffness and factor"), (factor, "begin", "solutions"),
                               (factor, "finish", "solutions"), (tangent, "_condense", "contact"), (path.newton, "_touch", "contact")):
        watched(owner, name, label)
    total, _ = cost(lambda: [path.advance(step / 400) for step in range(1, 401)])
    shares = {name: 1e3 * seconds / 400 for name, seconds in spent.items()}
    u = path.states[-1].u
    slow, force = DolfinxElasticity(body), body.force(u)
    unknowns, cells = body.mesh.points.size, len(body.mesh.cells)
    matrix, square, far = np.empty(unknowns * (factor.band + 1)), np.random.default_rng(0).random((1500, 1500)), np.ones(2**25)
    # Operations [1/ms] in a product of matrices, and bytes [1/ms] read from a matrix as large as the factor and from far memory.
    peak = 2e-3 * 1500**3 / median(lambda: square @ square, 5)
    near, slowest = 1e-3 * matrix.nbytes / median(matrix.sum, 30), 1e-3 * far.nbytes / median(far.sum, 5)
    # 54 multiply-adds for each of 6 points of a prism give F, as many give the forces, and the law's stress takes about 150 operations.
    work, read = cells * 6 * (4 * 54 + 150), cells * 6 * 19 * 8 + 3 * 8 * unknowns

    def best(amount: float, rate: float, unit: str = "MB at {:.2g} GB/s") -> tuple[float, str]:
        return amount / rate, f"{amount / 1e6:.2g} {unit.format(rate / 1e6)}"

    counted = "Mflop at {:.2g} Gflop/s"
    once = {"forces": (lambda: body.force(u), lambda: slow.force(u), max(best(work, peak, counted), best(read, slowest))),
            "solutions": (lambda: factor.solve(force), None, best(2 * matrix.nbytes, near)),
            "stiffness and factor": (lambda: factor.update(u), lambda: slow.stiffness(u),
                                     best(unknowns * factor.band**2, peak, counted + ", the factor alone"))}
    for name in (*once, "contact"):
        run, other, (floor, why) = once.get(name, (None, None, (None, None)))
        table.add({"part": name, "ms a step": shares[name], "once [ms]": 1e3 * median(run, 30) if run else None,
                   "assembled by dolfinx [ms]": 1e3 * median(other, 30) if other else None, "at best [ms]": floor, "which is": why})
    table.add({"part": "rest", "ms a step": 1e3 * total / 400 - sum(shares.values())})


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--second", action="store_true", help="cells of second order")
    parser.add_argument("--parts", action="store_true")
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--large", action="store_true", help="60 k nodes as well")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--plain-steps", type=int, default=60, help="steps of the plain method (it is slow)")
    options = parser.parse_args()
    table = footing.Table()
    if options.growth:
        growth(table, options.large)
    elif options.parts:
        parts(table)
    else:
        scene = press((40, 2, 2), cell="hexahedron", order=2) if options.second else press()
        versus(table, scene, options.repeats, options.plain_steps)


if __name__ == "__main__":
    main()
