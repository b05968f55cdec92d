"""Where must a beam be pressed, and how deep, so that its end sinks by 12 mm and it pushes back with 0.9 N?

Five thousand paths are predicted in some seconds, and one is chosen. Its end sinks as predicted. The force is that of beam theory, which
is less than the elements' by some tenth for all paths of one body: so each path that is solved says by how much, and the next choice is
better.
"""

from pathlib import Path

import numpy as np

from learning import sweep
from physics import solve

SINKS, FORCE = 0.012, 0.9  # [m], [N]
RUN = Path(__file__).parents[1] / "assets" / "m4gn-fast"

found = sweep(
    {
        "body": {"length": 0.13, "width": 0.024, "height": 0.025, "cells": [25, 5, 5]},
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
        "support": [{"where": "x-min"}],
        "obstacle": {"shape": "cylinder", "radius": 0.012, "place": {"face": "z-max", "gap": 0.001, "depth": 0.01}},
        "steps": {"count": 20},
    },
    RUN, vary=["obstacle.place.along=0.55:0.9", "obstacle.place.depth=0.004:0.02"], count=5000, nodes="x-max",
)
sinks = -found.rows.displacement[:, -1, :, 2].mean(axis=1)  # (5000,) [m]
sure = ~found.rows.unsure[:, -1]

ratio = 1.0
for _ in range(3):
    off = abs(sinks / SINKS - 1) + abs(ratio * found.rows.force[:, -1] / FORCE - 1)
    best = int(np.argmin(np.where(sure, off, np.inf)))
    truth = solve(found.scene(best), final=True)
    force = abs(truth.reaction[-1, 2])
    ratio = force / found.rows.force[best, -1]
    end = -truth.displacement[-1, truth.mesh.place("x-max"), 2].mean()
    print(f"pressed at {found.varied['obstacle.place.along'][best]:.3f} of the length, {1e3 * found.varied['obstacle.place.depth'][best]:.2f}"
          f" mm deep: the end sinks by {1e3 * end:.3f} mm, predicted {1e3 * sinks[best]:.3f} mm; the force is {force:.4f} N")

assert abs(end / SINKS - 1) < 0.01 and abs(force / FORCE - 1) < 0.02
