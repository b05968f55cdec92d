"""How many steps lead to the next frame, and how fast a velocity changes, worked out on paper."""

from types import SimpleNamespace

import numpy as np
import pytest

from physics.flow import solution
from physics.flow.frames import COURANT, STILL, TURN, count, limit, rate_of_change, rounded, turn
from physics.flow.stepping import Memory

U = np.array([[3.0, 9.0]])
BEFORE, EARLIER, P = np.array([[3.0, 4.0]]), np.zeros((1, 2)), np.zeros(1)


def memory(**more):
    return Memory(1.0, U, P, **{"size": 0.5, "before": BEFORE, "earlier": EARLIER} | more)


def test_a_turn_is_the_second_difference_over_the_first_less_what_counts_as_still():
    """Differences (3, 4) and (0, 5): the second one is (-3, 1)."""
    assert turn(memory()) == pytest.approx((np.sqrt(10) - STILL * np.sqrt(90)) / 5, rel=1e-12)
    assert turn(memory(before=U, earlier=U)) == 0.0
    assert turn(memory(earlier=None)) == turn(memory(before=None)) == 0.0
    assert turn(Memory(1.0, 1e6 * np.ones((1, 2)), P, before=1e6 * np.ones((1, 2)) - 1e-3, earlier=1e6 * np.ones((1, 2)))) == 0.0


def test_a_rate_of_change_is_of_second_order_where_two_velocities_are_known():
    """u = t^2 at 1, 3/2, 2 has the rate 4 at t = 2; by the last difference alone 3.5."""
    at = [np.full((1, 2), t**2) for t in (1.0, 1.5, 2.0)]
    m = Memory(2.0, at[2], P, size=0.5, before=at[1], earlier=at[0])
    assert rate_of_change(m) == pytest.approx(np.full((1, 2), 4.0))
    assert rate_of_change(Memory(2.0, at[2], P, size=0.5, before=at[1])) == pytest.approx(np.full((1, 2), 3.5))
    assert not rate_of_change(Memory(2.0, at[2], P, size=0.5)).any()


@pytest.mark.parametrize("steps, wanted", [(0.2, 1), (1, 1), (16, 16), (16.5, 17), (31.2, 32), (33, 34), (65, 68), (130, 136), (128, 128)])
def test_many_steps_are_rounded_up_to_a_sixteenth_of_a_power_of_two(steps, wanted):
    assert rounded(steps) == wanted


def stepper(rate, **more):
    return SimpleNamespace(memory=memory(**more), space=SimpleNamespace(order=3, rate=lambda u: rate))


def test_steps_are_those_that_convection_allows_and_as_many_as_a_turn_wants():
    """A rate of 21 a second over 0.105: 200 steps a second. The first block has more, by 1.3, 32 at the least."""
    assert COURANT[3] == 0.105 and limit(stepper(21.0)) == pytest.approx(200)
    assert count(stepper(21.0, earlier=None), 1.0) == 272 and count(stepper(2.1, earlier=None), 1.0) == 32  # 260 by sixteens
    # The last steps of 1/40 s turn by more than twice TURN, so they are halved: 80 a second rather than the 50 of convection.
    assert turn(memory()) > 2 * TURN and count(stepper(5.25, size=1 / 40), 1.0) == 80
    assert count(stepper(10.5, size=1 / 40), 1.0) == 100  # convection wants more
    # What no longer turns may take steps twice as long, no longer; a few too many are kept.
    still = {"before": U, "earlier": U}
    assert count(stepper(0.0, size=1 / 40, **still), 1.0) == 20
    assert count(stepper(0.105 * 38, size=1 / 40, **still), 1.0) == 40 and count(stepper(0.105 * 34, size=1 / 40, **still), 1.0) == 34


@pytest.mark.parametrize("force, blocks", [(SimpleNamespace(length=0.25), 17), (SimpleNamespace(length=None), 19), (None, 19)])
def test_a_frame_has_five_blocks_in_three_passages_of_its_fastest_fluid(monkeypatch, force, blocks):
    """Walls move at 5 m/s, faster than the inflow: 0.5 s 5 m/s / 0.25 m = 10 passages of a body, or of a tenth of 2.2 m 11.4."""
    taken = []
    monkeypatch.setattr(solution, "advance", lambda stepper, until, blocks: taken.append((until, blocks)))
    scene = SimpleNamespace(force=force, inflow=[SimpleNamespace(speed=-2.0)], wall=[SimpleNamespace(velocity=(3.0, -4.0))],
                            steps=SimpleNamespace(stationary=False, count=4, duration=2.0))
    mesh = SimpleNamespace(points=np.array([[0.0, 0, 0], [2.2, 0.41, 0]]))
    solution._go_on(scene, SimpleNamespace(space=SimpleNamespace(mesh=mesh)), 3)
    assert taken == [(1.5, blocks)]
