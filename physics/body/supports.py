"""What holds and loads a body: held components, prescribed displacements, tractions, dead pressures. Legend: N nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.body.pressure import pressure_force
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.float64]


def held(scene: Scene, mesh: Mesh) -> NDArray[np.bool_]:
    """(N, 3) True on the components that a support holds."""
    fixed = np.zeros(mesh.points.shape, bool)
    for support in scene.support:
        for letter in support.fixed:
            fixed[mesh.place(support.where), "xyz".index(letter)] = True
    return fixed


def prescribed(scene: Scene, mesh: Mesh) -> Floats:
    """(N, 3) displacements [m] of the held components at the last step, zero elsewhere.

    Raises:
        InputError: two supports give one component of a node different displacements
    """
    target, given = np.zeros_like(mesh.points), np.zeros(mesh.points.shape, bool)
    for i, support in enumerate(scene.support):
        nodes = mesh.place(support.where)
        for letter in support.fixed:
            axis = "xyz".index(letter)
            value = support.displacement[axis]
            if (given[nodes, axis] & (target[nodes, axis] != value)).any():
                raise InputError(f"support[{i}]: gives the {letter} displacement of nodes at {support.where!r} as {value:g} m, "
                                 "another support gives another")
            target[nodes, axis], given[nodes, axis] = value, True
    return target


def rigid_motions_left(mesh: Mesh, fixed: NDArray[np.bool_]) -> int:
    """How many of the six rigid motions the held components (N, 3) leave free."""
    x = (mesh.points - mesh.points.mean(axis=0)) / np.ptp(mesh.points)
    motions = [np.broadcast_to(axis, x.shape) for axis in np.eye(3)] + [np.cross(axis, x) for axis in np.eye(3)]
    at_held = np.stack([motion[fixed] for motion in motions], axis=1)
    return 6 - int(np.linalg.matrix_rank(at_held, tol=1e-9 * len(at_held) ** 0.5)) if len(at_held) else 6


def traction_load(scene: Scene, mesh: Mesh) -> Floats:
    """(N, 3) nodal forces [N] of tractions and dead pressures, over rest facets, at the last step."""
    force = np.zeros_like(mesh.points)
    for load in scene.load:
        if load.traction is not None and load.where is not None:
            force += nodal_areas(mesh, load.where)[:, None] * np.array(load.traction)
        if load.pressure is not None and load.where is not None and not load.follower:
            force += pressure_force(mesh.points, mesh.facets(load.where), load.pressure)
    return force


def nodal_areas(mesh: Mesh, place: str) -> Floats:
    """(N,) integral of each node's shape function over a plane named face [m2]."""
    areas = np.zeros(len(mesh.points))
    for facets in mesh.facets(place):
        x = mesh.points[facets]
        if facets.shape[1] == 3:
            share = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)[:, None] / 6
        else:
            share = _bilinear_shares(x)
        np.add.at(areas, facets, share)
    return areas


def _bilinear_shares(x: Floats) -> Floats:
    """(F, 4) integrals of the bilinear shape functions over quadrilaterals (F, 4, 3), by 2 x 2 Gauss points."""
    shares = np.zeros(x.shape[:2])
    sign = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for point in sign / np.sqrt(3):
        shape = np.prod(1 + sign * point, axis=1) / 4  # (4,)
        slope = sign * (1 + sign * point)[:, ::-1] / 4  # (4, 2)
        tangent = np.einsum("ak,fad->fkd", slope, x)
        shares += np.linalg.norm(np.cross(tangent[:, 0], tangent[:, 1]), axis=1)[:, None] * shape
    return shares
