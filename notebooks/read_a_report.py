# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # Read a report: find the worst frame, correct it
#
# A prediction is an array. Here it comes from a model that is wrong in a known way: Hooke's law with small strains, for a beam
# that is turned by a seventh of a radian. Put your own model's array in its place.

# %%
import dataclasses
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path.cwd() if (Path.cwd() / "physics").exists() else Path.cwd().parent))

import matplotlib.pyplot as plt
import numpy as np

from datagen.files.prediction import verify_files
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets.generate import trajectory_of
from physics.fidelity.correct import Corrector
from physics.fidelity.verify import Checker
from physics.mesh.build import build_mesh
from physics.scene import read_scene
from physics.solution import solve

folder = Path(tempfile.mkdtemp())
scene = read_scene({
    "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [20, 4, 4]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}], "steps": {"count": 40},
    "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.085, 0.01, 0.0305], [0.085, 0.01, 0.0205]]}})
write_trajectory(folder / "truth.vtkhdf", trajectory_of(scene))

hooke = dataclasses.replace(scene, material=dataclasses.replace(scene.material, law="linear"))
prediction = solve(hooke).displacement  # (T, N, 3) [m]

# %% [markdown]
# ## Bring a prediction
#
# Two lines: the array takes the place of the displacements in the truth's file. Obstacle nodes come after those of the body.

# %%
truth = read_trajectory(folder / "truth.vtkhdf")
mine = truth.displacement.copy()
mine[:, truth.body] = prediction
write_trajectory(folder / "mine.vtkhdf", dataclasses.replace(truth, displacement=mine, per_frame={}))

found = verify_files(folder / "mine.vtkhdf", folder / "truth.vtkhdf", folder / "report")
for name in found["units"]:
    print(f"{name:26s} {found[name]:.4g}")
print(f"{'worst_step':26s} {found['worst_step']}", found["verdict"], sep="\n")

# %% [markdown]
# How to read this. `rmsd_all` is the error, `relative_residual` the force that is missing to equilibrium: an error can be small
# and the forces nonsense, or the other way round. `estimated_error` is what the equations alone say about the error, and
# `effectivity` whether that may be believed: near 1 it may. `largest_penetration` tells whether the obstacle was seen.

# %%
assert 0.5 < found["effectivity"] < 2
step = found["worst_step"]
plt.figure(figsize=(12, 5))
plt.imshow(plt.imread(folder / "report" / "worst.png"))
plt.axis("off")
plt.show()

# %% [markdown]
# ## The worst frame, corrected
#
# Newton's method started from the prediction. Each step costs about as much as one of the solver, so the question is how many
# are needed; the residual says when to stop, without the truth.

# %%
mesh, last = build_mesh(scene.body), scene.steps.count
true, checker = truth.displacement[step, truth.body], Checker(scene, mesh)
u = prediction[step]
print("Newton steps   error [mm]   residual [N]")
errors = []
for count in range(6):
    errors.append(np.sqrt(np.mean(np.sum((u - true) ** 2, axis=1))))
    print(f"{count:12d} {1e3 * errors[-1]:12.6f} {checker.frame(u, step / last).residual:14.2e}")
    u = u + checker.correction(u, step / last)
assert errors[-1] < 1e-3 * errors[0]

# %% [markdown]
# ## The whole path, corrected
#
# One step for each frame with a factor of the stiffness that is kept from frame to frame; `fidelity rollout --correct 1` does
# this inside of a network's rollout.

# %%
for count in (1, 2):
    corrector = Corrector(scene, mesh, count=count)
    path = np.array([prediction[0]] + [corrector(prediction[t], t / last) for t in range(1, last + 1)])
    error = np.sqrt(np.mean(np.sum((path - truth.displacement[:, truth.body])[1:] ** 2, axis=2)))
    print(f"{count} a frame: {1e3 * error:.3g} mm, {corrector.factorisations} factors in {last} frames")
assert error < 0.1 * found["rmsd_all_all_nodes"]
