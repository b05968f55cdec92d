"""A beam pressed by a rigid obstacle, solved by finite elements: for tests of what is held against it."""

from functools import cache

from datagen.sets.generate import trajectory_of
from physics.scene import read_scene

SCENE = {
    "body": {"shape": "beam", "length": 0.1, "width": 0.02, "height": 0.02, "cells": [10, 3, 3], "cell": "prism"},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
    "support": [{"where": "x-min"}],
    "obstacle": {"shape": "cylinder", "radius": 0.01, "axis": [0.1, 1, 0],
                 "path": [[0.08, 0.01, 0.0305], [0.08, 0.011, 0.02]]},
    "steps": {"count": 10},
}


@cache
def pressed(depth=0.01, cell="prism", law="neo-hookean"):
    """A cantilever's trajectory of 10 steps, pressed by `depth` [m] near its free end; the first half millimetre is a gap."""
    scene = {**SCENE, "body": {**SCENE["body"], "cell": cell}, "material": {**SCENE["material"], "law": law},
             "obstacle": {**SCENE["obstacle"], "path": [[0.08, 0.01, 0.0305], [0.08, 0.011, 0.03 - depth]]}}
    return trajectory_of(read_scene(scene))
