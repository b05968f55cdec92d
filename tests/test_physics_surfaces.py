"""Surface meshes of rigid obstacles: their nodes, listed, and the volume within them. An N-gon in a circle of radius r has the area
N / 2 sin(2 pi / N) r^2."""

import itertools

import numpy as np
import pytest

from physics.contact import obstacles as obstacle
from physics.contact import shapes, surfaces
from physics.contact.obstacles import Rigid
from physics.scene import Obstacle

ROOT = (0.1, 0.2, 0.3)
BODY = np.array([[0.0, -0.5, -0.5], [0.0, 0.5, 0.5], [0.2, 0.0, 0.0]])
A, C = np.array([1, 2, 2]) / 3, np.array([2, -2, 1]) / 3  # at right angles, neither of them along a coordinate
TILTED = tuple(6 * A)  # an axis need not be of unit length


def rigid(**keys):
    return Rigid(Obstacle(**({"path": (ROOT,)} | keys)))


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


def test_lines_are_divided_in_equal_parts_about_a_size_long():
    assert surfaces.divide(1.0, 2.0, 0.3).tolist() == pytest.approx([1, 4 / 3, 5 / 3, 2])  # 3.3 of them
    assert surfaces.divide(-1.0, 1.0, 9.0).tolist() == [-1, 1]  # one at least
    assert surfaces.divide(0.0, 2.0, 0.8).tolist() == [0, 1, 2]  # 2.5, the half to the even number
    assert surfaces.divide(3.0, 3.0, 0.1).tolist() == surfaces.divide(3.0, 2.0, 0.1).tolist() == [3]


def test_a_disc_is_its_outline_drawn_in_in_rings_and_its_middle():
    """A rectangle of 4 by 2 around (1, 1): its corners are sqrt(5) from the middle, in edges of 1 two rings."""
    outline = np.array([[-1.0, 0, 0], [3, 0, 0], [3, 2, 0], [-1, 2, 0]])
    points, triangles = surfaces.disc(outline, 1.0)
    assert points.tolist() == [[0, 0.5, 0], [2, 0.5, 0], [2, 1.5, 0], [0, 1.5, 0], *outline.tolist(), [1, 1, 0]]
    assert triangles.tolist() == [[8, 0, 1], [8, 1, 2], [8, 2, 3], [8, 3, 0], [0, 4, 5], [1, 5, 6], [2, 6, 7], [3, 7, 4],
                                  [0, 5, 1], [1, 6, 2], [2, 7, 3], [3, 4, 0]]
    points, triangles = surfaces.disc(outline, 9.0)  # one ring at least
    assert points.tolist() == [*outline.tolist(), [1, 1, 0]] and triangles.tolist() == [[4, 0, 1], [4, 1, 2], [4, 2, 3], [4, 3, 0]]
    assert len(surfaces.disc(outline, 0.4)[0]) == 6 * 4 + 1  # 5.6
