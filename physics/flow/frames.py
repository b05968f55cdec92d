"""The frames of a flow: how many steps lead from one to the next, and what is said of each.

Steps are as long as stability and error let them be. Convection is explicit, so with `rate` how often the fastest fluid crosses its
cell, dt rate must stay below COURANT, which was measured for each order (benchmarks/flow.py --courant) and holds a margin of a tenth.
Of a motion with the angular frequency w two differences in a row have the ratio |d2 u| / |d u| = w dt, and the frequency of the
steps is off by about (w dt)^2: w dt stays below TURN. What changes by less than STILL of the velocity in a step counts as still.

A block of steps that ends past the limit, or in numbers that are none, is done again from its start with shorter ones: what is
explicit and too long is bounded, looks like a flow, and is wrong.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from physics.flow.forces import Forces
from physics.flow.stepping import Memory, Stepper

Floats = NDArray[np.float64]

COURANT = {2: 0.165, 3: 0.105}
OVER = 1.1  # of the limit, that a block may end at
TURN, STILL = 0.04, 1e-6
FIRST = 32  # steps of the first block
MOST = 100_000  # steps of a block
AGAIN = 4  # times that a block is done again


class NoFlow(RuntimeError):
    """The flow could not be followed any further."""


def limit(stepper: Stepper) -> float:
    """[1/s] the least number of steps in a second that is stable now."""
    return stepper.space.rate(stepper.memory.u) / COURANT[stepper.space.order]


def advance(stepper: Stepper, until: float, *, blocks: int = 1) -> None:
    """On to a time [s], in steps of a size that is chosen anew for each of some blocks. Raises `NoFlow`."""
    start = stepper.memory.time
    for block in range(1, blocks + 1):
        _block(stepper, until if block == blocks else start + (until - start) * block / blocks)


def _block(stepper: Stepper, until: float) -> None:
    before = stepper.memory
    span, peak = until - before.time, _largest(stepper, until)
    steps, reason = count(stepper, span), ""
    for _ in range(AGAIN + 1):
        if steps > MOST:
            break
        with np.errstate(all="ignore"):
            stepper.advance(until, steps)
        now = stepper.memory
        if not np.isfinite(now.u).all() or abs(now.u).max() > 1e3 * peak:
            reason, wanted = "the steps were unstable", 2.0 * steps
        else:
            wanted = limit(stepper) * span
            if wanted <= OVER * steps:
                return
            reason = f"the fastest fluid crosses {wanted / steps:.3g} times the part of a cell that is stable in a step"
        steps = rounded(max(1.1 * wanted, steps + 1))
        stepper.memory = before
    raise NoFlow(f"no flow after t = {before.time:.6g} s: {reason}, and {steps} steps to {until:.6g} s are tried no more; take larger "
                 "cells, a slower inflow or one with a ramp")


def count(stepper: Stepper, span: float) -> int:
    """How many steps are taken over a span of time."""
    m = stepper.memory
    if m.before is None or m.earlier is None:
        return max(FIRST, rounded(1.3 * limit(stepper) * span))
    last = span / m.size  # steps of the last size
    wanted = max(limit(stepper) * span, last * min(turn(m) / TURN, 2.0), last / 2)
    steps = rounded(wanted)
    # A new size may cost a factor, so only one that is well below is worth it.
    kept = round(last)
    return kept if steps <= kept <= 1.06 * steps + 1 and abs(kept - last) < 1e-6 * last else steps


def turn(m: Memory) -> float:
    """w dt of the last steps."""
    if m.before is None or m.earlier is None:
        return 0.0
    step, bend = m.u - m.before, m.u - 2 * m.before + m.earlier
    moved = float(np.linalg.norm(step))
    return max(0.0, float(np.linalg.norm(bend)) - STILL * float(np.linalg.norm(m.u))) / moved if moved else 0.0


def rounded(steps: float) -> int:
    """The next number of steps, of few different ones when they are many."""
    grain = max(1, 2 ** math.floor(math.log2(max(steps, 1) / 16)))
    return max(1, math.ceil(steps / grain - 1e-9) * grain)


def _largest(stepper: Stepper, until: float) -> float:
    given = stepper.conditions.values(until)
    return max(float(abs(given).max(initial=0.0)), float(abs(stepper.memory.u).max()), 1e-300)


def rate_of_change(m: Memory) -> Floats:
    """(N, 2) [m/s2] of the velocity, of second order where there are two velocities before it."""
    if m.before is None:
        return np.zeros_like(m.u)
    if m.earlier is None:
        return (m.u - m.before) / m.size
    return (1.5 * m.u - 2 * m.before + 0.5 * m.earlier) / m.size


def figures(stepper: Stepper, forces: Forces | None, density: float, steps: int) -> dict[str, Floats]:
    """What is said of a frame: drag and lift [N/m], pressure_difference [Pa], kinetic_energy [J/m], divergence [1/s], step_size [s],
    iterations, the steps since the frame before, and unresolved, the share of the velocity that only its highest order holds."""
    m = stepper.memory
    said = {"kinetic_energy": density * stepper.energy(), "divergence": stepper.divergence(), "step_size": m.size,
            "iterations": float(steps), "unresolved": stepper.space.finest(m.u)}
    if forces is not None:
        drag, lift = forces.force(m.u, m.p, rate_of_change(m)) if m.steps else (0.0, 0.0)
        said |= {"drag": float(drag), "lift": float(lift)}
        difference = forces.difference(m.p)
        if difference is not None:
            said["pressure_difference"] = difference
    return {name: np.array(value) for name, value in said.items()}
