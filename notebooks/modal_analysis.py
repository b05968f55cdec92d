# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # The modes of a beam, a plate and a channel
#
# How does a body want to move? Its elastic modes answer that: the pairs of
#
# $$K \varphi = \lambda M \varphi, \qquad \lambda = (2 \pi f)^2,$$
#
# with the stiffness $K$ and the mass $M$ of the body at rest. We solve for them with finite elements, hold the first
# ones against the theory of slender beams, and see what a coarse mesh of prisms gets wrong. Then a plate with a hole, read
# from a mesh file, and a flow channel, which has no stiffness but has a shape; and last what modes are for here: segments.

# %%
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path.cwd() if (Path.cwd() / "physics").exists() else Path.cwd().parent))

import matplotlib.pyplot as plt
import meshio
import numpy as np

from datagen.files.trajectory import at_rest
from learning.segments.cut import segment
from learning.segments.quality import segment_quality
from physics.mesh.build import build_mesh
from physics.modes.elastic import elastic_modes, euler_bernoulli_hz
from physics.modes.laplacian import laplacian_modes
from physics.scene import read_body, read_scene
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

# %% [markdown]
# Second-order cells are worth their price: with the same mesh the error is ten times smaller, and what is left comes from the
# edges of the clamped face, where the stress is singular.

# %%
straight = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [20, 4, 4], "cell": "tetrahedron"}
for order in (1, 2):
    scene = read_scene({"body": straight | {"order": order}, "material": {"young_modulus": 1e6, "poisson_ratio": 0.4},
                        "support": [{"where": "x-min"}]})
    found = elastic_modes(scene, count=1)
    print(f"order {order}: {found.frequencies_hz[0]:.3f} Hz with {found.dofs} unknowns")
    error = found.frequencies_hz[0] / 10.049 - 1  # of the converged value, tests/test_physics_modes_elastic.py
assert error < 5e-3

# %% [markdown]
# ## A plate with a hole, from a mesh file
#
# Any mesh that meshio reads will do, and its physical groups name the places. Here we make one ourselves: the quadrilaterals
# around a hole, pulled up into hexahedra, with the left edge and the rim of the hole as groups.

# %%
plane = build_mesh(read_body({"body": {"shape": "channel", "length": 0.3, "height": 0.2, "hole_centre": [0.15, 0.1],
                                       "hole_radius": 0.05, "cell_size": 0.0125, "cell": "quadrilateral"}}))
layers, n = 2, len(plane.points)
points = np.concatenate([plane.points + [0, 0, 0.004 * k / layers] for k in range(layers + 1)])
bricks = np.concatenate([np.hstack([plane.cells + k * n, plane.cells + (k + 1) * n]) for k in range(layers)])


def wall(place):
    """The quadrilaterals above the edges of a place."""
    edges = np.concatenate(plane.facets(place))
    return np.concatenate([np.hstack([edges + k * n, edges[:, ::-1] + (k + 1) * n]) for k in range(layers)])


groups = {"plate": bricks, "clamped": wall("x-min"), "rim": wall("hole")}
kinds = ["hexahedron", "quad", "quad"]
tags = [np.full(len(cells), i + 1) for i, cells in enumerate(groups.values())]
meshio.Mesh(points, list(zip(kinds, groups.values(), strict=True)), cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={name: np.array([i + 1, 3 if i == 0 else 2]) for i, name in enumerate(groups)}
            ).write(folder / "plate.msh", file_format="gmsh22")

plate = read_scene({"body": {"shape": "file", "path": str(folder / "plate.msh"), "order": 2},
                    "material": {"young_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0},
                    "support": [{"where": "clamped", "fixed": "xyz"}]})
modes = elastic_modes(plate, count=6)
print(modes.dofs, "unknowns;", modes.solver)
print("f [Hz]           ", np.round(modes.frequencies_hz, 1))
print("share of the mass that moves along z", np.round(modes.effective_masses[:, 2] / modes.free_mass[2], 3))
assert modes.residuals.max() < 1e-8
assert modes.effective_masses[0, 2] > 0.5 * modes.free_mass[2]  # the first bending carries most of it

figure, axes = plt.subplots(2, 3, figsize=(12, 6))
for i, axis in enumerate(axes.flat):
    picture = folder / f"plate-{i + 1}.png"
    mode_picture(picture, modes.mesh, modes.shapes[i], title=f"mode {i + 1}: {modes.frequencies_hz[i]:.0f} Hz")
    axis.imshow(plt.imread(picture))
    axis.axis("off")
plt.show()

# %% [markdown]
# ## A flow channel
#
# A fluid has no elastic modes, but its domain has Laplacian ones, $-\nabla^2 \varphi = \lambda \varphi$ with $\varphi = 0$ at
# inlet, walls and hole and an open outlet. They need a shape and nothing else, and they show where the domain is wide.

# %%
channel = laplacian_modes(read_body({"body": {"shape": "channel"}}), count=6)
strip = (np.pi / 0.41) ** 2
print(f"held: {', '.join(channel.dirichlet)}; eigenvalues {np.round(channel.eigenvalues, 2)} 1/m2; "
      f"those of an endless strip start at {strip:.2f}")
assert channel.residuals.max() < 1e-8 and channel.eigenvalues[0] > strip

figure, axes = plt.subplots(3, 2, figsize=(12, 7))
for i, axis in enumerate(axes.flat):
    picture = folder / f"channel-{i + 1}.png"
    mode_picture(picture, channel.mesh, channel.shapes[i], title=f"{channel.eigenvalues[i]:.1f} 1/m2")
    axis.imshow(plt.imread(picture))
    axis.axis("off")
plt.show()

# %% [markdown]
# ## How modes guide segments
#
# The network gathers nodes into segments. METIS cuts the mesh into pieces of equal size and knows nothing of mechanics; the
# refinement then moves nodes to the neighbouring segment that is nearest in place *and in the mode*, so that segments are
# short where the body bends and long where it moves as a whole.
#
# A mode's sign is arbitrary, and in a square beam so is the plane of the first bending: any two perpendicular planes will do.
# What may be used is what depends on neither. For a whole cluster that is $\sqrt{\sum_k |\varphi_k|^2}$ at each node, or
# distances between the modes of two nodes, which the segments take.

# %%
square = elastic_modes(beam((40, 6, 6)), count=2)
other = elastic_modes(beam((40, 6, 6)), count=6)
print("clusters of the first six modes:", [[i + 1 for i in members] for members in other.clusters])
sizes = [np.sqrt((modes.shapes[:2] ** 2).sum(axis=(0, 2))) for modes in (square, other)]
assert np.allclose(*sizes, atol=1e-6 * sizes[0].max())  # the pair is the same, whoever chose inside it

body = at_rest(square.mesh, square.pictured[:1], frequencies_hz=square.frequencies_hz[:1])
flipped = at_rest(square.mesh, -square.pictured[:1], frequencies_hz=square.frequencies_hz[:1])
cuts = {method: segment(body, count=8, method=method) for method in ("metis", "slic-mdod-e")}
assert np.array_equal(segment(flipped, count=8), segment(body, count=8))
size = np.linalg.norm(square.pictured[0], axis=1)
figure, axes = plt.subplots(1, 2, figsize=(12, 3), sharey=True)
for axis, (method, label) in zip(axes, cuts.items(), strict=True):
    spread = np.mean([np.ptp(size[label == k]) for k in range(label.max() + 1)])
    print(f"{method:12s} conductance {segment_quality(body, label)['conductance']:.3f}, "
          f"the mode varies by {spread:.3f} of its largest value inside a segment")
    axis.scatter(1e3 * square.mesh.points[:, 0], size, c=label, cmap="tab10", s=6)
    axis.set(xlabel="x [mm]", title=method, ylabel="size of mode 1")
plt.show()
