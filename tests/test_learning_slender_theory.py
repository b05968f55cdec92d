"""Beam theory against closed forms of the textbooks."""

import pytest
import torch

from learning.slender.theory import Bar

LENGTH, WIDTH, HEIGHT, NU = 0.2, 0.03, 0.02, 0.3
EI, AREA = WIDTH * HEIGHT**3 / 12, WIDTH * HEIGHT  # E = 1
SHEAR = EI / (10 * 1.3 / (12 + 11 * 0.3) * AREA / 2.6)  # EI / (k G A), G = 1 / 2.6


def bar(both=False):
    return Bar(LENGTH, WIDTH, HEIGHT, NU, both)


def at(*values):
    return torch.tensor(values, dtype=torch.float64)


def test_the_tip_of_a_cantilever_goes_down_by_pl3_over_3ei_and_pl_over_kga():
    w, p = bar().bend(at(LENGTH), at(LENGTH))
    assert w.item() == pytest.approx(LENGTH**3 / 3 + LENGTH * SHEAR, rel=1e-12)
    assert p.item() == pytest.approx(LENGTH**2 / 2, rel=1e-12)


def test_beyond_the_force_a_cantilever_is_straight():
    a = 0.12
    w, p = bar().bend(at(a, 0.15, LENGTH), at(a))
    assert p.tolist() == pytest.approx([a**2 / 2] * 3, rel=1e-12)
    assert torch.diff(w).tolist() == pytest.approx([a**2 / 2 * 0.03, a**2 / 2 * 0.05], rel=1e-12)


def test_the_middle_of_a_beam_held_at_both_ends_goes_down_by_pl3_over_192ei_and_pl_over_4kga():
    w, p = bar(both=True).bend(at(LENGTH / 2), at(LENGTH / 2))
    assert w.item() == pytest.approx(LENGTH**3 / 192 + LENGTH / 4 * SHEAR, rel=1e-12)
    assert p.item() == pytest.approx(0, abs=1e-15)


def test_held_ends_neither_move_nor_turn_wherever_the_force_is():
    for both, ends in ((False, at(0.0)), (True, at(0.0, LENGTH))):
        for a in (0.03, 0.1, 0.17):
            w, p = bar(both).bend(ends, at(a))
            assert abs(w).max() < 1e-17 and abs(p).max() < 1e-16  # rounding of terms of 1e-3 and 1e-2


def test_the_deflection_at_one_place_under_a_force_at_another_is_that_the_other_way_round():
    for both in (False, True):  # Maxwell and Betti
        here, there = at(0.05), at(0.14)
        assert bar(both).bend(here, there)[0].item() == pytest.approx(bar(both).bend(there, here)[0].item(), rel=1e-12)


def test_the_deflection_under_the_force_is_that_of_the_whole_shape():
    a = torch.linspace(0.01, 0.19, 7, dtype=torch.float64)
    for both in (False, True):
        for short, long in zip(bar(both).own(a), bar(both).bend(a, a), strict=True):
            assert torch.allclose(short, long, rtol=1e-9, atol=1e-12)  # a cancels to a hundredth near a held end


def test_a_square_and_a_thin_strip_have_the_torsion_constants_of_the_tables():
    assert Bar(1.0, 0.02, 0.02, NU, False).torsion_constant == pytest.approx(0.1406 * 0.02**4, rel=3e-3)  # Roark's formula is that good
    assert Bar(1.0, 1.0, 0.001, NU, False).torsion_constant == pytest.approx(1e-9 / 3, rel=1e-3)
    assert Bar(1.0, 0.001, 1.0, NU, False).torsion_constant == pytest.approx(1e-9 / 3, rel=1e-3)


def test_a_torque_turns_a_cantilever_in_proportion_up_to_it_and_not_beyond():
    flexibility = EI * 2.6 / bar().torsion_constant
    assert bar().twist(at(0.04, 0.1, 0.2), at(0.1)).tolist() == pytest.approx([0.04 * flexibility, 0.1 * flexibility, 0.1 * flexibility])
    halves = bar(both=True).twist(at(0.0, 0.05, 0.1, 0.2), at(0.1)) / flexibility
    assert halves.tolist() == pytest.approx([0, 0.025, 0.05, 0])  # two springs side by side


def test_lying_on_its_side_a_beam_has_its_sides_exchanged():
    assert bar().lying == Bar(LENGTH, HEIGHT, WIDTH, NU, False)


def test_an_axis_is_drawn_in_by_half_the_integral_of_its_squared_slope():
    x = torch.linspace(0, LENGTH, 401, dtype=torch.float64)
    w = x[None] ** 2  # slope 2 x: the integral of 2 x^2 is 2 x^3 / 3
    assert bar().drawn_in(x, w)[0, -1].item() == pytest.approx(2 * LENGTH**3 / 3, rel=1e-5)  # straight pieces: 1 / (4 n^2)
    held = bar(both=True).drawn_in(x, w)[0]
    assert held[0] == held[-1] == 0
    assert held[200].item() == pytest.approx(2 * 0.1**3 / 3 - LENGTH**3 / 3, rel=1e-4)
