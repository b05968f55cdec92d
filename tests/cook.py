"""Cook's membrane, a tapered cantilever under shear: published values for many elements."""

from dataclasses import replace

import numpy as np

from physics.mesh.build import build_mesh
from physics.solution import solve
from tests.scenes import beam

BULK, SHEAR = 400889.8, 80.1938
INCOMPRESSIBLE = {"young_modulus": 9 * BULK * SHEAR / (3 * BULK + SHEAR),
                  "poisson_ratio": (3 * BULK - 2 * SHEAR) / (6 * BULK + 2 * SHEAR)}  # nearly


def cooks_membrane(across, shear, material, **body):
    """Deflections of the nodes in the upper right corner in plane strain, one cell thick, of hexahedra unless told otherwise."""
    return loaded(across, shear, material, **body)[2]


def loaded(across, shear, material, **body):
    """The same, after the scene and its solution."""
    scene = beam(
        body={"length": 1.0, "width": 1.0, "height": 1.0, "cells": [across, across, 1], "cell": "hexahedron"} | body,
        material=material, steps={"count": 10},
        support=[{"where": "x-min", "fixed": "xy"}, {"where": "z-min", "fixed": "z"}, {"where": "z-max", "fixed": "z"}],
        load=[{"where": "x-max", "traction": [0.0, shear, 0.0]}])
    square = build_mesh(scene.body)
    x, y, z = square.points.T
    solution = solve(scene, mesh=replace(square, points=np.stack([48 * x, 44 * x + y * (44 - 28 * x), z], axis=1)))
    return scene, solution, solution.displacement[-1][(x == 1) & (y == 1), 1]
