"""Energy, stress and tangent of every law: on paper where F is simple, elsewhere against closed forms of the stress."""

import numpy as np
import pytest

from physics.body.elasticity import Elasticity
from physics.body.element import Samples
from physics.body.kernel import Kernel
from physics.body.material import LAWS, lame, law_of, stress
from physics.body.stress import first_piola, von_mises
from physics.mesh.build import build_mesh
from physics.reduced.elastic import Elastic
from physics.scene import Body, Material, Scene, Steps
from physics.schema import InputError
from physics.solution import solve
from tests.test_physics_stress import cauchy
from tests.test_physics_stress import material as closed_material

LAMBDA, MU = 3.0, 2.0
BULK = LAMBDA + 2 * MU / 3  # 13/3


def one_tensor(law, cells):
    """A cell of three nodes whose gradients are the unit vectors: F = I + the nodes' displacements as columns, forces the columns of P."""
    count = len(cells)
    return Kernel(law, np.arange(3 * count).reshape(-1, 3), Samples(np.broadcast_to(np.eye(3), (1, count, 3, 3)), np.ones((1, count)),
                                                                    np.ones((1, 2))))


def evaluate(law, F):
    """W (M,), P (M, 3, 3) and A = dP/dF (M, 3, 3, 3, 3) by the compiled code."""
    F = np.asarray(F, float).reshape(-1, 3, 3)
    kernel, u = one_tensor(law, F), np.ascontiguousarray((F - np.eye(3)).transpose(0, 2, 1)).reshape(-1, 3)
    slot = np.arange(len(F) * 45, dtype=np.int32).reshape(-1, 45)
    out = np.zeros(slot.size)
    kernel.add_stiffness(u, (LAMBDA, MU), slot, out)
    whole = np.zeros((len(F), 9, 9))
    whole[:, *np.triu_indices(9)] = out.reshape(-1, 45)
    whole = whole + np.triu(whole, 1).transpose(0, 2, 1)
    tangent = whole.reshape(-1, 3, 3, 3, 3).transpose(0, 2, 1, 4, 3)  # unknown 3 j + i is F_ij
    return kernel.energies(u, (LAMBDA, MU)), kernel.forces(u, (LAMBDA, MU)).reshape(-1, 3, 3).transpose(0, 2, 1), tangent


def piola(law, F, lmbda=LAMBDA, mu=MU):
    """First Piola-Kirchhoff stress in closed form (Bonet and Wood; Holzapfel)."""
    J, T = np.linalg.det(F), np.linalg.inv(F).T
    if law == "neo-hookean":
        return mu * J ** (-2 / 3) * (F - (F * F).sum() / 3 * T) + (lmbda + 2 * mu / 3) / 2 * (J**2 - 1) * T
    if law == "neo-hookean-log":
        return mu * (F - T) + lmbda * np.log(J) * T
    if law == "saint-venant-kirchhoff":
        E = (F.T @ F - np.eye(3)) / 2
        return F @ (lmbda * np.trace(E) * np.eye(3) + 2 * mu * E)
    e = (F + F.T) / 2 - np.eye(3)
    return lmbda * np.trace(e) * np.eye(3) + 2 * mu * e


def test_lame_parameters_by_hand():
    """E = 10, nu = 1/4: lambda = mu = 4. E = 9, nu = -1/2: mu = 9, lambda = -4.5 / (0.5 * 2) = -4.5. And K = E / (3 (1 - 2 nu))."""
    assert lame(Material(young_modulus=10.0, poisson_ratio=0.25)) == pytest.approx((4, 4), rel=1e-14)
    assert lame(Material(young_modulus=9.0, poisson_ratio=-0.5)) == pytest.approx((-4.5, 9), rel=1e-14)
    lmbda, mu = lame(Material(young_modulus=1e6, poisson_ratio=0.4))
    assert lmbda + 2 * mu / 3 == pytest.approx(1e6 / 0.6, rel=1e-14) and mu == pytest.approx(1e6 / 2.8, rel=1e-14)


# Stretches (2, 1, 1): J = 2, tr C = 6, E = diag(3/2, 0, 0), e = diag(1, 0, 0). Shear F_12 = 1: J = 1, tr C = 4,
# E = 1/2 [[0, 1], [1, 1]], e_12 = 1/2. Half the size: J = 1/8, tr C = 3/4, E = -3/8 I, e = -1/2 I.
STRETCH, SHEAR, HALF = np.diag([2.0, 1, 1]), np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]]), np.eye(3) / 2
LN2 = np.log(2)
ENERGIES = {
    "neo-hookean": (MU / 2 * (2 ** (-2 / 3) * 6 - 3) + BULK / 4 * (4 - 1 - 2 * LN2), MU / 2, BULK / 4 * (1 / 64 - 1 + 6 * LN2)),
    "neo-hookean-log": (MU / 2 * 3 - MU * LN2 + LAMBDA / 2 * LN2**2, MU / 2, MU / 2 * (3 / 4 - 3) + 3 * MU * LN2 + LAMBDA / 2 * 9 * LN2**2),
    "saint-venant-kirchhoff": (LAMBDA / 2 * 9 / 4 + MU * 9 / 4, LAMBDA / 2 / 4 + MU * 3 / 4, LAMBDA / 2 * 81 / 64 + MU * 3 * 9 / 64),
    "linear": (LAMBDA / 2 + MU, MU / 2, LAMBDA / 2 * 9 / 4 + MU * 3 / 4),
}


@pytest.mark.parametrize("law", LAWS)
def test_energies_by_hand(law):
    found, _, _ = evaluate(law, [STRETCH, SHEAR, HALF, np.eye(3)])
    assert found == pytest.approx([*ENERGIES[law], 0], rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("law", LAWS)
def test_stress_and_tangent_of_any_deformation(law):
    """P in closed form, and the tangent as its slope: central differences, off by step^2 = 1e-10 and rounding 1e-11."""
    rng = np.random.default_rng(5)
    F = np.eye(3) + rng.uniform(-0.3, 0.3, (9, 3, 3))  # nine: one more than a pack
    energy, stress, tangent = evaluate(law, F)
    np.testing.assert_allclose(stress, [piola(law, f) for f in F], rtol=0, atol=1e-12 * abs(stress).max())
    for k, one in np.ndenumerate(np.zeros((3, 3))):
        step = one + np.zeros((3, 3))
        step[k] = 1e-5
        slope = [(piola(law, f + step) - piola(law, f - step)) / 2e-5 for f in F]
        np.testing.assert_allclose(tangent[..., *k], slope, rtol=0, atol=1e-8 * abs(tangent).max())
    assert evaluate(law, F[[8]])[0] == pytest.approx(energy[[8]], rel=1e-14)  # whatever stands beside it


@pytest.mark.parametrize("law", LAWS)
def test_near_rest_every_law_is_hookes(law):
    """A_ijkl = lambda d_ij d_kl + mu (d_ik d_jl + d_il d_jk), and no energy or stress at rest."""
    energy, stress, tangent = evaluate(law, np.eye(3))
    eye = np.eye(3)
    hooke = LAMBDA * np.einsum("ij,kl->ijkl", eye, eye) + MU * (np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye))
    np.testing.assert_allclose(tangent[0], hooke, atol=1e-13)
    assert abs(energy[0]) < 1e-14 and abs(stress).max() < 1e-14


def test_laws_with_a_logarithm_have_no_energy_inside_out():
    inside_out = np.diag([-1.0, 1, 1])
    with np.errstate(invalid="ignore"):
        assert all(np.isnan(evaluate(law, inside_out)[0][0]) for law in ("neo-hookean", "neo-hookean-log"))
    assert evaluate("saint-venant-kirchhoff", inside_out)[0][0] == pytest.approx(0, abs=1e-14)  # C = I
    assert evaluate("linear", inside_out)[0][0] == pytest.approx(LAMBDA / 2 * 4 + MU * 4)  # e = diag(-2, 0, 0)


@pytest.mark.parametrize("stretch, lateral, stress", [(0.5, 1.322931, -1171231.57), (0.8, 1.094382, -256160.73), (0.9, 1.043300,
                                                                                                                  -112032.43),
                                                      (1.1, 0.962834, 90676.98), (1.5, 0.855271, 339862.62), (2.0, 0.773415, 539040.19)])
def test_the_default_law_has_the_uniaxial_stress_of_solids4foam(stretch, lateral, stress):
    """E = 1 MPa, nu = 0.4. A lateral stretch of six digits leaves a stress across of up to 1e-6 of K = 1.7 MPa."""
    kernel, F = one_tensor("neo-hookean", [0]), np.diag([stretch, lateral, lateral])
    P = kernel.forces(np.ascontiguousarray(F - np.eye(3)), lame(Material(young_modulus=1e6, poisson_ratio=0.4)))
    assert P[0, 0] == pytest.approx(stress, abs=10) and P[1, 1] == pytest.approx(0, abs=10) and P[1, 1] == pytest.approx(P[2, 2], abs=1e-8)


@pytest.mark.parametrize("law", ["neo-hooke", ""])
def test_an_unknown_law_is_an_error_that_names_the_known_ones(law):
    cube = Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1))
    mesh, material = build_mesh(cube), Material(law=law, young_modulus=1.0, poisson_ratio=0.3)
    free = np.zeros(len(mesh.points), bool)
    uses = (lambda: one_tensor(law, np.eye(3)[None]), lambda: first_piola(np.eye(3)[None], material),
            lambda: von_mises(mesh, mesh.points, material), lambda: Elasticity(mesh, material, np.repeat(free[:, None], 3, axis=1)),
            lambda: Elastic(mesh, free, material), lambda: solve(Scene(body=cube, material=material, steps=Steps(count=1))))
    for use in uses:
        with pytest.raises(InputError, match=f"material.law = {law!r}: must be one of {', '.join(LAWS)}"):
            use()


@pytest.mark.parametrize("law", ["neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"])
def test_stress_of_a_law_by_its_slopes_is_that_of_the_closed_form(law):
    """P = J sigma F^-T with sigma as textbooks have it; of a linear law P is sigma. Each tensor has a lambda and a mu of its own."""
    dice = np.random.default_rng(4)
    H, share = dice.uniform(-0.2, 0.2, (5, 3, 3)), np.array([1.0, 2.0, 0.5, 3.0, 1.0])
    lmbda, mu = (np.array(lame(closed_material(law))) * np.ones((5, 1))).T * share
    found = stress(law_of(law), H, lmbda, mu)
    for P, h, times in zip(found, H, share, strict=True):
        F = np.eye(3) + h
        sigma = times * cauchy(F, law)  # linear in both
        expected = sigma if law == "linear" else np.linalg.det(F) * sigma @ np.linalg.inv(F).T
        np.testing.assert_allclose(P, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())
    if law.startswith("neo"):
        over = stress(law_of(law), np.diag([-2.0, 0, 0])[None], lmbda[:1], mu[:1])
        assert np.isnan(over).all()  # a cell inside out
