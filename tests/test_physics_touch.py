"""The zone of a surface near an obstacle, and one Newton step there: against loops, differences and whole matrices."""

import numpy as np
import pytest

from physics.contact.conditions import ContactSurface
from physics.contact.obstacles import Rigid
from physics.contact.touch import Condensed, Contact, Touch
from physics.mesh.build import build_mesh
from physics.scene import Body, Obstacle

CENTRE = np.array([0.11, 0.07, 0.148])
DEEP = np.array([0.11, 0.07, 0.115])
RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def contact():
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 1), cell="prism"))
    surface = ContactSurface(mesh, "facets", np.zeros(len(mesh.points), bool))
    rigid = Rigid(Obstacle(shape="capsule", radius=0.05, length=0.03, axis=(1.0, 0.4, 0.1), path=((9.0, 9.0, 9.0),)))
    return Contact(surface, rigid, mesh.points, 5e3)


U = RNG.normal(scale=4e-3, size=(24, 3))


def test_softness_is_one_over_stiffness_and_area(contact):
    assert contact.softness == pytest.approx([1 / (5e3 * area) for area in contact.surface.area])


def test_gaps_and_forces_are_those_of_each_point(contact):
    gap, normal = contact.gaps(U, CENTRE)
    weights, x = contact.surface.weights.toarray(), contact.rest + U
    pressure = RNG.uniform(1, 2, len(gap))
    force = np.zeros((24, 3))
    for q in range(len(gap)):
        (g,), (n,) = contact.obstacle.gap((weights[q] @ x)[None], CENTRE)
        assert gap[q] == pytest.approx(g, abs=1e-15) and normal[q] == pytest.approx(n)
        for a in range(24):
            force[a] += weights[q, a] * pressure[q] * n
    assert contact.forces(pressure, normal) == pytest.approx(force)


def test_a_zone_is_what_is_nearer_than_its_reach(contact):
    gap, normal = contact.gaps(U, CENTRE)
    reach = float(np.sort(gap)[12:14].mean())
    zone = contact.zone(U, CENTRE, reach)
    assert zone.points.tolist() == [q for q in range(len(gap)) if gap[q] < reach] and len(zone.points) == 13
    assert 0 < (gap[zone.points] < 0).sum() < 13
    weights = contact.surface.weights.toarray()
    assert zone.nodes.tolist() == [a for a in range(24) if any(weights[q, a] for q in zone.points)] and len(zone.nodes) < 24
    assert np.array_equal(zone.weights.toarray(), weights[zone.points][:, zone.nodes])
    assert np.array_equal(zone.softness, contact.softness[zone.points])
    there = zone.gaps(U, CENTRE)
    assert there[0] == pytest.approx(gap[zone.points]) and there[1] == pytest.approx(normal[zone.points])
    pressure = np.zeros(len(gap))
    pressure[zone.points] = RNG.uniform(1, 2, 13)
    whole = contact.forces(pressure, normal)
    assert zone.forces(pressure[zone.points], there[1]) == pytest.approx(whole[zone.nodes])
    assert whole.sum(axis=0) == pytest.approx(whole[zone.nodes].sum(axis=0))


@pytest.mark.parametrize("keys", [{"shape": "sphere"}, {"shape": "cylinder", "axis": (0.0, 2.0, 1.0)},
                                  {"shape": "capsule", "axis": (1.0, 2.0, 1.0), "length": 0.08}])
def test_the_compiled_pass_finds_what_the_round_shapes_say(contact, keys):
    """At points on all sides, past both ends of the capsule, and on the axis itself, where the normal is one that was chosen."""
    rigid = Rigid(Obstacle(radius=0.05, path=((0.0, 0.0, 0.0),), **keys))
    zone = Contact(contact.surface, rigid, contact.rest, 5e3).zone(U, CENTRE, np.inf)
    points = CENTRE + np.random.default_rng(5).normal(scale=0.06, size=(len(zone.points), 3))
    points[:3] = CENTRE, CENTRE + 0.01 * rigid.shape.axis, CENTRE + 0.06 * rigid.shape.anywhere  # the last beside the middle
    zone.positions = lambda u: points
    for found, said in zip(zone.gaps(U, CENTRE), rigid.gap(points, CENTRE), strict=True):
        assert found == pytest.approx(said, rel=0, abs=1e-12)
    pressed, pressure = np.arange(2, len(points)), np.full(len(points) - 2, 4.0)
    every = np.arange(len(zone.nodes))
    bend, expected = zone.bend(pressed, every, pressure, U, CENTRE), 2 * rigid.bend(points[2:], CENTRE)
    weights = zone.weights.toarray()[pressed]
    whole = np.einsum("qa,qtk->qtak", weights, expected).reshape(2 * len(pressed), -1)
    assert bend == pytest.approx(whole[expected.any(axis=2).ravel()], rel=0, abs=1e-11)


def test_a_zone_covers_what_moved_less_than_its_margin(contact):
    """One node moved by 5 mm (3, 4 across), others by less, the obstacle by 3 mm (2, -1, 2): 8 mm of 10 - 2 mm."""
    zone = contact.zone(U, CENTRE, 0.010)
    moved = U.copy()
    moved[0] += [0.001, -0.001, 0.0]
    moved[7] += [0.003, 0.0, -0.004]
    moved[20] += [0.0, 0.0045, 0.0]
    beside = CENTRE + [0.002, -0.001, 0.002]
    assert zone.covers(moved, beside, 0.002 - 1e-9) and not zone.covers(moved, beside, 0.002 + 1e-9)
    assert zone.covers(moved, CENTRE, 0.005 - 1e-9) and not zone.covers(moved, CENTRE, 0.005 + 1e-9)
    assert zone.covers(U, beside, 0.007 - 1e-9) and not zone.covers(U, beside, 0.007 + 1e-9)
    assert zone.covers(U, CENTRE, 0.010) and not zone.covers(U, CENTRE, 0.011)
    # What it promises: after any such motion no point outside is nearer than that.
    outside = np.setdiff1d(np.arange(len(contact.surface.area)), zone.points)
    assert contact.gaps(moved, beside)[0][outside].min() >= 0.002


def touch(contact):
    zone = contact.zone(U, DEEP, 0.02)
    gap, normal = zone.gaps(U, DEEP)
    pressure = np.where(gap < 0, -gap / zone.softness, 0.0)
    return Touch(zone, U, DEEP, gap, normal, pressure)


def moved_gaps(zone, nodes, step):
    """Gaps at displacements whose components of the zone's `nodes` differ by +-step, one at a time: (3 n, q) differences."""
    rows = []
    for node in zone.nodes[nodes]:
        for k in range(3):
            ends = []
            for sign in (1, -1):
                u = U.copy()
                u[node, k] += sign * step
                ends.append(zone.gaps(u, DEEP))
            rows.append(ends)
    return rows


def test_rows_are_derivatives_of_the_gaps(contact):
    """G by central differences, B^T B by those of the forces p n: some points pressed, some not, not all of the zone."""
    made = touch(contact)
    zone, points = made.zone, np.flatnonzero(made.gap < 0.012)[1:]
    assert 2 < (made.pressure[points] > 0).sum() < len(points) < len(zone.points)
    nodes, gradient, bend = made.rows(points)
    assert nodes.tolist() == [a for a in range(len(zone.nodes)) if zone.weights[points, a].nnz]
    step, weights = 1e-6, zone.weights[points][:, nodes].toarray()
    ends = moved_gaps(zone, nodes, step)
    slope = np.array([(high[0] - low[0])[points] / (2 * step) for high, low in ends]).T
    assert gradient == pytest.approx(slope, abs=1e-8)
    force = made.pressure[points, None] * np.array([(high[1] - low[1])[points] / (2 * step) for high, low in ends])  # (3 n, k, 3)
    second = np.einsum("kn,jkd->jnd", weights, force).reshape(gradient.shape[1], -1)
    assert bend.T @ bend == pytest.approx(second, abs=1e-6 * abs(second).max())
    pressed = (made.pressure[points] > 0).sum()
    assert pressed <= len(bend) <= 2 * pressed and bend.any(axis=1).all()


@pytest.mark.parametrize("scale, negative", [(0.1, 0), (0.6, 0), (1.6, 1), (30.0, 2)])
def test_a_condensed_body_is_the_whole_one_without_what_a_round_obstacle_takes(scale, negative):
    """K' = K - B^T B of 7 unknowns, 4 points and 2 rows of B, inverted as a whole; some of its eigenvalues below zero."""
    rng = np.random.default_rng(0)
    root, g = rng.normal(size=(7, 7)), rng.normal(size=(4, 7))
    k = root @ root.T + np.eye(7)
    b = scale * np.linalg.cholesky(k)[:, [1, 4]].T * np.array([[1.0], [0.3]])  # B K^-1 B^T: scale^2 diag(1, 0.09)
    softness = np.diag(rng.uniform(0.1, 1, 4))
    inside = np.linalg.eigvalsh(k - b.T @ b)
    assert (inside < 0).sum() == negative
    inverse = np.linalg.inv(k)
    left, across = np.eye(2) - b @ inverse @ b.T, b @ inverse @ g.T
    made = Condensed(g @ inverse @ g.T + softness, across, left, 5)
    assert made.negative == 5 + negative
    assert made.matrix == pytest.approx(g @ np.linalg.inv(k - b.T @ b) @ g.T + softness, rel=1e-8)
    assert left @ made.turn(np.array([2.0, -3.0])) == pytest.approx([2.0, -3.0])
    assert made.across is across


def test_where_nothing_is_round_nothing_is_taken():
    made = Condensed(np.diag([2.0, 3.0]), np.zeros((0, 2)), np.zeros((0, 0)), 1)
    assert np.array_equal(made.matrix, np.diag([2.0, 3.0])) and made.negative == 1 and made.turn(np.zeros(0)).shape == (0,)
