"""At what frequency does a square plate vibrate that is clamped along one side? Leissa's table for thin plates says

    f = 3.492 / (2 pi a^2) sqrt(D / (rho h)),    D = E h^3 / (12 (1 - nu^2)),    nu = 0.3

and 8.525 in place of 3.492 for the second mode, a torsion. The plate here is a hundred times as wide as thick.
"""

import numpy as np

from physics import elastic_modes, read_scene

SIDE, THICK, YOUNG, POISSON, DENSITY = 1.0, 0.01, 200e9, 0.3, 8000.0

scene = read_scene({
    "body": {"shape": "plate", "length": SIDE, "width": SIDE, "height": THICK, "cells": [12, 12, 1], "cell": "hexahedron", "order": 2},
    "material": {"young_modulus": YOUNG, "poisson_ratio": POISSON, "density": DENSITY},
    "support": [{"where": "x-min"}],
})
modes = elastic_modes(scene, count=2)

stiffness = YOUNG * THICK**3 / (12 * (1 - POISSON**2))  # [N m]
expected = np.array([3.492, 8.525]) / (2 * np.pi * SIDE**2) * np.sqrt(stiffness / (DENSITY * THICK))

print(f"{modes.dofs} unknowns, {modes.cells}; largest residual {modes.residuals.max():.0e}")
for hz, theory in zip(modes.frequencies_hz, expected, strict=True):
    print(f"{hz:.3f} Hz, Leissa {theory:.3f} Hz")
assert np.allclose(modes.frequencies_hz, expected, rtol=0.01)
