"""Stress against closed forms of each law, the derivative of the energy, and a virtual-work identity on a whole mesh."""

import numpy as np
import pytest

from physics.body.elasticity import Elasticity
from physics.body.material import LAWS, lame
from physics.body.stress import deformation, first_piola, von_mises
from physics.mesh.build import build_mesh
from physics.mesh.quality import cell_volumes
from physics.scene import Body, Material

CELLS = ("prism", "tetrahedron", "hexahedron")


def material(law: str) -> Material:
    return Material(law=law, young_modulus=1e6, poisson_ratio=0.4)


def cauchy(F: np.ndarray, law: str) -> np.ndarray:
    """Closed forms, as textbooks give them (Bonet and Wood; Holzapfel)."""
    lmbda, mu = lame(material(law))
    eye, J, b = np.eye(3), np.linalg.det(F), F @ F.T
    if law == "neo-hookean":
        bulk = lmbda + 2 * mu / 3
        return mu * J ** (-5 / 3) * (b - np.trace(b) / 3 * eye) + bulk / 2 * (J - 1 / J) * eye
    if law == "neo-hookean-log":
        return (mu * (b - eye) + lmbda * np.log(J) * eye) / J
    if law == "saint-venant-kirchhoff":
        E = (F.T @ F - eye) / 2
        return F @ (lmbda * np.trace(E) * eye + 2 * mu * E) @ F.T / J
    e = (F + F.T) / 2 - eye
    return lmbda * np.trace(e) * eye + 2 * mu * e


def mises(sigma: np.ndarray) -> float:
    """By the three principal stresses, a form other than that of the code."""
    a, b, c = np.linalg.eigvalsh(sigma)
    return float(np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2))


@pytest.mark.parametrize("law", ["neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"])
@pytest.mark.parametrize("cell", CELLS)
def test_a_uniform_deformation_has_the_stress_of_the_closed_form(law, cell):
    F = np.eye(3) + np.random.default_rng(3).uniform(-0.2, 0.2, (3, 3))
    mesh = build_mesh(Body(length=0.06, width=0.03, height=0.03, cells=(3, 2, 2), cell=cell))
    u = mesh.points @ (F - np.eye(3)).T
    np.testing.assert_allclose(deformation(mesh, u), np.broadcast_to(F, (len(mesh.cells), 3, 3)), atol=1e-13)
    # One matrix for all cells, so only rounding remains.
    np.testing.assert_allclose(von_mises(mesh, u, material(law)), mises(cauchy(F, law)), rtol=1e-10)


def test_every_law_can_be_asked_for_stress_and_the_rest_state_has_none():
    for law in LAWS:
        assert abs(first_piola(np.eye(3)[None], material(law))).max() < 1e-6  # of 1e6 Pa: rounding


def test_stress_does_the_work_of_the_forces_on_tetrahedra():
    """For any v on a mesh of tetrahedra, sum over cells of V P : grad v = f . v, the definition of internal forces."""
    mesh = build_mesh(Body(length=0.06, width=0.03, height=0.03, cells=(3, 2, 2), cell="tetrahedron"))
    rng = np.random.default_rng(0)
    u, v = 1e-3 * rng.normal(size=mesh.points.shape), rng.normal(size=mesh.points.shape)
    law = material("neo-hookean")
    P, gradient = first_piola(deformation(mesh, u), law), deformation(mesh, v) - np.eye(3)
    inside = (cell_volumes(mesh.points, mesh.cells, mesh.cell)[:, None, None] * P * gradient).sum()
    force = Elasticity(mesh, law, np.zeros(mesh.points.shape, bool)).force(u)
    assert inside == pytest.approx((force * v).sum(), rel=1e-10)


def test_a_rigid_rotation_has_no_stress():
    mesh = build_mesh(Body(length=0.06, width=0.03, height=0.03, cells=(3, 2, 2)))
    turn = np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])
    assert von_mises(mesh, mesh.points @ (turn - np.eye(3)).T, material("neo-hookean")).max() < 1e-6


def test_von_mises_of_pulled_and_sheared_cells_by_hand():
    """E = 1 MPa, nu = 0.4, so mu = 5/14 MPa. Law "linear": stretched by 1 % along x 2 mu 0.01, sheared sqrt(3) mu 0.01."""
    mesh = build_mesh(Body(length=0.06, width=0.03, height=0.03, cells=(2, 1, 1), cell="tetrahedron"))
    x, y, z = mesh.points.T
    mu, zero = 1e6 / 2.8, 0 * x
    for u, expected in (((0.01 * x, zero, zero), 0.02 * mu), ((0.01 * y, zero, zero), 3**0.5 * 0.01 * mu),
                        ((zero, zero, 0.01 * x), 3**0.5 * 0.01 * mu),
                        ((0.01 * x, 0.01 * y, 0.01 * z), 0), ((0.01 * x, -0.02 * y, 0.03 * z), 2 * mu * 0.01 * 19**0.5)):
        # the last: differences of the stretches 3, 5 and 2 %, and sqrt((9 + 25 + 4) / 2)
        np.testing.assert_allclose(von_mises(mesh, np.stack(u, axis=1), material("linear")), expected, rtol=1e-9, atol=1e-6)


def test_piola_is_not_its_transpose():
    """One F with F_12 = 1 alone, law of Saint-Venant and Kirchhoff: E = 1/2 [[0, 1], [1, 1]], S = lambda/2 I + 2 mu E, P = F S."""
    lmbda, mu = lame(material("saint-venant-kirchhoff"))
    F = np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]])
    expected = np.array([[lmbda / 2 + mu, lmbda / 2 + 2 * mu, 0], [mu, lmbda / 2 + mu, 0], [0, 0, lmbda / 2]])
    np.testing.assert_allclose(first_piola(np.stack([np.eye(3), F]), material("saint-venant-kirchhoff"))[1], expected, rtol=1e-12,
                               atol=1e-6)


def test_a_cell_inside_out_has_no_stress_and_the_others_keep_theirs():
    mesh = build_mesh(Body(length=2.0, width=1.0, height=1.0, cells=(2, 1, 1), cell="hexahedron"))
    u = np.where(mesh.points[:, :1] > 1.5, [-2.0, 0, 0], [0.0, 0, 0])  # the second cell is turned over
    found = von_mises(mesh, u, material("neo-hookean"))
    assert found[0] == pytest.approx(0, abs=1e-6) and np.isnan(found[1])
