"""How far does the end of a cantilever sink under a load? Beam theory says w = P L^3 / (3 E I).

A beam of 100 x 5 x 5 mm is clamped at one end and loaded by a traction on the other, so gently that linear elasticity
is enough. First-order prisms bend too stiffly; the element "reduced" lets them bend as they should (docs/elements.md).
"""

from physics import read_scene, solve

LENGTH, SIDE, YOUNG, TRACTION = 0.1, 0.005, 1e6, 1.0  # [m], [m], [Pa], [Pa]

scene = read_scene({
    "body": {"length": LENGTH, "width": SIDE, "height": SIDE, "cells": [40, 4, 4], "element": "reduced"},
    "material": {"law": "linear", "young_modulus": YOUNG, "poisson_ratio": 0.3},
    "support": [{"where": "x-min"}],
    "load": [{"where": "x-max", "traction": [0.0, 0.0, -TRACTION]}],
    "steps": {"count": 1},
})
solution = solve(scene)

end = solution.mesh.place("x-max")
found = -solution.displacement[-1, end, 2].mean()  # [m] downwards
inertia = SIDE**4 / 12  # [m4] second moment of area
expected = TRACTION * SIDE**2 * LENGTH**3 / (3 * YOUNG * inertia)

print(f"tip deflection {1e3 * found:.4f} mm, beam theory {1e3 * expected:.4f} mm")
assert abs(found / expected - 1) < 0.01
