"""Scenes that several tests start from."""

from dataclasses import replace

import numpy as np

from physics.mesh.build import build_mesh
from physics.scene import read_scene


def beam(**changes):
    """A clamped beam of 60 mm without load; keyword arguments replace or add top-level tables of the scene file."""
    table = {
        "body": {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [12, 4, 4]},
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
        "support": [{"where": "x-min", "fixed": "xyz"}],
        "steps": {"count": 20},
    }
    return read_scene(table | changes)


def pressed(**changes):
    """The same beam under a cylinder that moves down by 15 mm."""
    obstacle = {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.0305], [0.05, 0.01, 0.0155]]}
    return beam(**({"obstacle": obstacle} | changes))


def bent(**changes):
    """A beam of few hexahedra, clamped, bent by a traction at its end of 0.8 N in four steps."""
    body = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [3, 2, 2], "cell": "hexahedron"}
    return beam(**({"body": body, "load": [{"where": "x-max", "traction": [0.0, 0.0, -2e3]}], "steps": {"count": 4}} | changes))


def arch():
    """A shallow arch of eight cells under a load that it cannot bear: its scene, its mesh, and how far each node was raised (N,) [m]."""
    scene = beam(body={"length": 0.1, "width": 0.005, "height": 0.003, "cells": [8, 1, 2], "cell": "hexahedron"},
                 material={"law": "saint-venant-kirchhoff", "young_modulus": 1e6, "poisson_ratio": 0.0}, steps={"count": 10},
                 support=[{"where": "x-min z-min", "fixed": "xyz"}, {"where": "x-max z-min", "fixed": "xyz"}],
                 load=[{"acceleration": [0.0, 0.0, -100.0]}])
    mesh = build_mesh(scene.body)
    rise = 0.008 * np.sin(np.pi * mesh.points[:, 0] / 0.1)
    return scene, replace(mesh, points=mesh.points + np.outer(rise, [0, 0, 1])), rise
