"""A trained network on scenes unlike those it was trained on: error, drift, cells turned inside out.

    .venv/bin/python -m benchmarks.stability RUN --data DIR                       scenes of the test split, changed
    .venv/bin/python -m benchmarks.stability RUN --data DIR --case large long

Each changed scene is solved by finite elements here, and the rollout is held against that at about FRAMES frames:

    as drawn            the scene itself
    never touches       the obstacle moves past, beside the body
    leaves again        and goes back the way it came
    coarse, fine        cells of twice and half the size
    large               the same number of scenes of the family beam-large
    long                2000 steps
    disturbed           (scheme "step") free nodes start from noise of 1e-3 m; a pose has no start

Means over the scenes, but the largest of "largest" and of "inverted cells".
"""

import tomllib
from dataclasses import replace

import numpy as np

from benchmarks import footing
from datagen.family.family import draw, load_family
from datagen.files.trajectory import read_trajectory
from datagen.sets.dataset import files
from datagen.sets.generate import trajectory_of
from learning.prediction.checkpoint import load_model
from learning.prediction.rollout import walk
from learning.samples.samples import build_example
from physics.fem import release
from physics.mesh.quality import det_f, rmsd
from physics.scene import read_scene
from physics.solution import solve

FRAMES = 50


def changed(scene, case):
    """The scene of a case."""
    body, obstacle = scene.body, scene.obstacle
    path = np.array(obstacle.path)
    if case == "never touches":
        way = np.array([0.0, 0.0, 3 * max(body.extent) * (1 if path[0, 2] > body.extent[2] / 2 else -1)])
        return replace(scene, obstacle=replace(obstacle, path=tuple(map(tuple, (path + way).tolist()))))
    if case == "leaves again":
        return replace(scene, obstacle=replace(obstacle, path=(*obstacle.path, *obstacle.path[-2::-1])))
    if case in ("coarse", "fine"):
        return replace(scene, body=replace(body, cell_size=body.cell_size * (2 if case == "coarse" else 0.5)))
    if case == "long":
        return replace(scene, steps=replace(scene.steps, count=2000))
    return scene


def measured(model, trajectory, disturbed=False):
    """The figures of one trajectory."""
    truth, free, body = trajectory.displacement, trajectory.free, trajectory.body
    last = len(truth) - 1
    frames = np.unique(np.linspace(0, last, min(FRAMES, last) + 1).round().astype(int))[1:]
    start = np.zeros(truth.shape[1:])
    if disturbed:
        start[free] = 1e-3 * np.random.default_rng(0).normal(size=(free.sum(), 3))
    blind = replace(trajectory, displacement=np.where(free[:, None], 0, truth).astype(np.float32))
    case = build_example(blind, model.config, targets=frames if model.config.scheme == "pose" else None)
    path = walk(model, case, start=start)
    error = np.array([rmsd(path[frame], truth[frame], free) for frame in frames])
    middle, end = (np.sqrt(np.mean(np.array_split(error, 10)[part] ** 2)) for part in (5, -1))
    footing.say(f"drift, root mean square error of the last tenth of the frames over that of the sixth: {end / max(middle, 1e-12):.2g}")
    alone, mesh = np.nan, trajectory.mesh
    if case.estimate is not None:
        alone = rmsd(case.estimate.displacement[np.searchsorted(case.estimate.frames, frames)], truth[frames], free)
    return {"RMSD-all [m]": np.sqrt(np.mean(error**2)), "estimate alone [m]": alone,
            "nothing moves [m]": rmsd(0 * truth[frames], truth[frames], free), "largest [m]": error.max(),
            "inverted cells": np.count_nonzero(~(det_f(mesh.points, path[frames][:, body], mesh.cells, mesh.cell) > 0), axis=-1).max()}


def main():
    names = ["as drawn", "never touches", "leaves again", "coarse", "fine", "large", "long", "disturbed"]
    parser = footing.parser(__doc__)
    parser.add_argument("run")
    parser.add_argument("--data", required=True)
    parser.add_argument("--count", type=int, default=3)
    parser.add_argument("--case", nargs="*", choices=names, default=names)
    options = parser.parse_args()
    model = load_model(options.run)
    scenes = [read_scene(tomllib.loads(read_trajectory(path).scene)) for path in files(options.data, "test")[:options.count]]
    large, table = load_family("beam-large"), footing.Table()
    for case in options.case:
        if case == "disturbed" and model.config.scheme == "pose":
            continue
        found = []
        for i, scene in enumerate(scenes):
            wanted = draw(large, 0, i) if case == "large" else changed(scene, case)
            solution = solve(wanted, partial=True)
            if solution.failure:
                footing.say(f"{case}: left out, {solution.failure}")
                continue
            found.append(measured(model, trajectory_of(wanted, solution=solution), case == "disturbed"))
            release()
        largest = ("largest [m]", "inverted cells")
        worst = {head: (max if head in largest else np.mean)([each[head] for each in found]) for head in (found[0] if found else {})}
        table.add({"case": case, "scenes": len(found)} | {head: None if np.isnan(value) else str(value) if head == "inverted cells"
                                                          else f"{value:.1e}" for head, value in worst.items()})


if __name__ == "__main__":
    main()
