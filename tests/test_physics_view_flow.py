"""Pictures of flows: vorticity by hand, and a prediction beside its truth."""

import numpy as np
from PIL import Image

from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.view.flow import flow_film, flow_picture, vorticity

MESH = build_mesh(Body(shape="plate", length=2.0, width=1.0, cells=(5, 3), cell="triangle"))


def test_the_vorticity_of_a_linear_velocity_is_dv_dx_less_du_dy():
    """u = 3 x + 5 y, v = 7 x - 2 y: 7 - 5 = 2 at every node, twice that at twice the velocity."""
    x, y = MESH.points[:, 0], MESH.points[:, 1]
    u = np.stack([3 * x + 5 * y, 7 * x - 2 * y, 0 * x], axis=1)
    np.testing.assert_allclose(vorticity(MESH, np.array([u, 2 * u])), np.repeat([[2.0], [4.0]], len(u), axis=1), rtol=1e-12)


def test_a_picture_is_red_where_the_fluid_turns_to_the_left_and_has_two_panels_with_a_truth(tmp_path):
    x, y = MESH.points[:, 0], MESH.points[:, 1]
    turn = np.array([np.stack([-sign * y, sign * x, 0 * x], axis=1) for sign in (1, -1)])
    flow_picture(tmp_path / "one.png", MESH, turn, 0)
    one = np.asarray(Image.open(tmp_path / "one.png")).astype(int)
    centre = one[one.shape[0] // 2, one.shape[1] // 2]
    assert centre[0] > centre[2] + 40
    flow_picture(tmp_path / "two.png", MESH, turn, 1, truth=turn[::-1])
    two = np.asarray(Image.open(tmp_path / "two.png")).astype(int)
    left, right = two[two.shape[0] // 2, two.shape[1] // 4], two[two.shape[0] // 2, 3 * two.shape[1] // 4]
    assert left[2] > left[0] + 40 and right[0] > right[2] + 40
    assert flow_film(tmp_path / "film.gif", MESH, turn, truth=turn) == 2
    assert Image.open(tmp_path / "film.gif").n_frames == 2
