"""A body in motion: on which mesh, and in how many steps of time, does it keep an error that is asked?

A step of length h makes periods longer by a share that falls as h^2 (motion/dynamics.py), so that the phase of a body is the farther off
the longer it swings. How many steps are enough is sought on the coarsest mesh, where they are cheap: more and more of them, until what is
left by the order that is seen (estimate.py) is below TIME of the error. Meshes are compared as for equilibria (climb.py), each by its
whole motion, all in so few steps that time makes ROUGH of the error: it makes about the same on each. The mesh that is chosen has as many
as are enough, and once more fewer, to see what time makes of the error there; where that is too much there are more.

The frames of a scene are what its file has. Where fewer steps are enough frames between them lie on cubic splines in time; where more are
taken, a frame has the mean force of its steps. Legend: N nodes, T frames + 1, K frames that are compared, M points.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.accuracy.between import splines
from physics.accuracy.choose import LOOSE, LOOSEST, MOST_NODES, converging, sought
from physics.accuracy.estimate import FIRST, ErrorEstimate, distance, estimate
from physics.accuracy.meshes.ladder import MeshFamily, Sizes
from physics.accuracy.pilot import Pilot, Pilots
from physics.accuracy.table import Verdict, row, rows_of_mesh
from physics.equilibrium.state import NoEquilibrium
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.solution import Solution, of_path, solve

Floats = NDArray[np.float64]

TIME, MESH = 0.35, 0.5  # shares of the error asked
ROUGH = 2.0  # times the error asked time may make where meshes are compared
FEWEST, MOST = 16, 20_000  # steps of time
MORE = 1.5  # times as many steps at least are tried next
COMPARED = 60  # frames, at most
KEPT = 2  # motions of which all frames are kept
TAUGHT = 6  # frames that tell a drawing where its cells should be small

Key = tuple[int, Sizes, float, int]  # order of the cells, sizes, tolerance, steps of time


@dataclass(frozen=True)
class ChosenMotion:
    """scene: with the mesh that was chosen, asking for nothing; solution: its frames; verdict: what is known of their error."""

    scene: Scene
    solution: Solution
    verdict: Verdict


class Motions(Pilots):
    """The motions of a scene on its meshes, each found once; used as `Pilots` are, with the frames that are compared for poses."""

    def __init__(self, scene: Scene, kinds: list[MeshFamily], quantity: str, tolerance: float, steps: int) -> None:
        super().__init__(scene, kinds, quantity, tolerance=tolerance, small_strain=0.0)
        self.count, self.frames = steps, scene.steps.count
        self.compared = sorted({round(step) for step in np.linspace(1, self.frames, min(COMPARED, self.frames))})
        self.fractions = np.array(self.compared) / self.frames
        self._moved: dict[Key, Pilot] = {}
        self._kept: dict[Key, Solution] = {}  # the last few

    def __call__(self, family: MeshFamily, sizes: Sizes, tolerance: float | None = None) -> Pilot:
        return self.moved(family, sizes, self.count, tolerance)

    def __len__(self) -> int:
        return len(self._moved)

    def knows(self, family: MeshFamily, sizes: Sizes) -> bool:
        return (family.order, sizes, self.tolerance, self.count) in self._moved

    def solved(self, order: int) -> list[tuple[Sizes, Pilot]]:
        return [(sizes, pilot) for (one, sizes, tolerance, steps), pilot in self._moved.items()
                if (one, tolerance, steps) == (order, self.tolerance, self.count)]

    def moved(self, family: MeshFamily, sizes: Sizes, steps: int, tolerance: float | None = None) -> Pilot:
        """The motion on a mesh in so many steps of time. Raises `NoEquilibrium`."""
        key = family.order, sizes, tolerance or self.tolerance, steps
        if key not in self._moved:
            self._solve(family, key)
        return self._moved[key]

    def solution(self, family: MeshFamily, sizes: Sizes) -> Solution:
        """All frames of a motion."""
        key = family.order, sizes, self.tolerance, self.count
        if key not in self._kept:
            self._solve(family, key)
        return self._kept[key]

    def _solve(self, family: MeshFamily, key: Key) -> None:
        started, (_, sizes, tolerance, steps) = time.process_time(), key
        scene, mesh = family.rung(sizes)
        found = _solved(scene, mesh, steps, tolerance)
        some = found.displacement[:: max(1, self.frames // TAUGHT)][1:]
        self._moved[key] = Pilot(mesh, self.of(scene, found, self.compared), some, time.process_time() - started)
        self._kept = dict([*self._kept.items(), (key, found)][-KEPT:])
        self.seconds += self._moved[key].seconds
        family.learn(sizes, some)


def choose_motion(scene: Scene, most: int = MOST_NODES) -> ChosenMotion:
    """The motion of a scene that keeps the error which it asks for, at the least cost, or the best that was tried.

    Args: most: nodes
    Raises as `solve`.
    """
    assert scene.steps.error is not None
    asked, quantity = scene.steps.error, scene.steps.quantity or "displacement"
    kinds = sorted(converging(scene), key=lambda family: family.order)
    motions = Motions(scene, kinds, quantity, min(LOOSEST, asked / 100), FEWEST)
    stepped, enough, motions.count = in_time(motions, kinds[-1], TIME * asked, ROUGH * asked)
    best, other, loose = sought(kinds, motions, MESH * asked, LOOSE * asked, most)
    motions.count = enough
    while True:
        coarser, ahead = beside(motions)
        fewer, pilot = (motions.moved(best.family, best.sizes, steps) for steps in (coarser, motions.count))
        off = distance(fewer.values, pilot.values, motions.weights)
        ratio = (coarser / motions.count) ** stepped.order
        made = off * ratio / (1 - ratio)
        estimated = best.error + made + loose
        if estimated <= asked or made <= TIME * asked or ahead > MOST:
            break
        motions.count = ahead
    motion = f"{motions.count} for {motions.frames} frames, held against {coarser}; error falls as h^{stepped.order:.2g} ({stepped.how})"
    rows = [*rows_of_mesh(best),
            row("kinematics", "the linear law, as asked" if scene.linear else "finite strain", 0.0),
            row("tolerance", f"{motions.tolerance:.0e} of the reaction", loose),
            row("steps of time", motion, made),
            row("the whole scene", f"{best.family.said(best.sizes)}; {best.said}", estimated, pilot.seconds)]
    if other is not None:
        sizes, error = other.ladder[-1]
        rows.append(row("the other order", other.family.said(sizes) + ("" if other.reached else ", given up"), error))
    rows.append(row("the search", f"{len(motions)} motions", None, motions.seconds))
    remarks = ("the error does not fall regularly: the larger of two differences is taken",) * ("irregular" in (best.how, stepped.how))
    chosen = best.family.scene_with(best.sizes)
    said = f"{motions.count} of time for {motions.frames} frames"
    found = motions.solution(best.family, best.sizes)
    found = of_path(chosen, replace(found, model=found.model | {"steps": said}, steps_of_time=motions.count, seconds=pilot.seconds))
    reached = best.reached and estimated <= asked
    return ChosenMotion(chosen, found, Verdict(asked, quantity, estimated, reached, tuple(rows), remarks))


def in_time(motions: Motions, family: MeshFamily, target: float, rough: float) -> tuple[ErrorEstimate, int, int]:
    """What is known of the error of time on the coarsest mesh of a family, and numbers of steps that keep a target and a rough one."""
    fit = numbers(motions.frames)
    motions.count = next(n for n in fit if n >= max(FEWEST, MORE * fit[0]))
    tried, differences = [motions.count], list[float]()
    while True:
        ahead = beside(motions)[1]
        if ahead > MOST:
            few = tried[len(tried) // 2]  # nothing will be promised: no more is spent on it
            return ErrorEstimate(np.inf, FIRST[motions.quantity], "irregular"), few, few
        before, after = (motions.moved(family, family.base, steps) for steps in (motions.count, ahead))
        differences.append(distance(before.values, after.values, motions.weights))
        tried.append(ahead)
        motions.count = ahead
        found = estimate(tried, differences, 2.0, motions.quantity)
        if found.error <= target:
            break
    finest = motions.moved(family, family.base, tried[-1])
    off = [distance(motions.moved(family, family.base, steps).values, finest.values, motions.weights) + found.error for steps in tried]
    enough, roughly = (next(steps for steps, each in zip(tried, off, strict=True) if each <= least) for least in (target, rough))
    return found, enough, roughly


def beside(motions: Motions) -> tuple[int, int]:
    """The numbers of steps next to that of motions, MORE times fewer and more at least."""
    fit = numbers(motions.frames)
    return max(n for n in fit if MORE * n <= motions.count), next(n for n in fit if n >= MORE * motions.count)


def numbers(frames: int) -> list[int]:
    """Of steps with which every frame is reached, or every step a frame, rising beyond MOST."""
    few = [n for n in range(2, frames) if frames % n == 0]
    return few + [frames * 2**k for k in range(3 + max(0, int(np.log2(MOST / frames) + 1)))]


def framed(found: Solution, frames: int) -> Solution:
    """The frames of a motion that was solved in fewer steps of time, a number that divides theirs."""
    steps = len(found.displacement) - 1
    rows = {name: value for name, value in vars(found).items() if isinstance(value, np.ndarray) and len(value) == steps + 1}
    each = frames // steps
    to, passed = splines(np.arange(0, frames + 1, each), np.arange(frames + 1)), -(-np.arange(frames + 1) // each)
    led: dict[str, Any] = {name: np.tensordot(to, value, 1) for name, value in rows.items() if value.dtype == np.float64}
    led |= {name: np.maximum(led[name], 0.0) for name in ("energy", "kinetic_energy", "penetration")}
    led |= {"relative_residual": found.relative_residual[passed], "snap": np.zeros(frames + 1), "released": np.zeros(frames + 1)}
    iterations = np.zeros(frames + 1, np.int64)
    iterations[::each] = found.newton_iterations
    return replace(found, **led, newton_iterations=iterations, knots=tuple(range(0, frames + 1, each)))


def _solved(scene: Scene, mesh: Mesh, steps: int, tolerance: float) -> Solution:
    """The frames of a scene, solved in so many steps of time. Raises `NoEquilibrium`."""
    frames = scene.steps.count
    found = solve(replace(scene, steps=replace(scene.steps, count=min(frames, steps))), mesh=mesh, tolerance=tolerance,
                  substeps=max(1, steps // frames), partial=True, look=False)
    if found.failure:
        raise NoEquilibrium(f"on {len(mesh.points)} nodes in {steps} steps of time: {found.failure}", found)
    return found if steps >= frames else framed(found, frames)
