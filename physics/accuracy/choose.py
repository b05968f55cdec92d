"""Which mesh keeps an error that is asked at the least cost?

A direction at a time: the coarsest mesh is solved at a few poses, and again with more cells along each direction; the direction whose
refinement changes most is refined, and so on until the errors of all directions together are below what is asked. What the directions
do to each other is left out, but all are looked at again on the last mesh. Second order goes first; first order is given up where it
would cost more. Small strain may make SMALL_STRAIN of the error and the tolerance of Newton's method is lowered to make less than LOOSE.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from physics.accuracy.estimate import ROUNDING, Estimate, distance, estimate
from physics.accuracy.ladder import Family, Sizes, families
from physics.accuracy.pilot import Pilot, Pilots
from physics.equilibrium.newton import TOLERANCE
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError

MESH, SMALL_STRAIN, LOOSE = 0.8, 0.1, 0.05  # shares of the error asked
MOST_NODES = 20_000  # of a mesh that is tried
LOOSEST, TIGHTEST = 1e-4, 1e-9  # tolerances
COARSEST = 5  # refinements of a coarsest mesh that cannot hold the scene


@dataclass
class Climb:
    """The way from the coarsest mesh of a family to one that keeps the error.

    sizes: where it is; parts: what is known of each direction; ladder: meshes on the way, each with its error at that time
    """

    family: Family
    sizes: Sizes
    parts: dict[int, Estimate] = field(default_factory=dict)
    ladder: list[tuple[Sizes, float]] = field(default_factory=list)
    reached: bool = False

    @property
    def error(self) -> float:
        """Of all directions together; infinite while one of them is unknown."""
        return sum(part.error for part in self.parts.values()) if len(self.parts) == len(self.sizes) else float("inf")


@dataclass(frozen=True)
class Choice:
    """What is solved: the scene with its mesh, how it is solved, and what is known of its error.

    loose: the error by the tolerance; pilots: all that was solved to choose; other: the climb of the other order, if there was one
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
        return self.pilots(self.climb.family, self.climb.sizes)


def choose(scene: Scene, most: int = MOST_NODES) -> Choice:
    """The cheapest mesh that keeps the error that a scene asks for, or the finest one tried. Args: most: nodes.

    Raises:
        InputError: the scene has no solution to look for
        NoEquilibrium: a step has none that could be found
    """
    assert scene.steps.error is not None
    asked, quantity = scene.steps.error, scene.steps.quantity or "displacement"
    kinds = families(scene)
    pilots = Pilots(scene, kinds, quantity, tolerance=min(LOOSEST, asked / 100), small_strain=SMALL_STRAIN * asked)
    first = _coarsest(pilots, kinds[0])
    loose = _tightened(pilots, kinds[0], first, LOOSE * asked)
    climbs = [_climb(pilots, Climb(kinds[0], first), MESH * asked, most)]
    for kind in kinds[1:]:
        limit = pilots(kinds[0], climbs[0].sizes).work
        climbs.append(_climb(pilots, Climb(kind, _coarsest(pilots, kind)), MESH * asked, most, limit))
    kept = [climb for climb in climbs if climb.reached]
    best = (min(kept, key=lambda climb: pilots(climb.family, climb.sizes).work) if kept
            else min(climbs, key=lambda climb: climb.error))
    other = next((climb for climb in climbs if climb is not best), None)
    chosen, mesh = best.family.rung(best.sizes)
    return Choice(chosen, mesh, best, pilots.tolerance, pilots.small_strain, loose, pilots, asked, quantity, other)


def _coarsest(pilots: Pilots, family: Family) -> Sizes:
    """The coarsest mesh that can hold the scene: its obstacle and its places by coordinates may be too small for coarser ones."""
    sizes, refused = family.base, None
    for _ in range(1 + COARSEST):
        try:
            pilots(family, sizes)
            return sizes
        except InputError as error:
            refused = refused or error
            for axis in range(len(sizes)):
                sizes = family.after(sizes, axis)
    assert refused is not None
    raise refused


def _tightened(pilots: Pilots, family: Family, sizes: Sizes, allowed: float) -> float:
    """Lower the tolerance until it makes less of the error than is allowed, seen on one mesh; what it makes."""
    while True:
        loose, tight = pilots(family, sizes), pilots(family, sizes, min(TOLERANCE, pilots.tolerance) / 100)
        made = distance(loose.values, tight.values, pilots.weights)
        if made <= allowed or pilots.tolerance / 10 < TIGHTEST:
            return made
        pilots.tolerance /= 10


def _climb(pilots: Pilots, climb: Climb, target: float, most: int, limit: float = float("inf")) -> Climb:
    """Refine until the error is below the target, the nodes would be too many, or the work would pass a limit."""
    family, quantity = climb.family, pilots.quantity
    highest = family.highest - 1 if quantity == "stress" else family.highest
    way: dict[int, tuple[list[int], list[float]]] = {axis: ([n], []) for axis, n in enumerate(climb.sizes)}  # of each direction
    fresh: set[int] = set()

    def look(axis: int) -> bool:
        """Estimate the error along a direction anew; False where that is too large to be solved."""
        there = family.after(climb.sizes, axis)
        ratio = there[axis] / climb.sizes[axis]
        if ratio * pilots(family, climb.sizes).nodes > most:
            return False
        change = distance(pilots(family, climb.sizes).values, pilots(family, there).values, pilots.weights)
        sizes, changes = way[axis]
        climb.parts[axis] = estimate([*sizes, there[axis]], [*changes, change], highest, quantity)
        changes_at[axis] = change
        fresh.add(axis)
        return True

    changes_at: dict[int, float] = {}
    while True:
        stale = [axis for axis in way if axis not in climb.parts]
        if not stale and climb.error <= target:
            stale = [axis for axis in way if axis not in fresh]
            if not stale:
                climb.ladder.append((climb.sizes, climb.error))
                climb.reached = True
                return climb
        if stale:
            if not all([look(axis) for axis in stale]):
                climb.ladder.append((climb.sizes, climb.error))
                return climb
            continue
        climb.ladder.append((climb.sizes, climb.error))
        work = pilots(family, climb.sizes).work
        grown = (climb.error / max(target, ROUNDING)) ** (len(way) / family.highest)  # of the nodes, at best
        if work * grown > limit:
            return climb
        axis = max(climb.parts, key=lambda one: climb.parts[one].error)
        climb.sizes = family.after(climb.sizes, axis)
        way[axis][0].append(climb.sizes[axis])
        way[axis][1].append(changes_at[axis])
        fresh.clear()
        before = climb.parts[axis]
        if not look(axis):  # what it was before, less by the order seen
            sizes = way[axis][0]
            climb.parts[axis] = replace(before, error=before.error * (sizes[-2] / sizes[-1]) ** before.order)
            climb.ladder.append((climb.sizes, climb.error))
            return climb
