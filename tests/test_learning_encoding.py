"""Random-walk encodings: the powers that they are, the same for any numbering, and free of place and shape."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from learning.graphs import encoding
from learning.graphs.encoding import mesh_graph, random_walk, segment_graph
from learning.graphs.graph import build_skeleton, neighbours
from learning.segments.cut import segment
from learning.segments.edges import mesh_edges
from tests.synthetic import bending


def beam():
    """The mesh graph of a small beam and its obstacle, its segments and the overlap of these."""
    trajectory = bending()
    pair = np.concatenate([(edges := mesh_edges(trajectory)), edges[:, ::-1]]).T
    label = segment(trajectory, count=7).astype(np.int64)
    return trajectory, mesh_graph(pair, len(trajectory.points)), label, neighbours(label, pair)


@pytest.mark.parametrize("steps", [1, 2, 7, 16])
def test_values_are_the_diagonals_of_powers(steps, monkeypatch):
    _, graph, label, shared = beam()
    monkeypatch.setattr(encoding, "ROWS", 40)  # several blocks of rows
    for adjacency in (graph, segment_graph(graph, label), segment_graph(graph, label, shared)):
        dense = adjacency.toarray()
        walk = dense / dense.sum(axis=1, keepdims=True)
        powers = [np.linalg.matrix_power(walk, k).diagonal() for k in range(1, steps + 1)]
        # single precision of values up to 1
        assert np.allclose(random_walk(adjacency, steps), np.stack(powers, axis=1), rtol=0, atol=1e-7)


def test_a_ring_and_a_pair_by_hand():
    ring = csr_matrix(np.roll(np.eye(5), 1, axis=1) + np.roll(np.eye(5), -1, axis=1))
    assert random_walk(ring, 5)[0] == pytest.approx([0, 1 / 2, 0, 3 / 8, 1 / 16])  # of 32 walks of five steps two go round
    weighted = csr_matrix(np.array([[2.0, 1.0], [1.0, 0.0]]))  # a loop of weight 2 and an edge
    assert random_walk(weighted, 2) == pytest.approx(np.array([[2 / 3, 7 / 9], [0, 1 / 3]]))


def test_weights_between_segments_are_sums_over_their_nodes():
    _, graph, label, shared = beam()
    dense = graph.toarray()
    member = label == np.arange(8)[:, None]  # (K, N)
    for more in (None, shared):
        if more is not None:
            member = member.copy()
            member[more[1], more[0]] = True
        expected = [[dense[np.ix_(s, t)].sum() for t in member] for s in member]
        assert np.array_equal(segment_graph(graph, label, more).toarray(), expected)


def test_a_mesh_counts_each_edge_once_and_a_lone_node_as_its_own_neighbour():
    found = mesh_graph(np.array([[0, 1, 1, 3], [1, 0, 3, 1]]), 4).toarray()
    assert found.tolist() == [[0, 1, 0, 0], [1, 0, 0, 1], [0, 0, 1, 0], [0, 1, 0, 0]]
    # segments {0, 1}, {3} and {2}: an edge inside counts twice; node 2 is also of the second
    weight = segment_graph(csr_matrix(found), np.array([0, 0, 2, 1]), np.array([[2], [1]])).toarray()
    assert weight.tolist() == [[2, 1, 0], [1, 1, 1], [0, 1, 1]]


def test_numbering_makes_no_difference():
    _, graph, label, _ = beam()
    order = np.random.default_rng(0).permutation(graph.shape[0])
    shuffled = graph[order][:, order]
    # sums of some 100 terms in another order, rounded to single precision
    assert np.allclose(random_walk(shuffled, 9), random_walk(graph, 9)[order], rtol=0, atol=1e-7)
    renamed = np.random.default_rng(1).permutation(8)
    after, before = (random_walk(segment_graph(graph, labels), 9) for labels in (renamed[label], label))
    assert np.allclose(after[renamed], before, rtol=0, atol=1e-7)


def test_walks_leave_neither_the_obstacle_nor_a_lone_node():
    _, graph, label, _ = beam()
    codes = random_walk(segment_graph(graph, label), 6)
    assert np.allclose(codes[7], 1) and (codes[:7, 1:] < 1).all()
    lone = mesh_graph(np.array([[0, 1], [1, 0]]), 3)
    assert random_walk(lone, 4).tolist() == [[0, 1, 0, 1], [0, 1, 0, 1], [1, 1, 1, 1]]


def test_a_skeleton_carries_them_for_any_number_of_segments():
    trajectory, graph, _, _ = beam()
    for count in (1, 3, 40):
        label = segment(trajectory, count=count)
        skeleton = build_skeleton(trajectory, label, overlap=1, walk=6)
        assert skeleton.node_code is not None and skeleton.segment_code is not None and skeleton.shared is not None
        assert np.array_equal(skeleton.node_code, random_walk(graph, 6))
        assert skeleton.segment_code.shape == (label.max() + 1, 6)
    plain = build_skeleton(trajectory, label)
    assert plain.shared is plain.node_code is plain.segment_code is None
