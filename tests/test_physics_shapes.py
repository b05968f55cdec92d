"""Shapes of rigid obstacles: distances and normals worked out on paper, their slopes, curvature and extents."""

import itertools

import numpy as np
import pytest

from physics.contact.obstacles import Rigid
from physics.scene import Obstacle

ROOT = (0.1, 0.2, 0.3)
SPHERE = Obstacle(shape="sphere", radius=0.3, path=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)))
OBSTACLES = {
    "sphere": SPHERE,
    "cylinder": Obstacle(shape="cylinder", radius=0.3, axis=(0.0, 2.0, 1.0), path=(ROOT,)),
    "capsule": Obstacle(shape="capsule", radius=0.3, length=0.8, axis=(1.0, 2.0, 1.0), path=(ROOT,)),
    "box": Obstacle(shape="box", radius=0.1, size=(0.6, 0.8, 1.0), path=(ROOT,)),
    "half-space": Obstacle(shape="half-space", normal=(0.0, 1.0, 2.0), path=(ROOT,)),
}

# Three unit vectors at right angles, none of them along a coordinate.
A, B, C = np.array([1, 2, 2]) / 3, np.array([2, 1, -2]) / 3, np.array([2, -2, 1]) / 3
TILTED = tuple(6 * A)  # an axis need not be of unit length
BOX = {"shape": "box", "radius": 0.5, "size": (2.0, 4.0, 6.0)}  # half 1, 2, 3; inner half 0.5, 1.5, 2.5
SHARP = BOX | {"radius": 0.0}
# What is built, where the point is seen from the centre, its gap, its normal.
ON_PAPER = {
    "sphere, outside": ({"shape": "sphere", "radius": 2.0}, (1, -4, 8), 7.0, (1 / 9, -4 / 9, 8 / 9)),
    "sphere, inside": ({"shape": "sphere", "radius": 2.0}, (0.3, 0, -0.4), -1.5, (0.6, 0, -0.8)),
    "cylinder, far along its axis": ({"shape": "cylinder", "radius": 0.5, "axis": TILTED}, 100 * A + 3 * B - 4 * C, 4.5, 0.6 * B - 0.8 * C),
    "cylinder, inside": ({"shape": "cylinder", "radius": 0.5, "axis": TILTED}, -7 * A + 0.1 * C, -0.4, C),
    "capsule, beside it": ({"shape": "capsule", "radius": 0.5, "length": 6.0, "axis": TILTED}, 2.9 * A + 4 * B, 3.5, B),
    "capsule, below": ({"shape": "capsule", "radius": 0.5, "length": 6.0, "axis": TILTED}, -2.9 * A - 4 * C, 3.5, -C),
    "capsule, past its end": ({"shape": "capsule", "radius": 0.5, "length": 6.0, "axis": TILTED}, 6 * A - 4 * B, 4.5, 0.6 * A - 0.8 * B),
    "capsule, past its start": ({"shape": "capsule", "radius": 0.5, "length": 6.0, "axis": TILTED}, -6 * A + 4 * C, 4.5,
                                -0.6 * A + 0.8 * C),
    "half-space, in front": ({"shape": "half-space", "normal": tuple(5 * C)}, 7 * A + 2 * B + 3 * C, 3.0, C),
    "half-space, behind": ({"shape": "half-space", "normal": tuple(5 * C)}, 7 * A + 2 * B - 3 * C, -3.0, C),
    "box, face x": (BOX, (-3, 1.4, 2.4), 2.0, (-1, 0, 0)),
    "box, face y": (BOX, (0.4, 5, -2.4), 3.0, (0, 1, 0)),
    "box, face z": (BOX, (-0.4, -1.4, 7), 4.0, (0, 0, 1)),
    "box, edge along z": (BOX, (3.5, -5.5, 2.4), 4.5, (0.6, -0.8, 0)),
    "box, edge along x": (BOX, (0.4, 4.5, -6.5), 4.5, (0, 0.6, -0.8)),
    "box, corner": (BOX, (-1.5, 3.5, -4.5), 2.5, (-1 / 3, 2 / 3, -2 / 3)),
    "box, within the rounding of an edge": (BOX, (0.5 + 0.03, 1.5 + 0.04, 0), 0.05 - 0.5, (0.6, 0.8, 0)),
    "box, inside near x": (BOX, (-0.4, 1.2, 1.0), -0.6, (-1, 0, 0)),
    "box, inside near y": (BOX, (0.1, 1.45, -2.0), -0.55, (0, 1, 0)),
    "box, inside near z": (BOX, (0.1, 0.5, -2.4), -0.6, (0, 0, -1)),
    "sharp box, face": (SHARP, (0.9, -4, 2.9), 2.0, (0, -1, 0)),
    "sharp box, edge": (SHARP, (4, -6, 2.9), 5.0, (0.6, -0.8, 0)),
    "sharp box, corner": (SHARP, (-2, 4, 5), 3.0, (-1 / 3, 2 / 3, 2 / 3)),
    "sharp box, inside": (SHARP, (0.7, 1.6, -2.5), -0.3, (1, 0, 0)),
}


def rigid(**keys):
    return Rigid(Obstacle(**({"path": (ROOT,)} | keys)))


@pytest.mark.parametrize("case", ON_PAPER)
def test_distance_and_normal_worked_out_on_paper(case):
    keys, offset, gap, normal = ON_PAPER[case]
    body, centre = rigid(**keys), np.array([-3.0, 0.5, 7.0])  # nothing is measured from where the path starts
    # Beside it a point of another region: each point is on its own.
    found, direction = body.gap(np.array([centre + offset, centre + [20.0, 30.0, -40.0]]), centre)
    assert found[0] == pytest.approx(gap, abs=1e-13) and direction[0] == pytest.approx(np.array(normal), abs=1e-13)


@pytest.mark.parametrize("keys", [{"shape": "sphere"}, {"shape": "cylinder"}, {"shape": "capsule", "length": 0.8}])
def test_on_the_axis_the_normal_is_one_of_those_as_good(keys):
    body, centre = rigid(radius=0.3, axis=(0.0, 0.0, 2.0), **keys), np.array(ROOT)
    points = centre + [[0, 0, 0], [3, 0, 0], [0, 0, 0.25]]
    on_axis = [0] if keys["shape"] == "sphere" else [0, 2]
    gap, normal = body.gap(points, centre)
    assert gap[on_axis] == pytest.approx(-0.3, abs=1e-15) and gap[1] == pytest.approx(2.7)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1) and normal[1] == pytest.approx([1, 0, 0])
    assert normal[on_axis] @ [0, 0, 1] == pytest.approx(0, abs=1e-15)
    assert not body.bend(points, centre)[on_axis].any()  # without a distance from the axis there is no curvature


@pytest.mark.parametrize("name, count", [("sphere", 200), ("cylinder", 200), ("capsule", 200), ("box", 1000), ("half-space", 20)])
def test_normal_is_the_gradient_of_the_gap(name, count):
    body, points = Rigid(OBSTACLES[name]), 0.6 * np.random.default_rng(0).normal(size=(count, 3)) + ROOT
    centre = np.array(ROOT)
    gap, normal = body.gap(points, centre)
    step = 1e-6  # central differences: order step^2; no point is within a step of where two faces are equally near
    slope = [(body.gap(points + step * e, centre)[0] - body.gap(points - step * e, centre)[0]) / (2 * step) for e in np.eye(3)]
    assert np.transpose(slope) == pytest.approx(normal, abs=1e-8)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1)
    assert body.gap(points - gap[:, None] * normal, centre)[0] == pytest.approx(0, abs=1e-12)
    if name == "box":  # every face, edge and corner is among them
        beyond = np.sign(points - centre) * (abs(points - centre) > [0.2, 0.3, 0.4])
        assert len(np.unique(beyond, axis=0)) == 27


@pytest.mark.parametrize("shape", OBSTACLES)
def test_bend_has_two_directions_for_each_point(shape):
    assert Rigid(OBSTACLES[shape]).bend(np.array([ROOT, ROOT, ROOT, ROOT]) + 0.9, np.array(ROOT)).shape == (4, 2, 3)


@pytest.mark.parametrize("shape", OBSTACLES)
def test_bend_is_the_second_derivative_of_the_gap(shape):
    body, points = Rigid(OBSTACLES[shape]), 0.6 * np.random.default_rng(0).normal(size=(400, 3)) + ROOT
    centre = np.array(ROOT)
    # deeper than the rounding is wide nothing is smooth
    points = points[body.gap(points, centre)[0] > -0.9 * (OBSTACLES[shape].radius or 0.0)]
    step = 1e-6  # central differences: order step^2, but for the few points within a step of where two regions meet: none here
    slope = [(body.gap(points + step * e, centre)[1] - body.gap(points - step * e, centre)[1]) / (2 * step) for e in np.eye(3)]
    bend = body.bend(points, centre)
    assert np.einsum("qik,qil->qkl", bend, bend) == pytest.approx(np.transpose(slope, (1, 2, 0)), abs=1e-6)


def test_bend_worked_out_on_paper():
    """1/d across the axis of a cylinder at a distance d from it, both ways on a ball; none on faces and within sharp edges."""
    centre = np.array([-3.0, 0.5, 7.0])
    capsule, box = rigid(shape="capsule", radius=0.5, length=6.0, axis=TILTED), rigid(**BOX)

    def second(body, offset):
        (bend,) = body.bend(np.array([centre + offset]), centre)
        return bend.T @ bend

    assert second(capsule, 2.9 * A + 4 * B) == pytest.approx(np.outer(C, C) / 4, abs=1e-14)
    n = 0.6 * A - 0.8 * B
    assert second(capsule, 6 * A - 4 * B) == pytest.approx((np.eye(3) - np.outer(n, n)) / 5, abs=1e-14)
    assert second(rigid(shape="cylinder", radius=0.5, axis=TILTED), -6 * A + 4 * C) == pytest.approx(np.outer(B, B) / 4, abs=1e-14)
    t = np.array([0.8, 0.6, 0])  # along the rounding of the edge with the normal 0.6, -0.8
    assert second(box, (3.5, -5.5, 2.4)) == pytest.approx(np.outer(t, t) / 5, abs=1e-14)
    assert second(box, (0.53, 1.46 - 3, 0)) == pytest.approx(np.outer(t, t) / 0.05, rel=1e-9)  # inside, in the rounding
    n = np.array([-1, 2, -2]) / 3
    assert second(box, (-1.5, 3.5, -4.5)) == pytest.approx((np.eye(3) - np.outer(n, n)) / 3, abs=1e-14)
    for offset in ((-3, 1.4, 2.4), (0.1, 0.5, -2.4)):  # before a face, and inside
        assert not second(box, offset).any()
    assert not second(rigid(**SHARP), (-2, 4, 5)).any()
    assert not second(rigid(shape="half-space", normal=(0.0, 1.0, 2.0)), (-2, 4, 5)).any()


def test_width_is_the_smallest_extent():
    assert [Rigid(OBSTACLES[shape]).width for shape in ("sphere", "cylinder", "capsule")] == pytest.approx([0.6] * 3)
    for size in itertools.permutations((0.7, 0.4, 1.1)):
        assert rigid(shape="box", size=size, radius=0.01).width == pytest.approx(0.4)
    assert Rigid(OBSTACLES["half-space"]).width == np.inf
