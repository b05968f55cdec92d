"""When it is time to look whether a state is stable: an old factor leads to unstable ones as well.

The next look comes before the softest mode, whose stiffness is followed from look to look, would have lost LOSS of it, after at most
twice as much of the loading as from the last look to this one, and SELDOM of it at most. What a look finds is the factor's
inertia (tangent.py). Legend: N nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LOSS, SELDOM = 0.3, 0.05  # when the next look comes: loss of the softest mode's stiffness, share of the loading


@dataclass(frozen=True)
class Watch:
    """What is known from the last look at stability.

    softest: stiffness of the softest mode then [N/m]; unseen: share of the loading since; trusted: what of it may pass without a look
    """

    softest: float = 0.0
    unseen: float = 0.0
    trusted: float = 0.0

    def after(self, softest: float) -> Watch:
        """What is known after a look that found this stiffness of the softest mode."""
        loss = max(0.0, self.softest - softest) / softest / self.unseen  # of stiffness, for each part of the loading
        return Watch(softest, 0.0, min(LOSS / max(loss, LOSS), 2 * self.unseen, SELDOM))


def softest_mode(solve: Callable[[Floats], Floats], fixed: NDArray[np.bool_]) -> float:
    """The stiffness of about the softest motion (N, 3) under forces that are its own multiple [N/m], by inverse iteration.

    Args: solve: K^-1 f for forces (N, 3); fixed: (N, 3) True on held components.
    """
    mode = np.where(fixed, 0.0, np.cos(np.arange(fixed.size).reshape(-1, 3)))
    for _ in range(3):  # other modes are some times stiffer, and need not be gone
        mode = solve(mode / np.linalg.norm(mode))
    return 1 / float(np.linalg.norm(mode))
