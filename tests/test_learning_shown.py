"""Which trajectory and which frames of a measurement are shown, under which names, and where the obstacle is in them."""

import numpy as np
import pytest

from learning.prediction.predictor import Case
from learning.prediction.rivals import REFERENCE
from learning.report.measure import Hardest, Measurement, WorstFrame
from learning.report.shown import exhibits, worst_frames
from physics.mesh.build import build_mesh
from tests.rows import rows
from tests.scenes import pressed
from tests.synthetic import bending


def case(name: str, steps: int = 6) -> Case:
    scene = pressed(body={"length": 0.1, "width": 0.02, "height": 0.02, "cells": [10, 2, 2]})
    return Case(name, bending(steps=steps), scene, build_mesh(scene.body))


def test_one_whole_trajectory_of_every_predictor_then_the_worst_frames():
    first, second = case("0003"), case("0007")
    frames = [WorstFrame(first, "M4GN b", 4, 1.5 * first.truth[4], 1e-3), WorstFrame(second, "M4GN b", 2, 2 * second.truth[2], 2e-3),
              WorstFrame(second, "M4GN a", 5, second.truth[5], 9e-3)]  # of the worse network
    paths = {"M4GN b": 1.5 * first.truth, "nothing moves": 0 * first.truth}
    shown = exhibits(Measurement(rows=rows(), frames=frames, hardest=Hardest(first, paths, 1e-3)))
    assert [each.title for each in shown] == ["Test trajectory 0003, every predictor", "Worst frame of 0007", "Worst frame of 0003"]
    whole, worst = shown[0], shown[1]
    assert list(whole.motions) == ["M4GN b", "nothing moves", REFERENCE] and whole.truth == REFERENCE == worst.truth
    assert np.array_equal(whole.motions[REFERENCE].displacement, first.truth) and whole.frames[-1] == "step 6 of 6"
    assert np.array_equal(whole.motions["M4GN b"].displacement, paths["M4GN b"])
    assert np.array_equal(whole.obstacle.points, first.trajectory.obstacle[0])
    assert list(worst.motions) == ["M4GN b", REFERENCE] and worst.frames == ["step 2 of 6"]
    assert np.array_equal(worst.motions["M4GN b"].displacement, 2 * second.truth[2:3])
    assert np.array_equal(worst.motions[REFERENCE].displacement, second.truth[2:3])
    assert np.array_equal(worst.obstacle.points, second.trajectory.obstacle[0][2:3])
    name, = whole.motions["M4GN b"].fields
    assert name.startswith("von Mises stress [") and not whole.motions["nothing moves"].fields[name].any()


@pytest.mark.parametrize("count, errors", [(7, [7, 6, 5, 4, 3]), (2, [2, 1])])
def test_five_frames_at_most_the_worst_first(count, errors):
    one = case("0")
    frames = [WorstFrame(one, "M4GN b", 1, one.truth[1], float(i + 1)) for i in range(count)]
    assert [frame.error for frame in worst_frames(Measurement(rows=rows(), frames=frames))] == errors


def test_nothing_is_shown_of_nothing():
    assert exhibits(Measurement()) == []


def test_without_an_obstacle_none_is_shown(monkeypatch):
    one = case("0")
    monkeypatch.setattr(type(one.trajectory), "obstacle", property(lambda self: None))
    shown, = exhibits(Measurement(rows=rows()[2:], hardest=Hardest(one, {}, 0.0)))
    assert shown.obstacle is None and list(shown.motions) == [REFERENCE]
