"""A load that acts at once moves a body twice as far as one that grows slowly.

A cantilever is loaded by its own weight. Through equilibria it comes to rest at a deflection w; let go at once, with
inertia, it swings between zero and nearly 2 w, for almost all of the motion is in the first mode.
"""

from physics import elastic_modes, read_scene, solve

table = {
    "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [10, 2, 2], "element": "reduced"},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.3, "density": 1000.0},
    "support": [{"where": "x-min"}],
    "load": [{"acceleration": [0.0, 0.0, -0.5]}],
    "steps": {"count": 1},
}
slow = solve(read_scene(table))
period = 1 / float(elastic_modes(read_scene(table), count=1).frequencies_hz[0])  # [s]

fast = solve(read_scene(table | {"load": [table["load"][0] | {"sudden": True}],
                                 "steps": {"count": 60, "duration": 1.2 * period, "dynamic": True}}))
end = slow.mesh.place("x-max")
static = -slow.displacement[-1, end, 2].mean()
largest = (-fast.displacement[:, end, 2]).mean(axis=1).max()
print(f"period {period:.4f} s; at rest {1e3 * static:.4f} mm, swinging up to {1e3 * largest:.4f} mm: {largest / static:.3f} times")
assert 1.9 < largest / static < 2.1
