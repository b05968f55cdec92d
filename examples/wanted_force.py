"""Where must a beam be pressed, and how deep, so that its end sinks by 12 mm and it pushes back with 0.9 N?

Five thousand paths are predicted in some seconds. Their force is that of beam theory, about a tenth less than that of finite elements: one
path that is solved says by how much. Then the six that should fit best are solved, and the best of them is taken.
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


def solved(path):
    """The sinking of the end [m] and the force [N] by finite elements."""
    truth = solve(found.scene(path), final=True)
    return -truth.displacement[-1, truth.mesh.place("x-max"), 2].mean(), abs(truth.reaction[-1, 2])


def nearest(ratio, count):
    """The paths of which the predictor is sure whose sinking and force are nearest to the wanted ones."""
    off = abs(sinks / SINKS - 1) + abs(ratio * found.rows.force[:, -1] / FORCE - 1)
    return np.argsort(np.where(sure, off, np.inf))[:count]


first = nearest(1.0, 1)[0]
ratio = solved(first)[1] / found.rows.force[first, -1]
tried = {path: solved(path) for path in nearest(ratio, 6)}
best = min(tried, key=lambda path: abs(tried[path][0] / SINKS - 1) + abs(tried[path][1] / FORCE - 1))
end, force = tried[best]

place, depth = (found.varied[f"obstacle.place.{name}"][best] for name in ("along", "depth"))
print(f"pressed at {place:.3f} of the length, {1e3 * depth:.2f} mm deep: the end sinks by {1e3 * end:.3f} mm, predicted "
      f"{1e3 * sinks[best]:.3f} mm, and the force is {force:.4f} N, {ratio:.2f} times beam theory's at the path solved first")
assert abs(end / SINKS - 1) < 0.01 and abs(force / FORCE - 1) < 0.02
