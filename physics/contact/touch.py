"""Contact of a body with its obstacles, and in one Newton step: what an obstacle is to the body at the points that are near it.

Legend: N nodes, Q points, q points of a zone near the obstacle, k of them, n nodes behind those.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.contact.conditions import ContactSurface, Surfaces
from physics.contact.obstacles import Rigid, Rigids
from physics.contact.shapes import Round
from physics.linalg.multigrid import Felt
from physics.linalg.native import compiled, pointer
from physics.mesh.mesh import Mesh
from physics.scene import Obstacle
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Contact:
    """Contact between a surface and an obstacle, or several: who is near, what the gaps are, what the forces do."""

    def __init__(self, surface: ContactSurface, obstacle: Rigid | Rigids, rest: Floats, stiffness: float | Floats) -> None:
        """Args: rest (N, 3) rest positions [m]; stiffness k [Pa/m] of a unit area, or that at each point (Q,)."""
        self.surface, self.obstacle, self.rest = surface, obstacle, rest
        self.softness = 1.0 / (stiffness * surface.area)  # (Q,) c_q [m/N]

    def gaps(self, u: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Gaps (Q,) [m] and normals (Q, 3) at displacements (N, 3)."""
        return self.obstacle.gap(self.surface.positions(self.rest + u), centre)

    def forces(self, pressure: Floats, normal: Floats) -> Floats:
        """Nodal forces (N, 3) [N] of point forces (Q,) along normals (Q, 3)."""
        return self.surface.weights.T @ (pressure[:, None] * normal)

    def zone(self, u: Floats, centre: Floats, reach: float) -> Zone:
        """The points whose gap is below a reach [m]."""
        return Zone(self, u, centre, reach)


def contact_of(obstacles: Sequence[Obstacle], mesh: Mesh, held: NDArray[np.bool_], stiffness: Floats | float) -> Contact | None:
    """Contact with the obstacles of a scene; None where there are none.

    Args: held (N,): not in contact; stiffness k [Pa/m] on facets, one or at each node (N,). Raises `InputError` as `ContactSurface` does.
    """
    if not obstacles:
        return None
    rigid, surfaces = [Rigid(obstacle) for obstacle in obstacles], []
    for i, (obstacle, one) in enumerate(zip(obstacles, rigid, strict=True)):
        try:
            surfaces.append(ContactSurface(mesh, obstacle.contact, held, one.width))
        except InputError as error:
            raise InputError(str(error).replace("obstacle:", f"obstacle[{i}]:", 1) if len(rigid) > 1 else str(error)) from None
    surface = surfaces[0] if len(rigid) == 1 else Surfaces(surfaces)
    at_points = surface.weights @ stiffness if isinstance(stiffness, np.ndarray) else stiffness
    of = np.repeat(np.arange(len(rigid)), [len(one.area) for one in surfaces])
    return Contact(surface, rigid[0] if len(rigid) == 1 else Rigids(rigid, of), mesh.points, at_points * surface.hardness)


class Zone:
    """The part of a surface near an obstacle: for as long as `covers` says so, all that contact has to look at.

    points: (q,) of the surface; nodes: (m,) behind them; weights: (q, m) sparse; softness: (q,) [m/N]; obstacle: as they meet it
    made_at, made_with: the displacements (N, 3) and the obstacle's centre (3,), of several (K, 3), that it was made for
    """

    def __init__(self, contact: Contact, u: Floats, centre: Floats, reach: float) -> None:
        self.made_at, self.made_with, self._reach = np.ascontiguousarray(u, float), centre, reach
        self.points = np.flatnonzero(contact.gaps(u, centre)[0] < reach)
        self.obstacle = contact.obstacle.among(self.points)
        rows = contact.surface.weights[self.points]
        self.nodes = np.unique(rows.indices).astype(np.int64)
        self.weights = rows[:, self.nodes].tocsr().astype(float)
        self.weights.sort_indices()
        self.softness = contact.softness[self.points]
        self._rest = contact.rest[self.nodes]
        self._kept = self.weights.indptr.astype(np.int32), self.weights.indices.astype(np.int32), self.weights.data
        self._rows = [pointer(array) for array in self._kept]
        self._there, self._from = [pointer(array) for array in (self.nodes, self._rest)], pointer(self.made_at)
        shape = self.obstacle.shape if isinstance(self.obstacle, Rigid) else None
        self._round = shape if isinstance(shape, Round) else None  # whose distances are a compiled pass
        self._behind: tuple[Integers, Integers, Integers] | None = None

    def covers(self, u: Floats, centre: Floats, near: float) -> bool:
        """True when no point outside of the zone can have a gap below `near` [m]."""
        u = np.ascontiguousarray(u, float)
        way = math.dist(centre, self.made_with) if centre.ndim == 1 else max(map(math.dist, centre, self.made_with))
        return bool(_library().farthest(ctypes.c_int64(len(u)), pointer(u), self._from) + way <= self._reach - near)

    def positions(self, u: Floats) -> Floats:
        """(q, 3) where its points are at displacements (N, 3)."""
        u, found = np.ascontiguousarray(u, float), np.empty((len(self.points), 3))
        _library().positions(ctypes.c_int64(len(found)), *self._rows, *self._there, pointer(u), pointer(found))
        return found

    def gaps(self, u: Floats, centre: Floats) -> tuple[Floats, Floats]:
        """Gaps (q,) [m] and normals (q, 3) at displacements (N, 3)."""
        points = self.positions(u)
        if self._round is None:
            return self.obstacle.gap(points, centre)
        offset, gap, normal, shape = points - centre, np.empty(len(points)), np.empty((len(points), 3)), self._round
        _round().distances(ctypes.c_int64(len(gap)), pointer(offset), pointer(shape.axis), ctypes.c_double(shape.half),
                           ctypes.c_double(shape.radius), pointer(shape.anywhere), pointer(gap), pointer(normal))
        return gap, normal

    def _bends(self, points: Floats, centre: Floats, which: Integers) -> Floats:
        """(k, 2, 3) of `Rigid.bend` for some of its points (k,), which are at (k, 3)."""
        if self._round is None:
            return self.obstacle.among(which).bend(points, centre)
        offset, found, shape = points - centre, np.empty((len(points), 2, 3)), self._round
        _round().bends(ctypes.c_int64(len(found)), pointer(offset), pointer(shape.axis), ctypes.c_double(shape.half),
                       pointer(shape.anywhere), pointer(found))
        return found

    def forces(self, pressure: Floats, normal: Floats) -> Floats:
        """(m, 3) forces [N] on the zone's nodes of point forces (q,) along normals (q, 3)."""
        pressure, normal, found = np.ascontiguousarray(pressure), np.ascontiguousarray(normal), np.zeros((len(self.nodes), 3))
        own = np.arange(len(found))
        _library().forces(ctypes.c_int64(len(pressure)), *self._rows, *map(pointer, (own, pressure, normal, found)))
        return found

    def judge(self, force: Floats, gap: Floats, normal: Floats, pressure: Floats) -> tuple[Floats, float, float]:
        """Forces (N, 3) [N] less those of contact, how far points (q,) are from their conditions and how far inside [m], at most."""
        normal, left, wrong = np.ascontiguousarray(normal), force.copy(), (ctypes.c_double * 2)()
        _library().judge(ctypes.c_int64(len(gap)), *self._rows, self._there[0],
                         *map(pointer, (gap, normal, self.softness, pressure, left)), wrong)
        return left, wrong[0], wrong[1]

    def behind(self, points: Integers) -> tuple[Integers, Integers]:
        """(n,) its nodes that hold some of its points (k,), and their numbers; for the same points once more the same arrays."""
        if self._behind is None or (points is not self._behind[0] and not np.array_equal(points, self._behind[0])):
            nodes = np.unique(self.weights[points].indices).astype(np.int64)
            self._behind = points, nodes, self.nodes[nodes]
        return self._behind[1:]

    def gradient(self, points: Integers, nodes: Integers, normal: Floats) -> Floats:
        """G (k, 3 n): derivative of the gaps of k of its points by the components of n of its nodes that hold all of theirs."""
        return self._spread(points, nodes, normal[points])

    def bend(self, points: Integers, nodes: Integers, pressure: Floats, u: Floats, centre: Floats) -> Floats:
        """B (b, 3 n): forces (k,) on a round obstacle take B^T B from the stiffness of n nodes, for their normals turn."""
        rows = self._bends(self.positions(u)[points], centre, points) * np.sqrt(pressure)[:, None, None]  # (k, 2, 3)
        point, which = rows.any(axis=2).nonzero()
        return self._spread(points[point], nodes, rows[point, which])

    def _spread(self, points: Integers, nodes: Integers, vectors: Floats) -> Floats:
        """(r, 3 n) w_qa v: vectors (r, 3) at points (r,), given to those of n nodes that hold them."""
        found = np.zeros((len(points), 3 * len(nodes)))
        _library().spread(ctypes.c_int64(len(points)), pointer(points), pointer(vectors), *self._rows, ctypes.c_int64(len(self.nodes)),
                          ctypes.c_int64(len(nodes)), pointer(nodes), pointer(found))
        return found


@dataclass
class Touch:
    """Contact at displacements u (N, 3): gaps (q,) [m], normals (q, 3) and forces (q,) [N] at the points of a zone."""

    zone: Zone
    u: Floats
    centre: Floats  # (3,) of the obstacle, of several (K, 3)
    gap: Floats
    normal: Floats
    pressure: Floats

    def rows(self, points: Integers) -> tuple[Integers, Floats, Floats]:
        """Of k points of the zone: n nodes of it behind them, G (k, 3 n) their gaps' gradient, and B (b, 3 n) of `Zone.bend`."""
        nodes, pressed = self.zone.behind(points)[0], points[self.pressure[points] > 0]
        return (nodes, self.zone.gradient(points, nodes, self.normal),
                self.zone.bend(pressed, nodes, self.pressure[pressed], self.u, self.centre))

    def felt(self, points: Integers) -> Felt:
        """Contact at some points of the zone, as the linear algebra takes it."""
        _, gradient, bend = self.rows(points)
        found = Felt(self.zone.behind(points)[1], gradient, bend, self.gap[points], self.zone.softness[points], self.pressure[points])
        obstacle = self.zone.obstacle.among(points)
        if len(obstacle.each) > 1:  # which may press against each other
            found.reaction = float(np.linalg.norm(obstacle.sums(found.pressed, self.normal[points]), axis=1).sum())
        return found


class Condensed:
    """A body of stiffness K' = K - B^T B as k points of contact feel it: B is what a round obstacle takes from it.

    By Woodbury's formula, with the compliance K^-1 of the kept factor, T = 1 - B K^-1 B^T and X = B K^-1 G^T:

    matrix: (k, k) G K'^-1 G^T + diag(c) = G K^-1 G^T + X^T T^-1 X + diag(c)
    across: (b, k) X
    negative: eigenvalues of K' below zero: those of K and those of T
    """

    def __init__(self, matrix: Floats, across: Floats, left: Floats, negative: int) -> None:
        self.across, self.negative = across, negative
        if np.trace(left) < len(left) - 1:  # else no eigenvalue of B K^-1 B^T can reach 1
            self.negative += int((np.linalg.eigvalsh(left) < 0).sum())
        self._inverse = np.linalg.inv(left) if len(left) else left
        self.matrix = matrix + across.T @ self._inverse @ across

    @classmethod
    def of(cls, felt: Felt, compliance: Floats, negative: int) -> Condensed:
        """From the compliance (3 n, 3 n) of the nodes that contact is felt at, and the eigenvalues of K below zero."""
        k, b, compliance = len(felt.gap), len(felt.bend), np.ascontiguousarray(compliance)
        both = np.empty((k + b, k + b))  # [G; B] K^-1 [G; B]^T, and c on the diagonal of the points
        _library().condense(ctypes.c_int64(k), ctypes.c_int64(b), ctypes.c_int64(len(compliance)),
                            *map(pointer, (felt.gradient, felt.bend, compliance, felt.softness, both)))
        left = -both[k:, k:]
        left.flat[::b + 1] += 1.0
        return cls(both[:k, :k], both[k:, :k], left, negative)

    def turn(self, rows: Floats) -> Floats:
        """T^-1 times (b,)."""
        return self._inverse @ rows


@cache
def _library() -> ctypes.CDLL:
    library = compiled((Path(__file__).parent / "loops.cpp").read_text(), rounded=True)
    library.farthest.restype = ctypes.c_double
    return library


@cache
def _round() -> ctypes.CDLL:
    return compiled((Path(__file__).parent / "round.cpp").read_text(), rounded=True)
