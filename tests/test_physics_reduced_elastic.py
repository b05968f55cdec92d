"""The elasticity of a body in numpy against closed forms: one deformation throughout, turned bodies, moments of cells."""

from math import factorial

import numpy as np
import pytest

from physics.mesh import cell as cells
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.reduced import elastic as module
from physics.reduced.elastic import Elastic, symmetric
from physics.scene import Body, Material

CELLS = ("prism", "tetrahedron", "hexahedron")
LAWS = ("neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear")
SIDES = (0.06, 0.02, 0.03)
NU = 0.3
LAMBDA, MU = 0.3 / (1.3 * 0.4), 1 / 2.6  # of Young's modulus 1
# a gradient with nine different components, det F = 1.1 or so
H = np.array([[0.11, 0.05, -0.07], [-0.02, 0.06, 0.13], [0.09, -0.04, -0.03]])


def body(cell="prism", law="linear", cells=(2, 2, 1)):
    mesh = build_mesh(Body(length=SIDES[0], width=SIDES[1], height=SIDES[2], cells=cells, cell=cell))
    held = np.zeros(len(mesh.points), bool)
    held[mesh.places["x-min"]] = True
    return mesh, held, Elastic(mesh, held, Material(young_modulus=7.0, poisson_ratio=NU, law=law))


def energy(law, f):
    """W (f) over Young's modulus, of complex f too."""
    c = f.T @ f
    j = np.linalg.det(f) if f.dtype == float else f[0] @ np.cross(f[1], f[2])
    if law == "linear":
        e = (f + f.T) / 2 - np.eye(3)
    else:
        e = (c - np.eye(3)) / 2
    if law in ("linear", "saint-venant-kirchhoff"):
        return LAMBDA / 2 * np.trace(e) ** 2 + MU * np.trace(e @ e)
    if law == "neo-hookean-log":
        return MU / 2 * (np.trace(c) - 3) - MU * np.log(j) + LAMBDA / 2 * np.log(j) ** 2
    bulk = LAMBDA + 2 / 3 * MU
    return MU / 2 * (j ** (-2 / 3) * np.trace(c) - 3) + bulk / 4 * (j**2 - 1 - 2 * np.log(j))


def stress(law, f):
    """P = dW/dF, by complex steps: exact."""
    found = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            step = f.astype(complex)
            step[i, j] += 1e-30j
            found[i, j] = energy(law, step).imag / 1e-30
    return found


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("law", LAWS)
def test_one_deformation_throughout_pulls_at_the_end_by_its_stress_times_the_area(cell, law):
    mesh, held, elastic = body(cell, law)
    force = elastic.internal((mesh.points @ H.T).ravel()).reshape(-1, 3)
    p = stress(law, np.eye(3) + H)
    # the whole force on the face at x-max, whose normal is x; inside forces cancel, held nodes have none
    end = mesh.places["x-max"]
    np.testing.assert_allclose(force[end].sum(axis=0), p[:, 0] * SIDES[1] * SIDES[2], rtol=1e-11)
    assert not force[held].any()
    inside = np.setdiff1d(np.arange(len(mesh.points)), np.unique(np.concatenate([facets.ravel() for facets in mesh.surface])))
    np.testing.assert_allclose(force[inside], 0, atol=1e-14)
    # each node on the surface has the stress times its share of the area
    for node in np.flatnonzero(~held):
        np.testing.assert_allclose(force[node], own_force(mesh, node, p), atol=1e-11 * abs(force).max())


def own_force(mesh, node, p):
    """P times the integral of the gradient of a node's shape function, which is that of the function times the normal on the surface."""
    total = np.zeros(3)
    for facets in mesh.surface:
        for facet in facets:
            if node in facet:
                total += vector_area(mesh.points, facet, node)
    return p @ total


def vector_area(points, facet, node):
    """The share of a facet's outward area that a node has: thirds of a triangle, quarters of a parallelogram."""
    corner = points[facet]
    area = np.cross(corner[1] - corner[0], corner[2] - corner[0]) / (2 if len(facet) == 3 else 1)
    outward = np.sign(area @ (corner.mean(axis=0) - np.array(SIDES) / 2))
    return outward * area / len(facet)


@pytest.mark.parametrize("law", LAWS[:2])
def test_a_cell_inside_out_has_no_force(law):
    mesh, _, elastic = body("tetrahedron", law)
    assert np.isfinite(elastic.internal((mesh.points @ np.diag([-0.99, 0, 0])).ravel())).all()
    assert not np.isfinite(elastic.internal((mesh.points @ np.diag([-1.01, 0, 0])).ravel())).all()
    assert not np.isfinite(elastic.internal((mesh.points @ np.diag([-1.0, 0, 0])).ravel())).all()  # flat


@pytest.mark.parametrize("cell", CELLS)
def test_gradients_are_those_of_a_linear_field(cell):
    mesh, _, elastic = body(cell)
    found = elastic.gradient((mesh.points @ H.T + [0.3, -0.2, 0.1]).ravel())
    np.testing.assert_allclose(found, np.broadcast_to(H, found.shape), atol=1e-13)
    assert elastic.weights.sum() == pytest.approx(np.prod(SIDES), rel=1e-13) and (elastic.weights > 0).all()
    points = {"prism": 6, "tetrahedron": 1, "hexahedron": 8}[cell]
    assert len(elastic.weights) == points * len(mesh.cells) == len(found)
    assert elastic.size == 3 * len(mesh.points)


def test_lame_of_youngs_modulus_one():
    lmbda, mu = body()[2].lame
    assert lmbda == pytest.approx(np.full(24 * 6 // 3, LAMBDA), rel=1e-15) and mu == pytest.approx(np.full(len(lmbda), MU), rel=1e-15)


@pytest.mark.parametrize("cell", CELLS)
def test_the_stiffness_has_the_energy_of_hookes_law_and_none_for_rigid_motions(cell):
    mesh, _, elastic = body(cell)
    stiffness = elastic.stiffness.toarray()
    np.testing.assert_allclose(stiffness, stiffness.T, atol=1e-15 * abs(stiffness).max())
    other = np.array([[0.2, -0.3, 0.1], [0.4, 0.15, -0.1], [0.05, 0.2, -0.25]])
    u, v = (mesh.points @ H.T).ravel(), (mesh.points @ other.T).ravel()
    e, d = (H + H.T) / 2, (other + other.T) / 2
    expected = (LAMBDA * np.trace(e) * np.trace(d) + 2 * MU * (e * d).sum()) * np.prod(SIDES)
    assert u @ stiffness @ v == pytest.approx(expected, rel=1e-11)
    rigid = [np.tile(axis, len(mesh.points)) for axis in np.eye(3)]
    rigid += [np.cross(axis, mesh.points).ravel() for axis in np.eye(3)]
    np.testing.assert_allclose(stiffness @ np.array(rigid).T, 0, atol=1e-14 * abs(stiffness).max())
    assert (np.linalg.eigvalsh(stiffness) > 1e-9 * abs(stiffness).max()).sum() == len(stiffness) - 6


@pytest.mark.parametrize("narrow", [1, 600])
def test_solving_is_that_of_the_dense_matrix_of_free_components(narrow, monkeypatch):
    monkeypatch.setattr(module, "NARROW", narrow)
    _, held, elastic = body()
    free = ~np.repeat(held, 3)
    force = np.random.default_rng(0).normal(size=(elastic.size, 2))
    expected = np.zeros_like(force)
    expected[free] = np.linalg.solve(elastic.stiffness.toarray()[np.ix_(free, free)], force[free])
    np.testing.assert_allclose(elastic.solve(force), expected, atol=1e-10 * abs(expected).max())
    np.testing.assert_allclose(elastic.solve(force[:, 1]), expected[:, 1], atol=1e-10 * abs(expected).max())
    np.testing.assert_array_equal(elastic.held, ~free)


def test_hookes_law_by_hand():
    strain = np.array([[[1.0, 2, 3], [2, 4, 5], [3, 5, -2]], [[0, 1, 0], [1, 0, 0], [0, 0, 0]]])
    expected = 2 * MU * strain
    expected[0] += LAMBDA * 3 * np.eye(3)
    elastic = body()[2]
    np.testing.assert_allclose(elastic.hooke(np.tile(strain, (len(elastic.weights) // 2, 1, 1)))[:2], expected, rtol=1e-15)
    np.testing.assert_array_equal(symmetric(np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9]])), [[1, 3, 5], [3, 5, 7], [5, 7, 9]])


def random_gradients(elastic, count):
    return np.random.default_rng(3).normal(size=(count, len(elastic.weights), 3, 3))


def test_the_forms_of_second_and_third_order_are_symmetric_and_those_of_saint_venants_stress():
    _, _, elastic = body(law="saint-venant-kirchhoff")
    a, b, c = random_gradients(elastic, 3)

    def part(order, h):
        """Of P (h) of Saint Venant-Kirchhoff the terms of one order, written down."""
        found = np.empty_like(h)
        for k, g in enumerate(h):
            linear, square = (g + g.T) / 2, g.T @ g / 2
            hooke = [LAMBDA * np.trace(e) * np.eye(3) + 2 * MU * e for e in (linear, square)]
            found[k] = hooke[1] + g @ hooke[0] if order == 2 else g @ hooke[1]
        return elastic.force(found)

    # a symmetric form follows from its values on equal arguments
    two = (part(2, a + b) - part(2, a - b)) / 4
    three = sum(s * t * part(3, a + s * b + t * c) for s in (1, -1) for t in (1, -1)) / 24
    np.testing.assert_allclose(elastic.second(a, b), two, atol=1e-12 * abs(two).max())
    np.testing.assert_allclose(elastic.third(a, b, c), three, atol=1e-11 * abs(three).max())
    np.testing.assert_allclose(elastic.third(c, a, b), three, atol=1e-11 * abs(three).max())


def rotation(degrees, axis=(2.0, -1, 3)):
    axis = np.array(axis) / np.linalg.norm(axis)
    k = np.cross(np.eye(3), axis)  # k @ v = axis x v
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def test_a_turned_body_answers_as_one_at_rest_turned():
    mesh, _, elastic = body(cells=(3, 2, 1))
    turns = [rotation(degrees) for degrees in (0, 25, 70)]
    u = np.array([(mesh.points @ (turn - np.eye(3)).T).ravel() for turn in turns])
    force = np.random.default_rng(0).normal(size=(3, *mesh.points.shape))
    found = elastic.answers(u, force.reshape(3, -1)).reshape(force.shape)
    for k, turn in enumerate(turns):
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
        expected = elastic.solve((force[k] @ turn).ravel()).reshape(-1, 3) @ turn.T
        np.testing.assert_allclose(found[k], expected, atol=1e-9 * abs(expected).max())
        np.testing.assert_allclose(elastic._rotations(u[k]), np.broadcast_to(turn, (len(mesh.points), 3, 3)), atol=1e-12)


def test_a_node_turns_by_the_mean_around_it_weighted_by_volume():
    mesh = build_mesh(Body(length=0.06, width=0.02, height=0.03, cells=(3, 1, 1), cell="tetrahedron"))
    points = mesh.points.copy()
    points[:, 0] *= 1 + 20 * points[:, 0]  # cells of different volume
    mesh = Mesh(points, mesh.cells, mesh.cell, mesh.places)
    held = points[:, 0] == 0
    elastic = Elastic(mesh, held, Material(young_modulus=7.0, poisson_ratio=NU, law="linear"))
    u = 2e-3 * np.random.default_rng(1).normal(size=points.shape)
    found = elastic._rotations(u.ravel())
    for node in range(len(points)):
        total, volume = np.zeros((3, 3)), 0.0
        for cell in mesh.cells[(mesh.cells == node).any(axis=1)]:
            edges, ends = (points[cell[1:]] - points[cell[0]]).T, (u[cell[1:]] - u[cell[0]]).T
            size = abs(np.linalg.det(edges)) / 6
            total, volume = total + size * ends @ np.linalg.inv(edges), volume + size
        skew = (total - total.T) / 2 / volume
        sine = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])  # sin(angle) times the axis
        angle = np.degrees(np.arcsin(np.linalg.norm(sine)))
        np.testing.assert_allclose(found[node], rotation(angle, sine), atol=1e-12)


def test_where_strains_are_large_the_rotation_stays_finite():
    mesh, _, elastic = body()
    spin = np.array([[0, -1.5, 0], [1.5, 0, 0], [0, 0, 0]])  # a "sine" of 1.5
    found = elastic._rotations((mesh.points @ spin.T).ravel())
    np.testing.assert_allclose(found, np.broadcast_to(np.eye(3) + spin + spin @ spin, found.shape), atol=1e-12)  # cosine 0


@pytest.mark.parametrize("cell, order", [("prism", 2), ("hexahedron", 3), ("tetrahedron", 1)])
def test_points_of_integration_are_exact_to_their_order(cell, order):
    at, weight = cells.CELLS[cell].points, cells.CELLS[cell].weights

    def exact(a, b, c):
        if cell == "hexahedron":
            return 1 / ((a + 1) * (b + 1) * (c + 1))
        if cell == "prism":
            return factorial(a) * factorial(b) / factorial(a + b + 2) / (c + 1)
        return factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 3)

    for a in range(order + 1):
        for b in range(order + 1 - a):
            for c in range(order + 1 - a - b):
                assert weight @ (at[:, 0]**a * at[:, 1]**b * at[:, 2]**c) == pytest.approx(exact(a, b, c), rel=1e-14)
