"""Estimates of beams that are bent and dented far, against the finite elements' own path: they stay with it to the end."""

import numpy as np
import pytest

from datagen.sets.generate import trajectory_of
from learning.samples.estimate import estimate
from physics.scene import read_scene

SUPPORT = {"x-min": [{"where": "x-min"}], "both": [{"where": "x-min"}, {"where": "x-max"}]}

# A slender cantilever that a ball bends and turns, down by a fifth of its length; a beam held at both ends with a dent as deep as the ball.
# Both as drawn for the family "beam", numbers rounded, in a twentieth of its steps; an error is the root mean square over all frames.
TURNED = {
    "body": {"shape": "beam", "length": 0.2854, "width": 0.022, "height": 0.02983, "cell_size": 0.00519, "cell": "prism"},
    "support": SUPPORT["x-min"],
    "obstacle": {"shape": "sphere", "radius": 0.01747, "path": [[0.205, -0.0198, 0.01396], [0.192, 0.02464, 0.01753]]},
}
DENTED = {
    "body": {"shape": "beam", "length": 0.1253, "width": 0.03095, "height": 0.02789, "cell_size": 0.00552, "cell": "prism"},
    "support": SUPPORT["both"],
    "obstacle": {"shape": "sphere", "radius": 0.01093, "path": [[0.04604, 0.01646, 0.04026], [0.0477, 0.01567, 0.02972]]},
}


@pytest.mark.parametrize(("scene", "bound"), [(TURNED, 1e-3), (DENTED, 2e-3)], ids=["turned", "dented"])
def test_a_beam_bent_far_is_followed_to_the_end_of_the_path(scene, bound):
    truth = trajectory_of(read_scene({**scene, "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "steps": {"count": 20}}))
    frames = np.arange(1, 21)
    found = estimate(truth, frames)
    motion = truth.displacement[frames][:, truth.free].astype(float)
    assert abs(motion).max() > 0.3 * scene["body"]["height"]
    error = np.sqrt(((found.displacement[:, truth.free] - motion) ** 2).mean()) / np.sqrt((motion**2).mean())
    assert error < bound and found.lost == ()  # the bounds are those of beams that are pressed less far
