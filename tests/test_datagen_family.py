"""A family's draws depend on seed, index and key names alone and fill their ranges; wrong families are refused in a line."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from datagen.family.family import FOLDER, counts, draw, load_family
from physics.contact.obstacles import Rigid
from physics.mesh.build import build_mesh
from physics.scene import PLACES, read_scene
from physics.schema import InputError

BASE = """
[body]
length = { uniform = [0.1, 0.2] }
width = 0.02
height = 0.02
cells = [{ choice = [4, 8] }, 2, 2]
[material]
young_modulus = { log-uniform = [1e4, 1e8] }
poisson_ratio = 0.4
[[support]]
where = { choice = ["x-min", "x-max"] }
[obstacle]
shape = "cylinder"
radius = 0.01
place = { face = "z-max", along = 0.75, gap = 0.002, depth = 0.01 }
"""


def family(folder: Path, text: str = BASE):
    path = folder / "family.toml"
    path.write_text(text)
    return load_family(path)


def test_a_draw_is_reproducible(tmp_path):
    one = family(tmp_path)
    assert draw(one, 3, 5) == draw(one, 3, 5)
    others = [draw(one, *key) for key in ((3, 5), (3, 6), (4, 5), (3, 5, 1))]
    assert len({scene.body.length for scene in others}) == len(others)


def test_a_draw_does_not_depend_on_the_order_of_keys(tmp_path):
    one = family(tmp_path)
    turned = dataclasses.replace(one, table=dict(reversed(one.table.items())))
    assert draw(turned, 0, 7) == draw(one, 0, 7)


def test_a_draw_stays_what_it_was(tmp_path):
    """Data sets are named by family and seed: another version of numpy must not change them. The numbers were drawn once."""
    scene = draw(family(tmp_path), 1, 2)
    assert scene.body.length == pytest.approx(0.19412156912459694, rel=1e-15)
    assert scene.material.young_modulus == pytest.approx(82186180.43187055, rel=1e-13)  # a power: libm may round differently


def test_draws_fill_their_ranges_evenly(tmp_path):
    one = family(tmp_path)
    scenes = [draw(one, 0, i) for i in range(400)]
    length = np.array([scene.body.length for scene in scenes])
    decade = np.log10([scene.material.young_modulus for scene in scenes])
    # The mean of 400 uniform numbers has a standard deviation of 1/sqrt(12 * 400) = 0.0144 widths; four of them are allowed.
    assert abs(length.mean() - 0.15) < 0.058 * 0.1 and 0.1 <= length.min() and length.max() < 0.2
    assert abs(decade.mean() - 6) < 0.058 * 4
    assert abs(np.corrcoef(length, decade)[0, 1]) < 0.2  # four standard deviations 1/sqrt(400)
    assert {scene.body.divisions[0] for scene in scenes} == {4, 8}
    assert {scene.support[0].where for scene in scenes} == {"x-min", "x-max"}


def test_an_obstacle_is_placed_before_a_face(tmp_path):
    scene, path = placed(tmp_path, BASE)
    start, end = path
    assert start == pytest.approx([0.75 * scene.body.length, 0.01, 0.02 + 0.01 + 0.002])
    assert end == pytest.approx([0.75 * scene.body.length, 0.01, 0.02 + 0.01 - 0.01])
    _, path = placed(tmp_path, BASE.replace("z-max", "z-min"))
    assert path[:, 2] == pytest.approx([-0.012, 0.0])
    scene, path = placed(tmp_path, BASE.replace("z-max", "y-max").replace("radius", "axis = [0, 0, 1]\nradius"))
    assert path[0] == pytest.approx([0.75 * scene.body.length, 0.032, 0.01])


def placed(folder: Path, text: str):
    scene = draw(family(folder, text), 0, 0)
    assert scene.obstacle is not None
    return scene, np.array(scene.obstacle.path)


SHAPES = {
    "sphere": {"radius": 0.01}, "cylinder": {"radius": 0.01}, "capsule": {"radius": 0.01, "length": 0.02},
    "box": {"size": [0.02, 0.03, 0.04], "radius": 0.002}, "half-space": {}}


@pytest.mark.parametrize("face", PLACES)
@pytest.mark.parametrize("shape", SHAPES)
def test_every_obstacle_starts_at_its_gap_before_every_face(tmp_path, shape, face):
    """Measured on the mesh: the start is `gap` away from the face, and after that much of the way the two touch."""
    turn = "turn = 20, " if shape in ("cylinder", "capsule") else ""
    keys = "\n".join(f"{key} = {value}" for key, value in SHAPES[shape].items())
    text = BASE.replace('shape = "cylinder"\nradius = 0.01', f'shape = "{shape}"\n{keys}')
    text = re.sub("place = .*", f'place = {{ face = "{face}", {turn}along = 0.5, across = 0.5, gap = 0.002, depth = 0.003 }}', text)
    scene, path = placed(tmp_path, text.replace("cells = [{ choice = [4, 8] }, 2, 2]", "cells = [8, 4, 4]"))
    rigid, rest = Rigid(scene.obstacle), build_mesh(scene.body).points
    assert rigid.gap(rest, path[0])[0].min() == pytest.approx(0.002, abs=1e-12)
    assert rigid.gap(rest, path[0] + 0.4 * (path[1] - path[0]))[0].min() == pytest.approx(0, abs=1e-12)
    normal = PLACES.index(face) // 2
    assert abs(path[1] - path[0])[normal] == pytest.approx(0.005)
    assert np.count_nonzero(abs(path[1] - path[0]) > 1e-12) == 1


def test_a_push_can_be_tilted_and_measured_by_the_body(tmp_path):
    place = 'place = { face = "y-min", along = 0.25, across = 0.75, depth = 0.5, depth_in = "width", direction = [45, -30] }'
    scene, path = placed(tmp_path, re.sub("place = .*", place, BASE).replace('"cylinder"', '"sphere"'))
    assert path[0] == pytest.approx([0.25 * scene.body.length, -0.01, 0.015])
    assert path[1] - path[0] == pytest.approx([0.01, 0.01, -0.01 / np.sqrt(3)])  # half of 0.02 m along y, tan 45, tan -30


def test_a_choice_may_hold_tables_with_ranges(tmp_path):
    both = '[{ where = "x-min" }, { where = "x-max", displacement = [{ uniform = [0.001, 0.002] }, 0, 0] }]'
    text = BASE.replace('[[support]]\nwhere = { choice = ["x-min", "x-max"] }\n', "").replace(
        "[body]", f'support = {{ choice = [[{{ where = "x-min" }}], {both}] }}\n[body]', 1)
    scenes = [draw(family(tmp_path, text), 0, i) for i in range(40)]
    two = [scene for scene in scenes if len(scene.support) == 2]
    assert 10 < len(two) < 30  # 40 fair coins: mean 20, three standard deviations are 9.5
    moved = {scene.support[1].displacement[0] for scene in two}
    assert len(moved) == len(two) and 0.001 <= min(moved) and max(moved) < 0.002


def test_a_case_is_laid_over_the_rest_as_often_as_it_weighs(tmp_path):
    cases = """
[[case]]
weight = 3
obstacle.place.along = 0.25
[[case]]
body.length = 0.3
obstacle.radius = { uniform = [0.02, 0.03] }
"""
    one = family(tmp_path, BASE + cases)
    scenes = [draw(one, 0, i) for i in range(400)]
    second = [scene for scene in scenes if scene.body.length == 0.3]
    assert abs(len(second) - 100) < 35  # four standard deviations sqrt(400 * 3/16) = 8.7
    assert all(0.02 <= scene.obstacle.radius < 0.03 and scene.obstacle.path[0][0] == pytest.approx(0.225) for scene in second)
    first = next(scene for scene in scenes if scene.body.length != 0.3)
    assert first.obstacle.radius == 0.01 and first.obstacle.path[0][0] == pytest.approx(0.25 * first.body.length)
    # A key that no case names is drawn as if there were none.
    assert first.material == draw(family(tmp_path), 0, scenes.index(first)).material
    for wrong, message in ((cases.replace("weight = 3", "weight = 0"), "case[0].weight"), ("[case]\nweight = 3\n", "[[case]]")):
        with pytest.raises(InputError) as error:
            family(tmp_path, BASE + wrong)
        assert message in str(error.value)


def test_a_scene_without_ranges_is_a_family(tmp_path):
    plain = draw(family(tmp_path), 0, 0)
    again = family(tmp_path, plain.to_toml())
    assert draw(again, 5, 9) == plain == read_scene(again.table)


def test_the_families_of_the_package():
    for path in FOLDER.glob("*.toml"):
        one = load_family(path.stem)
        for i in range(20):
            draw(one, 0, i)
    assert counts(load_family("demo")) == {"train": 8, "valid": 2, "test": 2}


def test_counts(tmp_path):
    one = family(tmp_path, BASE + "[splits]\ntrain = 6\nvalid = 2\ntest = 2\n")
    assert counts(one) == {"train": 6, "valid": 2, "test": 2}
    assert counts(one, count=100) == {"train": 60, "valid": 20, "test": 20}
    assert all(sum(counts(one, count=n).values()) == n for n in range(1, 30))
    assert counts(one, split="test") == {"test": 2}
    assert counts(one, split="valid", count=7) == {"valid": 7}
    for wrong in ({"count": 0}, {"count": -3}, {"split": "tests"}):
        with pytest.raises(InputError):
            counts(one, **wrong)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("uniform = [0.1, 0.2]", "uniform = [0.2, 0.1]", "body.length.uniform"),
    ("uniform = [0.1, 0.2]", "uniform = [0.1]", "two numbers"),
    ("uniform = [0.1, 0.2]", "uniform = [0.1, nan]", "finite"),
    ("uniform = [0.1, 0.2]", "uniform = [0.1, 0.2], choice = [1]", "one key"),
    ("uniform = [0.1, 0.2]", "uniform = [-0.2, -0.1]", "must be above 0 m"),
    ("uniform = [0.1, 0.2]", "uniforn = [0.1, 0.2]", "body.length must be a number"),
    ("log-uniform = [1e4, 1e8]", "log-uniform = [0.0, 1e8]", "above 0"),
    ("choice = [4, 8]", "choice = []", "at least one"),
    ("choice = [4, 8]", "uniform = [4, 8]", "must be an integer"),
    ('"z-max"', '"top"', "obstacle.place.face"),
    ("along = 0.75", "along = 1.5", "at most 1"),
    (", depth = 0.01", "", "obstacle.place.depth: missing"),
    ("depth", "dept", "did you mean 'depth'"),
    ("radius = 0.01", "radius = 0.01\npath = [[0, 0, 1]]", "either path or place"),
    ("radius = 0.01", "radius = 0.01\naxis = [0, 0, 1]", "must be parallel"),
    ("depth = 0.01", "depth = 0.01, direction = [80, 0]", "at most 75 degrees"),
    ("depth = 0.01", 'depth = 0.01, depth_in = "lenght"', "did you mean 'length'"),
    ("radius = 0.01\nplace = {", "radius = 0.01\naxis = [0, 1, 0]\nplace = { turn = 3,", "either axis or place.turn"),
    ("[material]", "[materials]", "did you mean 'material'"),
    ("[body]", "[splits]\ntrain = 1.5\n[body]", "splits.train must be an integer"),
])
def test_a_wrong_family_is_refused_in_one_line(tmp_path, old, new, message):
    assert old in BASE
    with pytest.raises(InputError) as error:
        family(tmp_path, BASE.replace(old, new))
    assert message in str(error.value) and "\n" not in str(error.value) and "family.toml" in str(error.value)


def test_an_unknown_family_is_refused():
    with pytest.raises(InputError, match="did you mean 'demo'"):
        load_family("dem")
