"""A test case and what predicts it, learned or not: the one interface of everything that a report compares.

Legend: T frames (the rest state first), N nodes of the body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import Trajectory
from physics.mesh.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.floating[Any]]


class LeftOut(Exception):
    """A predictor that cannot be measured on a case; the message completes "because in this case ..."."""


@dataclass(frozen=True)
class Case:
    """A test trajectory with its scene, None where it has none, the mesh that it was solved on, and its file, by whose name predictions
    are found."""

    name: str
    trajectory: Trajectory
    known: Scene | None
    mesh: Mesh
    file: Path | None = None

    @property
    def scene(self) -> Scene:
        """The scene. Raises `LeftOut` where there is none."""
        if self.known is None:
            raise LeftOut("there is no scene, and so there are no equations")
        return self.known

    @property
    def truth(self) -> NDArray[np.float32]:
        """(T, N, 3) displacement of the body."""
        return self.trajectory.displacement[:, self.trajectory.body]

    @property
    def free(self) -> NDArray[np.bool_]:
        """(N,) True on the body's nodes that are not held."""
        return self.trajectory.free[self.trajectory.body]

    @property
    def steps(self) -> int:
        return len(self.trajectory.displacement) - 1


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What one predictor says about one case, and what that cost.

    path: (T, N, 3) displacements
    one_step: (T - 1, N, 3) predictions of frames 1 .. T - 1, each from the true frame before; None when it starts from none
    seconds: processor time of all steps; set_up: before the first one, spent anew on each scene
    wall: time of both by the clock on the wall, where it is known
    iterations: Newton steps in all, where there are any
    fields: (T, N, k) each, what is told beside displacements, on the nodes of the file, obstacle included
    bar, unsure: (T,) error bar [m] of each frame, and whether the predictor says that it does not know; None where it cannot say
    """

    path: Floats
    one_step: Floats | None = None
    seconds: float
    set_up: float = 0.0
    wall: float = np.nan
    iterations: int | None = None
    fields: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    bar: Floats | None = None
    unsure: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Predictor:
    """A name, one of table.KINDS, and a function that predicts a case or raises `LeftOut`."""

    name: str
    kind: str
    predict: Callable[[Case], Prediction]
