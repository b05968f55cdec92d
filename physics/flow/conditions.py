"""What happens at the boundary of a flow: where the velocity is given, and where fluid leaves freely.

At an outflow nothing pulls: nu du/dn - p n = 0, the natural condition of nu (grad u, grad v) - (p, div v), through which Poiseuille
flow leaves undisturbed. Where fluid comes back through it, convection would bring energy in, as much as the flow likes; the term
(u . n)_- u / 2 takes that out and is nothing while fluid leaves (Braack and Mucha, J. Comput. Math. 32, 2014).

Where places meet, a wall at rest counts before one that moves, and that before an inflow. Legend: n nodes whose velocity is given,
F edges, k the velocity's order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.flow.space import OPPOSITE, FlowSpace, table
from physics.mesh.mesh import Mesh
from physics.mesh.sound.rows import rows_in
from physics.scene.flow import FlowScene, Inflow
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

STRAIGHT = 1e-6  # of the length of an inflow: how far its nodes may lie off a line
GAUSS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True)
class Conditions:
    """What is given at the boundary, and what acts inside.

    fixed: (n,) velocity nodes; values: their velocities (n, 2) [m/s] at a time [s]
    open: (F, 2) vertices of the edges through which fluid leaves, the fluid on their left
    source: the acceleration (N, 2) [m/s2] of the fluid at all velocity nodes at a time; None is none
    """

    fixed: Integers
    values: Callable[[float], Floats]
    open: Integers
    source: Callable[[float], Floats] | None = None


def conditions_of(scene: FlowScene, space: FlowSpace) -> Conditions:
    """What a scene says of its boundary. Raises `InputError` where that does not fit its mesh."""
    mesh, nodes = space.mesh, space.velocity
    outer = mesh.boundary[0]
    kind = np.zeros(len(outer), np.int64)  # 0 a wall, -1 open, 1 + i inflow i
    wheres = [(f"outflow[{i}].where", outflow.where, -1) for i, outflow in enumerate(scene.outflow)]
    wheres += [(f"inflow[{i}].where", inflow.where, 1 + i) for i, inflow in enumerate(scene.inflow)]
    for key, where, number in wheres:
        chosen = rows_in(outer, _edges(mesh, where, key))
        if (kind[chosen] != 0).any():
            raise InputError(f"{key} = {where!r}: has edges of another inflow or outflow")
        kind[chosen] = number
    # Later ones overwrite: inflows, walls that move, walls at rest.
    size, given = len(nodes.points), np.zeros(len(nodes.points), bool)
    along = np.zeros((len(scene.inflow), size, 2))
    steady = np.zeros((size, 2))
    for i, inflow in enumerate(scene.inflow):
        edges = outer[kind == 1 + i]
        on = nodes.on_edges(mesh, edges)
        given[on] = True
        along[:, on] = 0.0
        along[i, on] = _profile(inflow, nodes.points[on], edges, mesh, f"inflow[{i}]")
    moving = [_edges(mesh, wall.where, f"wall[{i}].where") for i, wall in enumerate(scene.wall)]
    still = outer[(kind == 0) & ~np.logical_or.reduce([rows_in(outer, edges) for edges in moving] or [np.zeros(len(outer), bool)])]
    for edges, velocity in [*zip(moving, (wall.velocity for wall in scene.wall), strict=True), (still, (0.0, 0.0))]:
        on = nodes.on_edges(mesh, edges)
        given[on], along[:, on], steady[on] = True, 0.0, velocity
    fixed = np.flatnonzero(given)
    along, steady, duration = along[:, fixed], steady[fixed], scene.steps.duration or 1.0
    full = scene.steps.stationary

    def values(t: float) -> Floats:
        found = steady.copy()
        for inflow, profile in zip(scene.inflow, along, strict=True):
            found += (inflow.speed * (1.0 if full else inflow.factor_at(t, duration))) * profile
        return found

    return Conditions(fixed, values, outer[kind == -1])


def _edges(mesh: Mesh, where: str, key: str) -> Integers:
    """(F, 2) the outer edges of a place. Raises `InputError` when it has none."""
    try:
        found = mesh.facets(where)[0]
    except InputError as error:
        raise InputError(f"{key}: {error}") from None
    found = found[rows_in(found, mesh.boundary[0])]
    if not len(found):
        raise InputError(f"{key} = {where!r}: has no edge on the boundary")
    return found


def _profile(inflow: Inflow, points: Floats, edges: Integers, mesh: Mesh, key: str) -> Floats:
    """(n, 2) the direction into the fluid times the profile, at nodes on a straight place."""
    ends = mesh.points[edges][..., :2]
    along = (ends[:, 1] - ends[:, 0]).sum(axis=0)
    length = float(np.hypot(*along))
    if length < 1e-12 * np.ptp(mesh.points, axis=0).max():
        raise InputError(f"{key}.where = {inflow.where!r}: an inflow is a straight piece of the boundary")
    along /= length
    inward = np.array([-along[1], along[0]])  # the fluid is on the left of an outer edge
    s, off = (points - ends[0, 0]) @ along, (points - ends[0, 0]) @ inward
    if np.ptp(off) > STRAIGHT * length or np.ptp(s) > (1 + STRAIGHT) * length:
        raise InputError(f"{key}.where = {inflow.where!r}: an inflow is one straight piece of the boundary")
    return inflow.profile_at(np.clip((s - s.min()) / length, 0, 1))[:, None] * inward


class OpenEdges:
    """Integrals over the edges through which fluid leaves."""

    def __init__(self, space: FlowSpace, edges: Integers) -> None:
        self._order, self._mesh, self._pressure = space.order, space.mesh, space.pressure
        self._edges, self.nodes = edges, space.velocity.along_edges(space.mesh, edges)  # (F, k + 1) nodes in a row
        low = np.sort(edges, axis=1)
        away = np.diff(space.mesh.points[low][..., :2], axis=1)[:, 0]
        self._normal = np.stack([away[:, 1], -away[:, 0]], axis=1) * np.where(edges[:, 0] == low[:, 0], 1, -1)[:, None]  # times length
        self._values = _on_edge(space.order)

    def backflow(self, u: Floats) -> Floats | None:
        """(F, k + 1, 2) the integrals of min(u . n, 0) u / 2 times the functions of `nodes`; None while all fluid leaves."""
        at = u[self.nodes]
        out = np.einsum("fid,fd->fi", at, self._normal)
        if not len(out) or out.min() >= 0:
            return None
        through = np.minimum(np.einsum("gi,fi->fg", self._values, out), 0) * (GAUSS[1] / 4)
        return np.einsum("fg,gi,gj,fjd->fid", through, self._values, self._values, at)

    def penalty(self, share: float) -> tuple[Integers, Integers, Floats]:
        """Blocks (F, k, k) of share / h (p, q) over the edges, with the cell and the local pressure nodes (F, k) of each."""
        values = _on_edge(self._order - 1)
        block = share * np.einsum("g,gi,gj->ij", GAUSS[1] / 2, values, values)
        nodes = self._pressure.along_edges(self._mesh, self._edges)
        owner, _ = owners(self._mesh, self._edges)
        local = (self._pressure.cells[owner][:, :, None] == nodes[:, None, :]).argmax(axis=1)
        return owner, local, np.broadcast_to(block, (len(owner), *block.shape))


def owners(mesh: Mesh, edges: Integers) -> tuple[Integers, Integers]:
    """(F,) the cell of each edge (F, 2) of the boundary, and which of its edges `OPPOSITE` it is."""
    base = int(mesh.cells.max()) + 1
    sides = np.sort(np.concatenate([mesh.cells[:, pair] for pair in OPPOSITE]), axis=1)
    keys, wanted = sides @ [base, 1], np.sort(edges, axis=1) @ [base, 1]
    rank = np.argsort(keys)
    side, owner = np.divmod(rank[np.searchsorted(keys, wanted, sorter=rank)], len(mesh.cells))
    return owner, side


def _on_edge(order: int) -> Floats:
    """(G, order + 1) values of the functions of an edge's nodes in a row, at Gauss's points."""
    x = (GAUSS[0] + 1) / 2
    row = [0, *range(3 + 2 * (order - 1), 3 + 3 * (order - 1)), 1]  # corner, inside of the third edge, corner
    return table(order, np.stack([x, np.zeros_like(x)], axis=1))[0][:, row]
