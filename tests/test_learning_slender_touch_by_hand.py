"""How an obstacle meets a beam, number by number: the module's equations in plain floats, and grooves by searching their law."""

import math

import numpy as np
import pytest
import torch

from learning.slender.theory import Bar
from learning.slender.touch import TORN, Indenter, first_touch, groove, groove_law, held, press, torn_apart

BARS = (Bar(0.2, 0.03, 0.02, 0.3, False), Bar(0.2, 0.03, 0.02, 0.3, True))
X = torch.tensor([0.0, 0.05, 0.14, 0.2], dtype=torch.float64)


def one(value):
    return torch.tensor(value, dtype=torch.float64)


@pytest.mark.parametrize("start, end, touched", [(0.036, 0.022, 1 / 7), (0.034, 0.022, 0.0), (0.03, 0.02, 0.0), (0.036, 0.034, 1.0),
                                                 (0.04, 0.0345, 1.0), (0.035, 0.036, 1.0), (0.036, 0.0335, 0.8)])
def test_an_obstacle_touches_where_it_has_come_down_by_its_gap(start, end, touched):
    """Its centre is 10 mm above the face, that 24 mm above the axis, when it does."""
    found = first_touch(one([0.08, 0.0, start]), one([0.08, 0.0, end]), 0.01, 0.048)
    assert found.item() == pytest.approx(touched, abs=1e-12)


@pytest.mark.parametrize("cells, beside, nodes", [(4, 0.0125, 0.012), (4, 0.0149, 0.012), (4, 0.0151, 0.018), (4, -0.001, 0.0),
                                                  (5, 0.0005, 0.003), (5, -0.0005, -0.003), (5, 0.0065, 0.009), (5, 0.0059, 0.003)])
def test_rows_of_nodes_lie_two_rows_apart_about_the_middle_or_beside_it(cells, beside, nodes):
    """Rows 3 mm apart: nodes of an even number of cells at 0, 6, 12 mm from the middle, of an odd one at 3, 9 mm."""
    start, end = one([0.0, beside - 0.002, 0.0]), one([0.0, beside + 0.006, 0.0])
    found = groove(start, end, one(0.25), 0.003, cells)
    assert [each.item() for each in found] == pytest.approx([beside, nodes], abs=1e-15)


def plain(bar, obstacle, centre):
    """Touch, push, slope, force, indentation of one pose: eight rounds, each half of the way where it says so."""
    x, _, z = centre
    arm, length = obstacle.radius + bar.height / 2, bar.length
    low, high = length / 1000, length * (0.999 if bar.held_at_both else 1.0)
    second, nu = bar.width * bar.height**3 / 12, bar.poisson_ratio

    def bounded(a):
        return min(max(a, low), high)

    a, q, indentation = bounded(x), 0.0, 0.0
    for _ in range(8):
        w, p = (each.item() for each in bar.bend(one(a), one(a)))
        push = max(arm * math.cos(q) - z - indentation, 0.0)
        force = push / w
        pressed = (1 - nu**2) * force * second  # F (1 - nu^2) / E with E I = 1
        asked = (0.75 * pressed / math.sqrt(obstacle.radius)) ** (2 / 3) / 2 if obstacle.round else pressed / bar.width
        indentation = min((indentation + asked) / 2, max(arm - z, 0.0) / 2)
        q = (q + math.atan(force * p)) / 2
        a = bounded(x - arm * math.sin(q) + (0.0 if bar.held_at_both else 0.6 * push**2 / a))
    return a, push, q, force, indentation


@pytest.mark.parametrize("bar", BARS, ids=["clamped", "at both ends"])
@pytest.mark.parametrize("obstacle", [Indenter(0.01, True, first=0.4, row=0.003), Indenter(0.015, True, first=-0.2, row=0.001, nodes=0.002),
                                      Indenter(0.012, False, 0.25)], ids=["sphere", "larger", "cylinder"])
@pytest.mark.parametrize("centre", [(0.15, 0.0015, 0.019), (0.06, -0.002, 0.0215), (0.3, 0.0, 0.018), (0.12, 0.001, 0.035)])
def test_one_pose_is_that_of_the_equations(bar, obstacle, centre):
    bent = press(X, one([centre]), obstacle, bar)
    a, push, q, force, indentation = plain(bar, obstacle, centre)
    told = [bent.touch, bent.push, bent.slope, bent.force, bent.indentation, bent.depth, bent.width]
    arm = obstacle.radius + 0.01
    wanted = [a, push, q, force, indentation, max(arm - centre[2], 0), math.sqrt(obstacle.radius * indentation)]
    assert [each.item() for each in told] == pytest.approx(wanted, rel=1e-9, abs=1e-15)
    sideways = Bar(bar.length, bar.height, bar.width, bar.poisson_ratio, bar.held_at_both)
    share = (bar.height / bar.width) ** 2  # I = w h^3 / 12 over that of the beam on its side
    at = one(a)
    aside, twist = sideways.bend(at, at)[0].item() * share, bar.twist(at, at).item()
    if obstacle.round:
        b, e, m_most = obstacle.row, centre[1], obstacle.row / (2 * obstacle.radius)
        m = bent.lean.item() * m_most
        H, T, B, F = arm, twist, aside, force
        angle = T * F * (e + m * (H - B * F)) / (1 + T * F * (H - B * F))
        moved = B * F * (m - angle)
        # z = Z - C m, from the nodes of the groove in which it lies
        under = (e - moved - H * angle - obstacle.nodes) / b - 2 * bent.groove.item()
        if abs(bent.lies.item()) < 1 and push:
            assert bent.lies.item() == pytest.approx(under, abs=1e-8)
            assert bent.pull.item() - bent.hold.item() * bent.lean.item() == pytest.approx(under, abs=1e-8)
        side_force, torque = F * (m - angle), angle / T
    else:
        lean = math.tan(q) * math.tan(0.25)
        assert bent.lean.item() == pytest.approx(lean) and not (bent.pull + bent.hold + bent.lies + bent.groove).any() and not bent.jumps
        side_force, torque = force * lean, -math.atan(lean) / twist
    w, p = bar.bend(X, at)
    for found, expected in ((bent.deflection, force * w), (bent.rotation, torch.atan(force * p)), (bent.turn, torque * bar.twist(X, at)),
                            (bent.aside, side_force * share * sideways.bend(X, at)[0]), (bent.drawn_in, bar.drawn_in(X, force * w[None]))):
        np.testing.assert_allclose(found[0], expected.reshape(-1), rtol=1e-7, atol=1e-15)


def law(z, steep, start):
    """m / M at places z in [0, 1], plainly."""
    return np.minimum(np.maximum(steep * (z - start), -2 * z), 2 * (1 - z))


@pytest.mark.parametrize("width", [0.2, 0.5, 0.8, 1.2, 2.5])
@pytest.mark.parametrize("hold", [0.1, 0.45, 0.8, 3.0])
def test_a_groove_is_left_for_the_next_one_when_no_place_in_it_can_hold_the_pull(width, hold):
    """What a groove can hold is the largest z + hold m(z), found by trying; the next groove's nodes are two rows on."""
    steep, start = (each.item() for each in groove_law(one([width])))
    z = np.linspace(0, 1, 200_001)
    highest = (z + hold * law(z, steep, start)).max()
    for moved in (0, 1, 2, -1, -3):
        for pull in (2 * abs(moved) + highest - 1e-4, 2 * (abs(moved) - 1) + highest + 1e-4 if moved else 0.3 * highest):
            sign = -1 if moved < 0 else 1
            lean, lies, found, jumped = (each.item() for each in held(one([sign * pull]), one([hold]), one([width]), 0.5 * sign))
            assert found == moved
            if abs(lies) < 1:  # in equilibrium in that groove
                assert lies == pytest.approx(sign * pull - 2 * found - hold * lean, abs=1e-8)
                assert abs(lean) == pytest.approx(abs(law(abs(lies), steep, start)), abs=1e-8)
            if moved:
                assert bool(jumped) == (hold >= 0.5)  # a stiffer beam follows without a jump


def test_a_soft_beam_that_crosses_the_nodes_row_has_jumped_and_a_stiff_one_not():
    """A narrow touch that began at z > 0: pulled to -0.6 it lies on the other side."""
    for hold, jumps in ((0.8, True), (0.3, False)):
        _, lies, moved, jumped = (each.item() for each in held(one([-0.6]), one([hold]), one([0.3]), 0.5))
        assert moved == 0 and lies < 0 and bool(jumped) == jumps
        _, lies, moved, jumped = (each.item() for each in held(one([-0.6]), one([hold]), one([0.3]), -0.5))
        assert moved == 0 and lies < 0 and not jumped


def test_theory_is_torn_where_a_pull_a_twentieth_of_a_row_off_would_put_the_body_elsewhere():
    """A touch 1.65 rows wide feels a spring k = 1.75, m = k pull / (1 + hold k), up to the knee z = 2 / 3.75; soft bodies then jump."""
    def apart(pull, hold, first=0.5):
        return torn_apart(one([pull]), one([hold]), one([1.65]), first).item()

    assert apart(0.2, 0.3) == pytest.approx(0.3 * 1.75 * 0.1 / (1 + 0.3 * 1.75))  # smooth: as far apart as a spring puts it
    assert apart(0.2, 0.0) == 0.0
    # held up to 2 / 3.75 + 2 (1 - 2 / 3.75) = 1.4667, then in the next groove, where the pull is two rows less
    before, after = 1.75 * 1.41 / 2.75, 1.75 * (1.51 - 2) / 2.75
    assert apart(1.46, 1.0) == pytest.approx(before - after) and apart(-1.46, 1.0, -0.5) == pytest.approx(before - after)
    assert before - after > TORN > apart(1.41, 1.0)
    both = torn_apart(one([0.2, 1.46]), one([0.3, 1.0]), one([1.65, 1.65]), one([0.5, 0.5]))
    assert both.tolist() == [apart(0.2, 0.3), apart(1.46, 1.0)]


def test_a_pose_is_at_a_jump_where_it_has_jumped_and_where_it_may_have():
    """A sphere on a tall beam, from its middle to 10 mm beside it: it moves on to the next groove, about there it may have."""
    beside = torch.linspace(0.0, 0.01, 401, dtype=torch.float64)
    centre = torch.stack([torch.full_like(beside, 0.18), beside, torch.full_like(beside, 0.001)], dim=1)
    bent = press(X, centre, Indenter(0.01, True, 0.0, 0.3, 0.003, 0.0), Bar(0.2, 0.02, 0.03, 0.3, False))
    jumped = held(bent.pull + 2 * bent.groove, bent.hold, bent.width / 0.003, 0.3)[3]
    assert torch.equal(bent.jumps, jumped | (bent.torn > TORN))
    assert jumped.any() and (bent.jumps & ~jumped).any() and not bent.jumps.all()


@pytest.mark.parametrize("start, end, touched", [(0.25, -0.25, 0.5), (0.0, 0.5, 0.0), (0.0, 0.0, 0.0), (0.0, -0.5, 0.0), (0.5, 0.0, 1.0),
                                                 (0.5, 0.5, 1.0), (-0.5, -0.5, 0.0), (-0.5, 0.5, 0.0)])
def test_an_obstacle_that_touches_at_the_start_touches_there_even_if_it_stays_or_leaves(start, end, touched):
    """Heights of the centre above that at which it touches, in numbers without rounding."""
    places = one([[0.0, 0.0, 0.75 + start], [0.0, 0.0, 0.75 + end]])
    assert first_touch(*places, 0.5, 0.5).item() == touched


def test_an_obstacle_of_which_no_more_is_told_lies_straight_over_a_row_of_nodes_in_rows_of_one():
    assert Indenter(0.01, True) == Indenter(0.01, True, turn=0.0, first=0.0, row=1.0, nodes=0.0)


STUBBY = (Bar(0.2, 0.03, 0.02, 0.3, False), Bar(0.02, 0.03, 0.02, 0.3, True))


@pytest.mark.parametrize("bar", STUBBY, ids=["clamped", "at both ends"])
@pytest.mark.parametrize("along", [-0.01, 0.0, 0.0003, 0.004, 0.01, 0.0199, 0.03])
def test_near_a_held_end_it_touches_a_thousandth_of_the_length_from_it_and_sinks_in_by_half_at_most(bar, along):
    """Where the beam gives least the obstacle enters it instead."""
    obstacle = Indenter(0.01, False)
    bent = press(X, one([[along, 0.0, 0.0195]]), obstacle, bar)
    told = [each.item() for each in (bent.touch, bent.push, bent.slope, bent.force, bent.indentation)]
    assert told == pytest.approx(plain(bar, obstacle, (along, 0.0, 0.0195)), rel=1e-9, abs=1e-15)
    low, high = 0.001 * bar.length, (0.999 if bar.held_at_both else 1.0) * bar.length
    assert low <= told[0] <= high and told[4] <= 0.00025 * (1 + 1e-12)
    if along < low:
        assert told[0] == pytest.approx(low) and told[4] == pytest.approx(0.00025)


def test_a_beam_on_its_edge_that_would_roll_over_turns_as_if_a_tenth_of_its_stiffness_were_left():
    """30 mm high and 6 mm wide, pressed by 8 mm: it bends sideways farther than the lever is long, and 1 + T F (H - B F) is negative."""
    bar, b = Bar(0.2, 0.006, 0.03, 0.3, False), 0.003
    for depth, left in ((0.008, 0.1), (0.0005, None)):
        bent = press(X, one([[0.15, 0.0005, 0.025 - depth]]), Indenter(0.01, True, first=0.1, row=b), bar)
        a, force = bent.touch, bent.force.item()
        sideways, twist = Bar(0.2, 0.03, 0.006, 0.3, False).bend(a, a)[0].item() * 25, bar.twist(a, a).item()
        lever = 0.025 - sideways * force
        whole = 1 + twist * force * lever
        assert whole < 0.1 if left else whole > 0.2
        turn, most = twist * force / (left or whole), b / 0.02
        wanted = [(0.0005 * (1 - lever * turn)) / b - 2 * bent.groove.item(), (sideways * force + lever**2 * turn) * most / b]
        assert [bent.pull.item(), bent.hold.item()] == pytest.approx(wanted, rel=1e-9)


def test_a_beam_that_is_just_too_soft_to_follow_jumps():
    """At hold = 1/2 the law's falling side has the slope of the beam: nothing holds it between two grooves."""
    for hold, jumps in ((0.499, False), (0.5, True)):
        lean, lies, moved, jumped = (each.item() for each in held(one([2.2]), one([hold]), one([0.95]), 0.5))
        assert moved == 1 and bool(jumped) == jumps
        assert lies == pytest.approx(0.2 / (1 + 2.4 * hold)) and lean == pytest.approx(2.4 * lies)  # in the next groove, two rows on
        lean, lies, moved, _ = (each.item() for each in held(one([0.9]), one([hold]), one([0.95]), 0.5))
        assert moved == 0 and lies == pytest.approx(min(0.9 / (1 + 2.4 * hold), 1))


@pytest.mark.parametrize("first, side", [(0.3, 1), (0.0, 1), (-0.3, -1)])
def test_over_its_row_of_nodes_a_narrow_touch_lies_on_the_side_where_it_began(first, side):
    """Width 0.5: k = 9, g = 0.435. Pulled nowhere it lies where 9 (z - 0.435) = -z / hold; a wide touch lies on the row."""
    lean, lies, moved, jumped = (each.item() for each in held(one([0.0]), one([0.8]), one([0.5]), first))
    z = 0.8 * 9 * 0.435 / (1 + 0.8 * 9)
    assert (lies, lean) == pytest.approx((side * z, -side * z / 0.8)) and moved == 0 and not jumped
    lean, lies, moved, jumped = (each.item() for each in held(one([0.0]), one([0.8]), one([1.2]), first))
    assert lies == lean == moved == 0 and not jumped


def test_the_table_of_grooves_is_met_at_each_of_its_widths():
    widths = [0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.4, 1.65, 2.2]
    steep, start = groove_law(one(widths))
    assert steep.tolist() == pytest.approx([15, 10, 8, 6, 3, 2.8, 2.4, 2.6, 1.75, 1])
    assert start.tolist() == pytest.approx([0.48, 0.45, 0.42, 0.4, 0.24, 0.18, 0, 0, 0, 0])
    between, _ = groove_law(one([1.925]))
    assert between.item() == pytest.approx(1.375)
