"""How much stiffer is a body that cannot widen? Material varied by Python, one solution for each Poisson ratio.

A block between sliding walls is shortened by a thousandth. Its stress over its strain is the constrained modulus

    M = E (1 - nu) / ((1 + nu) (1 - 2 nu)),

which grows without bound towards nu = 1/2.
"""

from dataclasses import replace

from physics import read_scene, solve

YOUNG, STRAIN, AREA = 1e6, 1e-3, 0.02 * 0.02  # [Pa], -, [m2]
walls = [{"where": f"{axis}-{end}", "fixed": axis} for axis in "xyz" for end in ("min", "max")]
walls[1]["displacement"] = [-STRAIN * 0.04, 0.0, 0.0]  # x-max

scene = read_scene({
    "body": {"length": 0.04, "width": 0.02, "height": 0.02, "cells": [4, 2, 2], "cell": "hexahedron"},
    "material": {"law": "linear", "young_modulus": YOUNG, "poisson_ratio": 0.0},
    "support": walls,
    "steps": {"count": 1},
})
for poisson in (0.0, 0.2, 0.4, 0.45):
    solution = solve(replace(scene, material=replace(scene.material, poisson_ratio=poisson)))
    found = abs(solution.reaction[-1, 0]) / AREA / STRAIN
    expected = YOUNG * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    print(f"nu = {poisson:.2f}: {1e-6 * found:.4f} MPa, closed form {1e-6 * expected:.4f} MPa")
    assert abs(found / expected - 1) < 1e-6
