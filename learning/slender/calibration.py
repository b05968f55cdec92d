"""How far off a frame may be: the network's own expectation, stretched until it holds on beams that it was not trained on.

The network says for each pose which error s it expects, from the errors that it makes in training; on other beams they are larger. With
the true errors e of n validation frames, e / s is taken as it comes, and the error bar of a new frame is

    q s,    q = the ceil((n + 1) c)-th smallest e / s

which covers the share c of new frames drawn like those (split conformal prediction). Frames of one beam are alike, so what counts is the
number of beams rather than of frames: the share that is covered varies from one set of beams to another by about sqrt(c (1 - c) / beams).

Source: Vovk, Gammerman, Shafer, Algorithmic Learning in a Random World (2005); Lei et al., J. Am. Stat. Assoc. 113 (2018).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor


def stretch(errors: Tensor, expected: Tensor, coverage: float) -> float:
    """q of the module for errors (n,) and what was expected of them (n,), both above 0; infinite for too few to cover so many."""
    ratio = torch.sort(errors / expected).values
    rank = math.ceil((len(ratio) + 1) * coverage)
    return math.inf if rank > len(ratio) else float(ratio[rank - 1])


def covered(errors: Sequence[Tensor], bars: Sequence[Tensor]) -> float:
    """The share of frames whose error is within its bar, each trajectory counting alike."""
    return float(torch.stack([(error <= bar).float().mean() for error, bar in zip(errors, bars, strict=True)]).mean())
