"""What one more question about a body that is known costs: where does it end under this obstacle? Time against error, in a picture.

    .venv/bin/python -m benchmarks.queries --picture docs/pictures/queries.png

The body, its mesh and its supports are there already; a question is an obstacle's path, its answer the last frame of all nodes. Finite
elements go to the end in as few steps as lead there. Errors are root mean square distances over all nodes from 100 steps of finite
elements to the tolerance of the data; times are means over the paths, of the processor and on the wall, those of the network on one
core and on two. The solver has one.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks import footing
from benchmarks.sweep import RUN, VARY, press
from datagen.family.vary import load_variation
from learning.prediction.rivals import coarser
from learning.prediction.sweep import sweep
from learning.report.pareto import pareto_picture
from learning.report.table import Row
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.mesh.transfer import interpolate
from physics.scene import Scene, Steps
from physics.solution import solve

SEED, TRUE_STEPS = 5, 100
Ends = NDArray[np.floating[Any]]  # (n, N, 3) [m] the last frames of n paths


@dataclass(frozen=True)
class Asked:
    """n paths of one body, and where it truly ends."""

    scenes: list[Scene]
    mesh: Mesh
    truth: Ends


def first_paths(count: int) -> Asked:
    """Of the sweep with this seed."""
    variation = load_variation(press(0.2), VARY, seed=SEED)
    scenes = [replace(variation.scene(SEED, number)[0], steps=Steps(count=TRUE_STEPS)) for number in range(count)]
    mesh = build_mesh(scenes[0].body)
    return Asked(scenes, mesh, np.array([solve(scene, mesh=mesh).displacement[-1] for scene in scenes]))


def predicted(count: int) -> Ends:
    """By the predictor, all in one call, everything included but the imports."""
    return sweep(press(0.2), RUN, vary=VARY, count=count, seed=SEED).rows.displacement[:, 0]


def solved(known: Asked, *, halvings: int = 0, **how: Any) -> Callable[[int], Ends]:
    """By finite elements, on request on cells of twice the size: how to answer some paths."""
    coarse = known.scenes
    for _ in range(halvings):
        coarse = [found for scene in coarse if (found := coarser(scene)) is not None]
    mesh = build_mesh(coarse[0].body)

    def answer(count: int) -> Ends:
        ends = np.array([solve(scene, mesh=mesh, final=True, **how).displacement[-1] for scene in coarse[:count]])
        return interpolate(mesh, ends, known.mesh.points) if halvings else ends

    return answer


def clocks(run: Callable[[], Any]) -> tuple[float, float, Any]:
    """Seconds of the processor and on the wall of a call, and what it returned."""
    start, began = time.process_time(), time.perf_counter()
    found = run()
    return time.process_time() - start, time.perf_counter() - began, found


def measured(name: str, answer: Callable[[int], Ends], known: Asked, count: int, cores: int) -> dict[str, Any]:
    """One row: `answer(n)` gives the ends of the first n paths, of which those of `known` are judged."""
    torch.set_num_threads(cores)
    processor, wall, found = clocks(lambda: answer(count))
    torch.set_num_threads(1)
    error = np.sqrt(((found[:len(known.truth)] - known.truth[:count]) ** 2).sum(axis=2).mean(axis=1))
    return {"a body that is known, asked by": name, "paths": count, "cores": cores, "processor [ms a path]": 1e3 * processor / count,
            "wall [ms a path]": 1e3 * wall / count, "error [mm]": 1e3 * float(error.mean()), "worst [mm]": 1e3 * float(error.max())}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--count", type=int, default=10_000, help="paths of the predictor's sweep")
    parser.add_argument("--judged", type=int, default=12, help="paths that are solved")
    options = parser.parse_args()
    known, table, rows = first_paths(options.judged), footing.Table(), []
    ways = [("predictor, all paths at once", predicted, options.count, "learned"), ("predictor, one path", predicted, 1, "learned"),
            ("FE, the end alone", solved(known), options.judged, "fe"),
            ("FE, the end alone, tolerance 0.01", solved(known, tolerance=1e-2), options.judged, "fe"),
            ("FE, the end alone, cells twice as large", solved(known, halvings=1), options.judged, "fe"),
            ("nothing moves", lambda count: np.zeros((count, *known.truth.shape[1:])), options.judged, "trivial")]
    for name, way, count, kind in ways:
        for cores in (1, 2) if kind == "learned" else (1,):
            row = measured(name, way, known, count, cores)
            table.add(row)
            if cores == 1:
                rows.append(Row(name, kind, {"ms_per_step": row["processor [ms a path]"], "rmsd_all": 1e-3 * row["error [mm]"]}))
    if options.picture is not None:
        pareto_picture(options.picture, rows, across="processor time of one more path of a known body [ms], one core",
                       up="RMSD of the last frame to finite elements in 100 steps [mm]")


if __name__ == "__main__":
    main()
