"""A family of plane bodies, from its draws to a checked set and its coarser and finer scenes."""

import numpy as np
import pytest
import tomli_w

from datagen.family.family import load_family
from datagen.files.trajectory import read_trajectory
from datagen.sets import generate as plan_of_work
from datagen.sets.check import check
from datagen.sets.deepmind import to_fields
from datagen.sets.generate import generate, trajectory_of
from learning.prediction.rivals import coarser
from physics.scene import Scene, read_scene

FAMILY = {
    "name": "slices", "body": {"shape": "plate", "length": {"uniform": [0.1, 0.12]}, "width": 0.03, "cells": [6, 3], "cell": "triangle",
                               "plane": "stress", "thickness": 0.02},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 6},
    "obstacle": {"shape": "cylinder", "radius": 0.02,
                 "place": {"face": "y-max", "along": 0.7, "turn": 0.0, "gap": 0.001, "depth": 0.1, "depth_in": "length"}},
    "splits": {"train": 1, "valid": 0, "test": 0}}


@pytest.mark.parametrize("order, kind", [(1, "triangle"), (2, "triangle6")])
def test_a_family_of_plane_bodies_is_generated_checked_and_judged(tmp_path, order, kind):
    (tmp_path / "slices.toml").write_text(tomli_w.dumps(FAMILY | {"body": FAMILY["body"] | {"order": order}}))
    generate(load_family(tmp_path / "slices.toml"), {"train": 1}, tmp_path / "set", seed=4, workers=1)
    found = read_trajectory(tmp_path / "set" / "train" / "0000.vtkhdf")
    scene = Scene.from_toml(found.scene)
    assert found.mesh.cell == kind and not found.points[:, 2].any() and not found.displacement[..., 2].any()
    around, triangles = found.obstacle
    assert np.linalg.norm(around[0] - found.per_frame["obstacle"][0], axis=1).max() == pytest.approx(0.02, rel=1e-3)  # a disc of its radius
    assert found.per_frame["obstacle"][0] == pytest.approx([0.7 * scene.body.length, 0.03 + 0.02 + 0.001, 0])
    assert len(triangles) == (8 if order == 1 else 39) and found.per_frame["reaction"][-1, 1] > 0 == found.per_frame["reaction"][-1, 2]
    assert check(tmp_path / "set") == []
    assert coarser(scene).body.divisions == (3, 2) and coarser(coarser(scene)).body.divisions == (2, 2)


def test_cells_of_second_order_are_given_to_others_in_four_or_as_they_are():
    scene = Scene.from_toml(tomli_w.dumps({
        "body": {"shape": "plate", "length": 0.1, "width": 0.03, "cells": [2, 1], "cell": "quadrilateral", "order": 2},
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 1},
        "load": [{"where": "x-max", "traction": [0.0, 10.0, 0.0]}]}))
    found = trajectory_of(scene)
    four, own = (to_fields(found, cells=cells)["cells"][0] for cells in ("tetrahedra", "own"))
    assert four.shape == (8, 4) and own.shape == (2, 9) and sorted(np.unique(four)) == list(range(15))


def test_forms_are_compiled_for_plane_cells_of_each_order_that_are_asked_for(monkeypatch):
    asked = []
    monkeypatch.setattr(plan_of_work, "solve", lambda scene: asked.append((scene.body.cell, scene.body.order, scene.body.plane)))
    monkeypatch.setattr(plan_of_work, "elastic_modes", lambda scene, count: None)
    body = {"shape": "plate", "length": 0.1, "width": 0.03, "cell": "triangle", "plane": "stress"}
    rest = {"material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}]}
    plan_of_work.compile_forms([read_scene({"body": body | {"cells": [2, 1], "order": 2}, "steps": {"count": 1}} | rest)])
    assert asked == [("triangle", 2, "stress")]
    plan_of_work.compile_forms([read_scene({"body": body, "steps": {"count": 1, "error": 0.1}} | rest)])
    assert sorted(asked[1:]) == [("triangle", 1, "stress"), ("triangle", 2, "stress")]
