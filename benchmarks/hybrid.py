"""What one Newton step makes of a prediction, beam by beam, those that slide included.

    ./run fidelity generate beam --split test --seed 77 --count 12 --out beam77
    .venv/bin/python -m benchmarks.hybrid beam77            one row for each beam and prediction
    .venv/bin/python -m benchmarks.hybrid beam77 --trained  the trained network's alone
    .venv/bin/python -m benchmarks.hybrid beam77 --start    what predictions save as the start of finite elements

Two predictions are made up, so that the worst of each kind is known: the truth with a smooth error of 3e-5 m root mean square
that changes along the path, which stretches and shears the body besides bending it; the truth three frames late. Beside them
stands a trained network of this family. Errors are root mean squares over all components. Two more bodies are driven until they
slip off their obstacle and come to rest elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks import footing
from datagen.files.trajectory import Trajectory
from datagen.sets.dataset import files
from learning.prediction.checkpoint import load_model
from learning.prediction.rollout import rollout
from learning.report.evaluate import load_cases
from physics.equilibrium.path import LoadPath
from physics.fidelity.along import corrected_path
from physics.fidelity.correct import Corrector, Floats
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.solution import solve
from tests.hard_cases import SLIPPING

LATE, OFF, WAVES = 3, 3e-5, 12
TRAINED = "assets/m4gn-fast"
Case = tuple[str, Scene, Mesh, Floats, Trajectory | None]  # name, and the truth (T, N, 3)


def smooth(mesh: Mesh, frames: int, fixed: np.ndarray, seed: int) -> Floats:
    """(T, N, 3) waves of some half-wavelengths along the body and across it, in all components; zero at held nodes."""
    rng = np.random.default_rng(seed)
    places = (mesh.points - mesh.points.min(axis=0)) / np.ptp(mesh.points, axis=0)
    held = mesh.points[fixed.any(axis=1), 0]
    fade = np.minimum(1.0, 8 * abs(mesh.points[:, :1] - held).min(axis=1) / np.ptp(mesh.points[:, 0]))
    error = np.zeros((frames, *mesh.points.shape))
    for _ in range(WAVES):
        along, turns = rng.uniform(0, 3, 3) * [1, 0.3, 0.3], rng.uniform(0.3, 2)
        wave = np.cos(np.pi * places @ along + rng.uniform(0, 2 * np.pi))[:, None] * rng.normal(size=3)
        error += np.cos(2 * np.pi * turns * np.linspace(0, 1, frames) + rng.uniform(0, 2 * np.pi))[:, None, None] * wave
    error *= np.where(fixed, 0.0, fade[:, None])
    return error * OFF / np.sqrt((error**2).mean())


def predictions(case: Case, fixed: np.ndarray) -> Iterator[tuple[str, Floats]]:
    name, _, mesh, truth, trajectory = case
    yield "smooth error", truth + smooth(mesh, len(truth), fixed, sum(name.encode()))
    yield f"{LATE} frames late", truth[np.maximum(np.arange(len(truth)) - LATE, 0)]
    if trajectory is not None:
        yield TRAINED, rollout(load_model(TRAINED), trajectory).displacement[:, trajectory.body].astype(np.float64)


def cases(folder: str, *, slipping: bool) -> Iterator[Case]:
    for found in load_cases(files(folder, "test")):
        yield found.name, found.scene, found.mesh, found.truth.astype(np.float64), found.trajectory
    for name, scene in SLIPPING.items() if slipping else ():
        solution = solve(scene)
        yield name, scene, solution.mesh, solution.displacement, None


def rms(error: Floats) -> Floats:
    return np.sqrt((error**2).mean(axis=(-2, -1)))


class Led(LoadPath):
    """The solver's path, begun at some fractions of the loading where it is told to."""

    starts: dict[float, Floats]

    def _predict(self, fraction: float) -> Floats:
        return self.starts[fraction] if fraction in self.starts else super()._predict(fraction)


def elements(scene: Scene, mesh: Mesh, count: int, starts: dict[int, Floats]) -> tuple[float, float]:
    """Processor milliseconds and Newton steps a frame of the solver's path, some frames begun at given displacements (N, 3)."""
    path = Led(scene, mesh)
    path.starts = {frame / count: start for frame, start in starts.items()}

    seconds, iterations = footing.cost(lambda: sum(path.advance(frame / count).iterations for frame in range(1, count + 1)))
    return 1e3 * seconds / count, iterations / count


def corrected(scene: Scene, mesh: Mesh, guess: Floats) -> tuple[float, Corrector, set[int], Floats]:
    """Processor seconds, the corrector, the frames that it was asked for, and what comes of the guess (T, N, 3)."""
    corrector, last, asked = Corrector(scene, mesh, count=1), len(guess) - 1, set()

    def correct(u: Floats, frame: int) -> Floats:
        asked.add(frame)
        return corrector(u, frame / last)

    seconds, after = footing.cost(lambda: corrected_path(correct, guess, corrector.share))
    return seconds, corrector, asked, after


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("folder")
    parser.add_argument("--start", action="store_true")
    parser.add_argument("--trained", action="store_true")
    options = parser.parse_args()
    table = footing.Table()
    for case in cases(options.folder, slipping=not options.trained):
        name, scene, mesh, truth, _ = case
        last = len(truth) - 1
        alone, steps = elements(scene, mesh, last, {})
        fixed = Corrector(scene, mesh).balance.fixed
        if options.start:
            row = {"body": name, "nodes": len(mesh.points), "FE [ms a frame]": alone, "Newton steps a frame": steps}
            wrong = truth + smooth(mesh, len(truth), fixed, sum(name.encode()))
            for kind, guess, every in (("the truth, each frame", truth, 1), ("the truth, each tenth", truth, 10),
                                       ("smooth error, each tenth", wrong, 10)):
                found = elements(scene, mesh, last, {frame: guess[frame] for frame in range(every, last + 1, every)})
                row |= {f"{kind} [ms]": found[0], f"{kind}, steps": found[1]}
            table.add(row)
            continue
        for kind, guess in predictions(case, fixed):
            if options.trained and kind != TRAINED:
                continue
            seconds, corrector, asked, after = corrected(scene, mesh, guess)
            before, left = rms(guess - truth)[1:], rms(after - truth)[1:]
            wrong_at = before > 1e-8  # the rest were right
            table.add({"body": name, "nodes": len(mesh.points), "prediction": kind, "off by [m]": float(np.sqrt((before**2).mean())),
                       "after [m]": float(np.sqrt((left**2).mean())), "times better": float(np.linalg.norm(before) / np.linalg.norm(left)),
                       "in its worst frame": float((before / np.maximum(left, 1e-9))[wrong_at].min(initial=np.inf)),
                       "frames corrected": len(asked), "Newton steps": corrector.iterations, "ms a frame": 1e3 * seconds / last,
                       "FE [ms a frame]": alone})


if __name__ == "__main__":
    main()
