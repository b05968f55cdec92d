"""Plane bodies of triangles of 6 and quadrilaterals of 9 nodes: exact states, derivatives, dolfinx, solids, orders of convergence."""

from dataclasses import replace

import numpy as np
import pytest

from physics.body.elasticity import Elasticity
from physics.body.lumped import node_masses
from physics.body.material import LAWS
from physics.body.pressure import pressure_force
from physics.body.stress import nodal_stress
from physics.body.supports import nodal_areas
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.mesh.quality import cell_volumes
from physics.mesh.second import corners_only, second_order
from physics.mesh.shapes.boxes import rectangle
from physics.scene import Body, Material, read_scene
from physics.solution import solve
from tests.chosen_displacement import errors_against
from tests.dolfinx_elasticity import assert_assembled_as_by_dolfinx
from tests.invariants import assert_det_f_sees_a_fold, assert_forces_and_stiffness_are_derivatives
from tests.test_physics_points import on_its_facets

PLANE = ("triangle", "quadrilateral")
GRADIENT = np.array([[0.1, 0.05, 0.0], [0.02, -0.04, 0.0], [0.0, 0.0, 0.0]])


def sheet(cell, law="neo-hookean", plane="strain", curved=True, size=1.0):
    """A sheet whose inner nodes, middles among them, are moved by up to a tenth of a cell, its elasticity, and its outer nodes."""
    mesh = build_mesh(Body(shape="plate", length=0.3 * size, width=0.2 * size, cells=(3, 2), cell=cell, order=2, plane=plane,
                           thickness=0.05))
    outer = np.zeros(len(mesh.points), bool)
    outer[np.concatenate(list(mesh.places.values()))] = True
    if curved:
        way = np.random.default_rng(0).uniform(-0.01, 0.01, mesh.points.shape) * size * [1, 1, 0]
        mesh = replace(mesh, points=mesh.points + np.where(outer[:, None], 0, way))
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[:, 2] = True
    return mesh, Elasticity(mesh, Material(law=law, young_modulus=1e6, poisson_ratio=0.4), fixed), outer


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("cell", PLANE)
def test_uniform_strain_is_exact_on_curved_cells(cell, law, plane):
    """The rules integrate gradients over curved cells exactly, and stress at the nodes is that of every point."""
    mesh, elasticity, outer = sheet(cell, law, plane)
    u = mesh.points @ GRADIENT.T
    force = elasticity.force(u)
    assert np.linalg.norm(force[~outer]) < 1e-12 * np.linalg.norm(force[outer])
    sigma = nodal_stress(mesh, u, elasticity.material)
    assert abs(sigma - sigma[0]).max() < 1e-10 * abs(sigma[0]).max() and abs(sigma[0]).max() > 1e4
    assert plane == "strain" or abs(sigma[:, 2, 2]).max() < 1e-6 * abs(sigma[0]).max()


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("cell", PLANE)
def test_a_solved_patch_is_affine_and_three_motions_store_nothing(cell, plane):
    """The outer nodes are led along an affine map, and the inner ones follow it."""
    mesh, elasticity, outer = sheet(cell, plane=plane)
    dofs = elasticity.space.dofs[:, :2].ravel()
    K = elasticity.stiffness(np.zeros_like(mesh.points)).convert("dense").getDenseArray()[np.ix_(dofs, dofs)]
    values = np.linalg.eigvalsh(K)
    assert abs(values[2]) < 1e-9 * values[-1] and values[3] > 1e-5 * values[-1]
    u, inside = (mesh.points @ (1e-9 * GRADIENT).T)[:, :2].ravel(), np.repeat(~outer, 2)
    inner = np.linalg.solve(K[np.ix_(inside, inside)], -K[np.ix_(inside, ~inside)] @ u[~inside])
    assert abs(inner - u[inside]).max() < 1e-11 * abs(u).max()


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("cell", PLANE)
def test_forces_and_stiffness_are_derivatives(cell, plane):
    mesh, elasticity, _ = sheet(cell, plane=plane, size=4)
    flat = Elasticity(mesh, elasticity.material, np.zeros(mesh.points.shape, bool))  # nothing held: z is no part of any force
    assert_forces_and_stiffness_are_derivatives(flat)


@pytest.mark.parametrize("cell", PLANE)
def test_kernels_agree_with_dolfinx_on_straight_cells(cell):
    """Plane strain on a thickness of one metre; straight, for there dolfinx takes the same rule."""
    mesh, ours, _ = sheet(cell, curved=False)
    mesh = replace(mesh, thickness=1.0)
    free = Elasticity(mesh, ours.material, np.zeros(mesh.points.shape, bool))
    assert_assembled_as_by_dolfinx(free, 0.005)


@pytest.mark.parametrize("cell", PLANE)
def test_area_mass_weight_and_sides_are_those_of_the_body(cell):
    mesh, elasticity, _ = sheet(cell)
    assert cell_volumes(mesh.points, mesh.cells, mesh.cell).sum() == pytest.approx(0.06, rel=1e-12)
    weight = elasticity.weight(np.array([0, -9.81, 0]))
    assert weight.sum(axis=0) == pytest.approx([0, -9.81 * 3, 0], rel=1e-12, abs=1e-9)
    masses = node_masses(elasticity)
    assert masses.sum() == pytest.approx(3, rel=1e-12) and masses.min() > 0
    assert nodal_areas(mesh, "x-min").sum() == pytest.approx(0.2 * 0.05, rel=1e-12)


def test_masses_of_a_triangle_are_shares_of_the_diagonal_of_its_consistent_matrix():
    mesh = replace(second_order(rectangle(Body(shape="plate", length=1.0, width=2.0, cells=(1, 1), cell="triangle"))), thickness=0.5)
    body = Elasticity(mesh, Material(law="linear", young_modulus=1.0, poisson_ratio=0.3, density=3.0), np.zeros(mesh.points.shape, bool))
    diagonal = body.mass().getDiagonal().array[body.space.dofs[:, 0]]
    assert node_masses(body)[:, 0] == pytest.approx(3.0 * diagonal / diagonal.sum(), rel=1e-12)


def arc(n=1):
    """n lines of three nodes on a quarter of the unit circle, as the outer sides of quadrilaterals that reach to half of it."""
    angle = np.pi / 2 * np.linspace(0, 1, 2 * n + 1)
    points = np.concatenate([r * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) for r in (0.5, 0.75, 1.0)])
    at = np.arange(3 * (2 * n + 1)).reshape(3, -1)
    cells = np.array([[at[0, i], at[2, i], at[2, i + 2], at[0, i + 2], at[1, i], at[2, i + 1], at[1, i + 2], at[0, i + 1], at[1, i + 1]]
                      for i in range(0, 2 * n, 2)])
    return Mesh(points, cells, "quadrilateral9", {"rim": at[2]}, thickness=0.3)


def test_a_side_of_three_nodes_carries_simpsons_shares_and_a_curved_one_its_own_length():
    mesh = second_order(rectangle(Body(shape="plate", length=1.0, width=1.0, cells=(1, 1), cell="triangle")))
    assert sorted(nodal_areas(mesh, "x-max")[mesh.places["x-max"]]) == pytest.approx([1 / 6, 1 / 6, 2 / 3], rel=1e-12)
    off = [abs(nodal_areas(arc(n), "rim").sum() / (np.pi / 2 * 0.3) - 1) for n in (2, 4)]
    assert off[1] < 5e-5 and np.log2(off[0] / off[1]) > 3.8, off  # parabolas are longer than chords, which leave 6e-3 at n = 4
    rim = arc(4)
    assert on_its_facets(rim, 2)[1].sum() == pytest.approx(nodal_areas(rim, rim_of_all(rim)).sum(), rel=1e-5)


def rim_of_all(mesh):
    """The name of a place of all outer nodes, which is put into the mesh."""
    mesh.places["all"] = np.unique(np.concatenate([facets.ravel() for facets in mesh.boundary]))
    return "all"


def test_a_pressure_on_a_curved_side_is_that_on_the_chord_between_its_ends():
    """The integral of the normal over any line is that over its chord: 1 x 1 x the thickness of a quarter circle."""
    mesh = arc(2)
    force = pressure_force(mesh, mesh.points, mesh.facets("rim"), 7.0)
    assert force.sum(axis=0) == pytest.approx([-7.0 * 0.3, -7.0 * 0.3, 0], rel=1e-12)
    whole = pressure_force(mesh, mesh.points, mesh.boundary, 7.0)
    assert abs(whole.sum(axis=0)).max() < 1e-14 and abs(np.cross(mesh.points, whole).sum(axis=0)).max() < 1e-14
    v = np.random.default_rng(3).normal(size=mesh.points.shape) * [1, 1, 0]
    grown = [cell_volumes(mesh.points + step * v, mesh.cells, mesh.cell).sum() for step in (1e-6, -1e-6)]
    assert (whole * v).sum() == pytest.approx(-7.0 * 0.3 * (grown[0] - grown[1]) / 2e-6, rel=1e-7)


@pytest.mark.parametrize("cell", PLANE)
def test_points_of_contact_lie_on_curved_sides_and_an_even_pressure_at_them_pushes_as_a_traction(cell):
    """Simpson's rule on each half of a straight side gives the shares of nodes exactly."""
    mesh = build_mesh(Body(shape="plate", length=0.3, width=0.2, cells=(3, 2), cell=cell, order=2, thickness=0.05))
    weights, areas = on_its_facets(mesh, 2)
    assert weights.T @ areas == pytest.approx(nodal_areas(mesh, rim_of_all(mesh)), abs=1e-15)
    rim = arc(3)
    at = on_its_facets(rim, 2)[0] @ rim.points
    outer = at[np.linalg.norm(at, axis=1) > 0.98]
    assert len(outer) >= 15 and abs(np.linalg.norm(outer, axis=1) - 1).max() < 1e-3  # a straight side leaves 0.03


def test_det_f_sees_a_cell_turned_inside_out_between_its_corners():
    assert_det_f_sees_a_fold(build_mesh(Body(shape="plate", length=1.0, width=1.0, cells=(1, 1), cell="triangle", order=2)), GRADIENT)


@pytest.mark.parametrize("cell", PLANE)
def test_what_can_be_seen_is_four_facets_for_each_cell_and_places_keep_lines_of_three_nodes(cell):
    body = Body(shape="plate", length=2.0, width=1.0, cells=(2, 1), cell=cell)
    first = rectangle(body)
    first = replace(first, parts={"x-min": [("line", np.array([first.places["x-min"]]))]})
    mesh = second_order(first)
    shown, = mesh.surface
    assert len(shown) == 4 * len(mesh.cells) and len(np.unique(shown)) == len(mesh.points)
    assert cell_volumes(mesh.points, shown, cell).sum() == pytest.approx(2.0)
    kind, rows = mesh.parts["x-min"][0]
    assert (kind, rows.shape) == ("line3", (1, 3)) and mesh.points[rows[0, 2]].tolist() == [0.0, 0.5, 0.0]
    facets, = mesh.facets("x-min")
    assert sorted(facets[0].tolist()) == sorted(rows[0].tolist()) and facets[0, 2] == rows[0, 2]
    assert corners_only(mesh).parts["x-min"][0][1].tolist() == first.parts["x-min"][0][1].tolist()


def chosen(x):
    """u (..., 3), its gradient (..., 3, 3), in plane strain; stretches from 0.6 to 1.5."""
    a, b, _ = np.moveaxis(x, -1, 0)
    k, zero = np.pi / 2, np.zeros_like(a)
    u = 0.2 * np.stack([np.sin(k * b) + a * b**3, np.cos(k * a) * (1 + b) ** 2 / 2, zero], axis=-1)
    rows = [[b**3, k * np.cos(k * b) + 3 * a * b**2, zero], [-k * np.sin(k * a) * (1 + b) ** 2 / 2, np.cos(k * a) * (1 + b), zero],
            [zero, zero, zero]]
    return u, 0.2 * np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def bent(points):
    """The unit square with all its sides, those of cells too, curved."""
    x, y, z = points.T
    return np.stack([x + 0.1 * np.sin(2 * y), y + 0.1 * x**2, z], axis=1)


def errors(cell, order, n, curve):
    """Of the displacement, root of the mean square, and of the potential, of a body led at its rim: see chosen_displacement.py."""
    mesh = build_mesh(Body(shape="plate", length=1.0, width=1.0, cells=(n, n), cell=cell, order=order))
    held = ((mesh.points[:, :2] < 1e-9) | (mesh.points[:, :2] > 1 - 1e-9)).any(axis=1)
    mesh = replace(mesh, points=bent(mesh.points) if curve else mesh.points)
    at, weight = np.polynomial.legendre.leggauss(5)
    r, s = (grid.ravel() for grid in np.meshgrid(*[(at + 1) / 2] * 2, indexing="ij"))
    weights = np.outer(weight, weight).ravel() / 4
    if cell == "triangle":
        s, weights = s * (1 - r), weights * (1 - r)
    fixed = np.stack([held, held, np.ones_like(held)], axis=1)
    return errors_against(chosen, mesh, fixed, np.column_stack([r, s, 0 * r]), weights)


@pytest.mark.parametrize("cell, order, curve", [("triangle", 1, False), ("quadrilateral", 1, False), ("triangle", 2, False),
                                                ("quadrilateral", 2, False), ("triangle", 2, True), ("quadrilateral", 2, True)])
def test_displacements_and_potential_converge_with_the_orders_of_their_cells(cell, order, curve):
    far, near = errors(cell, order, 8, curve), errors(cell, order, 16, curve)
    of_u, of_energy = np.log2(np.array(far) / near)
    assert of_u > order + 1 - 0.1 and of_energy > 2 * order - 0.1, (of_u, of_energy)


def test_a_slice_of_a_solid_that_is_held_across_moves_as_the_plane_body():
    """In contact, with quadrilaterals of 9 for hexahedra of 27 nodes; the solid's points of contact are in more rows across."""
    obstacle = {"shape": "cylinder", "axis": [0, 0, 1], "radius": 0.01, "path": [[0.085, 0.0305, 0], [0.085, 0.0205, 0]]}
    rest = {"material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 4}, "obstacle": obstacle}
    flat = read_scene({"body": {"shape": "plate", "length": 0.1, "width": 0.02, "cells": [6, 2], "cell": "quadrilateral", "order": 2,
                                "thickness": 0.015}, "support": [{"where": "x-min"}]} | rest)
    solid = read_scene({"body": {"length": 0.1, "width": 0.02, "height": 0.015, "cells": [6, 2, 1], "cell": "hexahedron", "order": 2},
                        "support": [{"where": "x-min"}, *({"where": f"z-{end}", "fixed": "z"} for end in ("min", "max"))]} | rest)
    one, other = solve(flat, tolerance=1e-9), solve(solid, tolerance=1e-9)
    for level in (0, 0.0075, 0.015):
        row = np.flatnonzero(abs(other.mesh.points[:, 2] - level) < 1e-9)
        order = [row[np.lexsort(other.mesh.points[row, :2].round(9).T)], np.lexsort(one.mesh.points[:, :2].round(9).T)]
        assert one.displacement[-1, order[1]] == pytest.approx(other.displacement[-1, order[0]], abs=1e-6 * 0.01)
    assert one.reaction[-1, :2] == pytest.approx(other.reaction[-1, :2], rel=1e-5)
    assert one.energy[-1] == pytest.approx(other.energy[-1], rel=1e-6)
