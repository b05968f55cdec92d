"""What the network is shown, number by number from its definition, of single poses and sections; and where its answer is laid on."""

import math

import numpy as np
import pytest
import torch

from learning.slender.beam import see
from learning.slender.features import look, obstacle_of, shown
from learning.slender.theory import Bar
from learning.slender.touch import Indenter, press
from tests.slender import scene

SPHERE = {"cells": (20, 5, 4), "path": ((0.08, 0.0125, 0.036), (0.081, 0.0147, 0.022))}
CYLINDER = {"support": ("x-min", "x-max"), "path": ((0.04, 0.012, 0.036), (0.041, 0.0125, 0.026)),
            "obstacle": {"shape": "cylinder", "radius": 0.012, "axis": [0.2, 1, 0]}, "material": {"law": "saint-venant-kirchhoff"}}
MIRRORED = {"cells": (20, 5, 4), "path": ((0.08, 0.0105, -0.012), (0.081, 0.0105, 0.002))}  # from below, on the other side of the middle
CASES = {"sphere": SPHERE, "cylinder": CYLINDER, "from below": MIRRORED}


def frac(value):
    return value - math.trunc(value)


def pose(beam, bar, obstacle, centre, bent):
    """One pose: the body's and the obstacle's proportions, places, sizes of what theory says, phases of the touch."""
    length, width, height = beam.extent
    ball = 1.0 if beam.round else 0.0
    b = {name: float(value[0]) for name, value in vars(bent).items() if value.ndim == 1}
    cell, row, a, side = length / beam.cells[0], beam.row, b["touch"], float(centre[1]) * ball
    depth = b["depth"] + 1e-6 * length
    force = b["force"] * (width * height**3 / 12) / height**2
    at = torch.tensor(a, dtype=torch.float64)
    angle = b["force"] * side * float(bar.twist(at, at))
    sideways = Bar(length, height, width, beam.poisson_ratio, beam.held_at_both)
    lying = float(sideways.bend(at, at)[0]) * (height / width) ** 2 * b["force"]  # I / I' = w h^3 / (h w^3)
    nodes = float(obstacle.nodes) * ball
    rows, aside = 2 * a / cell, (side - nodes) / row
    sag_along = (cell / 2 * abs(frac(rows + 0.5) - 0.5)) ** 2 / (2 * float(obstacle.radius))
    sag_across = (row * abs(frac(aside + 0.5) - 0.5)) ** 2 / (2 * float(obstacle.radius))
    tanh, r, turn = math.tanh, float(obstacle.radius), float(obstacle.turn)
    found = [math.log(length / height), width / height, r / height, 1.0 if beam.held_at_both else 0.0, ball, turn, beam.cells[1],
             beam.cells[2], math.log(cell / height), beam.diagonal, beam.diagonal if beam.cells[1] % 2 else 0, row / height, row / (2 * r),
             nodes / width, float(obstacle.first) * ball, beam.poisson_ratio, 1.0 if beam.neo_hookean else 0.0,
             float(centre[0]) / length, a / length, a / height, (length - a) / height, side / width, side / height, aside * ball,
             b["depth"] / length, b["depth"] / height, math.sqrt(b["depth"] / height), force, math.sqrt(force),
             b["indentation"] / height, b["indentation"] / depth, b["slope"], b["slope"] ** 2, 2 * b["width"] / cell,
             b["width"] / row * ball, angle, lying * ball / height, tanh(angle * lying / height), side / r,
             turn * b["slope"], turn * side / width, side * b["slope"] / width,
             b["lean"], tanh(b["pull"]), tanh(b["pull"] / 4), tanh(b["hold"]), tanh(b["hold"] / 4), b["lies"], tanh(b["groove"]),
             1.0 if b["groove"] != 0 else 0.0, tanh(b["torn"]), sag_along / max(depth, 1e-3 * height), sag_across * ball / height]
    for waves in (0.5, 1, 2):
        found += [math.sin(2 * math.pi * waves * rows), math.cos(2 * math.pi * waves * rows),
                  math.sin(2 * math.pi * waves * b["lies"]) * ball, math.cos(2 * math.pi * waves * b["lies"]) * ball]
    return found


def section(beam, obstacle, centre, bent, s):
    """One section at one pose."""
    length, _, height = beam.extent
    x, deflection, rotation, drawn = (float(each) for each in (beam.x[s], bent.deflection[0, s], bent.rotation[0, s], bent.drawn_in[0, s]))
    push, off = float(bent.push[0]) + 1e-6 * length, (beam.x[s] - float(bent.touch[0])) / height
    under = (x - drawn - float(centre[0])) / float(obstacle.radius)
    return [x / length, deflection / push, rotation * length / push, rotation, drawn * length / push**2, math.exp(-x / height),
            math.exp(-3 * x / height), math.exp((x - length) / height), math.exp(3 * (x - length) / height), math.tanh(off),
            math.tanh(off / 3), math.sqrt(max(1 - under**2, 1e-30)), math.exp(-(off / 0.25) ** 2), math.exp(-(off / 0.6) ** 2),
            math.exp(-(off / 1.5) ** 2)]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("fraction", [0.1, 0.4, 0.9])
def test_every_number_that_is_shown_is_that_of_its_definition(name, fraction):
    beam = see(scene(**CASES[name]))
    bar, obstacle = Bar(*beam.extent, beam.poisson_ratio, beam.held_at_both), obstacle_of(beam)
    centre = torch.as_tensor(beam.start + fraction * (beam.end - beam.start))[None]
    assert beam.diagonal == (name == "from below")  # turned twice: by the four cells up and the five across
    bent, seen = press(torch.as_tensor(beam.x), centre, obstacle, bar), shown(beam, np.array([fraction]))
    assert seen.pose[0].tolist() == pytest.approx(pose(beam, bar, obstacle, centre[0], bent), rel=1e-9, abs=1e-13)
    for s in (0, 1, 7, 16, 20):
        assert seen.section[0, s].tolist() == pytest.approx(section(beam, obstacle, centre[0], bent, s), rel=1e-9, abs=1e-14)
    # Units are the depth times an envelope that is 0 at a held end and 1/2 at half a height from it.
    length, height = beam.extent[0], beam.extent[2]
    for s in (0, 1, 7, 20):
        x = float(beam.x[s])
        wanted = x / (x + height / 2) * ((length - x) / (length - x + height / 2) if beam.held_at_both else 1)
        assert float(seen.unit[0, s]) == pytest.approx(float(bent.depth) * wanted, abs=1e-18)
    assert torch.equal(seen.depth, bent.depth) and torch.equal(seen.jumps, bent.jumps)
    # EI = 1 in theory: F / E is F in its units times the second moment w h^3 / 12.
    assert float(seen.force) == pytest.approx(float(bent.force) * beam.extent[1] * height**3 / 12, rel=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_the_base_is_that_of_plane_sections_that_bend_and_twist(name):
    """The place of each node of a section, x y z from its middle: turned about y by the rotation, about x by the twist, and moved."""
    one = scene(**CASES[name])
    beam = see(one)
    centre = torch.as_tensor(beam.centre(np.array([0.8])))
    bent = press(torch.as_tensor(beam.x), centre, obstacle_of(beam), Bar(*beam.extent, beam.poisson_ratio, beam.held_at_both))
    base = look(beam, centre).base.numpy()
    nodes = beam.nodes(base)[0].reshape(21, -1, 3)[:, :, [0, beam.side, beam.up]] * np.array(beam.signs)
    if beam.signs[0] < 0:
        nodes = nodes[::-1]
    y, z = (np.linspace(-0.5, 0.5, n + 1) * side * sign for n, side, sign in zip(beam.cells[1:], beam.extent[1:], beam.signs[1:],
                                                                                                      strict=True))
    y, z = (each.ravel() for each in np.meshgrid(y, z, indexing="ij" if beam.side == 1 else "xy"))
    for s in range(21):
        q, f = float(bent.rotation[0, s]), float(bent.turn[0, s])
        wanted = np.stack([z * math.sin(q) - float(bent.drawn_in[0, s]), float(bent.aside[0, s]) + z * math.sin(f),
                           -float(bent.deflection[0, s]) - z * (1 - math.cos(q)) - y * math.sin(f)], axis=1)
        np.testing.assert_allclose(nodes[s], wanted, atol=1e-15)
    assert float(abs(bent.turn).max()) > 1e-4 and float(abs(bent.rotation).max()) > 0.01


def test_an_obstacle_is_told_by_where_it_first_touches_in_its_groove():
    """Of five cells of 22 mm rows lie 2.2 mm apart and nodes at 2.2 and 6.6 mm from the middle; it touches 1.5 + 2.2/14 mm beside it."""
    beam = see(scene(**SPHERE))
    told = obstacle_of(beam)
    touched = 1.5e-3 + (0.036 - 0.034) / 0.014 * 2.2e-3
    assert told == Indenter(0.01, True, 0.0, told.first, beam.row, told.nodes)
    assert (told.nodes, told.first, told.row) == (pytest.approx(2.2e-3), pytest.approx((touched - 2.2e-3) / 2.2e-3), pytest.approx(2.2e-3))
    cylinder = obstacle_of(see(scene(**CYLINDER)))
    assert cylinder.turn == pytest.approx(math.atan(0.2)) and cylinder.radius == 0.012 and not cylinder.round


def test_many_paths_are_seen_as_each_of_them_alone():
    beam = see(scene(**SPHERE))
    centres = torch.as_tensor(beam.centre(np.array([0.2, 0.5, 0.9])))
    one, told = look(beam, centres), obstacle_of(beam)
    each = Indenter(torch.full((3,), told.radius, dtype=torch.float64), True, torch.zeros(3, dtype=torch.float64),
                    torch.full((3,), told.first, dtype=torch.float64), told.row, torch.full((3,), told.nodes, dtype=torch.float64))
    other = look(beam, centres, each)
    for name, value in vars(one).items():
        assert torch.allclose(value.double(), getattr(other, name).double(), rtol=1e-12), name
