"""Strain energies of isotropic solids, in J per cubic metre of the rest body, as functions of two invariants; what is made of which.

F = I + grad u is the deformation gradient, J = det F, C = F^T F, E = (C - I)/2 the Green-Lagrange strain, e = sym(grad u) the
small one. From Young's modulus and Poisson's ratio: mu the shear modulus, lambda Lame's first parameter, K the bulk modulus [Pa].

    invariants         a        b          da/dF    db/dF
    "stretch"          tr C     J          2 F      J F^-T
    "strain"           tr E     E : E      F        2 F E
    "small strain"     tr e     e : e      I        2 e

Stress and tangent are not written down anywhere: UFL differentiates the energies for the compiled kernels (kernel.py), and
`stress` takes their slopes by complex steps, exact to rounding, where there is no UFL (physics/reduced).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.mesh.mesh import Mesh
from physics.scene import Material, Materials, Orthotropic
from physics.schema import Bound, InputError

Floats = NDArray[np.float64]
Cells = NDArray[np.int64] | slice  # numbers of cells (c,), or all of them
Expression = Any  # of UFL, which has no useful types, or an array
STEP = 1e-30  # along the imaginary axis: its square is nothing beside 1
AT_ONCE = 1024  # points, so that what is between stays in the cache


@dataclass(frozen=True)
class Law:
    """invariants: which two; energy: of a, b, lambda, mu and the logarithm to be taken."""

    invariants: str
    energy: Callable[[Expression, Expression, Expression, Expression, Callable[[Any], Any]], Expression]


def lame(material: Material) -> tuple[float, float]:
    """Lame's parameters (lambda, mu) [Pa]."""
    young, poisson = material.young_modulus, material.poisson_ratio
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def neo_hookean(C: Expression, J: Expression, lmbda: Expression, mu: Expression, ln: Callable[[Any], Any]) -> Expression:
    """mu/2 (J^(-2/3) tr C - 3) + K/4 (J^2 - 1 - 2 ln J): neoHookeanElastic of solids4foam, the law of the data set."""
    bulk = lmbda + 2 * mu / 3
    return mu / 2 * (J ** (-2 / 3) * C - 3) + bulk / 4 * (J**2 - 1 - 2 * ln(J))


def neo_hookean_log(C: Expression, J: Expression, lmbda: Expression, mu: Expression, ln: Callable[[Any], Any]) -> Expression:
    """mu/2 (tr C - 3) - mu ln J + lambda/2 (ln J)^2: Bonet and Wood, Nonlinear Continuum Mechanics, eq. 6.27."""
    log_J = ln(J)
    return mu / 2 * (C - 3) - mu * log_J + lmbda / 2 * log_J**2


def quadratic(trace: Expression, square: Expression, lmbda: Expression, mu: Expression, ln: Callable[[Any], Any]) -> Expression:
    """lambda/2 (tr E)^2 + mu E : E: Saint Venant and Kirchhoff's law, or Hooke's with the small strain."""
    return lmbda / 2 * trace**2 + mu * square


LAWS = {
    "neo-hookean": Law("stretch", neo_hookean),
    "neo-hookean-log": Law("stretch", neo_hookean_log),
    "saint-venant-kirchhoff": Law("strain", quadratic),
    "linear": Law("small strain", quadratic),
}


def law_of(name: str) -> Law:
    """Raises `InputError` for an unknown law."""
    Bound(choice=tuple(LAWS)).check(name, "material.law")
    return LAWS[name]


def stress(law: Law, H: Floats, lmbda: Floats, mu: Floats) -> Floats:
    """First Piola-Kirchhoff stress P = dW/dF (Q, 3, 3) at H = F - I; not finite where a cell is inside out and the law minds.

    Args: lambda and mu (Q,), of which it has the unit
    """
    found = np.empty_like(H)
    for part in (slice(start, start + AT_ONCE) for start in range(0, len(H), AT_ONCE)):
        found[part] = _stress(law, H[part], lmbda[part], mu[part])
    return found


def _stress(law: Law, H: Floats, lmbda: Floats, mu: Floats) -> Floats:
    F = H + np.eye(3)
    if law.invariants == "stretch":
        cofactor = np.empty_like(F)  # J F^-T
        for i, j in np.ndindex(3, 3):
            cofactor[:, i, j] = F[:, i - 2, j - 2] * F[:, i - 1, j - 1] - F[:, i - 2, j - 1] * F[:, i - 1, j - 2]
        a, b = np.einsum("qij,qij->q", F, F), np.einsum("qi,qi->q", F[:, 0], cofactor[:, 0])
        b[b <= 0] = np.nan
        slopes = 2 * F, cofactor
    else:
        strain = (H + H.swapaxes(1, 2)) / 2
        small = law.invariants == "small strain"
        strain = strain if small else strain + H.swapaxes(1, 2) @ H / 2
        a, b = np.trace(strain, axis1=1, axis2=2), (strain * strain).sum(axis=(1, 2))
        slopes = (np.eye(3), 2 * strain) if small else (F, 2 * F @ strain)
    by_a = law.energy(a + 1j * STEP, b, lmbda, mu, np.log).imag / STEP
    by_b = law.energy(a, b + 1j * STEP, lmbda, mu, np.log).imag / STEP
    return np.asarray(by_a[:, None, None] * slopes[0] + by_b[:, None, None] * slopes[1])


def by_region(materials: Materials, mesh: Mesh) -> list[tuple[Material, Cells]]:
    """Each material of a body with the cells that are made of it. Raises `InputError` unless every cell has exactly one."""
    if isinstance(materials, Material):
        return [(materials, slice(None))]
    of = np.full(len(mesh.cells), -1)
    for i, material in enumerate(materials):
        if material.where is None:
            continue
        try:
            inside = mesh.region(material.where)
        except InputError as error:
            raise InputError(f"material[{i}].where = {material.where!r}: {error}") from None
        if (of[inside] >= 0).any():
            cell = np.flatnonzero(inside & (of >= 0))[0]
            raise InputError(f"material[{i}].where = {material.where!r}: {(of[inside] >= 0).sum()} of its cells are of "
                             f"material[{of[cell]}] already, {_lies(mesh, cell)}; every cell has one material")
        of[inside] = i
    rest = [i for i, material in enumerate(materials) if material.where is None]
    if rest and (of >= 0).all():
        raise InputError(f"material[{rest[0]}]: is that of all other cells, and there are none: the others have every cell of the body")
    if not rest and (of < 0).any():
        raise InputError(f"material: {(of < 0).sum()} of {len(of)} cells have none, {_lies(mesh, np.flatnonzero(of < 0)[0])}; "
                         "a material without where is that of all other cells")
    of[of < 0] = rest[0] if rest else -1
    return [(material, np.flatnonzero(of == i)) for i, material in enumerate(materials)]


def _lies(mesh: Mesh, cell: np.int64) -> str:
    centre = mesh.points[mesh.cells[cell]].mean(axis=0)
    return f"the first about ({', '.join(f'{x:.4g}' for x in centre)}) m"


def cellwise(materials: Materials, mesh: Mesh, value: Callable[[Material], float]) -> float | Floats:
    """A value of a body's material: one number, or of several materials one for each cell (C,)."""
    if isinstance(materials, Material):
        return value(materials)
    found = np.empty(len(mesh.cells))
    for material, cells in by_region(materials, mesh):
        found[cells] = value(material)
    return found


def hooke(material: Material, plane: str | None = None) -> tuple[Floats, tuple[float, ...]]:
    """What `orthotropic_stiffness` gives, of any material."""
    first, second = material.young_modulus, lame(material)[1]
    return orthotropic_stiffness(material.orthotropic or Orthotropic(
        young_moduli=(first,) * 3, poisson_ratios=(material.poisson_ratio,) * 3, shear_moduli=(second,) * 3), plane)


def orthotropic_stiffness(material: Orthotropic, plane: str | None = None) -> tuple[Floats, tuple[float, ...]]:
    """C (d, d) of the normal strains, sigma_i = sum_j C_ij epsilon_j, and the shear moduli, sigma_ij = 2 G_ij epsilon_ij [Pa].

    C is the inverse of S, S_ii = 1 / E_i, S_ij = S_ji = - nu_ij / E_i (Lekhnitskii, Theory of Elasticity of an Anisotropic Body, 3).

    plane: None for a solid, d = 3 and G of xy, yz, xz; "strain" or "stress" in the plane xy, d = 2 and one G
    """
    (x, y, z), (xy, yz, xz) = material.young_moduli, material.poisson_ratios
    S = np.array([[1 / x, -xy / x, -xz / x], [-xy / x, 1 / y, -yz / y], [-xz / x, -yz / y, 1 / z]])
    if plane is None:
        return np.linalg.inv(S), material.shear_moduli
    return np.linalg.inv(S[:2, :2]) if plane == "stress" else np.linalg.inv(S)[:2, :2], material.shear_moduli[:1]
