"""Bodies of tetrahedra of 10 and hexahedra of 27 nodes: exact states, derivatives, dolfinx, published values, orders of convergence."""

from dataclasses import replace

import numpy as np
import pytest

from physics.body.elasticity import Elasticity
from physics.body.lumped import node_masses
from physics.body.material import LAWS
from physics.body.stress import nodal_stress
from physics.body.supports import nodal_areas
from physics.mesh.build import build_mesh
from physics.mesh.quality import cell_volumes
from physics.mesh.second import second_order
from physics.modes.elastic import elastic_modes
from physics.scene import Body, Material
from physics.schema import InputError
from physics.solution import solve
from tests import plain_newton
from tests.cook import INCOMPRESSIBLE, cooks_membrane
from tests.dolfinx_elasticity import assert_assembled_as_by_dolfinx
from tests.invariants import (
    assert_det_f_sees_a_fold,
    assert_forces_and_stiffness_are_derivatives,
    assert_rigid_motion_stores_nothing,
    assert_swings_with_period,
)
from tests.scenes import beam, pressed

SOLIDS = ("tetrahedron", "hexahedron")
GRADIENT = np.array([[0.1, 0.05, 0.0], [0.02, -0.04, 0.03], [0.0, 0.01, 0.06]])


def block(cell, law="neo-hookean", element="standard", curved=True, size=1.0):
    """A block whose inner nodes, middles among them, are moved by up to a tenth of a cell, its elasticity, and its outer nodes."""
    mesh = build_mesh(Body(length=0.3 * size, width=0.2 * size, height=0.2 * size, cells=(3, 2, 2), cell=cell, order=2))
    outer = np.zeros(len(mesh.points), bool)
    outer[np.concatenate(list(mesh.places.values()))] = True
    if curved:
        way = np.random.default_rng(0).uniform(-0.01, 0.01, mesh.points.shape) * size
        mesh = replace(mesh, points=mesh.points + np.where(outer[:, None], 0, way))
    material = Material(law=law, young_modulus=1e6, poisson_ratio=0.4)
    return mesh, Elasticity(mesh, material, np.zeros(mesh.points.shape, bool), element), outer


@pytest.mark.parametrize("element", ["standard", "mean-dilatation"])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("cell", SOLIDS)
def test_uniform_strain_is_exact_on_curved_cells(cell, law, element):
    """The rules integrate gradients over curved cells exactly: rules of one degree less leave 1e-3 of the outer forces."""
    mesh, elasticity, outer = block(cell, law, element)
    force = elasticity.force(mesh.points @ GRADIENT.T)
    assert np.linalg.norm(force[~outer]) < 1e-12 * np.linalg.norm(force[outer])


@pytest.mark.parametrize("cell", SOLIDS)
def test_a_solved_patch_is_affine(cell):
    """The outer nodes are led along an affine map, and the inner ones follow it."""
    mesh, elasticity, outer = block(cell)
    matrix = elasticity.stiffness(np.zeros_like(mesh.points))
    rows = np.flatnonzero(np.repeat(~outer, 3))
    dense = matrix.convert("dense").getDenseArray()
    order = elasticity.space.dofs.ravel()
    u = mesh.points @ (1e-9 * GRADIENT).T
    K = dense[np.ix_(order, order)]
    inner = np.linalg.solve(K[np.ix_(rows, rows)], -K[np.ix_(rows, np.setdiff1d(np.arange(u.size), rows))] @ np.delete(u.ravel(), rows))
    assert abs(inner - u.ravel()[rows]).max() < 1e-11 * abs(u).max()


@pytest.mark.parametrize("element", ["standard", "mean-dilatation"])
@pytest.mark.parametrize("cell", SOLIDS)
def test_only_the_six_rigid_motions_store_nothing(cell, element):
    mesh, elasticity, _ = block(cell, element=element)
    assert_rigid_motion_stores_nothing(elasticity, 1e6 * 0.3 * 0.2 * 0.2, 0.1)
    values = np.linalg.eigvalsh(elasticity.stiffness(np.zeros_like(mesh.points)).convert("dense").getDenseArray())
    assert abs(values[5]) < 1e-9 * values[-1] and values[6] > 1e-5 * values[-1]


@pytest.mark.parametrize("element", ["standard", "mean-dilatation"])
@pytest.mark.parametrize("cell", SOLIDS)
def test_forces_and_stiffness_are_derivatives(cell, element):
    _, elasticity, _ = block(cell, element=element, size=4)
    assert_forces_and_stiffness_are_derivatives(elasticity)


@pytest.mark.parametrize("cell", SOLIDS)
def test_kernels_agree_with_dolfinx_on_straight_cells(cell):
    """Straight, for there dolfinx takes the same rule; its functions, its numbering and its geometry are its own."""
    _, ours, _ = block(cell, curved=False)
    assert_assembled_as_by_dolfinx(ours, 0.005)


@pytest.mark.parametrize("cell", SOLIDS)
def test_volume_mass_weight_and_areas_are_those_of_the_body(cell):
    mesh, elasticity, _ = block(cell)
    assert cell_volumes(mesh.points, mesh.cells, mesh.cell).sum() == pytest.approx(0.012, rel=1e-12)
    weight = elasticity.weight(np.array([0, 0, -9.81]))
    assert weight.sum(axis=0) == pytest.approx([0, 0, -9.81 * 12], rel=1e-12, abs=1e-9)
    masses = node_masses(elasticity)
    assert masses.sum() == pytest.approx(12, rel=1e-12) and masses.min() > 0
    areas = nodal_areas(mesh, "x-min")
    assert areas.sum() == pytest.approx(0.04, rel=1e-12)


def test_an_even_traction_does_not_push_the_corners_of_triangles():
    """Of a flat triangle with six nodes a third goes to each middle; of a square of nine 1/36, 4/36 and 16/36."""
    cube = {"length": 1.0, "width": 1.0, "height": 1.0, "cells": (1, 1, 1)}
    tetrahedra, hexahedra = (second_order(build_mesh(Body(**cube, cell=cell))) for cell in SOLIDS)
    at = nodal_areas(tetrahedra, "z-max")
    assert abs(at[:8]).max() < 1e-15 and sorted(at[at > 1e-9].round(12).tolist()) == [round(x, 12) for x in [1 / 6] * 4 + [1 / 3]]
    at = nodal_areas(hexahedra, "z-max")
    assert sorted(at[at > 1e-9].round(12).tolist()) == [round(x / 36, 12) for x in [1] * 4 + [4] * 4 + [16]]


def test_det_f_sees_a_cell_turned_inside_out_between_its_corners():
    assert_det_f_sees_a_fold(build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell="tetrahedron", order=2)), GRADIENT)


@pytest.mark.parametrize("cell, least", [("tetrahedron", 6.66), ("hexahedron", 6.82)])
def test_cooks_membrane_does_not_lock_by_mean_dilatation(cell, least):
    """Nearly incompressible, four cells a side; published references lie between 6.85 and 6.9. Standard cells give 4.9 and 5.9."""
    assert least < cooks_membrane(4, 6.25, INCOMPRESSIBLE, cell=cell, order=2, element="mean-dilatation").mean() < 6.9
    assert cooks_membrane(4, 6.25, INCOMPRESSIBLE, cell=cell, order=2).mean() < 6.0


@pytest.mark.parametrize("cell", SOLIDS)
def test_a_slender_beam_bends_as_timoshenko_says(cell):
    """Fifty times as long as thick on ten cells, Poisson's ratio 0, where the clamped face hinders nothing.

    w = P L^3 / (3 E I) + P L / (k G A), k = 5/6. Tetrahedra of first order give a tenth of that on forty times as many cells.
    """
    side, load = 0.02, 1e-3
    length = 50 * side
    scene = beam(body={"length": length, "width": side, "height": side, "cells": [10, 1, 1], "cell": cell, "order": 2},
                 material={"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.0}, steps={"count": 1},
                 load=[{"where": "x-max", "traction": [0.0, 0.0, -load / side**2]}])
    solution = solve(scene)
    areas = nodal_areas(solution.mesh, "x-max")
    exact = load * length**3 / (3 * 1e6 * side**4 / 12) + load * length / (5 / 6 * 0.5e6 * side**2)
    assert -(areas @ solution.displacement[-1])[2] / areas.sum() == pytest.approx(exact, rel=6e-3 if cell == "tetrahedron" else 3e-3)


@pytest.mark.parametrize("cell", SOLIDS)
def test_the_path_is_that_of_plain_newton_under_an_obstacle(cell):
    scene = pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [6, 2, 2], "cell": cell, "order": 2}, steps={"count": 6})
    path = solve(scene).displacement
    assert abs(path - plain_newton.solve(scene)).max() < 1e-6 * abs(path).max()


def test_a_mesh_of_prisms_is_refused_at_second_order():
    scene = beam(body={"length": 0.1, "width": 0.02, "height": 0.02, "cells": [4, 2, 2], "cell": "hexahedron", "order": 2})
    with pytest.raises(InputError, match="body.order = 2: prisms are of first order only; take tetrahedra or hexahedra"):
        solve(scene, mesh=build_mesh(replace(scene.body, cell="prism", order=1)))


@pytest.mark.parametrize("cell, off", [("tetrahedron", 0.03), ("hexahedron", 1e-8)])
def test_stress_at_the_surface_of_a_bent_beam_is_that_of_beam_theory(cell, off):
    """sigma = P (L - x) (h / 2) / I at its top, Poisson's ratio 0, away from the ends; hexahedra span that state."""
    scene = beam(body={"length": 0.1, "width": 0.02, "height": 0.02, "cells": [12, 2, 2], "cell": cell, "order": 2},
                 material={"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.0}, steps={"count": 1},
                 load=[{"where": "x-max", "traction": [0.0, 0.0, -1.0]}])
    solution = solve(scene)
    x = solution.mesh.points
    top = (abs(x[:, 2] - 0.02) < 1e-9) & (abs(x[:, 0] - 0.05) < 0.012)
    sigma = nodal_stress(solution.mesh, solution.displacement[-1], scene.material)[top, 0, 0]
    assert sigma == pytest.approx(0.02**2 * (0.1 - x[top, 0]) * 0.01 / (0.02**4 / 12), rel=off)


@pytest.mark.parametrize("cell", SOLIDS)
def test_stress_of_a_uniform_strain_is_the_same_at_every_node_of_curved_cells(cell):
    mesh, elasticity, _ = block(cell)
    sigma = nodal_stress(mesh, mesh.points @ GRADIENT.T, elasticity.material)
    assert abs(sigma - sigma[0]).max() < 1e-10 * abs(sigma[0]).max() and abs(sigma[0]).max() > 1e4


@pytest.mark.parametrize("cell", SOLIDS)
def test_a_released_beam_swings_as_its_mode_says_and_keeps_its_energy(cell):
    """Two periods of fifty steps: w(t) = a (1 - cos(omega t)), longer by (2 pi / 50)^2 / 12 = 0.13 % for its steps."""
    body = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [5, 1, 1], "cell": cell, "order": 2}
    period = 1 / elastic_modes(beam(body=body), count=1).frequencies_hz[0]
    scene = beam(body=body, load=[{"where": "x-max", "traction": [0.0, 0.0, -1.0], "sudden": True}],
                 steps={"count": 100, "duration": 2 * period, "dynamic": True})
    solution = solve(scene)
    assert_swings_with_period(solution, "x-max", [0, 0, -1.0], period, within=8e-3)
