"""What of a measurement is shown frame by frame: the trajectory that the networks find hardest, by every predictor, and worst frames."""

from __future__ import annotations

from learning.prediction.predictor import Case
from learning.prediction.rivals import REFERENCE
from learning.report.measure import Measurement, WorstFrame
from learning.report.table import best_learned
from physics.scene import Materials
from physics.view import Exhibit, ObstacleSurface, path_exhibit

WORST = 5  # frames


def worst_frames(found: Measurement) -> list[WorstFrame]:
    """The worst frame of each of the worst trajectories of the best network, the worst trajectory first."""
    best = best_learned(found.rows)
    frames = [frame for frame in found.frames if best is not None and frame.predictor == best.name]
    return sorted(frames, key=lambda frame: -frame.error)[:WORST]


def exhibits(found: Measurement) -> list[Exhibit]:
    """One whole trajectory with the paths of all predictors, then the worst frames, each beside the truth."""
    shown = []
    if found.hardest is not None:
        case, paths = found.hardest.case, found.hardest.paths
        shown.append(path_exhibit(f"Test trajectory {case.name}, every predictor", case.mesh, paths | {_truth(case): case.truth},
                                  _material(case), truth=_truth(case), obstacle=_obstacle(case, 0, case.steps + 1)))
    for frame in worst_frames(found):
        case, step = frame.case, frame.step
        paths = {frame.predictor: frame.displacement[None], _truth(case): case.truth[step:step + 1]}
        shown.append(path_exhibit(f"Worst frame of {case.name}", case.mesh, paths, _material(case), truth=_truth(case), first=step,
                                  steps=case.steps, obstacle=_obstacle(case, step, step + 1)))
    return shown


def _truth(case: Case) -> str:
    """What the truth is called."""
    return "the data" if case.known is None else REFERENCE


def _material(case: Case) -> Materials | None:
    """The material, without which there is no stress; None where it is not known."""
    return None if case.known is None else case.known.material


def _obstacle(case: Case, first: int, end: int) -> ObstacleSurface | None:
    """The obstacle in some frames."""
    if (surface := case.trajectory.obstacle) is None:
        return None
    return ObstacleSurface(surface[0][first:end], surface[1])
