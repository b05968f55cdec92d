"""The force of a flow on a part of its boundary, and the difference of pressure between two points.

With the test function that is 1 in a direction at the nodes of the place and 0 at all others, the discrete momentum equation, its
own time derivative and convection in it, leaves the force: what the wall must give so that the equation holds there too. It
converges twice as fast as the integral of the stress over the place (John and Matthies, Int. J. Numer. Methods Fluids 37, 2001).

At an end of the place that function also lives on the next edges of the boundary, and what the fluid bears there is not of the place.
An outflow bears nothing but what keeps fluid from bringing energy back in, which is known (conditions.py). On inflows and other walls
it is the integral of (nu du/dn - p n) times the function, by Gauss's points: exact for velocities and pressures that the space holds,
otherwise an edge's length times an error of the stress, which at a corner that juts into the fluid has a peak and is least sure. A
place that is closed in itself, such as a hole, has none of this.

Forces are of the fluid on the place, for each metre across the plane. Legend: N velocity nodes, M pressure nodes, F edges next to the
place, n and m nodes of a cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.flow.conditions import GAUSS, OpenEdges, owners
from physics.flow.space import OPPOSITE, FlowSpace, geometry_of, table
from physics.mesh.mesh import Mesh
from physics.mesh.sound.rows import rows_in
from physics.scene.flow import FlowScene, Force
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
OUTWARD = np.array([[1.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])  # of the edges OPPOSITE of the reference triangle, as long as they are


@dataclass(frozen=True)
class Probe:
    """One pressure in a cell."""

    nodes: NDArray[np.int64]
    values: Floats


@dataclass(frozen=True)
class Beside:
    """What edges next to a place bear with the functions of the place."""

    velocities: Integers  # (F, n)
    pressures: Integers  # (F, m)
    slope: Floats  # (F, n) the integrals of dN/dn
    push: Floats  # (F, m, 2) the integrals of q n

    def bears(self, u: Floats, p: Floats, nu: float) -> Floats:
        """(2,) [m3/s2] the integral of nu du/dn - p n."""
        along = np.einsum("fi,fid->d", self.slope, u[self.velocities])
        found: Floats = nu * along - np.einsum("fid,fi->d", self.push, p[self.pressures])
        return found


class Forces:
    """What is measured on a place.

    Attributes:
        scale: [N/m] by which a force is its coefficient; None where there is none
    """

    def __init__(self, scene: FlowScene, force: Force, space: FlowSpace, leaves: Integers) -> None:
        """Args: leaves (F, 2) the edges through which fluid leaves, as `Conditions.open`."""
        mesh, nodes = space.mesh, space.velocity
        try:
            edges = mesh.facets(force.where)[0]
        except InputError as error:
            raise InputError(f"force.where: {error}") from None
        if not len(edges):
            raise InputError(f"force.where = {force.where!r}: has no edge")
        self._on = nodes.on_edges(mesh, edges)
        one = np.zeros(len(nodes.points))
        one[self._on] = 1.0
        self._viscosity = space.matrix(space.viscosity) @ one
        self._open = OpenEdges(space, leaves)
        self._open_on = one[self._open.nodes]
        outer = mesh.boundary[0]
        others = outer[~rows_in(outer, np.concatenate([edges, leaves]))]
        others = others[(one[others] > 0).any(axis=1)]
        self._beside = _beside(space, others, one) if len(others) else None
        self.density, self.nu = scene.fluid.density, scene.fluid.viscosity / scene.fluid.density
        known = force.length is not None and force.speed is not None
        self.scale = 0.5 * self.density * force.speed**2 * force.length if known else None  # type: ignore[operator]
        self._space = space
        self._probes = [] if force.points is None else [_probe(mesh, space, np.array(point), "force.points") for point in force.points]

    def force(self, u: Floats, p: Floats, rate: Floats) -> Floats:
        """(2,) [N/m] at a velocity (N, 2), a pressure (M,) over the density, and a rate of change of the velocity (N, 2)."""
        right = self._space.momentum(u, -rate, p)
        found: Floats = self.density * (right[self._on].sum(axis=0) - self.nu * (self._viscosity @ u))
        back = self._open.backflow(u) if self._open_on.any() else None
        if back is not None:
            found += self.density * np.einsum("fi,fid->d", self._open_on, back)
        if self._beside is not None:
            found += self.density * self._beside.bears(u, p, self.nu)
        return found

    def difference(self, p: Floats) -> float | None:
        """[Pa] of the pressure (M,) over the density at the first point less that at the second; None without points."""
        if not self._probes:
            return None
        first, second = (float(p[probe.nodes] @ probe.values) for probe in self._probes)
        return self.density * (first - second)


def _beside(space: FlowSpace, edges: Integers, one: Floats) -> Beside:
    """Of some edges (F, 2) of the boundary, with the function that has values (N,) at the velocity nodes."""
    owner, side = owners(space.mesh, edges)
    first, last = CORNERS[np.array(OPPOSITE)].transpose(1, 0, 2)
    share = (GAUSS[0][:, None] + 1) / 2
    points = np.stack([a + share * (b - a) for a, b in zip(first, last, strict=True)])  # (3, G, 2)
    shape, velocity, pressure = ([table(order, at) for at in points] for order in (2, space.order, space.order - 1))
    cells, geometry = space.velocity.cells[owner].astype(np.int64), geometry_of(space.mesh)[owner]
    slope, push = [], []
    for f, e in enumerate(side):
        J = np.einsum("pgr,gd->pdr", shape[e][1], geometry[f])
        normal = np.einsum("p,prd,r->pd", np.linalg.det(J), np.linalg.inv(J), OUTWARD[e])  # as long as the edge
        normal *= (GAUSS[1] / 2 * (velocity[e][0] @ one[cells[f]]))[:, None]
        slope.append(np.einsum("pir,prd,pd->i", velocity[e][1], np.linalg.inv(J), normal))
        push.append(np.einsum("pi,pd->id", pressure[e][0], normal))
    return Beside(cells, space.pressure.cells[owner].astype(np.int64), np.array(slope), np.array(push))


def _probe(mesh: Mesh, space: FlowSpace, point: Floats, key: str) -> Probe:
    """The pressure at a point: that of the nearest node, or of the cell it lies in. Raises `InputError` outside of the mesh."""
    away = np.hypot(*(space.pressure.points - point).T)
    size = float(np.ptp(mesh.points, axis=0).max())
    nearest = int(np.argmin(away))
    if away[nearest] < 1e-9 * size:
        return Probe(np.array([nearest]), np.ones(1))
    geometry = geometry_of(mesh)
    a, b, c = geometry[:, 0], geometry[:, 1], geometry[:, 2]
    local = np.linalg.solve(np.stack([b - a, c - a], axis=2), (point - a)[:, :, None])[:, :, 0]
    inside = np.minimum(local.min(axis=1), 1 - local.sum(axis=1))
    for cell in np.argsort(-inside)[:4]:
        at = local[cell].copy()
        for _ in range(20):  # Newton on the quadratic map
            values, slopes = table(2, at[None])
            miss = values[0] @ geometry[cell] - point
            at -= np.linalg.solve(np.einsum("gr,gd->dr", slopes[0], geometry[cell]), miss)
        if min(at.min(), 1 - at.sum()) > -1e-9 and np.hypot(*miss) < 1e-9 * size:
            return Probe(space.pressure.cells[cell].astype(np.int64), table(space.order - 1, at[None])[0][0])
    raise InputError(f"{key}: ({point[0]:g}, {point[1]:g}) m is not inside of the fluid")
