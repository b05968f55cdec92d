"""Contact: points of the surface, the zone near the obstacle, and the complementarity problem."""

import itertools

import numpy as np
import pytest
import scipy.optimize

from physics.body.supports import nodal_areas
from physics.contact.conditions import ContactSurface, solve_complementarity
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body
from physics.schema import InputError


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("kind", ["facets", "nodes"])
def test_points_carry_the_whole_surface(cell, kind):
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 2), cell=cell))
    surface = ContactSurface(mesh, kind, np.zeros(len(mesh.points), bool))
    assert surface.area.sum() == pytest.approx(2 * (0.06 + 0.03 + 0.02))
    assert surface.weights.sum(axis=1) == pytest.approx(1)
    # Nodal forces of a uniform pressure on the top are those of its shape functions.
    top = surface.positions(mesh.points)[:, 2] > 0.1 - 1e-9
    inner = np.setdiff1d(mesh.places["z-max"], np.concatenate([mesh.places[p] for p in ("x-min", "x-max", "y-min", "y-max")]))
    if kind == "facets":
        assert (surface.weights.T @ (surface.area * top))[inner] == pytest.approx(nodal_areas(mesh, "z-max")[inner])
    assert len(np.unique(surface.positions(mesh.points).round(9), axis=0)) == len(surface.area)  # no point twice


# A tetrahedron with faces of unlike areas, and a parallelepiped: what is integrated over their surfaces is known.
TETRAHEDRON = Mesh(points=np.array([[5.0, 6, 7], [6, 6, 7], [5, 8, 7], [5, 6, 10]]), cells=np.arange(4)[None], cell="tetrahedron",
                   places={})
SIDES = np.array([[1.0, 0.2, 0.1], [0.0, 2.0, 0.3], [-0.4, 0.0, 3.0]])
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
HEXAHEDRON = Mesh(points=CORNERS @ SIDES + [5.0, 6.0, 7.0], cells=np.arange(8)[None], cell="hexahedron", places={})


def surface_of(mesh, kind="facets", held=(), width=np.inf):
    return ContactSurface(mesh, kind, np.isin(np.arange(len(mesh.points)), held), width)


@pytest.mark.parametrize("d", [1, 2, 3, 8])
def test_integrals_over_triangles_divided_in_parts(d):
    """Of the products of shape functions: the rule's own error of second degree, which falls as 1/d^2, is in the closed form.

    Over a triangle the mean of l_a^2 is 1/6 and by the rule, corners 1/12 and middles 1/4, 1/12 + 2/16 = 1/6 + 1/24; the mean of
    l_a l_b is 1/12 and by the rule 1/16 = 1/12 - 1/48.
    """
    area = np.array([3.5, 3.0, 1.5, 1.0])  # of the face opposite to node a: with the legs 1, 2, 3, the large one |(6, 3, 2)| / 2
    surface = surface_of(TETRAHEDRON, width=np.sqrt(13) / d)
    n, total = surface.weights.toarray(), area.sum()
    assert len(n) == 8 * d**2 + 2  # the corners of 4 (2 d)^2 triangles, by Euler
    assert surface.area.min() > 0 and surface.area.sum() == pytest.approx(total) and n.sum(axis=1) == pytest.approx(1)
    assert surface.area @ n == pytest.approx((total - area) / 3)  # three faces have node a
    expected = (total - area[:, None] - area) * (1 / 12 - 1 / (48 * d**2))  # two have the edge a, b
    np.fill_diagonal(expected, (total - area) * (1 / 6 + 1 / (24 * d**2)))
    assert (n * surface.area[:, None]).T @ n == pytest.approx(expected)
    x = surface.positions(TETRAHEDRON.points)
    assert x == pytest.approx(n @ TETRAHEDRON.points) and len(np.unique(x.round(9), axis=0)) == len(x)


@pytest.mark.parametrize("d", [1, 2, 3, 8])
def test_integrals_over_quadrilaterals_divided_in_parts(d):
    """Products of bilinear functions are exact, of degree two each way; of s^4 the mean is 1/5, and by Simpson's rule 1/(120 d^4) more."""
    sizes = [np.linalg.norm(np.cross(SIDES[i], SIDES[j])) for i, j in ((1, 2), (2, 0), (0, 1))]  # of the faces across each side
    surface = surface_of(HEXAHEDRON, width=np.linalg.norm(SIDES, axis=1).max() / d)
    n = surface.weights.toarray()
    assert len(n) == 6 * (2 * d) ** 2 + 2 and len(np.unique(n.round(9), axis=0)) == len(n)
    assert surface.area.min() > 0 and surface.area.sum() == pytest.approx(2 * sum(sizes))
    second, fourth = np.zeros((8, 8)), np.zeros(8)
    for across in range(3):
        for side in (0, 1):
            at = np.flatnonzero(CORNERS[:, across] == side)
            for a in at:
                fourth[a] += sizes[across] * (1 / 5 + 1 / (120 * d**4)) ** 2
                for b in at:
                    apart = (CORNERS[a] != CORNERS[b]).sum()  # the mean of s^2 is 1/3, of s (1 - s) 1/6
                    second[a, b] += sizes[across] * (1 / 3) ** (2 - apart) * (1 / 6) ** apart
    assert (n * surface.area[:, None]).T @ n == pytest.approx(second)
    assert surface.area @ n**4 == pytest.approx(fourth)


def test_areas_of_trapezoids():
    """A frustum of a pyramid, 2 x 2 below and 1 x 1 above, 1 high: its sides slant by 1/2."""
    points = np.where(CORNERS[:, 2:] == 0, 2.0 * CORNERS, CORNERS + [0.5, 0.5, 0.0])
    surface = surface_of(Mesh(points=points, cells=np.arange(8)[None], cell="hexahedron", places={}))
    assert surface.area.sum() == pytest.approx(4 + 1 + 4 * 1.5 * np.sqrt(1.25))


@pytest.mark.parametrize("width, divisions", [(np.sqrt(13), 1), (3.7, 1), (3.6, 2), (np.sqrt(13) / 2, 2), (1.8, 3), (np.sqrt(13) / 8, 8)])
def test_a_thin_obstacle_gets_more_points(width, divisions):
    """The longest edge of the tetrahedron is sqrt(13) = 3.606: no part of an edge is longer than the obstacle is wide."""
    assert len(surface_of(TETRAHEDRON, width=width).area) == 8 * divisions**2 + 2


@pytest.mark.parametrize("turn", range(3))
def test_the_longest_edge_is_found_wherever_a_facet_starts(turn):
    mesh = Mesh(points=np.roll(TETRAHEDRON.points, turn, axis=0), cells=np.roll(np.arange(4), turn)[None], cell="tetrahedron", places={})
    assert len(surface_of(mesh, width=3.6).area) == 34


def test_points_between_held_nodes_alone_are_not_in_contact():
    """Of ten points three lie on the edge 0-1; the middles of edges that go on from it are in contact, they can move."""
    every, free = surface_of(TETRAHEDRON), surface_of(TETRAHEDRON, held=[0, 1])
    n, left = every.weights.toarray(), free.weights.toarray()
    kept = n[:, :2].sum(axis=1) < 1
    assert np.array_equal(left, n[kept]) and np.array_equal(free.area, every.area[kept])
    assert len(left) == 7 and sorted(left[:, :2].sum(axis=1)) == [0, 0, 0, 0.5, 0.5, 0.5, 0.5]


def test_nodes_in_contact_are_those_of_the_surface_that_are_not_held():
    surface = surface_of(TETRAHEDRON, "nodes", held=[1])
    assert np.array_equal(surface.weights.toarray(), np.eye(4)[[0, 2, 3]])
    # Thirds of the faces' areas would be theirs; of the rule's own points they get as much: 1/12 + 2 / 8 of each.
    assert surface.area == pytest.approx([(9 - 3.5) / 3, (9 - 1.5) / 3, (9 - 1.0) / 3])
    inner = build_mesh(Body(length=0.2, width=0.2, height=0.2, cells=(2, 2, 2), cell="hexahedron"))
    assert len(surface_of(inner, "nodes").area) == 26 and len(inner.points) == 27


def test_an_obstacle_that_could_pass_between_the_points_is_refused():
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 1)))
    none = np.zeros(len(mesh.points), bool)
    with pytest.raises(InputError, match="pass between nodes"):
        ContactSurface(mesh, "nodes", none, 0.09)
    with pytest.raises(InputError, match="smaller cells"):
        ContactSurface(mesh, "facets", none, 0.01)
    with pytest.raises(InputError, match="smaller than 1/8 of a cell"):
        surface_of(TETRAHEDRON, width=np.sqrt(13) / 8 * (1 - 1e-6))
    surface_of(TETRAHEDRON, "nodes", width=np.sqrt(13))  # just as wide is wide enough


def brute(matrix, gap):
    """All p of the complementarity problem, by trying every set of points in contact."""
    found = []
    for on in itertools.product([False, True], repeat=len(gap)):
        on, p = np.array(on), np.zeros(len(gap))
        p[on] = np.linalg.solve(matrix[np.ix_(on, on)], -gap[on])
        if p.min() >= 0 and (gap + matrix @ p).min() >= -1e-9:
            found.append(p)
    return found


@pytest.mark.parametrize("seed", range(5))
def test_any_guess_leads_to_the_one_solution(seed):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(4, 4))
    matrix, gap = factor @ factor.T + 1e-2 * np.eye(4), rng.normal(size=4)
    (expected,) = brute(matrix, gap)
    for guess in itertools.product([False, True], repeat=4):
        guess = np.array(guess)
        before = guess.copy()
        assert solve_complementarity(matrix, gap, guess) == pytest.approx(expected, abs=1e-9)
        assert np.array_equal(guess, before)


@pytest.mark.parametrize("factor, gap", [
    ([[1, -1, 0], [3, -3, 3], [-2, 2, 1]], [2, 0, -5]),
    ([[-2, -3, -3, 3], [2, 1, -2, -3], [-3, 1, 2, -3], [3, 1, 0, -1]], [-5, 0, -5, 5])])
def test_where_the_active_set_goes_round_in_circles_least_squares_end(factor, gap, monkeypatch):
    called, real = [], scipy.optimize.nnls
    monkeypatch.setattr(scipy.optimize, "nnls", lambda *args: called.append(1) or real(*args))
    matrix, gap = np.array(factor, float) @ np.transpose(factor) + 0.01 * np.eye(len(gap)), np.array(gap, float)
    (expected,) = brute(matrix, gap)
    assert solve_complementarity(matrix, gap, np.zeros(len(gap), bool)) == pytest.approx(expected, rel=1e-6)
    assert called == [1]
    with pytest.raises(np.linalg.LinAlgError, match="could not be found"):  # it does not say that it is definite
        solve_complementarity(matrix, gap, np.zeros(len(gap), bool), definite=False)


def test_a_point_that_just_touches_needs_no_force():
    for guess in (False, True):
        assert solve_complementarity(np.array([[2.0]]), np.array([0.0]), np.array([guess]), definite=False) == 0
    assert solve_complementarity(np.array([[2.0]]), np.array([-3.0]), np.array([False])) == pytest.approx([1.5])
    with pytest.raises(np.linalg.LinAlgError, match="could not be found"):  # it gives way for ever
        solve_complementarity(np.array([[-1.0]]), np.array([-1.0]), np.array([False]), definite=False)


@pytest.mark.parametrize("seed", range(5))
def test_complementarity_problem_is_solved_exactly(seed):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(30, 20))  # more points than the body can tell apart: rank 20 plus a little softness
    matrix, gap = factor @ factor.T + 1e-6 * np.eye(30), rng.normal(size=30)
    p = solve_complementarity(matrix, gap, np.zeros(30, bool))
    w = gap + matrix @ p
    assert p.min() >= 0 and w.min() > -1e-8
    assert abs(p * w).max() < 1e-8
    again = scipy.optimize.minimize(lambda x: x @ matrix @ x / 2 + gap @ x, np.ones(30), jac=lambda x: matrix @ x + gap,
                                    bounds=[(0, None)] * 30, method="L-BFGS-B", options={"maxiter": 10000})
    assert p @ matrix @ p / 2 + gap @ p <= again.fun + 1e-9


def test_indefinite_problems_find_the_set_that_holds():
    """Two points, one of which is drawn in by the body: the set with p >= 0 and w >= 0, found by trying all four."""
    matrix, gap = np.array([[-1.0, 0.2], [0.2, 2.0]]), np.array([0.5, -1.0])
    p = solve_complementarity(matrix, gap, np.array([True, True]), definite=False)
    w = gap + matrix @ p
    assert p.min() >= 0 and w.min() >= -1e-12 and abs(p * w).max() < 1e-12
    with pytest.raises(np.linalg.LinAlgError):
        solve_complementarity(matrix, gap, np.array([True, True]))
