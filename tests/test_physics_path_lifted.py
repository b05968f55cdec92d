"""A body from which the obstacle lifts off and that is pressed again: between it is at rest, and the second time is as the first."""

from dataclasses import replace

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.scene import read_scene
from physics.solution import solve
from tests.scenes import beam

UNDER = {"material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 40}}
SMALL = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [6, 2, 2], "cell": "hexahedron"}


def twice(shape, at, high, low, **more):
    """Down, up, down and up again."""
    there, back = [*at, high], [*at, low]
    return {"shape": shape, "path": [there, back, there, back, there], **more}


def on_a_block():
    return read_scene({**UNDER, "body": {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [3, 3, 3]},
                       "support": [{"where": "z-min", "fixed": "xyz"}],
                       "obstacle": twice("half-space", [0.0, 0.0], 0.021, 0.012, normal=[0.0, 0.0, -1.0])})


CASES = {
    "bent": beam(**UNDER, body=SMALL, obstacle=twice("cylinder", [0.05, 0.01], 0.0315, 0.0155, radius=0.01)),
    "soft": beam(**{**UNDER, "material": {"young_modulus": 1e3, "poisson_ratio": 0.49}}, body=SMALL,
                 obstacle=twice("cylinder", [0.05, 0.01], 0.0315, 0.0205, radius=0.01)),
    "thin": beam(**UNDER, body={"length": 0.1, "width": 0.02, "height": 0.002, "cells": [10, 2, 1]},
                 obstacle=twice("sphere", [0.09, 0.01], 0.013, -0.02, radius=0.01)),
    "squeezed": on_a_block(),
    "in one step": beam(**{**UNDER, "steps": {"count": 4}}, body=SMALL,
                        obstacle=twice("cylinder", [0.05, 0.01], 0.0315, 0.0155, radius=0.01)),
}


@pytest.mark.parametrize("name", CASES)
def test_pressed_again_a_body_answers_as_at_first(name):
    same_twice(solve(CASES[name]))


@pytest.mark.slow
def test_an_arch_snaps_at_the_same_steps_each_time():
    """Pushed down at its crown it snaps aside, to either side; let go it snaps back. Both times it is noticed at once."""
    scene = beam(**{**UNDER, "steps": {"count": 80}},
                 body={"length": 0.1, "width": 0.005, "height": 0.002, "cells": [30, 1, 2], "cell": "hexahedron"},
                 support=[{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "xyz"}],
                 obstacle=twice("cylinder", [0.05, 0.0025], 0.0095, -0.006, radius=0.001))
    mesh = build_mesh(scene.body)
    rise = 0.003 * (1 - np.cos(2 * np.pi * mesh.points[:, 0] / 0.1))
    ours = solve(scene, mesh=replace(mesh, points=mesh.points + np.outer(rise, [0, 0, 1])))
    at_rest_between(ours)
    steps = np.flatnonzero(ours.snap)
    assert len(steps) == 4 and (steps[2:] == steps[:2] + 40).all()
    assert abs(ours.energy[1:41] - ours.energy[41:]).max() < 1e-5 * ours.energy.max()


def same_twice(ours):
    """Each half of the path, of which the second begins and ends at rest, is the other one again."""
    at_rest_between(ours)
    first, second = np.split(ours.displacement[1:], 2)
    size, force = abs(first).max(), abs(ours.reaction).max()
    assert not ours.snap.any() and force > 0 and size > 1e-3
    # Equations are solved to 1e-6 of the reaction, which bending makes a few times as much of; from either side they are met anew.
    assert abs(first - second).max() < 1e-5 * size
    assert abs(np.subtract(*np.split(ours.reaction[1:], 2))).max() < 1e-5 * force


def at_rest_between(ours):
    half = len(ours.displacement) // 2
    for rest in (half, 2 * half):
        assert abs(ours.displacement[rest]).max() < 1e-9 * abs(ours.displacement).max() and not ours.reaction[rest].any()
