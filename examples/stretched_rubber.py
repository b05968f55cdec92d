"""Twice as long: the force of a stretched bar under a law of finite strain.

For a Saint-Venant-Kirchhoff bar that is free to become thinner the force over the area at rest is, at a stretch s,

    P = E / 2 s (s^2 - 1),

three times E at s = 2, where Hooke's law for small strain would say E. Its section has shrunk to 1 - nu (s^2 - 1) of
itself by then, a tenth, so the stress in it is ten times as large.
"""

from physics import read_scene, solve, von_mises

YOUNG, POISSON, SIDE, STRETCH = 1e6, 0.3, 0.01, 2.0

scene = read_scene({
    "body": {"length": 0.03, "width": SIDE, "height": SIDE, "cells": [3, 2, 2], "cell": "hexahedron"},
    "material": {"law": "saint-venant-kirchhoff", "young_modulus": YOUNG, "poisson_ratio": POISSON},
    "support": [{"where": "x-min", "fixed": "x"}, {"where": "x-max", "fixed": "x", "displacement": [(STRETCH - 1) * 0.03, 0, 0]},
                {"where": "y-min", "fixed": "y"}, {"where": "z-min", "fixed": "z"}],
    "steps": {"count": 10},
})
solution = solve(scene)

found = abs(solution.reaction[-1, 0]) / SIDE**2
expected = YOUNG / 2 * STRETCH * (STRETCH**2 - 1)
stress = von_mises(solution.mesh, solution.displacement[-1], scene.material)
print(f"force over area at rest {1e-6 * found:.4f} MPa, closed form {1e-6 * expected:.4f} MPa")
true = expected / (1 - POISSON * (STRETCH**2 - 1))
print(f"stress in the bar from {1e-6 * stress.min():.4f} to {1e-6 * stress.max():.4f} MPa, closed form {1e-6 * true:.4f} MPa")
assert abs(found / expected - 1) < 1e-5 and abs(stress / true - 1).max() < 1e-4
