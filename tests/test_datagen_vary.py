"""One body under many obstacles: draws that are those of a family, what may vary, and refusals in one line."""

import pytest

from datagen.family.family import draw
from datagen.family.vary import load_variation
from physics.schema import InputError

PRESS = {"body": {"length": 0.1, "width": 0.024, "height": 0.024, "cells": [18, 4, 4]}, "support": [{"where": "x-min"}],
         "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "steps": {"count": 20},
         "obstacle": {"shape": "sphere", "radius": 0.012,
                      "place": {"along": 0.7, "gap": 0.001, "depth": 0.01, "direction": [0.0, 0.0], "turn": {"uniform": [-5, 5]}}}}
VARY = ["obstacle.place.along=0.3:0.9", "obstacle.place.direction[1]=-3:3", "obstacle.shape=sphere,cylinder",
        "obstacle.place.face=z-max,y-min,z-min"]


def test_a_scene_is_the_one_that_the_family_draws_and_its_values_are_those_that_were_drawn():
    variation = load_variation(PRESS, VARY)
    faces, shapes = set(), []
    for index in range(6):
        scene, values = variation.scene(7, index)
        assert scene == draw(variation.family, 7, index)
        told = dict(zip(variation.keys, values, strict=True))
        assert told["obstacle.shape"] == scene.obstacle.shape
        assert 0.3 <= told["obstacle.place.along"] <= 0.9 and abs(told["obstacle.place.turn"]) <= 5
        if told["obstacle.place.face"] != "y-min":  # touched at a fraction of the length, before which the centre may drift in y alone
            assert scene.obstacle.path[0][0] == pytest.approx(0.1 * told["obstacle.place.along"], abs=1e-12)
        faces.add(told["obstacle.place.face"])
        shapes.append(scene.obstacle.shape)
    assert variation.points == 6 and faces == {"z-max", "y-min", "z-min"} and shapes.count("sphere") == 3
    assert set(variation.keys) == {key.split("=")[0] for key in VARY} | {"obstacle.place.turn"}


def test_a_path_may_vary_by_its_points():
    table = PRESS | {"obstacle": {"shape": "sphere", "radius": 0.012, "path": [[0.07, 0.012, 0.037], [0.07, 0.012, 0.03]]}}
    variation = load_variation(table, ["obstacle.path[1][2]=0.02:0.03"])
    scene, (value,) = variation.scene(0, 3)
    assert scene.obstacle.path == ((0.07, 0.012, 0.037), (0.07, 0.012, value)) and 0.02 < value < 0.03
    assert table["obstacle"]["path"][1][2] == 0.03  # the caller's is left alone


@pytest.mark.parametrize(("vary", "changes", "words"), [
    (["obstacle.place.along=0.9:0.3"], [], "--vary obstacle.place.along=0.9:0.3: must be in rising order"),
    (["obstacle.place.along"], [], "must be KEY=LOW:HIGH or KEY=A,B"),
    (["obstacle.place.along=0.3"], [], "must be KEY=LOW:HIGH or KEY=A,B"),
    (["obstacle.place.along=0.3:nan"], [], "must be KEY=LOW:HIGH or KEY=A,B"),
    (["obstacle.place.alomg=0.3:0.4"], [], "obstacle.place.alomg: unknown key; did you mean 'along'"),
    (["obstacle.place.direction[7]=0:1"], [], "there is no entry \\[7\\] there"),
    (["body.length=0.1:0.2"], [], "body.length: is a range, and one body under many obstacles varies in its obstacle alone"),
    ([], ["obstacle.place.turn=0"], "nothing varies"),
    ([], ["case=[{weight=1}]"], "cannot have cases"),
    (["obstacle[0].radius=0.01:0.02"], ["obstacle=[{shape='sphere', radius=0.01, path=[[0, 0, 1]]}]"], "has one at a time"),
    (["obstacle.place.along=2:3"], [], "obstacle.place.along = 2.* must be at most 1"),
])
def test_what_cannot_be_varied_is_refused_in_one_line(vary, changes, words):
    with pytest.raises(InputError, match=words) as caught:
        load_variation(PRESS, vary, changes)
    assert "\n" not in str(caught.value)


def test_a_later_draw_that_is_no_scene_is_named_by_its_number():
    variation = load_variation(PRESS, ["obstacle.place.along=0.1:1.1"], seed=4)
    said = []
    for index in range(1, 30):
        try:
            variation.scene(4, index)
        except InputError as error:
            said.append((index, str(error)))
    assert said and all(text.startswith(f"number {index}: obstacle.place.along") for index, text in said)
