"""Which mesh keeps an error that is asked at the least cost?

Each order of cells has its way from coarse to fine (climb.py), and for each it is foreseen what the whole scene will cost on the mesh
that keeps the error; two meshes of a way tell. The one that promises the least goes on, until one is there that costs less than any
other promises. Small strain may make SMALL_STRAIN of the error and the tolerance of Newton's method is lowered to make less than LOOSE.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from physics.accuracy.climb import Climb
from physics.accuracy.estimate import distance
from physics.accuracy.meshes.ladder import MeshFamily, families
from physics.accuracy.pilot import Pilot, Pilots
from physics.equilibrium.newton import TOLERANCE
from physics.equilibrium.state import State
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError
from physics.solution import WITHOUT_LIMIT, through_held

MESH, SMALL_STRAIN, LOOSE = 0.8, 0.1, 0.05  # shares of the error asked
MOST_NODES = 20_000  # of a mesh that is tried
LOOSEST, TIGHTEST = 1e-4, 1e-9  # tolerances


@dataclass(frozen=True)
class Choice:
    """What is solved: the scene with its mesh, how it is solved, and what is known of its error.

    loose: the error by the tolerance; pilots: all that was solved to choose; other: the climb of the other order, if it was begun
    """

    scene: Scene
    mesh: Mesh
    climb: Climb
    tolerance: float
    small_strain: float
    loose: float
    pilots: Pilots
    asked: float
    quantity: str
    other: Climb | None

    @property
    def pilot(self) -> Pilot:
        """Of the chosen mesh."""
        return self.climb.pilot

    @property
    def states(self) -> list[State]:
        """Those of the pilot."""
        return [State(fraction, u, np.zeros(0)) for fraction, u in zip(self.pilots.fractions.tolist(), self.pilot.u, strict=True)]


def choose(scene: Scene, most: int = MOST_NODES, *, balanced: bool = False) -> Choice:
    """The cheapest mesh that keeps the error that a scene asks for, or the finest one tried.

    Args:
        most: nodes
        balanced: whether all steps will be solved on it, as in `solve_chosen`

    Raises:
        InputError: the scene has no solution to look for
        NoEquilibrium: a step has none that could be found
    """
    assert scene.steps.error is not None
    asked, quantity = scene.steps.error, scene.steps.quantity or "displacement"
    kinds = sorted(converging(scene), key=lambda family: family.order)
    pilots = Pilots(scene, kinds, quantity, tolerance=min(LOOSEST, asked / 100), small_strain=SMALL_STRAIN * asked,
                    balanced=balanced)
    best, other, loose = sought(kinds, pilots, MESH * asked, LOOSE * asked, most)
    chosen = best.family.scene_with(best.sizes)
    return Choice(chosen, best.pilot.mesh, best, pilots.tolerance, pilots.small_strain, loose, pilots, asked, quantity, other)


def converging(scene: Scene) -> list[MeshFamily]:
    """The families of a scene's meshes. Raises `InputError` where finer ones lead nowhere."""
    kinds = families(scene)
    if scene.obstacles and (deep := through_held(scene, kinds[0].rung(kinds[0].base)[1])):
        raise InputError(f"obstacle: passes through points that are held, by up to {deep:.3g} m: {WITHOUT_LIMIT}, and no mesh keeps an "
                         "error; end its path before them, or hold less of the body")
    return kinds


def sought(kinds: list[MeshFamily], pilots: Pilots, target: float, allowed: float, most: int) -> tuple[Climb, Climb | None, float]:
    """As `climbed` for an error of the mesh, with a tolerance that makes less than is allowed, and what it makes."""
    loose = math.nan

    def begun(climb: Climb) -> None:
        nonlocal loose
        if math.isnan(loose):
            loose = _tightened(pilots, climb, allowed)

    return *climbed([Climb(kind, pilots, target, most, kind.base) for kind in kinds], begun), loose


def climbed(climbs: list[Climb], begun: Callable[[Climb], None] = lambda climb: None) -> tuple[Climb, Climb | None]:
    """The climb that keeps the error at the least cost, or comes nearest to it, and another one that was begun.

    Args: begun: called with a climb when its coarsest mesh is solved
    Raises what none of them could be solved for.
    """
    def nearer(climb: Climb) -> bool:
        """Whether another way is, or may yet be."""
        return any(other.error < climb.error or not (other.ladder or other.ended) for other in climbs)

    while going := [climb for climb in climbs if not (climb.ended or (climb.lost and nearer(climb)))]:
        before = next((one.ladder[0][1] for one in climbs if one.ladder), 0.0)
        climb = next((one for one in going if len(one.ladder) == 1), None) or min(going, key=lambda one: one.outlook(before))
        if any(one.reached and one.outlook() <= climb.outlook(before) for one in climbs):
            break
        climb.go_on()
        if len(climb.ladder) == 1:
            begun(climb)
    solved = [climb for climb in climbs if climb.ladder]
    if not solved:
        raise next(climb.why for climb in climbs if climb.why)
    best = min(solved, key=lambda climb: (0, climb.outlook()) if climb.reached else (1, climb.error))
    return best, next((climb for climb in solved if climb is not best), None)


def _tightened(pilots: Pilots, climb: Climb, allowed: float) -> float:
    """Lower the tolerance until it makes less of the error than is allowed, seen on the coarsest mesh; what it makes."""
    family, sizes = climb.family, climb.ladder[0][0]
    while True:
        loose, tight = pilots(family, sizes), pilots(family, sizes, min(TOLERANCE, pilots.tolerance) / 100)
        made = distance(loose.values, tight.values, pilots.weights)
        if made <= allowed or pilots.tolerance / 10 < TIGHTEST:
            return made
        pilots.tolerance /= 10
