"""What it costs to hold a prediction against its reference and against the equations: 400 steps of the press scene, 1476 nodes.

    .venv/bin/python benchmarks/verify.py

Processor time of one thread: all figures that need only the two arrays, for the whole trajectory; and per frame the checks by
finite elements (residual with the contact forces that leave the least of it, energy, penetration, one Newton step, stress).
"""

import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np

from physics.body.stress import von_mises
from physics.fidelity.verify import Checker, verify
from physics.mesh import quality
from physics.scene import read_scene
from physics.solution import solve

PRESS = {
    "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [40, 5, 5]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 400},
    "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.08, 0.01, 0.0305], [0.08, 0.01, 0.0]]},
}


def main() -> dict[str, float]:
    scene = read_scene(PRESS)
    solution = solve(scene)
    mesh, truth = solution.mesh, solution.displacement
    free = np.ones(len(mesh.points), bool)
    free[mesh.places["x-min"]] = False
    drift = 1e-5 * np.sin(60 * mesh.points[:, :1]) * np.linspace(0, 1, len(truth))[:, None, None]
    prediction = truth + np.where(free[:, None], drift, 0.0)
    verify(prediction[:3], truth[:3], scene=scene, mesh=mesh, free=free)  # compiled forms

    last = len(truth) - 1
    checker = Checker(scene, mesh)
    start = time.process_time()
    for t in range(1, last + 1):
        checker.frame(prediction[t], t / last)
        checker.correction(prediction[t], t / last)
        checker.penetration(prediction[t], t / last)
        von_mises(mesh, prediction[t], scene.material)
    checks = time.process_time() - start

    cells, now, then = (mesh.cells, mesh.cell), mesh.points + prediction, mesh.points + truth
    start = time.process_time()
    quality.rmse(prediction, truth)
    quality.rmse(prediction, truth, free)
    for a, b in zip(now, then, strict=True):
        quality.set_distances(a, b)
    quality.mesh_continuity_error(now, then, *cells)
    quality.aspect_ratio_error(now, then, *cells)
    quality.det_f(mesh.points, prediction, *cells)
    quality.scaled_jacobian(now, *cells)
    metrics = time.process_time() - start
    found = verify(prediction, truth, scene=scene, mesh=mesh, free=free)
    return {"nodes": len(mesh.points), "frames": last, "metrics_seconds": metrics, "fe_checks_ms_per_frame": 1e3 * checks / last,
            "effectivity": found.effectivity}


if __name__ == "__main__":
    print(json.dumps(main(), indent=1))
