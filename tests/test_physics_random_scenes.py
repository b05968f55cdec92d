"""Scenes drawn at random, of every shape, cell, law, support and load: held against plain full Newton on the same mesh."""

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.scene import read_scene
from physics.solution import solve
from tests import plain_newton


def draw(seed):
    random = np.random.default_rng(seed)
    number, one_of = random.uniform, random.choice
    length, width, height = number(0.06, 0.12), number(0.015, 0.025), number(0.015, 0.025)
    clamped = {"where": "x-min", "fixed": "xyz"}
    support = [[clamped], [clamped, {"where": "x-max", "fixed": "xyz"}], [{"where": "z-min", "fixed": "xyz"}],
               [clamped, {"where": "x-max", "fixed": "z", "displacement": [0, 0, number(-0.003, 0.003)]}]][random.integers(4)]
    depth = height * (number(0.2, 0.8) if len(support) == 1 and support[0] is clamped else number(0.1, 0.4))
    shape, radius = str(one_of(["sphere", "cylinder", "capsule", "box", "half-space"])), number(0.006, 0.015)
    obstacle = {"sphere": {"radius": radius}, "cylinder": {"radius": radius, "axis": [number(-0.3, 0.3), 1, 0]},
                "capsule": {"radius": radius, "axis": [number(-1, 1), number(-1, 1), 0], "length": number(0.005, 0.03)},
                "box": {"size": [number(0.01, 0.02), number(0.01, 0.02), 2 * radius]},
                "half-space": {"normal": [number(-0.02, 0.02), number(-0.02, 0.02), -1]}}[shape]
    above = radius + 0.001 + (0.02 * (length + width) - radius if shape == "half-space" else 0)  # a tilted plane is lowest at a corner
    centre = np.array([length * number(0.4, 0.9), width * number(0.35, 0.65), height + above])
    aside = [number(-0.004, 0.004), number(-0.002, 0.002), -0.001 - depth]
    contact = str(one_of(["facets", "nodes"], p=[0.8, 0.2]))
    obstacle |= {"shape": shape, "path": [centre.tolist(), (centre + aside).tolist()], "contact": contact}
    load = []
    if random.random() < 0.5:
        load.append({"acceleration": (random.normal(size=3) * 5).tolist()})
    if random.random() < 0.5:
        load.append({"where": str(one_of(["x-max", "y-max", "z-max"])), "traction": (random.normal(size=3) * 200).tolist()})
    return read_scene({
        "body": {"length": length, "width": width, "height": height, "cell": str(one_of(["prism", "tetrahedron", "hexahedron"])),
                 "cells": [int(random.integers(8, 14)), int(random.integers(2, 5)), int(random.integers(2, 5))]},
        "material": {"law": str(one_of(["neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff"])),
                     "young_modulus": 10 ** number(5.5, 6.5), "poisson_ratio": number(0.2, 0.45)},
        "support": support, "load": load, "obstacle": obstacle, "steps": {"count": 12}})


# Left out of the first 40: scene 7, refused because its sphere is thinner than its cells and contact is at nodes; 0, where the plane
# crushes a Saint-Venant-Kirchhoff body until there is no equilibrium; and where plain Newton finds none in 12 steps (6, 11, 18, 26,
# 27, 39) or leaves the path of equilibria for another one (9: in 48 steps it stays on ours).
SEEDS = sorted(set(range(40)) - {0, 6, 7, 9, 11, 18, 26, 27, 39})


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_random_scene(seed):
    scene = draw(seed)
    ours = solve(scene)
    assert not ours.failure
    plain = plain_newton.solve(scene, tolerance=1e-8)[-1]
    # Both solve their equations to 1e-6 of the reaction or better; a soft body turns that into some times as much of its displacement.
    assert abs(ours.displacement[-1] - plain).max() < 1e-5 * abs(plain).max()
    reaction = -plain_newton.contact_force(Balance(scene, ours.mesh), plain, 1.0).sum(axis=0)
    assert np.linalg.norm(ours.reaction[-1] - reaction) <= 1e-5 * np.linalg.norm(reaction)
