"""What the own multifrontal Cholesky factor gains over MUMPS and CHOLMOD: the press scene with each of them, at three sizes.

    .venv/bin/python benchmarks/factors.py                      1.5 k, 5 k and 15 k nodes, some minutes

The first steps of the press scene's 400 (benchmarks/equilibrium.py), after the obstacle has touched, set-up left out. All three factor
the same stiffness, are kept as long and renewed by the same rule, and answer the same questions of contact; only the program differs
that factors and solves. MUMPS and CHOLMOD are PETSc's, each with its own ordering, and their compliance columns are whole solutions;
the own factor stops half-way (physics/linalg/columns.py). Processor time of one thread, each run in a process of its own.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

from petsc4py import PETSc

from benchmarks.equilibrium import PRESS
from physics.equilibrium import tangent
from physics.equilibrium.path import LoadPath
from physics.linalg.cholesky import DissectionFactor, NotPositiveDefinite
from physics.linalg.indefinite import SparseFactor
from physics.mesh.build import build_mesh
from physics.scene import read_scene

SIZES = (((40, 5, 5), 60), ((60, 8, 8), 20), ((90, 12, 12), 8))


class Cholmod(SparseFactor):
    """CHOLMOD's supernodal L L^T."""

    name = "CHOLMOD"

    def __init__(self, elasticity) -> None:
        super().__init__(elasticity)
        self._pc.setFactorSolverType("cholmod")

    def update(self, u) -> None:
        self.learned = []
        matrix = self.elasticity.stiffness(u)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._pc.setOperators(matrix)
        try:
            self._pc.setUp()
        except PETSc.Error:
            raise NotPositiveDefinite("the stiffness cannot be factored") from None
        self._vectors = self._vectors or matrix.createVecs()


KINDS = {"own": DissectionFactor, "MUMPS": SparseFactor, "CHOLMOD": Cholmod}


def one(kind: str, cells: list[int], steps: int) -> dict:
    """The first steps with one kind of factor."""
    tangent.solver_for = lambda elasticity, **choice: KINDS[kind](elasticity)
    scene = read_scene({**PRESS, "body": {**PRESS["body"], "cells": cells}})
    path = LoadPath(scene, build_mesh(scene.body))
    path.advance(1 / 400)
    start, taken = time.process_time(), 0
    for step in range(2, steps + 2):
        taken += path.advance(step / 400).iterations
    seconds = time.process_time() - start
    return {"nodes": len(path.balance.mesh.points), "ms": 1e3 * seconds / steps, "iterations": taken, "made": path.newton.factorisations,
            "largest": float(abs(path.states[-1].u).max())}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--one", help="a kind; prints one line of JSON")
    parser.add_argument("--cells", type=int, nargs=3)
    parser.add_argument("--steps", type=int)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one(options.one, options.cells, options.steps)))
        return
    print("| nodes | own, ms a step | MUMPS | CHOLMOD | MUMPS over own | CHOLMOD over own |\n" + "| ---: " * 6 + "|")
    for cells, steps in SIZES:
        rows = {}
        for kind in KINDS:
            command = [sys.executable, __file__, "--one", kind, "--cells", *map(str, cells), "--steps", str(steps)]
            rows[kind] = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        own, mumps, cholmod = (rows[kind]["ms"] for kind in KINDS)
        assert max(row["largest"] for row in rows.values()) < min(row["largest"] for row in rows.values()) * (1 + 1e-5)
        print(f"| {rows['own']['nodes']} | {own:.3g} | {mumps:.3g} | {cholmod:.3g} | {mumps / own:.2g} | {cholmod / own:.2g} |", flush=True)


if __name__ == "__main__":
    main()
