"""How fast are modes? Ratios measured side by side in one run, so that they hold on any machine.

    .venv/bin/python -m benchmarks.modes                    5 k, 20 k and 50 k unknowns, and one beam of the data set
    .venv/bin/python -m benchmarks.modes --large            500 k unknowns too (multigrid; some 10 minutes)
    .venv/bin/python -m benchmarks.modes --free             of a beam that nothing holds, rigid modes among the ten

Ten modes of a clamped beam of hexahedra, five times as long as thick, against
- one factorisation of K, by the own factor and by MUMPS, ordering included: the floor for anything that factors;
- SLEPc's Krylov-Schur method with MUMPS's factor, which also counts by inertia;
- scipy.sparse.linalg.eigsh in shift-invert mode on the same matrices, with its own factorisation (SuperLU) and no count.
Each size is repeated, all in turn, and the medians are given (eigsh runs once); each runs in a process of its own for its memory.
Without assembly, which is told separately.
"""

from dataclasses import replace
from statistics import median

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from petsc4py import PETSc

from benchmarks import footing
from physics.linalg.eigen.dissected import BlockLanczos
from physics.linalg.eigen.lowest import lowest_pairs
from physics.mesh.build import build_mesh
from physics.modes.elastic import elastic_modes, elastic_problem
from physics.scene import Scene, read_scene

CELLS = {"5k": (30, 6, 6), "20k": (55, 10, 10), "50k": (75, 14, 14), "500k": (165, 33, 33)}
REPEATS = {"5k": 5, "20k": 3, "50k": 3}


def beam(cells: tuple[int, int, int], cell: str = "hexahedron", length: float = 0.1, *, free: bool = False) -> Scene:
    return read_scene({"body": {"length": length, "width": 0.02, "height": 0.02, "cells": list(cells), "cell": cell},
                       "material": footing.MATERIAL, "support": [] if free else [{"where": "x-min"}]})


def free_part(found):
    """K and M of the free components."""
    keep = PETSc.IS().createGeneral(np.flatnonzero(found.free).astype(np.int32), comm=PETSc.COMM_SELF)
    return found.stiffness.createSubMatrix(keep, keep), found.mass.createSubMatrix(keep, keep)


def shift(found) -> float:
    """[1/s2] where a factor is made."""
    return -found.scale / 10 if found.zeros else 0.0


def ours(found) -> list[float]:
    pairs = lowest_pairs(found, 10)
    assert pairs.residuals.max() < 1e-8
    return pairs.values.tolist()


def slepc(found) -> list[float]:
    return ours(replace(found, graph=None))


def own_factor(found) -> list[float]:
    BlockLanczos(found).factor(shift(found))
    return []


def mumps(found) -> list[float]:
    K, M = free_part(found)
    K.axpy(-shift(found), M, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(K)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setUp()
    return []


def scipy_eigsh(found) -> list[float]:
    matrices = [scipy.sparse.csr_matrix(m.getValuesCSR()[::-1], shape=m.getSize()).tocsc() for m in free_part(found)]
    values, _ = scipy.sparse.linalg.eigsh(matrices[0], 10, matrices[1], sigma=shift(found), which="LM")
    return np.sort(values).tolist()


KINDS = {"modes": ours, "slepc": slepc, "own factor": own_factor, "mumps": mumps, "eigsh": scipy_eigsh}


def one(kind: str, size: str, free: bool) -> dict:
    """One measurement."""
    scene = beam(CELLS[size], free=free)
    mesh = build_mesh(scene.body)
    assembly, (found, _) = footing.cost(elastic_problem, scene, mesh)
    seconds, values = footing.cost(KINDS[kind], found)
    return {"seconds": seconds, "assembly": assembly, "unknowns": int(found.free.sum()), "zeros": found.zeros,
            "GB": footing.peak_memory() / 1024, "values": values}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--large", action="store_true", help="500 k unknowns too")
    parser.add_argument("--free", action="store_true", help="nothing is held")
    options = parser.parse_args()
    scene = beam((42, 5, 5), "prism", 0.105)
    mesh = build_mesh(scene.body)
    elastic_modes(scene, count=1, mesh=mesh)  # compiles, if need be
    milliseconds = 1e3 * footing.median(lambda: elastic_modes(scene, count=1, mesh=mesh), 15)
    footing.say(f"one mode of a beam of {len(mesh.points)} prism nodes with assembly: {milliseconds:.0f} ms")
    table = footing.Table()
    for size in (*REPEATS, *(["500k"] if options.large else [])):
        kinds = [kind for kind in KINDS if kind != "eigsh"] if size in REPEATS else ["modes"]
        turns = [{kind: footing.child(one, kind, size, options.free) for kind in kinds} for _ in range(REPEATS.get(size, 1))]
        seconds = {kind: median(turn[kind]["seconds"] for turn in turns) for kind in kinds}
        found = turns[0]
        if size in REPEATS:
            kinds.append("eigsh")
            found["eigsh"] = footing.child(one, "eigsh", size, options.free)
            seconds["eigsh"] = found["eigsh"]["seconds"]
            values = {kind: found[kind]["values"][found[kind]["zeros"]:] for kind in ("modes", "slepc", "eigsh")}
            assert np.allclose(values["modes"], values["slepc"], rtol=1e-9, atol=0)
            assert np.allclose(values["modes"], values["eigsh"], rtol=1e-6, atol=0)
        modes, missing = seconds["modes"], np.nan
        table.add({"unknowns": found["modes"]["unknowns"], "ten modes [s]": modes, "by SLEPc and MUMPS [s]": seconds.get("slepc"),
                   "by eigsh [s]": seconds.get("eigsh"), "one own factor [s]": seconds.get("own factor"),
                   "one of MUMPS [s]": seconds.get("mumps"), "modes over own factor": modes / seconds.get("own factor", missing),
                   "modes over MUMPS's": modes / seconds.get("mumps", missing),
                   "SLEPc's over MUMPS's": seconds.get("slepc", missing) / seconds.get("mumps", missing),
                   "SLEPc's over modes": seconds.get("slepc", missing) / modes,
                   "assembly [s]": median(turn["modes"]["assembly"] for turn in turns),
                   "memory: modes, SLEPc, eigsh [GB]":
                       ", ".join(f"{found[kind]['GB']:.2f}" for kind in ("modes", "slepc", "eigsh") if kind in found)})


if __name__ == "__main__":
    main()
