"""How the end of a path depends on the path: exact derivatives of what a predictor of beams says, by torch.

Of the last frame's displacements with respect to the two ends of the obstacle's path and to its radius, all else as it is: the kind
of obstacle, its turn, the face, the body. Theory and network are differentiated backwards, from all numbers of all sections in one batch.
The derivative is that of the branch on which the body is: where a sphere moves on to another groove the answer jumps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.slender.beam import see
from learning.slender.features import look
from learning.slender.many import Paths
from learning.slender.model import Slender
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Gradient:
    """displacement (N, 3) [m] of the last frame, and its derivatives, without a unit: by_start, by_end (3, N, 3) by the components of
    the path's ends, by_radius (N, 3)."""

    displacement: Floats
    by_start: Floats
    by_end: Floats
    by_radius: Floats


def gradient(model: Slender, scene: Scene) -> Gradient:
    """The last frame of a scene and its derivatives, for the N nodes of the mesh that the scene builds.

    Raises:
        InputError: the scene is not one of a beam that an obstacle presses, or the obstacle never touches it
    """
    beam = see(scene)
    if beam.first_touch >= 1:
        raise InputError("the obstacle never touches the body: there is nothing to differentiate")
    turn = torch.tensor([beam.turn], dtype=torch.float64)

    def end(numbers: Tensor) -> Tensor:
        paths = Paths(beam, numbers[None, :3], numbers[None, 3:6], numbers[6:], turn)
        return model.answer_with_slope(look(beam, paths.end, paths.obstacle()))[0][0]

    numbers = torch.cat([*beam.ends, torch.tensor([beam.radius])]).double().requires_grad_()
    said = end(numbers)  # (S, 3, 6)
    (slopes,) = torch.autograd.grad(said.flatten(), numbers, torch.eye(said.numel()), is_grads_batched=True)
    found = beam.nodes(torch.cat([said.detach()[None], slopes.T.reshape(7, *said.shape).float()]).numpy())
    place, signs = np.argsort([0, beam.side, beam.up]), np.array(beam.signs)[:, None, None]
    by_start, by_end = ((found[first:first + 3] * signs)[place] for first in (1, 4))
    return Gradient(found[0], by_start, by_end, found[7])
