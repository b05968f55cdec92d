"""Frames that the network's own predictions have led to, for it to learn to go on from.

A network that has learned from true frames alone is soon lost among its own. So trajectories are walked while it learns: one that is drawn
is shown as the network's predictions have left it, the network learns to come from there to the true frames that follow, and the walk
goes on by one prediction. With chance 1 / (1 + pushed) a walk begins anew at the true frame that was drawn, so that `pushed` predictions
lie behind a frame in the mean; it does so too at the end of a trajectory, and where it has gone as far astray as the trajectory moves.

This is the pushforward of Brandstetter et al., arXiv:2202.03376, over as many predictions as one likes for the price of one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.prediction.checkpoint import Model
from learning.prediction.rollout import went_on
from learning.samples.samples import Example


class Walks:
    """How far each trajectory of a training has been walked.

    frame: (E,) int64, the frame that is reached; -1 where a walk is to begin
    state: of each (N, D) float32, its state there as `Example.states` has it
    motion: (E,) root mean square of the true states of its free nodes
    """

    def __init__(self, model: Model, examples: Sequence[Example], kept: dict[str, Tensor] | None = None) -> None:
        """kept: what `tensors` gave; by default all walks are to begin."""
        self.model, self.examples = model, examples
        self.motion = [np.sqrt(np.square(each.states[:, each.skeleton.free], dtype=np.float64).mean()) for each in examples]
        self.frame = np.full(len(examples), -1)
        self.state = [example.states[0] for example in examples]
        if kept:
            self.frame = kept["frame"].numpy().copy()
            self.state = np.split(kept["state"].numpy(), np.cumsum([len(state) for state in self.state])[:-1])

    def tensors(self) -> dict[str, Tensor]:
        """What another needs to go on from here, all nodes one after the other."""
        return {"frame": torch.from_numpy(self.frame.copy()), "state": torch.from_numpy(np.concatenate(self.state))}

    def next(self, which: int, frame: int, generator: torch.Generator) -> tuple[int, NDArray[np.float32]]:
        """The frame of a trajectory to learn from, and (N, D) what is shown of it; the walk has then gone on from there.

        frame: the true one at which a walk begins
        """
        example, pushed, bundle = self.examples[which], self.model.config.pushed, self.examples[which].layout.bundle
        again = torch.rand((), generator=generator).item() * (1 + pushed) < 1
        at, now = int(self.frame[which]), self.state[which]
        if again or not 0 <= at < example.targets[-1]:
            at, now = frame, example.states[frame]
        after, free = went_on(self.model, example, at, now), example.skeleton.free
        lost = not np.sqrt(np.square((after - example.states[at + bundle])[free]).mean()) <= self.motion[which]
        self.frame[which], self.state[which] = -1 if lost else at + bundle, after
        return at, now
