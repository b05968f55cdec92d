"""Plane bodies: strain or stress across, and what acts on their sides, against closed forms and published values."""

from dataclasses import replace

import meshio
import numpy as np
import pytest

from physics.body.stress import cauchy, von_mises
from physics.equilibrium.balance import Balance
from physics.linalg.factor import factor_for
from physics.mesh import quality
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.mesh.transfer import interpolate
from physics.scene import read_scene
from physics.schema import InputError
from physics.solution import solve

CELLS = ("triangle", "quadrilateral")


def plate(cell, *, cells=(2, 2), length=1.0, width=1.0, law="neo-hookean", young=1e6, poisson=0.4, plane="strain", thickness=0.1, **more):
    body = {"shape": "plate", "length": length, "width": width, "cells": list(cells), "cell": cell, "plane": plane, "thickness": thickness}
    material = {"law": law, "young_modulus": young, "poisson_ratio": poisson}
    return read_scene({"body": body, "material": material, "steps": {"count": 4}} | more)


def rollers(**moved):
    """Held on two sides along their normals; the side x-max moves by `moved`."""
    return [{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"},
            {"where": "x-max", "fixed": "x", "displacement": [moved["by"], 0, 0]}]


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(("stretch", "nominal", "lateral"), [
    (0.8, -256160.73, 1.094382), (1.1, 90676.98, 0.962834), (1.5, 339862.62, 0.855271), (2.0, 539040.19, 0.773415)])
def test_a_thin_sheet_pulled_along_one_side_is_a_bar_pulled_along_its_axis(cell, stretch, nominal, lateral):
    """Nominal stress and lateral stretch of a bar of the data set's law, E = 1 MPa, nu = 0.4, from its one equation in the stretch."""
    scene = plate(cell, width=0.5, plane="stress", thickness=0.03, support=rollers(by=stretch - 1))
    found = solve(scene)
    assert found.reaction[-1, 0] == pytest.approx(-nominal * 0.5 * 0.03, rel=1e-6)
    assert found.displacement[-1, :, 1].min() == pytest.approx(0.5 * (min(lateral, 1) - 1), rel=1e-5, abs=1e-12)
    sigma = cauchy(found.mesh, found.displacement[-1], scene.material)
    assert sigma[:, 0, 0] == pytest.approx(nominal / lateral**2, rel=1e-5)  # over the area as it is
    assert abs(sigma[:, 1:, 1:]).max() < 1e-5 * abs(nominal)


@pytest.mark.parametrize("cell", CELLS)
def test_hookes_law_in_strain_and_in_stress(cell):
    """Uniaxial: E/(1 - nu^2) with no strain across, and nu sigma there; E with no stress. Confined on both sides: lambda + 2 mu."""
    young, nu, strain = 1e6, 0.4, 1e-3
    for plane, modulus, across in (("strain", young / (1 - nu**2), nu), ("stress", young, 0.0)):
        scene = plate(cell, law="linear", plane=plane, support=rollers(by=strain))
        found = solve(scene)
        assert found.reaction[-1, 0] == pytest.approx(-modulus * strain * 0.1, rel=1e-9)
        assert found.energy[-1] == pytest.approx(0.5 * modulus * strain**2 * 0.1, rel=1e-9)
        sigma = cauchy(found.mesh, found.displacement[-1], scene.material)
        assert sigma[:, 2, 2] == pytest.approx(across * modulus * strain, rel=1e-9, abs=1e-6)
        x, z = modulus * strain, across * modulus * strain
        assert von_mises(found.mesh, found.displacement[-1], scene.material) == pytest.approx(np.sqrt(x**2 - x * z + z**2), rel=1e-9)
    confined = [{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"}, {"where": "y-max", "fixed": "y"},
                {"where": "x-max", "fixed": "x", "displacement": [strain, 0, 0]}]
    found = solve(plate(cell, law="linear", support=confined))
    assert found.reaction[-1, 0] == pytest.approx(-young * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) * strain * 0.1, rel=1e-9)


@pytest.mark.parametrize(("per_side", "expected"), [(8, 11.213), (16, 11.929)])
def test_cooks_membrane_of_quadrilaterals(per_side, expected):
    """The upper right corner rises by this in plane strain under a shear of 0.05 a length, quadrilaterals of first order (another code)."""
    scene = plate("quadrilateral", cells=(per_side, per_side), young=1.0, thickness=1.0, support=[{"where": "x-min"}],
                  load=[{"where": "x-max", "traction": [0, 0.05, 0]}])
    mesh = build_mesh(scene.body)
    x, y = mesh.points[:, :2].T
    mesh = replace(mesh, points=np.stack([48 * x, 44 * x + (44 - 28 * x) * y, 0 * x], axis=1))
    corner = np.argmax(mesh.points.sum(axis=1))
    assert solve(scene, mesh=mesh).displacement[-1, corner, 1] == pytest.approx(expected, abs=6e-4)


def test_a_slice_of_a_solid_that_is_held_across_moves_as_the_plane_body():
    """In contact, with quadrilaterals for hexahedra; the solid's points of contact are three times as many across."""
    obstacle = {"shape": "cylinder", "axis": [0, 0, 1], "radius": 0.01, "path": [[0.085, 0.0305, 0], [0.085, 0.0205, 0]]}
    flat = plate("quadrilateral", cells=(12, 3), length=0.1, width=0.02, poisson=0.3, thickness=0.015, support=[{"where": "x-min"}],
                 obstacle=obstacle)
    solid = read_scene({
        "body": {"length": 0.1, "width": 0.02, "height": 0.015, "cells": [12, 3, 1], "cell": "hexahedron"}, "obstacle": obstacle,
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 4},
        "support": [{"where": "x-min"}, {"where": "z-min", "fixed": "z"}, {"where": "z-max", "fixed": "z"}]})
    one, other = solve(flat), solve(solid)
    assert "one cell thick along z and held across" in other.model["plane"] and "thickness = 0.015" in other.model["plane"]
    assert "plane" not in one.model and one.model["material"].endswith("plane strain, 0.015 m thick")
    base = np.flatnonzero(other.mesh.points[:, 2] == 0)
    base = base[np.lexsort((other.mesh.points[base, 1], other.mesh.points[base, 0]))]
    assert np.array_equal(other.mesh.points[base], one.mesh.points)
    assert one.displacement[-1] == pytest.approx(other.displacement[-1, base], abs=2e-6 * 0.01)
    assert one.reaction[-1, :2] == pytest.approx(other.reaction[-1, :2], rel=1e-4)
    assert one.energy[-1] == pytest.approx(other.energy[-1], rel=1e-5)


@pytest.mark.parametrize("cell", CELLS)
def test_a_block_under_a_rigid_plane_is_squeezed_evenly(cell):
    scene = plate(cell, cells=(3, 2), law="linear", poisson=0.3, thickness=0.2,
                  support=[{"where": "y-min", "fixed": "y"}, {"where": "x-min", "fixed": "x"}],
                  obstacle={"shape": "half-space", "normal": [0, -1, 0], "path": [[0, 1.0001, 0], [0, 0.998, 0]]})
    found = solve(scene)
    assert found.reaction[-1, 1] == pytest.approx(1e6 / (1 - 0.09) * 0.002 * 1.0 * 0.2, rel=1e-4)  # E/(1 - nu^2), the area 1 x 0.2
    assert found.displacement[-1, :, 0].max() == pytest.approx(0.3 / 0.7 * 0.002, rel=1e-4)


def ring(scene):
    """The unit square bent to a quarter of a ring of radii 1 and 2; x-min is the inner side."""
    mesh = build_mesh(scene.body)
    radius, angle = 1 + mesh.points[:, 0], np.pi / 2 * mesh.points[:, 1]
    return replace(mesh, points=np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * radius], axis=1))


@pytest.mark.parametrize(("plane", "expected"), [("strain", 1.3 / 3 * (0.4 + 4)), ("stress", (0.7 + 1.3 * 4) / 3)])
def test_a_pipe_under_pressure_widens_as_lame_says(plane, expected):
    """u(a) = p a^2 / (E (b^2 - a^2)) ((1 - nu) a + (1 + nu) b^2 / a) in stress; in strain (1 + nu) ((1 - 2 nu) a + b^2 / a)."""
    scene = plate("quadrilateral", cells=(12, 12), law="linear", poisson=0.3, plane=plane, thickness=0.3,
                  load=[{"where": "x-min", "pressure": 1e3}],
                  support=[{"where": "y-min", "fixed": "y"}, {"where": "y-max", "fixed": "x"}])
    found = solve(scene, mesh=ring(scene))
    inner = found.mesh.places["x-min"]
    radial = (found.displacement[-1] * found.mesh.points).sum(axis=1)[inner]
    assert radial == pytest.approx(1e-3 * expected, rel=4e-3)
    balance = Balance(scene, found.mesh)
    assert balance.load.sum(axis=0) == pytest.approx([300, 300, 0], rel=1e-9)  # p times the projected side and the thickness


def test_a_pressure_that_follows_its_side_is_the_slope_of_its_work():
    scene = plate("triangle", support=[{"where": "x-min"}], load=[{"where": "y-max", "pressure": 2e4, "follower": True}])
    balance, rng = Balance(scene, build_mesh(scene.body)), np.random.default_rng(3)
    u, way = (0.05 * rng.standard_normal((9, 3)) * [1, 1, 0] for _ in range(2))
    balance.apply_loads(1.0)
    body, step = balance.pressed, 1e-6
    force = body._pressed(u)
    ends = np.isin(np.arange(9), [balance.mesh.places["y-max"][0], balance.mesh.places["y-max"][-1]])
    held = np.where(ends[:, None], 0.0, way)  # over a side whose ends are held the pressure has a potential
    slope = (body.work(u + step * held) - body.work(u - step * held)) / (2 * step)
    assert (force * held).sum() == pytest.approx(slope, rel=1e-6)
    found = solve(scene)
    assert found.relative_residual.max() < 1e-6 and found.displacement[-1, :, 1].min() < -0.01


def test_a_thrown_plate_flies_as_a_point_does():
    scene = plate("triangle", length=0.2, width=0.1, thickness=0.05, load=[{"acceleration": [0, -9.81, 0], "sudden": True}],
                  steps={"count": 20, "dynamic": True, "duration": 0.02, "velocity": [3.0, 0, 0]})
    found = solve(scene)
    time, mass = np.linspace(0, 0.02, 21), 1000.0 * 0.2 * 0.1 * 0.05
    assert found.displacement[:, :, 0] == pytest.approx(np.tile(3 * time[:, None], 9), rel=1e-9, abs=1e-12)
    assert found.displacement[-1, :, 1] == pytest.approx(-9.81 * 0.02**2 / 2, rel=1e-6)
    assert found.kinetic_energy[-1] == pytest.approx(mass / 2 * (9 + (9.81 * 0.02) ** 2), rel=1e-6)


@pytest.mark.parametrize("cell", CELLS)
def test_figures_of_a_plane_mesh(cell):
    scene = plate(cell, cells=(2, 1), length=2.0)
    mesh = build_mesh(scene.body)
    x = mesh.points
    stretched = np.stack([0.2 * x[:, 0] + 0.3 * x[:, 1], -0.1 * x[:, 1], 0 * x[:, 0]], axis=1)
    assert quality.det_f(x, stretched, mesh.cells, cell) == pytest.approx(1.2 * 0.9)
    assert quality.det_f(x, stretched * [1, 20, 1], mesh.cells, cell) == pytest.approx(-1.2)
    assert quality.cell_volumes(x, mesh.cells, cell).sum() == pytest.approx(2.0)
    right = 2**0.5 / (2 * np.sqrt(3**0.5 / 2))  # of a triangle with two sides of 1
    assert quality.aspect_ratio(x, mesh.cells, cell) == pytest.approx(right if cell == "triangle" else 1.0)
    assert quality.scaled_jacobian(x, mesh.cells, cell) == pytest.approx(2 / 3**0.5 / 2**0.5 if cell == "triangle" else 1.0)


def test_a_linear_field_is_carried_to_any_point_of_a_plane_body():
    scene = plate("quadrilateral", cells=(3, 2))
    mesh, at = build_mesh(scene.body), np.array([[0.1, 0.9, 0], [0.5, 0.5, 0], [0.77, 0.02, 0], [1, 1, 0]])
    field = lambda p: np.stack([p[:, 0] - 2 * p[:, 1], 3 * p[:, 0], 0 * p[:, 0]], axis=1)  # noqa: E731
    assert interpolate(mesh, field(mesh.points)[None], at)[0] == pytest.approx(field(at), abs=1e-12)


@pytest.mark.parametrize(("more", "words"), [
    ({"load": [{"where": "x-max", "traction": [0, 0, 1]}]}, r"load\[0\].traction: acts along z"),
    ({"load": [{"acceleration": [0, 0, 1]}]}, r"load\[0\].acceleration: acts along z"),
    ({"support": [{"where": "x-min", "displacement": [0, 0, 1]}]}, r"support\[0\].displacement: moves along z"),
    ({"support": [{"where": "x-min", "axis": [0, 1, 0], "angle": 3}]}, r"support\[0\].axis = \[0.0, 1.0, 0.0\]: a plane body turns about"),
    ({"obstacle": {"shape": "sphere", "radius": 0.1, "path": [[0.5, 1.2, 0.1]]}}, "obstacle.path: leaves z = 0"),
    ({"obstacle": {"shape": "cylinder", "radius": 0.1, "path": [[0.5, 1.2, 0]]}}, r"a cylinder stands on its plane, axis = \[0, 0, 1\]"),
    ({"obstacle": {"shape": "half-space", "normal": [0, -1, 1], "path": [[0.5, 1.2, 0]]}}, "obstacle.normal"),
    ({"obstacle": {"shape": "capsule", "radius": 0.1, "length": 1.0, "axis": [0, 1, 1], "path": [[0.5, 1.9, 0]]}},
     "a capsule lies in its plane"),
    ({"steps": {"count": 2, "dynamic": True, "duration": 1.0, "velocity": [0, 0, 1]}}, "steps.velocity: leads out of the plane"),
])
def test_nothing_acts_across_a_plane_body(more, words):
    scene = plate("triangle", **({"support": [{"where": "x-min"}]} | more))
    with pytest.raises(InputError, match=words):
        solve(scene)


@pytest.mark.parametrize("cell", CELLS)
def test_a_factor_of_two_unknowns_a_node_is_that_of_the_whole_stiffness(cell):
    """Solutions and compliances against numpy's of the whole matrix, the third component held."""
    scene = plate(cell, cells=(3, 2), support=[{"where": "x-min", "fixed": "x"}, {"where": "x-min y-min"}])
    mesh = build_mesh(scene.body)
    balance = Balance(scene, mesh)
    body, rng = balance.body, np.random.default_rng(0)
    u = 0.02 * rng.standard_normal(mesh.points.shape) * [1, 1, 0]
    factor = factor_for(body)
    factor.update(u)
    dofs = body.space.dofs.ravel()
    matrix = body.stiffness(u)[:, :][np.ix_(dofs, dofs)]
    force = np.where(balance.fixed, 0.0, rng.standard_normal(mesh.points.shape))
    assert factor.solve(force).ravel() == pytest.approx(np.linalg.solve(matrix, force.ravel()), rel=1e-9, abs=1e-15)
    nodes = np.array([7, 2, 11])
    unit = np.zeros((mesh.points.size, 9))
    columns = (3 * nodes[:, None] + np.arange(3)).ravel()
    unit[columns, np.arange(9)] = ~balance.fixed[nodes].ravel()
    expected = np.linalg.solve(matrix, unit)[columns]
    assert factor.compliance(nodes) == pytest.approx(expected, rel=1e-9, abs=1e-15)
    begun = factor.begin(force)
    assert factor.at(begun, nodes) == pytest.approx(factor.solve(force)[nodes], rel=1e-9, abs=1e-15)
    push = rng.standard_normal((3, 3)) * [1, 1, 0]
    pushed = force.copy()
    pushed[nodes] += push
    assert factor.finish(begun, nodes, push) == pytest.approx(factor.solve(pushed), rel=1e-9, abs=1e-15)
    assert "half-bandwidth" in factor.name and factor.band == 2 * 4 + 1  # neighbours are at most four nodes on


def test_a_plane_mesh_from_a_file_takes_its_thickness_from_the_scene(tmp_path):
    built = build_mesh(plate("triangle").body)
    meshio.Mesh(built.points, [("triangle", built.cells)]).write(tmp_path / "sheet.vtk")
    table = {"body": {"shape": "file", "path": str(tmp_path / "sheet.vtk"), "thickness": 0.25, "plane": "stress"},
             "material": {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.4}, "steps": {"count": 1},
             "support": [{"where": {"plane": [0, 0, 0], "normal": [1, 0, 0], "within": 1e-9}, "fixed": "x"},
                         {"where": {"near": [0, 0, 0], "within": 1e-9}},
                         {"where": {"plane": [1, 0, 0], "normal": [1, 0, 0], "within": 1e-9}, "fixed": "x", "displacement": [1e-3, 0, 0]}]}
    found = solve(read_scene(table))
    assert isinstance(found.mesh, Mesh) and found.mesh.thickness == 0.25 and found.mesh.sheet
    assert found.reaction[-1, 0] == pytest.approx(-1e6 * 1e-3 * 0.25, rel=1e-9)
