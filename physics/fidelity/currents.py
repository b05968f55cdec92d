"""The equations of a flow, ready to check velocities and pressures at the stored nodes of its mesh.

Stored nodes are those of quadratic functions on the cells that a shape was computed on, or the vertices of a mesh from a file, where
functions between them are linear. A stored flow stands for such a function; every sum over cells below is exact for it. With rate
the time derivative, v test functions of the same kind that vanish where the velocity is given, phi and q linear ones:

    residual      R(v) = rho (rate + u . grad u + (div u) u / 2, v) + mu (grad u, grad v) - (p, div v), and at an outflow
                  what takes the energy out of fluid that comes back (conditions.py); its norm sup R(v) / |grad v| is
                  sqrt(R . K^-1 R) with K of (grad v, grad v)
    force         R of the functions that are 1 at the nodes of the place, which the walls have to give
    flux          (u, grad phi), for phi that climbs from 0 to 1 across one of BANDS pieces of the way from inflow to outflow:
                  the mean of the flux through all sections in that piece, by the coarea formula
    divergence    root mean square of div u projected on linear q

Legend: S stored nodes, N velocity nodes of the space, V vertices, T frames.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from physics import fem
from physics.flow.conditions import OpenEdges, conditions_of
from physics.flow.space import FlowSpace, Integers, table
from physics.flow.stored import computed_mesh, stored
from physics.mesh.mesh import Mesh
from physics.scene.flow import FlowScene

Floats = NDArray[np.float64]
BANDS = 10


class Currents:
    """The equations of one scene.

    Attributes:
        mesh: stored; given (n,) its nodes whose velocity is given; area [m2]
    """

    def __init__(self, scene: FlowScene, mesh: Mesh | None = None) -> None:
        """Args: mesh: that the scene was computed on, by default the one that its body describes. Raises `InputError`."""
        self.scene, self.density, self.viscosity = scene, scene.fluid.density, scene.fluid.viscosity
        space = self.space = FlowSpace(mesh or computed_mesh(scene), scene.order)
        where = stored(scene, space)
        self.mesh, cells = where.mesh, space.pressure.cells.astype(np.int64) if where.halved else space.mesh.cells
        order = 2 if where.halved else 1
        size, vertices = len(self.mesh.points), len(space.mesh.points)
        self._lift = _lifted(space.velocity.cells, space.order, cells, order, size)  # (N, S)
        self._pressures = _lifted(space.pressure.cells, space.order - 1, cells, order, size)
        straight = _lifted(space.velocity.cells, space.order, space.mesh.cells, 1, vertices)  # (N, V)
        conditions = conditions_of(scene, space)
        self._open = OpenEdges(space, conditions.open)
        there = conditions_of(scene, FlowSpace(space.mesh, 2))  # nodes of order 2 are the stored ones of a shape
        chosen = there.fixed < size
        self.given, self._values, self._chosen = there.fixed[chosen], there.values, chosen
        self._mass, viscosity = space.matrix(space.mass), space.matrix(space.viscosity)
        self._viscosity, self.area = viscosity, float(space.mass.sum())
        self._free = np.setdiff1d(np.arange(size), self.given)
        stiffness = (self._lift.T @ viscosity @ self._lift).tocsc()
        self._norm = scipy.sparse.linalg.splu(stiffness[self._free][:, self._free])
        self._slopes = _lifted(space.pressure.cells, space.order - 1, space.mesh.cells, 1, vertices).T
        self._linear_mass = scipy.sparse.linalg.splu((straight.T @ self._mass @ straight).tocsc())
        self._bands = self._lift.T @ _bands(scene, space, straight, viscosity)  # (S, 2 BANDS)
        self._on = None if scene.force is None else self._place(scene.force.where, cells, where.halved)

    def values(self, time: float) -> Floats:
        """(n, 2) [m/s] the velocities of `given` at a time [s]."""
        return self._values(time)[self._chosen]

    def inflow(self, time: float) -> float:
        """[m2/s] what flows in, by the scene."""
        total, duration = 0.0, self.scene.steps.duration or 1.0
        for inflow in self.scene.inflow:
            ends = self.space.mesh.points[self.space.mesh.facets(inflow.where)[0]]
            length = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())
            total += inflow.mean_speed * length * (1.0 if self.scene.steps.stationary else inflow.factor_at(time, duration))
        return total

    def forces(self, u: Floats, p: Floats, rate: Floats) -> Floats:
        """(S, 2) [N/m] minus R of each stored node's functions, at velocity and rate (S, 2) and pressure (S,)."""
        full = self._lift @ u
        right = self.space.momentum(full, -(self._lift @ rate), (self._pressures @ p) / self.density)
        right -= self.viscosity / self.density * (self._viscosity @ full)
        back = self._open.backflow(full)
        if back is not None:
            np.add.at(right, self._open.nodes, back)
        found: Floats = self.density * (self._lift.T @ right)
        return found

    def residual(self, forces: Floats) -> float:
        """[N/m] the norm of R in its weak sense, of what `forces` gives."""
        inside = forces[self._free]
        return float(np.sqrt(max(0.0, float((inside * self._norm.solve(inside)).sum()))))

    def on_place(self, forces: Floats) -> Floats:
        """(2,) [N/m] drag and lift; not numbers where the scene asks for none."""
        return np.full(2, np.nan) if self._on is None else np.asarray(forces[self._on].sum(axis=0))

    def divergence(self, u: Floats) -> float:
        """[1/s] of a velocity (S, 2)."""
        leak = self._slopes @ self.space.divergence(self._lift @ u)
        return float(np.sqrt(max(0.0, float(leak @ self._linear_mass.solve(leak))) / self.area))

    def energy(self, u: Floats) -> float:
        """[J/m] of a velocity (S, 2)."""
        full = self._lift @ u
        return self.density * float((full * (self._mass @ full)).sum()) / 2

    def fluxes(self, u: Floats) -> Floats:
        """(T, BANDS) [m2/s] of velocities (T, S, 2), from the inflow on; not numbers where nothing flows in."""
        x, y = self._bands[:, :BANDS], self._bands[:, BANDS:]
        return np.asarray(u[..., 0] @ x + u[..., 1] @ y)

    def _place(self, where: str, cells: Integers, halved: bool) -> Integers:
        edges = self.space.mesh.facets(where)[0]
        return self.space.pressure.on_edges(self.space.mesh, edges) if halved else np.unique(edges)


def _lifted(to: NDArray[np.int32], high: int, cells: Integers, low: int, size: int) -> scipy.sparse.csr_matrix:
    """The values of functions of a low order at the nodes of a high one: numbers of nodes for each cell, and how many of the low."""
    values = table(low, fem.triangle(high, 1)[0].points)[0]  # (n, m)
    nodes, first = np.unique(to.ravel(), return_index=True)
    cell, local = np.divmod(first, to.shape[1])
    rows = np.repeat(nodes, values.shape[1])
    found = scipy.sparse.csr_matrix((values[local].ravel(), (rows, cells[cell].ravel())), (len(nodes), size))
    found.data[abs(found.data) < 1e-14] = 0
    found.eliminate_zeros()
    return found


def _bands(scene: FlowScene, space: FlowSpace, straight: scipy.sparse.csr_matrix, viscosity: scipy.sparse.csr_matrix) -> Floats:
    """(N, 2 BANDS) of (u, grad phi) the share of each velocity node's x, then y; phi follows the potential between inflow and outflow."""
    nodes = len(space.velocity.points)
    if not scene.inflow or not scene.outflow:
        return np.full((nodes, 2 * BANDS), np.nan)
    start, end = (np.unique(np.concatenate([space.mesh.facets(part.where)[0].ravel() for part in parts]))
                  for parts in (scene.inflow, scene.outflow))
    potential = np.zeros(straight.shape[1])
    potential[end] = 1.0
    inner = np.setdiff1d(np.arange(len(potential)), np.concatenate([start, end]))
    stiffness = (straight.T @ viscosity @ straight).tocsc()
    potential[inner] = scipy.sparse.linalg.spsolve(stiffness[inner][:, inner], -(stiffness[inner] @ potential))
    found = np.zeros((2, nodes, BANDS))
    for band in range(BANDS):
        phi = (straight @ np.clip(BANDS * potential - band, 0, 1))[space.velocity.cells]  # (C, n)
        share = np.einsum("pi,pcjd,cj->dci", space.values, space.gradients, phi, optimize=True)  # the weight is in the gradients
        for axis in range(2):
            found[axis, :, band] = np.bincount(space.velocity.cells.ravel(), share[axis].ravel(), nodes)
    return np.concatenate(list(found), axis=1)
