# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A flow around a cylinder, and what a prediction of it is worth
#
# The flow is computed, looked at, and predicted by two rivals that know no equation. One of them comes near in the velocity; what it
# does to drag, flux and momentum only the equations tell.

# %%
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path.cwd() if (Path.cwd() / "physics").exists() else Path.cwd().parent))

import matplotlib.pyplot as plt
import numpy as np

from datagen.files.trajectory import write_trajectory
from datagen.flow.prediction import read_flow_truth
from datagen.flow.trajectory import flow_trajectory
from learning.flows.rivals import decomposed, stays
from physics.fidelity.figures import FLOW, shown
from physics.flow.solution import solve_flow
from physics.scene import read_any
from physics.view.flow import vorticity

folder = Path(tempfile.mkdtemp())
scene = read_any({
    "body": {"shape": "channel", "length": 1.2, "hole_centre": [0.2, 0.2], "hole_radius": 0.05, "cell_size": 0.045,
             "hole_cell_size": 0.018},
    "fluid": {"density": 1.0, "viscosity": 1e-3}, "inflow": [{"speed": 1.2}], "outflow": [{}],
    "steps": {"count": 240, "duration": 4.8}})
flow = solve_flow(scene)
print(f"{len(flow.velocity) - 1} frames on {len(flow.mesh.points)} nodes, Reynolds number {scene.reynolds_number:.3g}")

# %% [markdown]
# ## Vortices
#
# Past a Reynolds number of about 50 the wake sheds vortices; the lift swings, and the drag twice as fast.

# %%
times = np.linspace(0, scene.steps.duration, scene.steps.count + 1)
drag, lift = flow.coefficients("drag"), flow.coefficients("lift")
figure, (above, below) = plt.subplots(2, 1, figsize=(9, 6), layout="constrained")
above.tripcolor(*flow.mesh.points[:, :2].T, flow.mesh.cells, vorticity(flow.mesh, flow.velocity[-1:])[0], cmap="RdBu_r", vmin=-60, vmax=60)
above.set(aspect="equal", title="vorticity [1/s]")
below.plot(times[5:], drag[5:], label="drag coefficient")
below.plot(times[5:], lift[5:], label="lift coefficient")
below.set(xlabel="time [s]")
below.legend()
late = len(times) // 2
print(f"drag coefficient {drag[late:].mean():.3f}, lift {lift[late:].min():.3f} to {lift[late:].max():.3f}")

# %% [markdown]
# ## Two predictions
#
# "Nothing changes" is shown one frame. A dynamic mode decomposition is shown the first half and goes on with the linear map that
# leads from each frame to the next.

# %%
write_trajectory(folder / "truth.vtkhdf", flow_trajectory(scene, flow))
truth = read_flow_truth(folder / "truth.vtkhdf")
of = truth.reference
paths = {"nothing changes": stays(truth), "dynamic modes": decomposed(truth)}
found = {name: vars(of.verify(path.velocity, path.pressure)) for name, path in paths.items()}
found["the data"] = vars(of.verify(of.velocity, of.pressure))

# %% [markdown]
# ## Held against the equations
#
# The last column is what storage leaves of a perfect prediction: no error, and next to nothing missing in the equations.

# %%
print(f"{'':30s}" + "".join(f"{name:>18s}" for name in found))
for key, column in FLOW.items():
    print(f"{column.head:30s}" + "".join(f"{shown(each[key]):>18s}" for each in found.values()))

# %% [markdown]
# A flow that stands still still has no divergence: it was a flow once. What gives it away is the momentum equation, and the drag.

# %%
modes, still, data = found["dynamic modes"], found["nothing changes"], found["the data"]
assert modes["velocity_rmse_all"] < 0.5 * still["velocity_rmse_all"]
assert data["momentum_residual"] < 0.5 * still["momentum_residual"]
assert abs(modes["strouhal"] / data["strouhal"] - 1) < 0.1 and np.isnan(still["strouhal"])
