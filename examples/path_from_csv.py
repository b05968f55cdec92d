"""An elastic body remembers nothing: on the way back the obstacle feels the forces of the way in.

The path of the obstacle comes from a CSV file, as a robot or a testing machine would log it. Its rows are way-points
that are reached at equal fractions of the steps. Here a cylinder goes 8 mm down onto a beam and comes back the same
way.
"""

from pathlib import Path

import numpy as np

from physics import read_scene, solve

Path("press.csv").write_text("x,y,z\n" + "".join(f"0.05,0.01,{0.0305 - 0.001 * mm:.4f}\n" for mm in [*range(9), *range(7, -1, -1)]))
path = np.loadtxt("press.csv", delimiter=",", skiprows=1)  # (17, 3) [m]

scene = read_scene({
    "body": {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [12, 4, 4]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
    "support": [{"where": "x-min"}],
    "obstacle": {"shape": "cylinder", "radius": 0.01, "axis": [0, 1, 0], "path": path.tolist()},
    "steps": {"count": 32},
})
solution = solve(scene)

down, back = solution.reaction[:17, 2], solution.reaction[16:, 2][::-1]  # [N] upwards on the cylinder, by its place
largest = down.max()
print(f"largest force {largest:.3f} N; down and back differ by {abs(down - back).max() / largest:.1e} of it")
assert largest > 0.5 and abs(down - back).max() < 1e-5 * largest
