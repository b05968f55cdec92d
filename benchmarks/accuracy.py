"""Errors of trained networks over whole rollouts, beside those of predictors that know nothing and of the estimate alone.

    .venv/bin/python benchmarks/accuracy.py RUN --data DIR                  the test split
    .venv/bin/python benchmarks/accuracy.py RUN --data DIR --every 5        a fifth of the frames
    .venv/bin/python benchmarks/accuracy.py RUN --data DIR --every 5 --kept estimates of an earlier call, whose time is not told

RMSE-1, RMSE-50 and RMSE-all [m] of free nodes as physics/fidelity/verify.py defines them, means over trajectories: one step from true
frames, steps 1 to 50 and all steps of a rollout. Times are processor milliseconds a frame of one thread.
"""

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np
import torch

from datagen.files.trajectory import read_trajectory
from datagen.sets.dataset import files
from learning.prediction.checkpoint import load_model
from learning.prediction.rivals import keep_velocity, nothing_moves
from learning.prediction.rollout import predict_step, rollout, walk
from learning.samples.samples import CACHE, build_example
from physics.mesh.quality import rmse

torch.set_num_threads(1)


def measured(path, steps, truth, frames, free):
    """The three errors of a path (T, N, 3) and its single steps (T - 1, N, 3), at some frames."""
    early = frames[frames <= 50]
    return [rmse(steps[frames - 1], truth[frames], free), rmse(path[early], truth[early], free), rmse(path[frames], truth[frames], free)]


def single_steps(path, truth):
    """Steps from true frames that a path of poses (T, N, 3) makes: u(t) + P(t + 1) - P(t)."""
    return truth[:-1] + (path[1:].astype(float) - path[:-1])


def errors(model, trajectory, every=1, kept=False):
    """name -> [RMSE-1, RMSE-50, RMSE-all], and name -> processor ms a frame, of one trajectory."""
    truth, free = trajectory.displacement, trajectory.free
    last = len(truth) - 1
    frames = np.arange(last, 0, -every)[::-1]
    found = {name: measured(*rule(truth, free), truth, frames, free)
             for name, rule in (("nothing moves", nothing_moves), ("keep the last velocity", keep_velocity))}
    spent = {}
    if model.config.scheme == "step":
        started = time.process_time()
        path = rollout(model, trajectory).displacement
        spent["network"] = 1e3 * (time.process_time() - started) / last
        found["network"] = measured(path, predict_step(model, trajectory), truth, frames, free)
        return found, spent
    targets = np.unique(np.concatenate([frames, frames - 1]))
    blind = replace(trajectory, displacement=np.where(free[:, None], np.float32(0), truth))
    started = time.process_time()
    case = build_example(blind, model.config, targets=targets[targets > 0], cache=CACHE if kept else None)
    middle = time.process_time()
    path = walk(model, case)
    found["network"] = measured(path, single_steps(path, truth), truth, frames, free)
    spent["network"] = 1e3 * (time.process_time() - middle) / len(case.targets)
    if case.estimate is not None:
        path = blind.displacement.copy()
        path[case.targets] = case.estimate.displacement
        found["estimate alone"] = measured(path, single_steps(path, truth), truth, frames, free)
        if not kept:
            spent["estimate alone"] = 1e3 * (middle - started) / len(case.targets)
    return found, spent


def table(model, paths, every=1, kept=False):
    """Means over trajectories: name -> {"rmse_1", "rmse_50", "rmse_all", "ms"}, and RMSE-all of the network for each."""
    every_one, times = [], []
    for path in paths:
        found, spent = errors(model, read_trajectory(path), every, kept)
        every_one.append(found)
        times.append(spent)
    rows = {name: dict(zip(("rmse_1", "rmse_50", "rmse_all"), np.mean([each[name] for each in every_one], axis=0).tolist(), strict=True))
            | ({"ms": float(np.mean([spent[name] for spent in times]))} if name in times[0] else {}) for name in every_one[0]}
    return rows, [each["network"][2] for each in every_one]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("run")
    parser.add_argument("--data", required=True)
    parser.add_argument("--split", default="test")
    parser.add_argument("--count", type=int, help="only the first trajectories")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--kept", action="store_true")
    options = parser.parse_args()
    rows, each = table(load_model(options.run), files(options.data, options.split)[:options.count], options.every, options.kept)
    print(json.dumps({"trajectories": len(each), "every": options.every, "m": rows, "network_rmse_all_each": each}, indent=1))


if __name__ == "__main__":
    main()
