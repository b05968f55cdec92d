"""Blocks of steps: how they are cut, when one is done again and with how many, and when no more is tried. The stepper is made up."""

from types import SimpleNamespace

import numpy as np
import pytest

from physics.flow import frames
from physics.flow.frames import NoFlow, advance, figures
from physics.flow.stepping import Memory

ORDER = 2
STABLE = frames.COURANT[ORDER]


class Made:
    """A stepper that notes what it is asked for; after each call the fluid has the next of some speeds, whose rate is as large."""

    def __init__(self, *speeds, given=0.0, rate=0.1):
        self.calls, self.speeds = [], list(speeds)
        self.memory = Memory(1.0, np.full((2, 2), rate), np.zeros(1))
        self.start = self.memory
        self.space = SimpleNamespace(order=ORDER, rate=lambda u: float(abs(u).max()))
        self.conditions = SimpleNamespace(values=lambda t: np.full((1, 2), -given * t))

    def advance(self, until, steps):
        assert self.memory is self.start or not self.calls or self.calls[-1][0] < until  # every try begins where the block began
        self.calls.append((until, steps))
        speed = self.speeds.pop(0) if self.speeds else 0.1
        self.memory = Memory(until, np.array([[0.0, -speed], [0.0, 0.0]]), np.zeros(1))


def test_a_span_is_cut_into_equal_blocks_whose_last_ends_where_it_is_to():
    made = Made()
    advance(made, 2.1, blocks=4)
    assert [until for until, _ in made.calls] == pytest.approx([1.275, 1.55, 1.825, 2.1], rel=1e-12) and made.calls[-1][0] == 2.1
    made = Made()
    advance(made, 2.1)
    assert made.calls == [(2.1, frames.FIRST)]


@pytest.mark.parametrize("over, again", [(1.099, False), (1.101, True)])
def test_a_block_may_end_a_tenth_past_the_limit_and_is_done_again_with_a_tenth_to_spare(over, again):
    """32 steps in 1 s were chosen; at the end so many times as many would be needed."""
    made = Made(over * 32 * STABLE, 0.1)
    advance(made, 2.0)
    assert made.calls == [(2.0, 32)] + [(2.0, 40)] * again  # 1.1 x 35.2 = 38.8, of which there are 38, 40, ..
    assert made.memory.time == 2.0


def test_what_is_unstable_is_done_again_with_more_than_twice_as_many_steps():
    """2.2 x 32 = 70.4 -> 72; not a number, infinite, or more than a thousand times the fastest that was or is given: 4 m/s at 2 s."""
    for speed in (np.nan, np.inf, 4001.0):
        made = Made(speed, 0.1, given=2.0)
        advance(made, 2.0)
        assert made.calls == [(2.0, 32), (2.0, 72)]
    made = Made(101.0, 0.1, rate=0.1)
    advance(made, 2.0)
    assert made.calls[1] == (2.0, 72)
    made = Made(3999.0, 0.1, given=2.0)  # this is no sign of that, and asks for steps as small as it says
    advance(made, 2.0)
    assert made.calls[1] == (2.0, frames.rounded(1.1 * 3999.0 / STABLE))


def test_after_five_tries_no_more_is_tried_and_the_memory_is_what_it_was():
    made = Made(*[np.nan] * 9)
    with pytest.raises(NoFlow, match=r"^no flow after t = 1 s: the steps were unstable, and 1792 steps to 2 s are tried no more"):
        advance(made, 2.0)
    assert [steps for _, steps in made.calls] == [32, 72, 160, 352, 800] and made.memory is made.start


def test_more_than_a_hundred_thousand_steps_are_not_tried(monkeypatch):
    for wanted, tried in ((100_000, True), (100_001, False)):
        monkeypatch.setattr(frames, "count", lambda stepper, span, wanted=wanted: wanted)
        made = Made()
        if tried:
            advance(made, 2.0)
        else:
            with pytest.raises(NoFlow):
                advance(made, 2.0)
        assert bool(made.calls) == tried


def test_a_step_more_at_least_is_taken_the_next_time(monkeypatch):
    """Of one step 1.2 would be needed: 1.1 times that is 2 in whole ones."""
    monkeypatch.setattr(frames, "count", lambda stepper, span: 1)
    made = Made(1.2 * STABLE, 0.01)
    advance(made, 2.0)
    assert [steps for _, steps in made.calls] == [1, 2]


def test_the_figures_of_a_frame():
    """Density 1000: energy 3 m4/s2; forces only where they are asked for, none at the start."""
    u, seen = np.ones((1, 2)), []
    memory = Memory(0.5, u, np.array([7.0]), size=0.25, before=0 * u, steps=4)
    stepper = SimpleNamespace(memory=memory, energy=lambda: 3.0, divergence=lambda: 0.125, space=SimpleNamespace(finest=lambda u: 0.0625))
    plain = {"kinetic_energy": 3000.0, "divergence": 0.125, "step_size": 0.25, "iterations": 9.0, "unresolved": 0.0625}
    found = figures(stepper, None, 1000.0, 9)
    assert {name: float(value) for name, value in found.items()} == plain and all(value.shape == () for value in found.values())

    def force(*given):
        seen.append(given)
        return 5.0, 6.0

    forces = SimpleNamespace(force=force, difference=lambda p: None)
    found = figures(stepper, forces, 1000.0, 9)
    assert {name: float(value) for name, value in found.items()} == plain | {"drag": 5.0, "lift": 6.0}
    np.testing.assert_array_equal(seen[0][2], 4 * u)  # the rate, of one difference
    assert seen[0][0] is u and seen[0][1] is memory.p
    forces.difference = lambda p: 8.0 * p[0]
    stepper.memory = Memory(0.0, u, memory.p)
    found = figures(stepper, forces, 1000.0, 0)
    assert (found["drag"], found["lift"], found["pressure_difference"]) == (0, 0, 56) and len(seen) == 1
