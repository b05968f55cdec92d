"""How an obstacle meets a beam, in cases that can be worked out by hand."""

import math

import pytest
import torch

from learning.slender.theory import Bar
from learning.slender.touch import Indenter, groove_law, held, press

BAR = Bar(0.2, 0.03, 0.02, 0.3, False)
X = torch.linspace(0, 0.2, 41, dtype=torch.float64)


def pressed(obstacle, *, across=0.0, depth=1e-4, along=0.15, bar=BAR):
    centre = torch.tensor([[along, across, obstacle.radius + bar.height / 2 - depth]], dtype=torch.float64)
    return press(X, centre, obstacle, bar)


def test_the_touched_place_goes_down_by_the_depth_less_the_indentation():
    for obstacle in (Indenter(0.01, True, first=0.4, row=0.003), Indenter(0.01, False)):
        bent = pressed(obstacle)
        assert bent.depth.item() == pytest.approx(1e-4)
        # the iteration halves what it is off by, eight times; the beam turns by 1e-3, which lifts the touch by 1e-8 m
        assert bent.push.item() == pytest.approx(1e-4 - bent.indentation.item(), rel=5e-3)
        at = int(abs(X - bent.touch).argmin())
        assert bent.deflection[0, at].item() == pytest.approx(bent.push.item(), rel=0.02)  # the nearest section is up to 2.5 mm away


def test_a_sphere_sinks_in_as_hertz_says_halved_and_a_cylinder_as_a_column_would():
    sphere, cylinder = pressed(Indenter(0.01, True, first=0.4, row=0.003)), pressed(Indenter(0.01, False))
    for bent, asked in ((sphere, lambda f: 0.5 * (0.75 * f / math.sqrt(0.01)) ** (2 / 3)), (cylinder, lambda f: f / 0.03)):
        assert bent.indentation.item() == pytest.approx(asked(0.91 * bent.force.item() * BAR.second_moment), rel=0.02)


def test_where_nothing_touches_nothing_moves():
    for obstacle in (Indenter(0.01, True, first=0.4, row=0.003), Indenter(0.01, False, turn=0.2)):
        bent = pressed(obstacle, depth=-1e-3)
        for name in ("depth", "push", "force", "deflection", "rotation", "drawn_in", "aside", "turn"):
            assert not getattr(bent, name).any(), name


def test_a_turned_cylinder_lies_flat_on_the_beam_and_pushes_it_aside():
    turn = 0.2
    bent = pressed(Indenter(0.01, False, turn), depth=0.01)
    slope = bent.slope
    at = int(abs(X - bent.touch).argmin())
    # the cylinder's axis (sin g, cos g, 0) lies in the face that cos q (1, 0, 0) - sin q (0, 0, 1) and (0, cos f, -sin f) span
    face = torch.stack([torch.tensor([math.cos(slope), 0, -math.sin(slope)]),
                        torch.tensor([0, math.cos(bent.turn[0, -1]), -math.sin(bent.turn[0, -1])]),
                        torch.tensor([math.sin(turn), math.cos(turn), 0])])
    assert abs(torch.linalg.det(face).item()) < 1e-6
    ratio = bent.aside[0, at] / bent.deflection[0, at]
    stiffer = (BAR.height / BAR.width) ** 2  # to the side the beam is (w / h)^2 times as stiff; shear adds a per cent to either
    assert ratio.item() == pytest.approx(math.tan(slope) * math.tan(turn) * stiffer, rel=0.03)
    straight = pressed(Indenter(0.01, False), depth=0.01)
    assert not straight.aside.any() and not straight.turn.any()


def test_a_sphere_over_the_middle_of_a_groove_in_the_middle_of_a_beam_moves_nothing_aside():
    bent = pressed(Indenter(0.02, True, row=0.0005), depth=0.005)  # so wide a touch that it feels ridges alone
    assert bent.width.item() > 0.0005
    assert not bent.aside.any() and not bent.turn.any() and not bent.lean.any()


def test_a_narrow_touch_holds_the_beam_where_it_lies_in_its_groove():
    obstacle = Indenter(0.01, True, first=0.4, row=0.003)
    bent = pressed(obstacle, across=0.4 * 0.003, depth=0.002)
    at = int(abs(X - bent.touch).argmin())
    # e - y - H f is z in distances of rows; the section nearest to the touch is up to 2.5 mm away
    under = (0.4 * 0.003 - bent.aside[0, at] - (0.01 + BAR.height / 2) * bent.turn[0, at]) / 0.003
    assert bent.width.item() < 0.35 * 0.003 and bent.groove == 0
    assert under.item() == pytest.approx(bent.lies.item(), abs=0.01)
    assert bent.lean.item() == pytest.approx(15 * (bent.lies.item() - 0.48), rel=1e-6)


def test_a_mirrored_press_gives_the_mirrored_answer():
    here = pressed(Indenter(0.01, True, first=0.4, row=0.003), across=0.002, depth=0.01)
    there = pressed(Indenter(0.01, True, first=-0.4, row=0.003), across=-0.002, depth=0.01)
    assert torch.equal(here.deflection, there.deflection)
    for name in ("aside", "turn", "lean", "pull", "lies"):
        assert torch.allclose(getattr(here, name), -getattr(there, name), rtol=1e-12, atol=1e-18) and getattr(here, name).any(), name


def solved(pull, hold, width, first=0.5):
    """m / M, place, grooves moved and whether at a jump, for one pose each."""
    given = [torch.tensor(each, dtype=torch.float64) for each in (pull, hold, width)]
    return [each.tolist() for each in held(*given, first)]


def law(z, width):
    """The law of a groove in a plain form."""
    steep, start = (float(each) for each in groove_law(torch.tensor([width], dtype=torch.float64)))
    return math.copysign(1, z) * min(max(steep * (abs(z) - start), -2 * abs(z)), 2 * (1 - abs(z)))


def test_where_a_sphere_lies_is_in_equilibrium_with_the_law_of_its_groove():
    for width in (0.3, 0.5, 0.75, 1.1, 2.0):
        for hold in (0.05, 0.3, 0.7, 2.0):
            for pull in (-0.9, -0.45, 0.05, 0.3, 0.6, 0.95):
                for first in (-0.5, 0.5):
                    (m,), (z,), (moved,), _ = solved([pull], [hold], [width], first)
                    assert -1 <= z <= 1 and moved == 0
                    if abs(z) < 1:
                        assert m == pytest.approx(law(z, width), abs=1e-9)
                        assert z == pytest.approx(pull - hold * m, abs=1e-9), (width, hold, pull, first)


def test_a_wide_touch_lies_where_a_spring_would_hold_it_until_a_ridge_is_passed():
    # from 0.95 to 1.4 rows k is 2.4 to 2.6 and g is 0: the law's knee is at 2 / (2 + k)
    m, z, moved, jumped = solved([0.5, 1.3, 2.1], [1.0, 1.0, 1.0], [0.95] * 3)
    assert z[0] == pytest.approx(0.5 / 3.4) and m[0] == pytest.approx(2.4 * 0.5 / 3.4) and moved[0] == 0
    assert z[1] == pytest.approx(1.3 / 3.4) and moved[1] == 0  # held up to 2 / 4.4 + 2 x 2.4 / 4.4 = 1.545
    assert z[2] == pytest.approx(0.1 / 3.4) and moved[2] == 1  # beyond it lies in the next groove, two rows on
    assert jumped == [False, False, True]
    assert solved([0.2, -0.6], [0.8, 0.8], [0.3] * 2)[3] == [False, True]  # a narrow touch across the nodes' row
    assert solved([-0.6], [0.1], [0.3])[3] == [False]  # a stiff beam follows


def test_the_law_of_a_groove_is_that_of_its_table():
    steep, start = groove_law(torch.tensor([0.0, 0.35, 0.40, 0.85, 9.0], dtype=torch.float64))
    assert steep.tolist() == pytest.approx([15, 15, 12.5, 2.8, 1]) and start.tolist() == pytest.approx([0.48, 0.48, 0.465, 0.18, 0])
