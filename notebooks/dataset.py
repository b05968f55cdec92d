# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A data set of your own
#
# A family is a scene file whose values may be ranges. From it we make a small data set, look at it, check that every
# trajectory still satisfies its equations, read its statistics, and pack it into one small file.

# %%
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path.cwd() if (Path.cwd() / "physics").exists() else Path.cwd().parent))

import matplotlib.pyplot as plt
import numpy as np

from datagen.family.family import counts, draw, load_family
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets import dataset
from datagen.sets.check import check
from datagen.sets.generate import generate
from datagen.sets.pack import pack, unpack
from datagen.sets.plan import planned
from datagen.sets.statistics import rows_of, statistics

folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## The family
#
# Ranges stand where a scene has values. The obstacle is placed relative to the body: on which face, how far along, how deep,
# in which direction. Values that belong together stand in cases, of which each draw takes one.

# %%
(folder / "mine.toml").write_text("""
name = "mine"

[body]
length = { uniform = [0.08, 0.14] }     # [m]
width = 0.024
height = 0.024
cell_size = 0.008

[material]
young_modulus = { log-uniform = [3e5, 3e6] }   # [Pa]
poisson_ratio = 0.4

[obstacle]
shape = { choice = ["sphere", "cylinder"] }
radius = 0.01
place = { face = { choice = ["y-max", "z-max"] }, turn = 0, gap = 0.001, depth_in = "length", direction = [{ uniform = [-20, 20] }, 0] }

[[case]]    # held at one end
support = [{ where = "x-min" }]
obstacle.place.along = 0.8
obstacle.place.depth = { uniform = [0.1, 0.2] }

[[case]]    # held at both ends
support = [{ where = "x-min" }, { where = "x-max" }]
obstacle.place.along = { uniform = [0.4, 0.6] }
obstacle.place.depth = { uniform = [0.04, 0.08] }

[steps]
count = 60
""")
family = load_family(folder / "mine.toml")
for index in range(3):
    scene = draw(family, 0, index)
    print(f"draw {index}: {scene.body.length:.4f} m, E = {scene.material.young_modulus:.3g} Pa, "
          f"{len(scene.support)} supports, path {np.round(scene.obstacle.path, 4).tolist()}")

# %% [markdown]
# ## What it will be like
#
# Before anything is solved: sizes and graph diameters of a draw. On the command line this is `fidelity generate mine.toml
# --dry-run`.

# %%
wanted = counts(family, count=10)
plan = planned(family, wanted)
for name in ("nodes", "graph_diameter", "xy_extent"):
    print(name, {key: round(value, 5) for key, value in plan[name].items()})

# %% [markdown]
# ## Generate
#
# Every trajectory depends on the seed and its own number alone. Stop it whenever you like; the same call goes on. A scene
# without an equilibrium that could be found is replaced by another draw, and the reason is kept.

# %%
started = time.perf_counter()
report = generate(family, wanted, folder / "data", workers=1)
print(report, f"{report['trajectories'] / (time.perf_counter() - started) * 60:.0f} trajectories a minute")
for entry in dataset.read_manifest(folder / "data").trajectories:
    for reason in entry.failed_attempts:
        print(f"{entry.file} is another draw: {reason}")
again = generate(family, wanted, folder / "data", workers=1)
assert again["new"] == 0

# %% [markdown]
# ## Look
#
# Each file opens in ParaView and PyVista with a time slider. Here are the last frames, seen from the side.

# %%
figure, axes = plt.subplots(2, 3, figsize=(13, 6))
for axis, path in zip(axes.flat, dataset.files(folder / "data", "train"), strict=False):
    trajectory = read_trajectory(path)
    x = trajectory.points + trajectory.displacement[-1]
    axis.scatter(x[trajectory.body, 0], x[trajectory.body, 2], s=4, c=np.linalg.norm(trajectory.displacement[-1, trajectory.body], axis=1))
    axis.scatter(x[~trajectory.body, 0], x[~trajectory.body, 2], s=2, color="0.5")
    axis.set(aspect="equal", title=path.name)
plt.show()

# %% [markdown]
# ## Check
#
# Layout, checksums, held nodes, the obstacle's path, det F, penetration, and the equilibrium of sampled steps computed anew
# from the stored displacements. Then the same for a file in which one node was moved by a thousandth of a millimetre.

# %%
assert check(folder / "data") == []
victim = dataset.files(folder / "data", "valid")[0]
honest = victim.read_bytes()
trajectory = read_trajectory(victim)
trajectory.displacement[-1, np.flatnonzero(trajectory.free)[10], 2] += 1e-6
write_trajectory(victim, trajectory)
for problem in check(folder / "data"):
    print(problem.replace(str(folder), "..."))
assert check(folder / "data")
victim.write_bytes(honest)

# %% [markdown]
# ## Statistics
#
# With the error that the numbers themselves carry. Two trajectories are solved again on cells of half the size: no model that
# learns from this set needs to be better than that.

# %%
rows = rows_of(folder / "data")
found = statistics(folder / "data", rows, refined=2)
for name in ("nodes", "displacement_rms", "change_rms", "storage_noise", "solver_noise"):
    print(f"{name:20s} mean {found[name]['mean']:.3g}  smallest {found[name]['min']:.3g}  largest {found[name]['max']:.3g}")
print(f"{'mesh error':20s} {1e3 * found['refined']['mesh_rmse']['mean']:.3f} mm, "
      f"{100 * found['refined']['mesh_relative']['mean']:.1f} % of the motion")
plt.hist([1e3 * row["displacement_largest"] for row in rows], bins=8)
plt.xlabel("largest displacement [mm]")
plt.ylabel("trajectories")
plt.show()
assert found["solver_noise"]["max"] < found["refined"]["mesh_rmse"]["min"]

# %% [markdown]
# ## Pack
#
# The motion has low rank, so it fits a small file with every displacement within a millionth of a metre. What is unpacked
# passes the same check.

# %%
packed = pack(folder / "data", folder / "mine.pack", tolerance=1e-6)
print(f"{packed['bytes'] / 1e3:.0f} kB, {packed['ratio']:.0f} times smaller, largest error {packed['largest_error']:.2e} m")
unpack(folder / "mine.pack", folder / "again")
assert check(folder / "again") == [] and packed["largest_error"] <= 1e-6
