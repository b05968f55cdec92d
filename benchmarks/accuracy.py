"""Errors of trained networks over whole rollouts, beside those of predictors that know nothing and of the estimate alone.

    .venv/bin/python -m benchmarks.accuracy RUN --data DIR [DIR ...]            the test split of each
    .venv/bin/python -m benchmarks.accuracy RUN --data DIR --every 5            a fifth of the frames
    .venv/bin/python -m benchmarks.accuracy RUN --data DIR --every 5 --kept     estimates of an earlier call, whose time is not told

RMSE-1, RMSE-50 and RMSE-all [m] of a coordinate of free nodes, as papers count: one step from true frames, steps 1 to 50 and all steps
of a rollout, root of the mean square over frames and trajectories at once; by step: the mean of every frame's own root.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import footing
from datagen.files.trajectory import read_trajectory
from datagen.sets.dataset import files
from learning.prediction.checkpoint import load_model
from learning.prediction.rivals import keep_velocity, nothing_moves
from learning.prediction.rollout import predict_step, rollout, walk
from learning.samples.samples import CACHE, build_example
from physics.mesh.quality import rmsd, rmse

ERRORS = ("RMSD-1", "RMSD-50", "RMSD-all")  # means over trajectories
AS_PUBLISHED = ("RMSE-1", "RMSE-50", "RMSE-all", "RMSE-all, by step")
# Lei et al. 2025, M4GN, on their own data set
PUBLISHED = (1.17e-5, 3.4e-5, 1.87e-4)


def measured(path, steps, truth, frames, free):
    """The errors of a path (T, N, 3) and its single steps (T - 1, N, 3), at some frames."""
    early = frames[frames <= 50]
    shown = [(steps[frames - 1], truth[frames], free), (path[early], truth[early], free), (path[frames], truth[frames], free)]
    return [*(rmsd(*each) for each in shown), *(rmse(*each) for each in shown), rmse(*shown[2], by_step=True)]


def single_steps(path, truth):
    """Steps from true frames that a path of poses (T, N, 3) makes: u(t) + P(t + 1) - P(t)."""
    return truth[:-1] + (path[1:].astype(float) - path[:-1])


def errors(model, trajectory, every=1, kept=False):
    """name -> the seven errors, and name -> processor ms a frame, of one trajectory."""
    truth, free = trajectory.displacement, trajectory.free
    last = len(truth) - 1
    frames = np.arange(last, 0, -every)[::-1]
    found = {name: measured(*rule(truth, free), truth, frames, free)
             for name, rule in (("nothing moves", nothing_moves), ("keep the last velocity", keep_velocity))}
    spent = {}
    if model.config.scheme == "step":
        seconds, rolled = footing.cost(rollout, model, trajectory)
        spent["network"] = 1e3 * seconds / last
        found["network"] = measured(rolled.displacement, predict_step(model, trajectory), truth, frames, free)
        return found, spent
    targets = np.unique(np.concatenate([frames, frames - 1]))
    blind = replace(trajectory, displacement=np.where(free[:, None], np.float32(0), truth))
    built, case = footing.cost(build_example, blind, model.config, targets=targets[targets > 0], cache=CACHE if kept else None)
    walked, path = footing.cost(walk, model, case)
    found["network"] = measured(path, single_steps(path, truth), truth, frames, free)
    spent["network"] = 1e3 * walked / len(case.targets)
    if case.estimate is not None:
        path = blind.displacement.copy()
        path[case.targets] = case.estimate.displacement
        found["estimate alone"] = measured(path, single_steps(path, truth), truth, frames, free)
        if not kept:
            spent["estimate alone"] = 1e3 * built / len(case.targets)
    return found, spent


def means(model, paths, every=1, kept=False):
    """Over trajectories: predictor -> {an error: its value, "ms": milliseconds}."""
    every_one = [errors(model, read_trajectory(path), every, kept) for path in paths]
    footing.say("network, RMSE-all [m] of each: " + " ".join(f"{found['network'][5]:.1e}" for found, _ in every_one))
    first, spent = every_one[0]
    each = {name: np.array([found[name] for found, _ in every_one]) for name in first}
    return {name: dict(zip(ERRORS, each[name][:, :3].mean(axis=0).tolist(), strict=True))
            | dict(zip(AS_PUBLISHED, [*np.sqrt((each[name][:, 3:6] ** 2).mean(axis=0)), each[name][:, 6].mean()], strict=True))
            | ({"ms": float(np.mean([times[name] for _, times in every_one]))} if name in spent else {}) for name in first}


def main():
    parser = footing.parser(__doc__)
    parser.add_argument("run")
    parser.add_argument("--data", required=True, nargs="+")
    parser.add_argument("--split", default="test")
    parser.add_argument("--count", type=int, help="only the first trajectories")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--kept", action="store_true")
    options = parser.parse_args()
    model, table = load_model(options.run), footing.Table()
    found = {Path(data).name: means(model, files(data, options.split)[:options.count], options.every, options.kept)
             for data in options.data}
    for name in next(iter(found.values())):
        table.add({"[m]": Path(options.run).name if name == "network" else name}
                  | {f"{data}: {error}": f"{rows[name][error]:.1e}" for data, rows in found.items() for error in AS_PUBLISHED})
        for data, rows in found.items():
            if "ms" in rows[name]:
                footing.say(f"{data}, {name}: {rows[name]['ms']:.3g} ms a frame")
    table.add({"[m]": "M4GN as published, on the original set"}
              | {f"{next(reversed(found))}: {error}": f"{value:.2e}" for error, value in zip(AS_PUBLISHED, PUBLISHED, strict=False)})


if __name__ == "__main__":
    main()
