"""How fast are modes? Ratios measured side by side in one run, so that they hold on any machine.

    .venv/bin/python benchmarks/modes.py                    5 k and 50 k unknowns, and one beam of the data set
    .venv/bin/python benchmarks/modes.py --large            500 k unknowns too (multigrid; some 10 minutes)

Ten modes of a clamped beam of hexahedra, five times as long as thick, against
- one factorisation of K by MUMPS, the floor for anything that factors;
- scipy.sparse.linalg.eigsh in shift-invert mode on the same matrices, with its own factorisation (SuperLU).
Each size is repeated, the three in turn, and the medians are given; each runs in a process of its own for its memory.
Without assembly, which is told separately. One thread each.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

CELLS = {"5k": (30, 6, 6), "50k": (75, 14, 14), "500k": (165, 33, 33)}
REPEATS = {"5k": 7, "50k": 3, "500k": 1}


def problem(size: str):
    """The eigenproblem of one size, and the seconds of its assembly."""
    from physics.mesh.build import build_mesh
    from physics.modes.elastic import elastic_problem
    from physics.scene import read_scene

    scene = read_scene({"body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": list(CELLS[size]), "cell": "hexahedron"},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}]})
    mesh = build_mesh(scene.body)
    started = time.perf_counter()
    found, _ = elastic_problem(scene, mesh)
    return found, time.perf_counter() - started


def free_part(found):
    """K and M of the free components."""
    import numpy as np
    from petsc4py import PETSc

    keep = PETSc.IS().createGeneral(np.flatnonzero(found.free).astype(np.int32), comm=PETSc.COMM_SELF)
    return found.stiffness.createSubMatrix(keep, keep), found.mass.createSubMatrix(keep, keep)


def ours(found) -> list[float]:
    from physics.linalg.eigen.lowest import lowest_pairs

    pairs = lowest_pairs(found, 10)
    assert pairs.residuals.max() < 1e-8
    return pairs.values.tolist()


def factor(found) -> list[float]:
    from petsc4py import PETSc

    stiffness, _ = free_part(found)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(stiffness)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setUp()
    return []


def scipy_eigsh(found) -> list[float]:
    import numpy as np
    import scipy.sparse
    import scipy.sparse.linalg

    matrices = [scipy.sparse.csr_matrix(m.getValuesCSR()[::-1], shape=m.getSize()).tocsc() for m in free_part(found)]
    values, _ = scipy.sparse.linalg.eigsh(matrices[0], 10, matrices[1], sigma=0.0, which="LM")
    return np.sort(values).tolist()


KINDS = {"ours": ours, "factor": factor, "eigsh": scipy_eigsh}


def child(kind: str, size: str) -> None:
    """One measurement: print seconds, assembly and memory as JSON."""
    found, assembly = problem(size)
    before = peak()
    started = time.perf_counter()
    values = KINDS[kind](found)
    print(json.dumps({"seconds": time.perf_counter() - started, "assembly": assembly, "unknowns": int(found.free.sum()),
                      "before_gb": before, "gb": peak(), "values": values}))


def peak() -> float:
    """The largest memory of this process so far [GB]; that of its parent, which getrusage counts too, left out."""
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]) / 2**20


def measure(kind: str, size: str) -> dict:
    done = subprocess.run([sys.executable, __file__, "--child", kind, size], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def one_beam(repeats: int = 15) -> tuple[int, float, float]:
    """Nodes of a beam as in the data set, and the median milliseconds of its first mode, by the clock and of the processor."""
    from physics.mesh.build import build_mesh
    from physics.modes.elastic import elastic_modes
    from physics.scene import read_scene

    scene = read_scene({"body": {"length": 0.105, "width": 0.02, "height": 0.02, "cells": [42, 5, 5]},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}]})
    mesh = build_mesh(scene.body)
    took, worked = [], []
    for _ in range(repeats + 1):  # the first compiles
        started, busy = time.perf_counter(), time.process_time()
        elastic_modes(scene, count=1, mesh=mesh)
        took.append(time.perf_counter() - started)
        worked.append(time.process_time() - busy)
    return len(mesh.points), 1e3 * statistics.median(took[1:]), 1e3 * statistics.median(worked[1:])


def blas() -> str:
    """The BLAS that MUMPS finds."""
    command = "readlink -f $(ldconfig -p | awk '/libblas.so.3 /{print $NF; exit}')"
    found = subprocess.run(command, shell=True, capture_output=True, text=True)
    return found.stdout.strip() or "unknown"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true", help="500 k unknowns too")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(*options.child)
        return
    print(f"BLAS {blas()}, one thread, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    nodes, clock, processor = one_beam()
    print(f"one mode of a beam of {nodes} prism nodes with assembly: {clock:.0f} ms by the clock, {processor:.0f} ms of the processor")
    print("unknowns   ten modes   one factor   eigsh    modes/factor   eigsh/modes   assembly   memory: modes, factor, eigsh")
    for size in ("5k", "50k"):
        runs = {kind: [] for kind in KINDS}
        for _ in range(REPEATS[size]):
            for kind in KINDS:
                runs[kind].append(measure(kind, size))
        a, b, c = (statistics.median(run["seconds"] for run in runs[kind]) for kind in KINDS)
        worst = max(abs(x / y - 1) for x, y in zip(runs["ours"][0]["values"], runs["eigsh"][0]["values"], strict=True))
        assert worst < 1e-6, worst
        memory = ", ".join(f"{max(run['gb'] for run in runs[kind]):.2f}" for kind in KINDS)
        assembly = statistics.median(run["assembly"] for run in runs["ours"])
        print(f"{runs['ours'][0]['unknowns']:8d} {a:9.2f} s {b:10.2f} s {c:8.2f} s {a / b:10.1f} {c / a:13.1f} "
              f"{assembly:11.2f} s   {memory} GB", flush=True)
    if options.large:
        run = measure("ours", "500k")
        print(f"{run['unknowns']:8d} {run['seconds']:9.1f} s   assembly {run['assembly']:.1f} s   memory {run['gb']:.2f} GB "
              f"({run['before_gb']:.2f} GB before)", flush=True)


if __name__ == "__main__":
    main()
