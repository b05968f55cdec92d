"""The sums over cells, against integrals of polynomials and against the forms of dolfinx."""

from dataclasses import replace

import numpy as np
import pytest

from physics.flow.space import FlowSpace
from physics.mesh.build import build_mesh
from physics.scene import read_body
from tests.flows import rectangle

GAUSS = np.polynomial.legendre.leggauss(12)


def integral(function):
    """Over the unit square, of a function of points (n, 2)."""
    x, w = (GAUSS[0] + 1) / 2, GAUSS[1] / 2
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.tensordot(np.outer(w, w).ravel(), function(points), 1)


def u(x):
    return np.stack([x[:, 0] ** 2 + x[:, 1], x[:, 0] * x[:, 1] - 3 * x[:, 1] ** 2], axis=1)


def grad_u(x):
    """(n, 2, 2) component, direction"""
    zero = np.ones(len(x))
    return np.stack([np.stack([2 * x[:, 0], zero], axis=1), np.stack([x[:, 1], x[:, 0] - 6 * x[:, 1]], axis=1)], axis=1)


def g(x):
    return np.stack([1 - x[:, 0] * x[:, 1], x[:, 0] ** 2], axis=1)


def v(x):
    return np.stack([x[:, 1] ** 2, 2 * x[:, 0] - x[:, 1] * x[:, 0]], axis=1)


def div_v(x):
    return -x[:, 0]


def p(x):
    return 1 + 2 * x[:, 0] - 3 * x[:, 1]


@pytest.mark.parametrize("order", (2, 3))
def test_the_form_of_momentum_is_exact_for_polynomials(order):
    """Only the convection of u by itself has the half of the divergence; each term is asked for alone as well."""
    space = FlowSpace(rectangle(3, seed=5), order)
    x, y = space.velocity.points, space.pressure.points
    nothing, none = np.zeros_like(x), np.zeros(len(y))

    def convection(z):
        gradient = grad_u(z)
        return np.einsum("nd,nkd->nk", u(z), gradient) + np.einsum("ndd->n", gradient)[:, None] / 2 * u(z)

    terms = {"mass": ((nothing, g(x), none), integral(lambda z: (g(z) * v(z)).sum(axis=1))),
             "convection": ((u(x), nothing, none), -integral(lambda z: (convection(z) * v(z)).sum(axis=1))),
             "pressure": ((nothing, nothing, p(y)), integral(lambda z: p(z) * div_v(z)))}
    for name, (given, wanted) in terms.items():
        assert (space.momentum(*given) * v(x)).sum() == pytest.approx(wanted, rel=1e-12), name
    whole = (space.momentum(u(x), g(x), p(y)) * v(x)).sum()
    assert whole == pytest.approx(sum(wanted for _, wanted in terms.values()), rel=1e-12)


@pytest.mark.parametrize("order", (2, 3))
def test_the_form_of_divergence_is_exact_for_polynomials(order):
    space = FlowSpace(rectangle(3, seed=5), order)
    found = space.divergence(u(space.velocity.points)) @ p(space.pressure.points)
    assert found == pytest.approx(integral(lambda z: p(z) * np.einsum("ndd->n", grad_u(z))), rel=1e-12)


@pytest.mark.parametrize("order", (2, 3))
@pytest.mark.parametrize("cells", (1, 2, 5, 8))
def test_sums_of_cells_that_do_not_fill_a_pack(order, cells):
    """Four cells are summed at once; what stands beside the last one counts nothing."""
    mesh = rectangle(2, seed=2)
    whole = replace(mesh, cells=mesh.cells[:cells])
    space = FlowSpace(whole, order)
    x, y = space.velocity.points, space.pressure.points
    alone = [FlowSpace(replace(mesh, cells=mesh.cells[i:i + 1]), order) for i in range(cells)]
    parts = sum((s.momentum(u(s.velocity.points), g(s.velocity.points), p(s.pressure.points)) * v(s.velocity.points)).sum() for s in alone)
    assert (space.momentum(u(x), g(x), p(y)) * v(x)).sum() == pytest.approx(parts, rel=1e-12)


@pytest.mark.parametrize("order", (2, 3))
def test_curved_sides_have_the_area_and_the_gradients_of_a_round_hole(order):
    """Area to the fourth order of the cells' angle; a field that is linear in x has its gradient in curved cells too."""
    radius, areas = 0.05, []
    for size in (0.03, 0.015):
        body = read_body({"body": {"shape": "channel", "length": 0.6, "cell_size": 0.05, "hole_cell_size": size}})
        space = FlowSpace(build_mesh(body), order)
        areas.append(abs(space.mass.sum() - (0.6 * 0.41 - np.pi * radius**2)))
        x = space.velocity.points
        gradient = np.einsum("pcid,ci->d", space.gradients, (2 * x[:, 0] - 3 * x[:, 1])[space.velocity.cells])
        np.testing.assert_allclose(gradient, space.mass.sum() * np.array([2.0, -3.0]), rtol=1e-12)
    assert areas[0] < 1e-3 * np.pi * radius**2
    assert areas[0] / areas[1] > 12  # 16 for cells of half the angle


@pytest.mark.parametrize("order", (2, 3))
def test_blocks_are_the_matrices_of_the_forms(order):
    """Mass and viscosity of polynomials, their divergence by the loop."""
    space = FlowSpace(rectangle(4, seed=7), order)
    x, y = space.velocity.points, space.pressure.points
    mass, viscosity = (space.matrix(blocks) for blocks in (space.mass, space.viscosity))
    assert (u(x) * (mass @ v(x))).sum() == pytest.approx(integral(lambda z: (u(z) * v(z)).sum(axis=1)), rel=1e-12)
    assert (u(x) * (viscosity @ u(x))).sum() == pytest.approx(integral(lambda z: (grad_u(z) ** 2).sum(axis=(1, 2))), rel=1e-12)
    blocks = space.divergence_blocks()
    found = np.einsum("cijd,ci,cjd->", blocks, p(y)[space.pressure.cells], u(x)[space.velocity.cells])
    assert found == pytest.approx(space.divergence(u(x)) @ p(y), rel=1e-12)
    laplacian = np.einsum("cij,ci,cj->", space.stiffness_of_pressure(), *(p(y)[space.pressure.cells],) * 2)
    assert laplacian == pytest.approx(13.0, rel=1e-12)
    assert np.einsum("cij,cj->", space.mass_of_pressure(), p(y)[space.pressure.cells]) == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("order", (2, 3))
def test_the_finest_part_is_what_the_highest_order_adds(order):
    """Nothing of a polynomial of one order less; of x^k on one pair of cells what its interpolant leaves, by quadrature of its own."""
    space = FlowSpace(rectangle(1), order)
    x = space.velocity.points[:, 0]
    lower, highest = (np.stack([x**power, 0 * x], axis=1) for power in (order - 1, order))
    assert space.finest(lower) < 1e-12
    knots = np.linspace(0, 1, order)
    left = integral(lambda z: ((z[:, 0] ** order - np.polyval(np.polyfit(knots, knots**order, order - 1), z[:, 0])) ** 2))
    assert space.finest(highest) == pytest.approx(np.sqrt(left * (2 * order + 1)), rel=1e-9)


def test_the_rate_is_how_often_fluid_crosses_a_cell():
    """Fluid of 3 m/s along x through squares of 0.25 m cut in two."""
    space = FlowSpace(rectangle(4), 2)
    fluid = np.zeros((len(space.velocity.points), 2))
    fluid[:, 0] = 3.0
    assert space.rate(fluid) == pytest.approx(12.0, rel=1e-12)
