"""Bars of a few boxes of linear elasticity, away from the origin: for tests whose figures are worked out on paper."""

from dataclasses import replace

import numpy as np

from physics.mesh.build import build_mesh
from physics.scene import read_scene

HX, HY, HZ = 0.04, 0.03, 0.02  # edges of a box [m]: the median of all is 0.03
ORIGIN = np.array([1.0, -2.0, 3.0])
MATERIAL = {"young_modulus": 1000.0, "poisson_ratio": 0.25, "law": "linear"}
LAMBDA, MU = 400.0, 400.0  # E nu / ((1 + nu)(1 - 2 nu)), E / (2 (1 + nu))


def bar(boxes=3, **tables):
    """The scene of a bar of some boxes, its mesh away from the origin, and the box layer 0 .. boxes of each node's plane."""
    body = {"length": boxes * HX, "width": HY, "height": HZ, "cells": [boxes, 1, 1], "cell": "hexahedron"}
    scene = read_scene({"body": body, "material": MATERIAL, "support": [{"where": "x-min"}]} | tables)
    mesh = build_mesh(scene.body)
    plane = (mesh.points[:, 0] / HX).round().astype(int)
    return scene, replace(mesh, points=mesh.points + ORIGIN), plane


def node_at(mesh, place):
    """The node at a place (3,) in the bar's own frame."""
    return int(np.argmin(np.linalg.norm(mesh.points - ORIGIN - place, axis=1)))


def stress(strain):
    """Hooke's law for the displacement gradient e x + g y + h z along x, strain (e, g, h) in per cent."""
    e, g, h = 0.01 * np.asarray(strain, float)
    return np.array([[(LAMBDA + 2 * MU) * e, MU * g, MU * h], [MU * g, LAMBDA * e, 0], [MU * h, 0, LAMBDA * e]])
