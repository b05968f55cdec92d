"""Grids in a family: every combination once, by the number of the scene, beside draws that stay random."""

import re
from itertools import product

import pytest

from datagen.family.family import LARGEST_SPLIT, counts, draw, load_family, points
from physics.schema import InputError

TEXT = """
[body]
length = { grid = [0.08, 0.1, 0.12] }
width = { uniform = [0.01, 0.02] }
height = 0.02
cells = [4, { grid = [1, 2] }, 2]
[material]
young_modulus = 1e6
poisson_ratio = { grid = [0.3, 0.45] }
[[support]]
where = "x-min"
[[case]]
steps.count = 3
[[case]]
steps.count = 7
"""


@pytest.fixture
def family(tmp_path):
    def of(text=TEXT):
        (tmp_path / "grid.toml").write_text(text)
        return load_family(tmp_path / "grid.toml")
    return of


def chosen(scene):
    return scene.body.length, scene.body.cells[1], scene.material.poisson_ratio


def test_every_combination_of_a_grid_is_made_once_and_then_again(family):
    made = family()
    assert points(made.table) == 12 and counts(made) == {"train": 12}
    scenes = [draw(made, 0, i) for i in range(24)]
    every = set(product((0.08, 0.1, 0.12), (1, 2), (0.3, 0.45)))
    assert {chosen(scene) for scene in scenes[:12]} == every and [chosen(s) for s in scenes[:12]] == [chosen(s) for s in scenes[12:]]
    assert len({scene.body.width for scene in scenes}) == 24  # what is drawn is drawn anew
    assert {scene.steps.count for scene in scenes} == {3, 7}


def test_each_split_walks_through_the_grid_from_its_start_whatever_the_seed_and_the_order_of_keys(family):
    made = family()
    before = [chosen(draw(made, 0, i)) for i in range(12)]
    assert [chosen(draw(made, 5, LARGEST_SPLIT + i, attempt=2)) for i in range(12)] == before
    body, rest = TEXT.split("[material]\n")
    material, rest = rest.split("[[support]]")
    young, poisson = material.splitlines(keepends=True)
    other = family(f"[material]\n{poisson}{young}{body}[[support]]{rest}")
    assert [chosen(draw(other, 0, i)) for i in range(12)] == before
    assert counts(family(TEXT + "[splits]\ntrain = 2\nvalid = 0\ntest = 1\n")) == {"train": 2, "test": 1}
    assert counts(made, count=5) == {"train": 5}


def test_without_a_grid_nothing_changes(family):
    plain = family(re.sub(r"\{ grid = \[([\d.]+).*?\] \}", r"\1", TEXT))
    assert points(plain.table) == 1 and counts(plain) == {"train": 8, "valid": 1, "test": 1}


@pytest.mark.parametrize("old, new, words", [
    ("grid = [1, 2]", "grid = []", r"body.cells.1: a grid is an array of at least one value"),
    ("grid = [1, 2]", "grid = 3", r"a grid is an array"),
    ("grid = [0.3, 0.45]", "grid = [0.3], uniform = [0, 0.4]", "material.poisson_ratio: a grid is an array"),
    ("steps.count = 3", "steps.count = { grid = [1, 2] }", "a grid stands outside of cases"),
    ("uniform = [0.01, 0.02]", "choice = [{ grid = [0.01, 0.02] }]", "a grid stands outside of cases, choices"),
    ("grid = [0.3, 0.45]", "grid = [0.3, 0.6]", "poisson_ratio = 0.6: must be below 0.5")])
def test_a_grid_that_is_none_is_refused(family, old, new, words):
    with pytest.raises(InputError, match=words):
        for index in range(12):
            draw(family(TEXT.replace(old, new).replace("[[case]]\nsteps.count = 7\n", "")), 0, index)
