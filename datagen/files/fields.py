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
from physics.mesh.mesh import Mesh
from physics.scene import Materials, Scene
from physics.solution import Solution

VTK_ORDER = [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]


def stress_fields(scene: Scene, solution: Solution, trajectory: Trajectory) -> dict[str, NDArray[np.float32]]:
    """Stress in every frame of a solution, as `fields` of the trajectory that was made of it."""
    stress = np.zeros((*trajectory.displacement.shape[:2], 7), np.float32)
    of = Stress(solution.mesh, scene.material)
    for t, u in enumerate(solution.displacement):
        stress[t, :len(u)] = of.at(u, as_solved(scene, trajectory, t).material)
    return {"stress": stress[:, :, :6], "von_mises": stress[:, :, 6:]}


class Stress:
    """Stress at the nodes of one mesh of some materials."""

    def __init__(self, mesh: Mesh, material: Materials) -> None:
        self.mesh, self.at_nodes = mesh, recovery(mesh, material)

    def at(self, u: NDArray[np.float64], material: Materials) -> NDArray[np.float64]:
        """(N, 7) [Pa] the six components, then von Mises' measure, for displacements (N, 3) [m]."""
        sigma = nodal_stress(self.mesh, u, material, self.at_nodes)
        return np.column_stack([sigma[:, *VTK_ORDER], von_mises_of(sigma)])
