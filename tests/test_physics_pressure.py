"""Pressure along the normal: closed forms of forces and of boxes, the tangent by differences, a cantilever as an elastica."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from datagen.sets.check import against_scene
from datagen.sets.generate import trajectory_of
from physics import journal
from physics.body.material import lame
from physics.body.pressure import Pressed, pressure_force, pressure_stiffness
from physics.body.supports import outer_facets
from physics.fidelity.verify import Checker
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.mesh.quality import cell_volumes
from physics.scene import Body, Load, Material, Scene, Steps, Support, read_scene
from physics.schema import InputError
from physics.solution import solve
from tests.scenes import beam

FACES = ("x-max", "y-max", "z-max")
SYMMETRIC = [{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"}, {"where": "z-min", "fixed": "z"}]
CELLS = ("prism", "tetrahedron", "hexahedron")


def squeezed(cell="hexahedron", law="neo-hookean", pressure=1e5, **more):
    """A box on symmetric supports under the same pressure on its three free sides."""
    return beam(body={"length": 0.06, "width": 0.03, "height": 0.02, "cells": [3, 2, 2], "cell": cell}, support=SYMMETRIC,
                steps={"count": 4}, material={"law": law, "young_modulus": 1e6, "poisson_ratio": 0.3},
                load=[{"where": face, "pressure": pressure} | more for face in FACES])


def warped(cell):
    """A box with all nodes moved at random, and its outer facets."""
    mesh = build_mesh(Body(length=0.06, width=0.03, height=0.02, cells=(3, 2, 2), cell=cell))
    u = np.random.default_rng(5).uniform(-2e-3, 2e-3, mesh.points.shape)
    return mesh, u


@pytest.mark.parametrize("cell", CELLS)
def test_pressure_on_a_closed_face_does_the_work_of_the_volume(cell):
    """No resultant, no moment, and for any motion v the work -p dV: differences of the volume that quality.py has."""
    mesh, u = warped(cell)
    x, v = mesh.points + u, np.random.default_rng(6).normal(size=u.shape)
    force = pressure_force(mesh, x, mesh.boundary, 300.0)
    assert np.linalg.norm(force.sum(axis=0)) < 1e-12 and np.linalg.norm(np.cross(x, force).sum(axis=0)) < 1e-13
    h = 1e-6
    grown = [cell_volumes(x + sign * h * v, mesh.cells, mesh.cell).sum() for sign in (1, -1)]
    assert (force * v).sum() == pytest.approx(-300.0 * (grown[0] - grown[1]) / (2 * h), rel=1e-7)


@pytest.mark.parametrize("body, nodes", [("tetrahedron", 3), ("hexahedron", 4), ("triangle", 2), ("triangle6", 3)])
def test_the_stiffness_of_a_facet_is_the_symmetric_part_of_its_derivative(body, nodes):
    x, corners = np.array([[0.0, 0, 0], [1, 0.1, 0], [1.2, 1, 0.3], [-0.1, 0.8, -0.2]])[:nodes], np.arange(nodes)[None]
    mesh = Mesh(x, corners, body, {}, thickness=0.3)
    size, h = x.size, 1e-5
    derivative = np.empty((size, size))
    for j, step in enumerate(h * np.eye(size)):
        ends = [pressure_force(mesh, x + sign * step.reshape(x.shape), [corners], 7.0).ravel() for sign in (1, -1)]
        derivative[:, j] = (ends[0] - ends[1]) / (2 * h)
    assert abs(derivative - derivative.T).max() > 0.1  # of an open facet it is not symmetric
    np.testing.assert_allclose(pressure_stiffness(mesh, x, corners, 7.0)[0], -(derivative + derivative.T) / 2, atol=1e-9)


@pytest.mark.parametrize("cell", CELLS)
def test_on_a_closed_face_the_tangent_is_the_whole_derivative(cell):
    mesh, u = warped(cell)
    soft, free = Material(young_modulus=1e-9, poisson_ratio=0.0), np.zeros(mesh.points.shape, bool)
    body = Pressed(mesh, soft, free, "standard", [(mesh.boundary, Load(where="x-max", pressure=50.0, follower=True))])
    body.fraction, v, h = 0.5, np.random.default_rng(7).normal(size=u.shape), 1e-6
    matrix = body.stiffness(u)
    right, left = matrix.createVecs()
    right.array[:] = body.space.to_dofs(v)
    matrix.mult(right, left)
    slope = (body.force(u + h * v) - body.force(u - h * v)) / (2 * h)
    np.testing.assert_allclose(body.space.from_dofs(left.array), slope, atol=1e-7 * abs(slope).max())
    assert body.factored == 0.5 and body.work(0 * u) == 0
    grown = cell_volumes(mesh.points + u, mesh.cells, mesh.cell).sum() - cell_volumes(mesh.points, mesh.cells, mesh.cell).sum()
    assert body.work(u) == pytest.approx(-0.5 * 50.0 * grown, rel=1e-9)
    work = [body.work(u + sign * h * v) for sign in (1, -1)]
    force = 0.5 * pressure_force(mesh, mesh.points + u, mesh.boundary, 50.0)
    assert (work[0] - work[1]) / (2 * h) == pytest.approx((force * v).sum(), rel=1e-6)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("follower", [False, True])
def test_a_squeezed_box_has_the_volume_of_its_law(cell, follower):
    """neo-hookean: sigma = K/2 (J - 1/J) in a uniform change of volume. A pressure that follows its face is sigma = -p, a dead
    one sigma J^(2/3) = -p, because the face has shrunk."""
    scene = squeezed(cell, follower=follower)
    bulk = lame(scene.material)[0] + 2 * lame(scene.material)[1] / 3
    volume = brentq(lambda J: bulk / 2 * (J - 1 / J) * (1 if follower else J ** (2 / 3)) + 1e5, 0.2, 1.0)
    solution = solve(scene)
    assert not solution.failure
    np.testing.assert_allclose(solution.displacement[-1], (volume ** (1 / 3) - 1) * solution.mesh.points, atol=1e-7)  # 1e-5 of it


def test_under_the_linear_law_the_box_shrinks_by_hookes_law():
    scene = squeezed(law="linear", pressure=1e3)
    strain = -1e3 * (1 - 2 * 0.3) / 1e6
    np.testing.assert_allclose(solve(scene).displacement[-1], strain * solve(scene).mesh.points, rtol=1e-5, atol=1e-12)


def elastica(bending, load, length, half):
    """Where the tip is, (along, across), of an inextensible cantilever of bending stiffness EI under a load [N/m] that stays normal to
    it, on its outer side at a distance from its axis, which grows as it bends. Integrated from the tip, where force and moment are zero;
    turned afterwards so that the clamp is level."""
    def slope(_, y):
        angle, force, moment = y[0], y[1:3], y[3]
        along, pushed = np.array([np.cos(angle), np.sin(angle)]), load * (1 + half * abs(moment) / bending)
        return [-moment / bending, *(pushed * np.array([along[1], -along[0]])), along[0] * force[1] - along[1] * force[0], *-along]

    y = solve_ivp(slope, (0, length), np.zeros(6), rtol=1e-10, atol=1e-14).y[:, -1]
    c, s = np.cos(y[0]), np.sin(y[0])
    return np.array([[c, s], [-s, c]]) @ -y[4:]


STRIP = {"length": 0.2, "width": 0.01, "height": 0.005, "cells": [80, 1, 4], "cell": "hexahedron"}


def strip(pressure, **more):
    return beam(body=STRIP, material={"law": "saint-venant-kirchhoff", "young_modulus": 1e6, "poisson_ratio": 0.0}, steps={"count": 10},
                load=[{"where": "z-max", "pressure": pressure} | more])


def test_a_pressed_cantilever_is_an_elastica_whose_load_turns_with_it():
    solution = solve(strip(7.5, follower=True))
    assert not solution.failure
    mesh = solution.mesh
    tip = (solution.displacement[-1] + mesh.points)[abs(mesh.points[:, 0] - 0.2) < 1e-9].mean(axis=0) - [0, 0.005, 0.0025]
    # The shear of cells of first order (body/element.py): G l^2 / (E h^2), with l = 1/400 m, h = 1/200 m, G = E / 2.
    bending = 1e6 * 0.01 * 0.005**3 / 12 * (1 + 0.5**2 / 2)
    along, across = elastica(bending, 7.5 * 0.01, 0.2, 0.0025)
    assert abs(across) > 0.1
    np.testing.assert_allclose(tip[[0, 2]], [along, across], atol=0.003 * abs(across))  # shear and stretch: (h/L)^2 = 6e-4, some times
    assert solution.relative_residual.max() <= 1e-6
    dead = solve(strip(7.5))
    assert abs(dead.displacement[-1, mesh.points[:, 0] > 0.1999].mean(axis=0)[0] - (along - 0.2)) > 0.01
    assert against_scene(trajectory_of(strip(7.5, follower=True), solution=solution)) == []
    checker = Checker(strip(7.5, follower=True), mesh)
    assert checker.frame(solution.displacement[-1], 1.0).residual <= 1e-5 * np.linalg.norm(solution.reaction[-1])
    assert checker.frame(dead.displacement[-1], 1.0).residual > 0.01 * np.linalg.norm(solution.reaction[-1])


def test_a_path_under_following_pressure_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr(journal, "EVERY", 0.0)

    class Killed(Exception):
        pass

    scene = replace(strip(2.0, follower=True), body=replace(strip(1.0).body, cells=(12, 1, 2)), steps=Steps(count=60),
                    support=(Support(where="x-min"), Support(where="x-max", fixed="yz", displacement=(0.0, 0.0, -0.02),
                                                             steps=(0.0, 0.5, 1.0), factor=(0.0, 1.0, 0.0))))
    whole = solve(scene)
    assert whole.factorisations < 60
    for at in (22, 30, 51):  # before the 31st the support turns back
        def kill(step, at=at):
            if step == at:
                raise Killed

        with pytest.raises(Killed):
            solve(scene, journal=tmp_path / f"{at}", on_step=kill)
        again = solve(scene, journal=tmp_path / f"{at}")
        assert again.resumed > 0 and np.array_equal(again.displacement, whole.displacement)


def test_a_scene_with_pressure_is_written_and_read():
    for scene in (squeezed(), squeezed(follower=True), squeezed(follower=False)):
        assert Scene.from_toml(scene.to_toml()) == scene
    assert "pressure" not in beam(load=[{"where": "x-max", "traction": [0, 0, 1.0]}]).to_toml()


@pytest.mark.parametrize(("load", "changes", "said"), [
    ({"where": "x-max", "pressure": 1.0, "traction": [0.0, 0, 0]}, {}, "exactly one of traction, pressure and acceleration"),
    ({"pressure": 1.0}, {}, "needs a where"),
    ({"where": "x-max", "traction": [1.0, 0, 0], "follower": True}, {}, "only a pressure follows"),
    ({"where": "x-max", "pressure": 1.0, "follower": True}, {"steps": {"dynamic": True, "duration": 1.0}}, "equilibria only"),
    ({"where": "x-max", "pressure": 1.0, "follower": True}, {"material": {"law": "linear", "young_modulus": 1.0, "poisson_ratio": 0.0}},
     "linear law"),
])
def test_what_does_not_go_together_is_refused(load, changes, said):
    with pytest.raises(InputError, match=said):
        read_scene({"body": {"length": 1.0, "width": 0.1, "height": 0.1, "cells": [4, 1, 1]}, "load": [load],
                    "material": {"young_modulus": 1.0, "poisson_ratio": 0.0}} | changes)


def test_a_pressure_needs_an_outer_face():
    mesh = build_mesh(Body(length=2.0, width=1.0, height=1.0, cells=(2, 1, 1), cell="hexahedron"))
    inner = np.flatnonzero(mesh.points[:, 0] == 1.0)[[0, 1, 3, 2]]
    cut = replace(mesh, places=mesh.places | {"cut": np.sort(inner)}, parts={"cut": [("quadrilateral", inner[None])]})
    assert sum(map(len, cut.facets("cut"))) == 1  # a traction may act there
    with pytest.raises(InputError, match=r"load\[2\].where = 'cut': 1 of its facets lie inside the body; a pressure needs an outer face"):
        outer_facets(cut, "cut", "load[2].where")
    with pytest.raises(InputError, match="'x-max z-max': has no facet; a pressure needs an outer face"):
        outer_facets(mesh, "x-max z-max", "load[0].where")
    assert [len(facets) for facets in outer_facets(mesh, "z-max", "load[0].where")] == [2]
