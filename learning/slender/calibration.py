"""How far off a frame may be: the network's own expectation, stretched until it holds on beams that it was not trained on.

The network says for each pose which error s it expects, from the errors that it makes in training; on other bodies they are larger. With
the true errors e of frames of k validation trajectories, the error bar of a new frame is

    q s,    q the smallest number for which the mean over trajectories of their shares of frames with e / s <= q reaches c

which covers about the share c of the frames of new trajectories drawn like those (conformal prediction with pooled distributions).
Frames of one trajectory are right or wrong together, so each trajectory counts alike, however many frames it has; and the share that is
covered varies from one set of k trajectories to another by up to sqrt(c (1 - c) / k), 9 % for a dozen and 3 % for a hundred of them.

Source: Dunn, Wasserman, Ramdas, Distribution-free prediction sets for two-layer hierarchical models, J. Am. Stat. Assoc. 118 (2023).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor


def stretch(errors: Sequence[Tensor], expected: Sequence[Tensor], coverage: float) -> float:
    """q of the module for errors and what was expected of them, both above 0, of each trajectory; infinite where that were below 1 in
    1 - coverage trajectories: so few cannot tell."""
    if len(errors) * (1 - coverage) < 1 - 1e-9:
        return math.inf
    ratio = np.concatenate([(error / bar).numpy() for error, bar in zip(errors, expected, strict=True)]).astype(float)
    share = np.concatenate([np.full(len(error), 1 / (len(error) * len(errors))) for error in errors])
    order = np.argsort(ratio)
    reached = np.cumsum(share[order]) >= coverage - 1e-12
    return float(ratio[order[reached.argmax()]])


def covered(errors: Sequence[Tensor], bars: Sequence[Tensor]) -> float:
    """The share of frames whose error is within its bar, each trajectory counting alike."""
    return float(torch.stack([(error <= bar).float().mean() for error, bar in zip(errors, bars, strict=True)]).mean())
