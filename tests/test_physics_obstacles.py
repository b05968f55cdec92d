"""Rigid obstacles: where they are on their path, and their sections with a plane."""

import numpy as np
import pytest

from physics.contact.obstacles import Rigid
from physics.scene import Obstacle

ROOT = (0.1, 0.2, 0.3)
SPHERE = Obstacle(shape="sphere", radius=0.3, path=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)))


def rigid(**keys):
    return Rigid(Obstacle(**({"path": (ROOT,)} | keys)))


def test_waypoints_are_reached_at_equal_fractions():
    body = Rigid(SPHERE)
    assert body.position(0.0) == pytest.approx([0, 0, 0])
    assert body.position(0.25) == pytest.approx([0.5, 0, 0])
    assert body.position(0.5) == pytest.approx([1, 0, 0])
    assert body.position(0.6) == pytest.approx([1, 0.2, 0])
    assert body.position(1.0) == pytest.approx([1, 1, 0])
    assert rigid(shape="box", size=(1.0, 1.0, 1.0)).position(0.7) == pytest.approx(ROOT)
    timed = rigid(shape="sphere", radius=0.3, path=SPHERE.path, steps=(0.0, 0.2, 1.0))
    assert timed.position(0.1) == pytest.approx([0.5, 0, 0]) and timed.position(0.6) == pytest.approx([1, 0.5, 0])


def test_one_obstacle_speaks_as_several_do():
    """What Newton's method asks of a set of obstacles, of a set of one: parts along normals, sums of forces, points from its centre."""
    body = rigid(shape="sphere", radius=0.3)
    normal, force = np.array([[1.0, 0, 0], [0, 0.6, 0.8]]), np.array([2.0, 5.0])
    assert body.each == (body,) and body.among(np.array([1])) is body and body.width == 0.6
    assert body.offset(np.array([[1.0, 2, 3]]), np.array(ROOT)) == pytest.approx(np.array([[0.9, 1.8, 2.7]]))
    assert body.along(normal, np.array([3.0, 4, 5])) == pytest.approx([3, 2.4 + 4])
    assert body.sums(force, normal) == pytest.approx(np.array([[2, 3, 4]]))


def test_the_section_of_an_obstacle_is_what_the_plane_sees():
    """Areas of polygons inscribed: n/2 r^2 sin(2 pi / n) for a circle, and for a stadium its rectangle as well."""
    body, path = np.array([[0, 0, 0], [2.0, 1, 0]]), ((1.0, 3.0, 0.0),)

    def area(**keys):
        points, triangles = Rigid(Obstacle(path=path, **keys)).surface_mesh(body, size=0.1, plane=True)
        sides = points[triangles[:, 1:]] - points[triangles[:, :1]]
        twice = np.cross(sides[:, 0], sides[:, 1])
        assert not points[:, 2].any() and not twice[:, :2].any() and (twice[:, 2] > 0).all()
        return twice[:, 2].sum() / 2, points

    for shape in ("sphere", "cylinder"):
        found, points = area(shape=shape, radius=0.5, axis=(0, 0, 1))
        assert found == pytest.approx(31 / 2 * 0.25 * np.sin(2 * np.pi / 31), rel=1e-4)  # 2 pi 0.5 / 0.1 = 31.4 sides
        assert points[:-1].mean(axis=0) == pytest.approx([1, 3, 0], abs=1e-3)
    lying = area(shape="capsule", radius=0.5, length=2.0, axis=(1, 0, 0))[0]
    assert np.pi * 0.25 + 2.0 > lying > 0.99 * (np.pi * 0.25 + 2.0)
    assert area(shape="half-space", normal=(0, -1, 0))[0] == pytest.approx((2.0 + 0.2) * 0.1)


def test_the_section_of_a_half_space_is_a_strip_as_deep_as_an_edge_and_an_edge_longer_than_the_body():
    """Its normal is (-0.6, 0.8, 0): the line runs along (0.8, 0.6, 0), on which the body lies from 0.3 x 0.8 to 0.5 x 0.8 + 0.2 x 0.6."""
    body = rigid(shape="half-space", normal=(-0.6, 0.8, 0.0), path=((0.1, 0.2, 0.0),))
    points, triangles = body.surface_mesh(np.array([[0.4, 0.2, 0.0], [0.6, 0.4, 0.0]]), size=0.05, plane=True)
    seen = (points - [0.1, 0.2, 0.0]) @ np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0]]).T
    ticks = np.linspace(0.24 - 0.05, 0.52 + 0.05, 9)  # 0.38 / 0.05 = 7.6 edges
    expected = [[x, y] for x in ticks for y in (0.0, -0.05)]
    outline = seen[:18]
    assert rounded(outline) == rounded(np.array(expected)) and seen[18:] == pytest.approx(np.array([[0.38, -0.025]]))
    assert len(triangles) == 18 and (np.cross(*np.moveaxis(points[triangles[:, 1:]] - points[triangles[:, :1]], 1, 0))[:, 2] > 0).all()


def rounded(points):
    return sorted(map(tuple, np.round(points, 9) + 0.0))


def test_the_sides_of_a_section_are_as_many_as_edges_fit_around_it_eight_at_least():
    for size, sides in ((0.1, 31), (0.5, 8), (0.2, 16)):  # 2 pi 0.5 = 3.14
        points, _ = rigid(shape="sphere", radius=0.5, path=((0.0, 0.0, 0.0),)).surface_mesh(np.zeros((1, 3)), size=size, plane=True)
        away = np.linalg.norm(points, axis=1)
        assert (away > 0.499).sum() == sides and away[-1 - sides] == pytest.approx(0.5, abs=1e-6) and points[-1 - sides, 1] == 0
    # Much larger than the edges that are asked for: at most a hundredth of its extent, which is pi r, half of what is around.
    points, _ = rigid(shape="sphere", radius=0.5, path=((0.0, 0.0, 0.0),)).surface_mesh(np.zeros((1, 3)), size=0.0157, plane=True)
    assert (np.linalg.norm(points, axis=1) > 0.499).sum() == 200
