"""Laplacian modes of a domain: -div grad phi = lambda phi, phi = 0 on part of the boundary, d phi / dn = 0 on the rest.

In weak form, integral of grad phi . grad v = lambda integral of phi v, that is K phi = lambda M phi, with first- or
second-order elements. lambda in [1/m2]; phi has unit mean square times volume, integral of phi^2 = 1. They know the shape of
a domain and nothing of a material: for fluids, whose motion has no elastic modes, they are what segments can be cut by.
A piece of the domain without a held boundary has a constant mode at zero. For sign and choice see modes.py.

Legend: N nodes, m modes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray

from physics import fem
from physics.linalg.eigen.lowest import lowest_pairs
from physics.linalg.eigen.pairs import Problem, clusters
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh, Parts, closure, pieces
from physics.mesh.sound.rows import rows_in
from physics.modes.elastic import remarks
from physics.scene import Body
from physics.schema import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class LaplacianModes:
    """The lowest Laplacian modes of a domain, in rising order."""

    mesh: Mesh
    eigenvalues: Floats  # (m,) [1/m2]
    shapes: Floats  # (m, N) at the nodes of the mesh
    residuals: Floats  # (m,) |K phi - lambda M phi| / |lambda M phi|, see eigen/pairs.py for zeros
    dirichlet: tuple[str, ...]  # where phi = 0
    dofs: int
    constant: int  # modes at zero among these
    constant_expected: int  # pieces of the domain without a held node
    cells: str
    solver: str
    remarks: tuple[str, ...]
    seconds: float

    @property
    def clusters(self) -> tuple[range, ...]:
        """The modes that belong together: constant ones, and those whose eigenvalues lie within 2 % of each other."""
        return clusters(self.eigenvalues, self.constant)

    @property
    def report(self) -> dict[str, Any]:
        """What Laplacian modes have and elastic ones do not, as plain values."""
        return {"eigenvalues": self.eigenvalues.tolist(), "dirichlet": list(self.dirichlet), "constant_modes": self.constant,
                "constant_modes_expected": self.constant_expected}

    @property
    def pictured(self) -> Floats:
        """(m, N) the shapes with their largest value 1."""
        return self.shapes / abs(self.shapes).max(axis=1, keepdims=True)


def laplacian_modes(body: Body, *, count: int = 10, dirichlet: Sequence[str] | None = None, mesh: Mesh | None = None,
                    spread: bool = False, method: str | None = None) -> LaplacianModes:
    """The lowest Laplacian modes of a body.

    Args:
        dirichlet: the places where phi = 0, none in an empty list; None is the whole boundary but a place named outlet
        mesh, spread, method: as for `elastic_modes`

    Raises:
        InputError: no such place, or more modes are asked for than there are free values
        RuntimeError: fewer pairs were found than asked for
    """
    started = time.perf_counter()
    mesh = mesh or build_mesh(body)
    space = fem.Space(mesh, order=body.order, components=1, spread=spread)
    u, v = ufl.TrialFunction(space.V), ufl.TestFunction(space.V)
    dx, dm = (ufl.dx(metadata={"quadrature_degree": degree}) for degree in space.degrees)
    stiffness, mass = fem.matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * dx), fem.matrix(ufl.inner(u, v) * dm)

    where, entities = _held(mesh, dirichlet)
    free = np.ones(space.owned, bool)
    nodes = np.zeros(len(mesh.points), bool)
    for part in entities:
        free[space.within(part)[:space.owned]] = False
        nodes[part[1]] = True
    dofs = space.comm.allreduce(int(free.sum()))
    if count > dofs:
        none = "; every node is where they are zero: --dirichlet names other places, or none" if not dofs else ""
        raise InputError(f"{count} modes asked for, the domain has {dofs} free values{none}")
    problem = Problem(stiffness=stiffness, mass=mass, free=free, zeros=sum(not nodes[part].any() for part in pieces(mesh)),
                      scale=float((np.pi / np.ptp(mesh.points, axis=0).max()) ** 2), dimension=mesh.dimension,
                      near_null=np.ones((1, space.owned)))
    pairs = lowest_pairs(problem, count, method=method)
    for matrix in (stiffness, mass):  # dolfinx hands out matrices that nobody else destroys
        matrix.destroy()
    shapes = np.stack([space.gather(vector)[:, 0] for vector in pairs.vectors])
    sign = np.where(np.take_along_axis(shapes, abs(shapes).argmax(axis=1)[:, None], axis=1) < 0, -1.0, 1.0)
    return LaplacianModes(mesh=mesh, eigenvalues=pairs.values, shapes=shapes * sign, residuals=pairs.residuals, dirichlet=where,
                          dofs=dofs, constant=pairs.zeros, constant_expected=problem.zeros,
                          cells=f"{CELLS[mesh.cell].plural} of order {body.order}", solver=pairs.solver,
                          remarks=remarks(pairs, problem, mesh), seconds=time.perf_counter() - started)


def _held(mesh: Mesh, dirichlet: Sequence[str] | None) -> tuple[tuple[str, ...], list[dict[int, NDArray[np.int64]]]]:
    """Where phi = 0, in words and as vertices, edges and faces of the mesh."""
    if dirichlet is not None:
        return tuple(dirichlet), [mesh.entities(name) for name in dirichlet]
    open_ends = [name for name in mesh.places if name.lower() == "outlet"]
    outer: Parts = []
    for facets in mesh.boundary:
        for name in open_ends:
            known = mesh.entities(name).get(facets.shape[1], facets[:0])
            facets = facets[~rows_in(facets, known)]
        outer.append((mesh.kind_of(facets), facets))
    return ("the whole boundary" + "".join(f" but {name}" for name in open_ends),), [closure(outer)]
