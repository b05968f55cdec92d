"""Which mesh has the frequencies of a body's modes to an error that is asked? The way of choose.py, with the modes themselves for pilots.

The error is the root mean square over the modes of how far each frequency is off, over that frequency: of a mesh, f - f_exact falls as
h^2 for cells of first order and as h^4 for those of second, less at clamped edges. Modes without frequency, motions of the whole body, are
exact on any mesh. Modes are compared by their number, so that those of close frequencies may change places.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.accuracy.choose import MESH, MOST_NODES, climbed
from physics.accuracy.climb import Climb
from physics.accuracy.meshes.ladder import MeshFamily, Sizes, families
from physics.accuracy.pilot import Pilot
from physics.accuracy.table import Verdict, row, rows_of_mesh
from physics.modes.elastic import Modes, elastic_modes
from physics.scene import Scene

SMALL = 1e-6  # of a body is its motion where modes tell how to grade a mesh
STILL = 1e-6  # of the highest frequency: a mode below it is a motion of the whole body


class Frequencies:
    """The modes of a scene's body on its meshes, each found once; used as `Pilots` are, with one pose and values (1, m, 1) [Hz].

    Raises `InputError`: the mesh has fewer free components than modes are asked for.
    """

    quantity, fractions, count = "frequency", np.ones(1), 1

    def __init__(self, modes: int) -> None:
        self.modes, self.seconds = modes, 0.0
        self.weights: NDArray[np.float64] = np.zeros(modes)
        self._known: dict[tuple[int, Sizes], tuple[Pilot, Modes]] = {}

    def __call__(self, family: MeshFamily, sizes: Sizes) -> Pilot:
        if (family.order, sizes) not in self._known:
            started = time.process_time()
            scene, mesh = family.rung(sizes)
            found = elastic_modes(scene, count=self.modes, mesh=mesh)
            values = np.asarray(found.frequencies_hz, float)
            if not self._known:
                moving = values > STILL * values.max()
                self.weights = np.where(moving, 1 / np.where(moving, values, 1.0) ** 2, 0.0)
            pilot = Pilot(mesh, values[None, :, None], np.zeros((1, 0, 3)), time.process_time() - started)
            self._known[family.order, sizes] = pilot, found
            self.seconds += pilot.seconds
            moving = found.shapes[self.weights > 0]
            family.learn(sizes, moving * (SMALL * np.ptp(mesh.points) / abs(moving).max(axis=(1, 2), keepdims=True)))
        return self._known[family.order, sizes][0]

    def __len__(self) -> int:
        return len(self._known)

    def solved(self, order: int) -> list[tuple[Sizes, Pilot]]:
        """All meshes of an order that were solved, in their order."""
        return [(sizes, pilot) for (one, sizes), (pilot, _) in self._known.items() if one == order]

    def found(self, climb: Climb) -> Modes:
        """On the mesh where a climb is."""
        return self._known[climb.family.order, climb.sizes][1]


@dataclass(frozen=True)
class ChosenModes:
    """scene: with the mesh that was chosen, asking for nothing; modes: on it; verdict: what is known of their error."""

    scene: Scene
    modes: Modes
    verdict: Verdict


def choose_modes(scene: Scene, count: int, most: int = MOST_NODES) -> ChosenModes:
    """The lowest modes of a body on the cheapest mesh that keeps the error which a scene asks for, or the finest one tried.

    Args: most: nodes of a mesh. Raises as `elastic_modes`.
    """
    asked = scene.steps.error
    assert asked is not None
    kinds = sorted(families(scene), key=lambda family: family.order)
    pilots = Frequencies(count)
    best, other = climbed([Climb(kind, pilots, MESH * asked, most, kind.base) for kind in kinds])
    modes = pilots.found(best)
    rows = [*rows_of_mesh(best), row("the whole body", f"{best.family.said(best.sizes)}; {best.said}", best.error, best.pilot.seconds)]
    if other is not None:
        sizes, error = other.ladder[-1]
        rows.append(row("the other order", other.family.said(sizes) + ("" if other.reached else ", given up"), error,
                        pilots(other.family, sizes).seconds))
    rows.append(row("the search", f"{len(pilots)} meshes", None, pilots.seconds))
    remarks = ("the error does not fall regularly: the larger of two differences is taken",) * (best.how == "irregular")
    return ChosenModes(best.family.rung(best.sizes)[0], modes,
                       Verdict(asked, "frequency", best.error, best.reached, tuple(rows), remarks))
