# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # Pressing a beam: equilibrium, and motion
#
# A rigid cylinder presses a clamped rubber beam down, moves on along it, and slides off its end. We look at the force that it
# takes, at what the solver decided to model, and at the same beam once slow and once fast.

# %%
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path.cwd() if (Path.cwd() / "physics").exists() else Path.cwd().parent))

import matplotlib.pyplot as plt
import numpy as np

from datagen.sets.generate import trajectory_of
from physics.contact.obstacles import Rigid
from physics.modes.elastic import elastic_modes
from physics.scene import read_scene
from physics.solution import solve

# %% [markdown]
# ## The scene
#
# The way-points of the path are reached at equal fractions of the steps: 18 mm down onto the beam, then 40 mm along it, past its end.

# %%
scene = read_scene({
    "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [20, 4, 4]},
    "material": {"young_modulus": 1e6, "poisson_ratio": 0.4, "density": 1000.0},
    "support": [{"where": "x-min"}],
    "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.08, 0.01, 0.0302], [0.08, 0.01, 0.012], [0.125, 0.01, 0.012]]},
    "steps": {"count": 160},
})

# %% [markdown]
# ## Through equilibria
#
# Inertia is left out: each step is an equilibrium. Towards the end of the beam the cylinder loses its hold, the equilibrium
# that the beam was in ends, and it springs back. Step and way of such a jump are reported.

# %%
solution = solve(scene)
assert not solution.failure and solution.relative_residual.max() <= 1e-6
print(f"{len(solution.displacement) - 1} steps in {solution.seconds:.2f} s, {solution.newton_iterations.sum()} Newton steps")
for what, why in trajectory_of(scene, solution=solution).extra["model"].items():
    print(f"  {what}: {why}")

# %%
fraction = np.linspace(0, 1, scene.steps.count + 1)
cylinder = np.array([Rigid(scene.obstacle).position(f) for f in fraction])
path = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(cylinder, axis=0), axis=1))])
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4))
for axis, name in ((0, "along the beam"), (2, "across it")):
    left.plot(1e3 * path, solution.reaction[:, axis], label=name)
left.set(xlabel="path of the cylinder [mm]", ylabel="reaction [N]")
left.legend()
side = abs(solution.mesh.points[:, 1]) < 1e-9
for step in (0, 40, 80, 120, 160):
    x = (solution.mesh.points + solution.displacement[step])[side]
    line, = right.plot(1e3 * x[:, 0], 1e3 * x[:, 2], ".", markersize=3)
    right.add_patch(plt.Circle(1e3 * cylinder[step, [0, 2]], 10, fill=False, color=line.get_color()))
right.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
plt.show()
assert np.linalg.norm(solution.reaction[-1]) < 1e-6 * np.linalg.norm(solution.reaction, axis=1).max()  # it has slid off

# %% [markdown]
# The work of the cylinder is stored in the beam, as long as it moves through equilibria; what it springs back with is gone.

# %%
push = -np.sum((solution.reaction[1:] + solution.reaction[:-1]) / 2 * np.diff(cylinder, axis=0), axis=1)
work = np.concatenate([[0], np.cumsum(push)])
plt.plot(1e3 * path, solution.energy, label="stored")
plt.plot(1e3 * path, work, "--", label="work of the cylinder")
plt.xlabel("path of the cylinder [mm]")
plt.ylabel("energy [J]")
plt.legend()
plt.show()
pressed = scene.steps.count // 2
assert abs(work[pressed] / solution.energy[pressed] - 1) < 0.01

# %% [markdown]
# ## Small strain is enough for a small load
#
# The solver estimates what finite strain would add to a linear solution, and spares it where that is nothing.

# %%
for traction in (1.0, 100.0):
    light = read_scene({"body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [20, 4, 4]},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}],
                        "load": [{"where": "x-max", "traction": [0.0, 0.0, -traction]}], "steps": {"count": 50}})
    small = solve(light)
    print(f"{traction:g} Pa, {small.seconds:.2f} s: {small.model['kinematics']}")
assert solve(replace(light, load=(replace(light.load[0], traction=(0.0, 0.0, -1.0)),))).linear_steps == 50

# %% [markdown]
# ## With inertia
#
# `dynamic = true` and a duration give the beam its mass. Slow, the force is that of the equilibria; fast, it is not, and once the
# cylinder has passed the beam swings on by itself with the energy that it has.

# %%
period = 1 / float(elastic_modes(scene, count=1).frequencies_hz[0])
plt.plot(fraction, solution.reaction[:, 2], "k", label="equilibria")
for periods in (40, 2):
    steps = replace(scene.steps, dynamic=True, duration=periods * period, count=800)
    moving = solve(replace(scene, steps=steps))
    swing = abs(moving.reaction[:401:5, 2] - solution.reaction[:81, 2]).max() / solution.reaction[:81, 2].max()
    print(f"in {periods} periods the force of the first leg is off by up to {swing:.2g} of the largest")
    plt.plot(np.linspace(0, 1, 801), moving.reaction[:, 2], linewidth=0.8, label=f"in {periods} periods of the first mode")
plt.xlabel("fraction of the path")
plt.ylabel("reaction [N]")
plt.legend()
plt.show()

# %%
touched = np.flatnonzero(np.linalg.norm(moving.reaction, axis=1) > 0)
free = slice(touched[-1] + 1, None)
energy = moving.energy + moving.kinetic_energy
time = np.linspace(0, 2 * period, 801)
plt.plot(time, moving.energy, label="stored")
plt.plot(time, moving.kinetic_energy, label="kinetic")
plt.plot(time, energy, "k", label="sum")
plt.xlabel("time [s]")
plt.ylabel("energy [J]")
plt.legend()
plt.show()
print(f"after the last touch the energy changes by {np.ptp(energy[free]) / energy[free].mean():.1e} of itself")
assert np.ptp(energy[free]) < 1e-4 * energy[free].mean()
