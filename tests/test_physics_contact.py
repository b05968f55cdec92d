"""Contact: points of the surface, the zone near the obstacle, and the complementarity problem."""

import numpy as np
import pytest
import scipy.optimize

from physics.contact import ContactSurface, solve_complementarity
from physics.mesh import build_mesh
from physics.scene import Body
from physics.schema import InputError
from physics.supports import nodal_areas


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
