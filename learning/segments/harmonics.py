"""Laplacian modes of a trajectory's body from its mesh alone: -div grad phi = lambda phi.

In weak form, integral of grad phi . grad v = lambda integral of phi v, on first-order cells with the mass lumped at the nodes:
K phi = lambda M phi with M diagonal. phi = 0 on nodes that are held (HANDLE, AIRFOIL, INFLOW, WALL), d phi / dn = 0 on the
rest; a body with nothing held has the constant at lambda = 0, which tells nothing and is left out. Plane cells, those of a
cloth in space too, are each laid flat and taken as prisms or hexahedra of unit height whose phi is constant over the height, which is
exact. `fidelity modes --kind laplacian` solves the same by finite elements of first or second order; here neither PETSc nor dolfinx
is needed.

Legend: N nodes, C cells, n nodes of a cell, P sample points, m modes. lambda in [1/m2].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import eigsh

from datagen.files.trajectory import AIRFOIL, HANDLE, INFLOW, WALL, Trajectory
from physics.body.element import samples
from physics.mesh.mesh import Mesh
from physics.schema import InputError

Floats = NDArray[np.float64]
EXTRUDED = {"triangle": "prism", "quadrilateral": "hexahedron"}
BESIDE = 6  # eigenvalues that are looked at beyond the wanted ones, for copies of the last


def harmonics(trajectory: Trajectory, *, count: int = 1, cluster: float = 1.0) -> tuple[Floats, Floats]:
    """The first Laplacian modes that are not constant, in rising order.

    Args:
        count: how many
        cluster: modes of eigenvalues up to this times the last wanted one come on top

    Returns:
        (m,) eigenvalues [1/m2] and (m, N) shapes on the nodes of the body

    Raises:
        InputError: more modes are asked for than the mesh has values to move
    """
    body = trajectory.body
    kinds = trajectory.node_kind[body]
    stiffness, mass = laplacian(trajectory.mesh)
    free = np.flatnonzero(~np.isin(kinds, (HANDLE, AIRFOIL, INFLOW, WALL)))
    constant = int(len(free) == len(kinds))
    wanted = min(count + constant + BESIDE, len(free) - 1)
    if wanted < count + constant:
        raise InputError(f"{count} Laplacian modes asked for, the mesh has {len(free)} nodes that are not held")
    scale = diags(mass[free] ** -0.5)
    matrix = csc_matrix(scale @ stiffness[free][:, free] @ scale)
    shift = -1e-3 * (np.pi / np.ptp(trajectory.points[body], axis=0).max()) ** 2  # below zero, where a free body has a mode
    start = np.random.default_rng(0).standard_normal(len(free))
    values, vectors = eigsh(matrix, k=wanted, sigma=shift, v0=start)
    order = np.argsort(values)[constant:]
    order = order[values[order] <= cluster * values[order[count - 1]] * (1 + 1e-9)]
    shapes = np.zeros((len(order), len(kinds)))
    shapes[:, free] = (scale @ vectors[:, order]).T
    return values[order], shapes


def laplacian(mesh: Mesh) -> tuple[csc_matrix, Floats]:
    """K (N, N) [m, or 1 in the plane] and the diagonal of M (N,) [m3, or m2]."""
    cells, points = mesh.cells, mesh.points
    nodes, corners = len(points), cells.shape[1]
    if mesh.cell in EXTRUDED:
        height, flat = np.ptp(points, axis=0).max(), _laid_flat(points[cells]).reshape(-1, 3)
        own = np.arange(len(flat)).reshape(cells.shape)  # each cell with nodes of its own
        both = np.concatenate([own, own + len(flat)], axis=1)
        raised = Mesh(np.concatenate([flat, flat + [0, 0, height]]), both, EXTRUDED[mesh.cell], {})
        sampled = samples(raised)
        gradients = sampled.gradients[:, :, :corners] + sampled.gradients[:, :, corners:]
        volumes = sampled.volumes / height
    else:
        sampled = samples(mesh)
        gradients, volumes = sampled.gradients, sampled.volumes
    volumes = np.abs(volumes)  # plane cells may be numbered in either sense
    blocks = np.einsum("pc,pcai,pcbi->cab", volumes, gradients, gradients)  # (C, n, n)
    row, column = np.repeat(cells, corners, axis=1).ravel(), np.tile(cells, (1, corners)).ravel()
    stiffness = coo_matrix((blocks.ravel(), (row, column)), shape=(nodes, nodes)).tocsc()
    mass = np.zeros(nodes)
    np.add.at(mass, cells, volumes.sum(axis=0)[:, None] / corners)
    return stiffness, mass


def _laid_flat(x: Floats) -> Floats:
    """The corners (C, n, 3) of triangles or quadrilaterals, each turned into the plane z = 0. Raises `InputError` for one without area."""
    first, second = (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) if x.shape[1] == 3 else (x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    normal = np.cross(first, second)
    length, area = np.linalg.norm(first, axis=1), np.linalg.norm(normal, axis=1)
    if len(empty := np.flatnonzero(~(area > 1e-12 * length * np.linalg.norm(second, axis=1)))):
        raise InputError(f"cell {empty[0]} of the mesh has no area")
    along, up = first / length[:, None], normal / area[:, None]
    axes = np.stack([along, np.cross(up, along), up], axis=1)  # (C, 3, 3)
    return np.einsum("cij,cnj->cni", axes, x - x.mean(axis=1, keepdims=True)) * [1.0, 1.0, 0.0]
