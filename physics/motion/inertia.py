"""Whether a loading is slow enough to leave inertia out; and where it is not left out, whether the steps are short enough.

A load that rises evenly over a time t makes an undamped mode of period T swing about its static value by

    |sin(pi t / T)| / (pi t / T) <= T / (pi t)

of it (Clough and Penzien, Dynamics of Structures, 5-2: ramp of finite rise time), the first mode most. Contact makes a body
stiffer and its periods shorter, so the first period of the free body bounds what a slow obstacle does as well. A path of
several legs changes its speed at each way-point; t is then the time of one leg.

Steps of length h make a period T longer by (2 pi h / T)^2 / 12 of it (dynamics.py).
"""

from __future__ import annotations

import math
from itertools import pairwise

from physics.scene import Scene

FAIR = 0.01  # largest share of the static displacement that may swing


def inertia(scene: Scene, frequency: float, steps: int | None = None) -> str:
    """What is done about inertia and why, in words.

    Args:
        frequency: [Hz] of the first mode, zero when a motion is left free
        steps: of time, where they are not those of the scene
    """
    if not frequency > 0:
        if scene.steps.dynamic:
            return "in motion, energy kept step by step; the supports leave a motion free"
        return "left out: the supports leave a motion free, which has no period to compare the loading with"
    period, duration = 1 / frequency, scene.steps.duration
    if scene.steps.dynamic:
        return _resolved(scene, period, steps or scene.steps.count)
    mode = f"the first mode ({frequency:.4g} Hz)"
    if duration is None:
        fair = fair_duration(scene, period)
        return (f"left out; fair when the loading takes at least {fair:.3g} s, {fair / period:.0f} periods of {mode}: then the body swings "
                f"by at most {FAIR:.0%} of its static displacement. The scene gives no duration")
    swing = min(2.0, period * legs(scene) / (math.pi * duration))
    said = (f"left out: the loading takes {duration:g} s, {duration / period:.3g} periods of {mode}, so that the body swings by at most "
            f"{swing:.2g} of its static displacement")
    return said if swing <= FAIR else said + f"; above {FAIR:g} this matters: [steps] dynamic = true has inertia"


def _resolved(scene: Scene, period: float, steps: int) -> str:
    """How well so many steps of a dynamic scene resolve a first period [s], in words."""
    assert scene.steps.duration is not None
    h = scene.steps.duration / steps
    longer, fastest = (2 * math.pi * h / period) ** 2 / 12, 1 / (10 * h)
    return (f"in motion, energy kept step by step: {period / h:.3g} steps of {h:.3g} s for a period of the first mode "
            f"({1 / period:.4g} Hz), which comes out longer by {longer:.1e} of it; modes above {fastest:.3g} Hz have less than 10 "
            "steps for a period")


def fair_duration(scene: Scene, period: float) -> float:
    """The shortest loading [s] that is slow for a body of a first period [s]."""
    return period * legs(scene) / (math.pi * FAIR)


def legs(scene: Scene) -> float:
    """How many of the shortest straight part, of an obstacle's path or of a table, the whole loading has room for; at least 1."""
    tables = [load.steps for load in scene.load if load.steps] + [support.steps for support in scene.support if support.steps]
    tables += [obstacle.steps for obstacle in scene.obstacles if obstacle.steps]
    equal = [len(obstacle.path) - 1 for obstacle in scene.obstacles if not obstacle.steps]
    return max([1, *equal, *(1 / min(b - a for a, b in pairwise(steps)) for steps in tables)])
