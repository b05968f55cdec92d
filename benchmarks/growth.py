"""How time grows with the mesh: a trained network, finite elements and their cheap forms on one scene at 1.5 k, 5 k and 15 k nodes.

    .venv/bin/python benchmarks/growth.py --run RUN [--out growth] [--steps 100]

The same pressed beam with finer and finer cells. Time is processor time per step, set-up included, one process, one thread (so that
other work on the machine does not count); errors are over whole rollouts to the reference of the same mesh. A network sees cells
smaller than it was trained on: read its error here as that of an alien, and its time as what any network of its size would take.
Writes growth.png and growth.json.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from datagen.sets.generate import trajectory_of
from learning.prediction.checkpoint import load_model
from learning.prediction.predictor import Case, LeftOut
from learning.prediction.rivals import REFERENCE, elements, reduced
from learning.prediction.surrogates import corrected, learned
from learning.report.evaluate import warm_up
from learning.report.pareto import COLOURS, MARKERS
from physics.fem import release
from physics.mesh.build import build_mesh
from physics.mesh.quality import rmse
from physics.scene import read_scene

CELLS = ((40, 5, 5), (60, 8, 8), (90, 12, 12))


def press(cells: tuple[int, int, int], steps: int) -> Case:
    """The scene solved on these cells."""
    scene = read_scene({
        "name": "press", "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": list(cells)},
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": steps},
        "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.08, 0.01, 0.0305], [0.08, 0.01, 0.0105]]}})
    return Case("x".join(map(str, cells)), trajectory_of(scene), scene, build_mesh(scene.body))


def measure(run: str | None, steps: int) -> list[dict]:
    """A row for each predictor and mesh."""
    model = load_model(run) if run else None
    networks = [learned(model, single_steps=False), corrected(model, 1)] if model else []
    predictors = [*networks, elements("FE, cells halved", halvings=1),
                  elements("FE, a tenth of the steps", fewer=10), reduced("reduced-order model"), elements(REFERENCE)]
    rows = []
    for cells in CELLS:
        case = press(cells, steps)
        warm_up(case)
        for predictor in predictors:
            start = time.process_time()
            try:
                found = predictor.predict(case)
            except LeftOut as reason:
                print(f"{predictor.name}, {case.name}: left out, because {reason}", file=sys.stderr)
                continue
            rows.append({"predictor": predictor.name, "kind": predictor.kind, "nodes": len(case.mesh.points),
                         "ms_per_step": 1e3 * (time.process_time() - start) / steps,
                         "rmse_all_mm": 1e3 * rmse(found.path[1:], case.truth[1:], case.free)})
            print("  ".join(f"{value:.4g}" if isinstance(value, float) else str(value) for value in rows[-1].values()))
        release()
    return rows


def exponents(rows: list[dict]) -> dict[str, float]:
    """The power of the number of nodes by which each one's time grows."""
    found = {}
    for name in dict.fromkeys(row["predictor"] for row in rows):
        nodes, ms = np.array([(row["nodes"], row["ms_per_step"]) for row in rows if row["predictor"] == name]).T
        if len(np.atleast_1d(nodes)) > 1:
            found[name] = float(np.polyfit(np.log(nodes), np.log(ms), 1)[0])
    return found


def picture(path: Path, rows: list[dict]) -> None:
    """Time per step against nodes, a line for each predictor."""
    figure = Figure(figsize=(9, 5.6), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set(xscale="log", yscale="log", xlabel="nodes of the body", ylabel="processor time per step [ms], set-up included")
    powers = exponents(rows)
    for number, name in enumerate(dict.fromkeys(row["predictor"] for row in rows)):
        own = [row for row in rows if row["predictor"] == name]
        kind = own[0]["kind"]
        axes.plot([row["nodes"] for row in own], [row["ms_per_step"] for row in own], color=COLOURS[kind], marker=MARKERS[kind],
                  ls=("-", "--", ":")[number % 3], label=name + (f"  (nodes^{powers[name]:.2f})" if name in powers else ""))
    axes.grid(which="major", color="#ececec", lw=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    figure.savefig(path)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--run", help="folder of a training")
    options.add_argument("--out", type=Path, default=Path("growth"))
    options.add_argument("--steps", type=int, default=100)
    chosen = options.parse_args()
    torch.set_num_threads(1)
    rows = measure(chosen.run, chosen.steps)
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "growth.json").write_text(json.dumps({"rows": rows, "exponents": exponents(rows)}, indent=1))
    picture(chosen.out / "growth.png", rows)
    print(json.dumps(exponents(rows), indent=1))
