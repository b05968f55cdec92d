"""Scenes drawn at random, of every shape, cell, law, support and load: held against plain full Newton on the same mesh, or slow motion."""

from dataclasses import replace

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.mesh.quality import smallest_det_f
from physics.scene import Steps, read_scene
from physics.schema import InputError
from physics.solution import solve
from tests import plain_motion, plain_newton


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


# In 12 steps plain Newton leaves the path of equilibria of scene 9 for another one; in 48 it does not.
FINER = {9: 48}
# At the first step of scene 34 the capsule barely touches: on some processors rounding leaves plain Newton more than 1e-8 of that force.
ROUGHER = {34: 3e-8}
# Plain Newton ends where a sphere has pressed a body to half of its volume (11) and where one slips off a capsule (39).
MOVED = (11, 39)
# What has no answer: 0 and 26, of the law of Saint-Venant and Kirchhoff, and 7, whose sphere could pass between the nodes.
SEEDS = sorted(set(range(40)) - {0, 7, 26, *MOVED})


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_random_scene(seed):
    scene = draw(seed)
    ours, finer = solve(scene), replace(scene, steps=Steps(count=FINER.get(seed, 12)))
    agree(scene, ours, plain_newton.solve(finer, tolerance=ROUGHER.get(seed, 1e-8))[-1])


@pytest.mark.slow
@pytest.mark.parametrize("seed", MOVED)
def test_random_scene_in_which_plain_newton_finds_nothing_ends_where_slow_motion_does(seed):
    scene = draw(seed)
    ours = solve(scene)
    agree(scene, ours, plain_motion.solve(scene)[-1])
    assert plain_motion.softest(Balance(scene, ours.mesh), ours.displacement[-1], 1.0) > 0


def test_the_random_scene_that_is_refused_could_not_be_seen_by_its_nodes():
    with pytest.raises(InputError, match="0.0121 m wide, it could pass between nodes 0.015 m apart"):
        solve(draw(7))


@pytest.mark.slow
def test_random_scene_that_ends_early_does_so_by_its_law():
    """Left to itself one step further, the body comes to rest with cells inside out; with another law it goes on to the end."""
    scene = draw(0)
    ours = solve(scene, partial=True)
    reached = len(ours.displacement) - 1
    assert reached == 7 and ours.failure.endswith("pressed so hard; a neo-hookean law does not")
    frames = plain_newton.solve(scene, tolerance=1e-8, steps=reached)
    assert abs(ours.displacement - frames).max() < 1e-4 * abs(frames).max()  # near the end of the path little force moves it far
    further = plain_motion.settle(Balance(scene, ours.mesh), frames[-1], (reached + 1) / 12)
    assert smallest_det_f(ours.mesh.points, further, ours.mesh.cells, ours.mesh.cell) < -1
    agree(other := scene.under("neo-hookean"), solve(other), plain_newton.solve(other, tolerance=1e-8)[-1])


@pytest.mark.slow
def test_random_scene_with_cells_inside_out_is_right_before_that_and_says_so():
    scene = draw(26)
    ours = solve(scene, tolerance=1e-8)  # so soft that 1e-6 of the reaction moves it
    inverted = int(np.argmax(ours.smallest_det_f <= 0))
    assert f"at step {inverted} a cell is turned inside out" in ours.model["inside out"]
    agree(scene, ours, plain_newton.solve(scene, tolerance=1e-8, steps=inverted - 1)[-1], inverted - 1)
    other = solve(scene.under("neo-hookean"))
    assert other.smallest_det_f.min() > 0 and "inside out" not in other.model


def agree(scene, ours, found, step=12):
    """Both end in the same state (N, 3), to what their equations are solved to, 1e-6 of the reaction: a soft body makes more of it."""
    assert not ours.failure
    assert abs(ours.displacement[step] - found).max() < 1e-5 * abs(found).max()
    reaction = -plain_newton.contact_force(Balance(scene, ours.mesh), found, step / 12).sum(axis=0)
    assert np.linalg.norm(ours.reaction[step] - reaction) <= 1e-5 * np.linalg.norm(reaction)
