"""What is seen of a scene of a beam, number by number, and exactly where a scene stops to be one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from learning.slender.beam import see
from physics.scene import Steps, Support
from physics.schema import InputError
from tests.slender import scene

BOTH = ("x-min", "x-max")


def cylinder(*axis):
    return {"shape": "cylinder", "radius": 0.012, "axis": list(axis)}


def test_a_beam_is_told_by_its_scene():
    """Pressed on y-min from x-max's end: the frame's x is 0.1 m less x, its z is 12 mm less y as the obstacle moves up along y."""
    beam = see(scene(support=["x-max"], cells=(20, 6, 4), sides=(0.1, 0.024, 0.022), path=((0.03, -0.013, 0.012), (0.02, 0.002, 0.0125)),
                     material={"poisson_ratio": 0.3, "law": "linear"}, obstacle={"radius": 0.011}))
    assert (beam.extent, beam.cells, beam.side, beam.up, beam.signs) == ((0.1, 0.022, 0.024), (20, 4, 6), 2, 1, (-1, 1, -1))
    assert (beam.held_at_both, beam.poisson_ratio, beam.neo_hookean, beam.radius, beam.round, beam.turn) == (
        False, 0.3, False, 0.011, True, 0.0)
    assert beam.start == pytest.approx([0.07, 0.001, 0.025]) and beam.end == pytest.approx([0.08, 0.0015, 0.01])
    assert beam.x == pytest.approx(0.005 * np.arange(21)) and beam.row == pytest.approx(0.00275)
    assert beam.centre([0.0, 0.5, 1.0]) == pytest.approx(np.array([[0.07, 0.001, 0.025], [0.075, 0.00125, 0.0175], [0.08, 0.0015, 0.01]]))
    assert beam.spread == pytest.approx((0.011 * math.sqrt(2.5 / 5), 0.012 * math.sqrt(28 / 9 / 7)))  # at 1, 1/2, 0, and 1, 2/3, 1/3, 0
    assert see(scene()).neo_hookean and not see(scene(material={"law": "saint-venant-kirchhoff"})).neo_hookean


@pytest.mark.parametrize("start, end, x", [(0.04, 0.05, (0.04, 0.05)), (0.046875, 0.053125, (0.046875, 0.053125)),
                                           (0.0532, 0.0468, (0.0532, 0.0468)), (0.045, 0.056, (0.055, 0.044))])
def test_held_at_both_ends_it_is_seen_from_the_nearer_one(start, end, x):
    """Nearer to the middle of the obstacle's path, x = 0 where that is half way."""
    beam = see(scene(support=BOTH, path=((start, 0.012, 0.036), (end, 0.0125, 0.022))))
    assert beam.held_at_both and beam.signs == (1 if x[0] == start else -1, 1, 1)
    assert (beam.start[0], beam.end[0]) == pytest.approx(x)


def test_a_sphere_on_the_other_side_of_the_middle_is_seen_in_a_mirror_one_over_it_is_not():
    """The end of its path counts. 11 mm is the middle."""
    for across, sign in ((0.0109, -1), (0.011, 1), (0.0111, 1)):
        beam = see(scene(path=((0.08, 0.012, 0.036), (0.08, across, 0.022))))
        assert beam.signs == (1, sign, 1) and beam.start == pytest.approx([0.08, sign * 0.001, 0.024])
        assert beam.end == pytest.approx([0.08, abs(across - 0.011), 0.01]) and beam.turn == 0
    straight = see(scene(path=((0.08, 0.01, 0.036), (0.08, 0.01, 0.022)), obstacle=cylinder(0, 1, 0)))
    assert straight.signs == (1, 1, 1) and straight.end[1] == pytest.approx(-0.001) and not straight.round  # across, it is long


def test_it_presses_on_the_face_towards_which_it_moves_most_on_z_where_it_moves_alike():
    square = {"sides": (0.1, 0.024, 0.024), "cells": (20, 4, 4)}
    assert see(scene(path=((0.08, 0.03, 0.04), (0.08, 0.02, 0.03)), **square)).up == 2
    assert see(scene(path=((0.08, 0.031, 0.04), (0.08, 0.02, 0.03)), **square)).up == 1
    assert see(scene(path=((0.0625, 0.012, 0.0625), (0.09375, 0.012, 0.03125)))).up == 2  # as far along as down
    with pytest.raises(InputError, match="moves along the beam rather than onto it"):
        see(scene(path=((0.0625, 0.012, 0.0625), (0.09376, 0.012, 0.03125))))


def test_a_cylinder_lies_across_the_beam_by_sixty_degrees_and_in_its_face_by_a_millionth():
    path = ((0.08, 0.011, 0.036), (0.08, 0.011, 0.03))
    assert see(scene(path=path, obstacle=cylinder(-0.57, 1, 0))).turn == pytest.approx(math.atan(0.57))  # tan 30 is 0.577
    for axis, said in (((0.58, 1, 0), "lies along the beam"), ((0, 1, 1.1e-6), "does not lie in the face"),
                       ((0, 1, -1.1e-6), "does not lie in the face"), ((0.5, 0, 1), "does not lie in the face")):
        with pytest.raises(InputError, match=said):
            see(scene(path=path, obstacle=cylinder(*axis)))
    assert see(scene(path=path, obstacle=cylinder(0, 1, 0.9e-6))).turn == 0
    aside = see(scene(path=((0.08, 0.036, 0.012), (0.08, 0.03, 0.012)), obstacle=cylinder(0.2, 0, 0.4)))
    assert (aside.side, aside.up) == (2, 1) and aside.turn == pytest.approx(math.atan(0.5))


@pytest.mark.parametrize("changes, said", [
    ({"cells": (20, 4, 1)}, "fewer than two cells across"), ({"body": {"element": "reduced"}}, "first-order prisms"),
    ({"support": ["x-min", "y-min"]}, "not clamped at x-min"), ({"support": [], "obstacle": {"contact": "nodes"}}, "not clamped"),
    ({"obstacle": {"contact": "nodes"}}, "contact is not felt at facets"),
    ({"steps": "dynamic"}, "loads or inertia")])
def test_a_scene_is_refused_for_what_it_has_alone(changes, said):
    dynamic = {"steps": Steps(count=20, dynamic=True, duration=1.0)} if "steps" in changes else {}
    with pytest.raises(InputError, match=said):
        see(replace(scene(**({} if dynamic else changes)), **dynamic))
    assert see(scene(cells=(20, 2, 2))).cells == (20, 2, 2)


@pytest.mark.parametrize("support", [{"where": "x-min", "fixed": "xy"}, {"where": "x-min", "displacement": [0, 0, 1e-3]}])
def test_an_end_that_is_held_in_part_or_moved_is_not_clamped(support):
    with pytest.raises(InputError, match="not clamped"):
        see(replace(scene(), support=(Support(**support),)))
