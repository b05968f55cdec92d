"""The mesh that the frames of a flow are stored on, and how velocity and pressure get there.

In a shape the flow of order 3 is computed on cells twice as large as the scene's `cell_size`, and stored on the four into which each of
them is cut, their corners on the curved sides: the pressure, of order 2, has its nodes just there, and the velocity is read off its
cubic. On a mesh from a file, or with order 2, frames are stored on the mesh's own nodes. Legend: V vertices of the mesh that is
computed on, S nodes stored.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physics.flow.space import FlowSpace
from physics.mesh.build import build_mesh
from physics.mesh.files import read_mesh
from physics.mesh.formats.drawing import Cut
from physics.mesh.mesh import Integers, Mesh
from physics.scene.flow import FlowScene
from physics.schema import InputError

Floats = NDArray[np.float64]

MIDDLE = np.array([-1, 9, 9, -1]) / 16  # of a cubic at the middle of its four nodes
QUARTERS = ((0, 5, 4), (1, 3, 5), (2, 4, 3), (3, 4, 5))  # of a triangle's six nodes


def computed_mesh(scene: FlowScene) -> Mesh:
    """The mesh that a scene is computed on. Raises `InputError` when it is not one of triangles."""
    body = scene.body
    if scene.order == 3 and body.shape == "channel":
        assert body.cell_size is not None and body.hole_cell_size is not None
        body = replace(body, cell_size=2 * body.cell_size, hole_cell_size=2 * body.hole_cell_size)
    if scene.order == 3 and body.shape == "plate":
        body = replace(body, cells=tuple((n + 1) // 2 for n in body.divisions), cell_size=None)
    if body.shape == "file":
        mesh = read_mesh(str(body.path), order=2, scale=body.scale, cut=Cut(body.cell_size))
    else:
        mesh = build_mesh(replace(body, order=1))
    if mesh.cell != "triangle":
        raise InputError(f"body.path: a mesh of cells of the kind {mesh.cell}; a flow is in a plane domain of triangles")
    return mesh


@dataclass(frozen=True)
class Stored:
    """The stored mesh."""

    mesh: Mesh
    space: FlowSpace
    halved: bool

    def velocity(self, u: Floats) -> NDArray[np.float32]:
        """(S, 3) [m/s] from (N, 2)."""
        found = u[:len(self.space.mesh.points)]
        if self.halved:
            edges = self.space.velocity.along_edges(self.space.mesh, self.space.mesh.edges)
            found = np.concatenate([found, np.einsum("eid,i->ed", u[edges], MIDDLE)])
        return np.pad(found, ((0, 0), (0, 1))).astype(np.float32)

    def pressure(self, p: Floats, density: float) -> NDArray[np.float32]:
        """(S, 1) [Pa] from (M,) over the density."""
        return (density * p[:len(self.mesh.points), None]).astype(np.float32)


def stored(scene: FlowScene, space: FlowSpace) -> Stored:
    """Where the frames of a scene go."""
    mesh = space.mesh
    if scene.order == 2 or scene.body.shape == "file":
        return Stored(replace(mesh, middles={}), space, False)
    nodes = space.pressure
    cells = np.concatenate([nodes.cells[:, list(quarter)] for quarter in QUARTERS]).astype(np.int64)
    edge = nodes.inner[:, 0]

    def halved(place: Integers) -> Integers:
        inside = np.zeros(len(mesh.points), bool)
        inside[place] = True
        on = inside[mesh.edges].all(axis=1) & _outer(mesh)
        return np.union1d(place, edge[on])

    fine = Mesh(np.pad(nodes.points, ((0, 0), (0, 1))), cells, "triangle", {name: halved(place) for name, place in mesh.places.items()})
    return Stored(fine, space, True)


def _outer(mesh: Mesh) -> NDArray[np.bool_]:
    """(E,) True on the edges of the boundary."""
    base = len(mesh.points)
    outer = np.sort(mesh.boundary[0], axis=1)
    return np.isin(mesh.edges[:, 0] * base + mesh.edges[:, 1], outer[:, 0] * base + outer[:, 1])
