"""Rigid obstacles: distances and normals worked out on paper, curvature, paths and surface meshes."""

import itertools

import numpy as np
import pytest

from physics.contact import obstacles as obstacle
from physics.contact import shapes
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
BODY = np.array([[0.0, -0.5, -0.5], [0.0, 0.5, 0.5], [0.2, 0.0, 0.0]])

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


def test_waypoints_are_reached_at_equal_fractions():
    body = Rigid(SPHERE)
    assert body.position(0.0) == pytest.approx([0, 0, 0])
    assert body.position(0.25) == pytest.approx([0.5, 0, 0])
    assert body.position(0.5) == pytest.approx([1, 0, 0])
    assert body.position(0.6) == pytest.approx([1, 0.2, 0])
    assert body.position(1.0) == pytest.approx([1, 1, 0])
    assert Rigid(OBSTACLES["box"]).position(0.7) == pytest.approx(ROOT)


# Surface meshes. An N-gon in a circle of radius r has the area N / 2 sin(2 pi / N) r^2.


def gon(n):
    return n / 2 * np.sin(2 * np.pi / n)


def rows(points):
    """Points as a sorted list of rounded ones; + 0 makes -0 to 0."""
    return sorted(map(tuple, np.round(points, 9) + 0.0))


def volume_of(points, triangles, centre):
    """The volume within closed outward triangles, by the divergence theorem."""
    directed = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    assert sorted(map(tuple, directed)) == sorted(map(tuple, directed[:, ::-1]))  # each edge once in either direction
    assert set(triangles.ravel()) == set(range(len(points)))
    a, b, c = (points[triangles[:, i]] - centre for i in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0
    return (np.cross(a, b) * c).sum() / 6


def test_mesh_of_a_cylinder_reaches_past_the_body_by_an_edge():
    body = rigid(shape="cylinder", radius=0.3, axis=(0.0, 0.0, 2.0))
    around, size = 13, 0.15  # 2 pi 0.3 / 0.15 = 12.57
    points, triangles = body.surface_mesh(np.array([[5, 5, 0.1], [4, -5, 1.0], [5, 0, 0.7]]), size=size)
    heights = np.linspace(0.1 - size, 1.0 + size, 9)  # 1.2 in eight parts of 0.15
    # The angle starts across the axis and the coordinate that it has least of, the first one: at z x e_x = e_y, and turns towards -e_x.
    angle = 2 * np.pi * np.arange(around) / around
    ring = 0.3 * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    expected = [[0.1 + x, 0.2 + y, z] for z in heights for x, y in ring] + [[0.1, 0.2, heights[0]], [0.1, 0.2, heights[-1]]]
    assert rows(points) == rows(expected)
    assert len(triangles) == 2 * around * 8 + 2 * around
    assert volume_of(points, triangles, ROOT) == pytest.approx(gon(around) * 0.09 * 1.2)


@pytest.mark.parametrize("size, edges", [(0.1, (15, 8, 4)), (0.25, (8, 3, 2)), (9.0, (8, 1, 1))])
def test_mesh_of_a_capsule_is_turned_about_its_tilted_axis(size, edges):
    """Rings along its 0.8 and up its quarter circles; radius 0.25, so that 2 pi r / size = 15.7 (16), 6.3 and less, at least 8."""
    around, long, up = (16 if size == 0.1 else edges[0]), edges[1], edges[2]
    body = rigid(shape="capsule", radius=0.25, length=0.8, axis=TILTED)
    points, triangles = body.surface_mesh(BODY, size=size)
    seen = points - ROOT
    along, across = seen @ A, np.linalg.norm(seen - np.outer(seen @ A, A), axis=1)
    cap = np.pi / 2 * np.arange(1, up) / up
    rings = [(0.25, z) for z in np.linspace(-0.4, 0.4, long + 1)]
    rings += [(0.25 * np.cos(t), side * (0.4 + 0.25 * np.sin(t))) for t in cap for side in (-1, 1)]
    expected = [ring for ring in rings for _ in range(around)] + [(0, 0.65), (0, -0.65)]
    assert rows(np.stack([across, along], axis=1)) == rows(expected)
    profile = [(0, -0.65), *sorted(rings, key=lambda ring: ring[1]), (0, 0.65)]
    frusta = sum((z2 - z1) * (r1 * r1 + r1 * r2 + r2 * r2) / 3 for (r1, z1), (r2, z2) in itertools.pairwise(profile))
    assert volume_of(points, triangles, ROOT) == pytest.approx(gon(around) * frusta)
    assert body.gap(points, np.array(ROOT))[0] == pytest.approx(0, abs=1e-12)


def test_mesh_of_a_sphere_has_one_ring_at_its_equator():
    body = rigid(shape="sphere", radius=0.3, path=((2.0, 1.0, 0.0), (9.0, 9.0, 9.0)))  # drawn where the path starts
    points, triangles = body.surface_mesh(BODY, size=0.12)
    around, up = 16, 4  # 2 pi 0.3 / 0.12 = 15.7, pi / 2 * 0.3 / 0.12 = 3.93
    latitude = np.pi / 2 * np.arange(-up + 1, up) / up
    heights = [0.3 * np.sin(t) for t in latitude for _ in range(around)] + [-0.3, 0.3]
    seen = points - [2, 1, 0]
    assert sorted((seen @ [0, 1, 0]).round(9) + 0.0) == sorted(np.round(heights, 9) + 0.0)  # the axis is y where none is given
    assert np.linalg.norm(seen, axis=1) == pytest.approx(0.3)
    profile = [(0.3 * np.cos(t), 0.3 * np.sin(t)) for t in np.pi / 2 * np.arange(-up, up + 1) / up]
    frusta = sum((z2 - z1) * (r1 * r1 + r1 * r2 + r2 * r2) / 3 for (r1, z1), (r2, z2) in itertools.pairwise(profile))
    assert volume_of(points, triangles, [2, 1, 0]) == pytest.approx(gon(around) * frusta)


@pytest.mark.parametrize("radius", [0.0, 0.1])
def test_mesh_of_a_box_is_its_grid_moved_onto_the_rounding(radius):
    body = rigid(shape="box", radius=radius, size=(0.6, 0.8, 1.5))
    points, triangles = body.surface_mesh(BODY, size=0.22)
    grid = [np.linspace(-h, h, n + 1) for h, n in ((0.3, 3), (0.4, 4), (0.75, 7))]  # 2.7, 3.6 and 6.8 edges
    expected = []
    for p in itertools.product(*grid):
        if any(abs(c) == t[-1] for c, t in zip(p, grid, strict=True)):
            inner = np.array([min(max(c, radius - t[-1]), t[-1] - radius) for c, t in zip(p, grid, strict=True)])
            way = np.array(p) - inner
            expected.append(inner + radius * way / (np.linalg.norm(way) or 1.0) + ROOT)
    assert rows(points) == rows(expected)
    assert len(triangles) == 4 * (3 * 4 + 4 * 7 + 7 * 3)
    volume = volume_of(points, triangles, ROOT)
    if radius:  # itself, plates on its faces, quarter cylinders on its edges, eighths of a sphere at its corners: inscribed
        exact = 0.4 * 0.6 * 1.3 + 0.2 * (0.24 + 0.52 + 0.78) + np.pi * 0.01 * 2.3 + 4 / 3 * np.pi * 0.001
        assert 0.9 * exact < volume < exact
    else:
        assert volume == pytest.approx(0.6 * 0.8 * 1.5)
    assert body.gap(points, np.array(ROOT))[0] == pytest.approx(0, abs=1e-12)


def test_half_space_is_shown_as_a_square_below_the_body():
    body = rigid(shape="half-space", normal=(0.0, 0.0, 3.0))
    seen = np.array([[1.0, 2.0, 0.5], [3.0, 2.5, 9.0], [1.5, 2.9, 1.0]])  # 2 by 0.9 from above
    points, triangles = body.surface_mesh(seen, size=0.3)
    ticks = np.linspace(-1.3, 1.3, 10)  # half of 2, and an edge; 2.6 / 0.3 = 8.7
    assert rows(points) == rows([[2 + a, 2.45 + b, 0.3] for a in ticks for b in ticks])
    a, b, c = (points[triangles[:, i]] for i in range(3))
    area = np.cross(b - a, c - a) / 2
    assert area == pytest.approx(np.tile([0, 0, (2.6 / 9) ** 2 / 2], (162, 1)))  # 2 x 81 of them, all seen from above
    assert len(np.unique(np.sort(triangles, axis=1), axis=0)) == 162
    middle = np.array(rows((a + b + c) / 3))
    assert len(np.unique(middle, axis=0)) == 162
    # Along another axis it still lies in the plane, around the middle of the body's shadow.
    tilted = rigid(shape="half-space", normal=tuple(2 * C))
    points, triangles = tilted.surface_mesh(seen, size=0.3)
    assert tilted.gap(points, np.array(ROOT))[0] == pytest.approx(0, abs=1e-12)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a) @ C > 0).all()
    shadow = seen - np.outer((seen - ROOT) @ C, C)
    assert (np.linalg.norm(points[:, None] - shadow, axis=2).min(axis=0) < 0.3).all()


@pytest.mark.parametrize("axis", np.eye(3).tolist() + [[3.0, -1.0, 2.0], [-1.0, 5.0, 5.0], [4.0, 3.0, -1.0]])
def test_across_an_axis_away_from_what_it_has_least_of(axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    across = shapes._across(axis)
    assert across @ axis == pytest.approx(0, abs=1e-15) and np.linalg.norm(across) == pytest.approx(1, abs=1e-15)
    assert across[abs(axis).argmin()] == 0


def test_a_large_obstacle_is_drawn_with_longer_edges(monkeypatch):
    """At most `FINEST` edges along a side, or half around; here 6, where the edges that are asked for would make thousands."""
    monkeypatch.setattr(obstacle, "FINEST", 6)
    sharp = rigid(shape="box", radius=0.0, size=(0.6, 0.8, 1.2)).surface_mesh(BODY, size=1e-3)[0]
    # 1.2 / 6 = 0.2: 3, 4 and 6 edges; all grid points but the inner ones.
    assert len(sharp) == 4 * 5 * 7 - 2 * 3 * 5
    ball = rigid(shape="sphere", radius=0.5).surface_mesh(BODY, size=1e-3)[0]
    assert len(ball) == 12 * 5 + 2  # 12 around, 3 up from the equator: 5 rings and two poles
    long = rigid(shape="capsule", radius=0.1, length=1.2, axis=(1.0, 0.0, 0.0)).surface_mesh(BODY, size=1e-3)[0]
    assert len(long) == 8 * 7 + 2  # edges of 0.2: 6 along, one up, 8 around
    assert len(rigid(shape="sphere", radius=0.5).surface_mesh(BODY, size=0.5)[0]) == 8 * 3 + 2  # longer ones are kept


def test_finest_is_a_hundred():
    assert len(rigid(shape="capsule", radius=1e-4, length=0.1).surface_mesh(BODY, size=1e-9)[0]) == 8 * 101 + 2


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
