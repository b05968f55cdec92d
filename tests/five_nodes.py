"""Trajectories of five nodes, whose every number can be worked out on paper, and folders of them; nothing is solved."""

from __future__ import annotations

import dataclasses

import numpy as np

from datagen.files.trajectory import HANDLE, INFLOW, NORMAL, OBSTACLE, OUTFLOW, WALL, Trajectory, write_trajectory
from datagen.sets import dataset

UNIT = 2.0**-10  # [m] of displacements below: their multiples are exact in single precision


def tiny(**changes) -> Trajectory:
    """Two tetrahedra that share a face, two of their five nodes held, and an obstacle of one triangle; two steps.

    In units of 2^-10 m the free nodes 1, 2 and 4 lie (3, 4, 0), 0 and (0, 0, 2) from rest at step 1, (3, 4, 12), (0, 6, 8) and
    (0, 0, 1) at step 2: lengths 5, 0, 2 and 13, 10, 1. What is held and the obstacle move further.
    """
    points = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1], [0.3, 0.2, 0.1], [1, 1, 1], [1.5, 1, 1], [1, 1.5, 2]], float)
    u = np.zeros((3, 8, 3), np.float32)
    u[1, 1], u[1, 4] = (3, 4, 0), (0, 0, 2)
    u[2, 1], u[2, 2], u[2, 4] = (3, 4, 12), (0, 6, 8), (0, 0, 1)
    u[2, 0], u[1:, 5:] = (0, 0, 100), (0, 50, 0)
    modes = np.zeros((2, 8, 3), np.float32)
    modes[0, 1], modes[1, 2] = (0, 0, 1), (0, 1, 0)
    made = Trajectory(
        points=points, connectivity=np.array([0, 1, 2, 3, 1, 2, 3, 4, 5, 6, 7]), offsets=np.array([0, 4, 8, 11]),
        types=np.array([10, 10, 5], np.uint8),
        node_kind=np.array([HANDLE, NORMAL, NORMAL, HANDLE, NORMAL, OBSTACLE, OBSTACLE, OBSTACLE], np.uint8),
        displacement=u * np.float32(UNIT), modes=modes, frequencies_hz=(10.0, 12.5),
        per_frame={"reaction": np.array([[0, 0, 1], [2, 3, 6], [0, 3, 4]], float), "energy": np.array([0, 0.5, 0.25]),
                   "smallest_det_f": np.array([1, 0.625, 0.75]), "newton_iterations": np.array([9, 2, 5]),
                   "relative_residual": np.array([0, 1e-3, 1e-4])},
        seed=3, index=7, versions={"numpy": "1"}, commit="abc", extra={"seconds": 6.0})
    return dataclasses.replace(made, **changes)


def square_flow() -> Trajectory:
    """A flow on a square of four triangles, nine frames.

    Node n has velocity (t^2, n t) / 16 and pressure t + n / 8 in frame t, but where velocity is given.
    """
    t, n = np.meshgrid(np.arange(9), np.arange(5), indexing="ij")
    velocity = np.stack([t**2, n * t, 0 * t], axis=2) / 16
    velocity[:, [0, 1, 3]] = [[1, 0, 0], [0, 0, 0], [0, 0, 0]]
    return tiny(
        points=np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0]], float),
        connectivity=np.array([0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4]), offsets=np.array([0, 3, 6, 9, 12]), types=np.full(4, 5, np.uint8),
        node_kind=np.array([INFLOW, WALL, OUTFLOW, WALL, NORMAL], np.uint8), displacement=np.zeros((9, 5, 3), np.float32),
        modes=np.zeros((0, 5, 3), np.float32), frequencies_hz=(), per_frame={}, scene="",
        fields={"velocity": velocity.astype(np.float32), "pressure": (t + n / 8)[..., None].astype(np.float32)})


def write_set(folder, trajectories, *, family='name = "tiny"\n[body]\nlength = 0.5\n', seed=3) -> dataset.Manifest:
    """A data set of trajectories by file name."""
    entries = []
    for file, trajectory in trajectories.items():
        write_trajectory(folder / file, trajectory)
        entries.append(dataset.entry_of(file, trajectory))
    manifest = dataset.Manifest(schema=dataset.SCHEMA, family=family, seed=seed, trajectories=tuple(entries))
    dataset.write_manifest(folder, manifest)
    return manifest
