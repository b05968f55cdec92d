"""Which solver a body gets: a factor of its tangent stiffness, or multigrid where that would be too large; and what a factor can do.

A factor is kept for as many solves as it is worth. It is banded or dissected (cholesky.py), or MUMPS's where the stiffness is not
positive definite (indefinite.py). Legend: N nodes.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physics.linalg import cholesky
from physics.linalg.cholesky import BandFactor, DissectionFactor, narrowest_order
from physics.linalg.multigrid import Multigrid
from physics.linalg.ordering.nested import dissect
from physics.linalg.stiffness import Stiffness

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Factor(Protocol):
    """What all kinds of factors do; held components are zero in every solution.

    Attributes:
        elasticity: whose stiffness it is of; name: in words
        double: whether its numbers have double precision
        negative: eigenvalues of the factored stiffness below zero
        worth: how many Newton steps with a kept factor cost about as much as a new one
        learned: nodes (m,) whose columns are known, group by group as they came
    """

    elasticity: Stiffness
    name: str
    double: bool
    negative: int
    worth: int

    @property
    def learned(self) -> list[Integers]: ...

    def widen(self) -> None:
        """Have numbers of double precision from the next update on."""

    def update(self, u: Floats) -> None:
        """Factor the stiffness at displacements (N, 3). Raises `NotPositiveDefinite` when that fails."""

    def solve(self, force: Floats) -> Floats:
        """K^-1 f for nodal forces (N, 3) [N]: displacements (N, 3) [m]."""

    def compliance(self, nodes: Integers) -> Floats:
        """(3 n, 3 n) displacements of n nodes under unit forces on their components; zero for held ones."""

    def learn(self, nodes: Integers) -> None:
        """Find the columns of n nodes that are not known yet."""

    def begin(self, force: Floats) -> Floats:
        """The first half of a solution: what `at` and `finish` take."""

    def at(self, begun: Floats, nodes: Integers) -> Floats:
        """(n, 3) displacements of n nodes in the solution that was begun."""

    def finish(self, begun: Floats, nodes: Integers | None = None, push: Floats | None = None) -> Floats:
        """(N, 3) the solution, with forces (n, 3) on n nodes added."""


def solver_for(elasticity: Stiffness, *, method: str | None = None, spread: bool = False) -> Factor | Multigrid:
    """What suits a body: a factor, or multigrid where that is too large.

    Args:
        method: "direct" or "multigrid" instead of the choice by size
        spread: over all processes of an MPI run, which multigrid alone can do
    """
    if spread or method == "multigrid":
        return Multigrid(elasticity, why="which processes share" if spread else "as asked for", spread=spread)
    order, band = narrowest_order(elasticity)
    if band <= cholesky.WIDEST_BAND:
        return BandFactor(elasticity, order, band)
    dissection = dissect(elasticity.mesh.points, elasticity.cells)
    if method == "direct" or dissection.numbers <= cholesky.MOST_NUMBERS:
        return DissectionFactor(elasticity, dissection, single=True)
    size, limit = 8e-9 * dissection.numbers, 8e-9 * cholesky.MOST_NUMBERS
    return Multigrid(elasticity, why=f"for a factor would take {size:.2g} GB, more than {limit:.2g} GB")


def factor_for(elasticity: Stiffness) -> Factor:
    """The factor that suits a body, whatever it takes: banded when its nodes can be numbered so that the band is narrow."""
    order, band = narrowest_order(elasticity)
    return BandFactor(elasticity, order, band) if band <= cholesky.WIDEST_BAND else DissectionFactor(elasticity)
