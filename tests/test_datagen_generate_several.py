"""Scenes of several obstacles and materials go through files, checks, tables, packs and pictures as those of one do."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import fidelity
from datagen.files.inputs import inputs_of, poses
from datagen.files.trajectory import OBSTACLE, read_trajectory, write_trajectory
from datagen.sets.check import against_scene
from physics.contact.obstacles import Rigid
from physics.scene import Scene

FAMILY = """
name = "pinched"
[body]
length = 0.1
width = 0.02
height = 0.02
cells = [10, 2, 2]
cell = "hexahedron"
[[material]]
young_modulus = { uniform = [1e6, 2e6] }
poisson_ratio = 0.4
where = { box = [[0, 0, 0], [0.05, 0.02, 0.02]] }
[[material]]
law = "saint-venant-kirchhoff"
young_modulus = 5e6
poisson_ratio = 0.3
[[support]]
where = "x-min"
[[obstacle]]
shape = "cylinder"
radius = { uniform = [0.008, 0.012] }
place = { face = "z-max", along = 0.8, gap = 0.0005, depth = 0.002 }
[[obstacle]]
shape = "box"
size = [0.01, 0.03, 0.01]
place = { face = "z-min", along = 0.4, gap = 0.001, depth = 0.001 }
[steps]
count = 5
[splits]
train = 1
valid = 0
test = 1
"""


@pytest.fixture(scope="module")
def pinched(tmp_path_factory):
    """The folder of a data set, and its family."""
    folder = tmp_path_factory.mktemp("pinched")
    (folder / "pinched.toml").write_text(FAMILY)
    assert fidelity.main(["generate", str(folder / "pinched.toml"), "--out", str(folder / "set"), "--workers", "1"]) == 0
    return folder


@pytest.fixture(scope="module")
def one(pinched):
    return read_trajectory(pinched / "set/train/0000.vtkhdf")


def test_each_is_drawn_and_placed_and_the_file_holds_the_whole_scene(one):
    scene = Scene.from_toml(one.scene)
    assert len(scene.obstacles) == len(scene.materials) == 2 and scene.to_toml() == one.scene
    cylinder, block = scene.obstacles
    assert 0.008 <= cylinder.radius <= 0.012 and cylinder.path[0] == pytest.approx((0.08, 0.01, 0.0205 + cylinder.radius))
    assert block.path == (pytest.approx((0.04, 0.01, -0.006)), pytest.approx((0.04, 0.01, -0.004)))
    assert 1e6 <= scene.materials[0].young_modulus <= 2e6 and scene.materials[1].law == "saint-venant-kirchhoff"


def test_both_surfaces_move_each_on_its_own_path(one):
    scene, (points, triangles) = Scene.from_toml(one.scene), one.obstacle
    assert np.array_equal(np.unique(triangles), np.arange(points.shape[1]))
    upper = points[0, :, 2].copy() > 0.01
    assert upper.any() and not upper.all() and (upper[triangles].all(axis=1) | ~upper[triangles].any(axis=1)).all()
    for mine, obstacle in zip((upper, ~upper), scene.obstacles, strict=True):
        rigid = Rigid(obstacle)
        for t, fraction in enumerate(np.linspace(0, 1, 6)):
            gap, _ = rigid.gap(points[t, mine], rigid.position(fraction))
            assert np.sort(abs(gap))[:-2].max() < 1e-8  # but for the middle of a cylinder's ends


def test_what_each_bears_stands_beside_the_sum(one):
    per_frame = one.per_frame
    assert {"reaction", "reaction_1", "reaction_2", "obstacle_1", "obstacle_2"} <= per_frame.keys() and "obstacle" not in per_frame
    assert per_frame["reaction"] == pytest.approx(per_frame["reaction_1"] + per_frame["reaction_2"], abs=1e-12)
    assert per_frame["reaction_1"][-1, 2] > 0.01 and per_frame["reaction_2"][-1, 2] < -0.01
    inputs = inputs_of(one)
    assert inputs.pose.shape == (6, 2, 3) and np.array_equal(inputs.pose[:, 1], per_frame["obstacle_2"])
    assert np.array_equal(poses(replace(one, per_frame={})), inputs.pose)


def test_the_check_passes_and_finds_what_is_wrong_with_either(pinched, one, capsys):
    assert fidelity.main(["dataset", "check", str(pinched / "set")]) == 0
    assert against_scene(one) == []
    rigid = np.flatnonzero(one.node_kind == OBSTACLE)
    for node, name in ((rigid[0], "obstacle 1"), (rigid[-1], "obstacle 2")):
        u = one.displacement.copy()
        u[3, node] += 1e-4
        assert against_scene(replace(one, displacement=u)) == [f"{name} leaves its path by 0.0001 m"]
    u = one.displacement.copy()
    under = (one.points[:, 2] < 1e-9) & (abs(one.points[:, 0] - 0.04) < 1e-9) & one.body
    u[5, under, 2] -= 5e-4
    assert any("obstacle 2 penetrates" in line for line in against_scene(replace(one, displacement=u)))
    swapped = one.per_frame | {"reaction_1": one.per_frame["reaction_2"], "reaction_2": one.per_frame["reaction_1"]}
    (line,) = against_scene(replace(one, per_frame=swapped))
    assert line.startswith("reaction_1 [")
    other = one.scene.replace("5000000.0", "6000000.0")
    assert other != one.scene and against_scene(replace(one, scene=other))[0].startswith("no equilibrium at step")


def test_stats_pack_and_verify_take_them(pinched, tmp_path, capsys):
    data, again = str(pinched / "set"), str(tmp_path / "again")
    assert fidelity.main(["dataset", "stats", data, "--refined", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["obstacle"] == {"cylinder and box": 2} and found["refined"]["count"] == 1 and not found["refined"]["failures"]
    assert found["reaction_2_largest"]["min"] > 0.01
    assert fidelity.main(["dataset", "pack", data, "--out", str(tmp_path / "a.pack")]) == 0
    assert fidelity.main(["dataset", "unpack", str(tmp_path / "a.pack"), "--out", again]) == 0
    assert fidelity.main(["dataset", "check", again]) == 0
    file = str(pinched / "set/test/0000.vtkhdf")
    capsys.readouterr()
    assert fidelity.main(["verify", file, "--reference", file, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["rmsd_all"] == figures["reaction_error"] == 0 and figures["relative_residual"] < 1e-3
    assert figures["nothing_moves"]["relative_residual"] < 1e-9 or figures["nothing_moves"]["largest_penetration"] > 5e-4


def test_simulate_tells_of_each_and_any_value_of_one_can_be_set(one, tmp_path, capsys):
    (tmp_path / "a.toml").write_text(one.scene)
    command = ["simulate", str(tmp_path / "a.toml"), "--out", str(tmp_path / "a.vtkhdf"), "--csv", str(tmp_path / "a.csv"), "--json",
               "--fields", "stress", "--set", "obstacle[0].radius=0.008", "material[0].young_modulus=1.5e6"]
    assert fidelity.main(command) == 0
    told, rows = json.loads(capsys.readouterr().out), list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert told["reaction_2"][-1][2] < 0 and told["obstacle_2"][-1] == pytest.approx(one.per_frame["obstacle_2"][-1].tolist())
    assert float(rows[-1]["reaction_1_z"]) == told["reaction_1"][-1][2] and float(rows[-1]["obstacle_2_x"]) == pytest.approx(0.04)
    found = read_trajectory(tmp_path / "a.vtkhdf")
    scene = Scene.from_toml(found.scene)
    assert scene.obstacles[0].radius == 0.008 and scene.materials[0].young_modulus == 1.5e6
    assert found.fields["stress"].shape == (6, len(found.points), 6) and found.fields["von_mises"][-1, :5].max() > 0
    assert fidelity.main(["simulate", str(tmp_path / "a.toml"), "--out", str(tmp_path / "b.vtkhdf"), "--set", "obstacle.radius=1"]) == 2
    assert "there is no radius there" in capsys.readouterr().err and not (tmp_path / "b.vtkhdf").exists()


def test_both_are_drawn(one, tmp_path):
    """Without the second one the picture is another below the body alone, without the first one above it."""
    def picture(name, keep):
        kept = one.body | keep
        number = np.cumsum(kept) - 1
        corners = np.split(one.connectivity, one.offsets[1:-1])
        cells = [i for i, nodes in enumerate(corners) if kept[nodes].all()]
        part = replace(one, points=one.points[kept], node_kind=one.node_kind[kept], displacement=one.displacement[:, kept],
                       modes=one.modes[:, kept], types=one.types[cells],
                       connectivity=np.concatenate([number[corners[i]] for i in cells]),
                       offsets=np.concatenate([[0], np.cumsum([len(corners[i]) for i in cells])]))
        write_trajectory(tmp_path / f"{name}.vtkhdf", part)
        assert fidelity.main(["view", str(tmp_path / f"{name}.vtkhdf"), "--out", str(tmp_path / f"{name}.png")]) == 0
        grey = np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")).astype(int)
        return int(((np.ptp(grey, axis=2) < 12) & (grey.mean(axis=2) < 225) & (grey.mean(axis=2) > 90)).sum())

    upper = one.points[:, 2] > 0.012
    both, first, second = picture("both", ~one.body), picture("first", upper), picture("second", ~upper)
    assert both > first and both > second
    assert fidelity.main(["view", str(tmp_path / "both.vtkhdf"), "--out", str(tmp_path / "both.html")]) == 0
