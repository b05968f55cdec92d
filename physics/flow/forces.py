"""The force of a flow on a part of its boundary, and the difference of pressure between two points.

With the test function that is 1 in a direction at the nodes of the place and 0 at all others, the discrete momentum equation, its
own time derivative and convection in it, leaves the force: what the wall must give so that the equation holds there too. It
converges twice as fast as the integral of the stress over the place (John and Matthies, Int. J. Numer. Methods Fluids 37, 2001).

Forces are of the fluid on the place, for each metre across the plane. Legend: N velocity nodes, M pressure nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.flow.space import FlowSpace, geometry_of, table
from physics.mesh.mesh import Mesh
from physics.scene.flow import FlowScene, Force
from physics.schema import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Probe:
    """One pressure in a cell."""

    nodes: NDArray[np.int64]
    values: Floats


class Forces:
    """What is measured on a place.

    Attributes:
        scale: [N/m] by which a force is its coefficient; None where there is none
    """

    def __init__(self, scene: FlowScene, force: Force, space: FlowSpace) -> None:
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
        self._mass, self._viscosity = (space.matrix(blocks) @ one for blocks in (space.mass, space.viscosity))
        self.density, self.nu = scene.fluid.density, scene.fluid.viscosity / scene.fluid.density
        known = force.length is not None and force.speed is not None
        self.scale = 0.5 * self.density * force.speed**2 * force.length if known else None  # type: ignore[operator]
        self._space = space
        self._probes = [] if force.points is None else [_probe(mesh, space, np.array(point), "force.points") for point in force.points]

    def force(self, u: Floats, p: Floats, rate: Floats) -> Floats:
        """(2,) [N/m] at a velocity (N, 2), a pressure (M,) over the density, and a rate of change of the velocity (N, 2)."""
        right = self._space.momentum(u, -rate, p)
        found: Floats = self.density * (right[self._on].sum(axis=0) - self.nu * (self._viscosity @ u))
        return found

    def difference(self, p: Floats) -> float | None:
        """[Pa] of the pressure (M,) over the density at the first point less that at the second; None without points."""
        if not self._probes:
            return None
        first, second = (float(p[probe.nodes] @ probe.values) for probe in self._probes)
        return self.density * (first - second)


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
