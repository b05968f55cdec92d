"""Contact within a step of time: mean normals and plastic impacts, worked out on paper and against every possible set."""

import itertools

import numpy as np
import pytest

from physics.contact.conditions import ContactSurface
from physics.contact.obstacles import Rigid
from physics.contact.touch import Contact
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.motion.impact import Sweeping, bear
from physics.scene import Body, Obstacle

# A tetrahedron whose nodes are its points of contact; each face has a third of its area at each of its corners.
REST = np.array([[5.0, 6, 7], [6, 6, 7], [5, 8, 7], [5, 6, 10]])
MESH = Mesh(points=REST, cells=np.arange(4)[None], cell="tetrahedron", places={})
START, END = np.array([4.0, 5.0, 6.0]), np.array([4.5, 5.25, 5.0])


def on_nodes(obstacle, stiffness=100.0, held=(), mesh=MESH):
    surface = ContactSurface(mesh, "nodes", np.isin(np.arange(len(mesh.points)), held))
    return Contact(surface, Rigid(obstacle), mesh.points, stiffness)


def swept(obstacle, before, after, centres=(START, END)):
    """Gap and mean normal of the nodes on their way from places before to places after (4, 3), seen from the obstacle."""
    contact = Sweeping(on_nodes(obstacle))
    contact.begin(centres[0] + before - REST, centres[0])
    u = centres[1] + after - REST
    zone = contact.zone(u, centres[1], np.inf)
    assert zone.points.tolist() == [0, 1, 2, 3]
    return zone.gaps(u, centres[1])


BALL = Obstacle(shape="sphere", radius=0.5, path=(tuple(START), tuple(END)))


def test_mean_normals_of_a_ball_on_paper():
    """From (2, 0, 0) to (0, 1, 0): halfway n = (2, 1, 0)/sqrt 5, which along (-2, 1, 0) foresees -3/sqrt 5 of the gap's change, -1."""
    before = np.array([[2.0, 0, 0], [0, 3, 0], [0, 0, 1], [0.6, 0.8, 0]])
    after = np.array([[0.0, 1, 0], [0, 2, 0], [2, 0, 1], [0.8, -0.6, 0]])
    gap, normal = swept(BALL, before, after)
    five = np.sqrt(5)
    assert gap == pytest.approx([0.5, 1.5, five - 0.5, 0.5])
    assert normal[0] == pytest.approx(np.array([2, 1, 0]) / five + (-1 + 3 / five) / 5 * np.array([-2, 1, 0]))
    assert normal[1] == pytest.approx([0, 1, 0])  # straight towards it
    assert normal[2] == pytest.approx(np.array([1, 0, 1]) / np.sqrt(2) + (five - 1 - np.sqrt(2)) / 4 * np.array([2, 0, 0]))
    assert normal[3] == pytest.approx(np.array([1.4, 0.2, 0]) / np.sqrt(2))  # round it: no work
    assert normal[3] @ (after - before)[3] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("shape", [{"shape": "capsule", "radius": 0.5, "length": 2.0, "axis": (1.0, 2.0, 2.0)},
                                   {"shape": "box", "radius": 0.1, "size": (1.0, 2.0, 1.5)},
                                   {"shape": "half-space", "normal": (1.0, 2.0, -2.0)}])
def test_the_work_along_a_mean_normal_is_the_change_of_the_gap(shape):
    obstacle = Obstacle(path=(tuple(START), tuple(END)), **shape)
    before, after = np.random.default_rng(5).normal(scale=2, size=(2, 4, 3))
    gap, normal = swept(obstacle, before, after)
    rigid, origin = Rigid(obstacle), np.zeros(3)
    assert gap == pytest.approx(rigid.gap(after, origin)[0])
    assert (normal * (after - before)).sum(axis=1) == pytest.approx(gap - rigid.gap(before, origin)[0])
    if shape["shape"] == "half-space":
        assert normal == pytest.approx(np.tile(np.array([1, 2, -2]) / 3, (4, 1)))


def test_a_point_that_does_not_move_has_the_normal_where_it_is():
    """Ways shorter than 1e-9 of the largest coordinate at rest, 10 m, are none: 5e-9 m, and not 5e-8 m on a ball of 10 nm."""
    tiny = Obstacle(shape="sphere", radius=1e-8, path=((0.0, 0.0, 0.0),))
    before = np.array([[2e-8, 0, 0], [3e-8, 0, 0], [0, 0, 1.0], [1.0, 0, 0]])
    after = before + [[0, 5e-9, 0], [0, 5e-8, 0], [0, 0, 0], [-0.5, 0, 0]]
    nowhere = np.zeros(3)
    rest = before + [0, 0, 10.0]
    mesh = Mesh(points=rest, cells=MESH.cells, cell="tetrahedron", places={})
    contact = Sweeping(on_nodes(tiny, mesh=mesh))
    contact.begin(before - rest, nowhere)
    zone = contact.zone(after - rest, nowhere, np.inf)
    zone._rest[:] = 0  # numbers so small would be lost in those of the rest places
    zone._rest[3] = [0, -10.0, 0]
    contact.begin(before - zone._rest, nowhere)
    _, normal = zone.gaps(after - zone._rest, nowhere)
    assert normal[0] == pytest.approx(np.array([4, 1, 0]) / np.sqrt(17), rel=1e-12)
    way, change = 5e-8, np.sqrt(34) * 1e-8 - 3e-8
    middle = np.array([6, 5, 0]) / np.sqrt(61)
    expected = middle + (change - 5e-8 * middle[1]) / way * np.array([0, 1, 0])
    assert normal[1] == pytest.approx(expected) and abs(normal[1, 1] - 5 / np.sqrt(34)) > 0.1
    assert np.array_equal(normal[2], [0, 0, 1]) and normal[3] == pytest.approx([1, 0, 0])


def test_before_the_first_step_everything_is_at_rest():
    contact = Sweeping(on_nodes(BALL))
    assert np.array_equal(contact.u, np.zeros((4, 3))) and np.array_equal(contact.centre, START)


def plane(stiffness, held=()):
    return on_nodes(Obstacle(shape="half-space", normal=(0.0, 3.0, 4.0), path=((0.0, 0.0, 0.0),)), stiffness, held)


def test_one_point_that_bears_is_stopped():
    """Mass 2 kg, v.n = 0.6 (-5) + 0.8 (1) = -2.2 m/s, obstacle 0.5 m/s along n, p = 30 N for 0.1 s.

    Without the force's 3 N s it would have v.n = -3.7 and come nearer by 4.2 m/s; the softness c = 1/(k A) = 0.05 m/N counts as
    2 c / h^2 = 10 / kg beside the 1/2 of its mass, so the impulse is 4.2 / 10.5 = 0.4 N s.
    """
    area = (9 - 3.0) / 3  # of node 1: all faces (half of 2, 6, 3 and 7 m2) but the one that it is not part of
    contact = plane(1 / (0.05 * area))
    n = np.array([0, 0.6, 0.8])
    velocity = np.arange(12.0).reshape(4, 3)
    velocity[1] = [7.0, -5.0, 1.0]
    pressure = np.array([0, 30.0, 0, 0])
    after, force = bear(contact, np.zeros((4, 3)), velocity, pressure=pressure, centre=np.zeros(3), towards=0.5 * n,
                        mobile=np.repeat(1 / np.array([[3.0], [2.0], [5.0], [7.0]]), 3, axis=1), h=0.1)
    assert after[1] == pytest.approx(velocity[1] - 1.5 * n + 0.2 * n)
    assert np.array_equal(after[[0, 2, 3]], velocity[[0, 2, 3]])
    assert force[0] == pytest.approx((0.4 - 3) / 0.1 * n)


def test_a_point_that_leaves_is_let_go():
    """Its force's impulse is taken back and none is found instead; a point without a force is none that bears."""
    contact = plane(100.0)
    n = np.array([0, 0.6, 0.8])
    velocity = np.array([[1.0, 2, 3], [0, 6, 8], [0, -9, -9], [4, 5, 6]])
    after, force = bear(contact, np.zeros((4, 3)), velocity, pressure=np.array([0, 20.0, 0, 0]), centre=np.zeros(3), towards=np.zeros(3),
                        mobile=np.full((4, 3), 0.25), h=0.05)
    assert after[1] == pytest.approx([0, 6, 8] - 0.25 * n) and force[0] == pytest.approx(-20 * n)
    assert np.array_equal(after[[0, 2, 3]], velocity[[0, 2, 3]])


def test_points_that_share_nodes_are_stopped_together():
    """Against all sets of points that could bear: impulses of which none pulls, and rates of which none leads inwards."""
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(1, 1, 1), cell="prism"))
    surface = ContactSurface(mesh, "facets", np.zeros(len(mesh.points), bool))
    contact = Contact(surface, Rigid(Obstacle(shape="sphere", radius=0.1, path=((0.0, 0.0, 0.0),))), mesh.points, 4e3)
    rng = np.random.default_rng(2)
    u, velocity = rng.normal(scale=0.01, size=(2, *mesh.points.shape)) * np.array([[[1.0]], [[100.0]]])
    centre, towards, h = np.array([0.12, 0.09, 0.19]), np.array([0.1, -0.2, -0.5]), 0.07
    on = [1, 4, 5, 9, 12, 17]
    pressure = np.zeros(len(surface.area))
    pressure[on] = rng.uniform(1, 3, 6)
    mobile = rng.uniform(0.5, 2, size=mesh.points.shape)
    mobile[0, 1] = 0.0  # a held component keeps its velocity
    after, force = bear(contact, u, velocity, pressure=pressure, centre=centre, towards=towards, mobile=mobile, h=h)

    weights, (_, normal) = surface.weights.toarray(), contact.gaps(u, centre)
    g = np.array([np.outer(weights[q], normal[q]).ravel() for q in on])
    loose = velocity - mobile * (h * pressure[on] @ g).reshape(-1, 3)
    matrix = g @ np.diag(mobile.ravel()) @ g.T + np.diag([2 / h**2 / (4e3 * surface.area[q]) for q in on])
    rate = g @ loose.ravel() - normal[on] @ towards
    found = []
    for some in itertools.product([False, True], repeat=6):
        some, pi = np.array(some), np.zeros(6)
        pi[some] = np.linalg.solve(matrix[np.ix_(some, some)], -rate[some])
        if pi.min() >= 0 and (rate + matrix @ pi).min() >= -1e-12:
            found.append(pi)
    (pi,) = found
    assert 0 < (pi > 0).sum() < 6
    assert after == pytest.approx(loose + mobile * (pi @ g).reshape(-1, 3)) and after[0, 1] == velocity[0, 1]
    assert force[0] == pytest.approx(sum((pi[i] / h - pressure[q]) * normal[q] for i, q in enumerate(on)))
