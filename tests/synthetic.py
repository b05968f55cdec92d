"""Small trajectories by beam theory, for tests of what learns from trajectories: no solver is needed to make them.

A cantilever held at x = 0 is pressed at x = a by a cylinder that comes down along z. With the cylinder's tip d below the
upper face the Euler-Bernoulli deflection under a point load is w(x) = d x^2 (3a - x) / (2a^3) for x < a and d a^2 (3x -
a) / (2a^3) beyond; sections stay plane, u_z = -w, u_x = (z - h/2) w'.
"""

from __future__ import annotations

import numpy as np

from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory
from physics.mesh.build import build_mesh
from physics.scene import Body


def cylinder_surface(radius: float, width: float, around: int = 16, along: int = 2):
    """Points (n, 3) about the origin and triangles (f, 3) of the mantle of a cylinder along y."""
    angle = 2 * np.pi * np.arange(around) / around
    y = np.linspace(0, width, along + 1)
    ring = np.stack([radius * np.cos(angle), np.zeros(around), radius * np.sin(angle)], axis=1)
    points = np.concatenate([ring + [0, s, 0] for s in y])
    i, j = np.divmod(np.arange(around * along), around)
    a, b = i * around + j, i * around + (j + 1) % around
    triangles = np.concatenate([np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)])
    return points, triangles


def bending(*, cells=(10, 2, 2), steps=10, gap=0.001, travel=0.02, at=0.07, length=0.1, seed=0) -> Trajectory:
    """One trajectory of steps + 1 frames; the cylinder starts `gap` above the beam and goes down by `travel` [m]."""
    side, radius = 0.02, 0.01
    mesh = build_mesh(Body(length=length, width=side, height=side, cells=cells))
    surface, triangles = cylinder_surface(radius, side)
    nodes = len(mesh.points)
    points = np.concatenate([mesh.points, surface + [at, 0, side + radius + gap]])

    x, z = mesh.points[:, 0], mesh.points[:, 2]
    shape = np.where(x < at, x**2 * (3 * at - x), at**2 * (3 * x - at)) / (2 * at**3)
    slope = np.where(x < at, x * (6 * at - 3 * x), 3 * at**2) / (2 * at**3)
    field = np.stack([(z - side / 2) * slope, 0 * x, -shape], axis=1)  # (nodes, 3) for a tip deflection of 1
    drop = travel * np.arange(steps + 1) / steps
    displacement = np.zeros((steps + 1, len(points), 3))
    displacement[:, :nodes] = np.maximum(drop - gap, 0)[:, None, None] * field
    displacement[:, nodes:, 2] = -drop[:, None]

    kind = np.full(len(points), OBSTACLE, np.uint8)
    kind[:nodes] = NORMAL
    kind[mesh.places["x-min"]] = HANDLE
    first = 1 - np.cos(np.pi * x / (2 * length))
    modes = np.zeros((2, len(points), 3), np.float32)
    modes[0, :nodes, 2] = modes[1, :nodes, 1] = first
    return Trajectory(
        points=points,
        connectivity=np.concatenate([mesh.cells.ravel(), (triangles + nodes).ravel()]),
        offsets=np.concatenate([np.arange(len(mesh.cells)) * 6, len(mesh.cells) * 6 + np.arange(len(triangles) + 1) * 3]),
        types=np.concatenate([np.full(len(mesh.cells), 13, np.uint8), np.full(len(triangles), 5, np.uint8)]),
        node_kind=kind, displacement=displacement.astype(np.float32), modes=modes, frequencies_hz=(10.0, 10.01), seed=seed)
