"""An obstacle of triangles as contact sees it: a smooth distance, held against the shapes that it stands for."""

import numpy as np
import pytest

from physics.contact.obstacles import Rigid
from physics.contact.tool import Lattice
from physics.scene import Obstacle
from physics.scene.rules import complete
from physics.scene.surface import sound
from tests.tools import ball, brick, spanner, text_of

ORIGIN = (0.0, 0.0, 0.0)


def tool(surface, **keys):
    points, triangles, _ = sound(*surface)
    return Rigid(complete(Obstacle(**({"shape": "mesh", "surface": text_of(points, triangles), "path": (ORIGIN,)} | keys))))


def around(count, low, high, seed=0):
    """Points at distances low .. high from the origin, in all directions."""
    random = np.random.default_rng(seed)
    way = random.normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True) * random.uniform(low, high, size=(count, 1))


def test_before_a_flat_face_the_gap_is_exact():
    body = tool(brick((0.3, 0.2, 0.1), 0.0, 9.0), radius=0.02)
    across = np.random.default_rng(0).uniform(-0.05, 0.05, size=(50, 3)) + [0.1, -0.05, 0.1]
    gap, normal = body.gap(across, np.zeros(3))
    assert gap == pytest.approx(across[:, 2] - 0.1, abs=1e-14) and normal == pytest.approx(np.tile([0, 0, 1], (50, 1)), abs=1e-12)
    assert not body.bend(across, np.zeros(3)).any()


def test_gaps_to_a_ball_of_triangles_are_those_to_the_ball_with_an_error_of_the_second_order_in_their_size():
    """The sag of chords of length e is e^2 / 8 r, and a window of spacing h moves the surface by h^2 / 3 r; h is e or less."""
    points, error, turned = around(200, 0.98, 1.04), [], []
    for size in (0.4, 0.2, 0.1):
        body = tool(ball(1.0, size))
        gap, normal = body.gap(points, np.zeros(3))
        error.append(abs(gap - (np.linalg.norm(points, axis=1) - 1)).max())
        turned.append(np.linalg.norm(normal - points / np.linalg.norm(points, axis=1, keepdims=True), axis=1).max())
    assert error[1] < error[0] / 3 and error[2] < error[1] / 1.8 and error[2] < 0.006  # at 0.1 the window is as wide as a triangle
    assert turned[1] < turned[0] / 3 and turned[2] < 0.01


def test_the_window_moves_the_surface_of_a_ball_by_a_third_of_its_spacing_squared():
    h, fine = 0.1, tool(ball(1.0, 0.07), radius=0.1)
    points = around(200, 0.98, 1.02)
    inscribed = 0.07**2 / 8  # at most what the chords take from it
    off = fine.gap(points, np.zeros(3))[0] - (np.linalg.norm(points, axis=1) - 1)
    assert h**2 / 3 < off.mean() < h**2 / 3 + 2 * inscribed  # along and across


@pytest.mark.parametrize("surface, keys", [(ball(0.1, 0.03), {}), (spanner(), {"scale": 0.01, "radius": 0.005}),
                                           (spanner(), {"scale": 0.01, "axis": (1.0, 3.0, 1.0), "angle": 50.0})])
def test_normal_is_the_gradient_and_bend_the_rising_part_of_the_second_derivative(surface, keys):
    body = tool(surface, **keys)
    corners = body.shape.mesh(np.zeros((0, 3)), 1.0)[0] @ body.shape.frame
    random = np.random.default_rng(0)
    points = corners[random.integers(0, len(corners), 300)] + 0.003 * random.normal(size=(300, 3))
    step, centre = 1e-6, np.zeros(3)
    _, normal = body.gap(points, centre)
    slope = [(body.gap(points + step * e, centre)[0] - body.gap(points - step * e, centre)[0]) / (2 * step) for e in np.eye(3)]
    assert np.transpose(slope) == pytest.approx(normal, abs=1e-5)  # the third derivative is about 1 / h^2: 1e-12 / 1e-5
    second = [(body.gap(points + step * e, centre)[1] - body.gap(points - step * e, centre)[1]) / (2 * step) for e in np.eye(3)]
    value, vector = np.linalg.eigh(np.transpose(second, (1, 2, 0)))
    value = np.sort(np.maximum(value, 0), axis=1)
    bend = body.bend(points, centre)
    found = np.einsum("qik,qil->qkl", bend, bend)
    assert bend.shape == (300, 2, 3) and value[:, 1:].max() > 5
    assert np.linalg.eigvalsh(found)[:, 1:] == pytest.approx(value[:, 1:], abs=1e-3 * value.max())
    largest = np.einsum("qi,qij,qj->q", vector[:, :, 2], found, vector[:, :, 2])
    assert largest == pytest.approx(value[:, 2], abs=1e-3 * value.max())


def test_an_edge_recedes_as_if_rounded_by_the_radius():
    """A rounding of r takes (sqrt 2 - 1) r from an edge of 90 degrees; the window does so within a fifth, wherever its nodes lie."""
    for shift in (0.0, 0.003, 0.007):
        points, triangles = brick((0.3, 0.2, 0.25), 0.0, 9.0)
        body = tool((points + [shift, shift / 2, 0], triangles), radius=0.02)
        corner, inward = np.array([0.3 + shift, 0.2 + shift / 2, 0.05]), -np.array([1, 1, 0]) / np.sqrt(2)
        way = np.linspace(0, 0.03, 3001)
        gap = body.gap(corner + way[:, None] * inward, np.zeros(3))[0]
        assert gap[0] > 0 > gap[-1]
        assert way[(gap < 0).argmax()] == pytest.approx(0.02 * (np.sqrt(2) - 1), rel=0.25)


@pytest.mark.parametrize("size", [0.02, 0.01])
def test_a_rounded_brick_of_triangles_is_the_rounded_box(size):
    half, keys = (0.1, 0.08, 0.06), {"axis": (0.3, 1.0, 0.5), "angle": 40.0}
    body = tool(brick(half, 0.03, size), **keys)
    box = Rigid(Obstacle(shape="box", size=tuple(2 * h for h in half), radius=0.03, path=(ORIGIN,), **keys))
    points = around(4000, 0.06, 0.2, seed=1)
    near = points[abs(box.gap(points, np.zeros(3))[0]) < 0.005]
    assert len(near) > 100
    # chords and window, at corners of radius 0.03: size^2 / 8 r and h^2 / 3 r
    h = body.shape._lattice.h
    allowed = (size**2 / 8 + h**2 / 3) / 0.03 * 1.5
    assert abs(body.gap(near, np.zeros(3))[0] - box.gap(near, np.zeros(3))[0]).max() < allowed < 0.2 * size


def test_far_off_the_gap_is_a_lower_bound_of_its_size():
    surface = spanner()
    body = tool(surface)
    points = np.array([-20, 0, 0]) + around(3000, 0, 150)
    exact, _ = body.shape._lattice._closed.distance(points)
    gap, normal = body.gap(points, np.zeros(3))
    h = body.shape._lattice.h
    far = abs(exact) > 12 * h
    assert far.sum() > 2000 and (np.sign(gap[far]) == np.sign(exact[far])).all() and (abs(gap[far]) <= abs(exact[far]) + 1e-9).all()
    assert (abs(gap[far]) > 3 * h).all() and np.linalg.norm(normal[far], axis=1) == pytest.approx(1)
    near = abs(exact) < 2 * h
    assert near.sum() > 20 and abs(gap - exact)[near].max() < h


def test_samples_depend_on_no_order_of_asking():
    points, triangles, _ = sound(*spanner())
    places = np.array([0, 0, 3.0]) + around(200, 0, 8)
    at_once, one_by_one = Lattice(points, triangles, 0.5), Lattice(points, triangles, 0.5)
    each = np.concatenate([one_by_one.gap(place[None])[0] for place in places[::-1]])[::-1]
    assert np.array_equal(at_once.gap(places)[0], each)


def test_extents_are_those_of_the_turned_surface():
    body = tool(spanner(), scale=0.001, axis=(0.0, 0.0, 1.0), angle=90.0)
    assert body.width == pytest.approx(0.006) and body.shape.extent == pytest.approx(0.074)
    reach = [body.shape.reach(np.array(way, float)) for way in ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1])]
    assert reach == pytest.approx([0.011, 0.011, 0.014, 0.06, 0.003])  # the handle now points along -y
    points, triangles = body.surface_mesh(np.zeros((1, 3)), size=0.001)
    assert points[:, 1].min() == pytest.approx(-0.06) and len(triangles) == 44
    assert body.gap(np.array([[0.0, -0.061, 0.0]]), np.zeros(3))[0] == pytest.approx(0.001, abs=1e-6)


def test_where_a_scene_says_nothing_the_window_is_a_twentieth_of_the_thickness_or_a_triangle():
    assert tool(spanner()).shape._lattice.h == pytest.approx(6 / 20)
    points, triangles = ball(1.0, 0.05)
    edges = np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2)
    assert tool((points, triangles)).shape._lattice.h == pytest.approx(np.median(edges)) and np.median(edges) < 0.09
