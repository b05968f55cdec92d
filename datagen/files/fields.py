"""What a trajectory file can hold of a solution besides its displacements.

    stress      (T, N, 6)  Cauchy stress [Pa] at the nodes: xx, yy, zz, xy, yz, xz, the order of symmetric tensors in VTK
    von_mises   (T, N, 1)  von Mises' measure of it [Pa]

Both are zero on the obstacle; at a node of two materials they are the mean. Legend: T frames, N nodes, body first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from datagen.files.solved import as_solved
from datagen.files.trajectory import Trajectory
from physics.body.stress import nodal_stress, recovery, von_mises_of
from physics.scene import Scene
from physics.solution import Solution

VTK_ORDER = [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]


def stress_fields(scene: Scene, solution: Solution, trajectory: Trajectory) -> dict[str, NDArray[np.float32]]:
    """Stress in every frame of a solution, as `fields` of the trajectory that was made of it."""
    at_nodes, mesh = recovery(solution.mesh, scene.material), solution.mesh
    stress = np.zeros((*trajectory.displacement.shape[:2], 6), np.float32)
    measure = np.zeros((*trajectory.displacement.shape[:2], 1), np.float32)
    for t, u in enumerate(solution.displacement):
        sigma = nodal_stress(mesh, u, as_solved(scene, trajectory, t).material, at_nodes)
        stress[t, :len(sigma)] = sigma[:, *VTK_ORDER]
        measure[t, :len(sigma), 0] = von_mises_of(sigma)
    return {"stress": stress, "von_mises": measure}
