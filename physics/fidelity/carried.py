"""A stored flow read off at other points, by the functions that its nodes stand for (currents.py).

A point is sought in the cells with the nearest centres, by Newton's method on their quadratic maps, and taken to be in the one that it
is deepest in; a point just outside, as of a rounder hole, is read off the function of the nearest cell gone on with.

Legend: M points, S stored nodes, k cells tried for each point.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from physics.flow.space import FlowSpace, geometry_of, table
from physics.flow.stored import computed_mesh, stored
from physics.scene.flow import FlowScene

CANDIDATES, NEWTON = 10, 8


def reader(scene: FlowScene, points: NDArray[np.float64]) -> scipy.sparse.csr_matrix:
    """(M, S) what makes values at points (M, 2) of those at the stored nodes of a scene of a shape."""
    space = FlowSpace(computed_mesh(scene), scene.order)
    where = stored(scene, space)
    cells, order = (space.pressure.cells, 2) if where.halved else (space.mesh.cells, 1)
    geometry = geometry_of(space.mesh)
    near = cKDTree(geometry[:, :3].mean(axis=1)).query(points, min(CANDIDATES, len(cells)))[1].reshape(len(points), -1)  # (M, k)
    nodes = geometry[near]  # (M, k, 6, 2)
    at = np.full((*near.shape, 2), 1 / 3)
    for _ in range(NEWTON):
        values, slopes = table(2, at.reshape(-1, 2))
        miss = np.einsum("mkg,mkgd->mkd", values.reshape(*near.shape, 6), nodes) - points[:, None]
        jacobian = np.einsum("mkgr,mkgd->mkdr", slopes.reshape(*near.shape, 6, 2), nodes)
        at = np.clip(at - np.linalg.solve(jacobian, miss[..., None])[..., 0], -1.0, 2.0)
    depth = np.minimum(at.min(axis=2), 1 - at.sum(axis=2))
    best = np.argmax(depth, axis=1)
    row = np.arange(len(points))
    values = table(order, at[row, best])[0]  # (M, n)
    rows, columns = np.repeat(row, values.shape[1]), cells[near[row, best]].ravel()
    return scipy.sparse.csr_matrix((values.ravel(), (rows, columns)), (len(points), len(where.mesh.points)))
