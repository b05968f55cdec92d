"""What a learned simulator has to beat: predictors that know nothing, and finite elements on a coarser mesh.

Each predictor moves the free nodes and is given the motion of the held ones; obstacle nodes take no part. Lengths in [m].
Legend: T frames (the rest state first), N nodes of the body.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from physics.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.floating[Any]]
CANDIDATES, NEWTON_STEPS = 24, 6


def nothing_moves(truth: Floats, free: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Free nodes stay where they are: (T, N, 3) from the rest state, and (T - 1, N, 3) one step from each true frame."""
    path, steps = truth.copy(), truth[1:].copy()
    path[:, free] = 0
    steps[:, free] = truth[:-1, free]
    return path, steps


def keep_velocity(truth: Floats, free: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Free nodes go on as they last went: (T, N, 3) rollout and (T - 1, N, 3) one step from each true frame.

    The rollout is shown frames 0 and 1, and no other: u_t = u_1 + (t - 1) (u_1 - u_0). One step from frame t is
    u_t + (u_t - u_(t-1)), and from the rest state, which has no velocity, it is the rest state.
    """
    path, steps = truth.copy(), truth[1:].copy()
    first = truth[1:2, free] - truth[:1, free]
    path[2:, free] = truth[1, free] + np.arange(1, len(truth) - 1, dtype=truth.dtype)[:, None, None] * first
    steps[0, free] = truth[0, free]
    steps[1:, free] = 2 * truth[1:-1, free] - truth[:-2, free]
    return path, steps


def coarser(scene: Scene) -> Scene | None:
    """The scene with half the cells along each direction, rounded down, at least 2; None when nothing is left to halve."""
    nx, ny, nz = (min(n, max(2, n // 2)) for n in scene.body.divisions)
    divisions = (nx, ny, nz)
    if divisions == scene.body.divisions:
        return None
    return replace(scene, body=replace(scene.body, cells=divisions, cell_size=None))


def interpolate(mesh: Mesh, displacement: Floats, points: Floats) -> Floats:
    """(T, M, 3) displacements at other rest points (M, 3), by the shape functions of the cell that holds each of them.

    The cell is sought among the CANDIDATES with the nearest centres, by Newton's iteration on the isoparametric map.
    (vtkProbeFilter of VTK 9.7.2 takes some points on the faces of prisms from outside of a wrong prism.)
    Raises ValueError when a point lies in no cell by more than 1e-6 of the cell's size.
    """
    extent = np.ptp(mesh.points[mesh.cells], axis=1).mean(axis=0)  # of a cell along x, y, z: distances count in cells
    centres = cKDTree(mesh.points[mesh.cells].mean(axis=1) / extent)
    near = centres.query(points / extent, min(CANDIDATES, len(mesh.cells)))[1].reshape(len(points), -1)  # (M, k)
    corners = mesh.points[mesh.cells[near]]  # (M, k, n, 3)
    at = np.full((*near.shape, 3), 0.25 if mesh.cell == "tetrahedron" else 0.5)  # (M, k, 3) place in the cell's coordinates
    for _ in range(NEWTON_STEPS):
        values, gradients = shapes(mesh.cell, at)
        missing = points[:, None] - np.einsum("mkn,mknd->mkd", values, corners)
        jacobian = np.einsum("mkne,mknd->mkde", gradients, corners)
        at = at + np.linalg.solve(jacobian, missing[..., None])[..., 0]
    values, _ = shapes(mesh.cell, at)
    astray = np.linalg.norm(points[:, None] - np.einsum("mkn,mknd->mkd", values, corners), axis=-1)
    outside = np.maximum(-values.min(axis=-1), 0) + astray / np.ptp(corners, axis=2).max(axis=-1)  # (M, k)
    best = np.argmin(outside, axis=1)[:, None]
    if (lost := int((np.take_along_axis(outside, best, 1) > 1e-6).sum())):
        raise ValueError(f"{lost} of {len(points)} points lie outside of the mesh to interpolate from")
    nodes = mesh.cells[np.take_along_axis(near, best, 1)[:, 0]]  # (M, n)
    weights = np.take_along_axis(values, best[..., None], 1)[:, 0]  # (M, n)
    return np.einsum("mn,tmnd->tmd", weights, displacement[:, nodes])


def shapes(cell: str, at: Floats) -> tuple[Floats, Floats]:
    """(..., n) shape functions and (..., n, 3) their gradients at places (..., 3) in a cell's coordinates, each 0 .. 1.

    All are products of the linear functions of a line, a triangle or a tetrahedron; one of them is negative outside.
    """
    parts = {"tetrahedron": ((0, 1, 2),), "prism": ((0, 1), (2,)), "hexahedron": ((0,), (1,), (2,))}[cell]
    values, gradients = np.ones((*at.shape[:-1], 1)), np.zeros((*at.shape[:-1], 1, 3))
    for axes in parts:
        own = at[..., axes]
        value = np.concatenate([1 - own.sum(axis=-1, keepdims=True), own], axis=-1)  # (..., q)
        slope = np.zeros((len(axes) + 1, 3))
        slope[0, axes] = -1
        slope[np.arange(1, len(axes) + 1), axes] = 1
        # The later factor varies slowest.
        gradients = (value[..., :, None, None] * gradients[..., None, :, :] + slope[:, None, :] * values[..., None, :, None])
        values = value[..., :, None] * values[..., None, :]
        values, gradients = values.reshape(*at.shape[:-1], -1), gradients.reshape(*at.shape[:-1], -1, 3)
    if cell == "hexahedron":
        around = [0, 1, 3, 2, 4, 5, 7, 6]  # from rows to the order around the square
        return values[..., around], gradients[..., around, :]
    return values, gradients
