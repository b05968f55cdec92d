"""A torch model of your own as a labelled point on the picture of speed against error, beside finite elements.

It is deliberately plain: the pose of the obstacle and its square, turned into displacements by one linear layer. What
matters is the way: inputs and target as tensors, a function from inputs to displacements, and `compare`, which times it
like every other predictor and holds it against the truth and the equations. It writes `report/pareto.png`, `report/report.html`.
"""

import torch

from datagen import inputs_of, trajectory_of
from learning import compare
from physics import read_scene

scene = read_scene({
    "body": {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [8, 2, 2]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 20},
    "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.0301], [0.05, 0.01, 0.0221]]},
})
trajectory = trajectory_of(scene)
seen, free = inputs_of(trajectory), torch.from_numpy(inputs_of(trajectory).free)
target = torch.from_numpy(trajectory.displacement[:, trajectory.body])[:, free].flatten(1)  # (T, 3 free nodes) [m]


def features(inputs):
    way = torch.from_numpy(inputs.pose[0] - inputs.pose).float()[:, 2:] / 0.008  # (T, 1) how far the obstacle has come
    return torch.cat([way, way**2], dim=1)


weights = torch.linalg.lstsq(features(seen)[::2], target[::2]).solution  # (2, 3 free nodes), from every second frame


def own_model(inputs):
    u = torch.from_numpy(inputs.held).clone()  # (T, N, 3) [m]
    u[:, free] = (features(inputs) @ weights).reshape(inputs.frames, -1, 3)
    return u.numpy()


with open("press.toml", "w") as file:
    file.write(scene.to_toml())
found = compare("press.toml", [], "report", functions=[own_model], only=["trivial"], refined=0, repeats=1)
rows = {row["name"]: row["scores"] for row in found["rows"]}
mine, idle = rows["own_model"], rows["nothing moves"]
print(f"{mine['ms_per_step']:.2g} ms a step, {1e3 * mine['rmsd_all']:.3g} mm off; {1e3 * idle['rmsd_all']:.3g} mm if nothing moved")
assert mine["ms_per_step"] > 0 and mine["rmsd_all"] < 0.05 * idle["rmsd_all"]
