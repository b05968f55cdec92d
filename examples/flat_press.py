"""The patch test of contact: a flat plate presses a block, and the stress is the same everywhere in the block.

Without friction the block shortens evenly, sigma = E strain, whatever the mesh. Careless nodal contact gets this
wrong at edges and corners.
"""

import numpy as np

from physics import read_scene, solve, von_mises

YOUNG, SIDE, DEPTH = 1e6, 0.02, 2e-5  # [Pa], [m], [m]: a strain of a thousandth

scene = read_scene({
    "body": {"length": SIDE, "width": SIDE, "height": SIDE, "cells": [4, 3, 5], "cell": "tetrahedron"},
    "material": {"law": "linear", "young_modulus": YOUNG, "poisson_ratio": 0.3},
    "support": [{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"}, {"where": "z-min", "fixed": "z"}],
    "obstacle": {"shape": "half-space", "normal": [0, 0, -1], "path": [[0, 0, SIDE], [0, 0, SIDE - DEPTH]]},
    "steps": {"count": 2},
})
solution = solve(scene)

found = abs(solution.reaction[-1, 2])
expected = YOUNG * DEPTH / SIDE * SIDE**2
stress = von_mises(solution.mesh, solution.displacement[-1], scene.material)
print(f"force {found:.6f} N, closed form {expected:.6f} N; stress varies by {np.ptp(stress) / stress.mean():.1e} of itself")
assert abs(found / expected - 1) < 1e-3 and np.ptp(stress) < 1e-2 * stress.mean()
