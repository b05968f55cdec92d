"""How fast are modes? Ratios measured side by side in one run, so that they hold on any machine.

    .venv/bin/python -m benchmarks.modes                    5 k and 50 k unknowns, and one beam of the data set
    .venv/bin/python -m benchmarks.modes --large            500 k unknowns too (multigrid; some 10 minutes)

Ten modes of a clamped beam of hexahedra, five times as long as thick, against
- one factorisation of K by MUMPS, the floor for anything that factors;
- scipy.sparse.linalg.eigsh in shift-invert mode on the same matrices, with its own factorisation (SuperLU).
Each size is repeated, the three in turn, and the medians are given; each runs in a process of its own for its memory.
Without assembly, which is told separately.
"""

from statistics import median

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from petsc4py import PETSc

from benchmarks import footing
from physics.linalg.eigen.lowest import lowest_pairs
from physics.mesh.build import build_mesh
from physics.modes.elastic import elastic_modes, elastic_problem
from physics.scene import Scene, read_scene

CELLS = {"5k": (30, 6, 6), "50k": (75, 14, 14), "500k": (165, 33, 33)}
REPEATS = {"5k": 7, "50k": 3}


def beam(cells: tuple[int, int, int], cell: str = "hexahedron", length: float = 0.1) -> Scene:
    return read_scene({"body": {"length": length, "width": 0.02, "height": 0.02, "cells": list(cells), "cell": cell},
                       "material": footing.MATERIAL, "support": [{"where": "x-min"}]})


def free_part(found):
    """K and M of the free components."""
    keep = PETSc.IS().createGeneral(np.flatnonzero(found.free).astype(np.int32), comm=PETSc.COMM_SELF)
    return found.stiffness.createSubMatrix(keep, keep), found.mass.createSubMatrix(keep, keep)


def ours(found) -> list[float]:
    pairs = lowest_pairs(found, 10)
    assert pairs.residuals.max() < 1e-8
    return pairs.values.tolist()


def factor(found) -> list[float]:
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(free_part(found)[0])
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setUp()
    return []


def scipy_eigsh(found) -> list[float]:
    matrices = [scipy.sparse.csr_matrix(m.getValuesCSR()[::-1], shape=m.getSize()).tocsc() for m in free_part(found)]
    values, _ = scipy.sparse.linalg.eigsh(matrices[0], 10, matrices[1], sigma=0.0, which="LM")
    return np.sort(values).tolist()


KINDS = {"modes": ours, "factor": factor, "eigsh": scipy_eigsh}


def one(kind: str, size: str) -> dict:
    """One measurement."""
    scene = beam(CELLS[size])
    mesh = build_mesh(scene.body)
    assembly, (found, _) = footing.cost(elastic_problem, scene, mesh)
    seconds, values = footing.cost(KINDS[kind], found)
    return {"seconds": seconds, "assembly": assembly, "unknowns": int(found.free.sum()), "GB": footing.peak_memory() / 1024,
            "values": values}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--large", action="store_true", help="500 k unknowns too")
    options = parser.parse_args()
    scene = beam((42, 5, 5), "prism", 0.105)
    mesh = build_mesh(scene.body)
    elastic_modes(scene, count=1, mesh=mesh)  # compiles, if need be
    milliseconds = 1e3 * footing.median(lambda: elastic_modes(scene, count=1, mesh=mesh), 15)
    footing.say(f"one mode of a beam of {len(mesh.points)} prism nodes with assembly: {milliseconds:.0f} ms")
    table = footing.Table()
    for size in (*REPEATS, *(["500k"] if options.large else [])):
        kinds = KINDS if size in REPEATS else ["modes"]
        turns = [{kind: footing.child(one, kind, size) for kind in kinds} for _ in range(REPEATS.get(size, 1))]
        found, seconds = turns[0], {kind: median(turn[kind]["seconds"] for turn in turns) for kind in kinds}
        if "eigsh" in found:
            assert np.allclose(found["modes"]["values"], found["eigsh"]["values"], rtol=1e-6, atol=0)
        table.add({"unknowns": found["modes"]["unknowns"], "ten modes [s]": seconds["modes"], "one factor [s]": seconds.get("factor"),
                   "eigsh [s]": seconds.get("eigsh"), "modes over factor": seconds["modes"] / seconds.get("factor", np.nan),
                   "eigsh over modes": seconds.get("eigsh", np.nan) / seconds["modes"],
                   "assembly [s]": median(turn["modes"]["assembly"] for turn in turns),
                   "memory: modes, factor, eigsh [GB]": ", ".join(f"{found[kind]['GB']:.2f}" for kind in kinds)})


if __name__ == "__main__":
    main()
