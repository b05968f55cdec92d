"""Obstacles and contact: distances, points of the surface, and the complementarity problem."""

import numpy as np
import pytest
import scipy.optimize

from physics.contact import ContactSurface, solve_complementarity
from physics.mesh import build_mesh
from physics.obstacle import Rigid
from physics.scene import Body, Obstacle
from physics.schema import InputError
from physics.supports import nodal_areas

ROOT = (0.1, 0.2, 0.3)
SPHERE = Obstacle(shape="sphere", radius=0.3, path=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)))
OBSTACLES = {
    "sphere": SPHERE,
    "cylinder": Obstacle(shape="cylinder", radius=0.3, axis=(0.0, 2.0, 1.0), path=(ROOT,)),
    "capsule": Obstacle(shape="capsule", radius=0.3, length=0.8, axis=(1.0, 2.0, 1.0), path=(ROOT,)),
    "box": Obstacle(shape="box", radius=0.1, size=(0.6, 0.8, 1.0), path=(ROOT,)),
    "half-space": Obstacle(shape="half-space", normal=(0.0, 1.0, 2.0), path=(ROOT,)),
}
VOLUME = {"sphere": 4 / 3 * np.pi * 0.3**3, "cylinder": np.pi * 0.3**2 * 1.2, "capsule": 4 / 3 * np.pi * 0.3**3 + np.pi * 0.3**2 * 0.8,
          # a box swollen by 0.1: itself, plates on its faces, quarter cylinders on its edges, eighths of a sphere at its corners
          "box": 0.4 * 0.6 * 0.8 + 0.2 * (0.24 + 0.48 + 0.32) + np.pi * 0.01 * 1.8 + 4 / 3 * np.pi * 0.001}
BODY = np.array([[0.0, -0.5, -0.5], [0.0, 0.5, 0.5], [0.2, 0.0, 0.0]])


@pytest.mark.parametrize("shape", OBSTACLES)
def test_normal_is_the_gradient_of_the_gap(shape):
    rigid, points = Rigid(OBSTACLES[shape]), np.random.default_rng(0).normal(size=(200, 3))
    centre = rigid.position(0.0)
    gap, normal = rigid.gap(points, centre)
    step = 1e-6  # central differences: order step^2
    slope = [(rigid.gap(points + step * e, centre)[0] - rigid.gap(points - step * e, centre)[0]) / (2 * step) for e in np.eye(3)]
    assert np.transpose(slope) == pytest.approx(normal, abs=1e-8)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1)
    assert rigid.gap(points - gap[:, None] * normal, centre)[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("shape", OBSTACLES)
def test_bend_is_the_second_derivative_of_the_gap(shape):
    rigid, points = Rigid(OBSTACLES[shape]), np.random.default_rng(0).normal(size=(200, 3))
    centre = rigid.position(0.0)
    points = points[rigid.gap(points, centre)[0] > -0.9 * rigid.radius]  # deeper than the rounding is wide nothing is smooth
    step = 1e-6  # central differences: order step^2, but for the few points within a step of where two regions meet: none here
    slope = [(rigid.gap(points + step * e, centre)[1] - rigid.gap(points - step * e, centre)[1]) / (2 * step) for e in np.eye(3)]
    bend = rigid.bend(points, centre)
    assert np.einsum("qik,qil->qkl", bend, bend) == pytest.approx(np.transpose(slope, (1, 2, 0)), abs=1e-6)


@pytest.mark.parametrize("shape", VOLUME)
def test_surface_mesh_is_closed_and_lies_on_the_surface(shape):
    rigid = Rigid(OBSTACLES[shape])
    points, triangles = rigid.surface_mesh(BODY, size=0.1)
    gap = rigid.gap(points, rigid.path[0])[0]
    inside = abs(gap + 0.3) < 1e-12 if shape == "cylinder" else np.zeros(len(gap), bool)  # the middles of its ends
    assert gap[~inside] == pytest.approx(0, abs=1e-12) and inside.sum() <= 2
    directed = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    assert sorted(map(tuple, directed)) == sorted(map(tuple, directed[:, ::-1]))  # each edge once in either direction
    a, b, c = (points[triangles[:, i]] - rigid.path[0] for i in range(3))
    volume = (np.cross(a, b) * c).sum() / 6
    exact = VOLUME[shape]
    if shape == "cylinder":  # as long as the body along its axis, and one edge more at either end
        exact = np.pi * 0.3**2 * (np.ptp(BODY @ rigid.axis) + 0.2)
    assert 0.85 * exact < volume < exact  # inscribed, outward


def test_half_space_is_shown_as_a_square_below_the_body():
    rigid = Rigid(OBSTACLES["half-space"])
    points, triangles = rigid.surface_mesh(BODY, size=0.1)
    assert rigid.gap(points, rigid.path[0])[0] == pytest.approx(0, abs=1e-12)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a) @ rigid.axis > 0).all()


def test_waypoints_are_reached_at_equal_fractions():
    rigid = Rigid(SPHERE)
    assert rigid.position(0.25) == pytest.approx([0.5, 0, 0])
    assert rigid.position(0.5) == pytest.approx([1, 0, 0])
    assert rigid.position(1.0) == pytest.approx([1, 1, 0])


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


@pytest.mark.parametrize("width, divisions", [(0.1, 1), (0.06, 2), (0.03, 4)])
def test_a_thin_obstacle_gets_more_points(width, divisions):
    """Cells of 0.1 m: no further apart than half of the obstacle's width; linear pressure still gives its exact nodal forces."""
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 1), cell="prism"))
    none = np.zeros(len(mesh.points), bool)
    few, many = ContactSurface(mesh, "facets", none), ContactSurface(mesh, "facets", none, width)
    x = many.positions(mesh.points)
    away = np.linalg.norm(x[:, None] - x, axis=2)
    assert (away + np.eye(len(x))).min(axis=1).max() <= 0.1 / (2 * divisions) * (1 + 1e-9) and 0.1 / (2 * divisions) <= width / 2
    assert many.area.sum() == pytest.approx(few.area.sum()) and many.area.min() > 0
    assert many.weights.T @ many.area == pytest.approx(few.weights.T @ few.area)
    for surface in (few, many):
        moment = surface.weights.T @ (surface.area * surface.positions(mesh.points)[:, 0])
        assert moment == pytest.approx(few.weights.T @ (few.area * few.positions(mesh.points)[:, 0]))


def test_an_obstacle_that_could_pass_between_the_points_is_refused():
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 1)))
    none = np.zeros(len(mesh.points), bool)
    with pytest.raises(InputError, match="pass between nodes"):
        ContactSurface(mesh, "nodes", none, 0.09)
    with pytest.raises(InputError, match="smaller cells"):
        ContactSurface(mesh, "facets", none, 0.01)


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
