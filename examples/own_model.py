"""A torch model of your own, trained on a trajectory and held against the equations.

The model is deliberately plain: a few numbers for each frame, turned into displacements by a linear layer. What matters
is the end: its predictions on frames that it has not seen are written as a file like any other, and `verify_files` says
how far they are from the truth and, without looking at the truth, how far the equations think they are. The ratio of
the two, the effectivity, is near 1 when that may be believed.
"""

from dataclasses import replace

import torch

from datagen import read_trajectory, trajectory_of, verify_files, write_trajectory
from physics import read_scene

write_trajectory("truth.vtkhdf", trajectory_of(read_scene({
    "body": {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [12, 4, 4]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
    "support": [{"where": "x-min"}],
    "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.0301], [0.05, 0.01, 0.0221]]},
    "steps": {"count": 40},
})))

truth = read_trajectory("truth.vtkhdf")
free = torch.from_numpy(truth.free)
target = 1e3 * torch.from_numpy(truth.displacement)[:, free].flatten(1)  # (T, 3 nodes) [mm]
time = torch.linspace(0, 1, len(target))[:, None]
powers = torch.cat([time, time**2, time**3], dim=1)  # (T, 3)

torch.manual_seed(0)
model = torch.nn.Linear(3, target.shape[1], bias=False)
optimizer = torch.optim.LBFGS(model.parameters(), max_iter=200, line_search_fn="strong_wolfe")


def loss() -> torch.Tensor:
    optimizer.zero_grad()
    value = (model(powers[::2]) - target[::2]).square().mean()  # every second frame
    value.backward()
    return value


optimizer.step(loss)
predicted = truth.displacement.copy()
predicted[:, truth.free] = 1e-3 * model(powers).detach().reshape(len(target), -1, 3).numpy()
write_trajectory("mine.vtkhdf", replace(truth, displacement=predicted, per_frame={}))

found = verify_files("mine.vtkhdf", "truth.vtkhdf")
print(f"error {1e3 * found['rmse_all']:.4f} mm, by the equations alone {1e3 * found['estimated_error']:.4f} mm: "
      f"effectivity {found['effectivity']:.2f}")
assert found["rmse_all"] < 1e-4 and 0.7 < found["effectivity"] < 1.4
