"""What is said of inertia: every number in words, worked out on paper."""

from dataclasses import replace

import pytest

from physics.motion.inertia import fair_duration, inertia, legs
from tests.scenes import beam, pressed

THREE = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.04], [0.05, 0.01, 0.03], [0.05, 0.01, 0.035], [0.05, 0.01, 0.02]]}
STAYS = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.04]]}


def timed(scene, duration, dynamic=False, count=20):
    return replace(scene, steps=replace(scene.steps, duration=duration, dynamic=dynamic, count=count))


def test_legs_are_the_straight_parts_of_the_path():
    assert [legs(scene) for scene in (beam(), beam(obstacle=STAYS), pressed(), beam(obstacle=THREE))] == [1, 1, 1, 3]


def test_a_fair_duration_lets_the_body_swing_by_a_hundredth():
    """T / (pi t) = 0.01 for the time t of a leg: t = 31.83 T."""
    assert fair_duration(pressed(), 0.25) == pytest.approx(0.25 * 31.8309886)
    assert fair_duration(beam(obstacle=THREE), 0.25) == pytest.approx(3 * 0.25 * 31.8309886)


FAIR_FROM = "left out; fair when the loading takes at least {} s, {} periods of the first mode ({} Hz): then the body swings by at " \
            "most 1% of its static displacement. The scene gives no duration"
TAKES = "left out: the loading takes {} s, {} periods of the first mode (20 Hz), so that the body swings by at most {} of its static " \
        "displacement"
MATTERS = "; above 0.01 this matters: [steps] dynamic = true has inertia"
MOVES = "in motion, energy kept step by step: {} steps of {} s for a period of the first mode ({} Hz), which comes out longer by {} of " \
        "it; modes above {} Hz have less than 10 steps for a period"


@pytest.mark.parametrize("scene, hz, words", [
    # 1 / (pi 0.01) = 31.83 periods of 1 / 20 s; three legs take three times as long.
    (pressed(), 20.0, FAIR_FROM.format(1.59, 32, 20)),
    (beam(obstacle=THREE), 12.5, FAIR_FROM.format(7.64, 95, 12.5)),
    # 1 / (pi 40) = 0.0080, and 3 / (pi 40) = 0.024: a leg is a third of the path.
    (timed(pressed(), 2.0), 20.0, TAKES.format(2, 40, 0.008)),
    (timed(beam(obstacle=THREE), 2.0), 20.0, TAKES.format(2, 40, 0.024) + MATTERS),
    # 1 / (pi 0.2) = 1.6, and 1 / (pi 0.02) = 16, but no more than twice the static displacement is ever said.
    (timed(pressed(), 0.01), 20.0, TAKES.format(0.01, 0.2, 1.6) + MATTERS),
    (timed(pressed(), 0.001), 20.0, TAKES.format(0.001, 0.02, 2) + MATTERS),
    (timed(pressed(), 2.0), 0.0, "left out: the supports leave a motion free, which has no period to compare the loading with"),
    (timed(pressed(), 2.0, dynamic=True), 0.0, "in motion, energy kept step by step; the supports leave a motion free"),
    (timed(pressed(), 2.0), 0.5, TAKES.format(2, 1, 0.32).replace("20 Hz", "0.5 Hz") + MATTERS),  # of less than 1 Hz, too
    # h = 0.5 / 400 = 1.25 ms, T = 0.25 s: 200 steps; (2 pi / 200)^2 / 12 = 8.2e-5; ten steps are 12.5 ms, 80 Hz.
    (timed(pressed(), 0.5, dynamic=True, count=400), 4.0, MOVES.format(200, 0.00125, 4, "8.2e-05", 80)),
    # h = 10 ms, T = 50 ms: five steps; (2 pi / 5)^2 / 12 = 0.13; 10 Hz.
    (timed(pressed(), 2.0, dynamic=True, count=200), 20.0, MOVES.format(5, 0.01, 20, "1.3e-01", 10)),
])
def test_what_is_said_word_by_word(scene, hz, words):
    assert inertia(scene, hz) == words


def test_the_limit_itself_is_fair():
    """A swing of FAIR does not matter yet, one a little above does: t = T / (pi 0.01)."""
    fair = fair_duration(pressed(), 0.05)
    assert "dynamic" not in inertia(timed(pressed(), fair * (1 + 1e-9)), 20.0)
    assert "dynamic = true" in inertia(timed(pressed(), fair * (1 - 1e-6)), 20.0)
