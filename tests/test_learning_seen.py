"""A scene outside of what a run was trained on is told from one inside."""

import json
import math
from dataclasses import replace

import pytest

from learning.seen import FILE, description, outside, read_seen, seen, write_seen
from physics.schema import InputError
from tests.scenes import pressed
from tests.synthetic import bending

TRAINING = [bending(length=0.1, travel=0.015), bending(length=0.12, travel=0.02)]


def test_inside_nothing_is_said_and_outside_by_how_much():
    known = seen(TRAINING)
    assert known.trajectories == 2 and known.numbers["extent along x [m]"] == pytest.approx((0.1, 0.12))
    assert outside(TRAINING[0], known) == {}
    far = outside(bending(length=0.13, travel=0.018), known)
    assert far["extent along x [m]"] == pytest.approx(0.5)  # half the width of 20 mm beyond 120 mm
    assert "way of the obstacle [m]" not in far
    assert next(iter(far.values())) == max(far.values())


def test_a_value_that_never_varied_is_compared_by_its_ratio():
    assert outside(bending(length=0.11, travel=0.018, steps=20), seen(TRAINING))["steps"] == pytest.approx(1.0)


def test_words_of_the_scene_count():
    scene = pressed()
    stiffer = replace(scene, material=replace(scene.material, young_modulus=2e6, law="linear"))
    known = seen([replace(TRAINING[0], scene=scene.to_toml())])
    far = outside(replace(TRAINING[0], scene=stiffer.to_toml()), known)
    assert far == {"material law": math.inf, "Young's modulus [Pa]": pytest.approx(1.0)}


def test_the_direction_of_the_push_is_a_word():
    up = TRAINING[0].displacement.copy()
    up[:, ~TRAINING[0].body] *= -1
    assert description(TRAINING[0])["direction of the obstacle"] == "-z"
    assert outside(replace(TRAINING[0], displacement=up), seen(TRAINING))["direction of the obstacle"] == math.inf


def test_ranges_survive_their_file(tmp_path):
    known = seen(TRAINING)
    assert read_seen(tmp_path) is None
    write_seen(tmp_path, known)
    assert read_seen(tmp_path) == known
    (tmp_path / FILE).write_text(json.dumps({"numbers": 3}))
    with pytest.raises(InputError, match="not the ranges of a run"):
        read_seen(tmp_path)
