"""Families of flows: drawn, generated, gone on with, and held against their scenes."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.family.family import counts, draw, load_family
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.flow.check import against_flow
from datagen.sets.check import check
from datagen.sets.generate import generate
from datagen.sets.plan import planned
from datagen.sets.statistics import statistics
from physics.scene import FlowScene, scene_of
from physics.schema import InputError

TINY = """
name = "tiny-flow"
[body]
shape = "channel"
length = 0.6
hole_centre = [{ uniform = [0.15, 0.25] }, { uniform = [0.18, 0.22] }]
hole_radius = { uniform = [0.04, 0.06] }
cell_size = 0.06
hole_cell_size = 0.025
[fluid]
density = 1.0
viscosity = 1e-3
[[inflow]]
speed = { uniform = [0.25, 0.5] }
[[outflow]]
[steps]
count = 3
duration = 0.03
[splits]
train = 2
valid = 0
test = 0
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flows")
    (folder / "tiny.toml").write_text(TINY)
    family = load_family(folder / "tiny.toml")
    generate(family, counts(family), folder / "set", workers=1)
    return family, folder / "set"


def test_the_family_cylinder_flow_draws_what_was_found_out_about_the_published_set():
    """Radius 0.05 +- 0.03 m, centre 0.325 +- 0.175 and 0.2 +- 0.1 m, peak 1.25 +- 1 m/s; 1885 nodes on average."""
    family = load_family("cylinder-flow")
    scenes = [draw(family, 0, index) for index in range(200)]
    values = np.array([(s.body.hole_radius, *s.body.hole_centre, s.inflow[0].speed) for s in scenes])
    np.testing.assert_allclose(values.mean(axis=0), [0.05, 0.325, 0.2, 1.25], rtol=0.1)
    assert (abs(values - [0.05, 0.325, 0.2, 1.25]) <= [0.03, 0.175, 0.1, 1.0]).all()
    assert all(s.inflow[0].ramp is None and s.steps.count == 600 and s.steps.duration == 6.0 for s in scenes)
    assert planned(family, {"train": 6})["nodes"]["mean"] == pytest.approx(1885, rel=0.05)
    assert (family.splits.train, family.splits.valid, family.splits.test) == (1000, 100, 100)


def test_what_was_generated_is_what_its_scenes_give(made):
    family, folder = made
    assert check(folder, steps=3) == []
    found = read_trajectory(folder / "train" / "0000.vtkhdf")
    scene = scene_of(found.scene)
    assert isinstance(scene, FlowScene)
    assert scene == draw(family, 0, 0)
    assert generate(family, counts(family), folder, workers=1)["new"] == 0
    said = statistics(folder)
    assert said["reynolds_number"]["min"] >= 0.25 * 2 / 3 * 0.08 / 1e-3
    assert said["nodes"]["mean"] > 50


def tampered(found, **changes):
    return replace(found, fields={**found.fields, **changes})


def test_what_contradicts_the_scene_is_found(made):
    _, folder = made
    found = read_trajectory(folder / "train" / "0001.vtkhdf")
    scene = scene_of(found.scene)
    velocity, pressure = found.fields["velocity"], found.fields["pressure"]
    assert against_flow(found, scene) == []
    slipping = velocity.copy()
    slipping[2, np.flatnonzero(found.node_kind == 6)[0], 0] = 0.01
    assert "inlets and walls is off by 0.01 m/s in frame 2" in against_flow(tampered(found, velocity=slipping), scene)[0]
    leaking = velocity.copy()
    leaking[1:, found.node_kind == 0] *= np.float32(1.5)
    assert "divergence in frame" in against_flow(tampered(found, velocity=leaking), scene)[0]
    late = velocity.copy()
    late[2] = velocity[3]
    assert "velocity of the first frames" in against_flow(tampered(found, velocity=late), scene)[0]
    assert "pressure of the first frames" in against_flow(tampered(found, pressure=1.001 * pressure), scene)[0]
    other = {**found.per_frame, "drag": 1.01 * found.per_frame["drag"]}
    assert "drag of the first frames" in against_flow(replace(found, per_frame=other), scene)[0]
    assert against_flow(replace(found, points=found.points + 1e-6), scene) == ["the mesh is not that of its scene"]
    assert against_flow(replace(found, fields={}), scene) == ["has no pressure and no velocity"]


def test_a_file_that_was_changed_is_made_again(made):
    family, folder = made
    path = folder / "train" / "0001.vtkhdf"
    whole = path.read_bytes()
    found = read_trajectory(path)
    write_trajectory(path, tampered(found, velocity=2 * found.fields["velocity"]))
    assert any("checksum" in line for line in check(folder, steps=1))
    assert generate(family, counts(family), folder, workers=1)["new"] == 1
    assert np.array_equal(read_trajectory(path).fields["velocity"], found.fields["velocity"])
    assert len(path.read_bytes()) == pytest.approx(len(whole), rel=0.05)


def test_a_family_of_flows_that_is_wrong_is_refused(tmp_path):
    (tmp_path / "wrong.toml").write_text(TINY.replace("viscosity = 1e-3", "viscosity = -1.0"))
    with pytest.raises(InputError, match=r"fluid\.viscosity = -1\.0: must be above 0"):
        load_family(tmp_path / "wrong.toml")
