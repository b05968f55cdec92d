"""Every measure of mesh quality worked out on paper, on a few nodes."""

import numpy as np
import pytest

from physics.mesh import quality
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.schema import InputError

SQUARE = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
CUBE = np.concatenate([SQUARE, SQUARE + (0, 0, 1)])
WEDGE = CUBE[[0, 1, 3, 4, 5, 7]]  # half of it: the triangle (0, 0), (1, 0), (0, 1)
TET = CUBE[[0, 1, 3, 4]]
CORNERS = {"tetrahedron": TET, "prism": WEDGE, "hexahedron": CUBE}


def one(points):
    return np.arange(len(points))[None]


def test_rmsd_is_of_vectors_over_frames_and_nodes_and_rmse_of_their_components():
    """Two frames of two nodes, errors (1, 2, 2), (0, 3, 4), 0 and (2, 0, 0): sqrt((9 + 25 + 0 + 4) / 4)."""
    truth = np.arange(12.0).reshape(2, 2, 3)
    error = np.array([[(1, 2, 2), (0, -3, 4)], [(0, 0, 0), (-2, 0, 0)]])
    assert quality.rmsd(truth + error, truth) == pytest.approx(9.5**0.5, rel=1e-14)
    assert quality.rmsd(truth + error, truth, np.array([True, False])) == pytest.approx(4.5**0.5, rel=1e-14)
    assert quality.rmsd(truth + error, truth, [1]) == pytest.approx(14.5**0.5, rel=1e-14)
    assert quality.rmsd(truth + error, truth, slice(1, 2)) == pytest.approx(14.5**0.5, rel=1e-14)
    assert quality.rmsd(truth[0] + error[0], truth[0]) == pytest.approx(17**0.5, rel=1e-14)
    assert quality.rmse(truth + error, truth) == pytest.approx((38 / 12) ** 0.5, rel=1e-14)
    assert quality.rmse(truth + error, truth, [1]) == pytest.approx((29 / 6) ** 0.5, rel=1e-14)
    # by step: frames have 34 / 6 and 4 / 6
    assert quality.rmse(truth + error, truth, by_step=True) == pytest.approx(((34 / 6) ** 0.5 + (4 / 6) ** 0.5) / 2, rel=1e-14)
    assert quality.rmse(truth + error, truth, [1], by_step=True) == pytest.approx(((25 / 3) ** 0.5 + (4 / 3) ** 0.5) / 2, rel=1e-14)


def test_hausdorff_and_chamfer_of_five_nodes():
    """To (0, 0, 0) and (4, 0, 0) from (0, 3, 0), (4, 0, 1) and (4, 0, 2): gaps 3, 1, 2 one way, 3 and 1 the other."""
    a, b = np.array([(0, 3, 0), (4, 0, 1), (4, 0, 2)]), np.array([(0, 0, 0), (4, 0, 0)])
    for there, back in ((a, b), (b, a)):
        assert quality.set_distances(there, back) == pytest.approx((3, (9 + 1 + 4) / 3 + (9 + 1) / 2), rel=1e-14)
    far = np.concatenate([a, [(4, 0, 12)]])  # 12 from b one way, while back nothing changes
    assert quality.set_distances(far, b) == pytest.approx((12, (9 + 1 + 4 + 144) / 4 + 5), rel=1e-14)
    assert quality.set_distances(b, far) == pytest.approx((12, (9 + 1 + 4 + 144) / 4 + 5), rel=1e-14)
    for broken in (np.nan, np.inf):
        assert quality.set_distances(a, b + [0, broken, 0]) == (np.inf, np.inf)


@pytest.mark.parametrize("cell, volume", [("tetrahedron", 1 / 6), ("prism", 1 / 2), ("hexahedron", 1)])
def test_volumes_of_single_cells(cell, volume):
    points = CORNERS[cell]
    frames = np.stack([points * (2, 3, 5) + 7, points, points * (-1, 1, 1)]).reshape(3, 1, -1, 3)
    np.testing.assert_allclose(quality.cell_volumes(frames, one(points), cell), np.array([30, 1, -1]).reshape(3, 1, 1) * volume, rtol=1e-12)
    stretch = np.array([(2, 0, 0), (0, 3, 0), (0, 0, 5)]) - np.eye(3)
    assert quality.det_f(points, points @ stretch, one(points), cell) == pytest.approx(30, rel=1e-12)


def test_area_of_a_triangle_in_space():
    """Half of |(3, 0, 0) x (0, 4, 4)| = |(0, -12, 12)|."""
    points = np.array([(1, 1, 1), (4, 1, 1), (1, 5, 5)])
    assert quality.cell_volumes(np.stack([points, 2 * points]), one(points),
                                "triangle") == pytest.approx(np.array([[72**0.5], [4 * 72**0.5]]))


def test_volume_of_a_hexahedron_with_a_curved_side():
    """The corner (1, 1, 1) raised by h: z = t (1 + h r s), so the volume grows by the mean of h r s, h / 4."""
    points = CUBE.copy()
    points[6, 2] = 1.8
    assert quality.cell_volumes(points, one(points), "hexahedron") == pytest.approx(1.2, rel=1e-14)
    # Of a prism the corner (0, 1, 1): z = t (1 + h s), and the mean of s over the triangle is 1 / 3.
    points = WEDGE.copy()
    points[5, 2] = 1.6
    assert quality.cell_volumes(points, one(points), "prism") == pytest.approx(0.5 * 1.2, rel=1e-14)


def least(displacement, g=(0.5 - 12**-0.5, 0.5 + 12**-0.5)):
    """Smallest det of the trilinear map's gradient over the corners and over the points g x g x g of the unit cube, by its definition."""
    x = CUBE + displacement

    def det(at):
        gradient = np.zeros((3, 3))
        for corner, place in zip(CUBE, x, strict=True):
            value = [w if c else 1 - w for c, w in zip(corner, at, strict=True)]
            for j in range(3):
                others = [value[k] for k in range(3) if k != j]
                gradient[:, j] += place * (1 if corner[j] else -1) * others[0] * others[1]
        return np.linalg.det(gradient)

    return min(det(corner) for corner in CUBE), min(det((r, s, t)) for r in g for s in g for t in g)


def test_a_hexahedron_inside_out_at_its_gauss_points_only():
    """Right at all of its corners, and yet no cell to compute with (found by a random search)."""
    x = np.array([(0.2, -0.4, -0.5), (0.5, -0.3, -0.3), (1.4, 2.5, 0.3), (0.5, 1.8, -1), (1.7, 0.4, 0.9), (0.1, 0.9, 1.6),
                  (-0.1, -0.2, 1.1),
                  (1, -0.4, 1.2)])
    corners, inside = least(x - CUBE)
    assert corners > 0.3 and inside < -0.7
    assert quality.det_f(CUBE, x - CUBE, one(CUBE), "hexahedron") == pytest.approx(inside, rel=1e-12)


def test_a_cell_that_is_turned_from_bottom_to_top_is_narrow_in_between():
    """The top is turned by w about the axis. At a corner the vertical edge rises by 1 whatever w is, so det F = 1 there.

    At the height t the sides are 1 - t times the lower ones and t times the upper ones, so det = 1 - 2 t (1 - t) (1 - cos w) on the
    axis; at the Gauss points t (1 - t) = 1 / 6.
    """
    for degrees in (60, 100, 150, 179):
        w = np.radians(degrees)
        turn = np.array([[np.cos(w), -np.sin(w), 0], [np.sin(w), np.cos(w), 0], [0, 0, 1]])
        displacement = np.zeros((8, 3))
        displacement[4:] = (CUBE[4:] - [0.5, 0.5, 0]) @ turn.T + [0.5, 0.5, 0] - CUBE[4:]
        corners, inside = least(displacement)
        assert corners == pytest.approx(1, abs=1e-12) and inside == pytest.approx(1 - (1 - np.cos(w)) / 3, abs=1e-12)
        assert quality.det_f(CUBE, displacement, one(CUBE), "hexahedron") == pytest.approx(inside, rel=1e-12)
        assert quality.smallest_det_f(CUBE, displacement, one(CUBE), "hexahedron") == pytest.approx(inside, rel=1e-12)
        # The same of the prism, at the height of the Gauss points.
        half = displacement[[0, 1, 3, 4, 5, 7]]
        assert quality.det_f(WEDGE, half, one(WEDGE), "prism") == pytest.approx(inside, rel=1e-12)


def test_det_f_of_a_hexahedron_at_both_kinds_of_points_in_a_plain_loop():
    rng = np.random.default_rng(0)
    for share in (0.2, 0.4, 0.6, 0.8) * 3:
        displacement = rng.uniform(-share, share, (8, 3))
        corners, inside = least(displacement)
        assert quality.det_f(CUBE, displacement, one(CUBE), "hexahedron") == pytest.approx(min(corners, inside), rel=1e-11, abs=1e-13)


def test_a_flat_cell_has_no_positive_det_f_and_a_thin_one_has():
    flat, thin = CUBE * (0, 0, -1), CUBE * (0, 0, -1 + 1e-9)
    for displacement, count in ((flat, 1), (thin, 0), (1.5 * flat, 1)):
        assert np.count_nonzero(~(quality.det_f(CUBE, displacement, one(CUBE), "hexahedron") > 0)) == count
    for rest, words in ((CUBE * (1, 1, 0), "1 of 1 cells are inverted in the rest state"), (CUBE * (1, 1, -1), "1 of 1 cells")):
        with pytest.raises(InputError, match=words):
            quality.det_f(rest, 0 * CUBE, one(CUBE), "hexahedron")
    points = np.concatenate([CUBE, CUBE * (1, 1, -1), CUBE + 5])
    with pytest.raises(InputError, match="1 of 3 cells are inverted"):
        quality.det_f(points, 0 * points, np.arange(24).reshape(3, 8), "hexahedron")


def test_frames_one_by_one_and_many_at_once_agree(monkeypatch):
    """The work is cut into pieces of frames by CHUNK; every frame comes out, in its place."""
    mesh = build_mesh(Body(length=2.0, width=1.0, height=1.0, cells=(2, 1, 1), cell="hexahedron"))
    stretch = np.arange(1, 8).reshape(7, 1, 1) * mesh.points * (1, 0, 0)
    for chunk in (1, 9 * 8 * 2 * 3, 10**9):
        monkeypatch.setattr(quality, "CHUNK", chunk)
        found = quality.cell_volumes(mesh.points + stretch, mesh.cells, "hexahedron")
        np.testing.assert_allclose(found, np.arange(2, 9)[:, None] * np.ones(2), rtol=1e-13)
        assert quality.smallest_det_f(mesh.points, stretch, mesh.cells, "hexahedron") == pytest.approx(np.arange(2, 9))


def test_continuity_of_three_triangles():
    """In a row, areas 1, 3 and 8/3: neighbours {3}, {1, 8/3} and {3}. A corner in common makes no neighbours."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0), (3, 2, 0), (3, -2 / 3, 0), (10, 2, 0)])
    cells = np.array([(0, 1, 2), (1, 3, 2), (1, 4, 3)])
    area = quality.cell_volumes(points, cells, "triangle")
    assert area == pytest.approx([1, 3, 8 / 3], rel=1e-12)  # 2 of base, 3 wide and 2 high; 8/3 high, 2 wide
    assert quality.mesh_continuity(points, cells, "triangle") == pytest.approx((1 + (8 / 3) / 1 + 1) / 3, rel=1e-12)
    fan = np.array([(0, 1, 2), (3, 5, 1)])  # they meet in node 1 alone
    assert quality.mesh_continuity(points, fan, "triangle") == 1


def test_aspect_ratio_by_each_formula():
    """Right-angled cells of sides 2, 3 and 6, so the longest edge of the tetrahedron is sqrt(9 + 36)."""
    long = 45**0.5
    tet, wedge, cube = (points * (2, 3, 6) for points in (TET, WEDGE, CUBE))
    assert quality.aspect_ratio(tet, one(tet), "tetrahedron") == pytest.approx(6**0.5 * long / 6 ** (1 / 3), rel=1e-13)  # V = 36 / 6
    assert quality.aspect_ratio(wedge, one(wedge), "prism") == pytest.approx(6 * (3**0.5 / (4 * 18)) ** (1 / 3), rel=1e-13)
    assert quality.aspect_ratio(cube, one(cube), "hexahedron") == pytest.approx(6 / 36 ** (1 / 3), rel=1e-13)
    triangle = TET[:3] * (3, 4, 1)  # longest edge 5, area 6
    assert quality.aspect_ratio(triangle, one(triangle), "triangle") == pytest.approx(5 / (2 * (3**0.5 * 6) ** 0.5), rel=1e-13)
    assert quality.aspect_ratio(cube * (1, 1, -1), one(cube), "hexahedron") == pytest.approx(6 / 36 ** (1 / 3), rel=1e-13)  # by its size
    assert quality.aspect_ratio(cube * (1, 1, 0), one(cube), "hexahedron") == np.inf


def test_scaled_jacobian_by_each_formula():
    """A corner of three edges at right angles has 1; sheared by 45 degrees 1 / sqrt(2). Ideal corners have 1 / sqrt(2) and sqrt(3) / 2."""
    shear = np.array([(1, 0, 0), (1, 1, 0), (0, 0, 1)])  # y leans over x
    assert quality.scaled_jacobian(CUBE * (2, 3, 6), one(CUBE), "hexahedron") == pytest.approx(1, rel=1e-13)
    assert quality.scaled_jacobian(CUBE @ shear, one(CUBE), "hexahedron") == pytest.approx(2**-0.5, rel=1e-13)
    assert quality.scaled_jacobian(-CUBE, one(CUBE), "hexahedron") == pytest.approx(-1, rel=1e-13)
    # The right-angled half of it is worst at its corners of 45 degrees, by 1 / sqrt(2) to sqrt(3) / 2.
    assert quality.scaled_jacobian(WEDGE * (5, 5, 2), one(WEDGE), "prism") == pytest.approx(2 / 3**0.5 * 2**-0.5, rel=1e-13)
    # At a corner away from the right angle: 6 V = 1 over 1 * sqrt(2) * sqrt(2).
    assert quality.scaled_jacobian(3 * TET, one(TET), "tetrahedron") == pytest.approx(2**0.5 / 2, rel=1e-13)


def test_centre_gradients_by_hand():
    np.testing.assert_allclose(quality.centre_gradients("tetrahedron"), [(-1, -1, -1), (1, 0, 0), (0, 1, 0), (0, 0, 1)], atol=1e-15)
    # A prism at (1/3, 1/3, 1/2): half of the triangle's gradients, and a third along the axis.
    np.testing.assert_allclose(quality.centre_gradients("prism"), [(-0.5, -0.5, -1 / 3), (0.5, 0, -1 / 3), (0, 0.5, -1 / 3),
                                                                  (-0.5, -0.5, 1 / 3), (0.5, 0, 1 / 3), (0, 0.5, 1 / 3)], atol=1e-15)
    np.testing.assert_allclose(quality.centre_gradients("hexahedron"), (2 * CUBE - 1) / 4, atol=1e-15)
