"""Frictionless contact of a body's surface with a rigid obstacle.

Contact is felt at points of the surface, x_q = sum_a w_qa x_a over the nodes of a facet, each standing for an area A_q
of the rest surface. Gap g_q (obstacles.py) and contact force p_q >= 0 along the normal n_q obey

    g_q + c_q p_q >= 0,   p_q >= 0,   p_q (g_q + c_q p_q) = 0,   c_q = 1 / (k A_q)

which for k -> infinity are the exact (Signorini) conditions. k is chosen so large that the penetration c_q p_q stays
far below the size of a cell, and so small that forces at neighbouring points remain unique. On a smooth surface it is softer: an
obstacle then lies on some rows of points at a time, and goes from one to the next without a step in its force.

With a stiffness K, internal forces f and outer ones b, one Newton step is a linear complementarity problem in p
alone: its matrix is the compliance G K^-1 G^T + diag(c) of the points that are near the obstacle (G holds w_qa n_q).
It is solved exactly by a primal-dual active set (Hintermueller, Ito, Kunisch, SIAM J. Optim. 13, 2003), so touching
and lifting cost no Newton steps and the factor of K never has to know of contact.

Legend: N nodes, Q points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse
from numpy.typing import NDArray
from scipy.linalg import lapack

from physics.contact.points import merged, points_of
from physics.contact.rounded import rounded
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh, unique_edges
from physics.schema import InputError

Floats = NDArray[np.float64]

FINEST = 8  # parts of an edge
CONTACT_STIFFNESS = 2e4  # k in units of Young's modulus over the size of a cell
SMOOTH = 1e-3  # stiffness of contact with a smooth surface over that
BLUNT = 20  # longest edges that an obstacle is wide which lies on many points at a time anyhow


def cell_size(mesh: Mesh) -> float:
    """The median distance between neighbours along the edges of the cells [m]: of second order half an edge."""
    cell = CELLS[mesh.cell]
    edges = unique_edges(mesh.cells[:, :cell.corners], cell.first) if cell.middles else mesh.edges
    return float(np.median(np.linalg.norm(np.diff(mesh.points[edges], axis=1), axis=2))) / (2 if cell.middles else 1)


class ContactSurface:
    """The points of a body's surface where contact is felt.

    Attributes:
        weights: (Q, N) sparse interpolation from nodes to points
        area: (Q,) [m2] of the rest surface
        hardness: (Q,) k over that of CONTACT_STIFFNESS
    """

    def __init__(self, mesh: Mesh, kind: str, held: NDArray[np.bool_], width: float = np.inf) -> None:
        """Args: kind "facets", "smooth" or "nodes"; held (N,): not in contact; width: smallest of the obstacle [m].

        A quadrilateral has nine points, a triangle six and the side of a plane cell three, or, where the longest facet is longer than
        the obstacle is wide, so many more that two points are nowhere further apart along an edge than half of the width. Facets of
        second order have them on each of the four parts between their nodes, sides of plane cells on both halves. A smooth surface
        (rounded.py) has them twice as dense, unless the obstacle is very wide.

        Raises:
            InputError: the obstacle is so thin that it could pass between the points
        """
        corners = [facets[:, :CELLS[mesh.kind_of(facets)].corners] for facets in mesh.boundary if len(facets)]
        longest = max(float(np.linalg.norm(mesh.points[facets] - mesh.points[np.roll(facets, 1, axis=1)], axis=2).max())
                      for facets in corners)
        divisions = int(np.ceil(longest / width * (1 - 1e-9))) or 1
        if kind == "nodes" and divisions > 1:
            raise InputError(f"obstacle: {width:.3g} m wide, it could pass between nodes {longest:.3g} m apart; give smaller cells, or "
                             "leave out contact = \"nodes\"")
        if divisions > FINEST:
            raise InputError(f"obstacle: {width:.3g} m wide, it is smaller than 1/{FINEST} of a cell's edge of {longest:.3g} m; "
                             "give smaller cells")
        weights, area = _felt(mesh, kind, divisions * (2 if kind == "smooth" and width < BLUNT * longest else 1))
        free = (area > 0) & ~((weights @ held.astype(float)) > 1 - 1e-9)
        self.weights, self.area = weights[free], area[free]
        self.hardness = np.full(len(self.area), SMOOTH if kind == "smooth" else 1.0)

    @property
    def smooth(self) -> bool:
        """Whether all of it is."""
        return bool((self.hardness < 1).all())

    def positions(self, x: Floats) -> Floats:
        """(Q, 3) positions of the points for nodes at (N, 3)."""
        return self.weights @ x


def _felt(mesh: Mesh, kind: str, divisions: int) -> tuple[scipy.sparse.csr_matrix, Floats]:
    """Weights (Q, N) and areas (Q,) of all points of a surface."""
    finer = divisions * (2 if CELLS[mesh.cell].middles else 1)
    if kind == "smooth":
        surface = rounded(mesh)
        weights, area = merged(*points_of(surface.facets, surface.weights @ mesh.points, mesh.thickness, finer, even=True))
        return (weights @ surface.weights).tocsr(), area
    facets = [(mesh.kind_of(facets), facets) for facets in mesh.boundary]
    if kind == "facets":
        return merged(*points_of(facets, mesh.points, mesh.thickness, finer))
    weights, area = points_of(facets, mesh.points, mesh.thickness, divisions)
    return scipy.sparse.identity(len(mesh.points), format="csr"), weights.T @ area


class Surfaces(ContactSurface):
    """The points of several surfaces, one after the other."""

    def __init__(self, each: Sequence[ContactSurface]) -> None:
        self.weights = scipy.sparse.vstack([surface.weights for surface in each], format="csr")
        self.area, self.hardness = (np.concatenate([getattr(surface, name) for surface in each]) for name in ("area", "hardness"))


def solve_complementarity(matrix: Floats, gap: Floats, guess: NDArray[np.bool_], *, definite: bool = True) -> Floats:
    """p >= 0 with w = gap + matrix p >= 0 and p . w = 0, for a symmetric matrix (Q, Q).

    Starts from a guess (Q,) of the points in contact. Where the active set of a positive definite matrix goes round in
    circles, the equivalent least-squares problem with p >= 0 is solved instead, which always ends.

    Raises:
        np.linalg.LinAlgError: the matrix is not what it is said to be, or, where it is not definite, no set was found
    """
    active = guess.copy()
    for _ in range(50):
        p = np.zeros(len(gap))
        if active.any():
            index = np.flatnonzero(active)
            part = matrix[index[:, None], index]
            if definite:
                _, solved, failed = lapack.dposv(part, -gap[index][:, None])
                if failed:
                    raise np.linalg.LinAlgError("the matrix is not positive definite")
                p[index] = solved[:, 0]
            else:
                p[index] = scipy.linalg.solve(part, -gap[index], assume_a="sym", check_finite=False)
        w = gap + matrix @ p
        following = np.where(active, p > 0, w < 0)
        if (following == active).all():
            return p
        active = following
    if not definite:
        raise np.linalg.LinAlgError("the points in contact could not be found")
    lower = np.linalg.cholesky(matrix)
    return scipy.optimize.nnls(lower.T, -scipy.linalg.solve_triangular(lower, gap, lower=True))[0]
