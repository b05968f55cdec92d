"""A family of plane bodies, from its draws to a checked set and its coarser and finer scenes."""

import numpy as np
import pytest
import tomli_w

from datagen.family.family import load_family
from datagen.files.trajectory import read_trajectory
from datagen.sets.check import check
from datagen.sets.generate import generate
from learning.prediction.rivals import coarser
from physics.scene import Scene

FAMILY = {
    "name": "slices", "body": {"shape": "plate", "length": {"uniform": [0.1, 0.12]}, "width": 0.03, "cells": [6, 3], "cell": "triangle",
                               "plane": "stress", "thickness": 0.02},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 6},
    "obstacle": {"shape": "cylinder", "radius": 0.02,
                 "place": {"face": "y-max", "along": 0.7, "turn": 0.0, "gap": 0.001, "depth": 0.1, "depth_in": "length"}},
    "splits": {"train": 1, "valid": 0, "test": 0}}


def test_a_family_of_plane_bodies_is_generated_checked_and_judged(tmp_path):
    (tmp_path / "slices.toml").write_text(tomli_w.dumps(FAMILY))
    generate(load_family(tmp_path / "slices.toml"), {"train": 1}, tmp_path / "set", seed=4, workers=1)
    found = read_trajectory(tmp_path / "set" / "train" / "0000.vtkhdf")
    scene = Scene.from_toml(found.scene)
    assert found.mesh.cell == "triangle" and not found.points[:, 2].any() and not found.displacement[..., 2].any()
    around, triangles = found.obstacle
    assert np.linalg.norm(around[0] - found.per_frame["obstacle"][0], axis=1).max() == pytest.approx(0.02, rel=1e-3)  # a disc of its radius
    assert found.per_frame["obstacle"][0] == pytest.approx([0.7 * scene.body.length, 0.03 + 0.02 + 0.001, 0])
    assert len(triangles) == 8 and found.per_frame["reaction"][-1, 1] > 0 == found.per_frame["reaction"][-1, 2]
    assert check(tmp_path / "set") == []
    assert coarser(scene).body.divisions == (3, 2) and coarser(coarser(scene)).body.divisions == (2, 2)
