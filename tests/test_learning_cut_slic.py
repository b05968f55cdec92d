"""The steps of segmentation, against graph superpixels in plain loops and cuts known on paper."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from datagen.files.trajectory import OBSTACLE
from learning.segments import cut as segments
from learning.segments.cut import body_graph, ends, segment
from learning.segments.features import Features, features
from physics.schema import InputError
from tests import plain_slic
from tests.graph_by_hand import one_cell, tiny
from tests.synthetic import bending


def path(nodes):
    """The edges of a chain, in both directions, sorted; and each node's neighbours."""
    return (np.array(sorted(pair for i in range(nodes - 1) for pair in ((i, i + 1), (i + 1, i)))).T,
            [[j for j in (i - 1, i + 1) if 0 <= j < nodes] for i in range(nodes)])


def along(values):
    """Features that differ in place along x alone."""
    return Features(np.outer(values, [0.0, 1.0, 0.0, 0.0]), 1.0)


@pytest.fixture(scope="module")
def beam():
    """A beam of 63 nodes with two modes, its neighbours, and its edges."""
    trajectory = bending(cells=(6, 2, 2), at=0.05)
    dice = np.random.default_rng(3).normal(size=trajectory.modes.shape).astype(np.float32) * 0.2
    trajectory = replace(trajectory, modes=trajectory.modes + dice * trajectory.body[:, None])
    graph = body_graph(trajectory)
    return trajectory, [graph.indices[graph.indptr[i]:graph.indptr[i + 1]].tolist() for i in range(63)], ends(graph)


# the graph

def test_the_body_graph_has_no_edge_of_the_obstacle():
    graph = body_graph(tiny())  # two tetrahedra that share a triangle: all pairs of 5 nodes but 0 and 4
    expected = np.ones((5, 5)) - np.eye(5)
    expected[0, 4] = expected[4, 0] = 0
    assert np.array_equal(graph.toarray(), expected)
    assert ends(graph).T.tolist() == [[i, j] for i in range(5) for j in range(5) if expected[i, j]]


# METIS

def test_metis_cuts_a_chain_into_equal_parts_with_the_fewest_cuts():
    edges, _ = path(12)
    graph = csr_matrix((np.ones(22, np.int8), edges), shape=(12, 12))
    for count in (2, 3, 4):
        part = segments._metis(graph, count)
        assert np.bincount(part).tolist() == [12 // count] * count and (np.diff(part) != 0).sum() == count - 1
    assert segments._metis(graph, 1).tolist() == [0] * 12


def test_metis_cuts_a_beam_across():
    # ten sections of 9 nodes; 9 edges between two of them, and no other cut into halves is as small
    trajectory = bending(cells=(9, 2, 2))
    label = segment(trajectory, count=2, method="metis")[trajectory.body]
    edges = ends(body_graph(trajectory))
    assert np.bincount(label).tolist() == [45, 45] and (label[edges[0]] != label[edges[1]]).sum() == 2 * 9


# superpixels

@pytest.mark.parametrize("method, tau", [("slic-od", 0.3), ("slic-od-l", 1.0), ("slic-md", 0.0), ("slic-mdod-e", 0.5)])
@pytest.mark.parametrize("start", ["metis", "dice"])
def test_refinement_is_its_literal_version(beam, method, tau, start, monkeypatch):
    trajectory, beside, edges = beam
    feature = features(trajectory, edges, count=6, method=method, tau=tau)
    table = feature.table.tolist()
    cut = segments._metis(body_graph(trajectory), 6) if start == "metis" else np.random.default_rng(1).integers(0, 6, 63)
    monkeypatch.setattr(segments, "_metis", lambda graph, count: cut)
    label = plain_slic.reattach(cut.tolist(), beside, table, tau)
    seen = [label]
    for sweeps in range(1, 11):
        found = segment(trajectory, count=6, method=method, tau=tau, iterations=sweeps) if sweeps in (1, 2, 10) else None
        label = plain_slic.reattach(plain_slic.sweep(label, beside, table, tau), beside, table, tau)
        seen.append(label)
        if found is not None:
            assert found[trajectory.body].tolist() == label, sweeps
            assert (found[~trajectory.body] == 6).all() and found.dtype == np.int32
    assert seen[0] != seen[1]
    assert segment(trajectory, count=6, method=method, tau=tau).tolist() == found.tolist()  # ten sweeps by default
    assert segment(trajectory, count=6, method=method, tau=tau, iterations=0)[trajectory.body].tolist() == seen[0]


def test_a_border_walks_a_layer_a_sweep_ten_sweeps_at_most(monkeypatch):
    # 41 sections of 4 nodes, at first one against 40: with n of them on this side, section n is (n + 1) / 2 from this centroid and
    # (40 - n) / 2 from the other, and goes over while n < 19.5. The place counts a hundred times what the obstacle does
    trajectory = bending(cells=(40, 1, 1))
    monkeypatch.setattr(segments, "_metis", lambda graph, count: (trajectory.points[trajectory.body, 0] > 1e-9).astype(np.int64))
    how = dict(count=2, method="slic-od", tau=100.0)
    sizes = [np.bincount(segment(trajectory, **how, **more))[0] for more in (dict(iterations=3), dict(), dict(iterations=50))]
    assert sizes == [4 * 4, 4 * 11, 4 * 20]


@pytest.mark.parametrize("seed", range(4))
def test_stray_pieces_are_handed_over_as_in_the_literal_version(beam, seed, monkeypatch):
    trajectory, beside, edges = beam
    label = np.random.default_rng(seed).integers(0, 5, 63)
    monkeypatch.setattr(segments, "_metis", lambda graph, count: label)
    table = features(trajectory, edges, count=5, method="metis", tau=0.5).table.tolist()
    found = segment(trajectory, count=5, method="metis")[trajectory.body].tolist()
    assert found == plain_slic.reattach(label.tolist(), beside, table, 0.5) != label.tolist()
    assert len(plain_slic.pieces(found, beside)) == 5


def test_a_segment_keeps_its_largest_piece():
    # 0 in three pieces of 1, 3 and 2 nodes; 1 in one of 2 and one of 3; so the first 0, the first 1s and the last 0s are stray
    label = np.array([0, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0])
    edges, beside = path(11)
    place = np.arange(11.0)
    # layer by layer: 2 and 9 first, then 1 and 10, then 0
    assert segments._reattach(label, edges, along(place)).tolist() == [0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1]
    assert plain_slic.reattach(label.tolist(), beside, along(place).table.tolist(), 1.0) == [0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1]
    whole = np.array([0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    assert segments._reattach(whole, edges, along(place)) is whole


@pytest.mark.parametrize("beyond, moves", [(-1.1e-5, True), (-0.9e-5, False), (0.9e-5, False), (1.1e-5, False)])
def test_a_node_moves_when_another_segment_is_nearer_by_more_than_a_tie(beyond, moves):
    # segment 0 at 0, 0 and 3 with centroid 1: its last node is 2 from it, and 2 + beyond from the centroid of segment 1
    edges, _ = path(5)
    moved = segments._sweep(np.array([0, 0, 0, 1, 1]), edges, along([0, 0, 3, 5 + beyond, 5 + beyond]))
    assert moved.tolist() == [0, 0, 1 if moves else 0, 1, 1]


@pytest.mark.parametrize("beyond, goes", [(-1.1e-5, 2), (-0.9e-5, 1), (0.9e-5, 1)])
def test_of_two_equally_near_segments_the_lower_number_takes_a_node(beyond, goes):
    # node 2, of segment 0 with centroid 20/3, lies between segments 1 (node 0, 3 away) and 2 (node 3, 3 + beyond away)
    edges = np.array([[0, 2], [1, 2], [2, 0], [2, 1], [2, 3], [2, 4], [3, 2], [4, 2]]).T
    table = along([-3.0, 10.0, 0.0, 3 + beyond, 10.0])
    for low, high in ((1, 2), (2, 1)):  # whichever comes first among the neighbours
        moved = segments._sweep(np.array([low, 0, 0, high, 0]), edges, table if low == 1 else along([-3 - beyond, 10.0, 0.0, 3.0, 10.0]))
        assert moved.tolist() == [low, 0, goes, high, 0]


def test_the_node_nearest_to_its_centroid_never_moves():
    # segment 0: two nodes at -3 and 3, both 3 from their mean, and 2 from segment 1, whose nodes stand at -1 and 5, with mean 2, and
    # at -5 and -3, with mean -4: so both want to go, and the lower number stays
    edges = np.array([[0, 1], [0, 4], [1, 0], [1, 2], [2, 1], [2, 3], [3, 2], [4, 0], [4, 5], [5, 4]]).T
    label = np.array([0, 0, 1, 1, 2, 2])
    assert segments._sweep(label, edges, along([-3.0, 3.0, -1.0, 5.0, -5.0, -3.0])).tolist() == [0, 1, 1, 1, 2, 2]
    # of three at 0, 3 and 5 the one in the middle stays anyway, and the last goes
    assert segments._sweep(np.array([0, 0, 0, 1, 1]), path(5)[0], along([0.0, 3.0, 5.0, 5.1, 5.1])).tolist() == [0, 0, 1, 1, 1]
    # the last of 0, 0, 0, 1 is farthest from their mean, the one before it stands at the centroid of segment 1 and is nearest
    edges = np.array([[0, 1], [1, 0], [1, 2], [2, 1], [2, 3], [3, 2]]).T
    assert segments._sweep(np.array([0, 0, 1, 1]), edges, along([-3.0, 1.0, 1.0, 1.5])).tolist() == [0, 1, 1, 1]


# what is refused, and what is not

def test_requests_at_the_limits():
    trajectory = tiny()
    most = segment(trajectory, count=5, method="metis", tau=0.0).tolist()  # METIS may leave parts empty; numbers have no gaps
    assert most[5:] == [max(most[:5]) + 1] * 4 and sorted(set(most)) == list(range(max(most) + 1))
    assert segment(trajectory, count=1, method="metis").tolist() == [0] * 5 + [1] * 4
    assert segment(one_cell(), count=1, method="metis").tolist() == [0] * 4
    for change, words in ((dict(count=6), "6 segments: must be from 1 to the 5 nodes"), (dict(count=0), "0 segments"),
                          (dict(tau=np.inf), "tau = inf: must be at least 0, and finite"), (dict(tau=-1e-9), "tau = -1e-09")):
        with pytest.raises(InputError, match=words):
            segment(trajectory, **{"count": 2, "method": "metis", **change})


def test_a_body_in_pieces_is_refused():
    loose = replace(tiny(), types=np.array([10, 5, 5], np.uint8), offsets=np.array([0, 4, 7, 10]),
                    connectivity=np.delete(tiny().connectivity, range(4)))
    assert (loose.node_kind == OBSTACLE).sum() == 4  # pieces of the obstacle do not count: node 0 is left over
    with pytest.raises(InputError, match="falls into 2 pieces, the smallest of 1 nodes"):
        segment(loose, count=2, method="metis")
