"""A family's draws depend on seed, index and key names alone and fill their ranges; wrong families are refused in a line."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from datagen.family import FOLDER, counts, draw, load_family
from physics.scene import read_scene
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
