"""A predicted path corrected at as many frames as the course of its corrections needs.

What a predictor of whole paths gets wrong changes slowly from frame to frame, far more slowly than the path itself, so a Newton step
is not needed at each: between corrected frames the correction is interpolated (Akima 1970: cubic pieces that do not swing beside a
kink, such as the first touch). A straight line over s frames is off by at most s^2/8 of the correction's second derivative. That of a
gap is the smaller of the two that the corrected frames before and after it give, so a kink beside a gap is not taken for one in it;
the next gap is as wide as it allows, and one that proves too wide is halved.

Legend: T frames, N nodes.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator

Floats = NDArray[np.float64]
Correct = Callable[[Floats, int], Floats]

LONGEST = 16  # frames from one correction to the next


def corrected_path(correct: Correct, guess: Floats, share: float) -> Floats:
    """(T, N, 3) displacements after corrections of a predicted path (T, N, 3) that begins at rest.

    Args:
        correct: takes displacements (N, 3) and the number of their frame, and gives better ones; asked in the order of the frames,
            but where a gap is halved after its end
        share: of the way from a prediction, that corrections leave; interpolation may miss half as much. 0: each frame is corrected
    """
    course, now, stride = _Course(correct, guess, share), 0, 1
    while now < len(guess) - 1:
        before, now = now, min(now + stride, len(guess) - 1)
        course.add(now)
        course.halve(before, now)
        stride = int(np.clip(course.fair(course.frames[-2], now), 1, min(2 * (now - course.frames[-2]), LONGEST)))
    return guess + course.interpolated()


class _Course:
    """Corrections (N, 3) by their frames, which are kept in order."""

    def __init__(self, correct: Correct, guess: Floats, share: float) -> None:
        self.correct, self.guess, self.share = correct, guess, share
        self.frames, self.off = [0], {0: np.zeros_like(guess[0])}

    def add(self, frame: int) -> None:
        self.off[frame] = self.correct(self.guess[frame], frame) - self.guess[frame]
        insort(self.frames, frame)

    def halve(self, a: int, b: int) -> None:
        """Correct frames between two corrected ones, which are neighbours, until no gap is too wide."""
        if b - a > max(1.0, self.fair(a, b)):
            middle = (a + b) // 2
            self.add(middle)
            self.halve(a, middle)
            self.halve(middle, b)

    def fair(self, a: int, b: int) -> float:
        """How many frames the gap between two corrected frames, which are neighbours, should span."""
        at = self.frames.index(a)
        second = min((self._second(*three) for three in (self.frames[max(at - 1, 0):at + 2], self.frames[at:at + 3]) if len(three) == 3),
                     default=np.inf)
        allowed = 8 * self.share / 2 * max(np.linalg.norm(self.off[a]), np.linalg.norm(self.off[b]))
        return float(np.sqrt(allowed / second)) if second else float(LONGEST)

    def _second(self, a: int, b: int, c: int) -> float:
        """Of the correction, by its values at three frames."""
        slope = (self.off[c] - self.off[b]) / (c - b) - (self.off[b] - self.off[a]) / (b - a)
        return 2 * float(np.linalg.norm(slope)) / (c - a)

    def interpolated(self) -> Floats:
        """(T, N, 3) at all frames."""
        known = np.array([self.off[frame] for frame in self.frames])
        return known if len(known) == len(self.guess) else Akima1DInterpolator(self.frames, known)(np.arange(len(self.guess)))
