"""Segments: in one piece, none empty, and nobody's sign or origin in them."""

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from datagen.trajectory import OBSTACLE
from learning.graph import mesh_edges
from learning.segments import METHODS, segment, segment_quality
from physics.schema import InputError
from tests.synthetic import bending


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [1, 2, 7, 19, 40])
@pytest.mark.parametrize("tau", [0.0, 0.5])
def test_segments_are_connected_and_none_is_empty(method, count, tau):
    trajectory = bending(cells=(10, 2, 2))  # 99 nodes
    label = segment(trajectory, count=count, method=method, tau=tau)
    body = label[trajectory.body]
    # METIS may leave a part empty once parts hold two or three nodes; numbers have no gaps all the same
    assert body.max() + 1 == count if count <= 19 else body.max() + 1 >= 0.6 * count
    assert (np.bincount(label) > 0).all()
    edges = mesh_edges(trajectory)
    edges = edges[label[edges[:, 0]] == label[edges[:, 1]]]
    inside = coo_array((np.ones(len(edges)), edges.T), shape=(len(label), len(label)))
    _, piece = connected_components(inside, directed=False)
    assert all(len(np.unique(piece[label == k])) == 1 for k in range(body.max() + 1))


def test_the_obstacle_is_the_last_segment():
    trajectory = bending()
    label = segment(trajectory, count=7)
    assert (label[trajectory.node_kind == OBSTACLE] == 7).all()
    assert (label[trajectory.body] < 7).all()


def test_the_sign_of_a_mode_makes_no_difference():
    trajectory = bending(cells=(20, 4, 4))
    sign = np.array([-1, 1], np.float32)[:, None, None]
    assert np.array_equal(segment(trajectory), segment(replace(trajectory, modes=sign * trajectory.modes)))


def test_the_choice_inside_a_double_eigenvalue_makes_no_difference():
    trajectory = bending(cells=(20, 4, 4))
    c, s = np.cos(0.7), np.sin(0.7)
    turned = np.einsum("ab,bnd->and", np.array([[c, -s], [s, c]]), trajectory.modes).astype(np.float32)
    assert np.array_equal(segment(trajectory), segment(replace(trajectory, modes=turned)))


def test_only_the_start_counts():
    trajectory = bending()
    other = trajectory.displacement.copy()
    other[1:] += 1.0
    assert np.array_equal(segment(trajectory), segment(replace(trajectory, displacement=other)))


def test_the_scale_of_the_scene_makes_no_difference():
    # a thousand times larger by a power of two, so that every rounding stays the same
    trajectory = bending(cells=(20, 4, 4))
    assert np.array_equal(segment(trajectory), segment(replace(trajectory, points=1024 * trajectory.points)))


def test_refinement_follows_mode_and_obstacle():
    trajectory = bending(cells=(40, 4, 4))
    metis, refined = (segment(trajectory, method=method) for method in METHODS)
    assert not np.array_equal(metis, refined)
    mode = trajectory.modes[0, trajectory.body, 2]

    def spread(label):  # mean square distance of the mode from its segment's mean
        label = label[trajectory.body]
        mean = np.bincount(label, weights=mode) / np.bincount(label)
        return ((mode - mean[label]) ** 2).mean()

    assert spread(refined) < spread(metis)


def test_quality_of_two_halves_by_hand():
    # a row of 4 prism layers cut in the middle: 9 edges along x and none across leave the cut, of 4*9 + 5*16 = 116
    trajectory = bending(cells=(4, 2, 2))
    label = np.where(trajectory.points[:, 0] > 0.0625 - 1e-9, 1, 0)
    quality = segment_quality(trajectory, label)
    assert quality["edge_cut_ratio"] == 9 / 116
    larger, smaller = 3 * 32 + 2 * 18 + 9, 2 * 32 + 1 * 18 + 9  # sums of degrees on either side
    assert larger + smaller == 2 * 116
    assert quality["conductance"] == 9 / smaller


@pytest.mark.parametrize("change, words", [
    (dict(count=0), "0 segments"), (dict(count=100), "99 nodes"), (dict(method="slic-mdod"), "did you mean 'slic-mdod-e'")])
def test_wrong_requests_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        segment(bending(), **change)


def test_a_trajectory_without_modes_needs_metis():
    bare = replace(bending(), modes=np.zeros((0, 147, 3), np.float32), frequencies_hz=())
    with pytest.raises(InputError, match="'metis' does without"):
        segment(bare)
    segment(bare, method="metis")


def test_1500_nodes_take_milliseconds():
    trajectory = bending(cells=(40, 5, 5))
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        segment(trajectory)
        seconds.append(time.perf_counter() - start)
    assert min(seconds) < 0.1  # 0.02 s on a free core; five times that for a busy one
