"""Pressure p [Pa] on faces of a body, along their normal: dead, on the rest facets, or following the facets as they move.

With x the nodes of a facet, N_a its shape functions and t_k = sum_b N_b,k x_b its tangents (of the side of a plane body t_1 = h e_z,
h the thickness), the nodal forces on the body are

    f_a = -p sum_g w_g N_a t_0 x t_1        over the Gauss points g, exact for plane and for warped facets

p > 0 pushes into the body. At rest positions that is a dead load. One that follows its face takes the deformed positions, and gives
way or resists as the face turns and grows: to the tangent stiffness it adds -df/dx,

    k_ab = p sum_g w_g N_a (N_b,1 [t_0] - N_b,0 [t_1])        [t] v = t x v

of which the symmetric part is taken. Over a closed face, and one whose rim is held, that is all of it, for then the pressure has a
potential, p times the volume (Schweizerhof and Ramm, Computers & Structures 18, 1984, 1099); else the rest is made up for by further
Newton steps, and by halving the step where these do not converge.

Legend: N nodes, C cells of n nodes, F facets of k nodes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.body.elasticity import Elasticity
from physics.body.schedule import share
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.scene import Load, Materials

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Gauss points of a facet by its kind: weights (g,), shape functions (g, k), and their derivatives (g, 2, k).
_SIGN = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
_AT = _SIGN[:, None] * _SIGN[None] / np.sqrt(3)  # (k, g, 2)
_SECOND = [(cell, cell.shapes(cell.points)) for cell in (CELLS["line3"], CELLS["triangle6"], CELLS["quadrilateral9"])]
POINTS = {
    "line": (np.ones(1), np.full((1, 2), 1 / 2), np.array([[[-1.0, 1.0], [0.0, 0.0]]])),
    "triangle": (np.array([0.5]), np.full((1, 3), 1 / 3), np.array([[[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]])),
    "quadrilateral": (np.ones(4), np.prod(1 + _AT, axis=2).T / 4, (_SIGN[:, None] * (1 + _AT)[:, :, ::-1] / 4).transpose(1, 2, 0)),
    **{cell.name: (cell.weights, values, slopes[..., :2].swapaxes(1, 2)) for cell, (values, slopes) in _SECOND},
}


def tangents(mesh: Mesh, points: Floats, facets: Integers) -> Floats:
    """(F, g, 2, 3) of facets (F, k) of a mesh at their Gauss points, its nodes at points (N, 3)."""
    tangent: Floats = np.einsum("gka,fai->fgki", POINTS[mesh.kind_of(facets)][2], points[facets])
    if mesh.dimension == 2:
        tangent[:, :, 1, 2] = mesh.thickness
    return tangent


def pressure_force(mesh: Mesh, points: Floats, facets: list[Integers], pressure: float) -> Floats:
    """(N, 3) nodal forces [N] of a pressure [Pa] on facets of a mesh, its nodes at points (N, 3), outward by the right-hand rule."""
    force = np.zeros_like(points)
    for corners in facets:
        weight, shape, _ = POINTS[mesh.kind_of(corners)]
        tangent = tangents(mesh, points, corners)
        normal = np.cross(tangent[:, :, 0], tangent[:, :, 1])  # (F, g, 3)
        np.add.at(force, corners, -pressure * np.einsum("g,ga,fgi->fai", weight, shape, normal))
    return force


def pressure_stiffness(mesh: Mesh, points: Floats, corners: Integers, pressure: float) -> Floats:
    """(F, 3 k, 3 k) the symmetric part of -df/dx of some facets (F, k) [N/m]."""
    weight, shape, slope = POINTS[mesh.kind_of(corners)]
    tangent = tangents(mesh, points, corners)
    cross = np.einsum("ijk,fgmj->fgmik", _LEVI_CIVITA, tangent)  # [t_m]: ([t] v)_i = e_ijk t_j v_k
    turn = np.einsum("gb,fgik->fgbik", slope[:, 1], cross[:, :, 0]) - np.einsum("gb,fgik->fgbik", slope[:, 0], cross[:, :, 1])
    whole = pressure * np.einsum("g,ga,fgbik->faibk", weight, shape, turn).reshape(len(corners), 3 * corners.shape[1], -1)
    return (whole + whole.transpose(0, 2, 1)) / 2


_LEVI_CIVITA = np.zeros((3, 3, 3))
_LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]], _LEVI_CIVITA[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = 1.0, -1.0


class Pressed(Elasticity):
    """A body with pressures that follow its faces: its force and stiffness are those of the body less those of the pressures.

    fraction: of the steps, at which the pressures act; factored: that of the stiffness that was asked for last
    """

    def __init__(self, mesh: Mesh, material: Materials, fixed: NDArray[np.bool_], element: str,
                 faces: list[tuple[list[Integers], Load]]) -> None:
        """Args: faces: facets, and the load whose pressure they are under."""
        super().__init__(mesh, material, fixed, element)
        self.fraction = self.factored = 0.0
        self._faces = [(facets, load) for group, load in faces for facets in group if len(facets)]
        self._middle = [mesh.points[np.unique(facets)].mean(axis=0) for facets, _ in self._faces]
        self._places = [_places(mesh, facets) for facets, _ in self._faces]

    def force(self, u: Floats) -> Floats:
        return super().force(u) - self._pressed(u)

    def _pressed(self, u: Floats) -> Floats:
        at = self.mesh.points + u
        forces = (pressure_force(self.mesh, at, [facets], self._pressure(load)) for facets, load in self._faces)
        return sum(forces, np.zeros_like(at))

    def _pressure(self, load: Load) -> float:
        """[Pa] at the fraction of the steps."""
        assert load.pressure is not None
        return share(load, self.fraction) * load.pressure

    def add_stiffness(self, u: Floats, slot: NDArray[np.int32], out: NDArray[Any], *, scale: float = 1.0) -> None:
        super().add_stiffness(u, slot, out, scale=scale)
        self.factored = self.fraction
        for (facets, load), (cell, entry, upper) in zip(self._faces, self._places, strict=True):
            added = pressure_stiffness(self.mesh, self.mesh.points + u, facets, scale * self._pressure(load))
            np.add.at(out, slot[cell, entry], added[upper])

    def work(self, u: Floats) -> float:
        """[J] of the pressures up to displacements (N, 3): -p times the change of volume, each seen from the middle of its face."""
        work = 0.0
        for (facets, load), middle in zip(self._faces, self._middle, strict=True):
            for sign, at in ((1, self.mesh.points + u), (-1, self.mesh.points)):
                force = pressure_force(self.mesh, at, [facets], self._pressure(load))
                work += sign * float((force * (at - middle)).sum()) / self.mesh.dimension
        return work


def _places(mesh: Mesh, facets: Integers) -> tuple[Integers, Integers, NDArray[np.bool_]]:
    """Where the stiffness of outer facets (F, k) goes: cell and entry (as `Stiffness.pairs`) of what is kept of (F, 3 k, 3 k)."""
    among = np.concatenate([mesh.cells[:, list(local)] for local in CELLS[mesh.cell].facets if len(local) == facets.shape[1]])
    owner = np.tile(np.arange(len(mesh.cells)), len(among) // len(mesh.cells))
    rows = {tuple(row): cell for row, cell in zip(np.sort(among, axis=1).tolist(), owner.tolist(), strict=True)}
    cell = np.array([rows[tuple(row)] for row in np.sort(facets, axis=1).tolist()])
    corner = (mesh.cells[cell][:, :, None] == facets[:, None, :]).argmax(axis=1)  # (F, k) which of its cell's nodes
    unknown = (3 * corner[:, :, None] + np.arange(3)).reshape(len(facets), -1)
    row, column = np.broadcast_arrays(unknown[:, :, None], unknown[:, None, :])
    upper, d = row <= column, 3 * mesh.cells.shape[1]
    entry = row * d - row * (row + 1) // 2 + column
    return np.broadcast_to(cell[:, None, None], row.shape)[upper], entry[upper], upper
