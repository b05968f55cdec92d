"""A network's flow with the divergence taken out of each frame before it goes on from there: what a splitting scheme does with its own.

With D u the divergence of a velocity u against the linear functions of the cells that the flow was computed on, the stored nodes being
those of their quadratic ones (physics/flow/space.py), and W one over the diagonal of the mass matrix, 0 where velocity is given,

    u - W D' y    with    D W D' y = D u

is the nearest velocity, in the norm of that diagonal, with as much flowing through every part of the channel as flows in. A stored truth
changes by some thousandths of its velocity, and the matrix has as many rows as there are cells' corners.

Legend: S stored nodes, T frames.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from physics.flow.space import FlowSpace
from physics.flow.stored import computed_mesh, stored
from physics.scene import FlowScene

Floats = NDArray[np.float64]


def without_divergence(scene: FlowScene, predicted: NDArray[np.bool_]) -> Callable[[Floats], Floats] | None:
    """What makes of velocities (S, 2) [m/s] the nearest without divergence; None where stored nodes are those of no quadratic function.

    predicted: (S,) the nodes that it may change
    """
    mesh = computed_mesh(scene)
    if not stored(scene, FlowSpace(mesh, scene.order)).halved:
        return None
    space = FlowSpace(mesh, 2)
    blocks = space.divergence_blocks()
    rows = np.broadcast_to(space.pressure.cells[:, :, None, None], blocks.shape)
    columns = np.broadcast_to(2 * space.velocity.cells[:, None, :, None] + np.arange(2), blocks.shape)
    shape = len(space.pressure.points), 2 * len(predicted)
    divergence = scipy.sparse.csr_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape)
    weight = np.where(predicted, 1 / space.matrix(space.mass).diagonal(), 0.0).repeat(2)
    spread = (scipy.sparse.diags(weight) @ divergence.T).tocsr()
    factor = scipy.sparse.linalg.splu((divergence @ spread).tocsc())

    def corrected(velocity: Floats) -> Floats:
        return velocity - (spread @ factor.solve(divergence @ velocity.ravel())).reshape(velocity.shape)

    return corrected
