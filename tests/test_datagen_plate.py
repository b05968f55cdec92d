"""The family plate: what its draws are like, that they are solved, and that their files are in balance."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.family.family import draw, load_family
from datagen.files.inputs import predicted
from datagen.files.solved import solved_on
from datagen.files.trajectory import HANDLE, problems, read_trajectory, write_trajectory
from datagen.sets.check import against_scene
from datagen.sets.dataset import digest
from datagen.sets.generate import trajectory_of
from datagen.sets.plan import figures
from physics import build_mesh
from physics.contact.obstacles import Rigid
from physics.fidelity.verify import Checker
from physics.scene import Scene, Steps

FAMILY = load_family("plate")


def test_the_obstacle_starts_before_the_body_and_is_pressed_into_it():
    shapes, held, sides = set(), set(), set()
    for index in range(24):
        scene = draw(FAMILY, 0, index)
        (obstacle,), mesh = scene.obstacles, build_mesh(scene.body)
        rigid = Rigid(obstacle)
        gap = rigid.gap(mesh.points, rigid.position(0.0))[0].min()
        assert 0.0005 - 1e-9 < gap < 0.03 and rigid.gap(mesh.points, rigid.position(1.0))[0].min() < -0.003
        shapes.add(obstacle.shape)
        held |= {support.where for support in scene.support}
        sides.add(len(scene.body.outline))
    assert shapes == {"sphere", "cylinder", "capsule", "box"} and sides == {4, 6, 8} and {"hole-1", "edge-4", "edge-6"} <= held


@pytest.mark.slow
def test_its_figures_are_those_that_were_published():
    """1271 nodes on average and a graph diameter of 16.9 +- 5.8, over a few scenes: within what so few of them scatter by."""
    rows = [figures(draw(FAMILY, 0, index)) for index in range(30)]
    nodes, diameter = (np.array([row[name] for row in rows]) for name in ("nodes", "graph_diameter"))
    assert nodes.mean() == pytest.approx(1271, abs=3 * nodes.std() / np.sqrt(30))
    assert diameter.mean() == pytest.approx(16.9, abs=3 * diameter.std() / np.sqrt(30)) and 3.5 < diameter.std() < 7
    assert (FAMILY.splits.train, FAMILY.splits.valid, FAMILY.splits.test) == (1000, 100, 100)
    assert {row["steps"] for row in rows} == {400}


def coarse(index):
    """A scene of it on few cells and in few steps."""
    scene = draw(FAMILY, 0, index)
    return replace(scene, body=replace(scene.body, cell_size=0.015, layers=1), steps=Steps(count=10))


@pytest.fixture(scope="module", params=["sphere", "box"])
def made(request, tmp_path_factory):
    """A scene of each shape, solved, with stress, as its file tells it."""
    number = next(i for i in range(40) if draw(FAMILY, 0, i).obstacles[0].shape == request.param)
    path = tmp_path_factory.mktemp(request.param) / "t.vtkhdf"
    write_trajectory(path, trajectory_of(coarse(number), stress=True))
    return read_trajectory(path)


def test_a_scene_is_solved_and_its_frames_are_in_balance(made):
    assert made.complete and problems(made) == [] and against_scene(made, steps=5) == []
    assert made.per_frame["relative_residual"].max() <= 1e-6 and np.linalg.norm(made.per_frame["reaction"][-1]) > 0
    assert (made.node_kind == HANDLE).any() and made.fields["von_mises"][-1].max() > 0


def test_every_stored_frame_is_in_balance_to_a_hundred_thousandth_of_its_reaction(made):
    """The held balance, worked out from the file; in single precision alone it is not."""
    scene, body, reaction = Scene.from_toml(made.scene), made.body, np.linalg.norm(made.per_frame["reaction"], axis=1)
    checker, pressed = Checker(scene, solved_on(scene, made)), np.flatnonzero(reaction)

    def missing(path):
        return np.array([checker.frame(path[t, body].astype(float), t / 10).residual for t in pressed]) / reaction[pressed]

    assert len(pressed) >= 5 and missing(made.exact).max() < 1e-5 < missing(made.displacement).max()


def test_a_remainder_belongs_to_its_displacements(made):
    """`check` sees one that is another's, though its size may be right, and a prediction has none."""
    plain, other = replace(made, remainder=None), replace(made, remainder=-made.remainder)
    assert problems(other) == [] and "no equilibrium at step" in against_scene(other, steps=1)[0] and against_scene(plain, steps=1) == []
    assert len({digest(plain), digest(other), digest(made)}) == 3
    assert problems(replace(made, displacement=made.displacement / 4)) == ["remainder is not what rounding took from displacement"]
    assert predicted(made, made.displacement[:, made.body]).remainder is None
