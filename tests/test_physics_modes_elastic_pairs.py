"""Modes of a few boxes against stiffness and mass put together by plain loops and scipy's dense solver; what is said of pairs."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg

from physics.linalg.eigen.pairs import Pairs
from physics.mesh.build import build_mesh
from physics.modes.elastic import _first_bending, _rigid_motions, elastic_modes, elastic_problem, remarks
from physics.modes.laplacian import laplacian_modes
from physics.scene import read_body, read_scene
from tests.scenes import beam
from tests.test_physics_modes_elastic import two_cubes

E, NU, RHO = 210e9, 0.3, 7000.0
MATERIAL = {"young_modulus": E, "poisson_ratio": NU, "density": RHO}


def gauss(corners):
    """Of each of the 2^D Gauss points of a box: shape functions (n,), their gradients (n, D), and weight. corners (n, D)"""
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    side = np.sign(corners - low - size / 2)  # (n, D) -1 or 1
    for place in itertools.product((-1 / np.sqrt(3), 1 / np.sqrt(3)), repeat=len(size)):
        one = (1 + side * place) / 2  # (n, D)
        gradients = np.stack([side[:, d] / size[d] * np.prod(np.delete(one, d, axis=1), axis=1) for d in range(len(size))], axis=1)
        yield np.prod(one, axis=1), gradients, np.prod(size) / 2 ** len(size)


def matrices(mesh, D, first, second, density, thickness=1.0):
    """Stiffness for stress = first tr(strain) 1 + 2 second strain, and consistent mass, (D N, D N) dense."""
    n = D * len(mesh.points)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for cell in mesh.cells:
        dofs = (D * cell[:, None] + np.arange(D)).ravel()
        for shape, gradient, weight in gauss(mesh.points[cell][:, :D]):
            for a, b in itertools.product(range(len(cell)), repeat=2):
                block = first * np.outer(gradient[a], gradient[b]) + second * np.outer(gradient[b], gradient[a])
                block += second * gradient[a] @ gradient[b] * np.eye(D)
                rows, columns = dofs[D * a:D * a + D], dofs[D * b:D * b + D]
                K[np.ix_(rows, columns)] += thickness * weight * block
                M[np.ix_(rows, columns)] += thickness * weight * density * shape[a] * shape[b] * np.eye(D)
    return K, M


def body(kind):
    """A scene, its dimension and its elastic constants: a solid, a sheet without stress across it, and a slice without strain."""
    shear, lame = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    if kind == "solid":
        table = {"length": 0.5, "width": 0.2, "height": 0.3, "cells": [2, 1, 2], "cell": "hexahedron"}
        support = [{"where": "x-min", "fixed": "xz"}, {"where": "z-max", "fixed": "y"}]
        return table, support, 3, lame, shear, 1.0
    table = {"shape": "plate", "length": 0.5, "width": 0.2, "cells": [3, 2], "cell": "quadrilateral", "plane": kind, "thickness": 0.04}
    support = [{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "yz"}]
    return table, support, 2, E * NU / (1 - NU**2) if kind == "stress" else lame, shear, 0.04


@pytest.mark.parametrize("kind", ["solid", "stress", "strain"])
def test_pairs_are_those_of_matrices_put_together_by_loops(kind):
    table, support, D, lame, shear, thickness = body(kind)
    scene = read_scene({"body": table, "material": MATERIAL, "support": support})
    modes, mesh = elastic_modes(scene, count=7), build_mesh(scene.body)
    K, M = matrices(mesh, D, lame, shear, RHO, thickness)
    free = np.ones((len(mesh.points), D), bool)
    for where, letters in (("x-min", "xz"), ("z-max", "y")) if D == 3 else (("x-min", "x"), ("y-min", "y")):
        for letter in letters:
            free[mesh.places[where], "xyz".index(letter)] = False
    keep = np.flatnonzero(free)
    values, vectors = scipy.linalg.eigh(K[np.ix_(keep, keep)], M[np.ix_(keep, keep)])
    assert np.diff(values[:8]).min() > 1e-3 * values[0]  # no two alike
    assert modes.eigenvalues == pytest.approx(values[:7], rel=1e-9)
    assert modes.frequencies_hz == pytest.approx(np.sqrt(values[:7]) / (2 * np.pi), rel=1e-9)
    assert modes.dofs == len(keep) and modes.rigid == modes.rigid_expected == 0
    assert modes.shapes.shape == (7, len(mesh.points), 3) and not modes.shapes[:, :, D:].any()
    motions = (np.eye(D)[:, None, :] * free).reshape(D, -1)  # unit motions of what is free along each axis
    mass = np.array([motion @ M @ motion for motion in motions])
    assert modes.free_mass == pytest.approx([*mass, *np.zeros(3 - D)], rel=1e-9)
    for i, shape in enumerate(modes.shapes):
        exact = np.zeros(D * len(mesh.points))
        exact[keep] = vectors[:, i]
        exact *= np.sign(exact @ shape[:, :D].ravel())
        assert shape[:, :D].ravel() == pytest.approx(exact, abs=1e-6 * abs(exact).max())
        assert shape.max() == abs(shape).max()  # the largest component is positive
        assert modes.participation[i, :D] == pytest.approx(motions @ M @ exact, abs=1e-6 * np.sqrt(mass.max()))
        assert not modes.participation[i, D:].any()
    assert modes.effective_masses == pytest.approx(modes.participation**2)
    assert np.linalg.norm(modes.pictured, axis=2).max(axis=1) == pytest.approx(np.ones(7), rel=1e-12)
    assert modes.pictured[3] == pytest.approx(modes.shapes[3] / np.linalg.norm(modes.shapes[3], axis=1).max())
    assert modes.report == {"frequencies_hz": list(modes.frequencies_hz), "rigid_modes": 0, "rigid_modes_expected": 0,
                            "participation_factors": modes.participation.tolist(),
                            "effective_masses": modes.effective_masses.tolist(), "free_mass": modes.free_mass.tolist()}


def test_a_plane_body_without_a_thickness_is_one_metre_thick():
    table, *_ = body("strain")
    del table["thickness"]
    thick = elastic_modes(read_scene({"body": table, "material": MATERIAL, "support": []}), count=4)
    assert thick.free_mass == pytest.approx([RHO * 0.5 * 0.2] * 2 + [0])
    assert thick.rigid == thick.rigid_expected == 3 and thick.frequencies_hz[0] < 1e-3 * thick.frequencies_hz[3]


@pytest.mark.parametrize("solid", [False, True])
def test_laplacian_pairs_are_those_of_matrices_put_together_by_loops(solid):
    table = {"shape": "plate", "length": 0.5, "width": 0.2, "cells": [5, 3], "cell": "quadrilateral"}
    if solid:
        table |= {"height": 0.3, "cells": [3, 2, 2], "cell": "hexahedron"}
    D = 3 if solid else 2
    modes = laplacian_modes(read_body({"body": table}), count=6, dirichlet=["x-min", "y-max"])
    mesh = modes.mesh
    K, M = np.zeros((2, len(mesh.points), len(mesh.points)))
    for cell in mesh.cells:
        for shape, gradient, weight in gauss(mesh.points[cell][:, :D]):
            K[np.ix_(cell, cell)] += weight * gradient @ gradient.T
            M[np.ix_(cell, cell)] += weight * np.outer(shape, shape)
    keep = np.setdiff1d(np.arange(len(mesh.points)), np.concatenate([mesh.places["x-min"], mesh.places["y-max"]]))
    values, vectors = scipy.linalg.eigh(K[np.ix_(keep, keep)], M[np.ix_(keep, keep)])
    assert modes.eigenvalues == pytest.approx(values[:6], rel=1e-9)
    assert modes.dofs == len(keep) and modes.dirichlet == ("x-min", "y-max") and modes.constant == modes.constant_expected == 0
    for i, shape in enumerate(modes.shapes):
        exact = np.zeros(len(mesh.points))
        exact[keep] = vectors[:, i]
        assert shape == pytest.approx(exact * np.sign(exact @ shape), abs=1e-6 * abs(exact).max())
        assert shape.max() == abs(shape).max()
    assert abs(modes.pictured).max(axis=1) == pytest.approx(np.ones(6)) and modes.report["eigenvalues"] == modes.eigenvalues.tolist()
    assert modes.report == {"eigenvalues": modes.eigenvalues.tolist(), "dirichlet": ["x-min", "y-max"], "constant_modes": 0,
                            "constant_modes_expected": 0}
    whole = laplacian_modes(read_body({"body": table}), count=1)
    sides = (0.5, 0.2, 0.3)[:D]
    assert whole.dirichlet == ("the whole boundary",) and whole.eigenvalues[0] > np.pi**2 * sum(1 / side**2 for side in sides)


def test_a_rectangle_has_the_waves_along_its_sides():
    """pi^2 (m^2 / a^2 + n^2 / b^2), the sides 0.5 and 0.3; held along x = 0 alone: (m + 1/2)^2 along x, n from 0 across."""
    table = {"shape": "plate", "length": 0.5, "width": 0.3, "cells": [20, 12], "cell": "quadrilateral", "order": 2}
    waves = np.arange(6)
    for dirichlet, m, n in ((None, waves + 1, waves + 1), (["x-min"], waves + 0.5, waves), (["y-min", "y-max"], waves, waves + 1)):
        exact = np.sort(np.pi**2 * np.add.outer((m / 0.5) ** 2, (n / 0.3) ** 2).ravel())[:6]
        modes = laplacian_modes(read_body({"body": table}), count=6, dirichlet=dirichlet)
        assert modes.eigenvalues == pytest.approx(exact, rel=3e-4)  # (h^2 lambda)^2 / 1500, h = 1 / 40
        assert modes.cells == "quadrilaterals of 9 nodes of order 2"
    both = laplacian_modes(read_body({"body": table}), count=3, dirichlet=[])
    assert both.eigenvalues == pytest.approx([0, 4 * np.pi**2, np.pi**2 / 0.09], rel=1e-4, abs=1e-7)
    assert both.constant == both.constant_expected == 1 and both.clusters == (range(0, 1), range(1, 2), range(2, 3))
    assert both.shapes[0] == pytest.approx(np.full(len(both.mesh.points), 1 / np.sqrt(0.15)), rel=1e-6)  # integral of the square 1


def test_rigid_motions_strain_nothing_and_the_first_guess_is_of_the_slender_cantilever():
    for kind, count in (("solid", 6), ("strain", 3)):
        table, support, D, *_ = body(kind)
        scene = read_scene({"body": table, "material": MATERIAL, "support": support})
        mesh = build_mesh(scene.body)
        problem, space = elastic_problem(scene, mesh)
        motions = _rigid_motions(space)
        assert len(motions) == count == np.linalg.matrix_rank(motions)
        K = problem.stiffness[:, :]
        assert abs(K @ motions.T).max() < 1e-12 * abs(K).max()
        assert np.array_equal(problem.near_null, motions)
        # smallest extent above zero over the largest one squared, times the speed of sound, squared
        assert _first_bending(scene, mesh) == pytest.approx(E / RHO * (0.2 / 0.5**2) ** 2)
        assert problem.scale == _first_bending(scene, mesh) and problem.dimension == D and problem.zeros == 0


def pairs(values, zeros=0, beyond=10.0, residuals=1e-12):
    return Pairs(values=np.array(values), vectors=np.zeros((len(values), 1)), residuals=np.array([1e-13, residuals]), zeros=zeros,
                 beyond=beyond, counted=True, floor=3e-9, solver="")


def test_what_is_said_of_pairs():
    mesh, expected = SimpleNamespace(remarks=("read with care",)), SimpleNamespace(zeros=0)
    assert remarks(pairs([1.0, 5.0]), expected, mesh) == ("read with care",)
    assert remarks(pairs([1.0, 9.79]), expected, mesh)[1:] == ()
    cut = "is cut: the next eigenvalue is 10, 1.5 % above the last; ask for more to have the whole cluster"
    assert remarks(pairs([1.0, 9.85]), expected, mesh)[1:] == ("the last one " + cut,)
    assert remarks(pairs([1.0, 9.8, 9.85]), expected, mesh)[1:] == ("the last cluster " + cut,)
    assert remarks(pairs([1.0, 9.85], beyond=np.nan), expected, mesh)[1:] == ()
    six = SimpleNamespace(zeros=6)
    assert remarks(pairs([0.0, 0.0], 2, 0.0), six, mesh)[1:] == ("the last is one of 6 zeros: ask for 6 to have them all",)
    assert remarks(pairs(6 * [0.0], 6, 10.0), six, mesh)[1:] == ()
    assert remarks(pairs([*6 * [0.0], 5.0], 6), six, mesh)[1:] == ()
    assert remarks(pairs([0.0, 5.0], 1), expected, mesh)[1:] == (
        "1 eigenvalues are zero, 0 were expected: parts of the mesh hang together too loosely",)
    assert remarks(pairs([1.0, 5.0], residuals=2e-8), expected, mesh)[1:] == (
        "the largest residual is 2.0e-08; rounding alone leaves about 3.0e-09 on this mesh",)
    assert remarks(pairs([1.0, 5.0], residuals=9e-9), expected, mesh)[1:] == ()


def test_a_held_body_with_a_part_on_a_hinge_has_its_zeros():
    """Two cubes that share a corner, one of them held: the other one turns about it in three ways."""
    mesh = two_cubes("corner")
    mesh = dataclasses.replace(mesh, places={"x-min": np.flatnonzero(mesh.points[:, 0] < 1e-9)})
    modes = elastic_modes(beam(), mesh=mesh, count=5)
    assert (modes.rigid, modes.rigid_expected) == (3, 0) and modes.residuals.max() < 1e-8
    assert "too loosely" in modes.remarks[0] and modes.frequencies_hz[2] < 1e-3 * modes.frequencies_hz[3]
