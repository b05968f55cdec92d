"""What linear solvers ask of a body: a stiffness that is added up from its cells, and where its nodes are.

body/elasticity.py and motion/dynamics.py have one each. Legend: N nodes, C cells of n nodes, d = 3 n.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from physics import fem
from physics.mesh.mesh import Mesh
from physics.scene import Materials

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Stiffness(Protocol):
    """The tangent stiffness of a body, held components left out.

    Attributes:
        mesh, material: the body's; space: dolfinx's numbering of its components
        cells: (C, n) nodes of each cell, 32-bit; fixed: (N, 3) True on held components
    """

    mesh: Mesh
    material: Materials
    fixed: NDArray[np.bool_]
    cells: NDArray[np.int32]

    @property
    def space(self) -> fem.Space: ...

    def pairs(self, unknown: Integers) -> tuple[Integers, Integers]:
        """Rows and columns (C, d (d + 1) / 2) of the entries that each cell adds to, none twice, for unknowns numbered (N, 3)."""

    def add_stiffness(self, u: Floats, slot: NDArray[np.int32], out: NDArray[Any]) -> None:
        """Add each cell's entries at displacements (N, 3) to out[slot], of single or double precision, slot as `pairs`."""

    def stiffness(self, u: Floats) -> PETSc.Mat:
        """The whole matrix at displacements (N, 3) in dolfinx's order."""
