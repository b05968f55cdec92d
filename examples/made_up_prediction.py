"""A prediction that is wrong in a known way: everything moves a tenth too far. What does `verify` say?

Any array (T, N, 3) can be held against its truth. An overshoot of a tenth is an error of a tenth of the motion, and the
obstacle is left behind: nothing penetrates, but the forces do not balance.
"""

import numpy as np

from physics import read_scene, solve, verify

scene = read_scene({
    "body": {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [12, 4, 4]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
    "support": [{"where": "x-min"}],
    "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.0305], [0.05, 0.01, 0.0245]]},
    "steps": {"count": 20},
})
truth = solve(scene)
free = np.ones(len(truth.mesh.points), bool)
free[truth.mesh.place("x-min")] = False

figures = verify(1.1 * truth.displacement, truth.displacement, scene=scene, mesh=truth.mesh, free=free)
motion = np.sqrt((truth.displacement[1:, free] ** 2).sum(axis=2).mean())  # [m] root mean square
still = verify(0 * truth.displacement, truth.displacement, scene=scene, mesh=truth.mesh, free=free)

print(f"too far: error {figures.rmsd_all / motion:.4f} of the motion, residual {figures.relative_residual:.3f} of the reaction")
print(f"nothing moves: residual {still.relative_residual:.1e}, but the cylinder is {1e3 * still.largest_penetration:.3f} mm inside")
assert abs(figures.rmsd_all / motion - 0.1) < 1e-6
assert figures.relative_residual > 0.1 and abs(still.largest_penetration - 0.0055) < 2e-4  # 6 mm less the gap of 0.5 mm
