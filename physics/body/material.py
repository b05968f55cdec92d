"""Strain-energy densities W(F) of isotropic solids, in J per cubic metre of the rest body.

F = I + grad u is the deformation gradient, J = det F, C = F^T F, E = (C - I)/2 the Green-Lagrange strain. From
Young's modulus and Poisson's ratio: mu the shear modulus, lambda Lame's first parameter, K the bulk modulus [Pa].
Stress and tangent are not written down anywhere: UFL differentiates W (first Piola-Kirchhoff stress P = dW/dF).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ufl

from physics.scene import Material

Expression = Any  # UFL has no useful types


def lame(material: Material) -> tuple[float, float]:
    """Lame's parameters (lambda, mu) [Pa]."""
    young, poisson = material.young_modulus, material.poisson_ratio
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def neo_hookean(F: Expression, lmbda: Expression, mu: Expression) -> Expression:
    """mu/2 (J^(-2/3) tr C - 3) + K/4 (J^2 - 1 - 2 ln J): neoHookeanElastic of solids4foam, the law of the data set."""
    J = ufl.det(F)
    bulk = lmbda + 2 * mu / 3
    return mu / 2 * (J ** (-2 / 3) * ufl.inner(F, F) - 3) + bulk / 4 * (J**2 - 1 - 2 * ufl.ln(J))


def neo_hookean_log(F: Expression, lmbda: Expression, mu: Expression) -> Expression:
    """mu/2 (tr C - 3) - mu ln J + lambda/2 (ln J)^2: Bonet and Wood, Nonlinear Continuum Mechanics, eq. 6.27."""
    log_J = ufl.ln(ufl.det(F))
    return mu / 2 * (ufl.inner(F, F) - 3) - mu * log_J + lmbda / 2 * log_J**2


def saint_venant_kirchhoff(F: Expression, lmbda: Expression, mu: Expression) -> Expression:
    """lambda/2 (tr E)^2 + mu E : E."""
    E = (F.T * F - ufl.Identity(3)) / 2
    return lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)


def linear(F: Expression, lmbda: Expression, mu: Expression) -> Expression:
    """lambda/2 (tr e)^2 + mu e : e with the small strain e = (grad u + grad u^T)/2: Hooke's law."""
    e = (F + F.T) / 2 - ufl.Identity(3)
    return lmbda / 2 * ufl.tr(e) ** 2 + mu * ufl.inner(e, e)


LAWS: dict[str, Callable[[Expression, Expression, Expression], Expression]] = {
    "neo-hookean": neo_hookean,
    "neo-hookean-log": neo_hookean_log,
    "saint-venant-kirchhoff": saint_venant_kirchhoff,
    "linear": linear,
}
