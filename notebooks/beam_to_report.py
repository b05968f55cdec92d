# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # One beam, from its scene to a report
#
# A soft beam is clamped at one end and pressed by a rigid cylinder. We solve for its motion with finite elements, teach a
# small network to imitate it, let the network run on its own, and then ask not only how far it is from the truth, but
# whether what it says is a possible state of a beam at all.

# %%
import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path.cwd() if (Path.cwd() / "physics").exists() else Path.cwd().parent))

import matplotlib.pyplot as plt
import numpy as np

from datagen.files.trajectory import write_trajectory
from datagen.sets.generate import trajectory_of
from learning.config import TrainConfig
from learning.prediction.checkpoint import load_model
from learning.prediction.rivals import nothing_moves
from learning.prediction.rollout import predict_step, rollout
from learning.segments.cut import segment
from learning.segments.quality import segment_quality
from learning.training.train import train
from physics.fidelity.verify import verify
from physics.mesh.build import build_mesh
from physics.scene import load_scene
from physics.schema import read_table
from physics.solution import solve
from physics.view import frame_picture

folder = Path(tempfile.mkdtemp())
seconds = float(os.environ.get("NOTEBOOK_TRAINING_SECONDS", "60"))

# %% [markdown]
# ## The scene
#
# A scene is a text file with units and bounds for every value; what it does not say has a default.

# %%
(folder / "press.toml").write_text("""
name = "press"

[body]
length = 0.1      # [m]
width = 0.02
height = 0.02
cells = [20, 4, 4]

[material]
young_modulus = 1e6   # [Pa]
poisson_ratio = 0.4

[[support]]
where = "x-min"
fixed = "xyz"

[obstacle]
shape = "cylinder"
radius = 0.01
path = [[0.085, 0.01, 0.0305], [0.085, 0.01, 0.0105]]

[steps]
count = 60
""")
scene = load_scene(folder / "press.toml")

# %% [markdown]
# ## The truth
#
# Every step is an equilibrium: the residual force stays below a millionth of the reaction, nothing penetrates.

# %%
solution = solve(scene)
print(f"{len(solution.displacement) - 1} steps in {solution.seconds:.2f} s, {solution.newton_iterations.sum()} Newton steps, "
      f"{solution.factorisations} factorisations")
print(f"largest residual {solution.relative_residual.max():.1e}, penetration {solution.penetration.max():.1e} m, "
      f"smallest det F {solution.smallest_det_f.min():.3f}")
for what, why in solution.model.items():
    print(f"  {what}: {why}")

# %% [markdown]
# The work of the obstacle is stored in the beam. Nothing in the solver enforces that; it has to come out.

# %%
height = np.linspace(0.0305, 0.0105, 61)
push = -solution.reaction[:, 2]
work = np.concatenate([[0], np.cumsum((push[1:] + push[:-1]) / 2 * np.diff(height))])
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4))
left.plot(1e3 * (height[0] - height), solution.reaction[:, 2])
left.set(xlabel="path of the cylinder [mm]", ylabel="reaction [N]")
right.plot(solution.energy, label="stored")
right.plot(work, "--", label="work of the cylinder")
right.set(xlabel="step", ylabel="energy [J]")
right.legend()
plt.show()
assert abs(work[-1] / solution.energy[-1] - 1) < 0.01

# %% [markdown]
# ## The trajectory file, and segments
#
# The file opens in ParaView as it is. The mesh is cut into segments that follow the first elastic mode and the distance to
# the obstacle.

# %%
trajectory = trajectory_of(scene, solution=solution)
write_trajectory(folder / "press.vtkhdf", trajectory)
label = segment(trajectory, count=12)
quality = segment_quality(trajectory, label)
print(f"{label.max()} segments and the obstacle; " + ", ".join(f"{name} {value:.3f}" for name, value in quality.items()))

# %% [markdown]
# ## A network that has seen this one beam
#
# Learned and tested on the same trajectory, so this says nothing about other beams; `./run demo` does that.

# %%
config = read_table(TrainConfig, {
    "segments": 12, "contact_radius": 0.006, "batch_size": 2, "budget_seconds": seconds, "learning_rate": 1e-3,
                      "final_learning_rate": 1e-5, "validate_every": 10_000,
                      "network": {"hidden": 32, "message_steps": 3, "transformer_layers": 1, "heads": 4}})
summary = train(config, [folder / "press.vtkhdf"], [], folder / "run")
print(f"{summary['steps']} steps of training in {summary['seconds']:.0f} s, loss {summary['loss']:.3g}")

# %%
model = load_model(folder / "run")
prediction = rollout(model, trajectory)
one_step = predict_step(model, trajectory)

# %% [markdown]
# ## Held against finite elements
#
# The rest state is in equilibrium, so "nothing moves" has no residual force at all; it only lets the cylinder through. One
# number is never enough.

# %%
mesh = build_mesh(scene.body)
free = trajectory.free[trajectory.body]
truth = trajectory.displacement[:, trajectory.body]
rest, rest_step = nothing_moves(truth, free)
rows = {"network": (prediction.displacement[:, trajectory.body], one_step[:, trajectory.body]), "nothing moves": (rest, rest_step),
        "finite elements": (truth, truth[1:])}
scores = {name: verify(u, truth, scene=scene, mesh=mesh, free=free, one_step=step) for name, (u, step) in rows.items()}
print(f"{'':16s} RMSD-1 [mm]  RMSD-all [mm]  residual/reaction  penetration [mm]  det F")
for name, score in scores.items():
    print(f"{name:16s} {1e3 * score.rmsd_1:11.4f} {1e3 * score.rmsd_all:14.4f} {score.relative_residual:18.2e} "
          f"{1e3 * score.largest_penetration:17.4f} {score.smallest_det_f:6.3f}")
assert scores["network"].rmsd_all < scores["nothing moves"].rmsd_all

# %%
step = scores["network"].worst_step
frame_picture(folder / "worst.png", mesh, prediction=rows["network"][0][step], truth=truth[step], step=step, steps=60)
plt.figure(figsize=(12, 5))
plt.imshow(plt.imread(folder / "worst.png"))
plt.axis("off")
plt.show()
