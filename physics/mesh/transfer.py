"""Displacements carried from one mesh of a body to other points of it, by the shape functions.

Legend: M points, N nodes of the mesh, T frames, k cells tried for each point, n nodes of a cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh

Floats = NDArray[np.floating[Any]]
Integers = NDArray[np.int64]
CANDIDATES, NEWTON_STEPS = 24, 6
MORE, PART = 8 * CANDIDATES, 500  # tried for points in none of these, for so many points at a time
CLOSE, INSIDE = 1e-9, 1e-8  # of a cell's size


def interpolate(mesh: Mesh, displacement: Floats, points: Floats, outside_by: float = 1e-6,
                candidates: int = CANDIDATES, few: int | None = None) -> Floats:
    """(T, M, 3) displacements at other rest points (M, 3), by the shape functions of the cell that holds each of them.

    The cell is sought among the `candidates` with the nearest centres (of even boxes one is enough), first among `few` of them where that
    is given: of cells that share a point any may then be taken. Points in none of these are sought among more.
    (vtkProbeFilter of VTK 9.7.2 takes some points on the faces of prisms from outside of a wrong prism.)
    Raises ValueError when a point lies in no cell by more than `outside_by` of the cell's size; what lies outside is extrapolated.
    """
    return carried(displacement, *located(mesh, points, outside_by, candidates, few))


def carried(displacement: Floats, nodes: Integers, weights: Floats) -> Floats:
    """(T, M, 3) what nodes have (T, N, 3) at points between nodes (M, n) with weights (M, n)."""
    return np.asarray(np.einsum("mn,tmnd->tmd", weights, displacement[:, nodes]))


def located(mesh: Mesh, points: Floats, outside_by: float = 1e-6, candidates: int = CANDIDATES,
            few: int | None = None, layered: bool = False) -> tuple[Integers, Floats]:
    """The nodes (M, n) of the cells that hold some points (M, 3), and the weights (M, n) of what they have; see `interpolate`.

    layered: cells lie in layers along all axes, as in a box, not all as thick: nearness is counted in layers
    """
    outside, nodes, weights = _located(mesh, points, few or candidates, 0.0 if few is None else CLOSE, layered)
    if few is not None and len(left := np.flatnonzero(outside > INSIDE)):
        outside[left], nodes[left], weights[left] = _located(mesh, points[left], candidates, CLOSE, layered)
    farther = np.flatnonzero(outside > outside_by)  # beside a long cell short ones may be nearer to a point than the one that holds it
    for first in range(0, len(farther), PART):
        left = farther[first:first + PART]
        outside[left], nodes[left], weights[left] = _located(mesh, points[left], MORE, CLOSE, layered)
    if (lost := int((outside > outside_by).sum())):
        raise ValueError(f"{lost} of {len(points)} points lie outside of the mesh to interpolate from")
    return nodes, weights


def _located(mesh: Mesh, points: Floats, candidates: int, close: float, layered: bool) -> tuple[Floats, Any, Floats]:
    """How far each point is outside (M,) of the nearest cell, in sizes of it, the nodes (M, n) of that, and their weights (M, n).

    By Newton's iteration on the isoparametric map, until all are as close, in sizes of a cell.
    """
    extent = np.ptp(mesh.points[mesh.cells], axis=1).mean(axis=0)  # of a cell along x, y, z: distances count in cells
    flat = range(mesh.dimension, 3)  # a plane body has no extent along z
    extent[flat] = 1.0
    middles = mesh.points[mesh.cells].mean(axis=1)
    centres, places = _in_layers(mesh, middles, points) if layered else (middles / extent, points / extent)
    near = cKDTree(centres).query(places, min(candidates, len(mesh.cells)))[1].reshape(len(points), -1)  # (M, k)
    corners = mesh.points[mesh.cells[near]]  # (M, k, n, 3)
    first = CELLS[CELLS[mesh.cell].first or mesh.cell]
    at = np.full((*near.shape, 3), 0.25 if first.name == "tetrahedron" else 0.5)  # (M, k, 3) place in the cell's coordinates
    at[..., flat] = 0.0
    for steps in range(NEWTON_STEPS + 1):
        values, gradients = CELLS[mesh.cell].shapes(at)
        missing = points[:, None] - np.einsum("mkn,mknd->mkd", values, corners)
        if steps == NEWTON_STEPS or (abs(missing) <= close * extent).all():
            break
        jacobian = np.einsum("mkne,mknd->mkde", gradients, corners)
        jacobian[..., flat, flat] = 1.0
        at = at + np.linalg.solve(jacobian, missing[..., None])[..., 0]
    astray, of_corners = np.linalg.norm(missing, axis=-1), values if first.name == mesh.cell else first.shapes(at)[0]
    outside = np.maximum(-of_corners.min(axis=-1), 0) + astray / np.ptp(corners, axis=2).max(axis=-1)  # (M, k)
    best = np.argmin(outside, axis=1)[:, None]
    nodes = mesh.cells[np.take_along_axis(near, best, 1)[:, 0]]  # (M, n)
    return np.take_along_axis(outside, best, 1)[:, 0], nodes, np.take_along_axis(values, best[..., None], 1)[:, 0]


def _in_layers(mesh: Mesh, *places: Floats) -> list[Floats]:
    """Places (M, 3) each counted in layers of cells along each axis: 1.5 in the middle of the second."""
    corners = mesh.points[mesh.cells[:, :CELLS[mesh.cell].corners].ravel()]
    ends = [np.unique(corners[:, axis]) for axis in range(3)]
    return [np.stack([np.interp(points[:, axis], planes, np.arange(len(planes))) for axis, planes in enumerate(ends)], axis=1)
            for points in places]
