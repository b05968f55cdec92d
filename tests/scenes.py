"""Scenes that several tests start from."""

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
