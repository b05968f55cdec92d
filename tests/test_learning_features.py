"""What the superpixel distance compares: every column from its definition, in segment sizes."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.files.trajectory import AIRFOIL, INFLOW, WALL, at_rest
from learning.segments import features as module
from learning.segments.features import Features, features
from learning.segments.harmonics import harmonics
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.schema import InputError
from tests.graph_by_hand import CELLS, REST, tiny
from tests.synthetic import bending

EDGES = np.array([(a, b) for a in range(5) for b in range(5) if any({a, b} <= set(cell) for cell in CELLS) and a != b]).T
LENGTH = np.mean([sum((REST[a] - REST[b]) ** 2) ** 0.5 for a, b in EDGES.T])  # 0.84 m


def solid(modes=(), frequencies=()):
    """`tiny` with modes on the body, and an obstacle that stands a long way off its rest place at step 0."""
    trajectory = tiny()
    moved = trajectory.displacement.copy()
    moved[0, 5:] = [-0.375, 0.25, -0.3125]  # node 5, at (4.125, -1.125, 5.9375), is 0.14 m from node 4
    shapes = np.zeros((len(modes), 9, 3), np.float32)
    for shape, mode in zip(shapes, modes, strict=True):
        shape[:5] = mode
    return replace(trajectory, displacement=moved, modes=shapes, frequencies_hz=tuple(frequencies))


def plane(kinds):
    """A plate of 3 x 2 cells, 0.6 m x 0.2 m, in z = 0; the kinds of some nodes."""
    mesh = build_mesh(Body(shape="plate", length=0.6, width=0.2, height=0.0, cells=(3, 2), cell="quadrilateral"))
    trajectory = at_rest(mesh, np.zeros((0, 12, 3)))
    for node, kind in kinds.items():
        trajectory.node_kind[node] = kind
    return trajectory


def spreads(table):
    """(N, N) distances between rows: what any choice of basis has in common."""
    return np.linalg.norm(table[:, None] - table, axis=2)


def test_the_distance_is_a_weighted_sum_of_three_lengths():
    # |2 - 5| + |(3, 4)| + 0.25 |(2, -3, 6)| = 3 + 5 + 0.25 * 7
    feature = Features(np.array([[9.0] * 6, [2.0, 1.0, 1.0, 5.0, 5.0, 5.0]]), 0.25)
    other = np.array([[5.0, 4.0, 5.0, 7.0, 2.0, 11.0], [2.0, 1.0, 1.0, 5.0, 5.0, 5.0]])
    assert feature.distance(np.array([1, 1]), other).tolist() == [9.75, 0]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_places_and_obstacle_count_in_segment_sizes(count):
    trajectory, size = solid(), LENGTH * (5 / count) ** (1 / 3)
    near = np.array([min(sum((REST[i] - REST[j] - trajectory.displacement[0, j]) ** 2) ** 0.5 for j in range(5, 9)) for i in range(5)])
    assert near.argmin() == 4 and 0.1 * LENGTH < near[4] < 0.2 * LENGTH
    for method, expected in (("metis", 0 * near), ("slic-od", near / size), ("slic-od-l", np.log(near / size)),
                             ("slic-od-e", np.exp(-near / size))):
        found = features(trajectory, EDGES, count=count, method=method, tau=0.7)
        assert found.table.shape == (5, 4) and found.tau == 0.7
        assert np.allclose(found.table, np.column_stack([expected, REST[:5] / size]), rtol=1e-12, atol=1e-12)


def test_the_logarithm_ends_at_a_tenth_of_an_edge():
    trajectory = solid()
    trajectory.displacement[0, 5:] = [-0.5, 0.25, -0.3125]  # node 5 at (4, -1.125, 5.9375): 1/16 m above node 4
    size = LENGTH * 5 ** (1 / 3)
    for method, expected in (("slic-od-l", np.log(0.1 * LENGTH / size)), ("slic-od", 0.0625 / size), ("slic-od-e", np.exp(-0.0625 / size))):
        assert features(trajectory, EDGES, count=1, method=method, tau=0.5).table[4, 0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("kinds", [{3: WALL, 4: WALL}, {3: AIRFOIL, 4: WALL}, {3: AIRFOIL, 4: AIRFOIL, 0: INFLOW}])
def test_a_plane_has_square_segments_and_measures_from_walls_and_airfoils(kinds):
    trajectory = plane(kinds)
    points, edges = trajectory.points, trajectory.mesh.edges.T
    # 9 edges of 0.2 m along x, 8 of 0.1 m along y
    assert edges.shape == (2, 17)
    size = (9 * 0.2 + 8 * 0.1) / 17 * (12 / 3) ** 0.5
    near = np.minimum(*(np.linalg.norm(points - points[node], axis=1) for node in (3, 4)))
    found = features(trajectory, np.concatenate([edges, edges[::-1]], axis=1), count=3, method="slic-od", tau=0.5).table
    assert np.allclose(found, np.column_stack([near / size, points / size]), rtol=1e-9, atol=1e-12)


def test_without_anything_to_measure_from_modes_still_do():
    trajectory = replace(plane({0: INFLOW}), modes=np.random.default_rng(0).normal(size=(1, 12, 3)).astype(np.float32))
    edges = trajectory.mesh.edges.T
    assert not features(trajectory, edges, count=3, method="slic-mdod-e", tau=0.5).table[:, 0].any()
    with pytest.raises(InputError, match=r"neither obstacle nor walls.*'slic-od-e'"):
        features(trajectory, edges, count=3, method="slic-od-e", tau=0.5)


MODE = np.array([[0, 0, 0], [1, 2, 0], [0, 0, 0.5], [3, -1, 0], [0, 4, 1.0]])
OTHER = np.array([[0, 1, 0], [2, 0, -1], [0, 3, 0.5], [1, 1, 0], [-2, 0, 1.0]])
THIRD = np.array([[5, 0, 0], [0, 0, 2], [1, 0, 0], [0, -3, 0], [1, 1, 1.0]])


def steepness(mode):
    return np.mean([sum((mode[a] - mode[b]) ** 2) ** 0.5 / sum((REST[a] - REST[b]) ** 2) ** 0.5 for a, b in EDGES.T])


def test_one_mode_changes_by_one_over_a_segment_size():
    size = LENGTH * (5 / 2) ** (1 / 3)
    table = features(solid([7 * MODE]), EDGES, count=2, method="slic-md", tau=0.5).table
    # whatever its amplitude was; the mode of the file is of single precision, its sign is arbitrary
    assert table.shape == (5, 1 + 3 + 3) and not table[:, 0].any()
    assert np.allclose(spreads(table[:, 1:4]), spreads(MODE / (size * steepness(MODE))), rtol=1e-6)


def orthonormal(*modes):
    """By Gram and Schmidt."""
    basis = []
    for mode in modes:
        rest = mode.ravel() - sum((mode.ravel() @ other) * other for other in basis)
        basis.append(rest / np.linalg.norm(rest))
    return np.concatenate([vector.reshape(5, 3) for vector in basis], axis=1)


@pytest.mark.parametrize("frequencies, count, taken", [
    ((10.0, 10.2, 10.21), 1, (MODE, OTHER)),  # up to 2 % above the wanted one, that included
    ((30.0, 10.2, 10.0), 1, (THIRD, OTHER)),  # the lowest frequency first, whatever the order in the file
    ((10.0, 10.19, 10.3), 2, (MODE, OTHER, THIRD)),  # 2 % above the last wanted one
    ((10.0, 10.1, 20.0), 2, (MODE, OTHER)),
    ((10.0, 20.0, 20.5), 2, (MODE, OTHER)),
    ((), 1, (MODE,)), ((), 2, (MODE, OTHER)), ((), 3, (MODE, OTHER, THIRD))])  # without frequencies: as they come
def test_of_several_modes_the_space_counts(frequencies, count, taken):
    trajectory = solid([MODE, 5 * OTHER, THIRD], frequencies)
    table = features(trajectory, EDGES, count=2, method="slic-md", tau=0.5, mode_count=count).table
    basis = orthonormal(*taken)
    expected = basis / (LENGTH * (5 / 2) ** (1 / 3) * np.mean([np.linalg.norm(basis[a] - basis[b]) / np.linalg.norm(REST[a] - REST[b])
                                                              for a, b in EDGES.T]))
    assert table.shape == (5, 4 + 3 * len(taken)) and np.allclose(spreads(table[:, 1:-3]), spreads(expected), rtol=1e-5)


def test_a_mode_that_adds_nothing_is_left_out_and_a_small_one_is_not():
    for extra, width in ((0.0, 3), (1e-4, 6)):
        trajectory = solid([MODE, MODE + extra * OTHER])
        assert features(trajectory, EDGES, count=2, method="slic-md", tau=0.5, mode_count=2).table.shape == (5, 4 + width)


def test_a_mode_that_is_the_same_everywhere_has_no_length_and_unit_mean_square():
    table = features(solid([np.ones((5, 3)) * [0, 0, 3]]), EDGES, count=2, method="slic-md", tau=0.5).table
    assert np.allclose(abs(table[:, 1:4]), [0, 0, 1], atol=1e-12)


def test_missing_modes_are_named():
    for modes, count, words in (((), 1, "carries no modes"), ((MODE,), 2, "carries 1 of the 2 modes")):
        with pytest.raises(InputError, match=words):
            features(solid(modes), EDGES, count=2, method="slic-md", tau=0.5, mode_count=count)


def test_laplacian_modes_of_the_file_are_those_that_move_and_near_copies_of_the_last():
    still = np.full((5, 3), 2.0)
    # eigenvalues grow with the square of a frequency: copies are those up to 1.02^2 = 1.0404 of the last wanted one
    for eigenvalues, taken in (((0.0, 10.0, 10.403, 10.41), (MODE, OTHER)), ((0.0, 10.0, 10.41, 20.0), (MODE,))):
        trajectory = replace(solid([still, MODE, OTHER, THIRD]), extra={"laplacian_eigenvalues": list(eigenvalues)})
        table = features(trajectory, EDGES, count=2, method="slic-md", tau=0.5, modes="laplacian").table
        basis = np.linalg.qr(np.stack([mode[:, 2] for mode in taken], axis=1))[0]  # their third component is the value
        found, expected = spreads(table[:, 1:-3]), spreads(basis)
        assert table.shape == (5, 4 + len(taken)) and np.allclose(found / found.mean(), expected / expected.mean(), rtol=1e-5)


def test_laplacian_modes_that_the_file_lacks_are_computed():
    trajectory = bending(cells=(5, 2, 1))
    edges = np.concatenate([trajectory.mesh.edges, trajectory.mesh.edges[:, ::-1]]).T
    shapes = np.zeros((1, len(trajectory.points), 3), np.float32)
    for extra in ({}, {"laplacian_eigenvalues": [1.0]}):  # a single mode that does not move
        table = features(replace(trajectory, modes=shapes, extra=extra), edges, count=2, method="slic-md", tau=0.5, modes="laplacian").table
        _, (mode,) = harmonics(trajectory, count=1)
        ratio = spreads(table[:, 1:-3])[0, -5:] / abs(mode[-5:] - mode[0])
        assert table.shape[1] == 5 and np.allclose(ratio, ratio[0], rtol=1e-9)


def test_computed_laplacian_modes_come_with_the_near_copies_of_the_last(monkeypatch):
    asked = []
    monkeypatch.setattr(module, "harmonics", lambda _, **how: asked.append(how) or (None, MODE.T[:2]))
    table = features(tiny(), EDGES, count=2, method="slic-md", tau=0.5, modes="laplacian", mode_count=3).table
    assert asked == [{"count": 3, "cluster": pytest.approx(1.0404)}] and table.shape == (5, 4 + 2)
