"""A small scene and trajectories that claim to be of it; nothing is solved."""

from __future__ import annotations

import dataclasses

import numpy as np

from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory
from physics.mesh.build import build_mesh
from physics.scene import Scene, read_scene

COUNT = 12


def scene(**changes) -> Scene:
    """A box of 50 x 20 x 10 mm in motion, so that its equilibrium is not asked for, under a plane that comes down."""
    table = {"body": {"length": 0.05, "width": 0.02, "height": 0.01, "cells": [3, 2, 1], "cell": "hexahedron"},
             "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "support": [{"where": "x-min"}],
             "obstacle": {"shape": "half-space", "normal": [0, 0, -1], "path": [[0.0, 0.0, 0.02], [0.0, 0.0, 0.01]]},
             "steps": {"count": COUNT, "dynamic": True, "duration": 1.0}}
    return read_scene(table | changes)


def trajectory(given: Scene, u=None, **changes) -> Trajectory:
    """The body of a scene with displacements (T, N, 3), at rest unless given, and one triangle of an obstacle that is on its way."""
    mesh = build_mesh(given.body)
    nodes, frames = len(mesh.points), given.steps.count + 1
    moved = np.zeros((frames, nodes + 3, 3))
    if u is not None:
        moved[:, :nodes] = u
    if given.obstacle is not None:
        first, last = np.array(given.obstacle.path)
        moved[:, nodes:] = ((last - first) * np.arange(frames)[:, None] / given.steps.count)[:, None]
    kind = np.concatenate([np.where(mesh.points[:, 0] == 0, HANDLE, NORMAL), np.full(3, OBSTACLE)]).astype(np.uint8)
    made = Trajectory(
        points=np.concatenate([mesh.points, np.eye(3)]), node_kind=kind,
        connectivity=np.concatenate([mesh.cells.ravel(), nodes + np.arange(3)]),
        offsets=np.concatenate([8 * np.arange(len(mesh.cells) + 1), [8 * len(mesh.cells) + 3]]),
        types=np.array([12] * len(mesh.cells) + [5], np.uint8), displacement=moved.astype(np.float32),
        modes=np.zeros((0, nodes + 3, 3), np.float32), scene=given.to_toml())
    return dataclasses.replace(made, **changes)
