"""Every figure of a verification, worked out on paper: a bar of three boxes, of linear elasticity, away from the origin.

Planes of the bar move as a whole, so each box has one strain, and all forces are sums of stress times area over four nodes.
"""

import numpy as np
import pytest

from physics.fidelity.figures import gathered
from physics.fidelity.verify import Checker, Reference, as_table, verify
from physics.mesh.build import build_mesh
from physics.mesh.shapes.boxes import rectangle
from physics.scene import Body
from tests.bars import HX, HY, HZ, LAMBDA, MU, ORIGIN, bar, node_at, stress

# Frames 0 .. 61; a free node is off by AMOUNT (2, 3, 6) um, of length 7, a held one by HELD (1, -2, 2) um, of length 3.
AMOUNT = np.array([4.5] + [2.0] + 49 * [1.0] + 10 * [3.0] + [4.0])
AMOUNT[37] = 5.0
HELD = AMOUNT.copy()
HELD[20] = 40.0


@pytest.fixture(scope="module")
def long():
    scene, mesh, plane = bar()
    truth = 0.01 * (np.arange(62) / 61)[:, None, None] * (mesh.points - ORIGIN) * [1, 0, 0]
    prediction = truth.copy()
    prediction[:, node_at(mesh, [2 * HX, HY, 0])] += 1e-6 * AMOUNT[:, None] * [2, 3, 6]
    prediction[:, node_at(mesh, [0, 0, HZ])] += 1e-6 * HELD[:, None] * [1, -2, 2]
    return prediction, truth, {"scene": scene, "mesh": mesh, "free": plane > 0, "sample": 2}


def test_rmsd_1_is_of_the_first_step_rmsd_50_of_frames_1_to_50_and_rmsd_all_without_the_rest_frame(long):
    prediction, truth, how = long
    fidelity = verify(prediction, truth, **how)
    # Squares of AMOUNT: frame 1 4; frames 1 .. 50 4 + 48 + 25 = 77; all 77 + 10 9 + 16 = 183. Of HELD 1599 more from frame 20 on.
    # 12 of the 16 nodes are free.
    assert fidelity.rmsd_1 == pytest.approx(7e-6 * np.sqrt(4 / 12))
    assert fidelity.rmsd_50 == pytest.approx(7e-6 * np.sqrt(77 / (50 * 12)))
    assert fidelity.rmsd_all == pytest.approx(7e-6 * np.sqrt(183 / (61 * 12)))
    # of a coordinate: a third of the squares; by step: the mean of AMOUNT in place of the root of its mean square
    assert fidelity.rmse_1 == pytest.approx(7e-6 * np.sqrt(4 / 36)) == fidelity.rmse_1_by_step
    assert fidelity.rmse_50 == pytest.approx(7e-6 * np.sqrt(77 / (50 * 36)))
    assert fidelity.rmse_50_by_step == pytest.approx(7e-6 / 6 * AMOUNT[1:51].mean())
    assert fidelity.rmse_all == pytest.approx(7e-6 * np.sqrt(183 / (61 * 36)))
    assert fidelity.rmse_all_by_step == pytest.approx(7e-6 / 6 * AMOUNT[1:].mean())
    assert fidelity.rmse_all_all_nodes == pytest.approx(1e-6 * np.sqrt((49 * 183 + 9 * (183 + 1599)) / (61 * 48)))
    both = np.sqrt((49 * AMOUNT**2 + 9 * HELD**2) / 48)
    assert fidelity.rmse_all_by_step_all_nodes == pytest.approx(1e-6 * both[1:].mean())
    assert fidelity.rmse_50_by_step_all_nodes == pytest.approx(1e-6 * both[1:51].mean())
    assert fidelity.rmsd_1_all_nodes == pytest.approx(1e-6 * np.sqrt((49 + 9) * 4 / 16))
    assert fidelity.rmsd_50_all_nodes == pytest.approx(1e-6 * np.sqrt((49 * 77 + 9 * 1676) / (50 * 16)))
    assert fidelity.rmsd_all_all_nodes == pytest.approx(1e-6 * np.sqrt((49 * 183 + 9 * 1782) / (61 * 16)))
    assert fidelity.worst_step == 37  # at frame 20 only a held node is farther off
    # The largest distance of any node: 7 AMOUNT, but 3 x 40 at frame 20; AMOUNT sums to 2 + 48 + 5 + 30 + 4 = 89 over the steps.
    assert fidelity.gf_h == pytest.approx(1e-6 * (7 * 88 + 120) / 61)
    # Chamfer: the mean square from each side, so twice that over the 16 nodes.
    assert fidelity.gf_c == pytest.approx(1e-12 * 2 * (49 * 183 + 9 * 1782) / (61 * 16))
    assert fidelity.inverted_elements == 0 and fidelity.largest_penetration == 0


def test_rmse_1_is_over_all_frames_that_were_predicted_from_the_true_one_before(long):
    prediction, truth, how = long
    node, held = node_at(how["mesh"], [HX, 0, HZ]), node_at(how["mesh"], [0, HY, 0])
    one_step = truth[1:].copy()
    one_step[:, node] += 1e-6 * np.arange(1, 62)[:, None] * [2, 3, 6]
    one_step[:, held] += 1e-6 * np.arange(1, 62)[:, None] * [1, -2, 2]
    fidelity = verify(prediction, truth, one_step=one_step, **how)
    squares = 61 * 62 * 123 / 6  # 1 + 4 + .. + 61^2
    assert fidelity.rmsd_1 == pytest.approx(7e-6 * np.sqrt(squares / (61 * 12)))
    assert fidelity.rmsd_1_all_nodes == pytest.approx(1e-6 * np.sqrt(58 * squares / (61 * 16)))
    assert fidelity.rmsd_50 == pytest.approx(7e-6 * np.sqrt(77 / (50 * 12)))


# Per cent of stretch and of shear towards y and z of each box, frames 0 .. 7. Of these 1, 4 and 7 are checked.
TRUE = np.array([3 * [[0, 0, 0]],
                 [[2, 1, 3], [1, 2, 2], [3, -1, 1]], [[9, 9, 9], [9, 9, 9], [9, 9, 9]], [[1, 1, 1], [2, 2, 2], [1, 3, 1]],
                 [[6, -4, 3], [5, 1, 7], [8, 2, -2]], [[20, 1, 1], [1, 2, 1], [30, 1, 1]], [[1, 0, 0], [2, 0, 0], [3, 0, 0]],
                 [[3, 2, -1], [4, 0, 2], [-5, 1, 1]]])
PREDICTED = np.array([3 * [[0, 0, 0]],
                      [[4, 1, 5], [2, 2, 2], [7, -3, 1]], [[9, 9, 9], [-120, 9, 9], [9, 9, 9]], [[1, 1, 1], [3, 2, 2], [1, 3, 1]],
                      [[5, -6, 3], [8, 1, 2], [4, 9, -2]], [[-130, 1, 1], [1, 2, 1], [-150, 1, 1]], [[1, 0, 0], [-110, 0, 0], [3, 0, 0]],
                      [[-6, 2, -3], [4, 5, 2], [-1, 1, 8]]])
PULL = np.array([7.0, -3.0, 5.0])  # [Pa] on the end, at the last step
BASE = np.array([11.0, 17.0, -13.0])  # [Pa] on the held end, straight into the support


def moved(strains, plane):
    """(T, N, 3) displacements by strains (T, 3 boxes, 3) in per cent."""
    planes = np.concatenate([np.zeros((len(strains), 1, 3)), np.cumsum(0.01 * HX * strains, axis=1)], axis=1)
    return planes[:, plane]


def node_forces(strains, mesh, plane, fraction):
    """(N, 3) internal less outer forces: each box gives each of its corners stress times a quarter of the three faces there."""
    faces = np.array([HY * HZ, HX * HZ, HX * HY]) / 4
    middle = ORIGIN + np.array([0, HY / 2, HZ / 2])
    forces = np.zeros_like(mesh.points)
    for box, strain in enumerate(strains):
        for node in range(len(mesh.points)):
            if plane[node] in (box, box + 1):
                side = np.array([2 * (plane[node] - box) - 1, *np.sign(mesh.points[node] - middle)[1:]])
                forces[node] += stress(strain) @ (side * faces)
    forces[plane == len(strains)] -= fraction * PULL * HY * HZ / 4
    return forces


@pytest.fixture(scope="module")
def planes():
    scene, mesh, plane = bar(load=[{"where": "x-max", "traction": PULL.tolist()}, {"where": "x-min", "traction": BASE.tolist()}])
    return verify(moved(PREDICTED, plane), moved(TRUE, plane), scene=scene, mesh=mesh, free=plane > 0, sample=3), mesh, plane, scene


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def test_residual_energy_and_reaction_are_over_the_checked_frames_and_over_the_largest_of_the_truth(planes):
    fidelity, mesh, plane, scene = planes
    energy, reaction, residual = {}, {}, []
    for name, strains in (("true", TRUE), ("predicted", PREDICTED)):
        # Each box has stored half of stress times strain; on the support pull the stress of the first one and the load there.
        e, g, h = np.moveaxis(0.01 * strains[[1, 4, 7]], 2, 0)
        energy[name] = HX * HY * HZ * ((LAMBDA / 2 + MU) * e**2 + MU / 2 * (g**2 + h**2)).sum(axis=1)
        reaction[name] = np.array([HY * HZ * (stress(strains[t][0])[:, 0] + t / 7 * BASE) for t in (1, 4, 7)])
    for t in (1, 4, 7):
        residual.append(np.linalg.norm(node_forces(PREDICTED[t], mesh, plane, t / 7)[plane > 0]))
    largest = np.linalg.norm(reaction["true"], axis=1)
    assert largest.argmax() == energy["true"].argmax() == 1  # the middle one of three
    assert fidelity.relative_residual == pytest.approx(rms(residual) / largest.max())
    assert fidelity.energy_error == pytest.approx(rms(energy["predicted"] - energy["true"]) / energy["true"].max())
    missed = np.linalg.norm(reaction["predicted"] - reaction["true"], axis=1)
    assert fidelity.reaction_error == pytest.approx(rms(missed) / largest.max())
    frame = Checker(scene, mesh).frame(moved(TRUE, plane)[4], 4 / 7)
    assert frame.reaction == pytest.approx(reaction["true"][1]) and frame.energy == pytest.approx(energy["true"][1])
    assert frame.residual == pytest.approx(np.linalg.norm(node_forces(TRUE[4], mesh, plane, 4 / 7)[plane > 0]))


def test_stress_error_is_of_von_mises_in_each_box_over_that_of_the_truth(planes):
    # sigma = (lambda + 2 mu, lambda, lambda) e and mu g, mu h: von Mises sqrt((2 mu e)^2 + 3 mu^2 (g^2 + h^2))
    true, predicted = (np.sqrt((2 * MU * s[..., 0]) ** 2 + 3 * MU**2 * (s[..., 1] ** 2 + s[..., 2] ** 2))
                       for s in (TRUE[[1, 4, 7]], PREDICTED[[1, 4, 7]]))
    assert planes[0].stress_error == pytest.approx(rms(predicted - true) / rms(true))


def test_shape_of_the_cells_is_judged_in_every_frame(planes):
    fidelity = planes[0]

    def shape(strains):
        """Volume and aspect ratio L / V^(1/3) of each box, and its scaled Jacobian: the sine-like share of its x edges."""
        stretch, edge = 1 + 0.01 * strains[..., 0], np.linalg.norm([100, 0, 0] + strains, axis=-1) / 100
        volume = HX * HY * HZ * abs(stretch)
        return volume, np.maximum(HX * edge, HY) / np.cbrt(volume), stretch / edge

    (true, ratio, _), (volume, found, jacobian) = shape(TRUE[1:]), shape(PREDICTED[1:])
    # Only the box in the middle has two neighbours: their larger volume over the smaller one, and 1 twice, over three.
    continuity = [np.maximum(v[:, 0], v[:, 2]) / np.minimum(v[:, 0], v[:, 2]) / 3 for v in (volume, true)]
    assert fidelity.mc == pytest.approx(np.mean(abs(continuity[0] - continuity[1])))
    assert fidelity.ar == pytest.approx(np.mean(abs(found - ratio)))
    assert fidelity.smallest_det_f == pytest.approx(-0.5)  # stretched by -150 %
    assert fidelity.smallest_scaled_jacobian == pytest.approx(jacobian.min())
    assert fidelity.inverted_elements == 2  # at frame 5; one at frames 2 and 6
    assert fidelity.worst_step == 5


def test_on_request_the_mesh_is_judged_at_a_few_frames_and_one_reference_serves_many_predictions(planes):
    """Of frames 1, 4 and 7 none is inside out; all else is as of every frame."""
    whole, mesh, plane, scene = planes
    reference = Reference(moved(TRUE, plane), scene, mesh, plane > 0, sample=3, shapes=3)
    reference.verify(0 * moved(TRUE, plane))
    some = reference.verify(moved(PREDICTED, plane))
    alone = verify(*(moved(strains, plane)[[0, 1, 4, 7]] for strains in (PREDICTED, TRUE)), scene=None, mesh=mesh, free=plane > 0)
    shape = ("gf_h", "gf_c", "mc", "ar", "smallest_det_f", "smallest_scaled_jacobian", "inverted_elements")
    assert [getattr(some, name) for name in shape] == [getattr(alone, name) for name in shape]
    assert some.inverted_elements == 0 and whole.inverted_elements == 2
    assert {k: v for k, v in as_table(some).items() if k not in shape} == {k: v for k, v in as_table(whole).items() if k not in shape}


def test_the_report_is_the_figures_under_their_names(planes):
    table = as_table(planes[0])
    published = [f"rmse_{steps}{how}{nodes}" for nodes in ("", "_all_nodes") for how in ("", "_by_step") for steps in ("1", "50", "all")]
    distances = [f"rmsd_{steps}{nodes}" for nodes in ("", "_all_nodes") for steps in ("1", "50", "all")]
    assert list(table) == [
        *distances, *published, "gf_h", "gf_c", "mc", "ar", "relative_residual", "energy_error", "reaction_error", "stress_error",
        "estimated_error", "effectivity", "largest_penetration", "smallest_det_f", "smallest_scaled_jacobian", "inverted_elements",
        "worst_step"]
    assert table["inverted_elements"] == 2 and table["mc"] == planes[0].mc


ROLLERS = [{"where": f"{axis}-min", "fixed": axis} for axis in "xyz"]


def test_an_estimate_three_times_the_error_has_an_effectivity_of_three():
    """On rollers a bar stretches evenly; the prediction is three times as far from that as from the truth held against it."""
    scene, mesh, plane = bar(support=ROLLERS, load=[{"where": "x-max", "traction": [50.0, 0, 0]}])
    even = (np.arange(8) / 7)[:, None, None] * (mesh.points - ORIGIN) * [0.05, -0.0125, -0.0125]  # t / E, and -nu times that
    off = np.zeros((8, *mesh.points.shape))
    size = np.array([0.0, 2, 30, 1, 5, 6, 7, 4])  # frames 1, 4 and 7 are checked
    off[:, node_at(mesh, [3 * HX, HY, HZ])] = 1e-6 * size[:, None] * [2, 3, 6]
    off[:, node_at(mesh, [0, HY, HZ])] = 1e-6 * size[:, None] * [0, 40, -30]  # not among the nodes that count
    fidelity = verify(even + 3 * off, even + 2 * off, scene=scene, mesh=mesh, free=plane > 0, sample=3)
    # Elasticity is linear: one Newton step is the way to equilibrium, of 3 x 7 um at one of 12 nodes, squared 4 + 25 + 16 = 45.
    assert fidelity.estimated_error == pytest.approx(21e-6 * np.sqrt(45 / (3 * 12)), rel=1e-6)
    assert fidelity.effectivity == pytest.approx(3, rel=1e-6)
    assert fidelity.rmsd_all == pytest.approx(7e-6 * np.sqrt((4 + 900 + 1 + 25 + 36 + 49 + 16) / (7 * 12)))
    assert fidelity.worst_step == 2


def test_without_a_sample_every_frame_is_checked_and_never_more_than_there_are():
    scene, mesh, plane = bar(support=ROLLERS, load=[{"where": "x-max", "traction": [50.0, 0, 0]}])
    even = (np.arange(4) / 3)[:, None, None] * (mesh.points - ORIGIN) * [0.05, -0.0125, -0.0125]
    off = np.zeros((4, *mesh.points.shape))
    off[:, node_at(mesh, [3 * HX, HY, HZ])] = 1e-6 * np.array([0, 1, 2, 4])[:, None] * [2, 3, 6]
    for sample, squares in ((None, (1 + 4 + 16) / 3), (90, (1 + 4 + 16) / 3), (2, (1 + 16) / 2), (1, 1)):
        fidelity = verify(even + off, even, scene=scene, mesh=mesh, free=plane > 0, sample=sample)
        assert fidelity.estimated_error == pytest.approx(7e-6 * np.sqrt(squares / 12), rel=1e-6)
        assert fidelity.effectivity == pytest.approx(1, rel=1e-6)


def test_ratios_to_nothing_are_not_numbers():
    """Without any force in the truth there is no relative residual, energy, reaction or stress; without error no effectivity."""
    scene, mesh, plane = bar()
    nothing = np.zeros((3, *mesh.points.shape))
    stretched = moved(TRUE[[0, 1, 4]], plane)
    fidelity = verify(stretched, nothing, scene=scene, mesh=mesh, free=plane > 0)
    for name in ("relative_residual", "energy_error", "reaction_error", "stress_error"):
        assert np.isnan(getattr(fidelity, name)), name
    assert fidelity.effectivity == pytest.approx(1, rel=1e-6)  # the way back to rest is the error
    assert np.isnan(verify(stretched, stretched, scene=scene, mesh=mesh, free=plane > 0).effectivity)


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_prediction_that_is_not_finite_is_infinitely_wrong_and_none_of_its_cells_is_whole(broken):
    scene, mesh, plane = bar()
    truth = moved(TRUE, plane)
    prediction = truth.copy()
    prediction[4, plane == 2] = broken  # of the two boxes beside this plane
    with np.errstate(invalid="ignore"):
        fidelity = verify(prediction, truth, scene=scene, mesh=mesh, free=plane > 0)
    for name in ("gf_h", "gf_c", "relative_residual", "energy_error", "reaction_error", "stress_error", "estimated_error"):
        if name != "reaction_error":  # the first box is whole
            assert getattr(fidelity, name) == np.inf, name
    assert not np.isfinite(fidelity.rmsd_all) and fidelity.rmsd_1 == 0
    assert fidelity.inverted_elements == 2 and fidelity.worst_step == 4


def test_one_step_of_a_path_that_has_not_begun_to_move_is_no_number():
    """A prediction that stands still there has done nothing; where the truth moves, or single steps are given, there is one."""
    scene, mesh, plane = bar()
    truth = moved(TRUE, plane)
    late = truth.copy()
    late[1, plane > 0] = 0
    how = {"scene": scene, "mesh": mesh, "free": plane > 0, "sample": 1}
    figures = verify(late, late, **how)
    assert np.isnan(figures.rmsd_1) and np.isnan(figures.rmsd_1_all_nodes) and figures.rmsd_all == 0
    assert verify(truth, truth, **how).rmsd_1 == 0 and truth[1, plane > 0].any()
    assert verify(late, late, one_step=late[1:], **how).rmsd_1 == 0


def test_figures_of_several_paths_are_means_extremes_and_of_errors_as_published_the_root_of_the_mean_square():
    keys = ("rmsd_all", "rmse_1", "rmse_all", "rmse_all_by_step", "rmse_50_all_nodes", "rmse_1_by_step_all_nodes", "smallest_det_f")
    found = gathered([dict.fromkeys(keys, 1.0), dict.fromkeys(keys, 7.0) | {"rmse_1": np.nan}])
    assert found == pytest.approx({"rmsd_all": 4.0, "rmse_1": 1.0, "rmse_all": 5.0, "rmse_all_by_step": 4.0, "rmse_50_all_nodes": 5.0,
                                   "rmse_1_by_step_all_nodes": 4.0, "smallest_det_f": 1.0})


def test_a_body_in_a_plane_has_two_coordinates():
    mesh = build_mesh(Body(shape="plate", length=1.0, width=1.0, cells=(2, 1), cell="triangle", plane="strain", thickness=0.1))
    truth = np.zeros((3, len(mesh.points), 3))
    prediction = truth + [3e-3, 4e-3, 0]
    free = np.ones(len(mesh.points), bool)
    found = verify(prediction, truth, scene=None, mesh=mesh, free=free)
    assert found.rmsd_all == pytest.approx(5e-3) and found.rmse_all == found.rmse_all_by_step == pytest.approx(5e-3 / 2**0.5)
    truth[2, 0, 2] = 1e-9  # a cloth, which leaves its plane
    assert verify(prediction, truth, scene=None, mesh=mesh, free=free).rmse_all == pytest.approx(5e-3 / 3**0.5)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_plane_cells_have_the_figures_of_their_plane_and_those_of_a_cloth_no_volume(cell):
    """The second of two squares becomes a tenth shorter, which the truth does not."""
    mesh = rectangle(Body(shape="plate", length=2.0, width=1.0, cells=(2, 1), cell=cell))
    moved = np.zeros((2, len(mesh.points), 3))
    moved[1, mesh.points[:, 0] == 2.0, 0] = -0.1
    found = verify(moved, np.zeros_like(moved), scene=None, mesh=mesh, free=np.ones(len(mesh.points), bool))
    assert found.smallest_det_f == pytest.approx(0.9) and found.inverted_elements == 0
    if cell == "triangle":
        # Four triangles in a row, of 0.5, 0.5, 0.45 and 0.45 m2: the inner two have neighbours of which one is 1/0.9 times the other.
        assert found.mc == pytest.approx((0 + 1 / 9 + 1 / 9 + 0) / 4, rel=1e-6)
    else:
        assert found.mc == 0 and found.ar == pytest.approx((0.9**-0.5 - 1) / 2, rel=1e-6)  # one neighbour each; sides of 1 over sqrt(0.9)
    moved[1, 0, 2] = 0.01
    cloth = verify(moved, np.zeros_like(moved), scene=None, mesh=mesh, free=np.ones(len(mesh.points), bool))
    assert np.isnan(cloth.smallest_det_f) and np.isnan(cloth.inverted_elements) and np.isfinite([cloth.mc, cloth.ar]).all()
