"""Stress at the nodes: linear functions, closed forms of each law, the bending of beams, bodies of a single layer."""

from dataclasses import replace

import numpy as np
import pytest

from physics.body.stress import nodal_stress, recovery, von_mises_of
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS as KNOWN
from physics.scene import Body
from physics.solution import solve
from tests.scenes import beam
from tests.test_physics_stress import cauchy, material, mises

CELLS = ("prism", "tetrahedron", "hexahedron")


def box(cell, cells=(4, 3, 2), **sides):
    return build_mesh(Body(**({"length": 0.06, "width": 0.03, "height": 0.01} | sides), cells=cells, cell=cell))


@pytest.mark.parametrize("cell", CELLS)
def test_what_varies_linearly_is_exact_up_to_the_surface(cell):
    mesh = box(cell)
    moved = replace(mesh, points=mesh.points + np.random.default_rng(1).uniform(-8e-4, 8e-4, mesh.points.shape))

    def linear(x):
        return x @ [1.0, -2.0, 3.0] + 0.1

    at_centres = linear(moved.points[moved.cells].mean(axis=1))
    np.testing.assert_allclose(recovery(moved) @ at_centres, linear(moved.points), atol=1e-12)  # rounding


def test_across_a_single_layer_nothing_is_fitted():
    mesh = box("hexahedron", cells=(4, 3, 1))
    x = mesh.points[mesh.cells].mean(axis=1)
    np.testing.assert_allclose(recovery(mesh) @ (5 * x[:, 0]), 5 * mesh.points[:, 0], atol=1e-12)
    np.testing.assert_allclose(recovery(mesh) @ (5 * x[:, 2]), np.full(len(mesh.points), 5 * 0.005), atol=1e-12)


def test_thin_cells_are_fitted_across_their_thickness():
    mesh = box("hexahedron", cells=(2, 2, 4), height=1e-4)
    x = mesh.points[mesh.cells].mean(axis=1)
    np.testing.assert_allclose(recovery(mesh) @ x[:, 2], mesh.points[:, 2], atol=1e-12)


def test_a_node_of_no_cell_has_no_stress():
    mesh = box("tetrahedron")
    more = replace(mesh, points=np.concatenate([mesh.points, [[1.0, 1.0, 1.0]]]))
    assert not nodal_stress(more, np.zeros(more.points.shape), material("linear"))[-1].any()


@pytest.mark.parametrize("law", ["neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"])
def test_uniform_stress_is_that_of_the_closed_form_at_every_node(law):
    F = np.eye(3) + np.random.default_rng(3).uniform(-0.2, 0.2, (3, 3))
    mesh = box("prism")
    sigma = nodal_stress(mesh, mesh.points @ (F - np.eye(3)).T, material(law))
    np.testing.assert_allclose(sigma, np.broadcast_to(cauchy(F, law), sigma.shape), rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(von_mises_of(sigma), mises(cauchy(F, law)), rtol=1e-9)


@pytest.mark.parametrize("cell", ["hexahedron", "prism"])
def test_a_bent_beam_has_the_stress_of_beam_theory_at_its_surface(cell):
    """A force F at the end of a cantilever: sigma_xx = 6 F (L - x) / (b h^2) at x. Cells of first order of length l take the share
    G l^2 / (E h^2) of the moment as shear (body/element.py), with G / E = 1/2 the rest is 1 / (1 + 1/32)."""
    scene = beam(body={"length": 0.12, "width": 0.02, "height": 0.02, "cells": [24, 4, 4], "cell": cell}, steps={"count": 1},
                 load=[{"where": "x-max", "traction": [0, 0, -10.0]}],
                 material={"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.0})
    solution = solve(scene)
    points, force = solution.mesh.points, 10.0 * 0.02**2
    sigma = nodal_stress(solution.mesh, solution.displacement[-1], scene.material)
    for x, side in ((0.03, 0.02), (0.06, 0.0), (0.09, 0.02)):
        there = (abs(points[:, 0] - x) < 1e-9) & (abs(points[:, 2] - side) < 1e-9)
        theory = np.sign(side - 0.01) * 6 * force * (0.12 - x) / 0.02**3
        np.testing.assert_allclose(sigma[there, 0, 0], theory * 32 / 33, rtol=1e-4)  # what is felt of the ends


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_of_second_order_a_linear_field_is_carried_on_to_the_nodes_and_there_is_the_mean_over_cells(cell):
    """Each cell has its own linear field, known at its best points: all cells' first points first."""
    mesh = build_mesh(Body(length=2.0, width=1.0, height=3.0, cells=(2, 1, 1), cell=cell, order=2))
    best = KNOWN[mesh.cell].points if cell == "tetrahedron" else KNOWN["hexahedron"].points
    x = np.einsum("pn,cni->pci", KNOWN[mesh.cell].shapes(best)[0], mesh.points[mesh.cells])  # (P, C, 3)
    level = 1 + np.arange(len(mesh.cells)) ** 2
    found = recovery(mesh) @ (x @ [1.0, -2.0, 0.5] + level).ravel()
    for node in (0, len(mesh.points) // 2, len(mesh.points) - 1):
        around = (mesh.cells == node).any(axis=1)
        assert found[node] == pytest.approx(mesh.points[node] @ [1.0, -2.0, 0.5] + level[around].mean(), rel=1e-12)
