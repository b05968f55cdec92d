# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # The modes of a beam
#
# How does a beam want to move? Its elastic modes answer that: the pairs of
#
# $$K \varphi = \lambda M \varphi, \qquad \lambda = (2 \pi f)^2,$$
#
# with the stiffness $K$ and the mass $M$ of the body at rest. We solve for them with finite elements, hold the first
# ones against the theory of slender beams, and see what a coarse mesh of prisms gets wrong.

# %%
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path.cwd() if (Path.cwd() / "physics").exists() else Path.cwd().parent))

import matplotlib.pyplot as plt
import numpy as np

from physics.modes import elastic_modes, euler_bernoulli_hz
from physics.scene import read_scene
from physics.view import mode_picture


def beam(cells, cell="prism", support=({"where": "x-min", "fixed": "xyz"},)):
    """A cantilever of soft rubber, 100 x 20 x 20 mm."""
    return read_scene({
        "name": "cantilever",
        "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": list(cells), "cell": cell},
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.4, "density": 1000.0},
        "support": list(support),
    })


# %% [markdown]
# ## The first modes, and beam theory beside them
#
# Every pair comes with its residual $|K\varphi - \lambda M\varphi| / |\lambda M\varphi|$, so nothing has to be taken on trust.

# %%
scene = beam((40, 6, 6))
modes = elastic_modes(scene, count=6)
theory = euler_bernoulli_hz(scene, 6)
print("mode   FE [Hz]   Euler-Bernoulli [Hz]   residual")
for i, hz in enumerate(modes.frequencies_hz):
    print(f"{i + 1:4d} {hz:9.3f} {theory[i]:18.3f} {modes.residuals[i]:15.1e}")

# %% [markdown]
# The first two are bending, one in each plane. The third is torsion, which the theory of bending does not know, and from
# then on a beam five times as long as thick is softer than the theory says, because it shears.

# %%
folder = Path(tempfile.mkdtemp())
figure, axes = plt.subplots(2, 2, figsize=(11, 6))
for i, axis in enumerate(axes.flat):
    picture = folder / f"mode-{i + 1}.png"
    mode_picture(picture, modes.mesh, modes.shapes[i], title=f"mode {i + 1}: {modes.frequencies_hz[i]:.2f} Hz")
    axis.imshow(plt.imread(picture))
    axis.axis("off")
plt.show()

# %% [markdown]
# ## A free beam
#
# Without supports the body can move as a whole: six modes at zero, and no more than six.

# %%
free = elastic_modes(beam((20, 4, 4), support=()), count=8)
print(np.round(free.frequencies_hz, 4))
assert max(free.frequencies_hz[:6]) < 1e-3 < free.frequencies_hz[6]

# %% [markdown]
# ## What a mesh costs
#
# Linear prisms bend too stiffly. The error falls with the square of the cell size, and the data set's mesh (5 cells across)
# carries a few per cent of it in the frequency. Hexahedra of the same size do a little better.

# %%
across = [2, 3, 4, 6, 8]
first = {cell: [elastic_modes(beam((8 * n, n, n), cell), count=1).frequencies_hz[0] for n in across]
         for cell in ("prism", "hexahedron")}
# Richardson's extrapolation of the two finest, second order: the limit that both kinds of cells must share.
limit = {cell: hz[-1] + (hz[-1] - hz[-2]) / ((across[-1] / across[-2]) ** 2 - 1) for cell, hz in first.items()}
print({cell: round(hz, 3) for cell, hz in limit.items()}, "Hz in the limit")
assert abs(limit["prism"] / limit["hexahedron"] - 1) < 5e-3

figure, axis = plt.subplots(figsize=(6, 4))
for cell, hz in first.items():
    axis.loglog(across, np.array(hz) / limit[cell] - 1, "o-", label=cell)
axis.loglog(across, 0.25 / np.array(across) ** 2, "k:", label="second order")
axis.set(xlabel="cells across the section", ylabel="error of the first frequency")
axis.legend()
plt.show()
