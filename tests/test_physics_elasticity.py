"""Energy, forces and stiffness of a body: exact solutions, derivatives, and invariance."""

import dataclasses

import numpy as np
import pytest

from physics.body.elasticity import Elasticity
from physics.body.material import LAWS
from physics.mesh.build import build_mesh
from physics.scene import Body, Material, Where
from physics.solution import solve
from tests.dolfinx_elasticity import assert_assembled_as_by_dolfinx
from tests.invariants import assert_forces_and_stiffness_are_derivatives, assert_rigid_motion_stores_nothing
from tests.scenes import beam

CELLS = ("prism", "tetrahedron", "hexahedron")

# Uniaxial nominal stress [Pa] of the solids4foam law, E = 1 MPa, nu = 0.4, with the lateral stretch: the root of dW/dl = 0.
UNIAXIAL = {0.5: (-1171231.57, 1.322931), 0.8: (-256160.73, 1.094382), 0.9: (-112032.43, 1.043300),
            1.1: (90676.98, 0.962834), 1.5: (339862.62, 0.855271), 2.0: (539040.19, 0.773415)}


def distorted(cell, law="neo-hookean", seed=0):
    """A block whose inner nodes are moved by up to a fifth of a cell, its elasticity, and the mask of the outer nodes."""
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.2, cells=(3, 2, 2), cell=cell))
    outer = np.zeros(len(mesh.points), bool)
    outer[np.concatenate(list(mesh.places.values()))] = True
    moved = mesh.points + np.where(outer[:, None], 0, np.random.default_rng(seed).uniform(-0.02, 0.02, mesh.points.shape))
    mesh = dataclasses.replace(mesh, points=moved)
    material = Material(law=law, young_modulus=1e6, poisson_ratio=0.4)
    return mesh, Elasticity(mesh, material, np.zeros(mesh.points.shape, bool)), outer


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("cell", CELLS)
def test_uniform_strain_is_exact_on_distorted_cells(cell, law):
    mesh, elasticity, outer = distorted(cell, law)
    gradient = np.array([[0.1, 0.05, 0.0], [0.02, -0.04, 0.03], [0.0, 0.01, 0.06]])
    force = elasticity.force(mesh.points @ gradient.T)
    # Patch test: uniform stress leaves no force on inner nodes. Its size next to outer forces is that of the rounding,
    # but for prisms and hexahedra also that of the quadrature of slightly curved facets, which is exact for uniform F too.
    assert np.linalg.norm(force[~outer]) < 1e-12 * np.linalg.norm(force[outer])


@pytest.mark.parametrize("cell", CELLS)
def test_rigid_motion_stores_nothing(cell):
    _, elasticity, _ = distorted(cell)
    assert_rigid_motion_stores_nothing(elasticity, 1e6 * 0.3 * 0.2 * 0.2, 0.1)


@pytest.mark.parametrize("law", LAWS)
def test_forces_and_stiffness_are_derivatives(law):
    _, elasticity, _ = distorted("prism", law)
    assert_forces_and_stiffness_are_derivatives(elasticity)


@pytest.mark.parametrize("cell", [*CELLS, "triangle", "quadrilateral", "tetrahedron10", "hexahedron27"])
def test_weight_is_that_of_the_mass_matrix_and_of_the_body(cell):
    """Node by node as dolfinx's mass has it, on distorted cells of two densities; in sum that of the body."""
    plane, second = cell in ("triangle", "quadrilateral"), cell[-1].isdigit()
    size = {"shape": "plate", "thickness": 0.05} if plane else {"height": 0.2}
    body = Body(length=0.3, width=0.2, cells=(3, 2) if plane else (3, 2, 2), cell=cell.rstrip("0127"), order=1 + second, **size)
    mesh = build_mesh(body)
    moves = np.random.default_rng(1).uniform(-0.02, 0.02, mesh.points.shape) * [0, 1, not plane]  # each part keeps its volume
    inner = np.setdiff1d(np.arange(len(mesh.points)), np.concatenate(list(mesh.places.values())))
    if second:  # sides that stay straight
        inner = inner[:0]
    mesh = dataclasses.replace(mesh, points=mesh.points + np.where(np.isin(np.arange(len(mesh.points)), inner)[:, None], moves, 0))
    dense, light = (Material(young_modulus=1e6, poisson_ratio=0.3, density=density, where=where)
                    for density, where in ((1000.0, Where(box=((0, -1, -1), (0.1, 1, 1)))), (30.0, None)))
    elasticity = Elasticity(mesh, (dense, light), np.zeros(mesh.points.shape, bool))
    down = np.array([0.5, -9.81, 0 if plane else 2.0])
    mass = elasticity.mass()
    rows = mass.convert("dense").getDenseArray().copy()
    order = elasticity.space.dofs.ravel()
    expected = (rows[np.ix_(order, order)] @ np.tile(down, len(mesh.points))).reshape(-1, 3)
    weight = elasticity.weight(down)
    assert weight == pytest.approx(expected, rel=1e-12, abs=1e-12 * abs(expected).max())
    volume = 0.1 * 0.2 * (0.05 if plane else 0.2)
    assert weight.sum(axis=0) == pytest.approx((1000 * volume + 30 * 2 * volume) * down, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_weight_of_curved_cells_is_that_of_the_mass_matrix(cell):
    """A block bent to a quarter of a ring that grows thicker: the rule for straight sides is off by 5e-3 with ten nodes, 2e-5 with 27."""
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 1), cell=cell, order=2))
    x, y, z = mesh.points.T
    turned, r = x / 0.3 * np.pi / 2, 0.4 - y
    mesh = dataclasses.replace(mesh, points=np.stack([r * np.sin(turned), 0.4 - r * np.cos(turned), z * (1 + (x / 0.3) ** 2)], axis=1))
    elasticity = Elasticity(mesh, Material(young_modulus=1e6, poisson_ratio=0.3, density=30.0), np.zeros(mesh.points.shape, bool))
    mass = elasticity.mass()  # whose numbers those of the dense matrix may be
    rows, order = mass.convert("dense").getDenseArray().copy(), elasticity.space.dofs.ravel()
    expected = (rows[np.ix_(order, order)] @ np.tile([0.5, -9.81, 2.0], len(mesh.points))).reshape(-1, 3)
    assert elasticity.weight(np.array([0.5, -9.81, 2.0])) == pytest.approx(expected, rel=1e-12, abs=1e-12 * abs(expected).max())


@pytest.mark.parametrize("stretch", UNIAXIAL)
def test_uniaxial_stress_of_the_default_law(stretch):
    """A bar on sliding walls is pulled; its state is uniform, so first-order cells give the stress exactly."""
    side = 0.02
    scene = beam(
        body={"length": side, "width": side, "height": side, "cells": [2, 2, 2]},
        support=[{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"}, {"where": "z-min", "fixed": "z"},
                 {"where": "x-max", "fixed": "x", "displacement": [(stretch - 1) * side, 0.0, 0.0]}])
    solution = solve(scene)
    assert not solution.failure
    stress, lateral = UNIAXIAL[stretch]
    mesh, u = solution.mesh, solution.displacement[-1]
    elasticity = Elasticity(mesh, scene.material, np.zeros(u.shape, bool))
    pulled = elasticity.force(u)[mesh.places["x-max"], 0].sum() / side**2
    assert pulled == pytest.approx(stress, rel=1e-6)  # the reference has 6 digits or more
    assert 1 + u[mesh.places["y-max"], 1] / side == pytest.approx(lateral, abs=1e-6)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("cell", CELLS)
def test_kernels_for_eight_cells_agree_with_dolfinx(cell, law):
    """Also where the number of cells is no multiple of eight, and with held components."""
    mesh, _, _ = distorted(cell, law)
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[mesh.places["x-min"], :2] = True
    ours = Elasticity(mesh, Material(law=law, young_modulus=1e6, poisson_ratio=0.4), fixed)
    assert_assembled_as_by_dolfinx(ours, 0.01)


def test_compiled_code_leaves_the_arithmetic_of_others_alone():
    """No flushing of denormal numbers to zero, in Python or in another library."""
    distorted("prism")[1].energy(np.zeros((36, 3)))
    smallest = np.array([2.0**-1022])  # below it numbers are denormal, and a sixteenth of it is one without rounding
    assert smallest / 16 * 16 == smallest
