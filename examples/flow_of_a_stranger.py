"""A flow that another program predicted, held against its truth and against the equations.

The "other program" takes the flow around a cylinder and predicts everything 3 % too fast. What enters and what leaves is then 3 %
off, and the kinetic energy 1.03^2 - 1 = 6.09 %; the error of the velocity alone would show neither.
"""

from dataclasses import replace
from pathlib import Path

from datagen import read_trajectory, trajectory_of, verify_files, write_trajectory
from physics import read_any

scene = read_any({
    "body": {"shape": "channel", "length": 0.8, "cell_size": 0.04, "hole_cell_size": 0.015},
    "fluid": {"density": 1.0, "viscosity": 1e-3},
    "inflow": [{"speed": 0.3}], "outflow": [{}],
    "steps": {"count": 40, "duration": 0.4}})
write_trajectory("truth.vtkhdf", trajectory_of(scene))

truth = read_trajectory("truth.vtkhdf")
velocity = 1.03 * truth.fields["velocity"]  # (frames, nodes, 3) [m/s]
write_trajectory("prediction.vtkhdf", replace(truth, fields={**truth.fields, "velocity": velocity}))

found = verify_files(Path("prediction.vtkhdf"), Path("truth.vtkhdf"))
print(found["verdict"])
print(f"flux off by {100 * found['flux_error']:.2f} %, kinetic energy by {100 * found['kinetic_energy_error']:.2f} %; the largest slip "
      f"at walls and inlets is {found['slip']:.3g} m/s")
print(f"momentum equation: {found['momentum_residual']:.2g} is missing, of the truth itself {found['data']['momentum_residual']:.2g}")
assert abs(found["kinetic_energy_error"] - 0.0609) < 2e-3  # over the largest of all frames
assert abs(found["flux_error"] - 0.03) < 3e-3
