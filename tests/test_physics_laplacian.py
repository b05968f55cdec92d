"""Laplacian modes: exact eigenvalues, convergence orders, boundaries."""

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.modes.laplacian import laplacian_modes
from physics.scene import read_body
from physics.schema import InputError

SQUARE = np.pi**2 * np.array([2, 5, 5, 8, 10, 10])  # pi^2 (m^2 + n^2)
L_SHAPE = 9.639723844021941  # Trefethen and Betcke, Computed eigenmodes of planar regions, 2006


def square(n, **changes):
    return read_body({"body": {"shape": "plate", "length": 1, "width": 1, "cells": [n, n], "cell": "triangle"} | changes})


def cube(n, cell, **changes):
    return read_body({"body": {"shape": "plate", "length": 1, "width": 1, "height": 1, "cells": [n, n, n], "cell": cell} | changes})


def bound(values, h, order):
    """Relative errors of eigenvalues on a mesh of size h: (h^2 lambda)^p / 50, from interpolation; 1/150 is seen."""
    return (h**2 * np.max(values)) ** order / 50


def orders(exact, *found):
    """log2 of the ratio of errors on meshes of n and 2 n."""
    coarse, fine = (np.array(values) / exact - 1 for values in found)
    return np.log2(coarse / fine)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("order, n", [(1, 20), (2, 10)])
def test_square_converges_with_order_2p(cell, order, n):
    coarse, fine = (laplacian_modes(square(k, cell=cell, order=order), count=6) for k in (n, 2 * n))
    assert max(coarse.residuals.max(), fine.residuals.max()) < 1e-8
    assert (fine.eigenvalues > SQUARE * (1 - 1e-12)).all()  # Rayleigh quotients of a smaller space
    assert orders(SQUARE, coarse.eigenvalues, fine.eigenvalues) == pytest.approx(2 * order, abs=0.3)
    assert fine.eigenvalues == pytest.approx(SQUARE, rel=(2e-2, 1e-4)[order - 1])


def test_square_without_dirichlet_has_one_constant_mode():
    modes = laplacian_modes(square(16, order=2), count=4, dirichlet=[])
    assert modes.constant == modes.constant_expected == 1
    assert abs(modes.eigenvalues[0]) < 1e-9 and modes.residuals.max() < 1e-8
    assert modes.eigenvalues[1:] == pytest.approx(np.pi**2 * np.array([1, 1, 2]), rel=bound(20, 1 / 16, 2))
    assert modes.clusters == (range(0, 1), range(1, 3), range(3, 4))
    assert np.ptp(modes.shapes[0]) < 1e-9 * abs(modes.shapes[0]).max()


def test_one_side_held():
    """phi = 0 at x = 0 only: (pi/2)^2 first, then with one wave across y."""
    modes = laplacian_modes(square(16, order=2, cell="quadrilateral"), count=3, dirichlet=["x-min"])
    exact = np.pi**2 * np.array([0.25, 1.25, 2.25])
    assert modes.eigenvalues == pytest.approx(exact, rel=bound(exact, 1 / 16, 2))
    assert not modes.shapes[:, modes.mesh.places["x-min"]].any()


@pytest.mark.parametrize("cell, order, n", [("prism", 1, 6), ("tetrahedron", 1, 8), ("hexahedron", 1, 6), ("tetrahedron", 2, 4),
                                            ("hexahedron", 2, 3)])
def test_cube_converges_with_order_2p(cell, order, n):
    coarse, fine = (laplacian_modes(cube(k, cell, order=order), count=1).eigenvalues for k in (n, 2 * n))
    assert orders(3 * np.pi**2, coarse, fine) == pytest.approx(2 * order, abs=0.3)


def l_shape(n):
    """Three unit squares around a corner, in triangles."""
    whole = build_mesh(square(2 * n, length=2, width=2))
    middle = whole.points[whole.cells].mean(axis=1)
    cells = whole.cells[~((middle[:, 0] > 1) & (middle[:, 1] > 1))]
    used, cells = np.unique(cells, return_inverse=True)
    return Mesh(whole.points[used], cells.reshape(-1, 3), "triangle", {})


def test_l_shape():
    """The corner makes the first eigenvalue converge with h^(4/3), whatever the order; the third is smooth, 2 pi^2."""
    coarse, fine = (laplacian_modes(square(1, order=2), mesh=l_shape(n), count=3) for n in (12, 24))
    assert orders(L_SHAPE, coarse.eigenvalues[0], fine.eigenvalues[0]) == pytest.approx(4 / 3, abs=0.3)
    assert fine.eigenvalues[0] == pytest.approx(L_SHAPE, rel=4e-3) and fine.eigenvalues[0] > L_SHAPE
    assert fine.eigenvalues[2] == pytest.approx(2 * np.pi**2, rel=bound(20, 1 / 24, 2))


def test_channel_is_open_at_its_outlet_only():
    modes = laplacian_modes(read_body({"body": {"shape": "channel"}}), count=10)
    held = np.unique(np.concatenate([modes.mesh.places[name] for name in ("inlet", "walls", "hole")]))
    assert not modes.shapes[:, held].any() and modes.residuals.max() < 1e-8
    free = np.setdiff1d(modes.mesh.places["outlet"], held)
    assert abs(modes.shapes[:, free]).max() > 0.1
    named = laplacian_modes(read_body({"body": {"shape": "channel"}}), count=10, dirichlet=["inlet", "walls", "hole"])
    assert named.eigenvalues == pytest.approx(modes.eigenvalues, rel=1e-9)
    # Far from the hole it is a strip: (pi / 0.41)^2 bounds all from below.
    assert modes.eigenvalues[0] > (np.pi / 0.41) ** 2


def test_channel_converges():
    """Halved cells bring the hole's polygon and the elements' error down by four; second order agrees with the limit."""
    values = [laplacian_modes(read_body({"body": {"shape": "channel", "cell_size": size}}), count=3).eigenvalues
              for size in (0.04, 0.02, 0.01)]
    rate = np.log2((values[0] - values[1]) / (values[1] - values[2]))
    assert rate == pytest.approx(2, abs=0.3)
    limit = values[2] + (values[2] - values[1]) / 3
    fine = laplacian_modes(read_body({"body": {"shape": "channel", "cell_size": 0.01, "order": 2}}), count=3).eigenvalues
    assert fine == pytest.approx(limit, rel=1e-3)  # the second order's hole is a polygon too


def test_multigrid_finds_the_same():
    body = cube(8, "hexahedron", order=2)
    few, many = (laplacian_modes(body, count=7, method=method) for method in ("direct", "multigrid"))
    assert many.eigenvalues == pytest.approx(few.eigenvalues, rel=1e-9)
    assert max(few.residuals.max(), many.residuals.max()) < 1e-8
    assert "multigrid" in many.solver and "MUMPS" in few.solver


def test_wrong_places_are_named():
    with pytest.raises(InputError, match="did you mean 'outlet'"):
        laplacian_modes(read_body({"body": {"shape": "channel"}}), dirichlet=["outlett"])
    with pytest.raises(InputError, match="free values"):
        laplacian_modes(square(2), count=2)
