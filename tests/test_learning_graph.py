"""Graphs of frames: each edge and each feature from its definition, on a mesh small enough for plain loops; no origin anywhere."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE
from learning.graphs.encoding import mesh_graph, random_walk
from learning.graphs.graph import build_graph, build_skeleton, contact_edges, join, neighbours
from learning.segments.edges import mesh_edges
from tests.graph_by_hand import KIND, REST, assert_graph_is, edges_by_hand, one_cell, tiny
from tests.synthetic import bending

RADIUS = 0.006
SEGMENT = np.array([0, 1, 0, 1, 2, 3, 3, 3, 3], np.int32)


def frame(trajectory, step, radius=RADIUS):
    u = trajectory.displacement.astype(np.float64)
    skeleton = build_skeleton(trajectory, np.where(trajectory.body, 0, 1))
    return build_graph(skeleton, trajectory.points + u[step], u[step + 1] - u[step], radius)


# one frame, from the definition

@pytest.mark.parametrize("radius, count", [(1.0, 2), (2.0, 10), (5.0, 20)])
def test_edges_and_features_are_their_definitions(radius, count):
    trajectory = tiny()
    x, after = (REST + trajectory.displacement[step] for step in (2, 3))
    known = np.arange(27.0).reshape(9, 3) / 8 - 1
    graph = build_graph(build_skeleton(trajectory, SEGMENT), x, after - x, radius, known)
    assert_graph_is(graph, REST, x, after - x, known, KIND, radius)
    assert graph.contact_pair.shape[1] == 2 * count  # of 20 pairs, each in both directions
    assert graph.segment.tolist() == [0, 1, 0, 1, 2, 3, 3, 3, 3] and graph.graph_of_segment.tolist() == [0, 0, 0, 0]
    assert graph.shared is graph.node_code is graph.segment_code is None


def test_an_edge_on_paper():
    # nodes 1 and 2, moved to (4, -2, 6) and (3, 0, 4): from 1 to 2, X = (0.375, -0.625, -0.125), x = (1, -2, 2) with |x| = 3
    x = REST.copy()
    x[1], x[2] = (4, -2, 6), (3, 0, 4)
    graph = build_graph(build_skeleton(tiny(), SEGMENT), x, np.zeros((9, 3)), 0.1)
    long = (0.375**2 + 0.625**2 + 0.125**2) ** 0.5
    row = graph.mesh_pair.T.tolist().index([1, 2])
    assert graph.mesh_edge[row].tolist() == pytest.approx([0.375, -0.625, -0.125, long, 0.625, -1.375, 2.125, 3 - long], abs=2e-7)
    back = graph.mesh_pair.T.tolist().index([2, 1])  # vectors turn round, lengths do not
    assert graph.mesh_edge[back].tolist() == pytest.approx([-0.375, 0.625, 0.125, long, -0.625, 1.375, -2.125, 3 - long], abs=2e-7)
    # free, at rest; the held nodes' mean is (3.0625, -1.625, 5.125)
    assert graph.node[1].tolist() == [1, 0, 0, 0, 0, 0, 0.4375, -0.25, 0, 0.5, -0.125, 0.875]
    assert graph.node[2].tolist() == [0, 0, 1, 0, 0, 0, 0.0625, 0.375, 0.125, -0.125, 1.25, -1.25]


def test_free_nodes_show_what_is_known_and_prescribed_ones_their_next_velocity():
    skeleton, velocity = build_skeleton(tiny(), SEGMENT), np.arange(1.0, 28).reshape(9, 3)
    shown = build_graph(skeleton, REST, velocity, 0.1).node[:, 3:6].numpy()
    assert not shown[[1, 3, 4]].any()
    assert np.array_equal(shown[[0, 2, 5, 6, 7, 8]], velocity[[0, 2, 5, 6, 7, 8]])  # held ones too, if they are moved
    assert np.array_equal(build_graph(skeleton, REST, velocity, 0.1, -velocity).node[[1, 3, 4], 3:6].numpy(), -velocity[[1, 3, 4]])


def test_a_skeleton_is_the_rest_state():
    trajectory = tiny()
    skeleton = build_skeleton(trajectory, SEGMENT)
    assert skeleton.pair.T.tolist() == [list(pair) for pair in edges_by_hand()]
    assert np.array_equal(skeleton.rest, REST) and skeleton.free.tolist() == [False, True, False, True, True] + [False] * 4
    assert skeleton.kind.argmax(axis=1).tolist() == [2, 0, 2, 0, 0, 1, 1, 1, 1] and (skeleton.kind.sum(axis=1) == 1).all()
    assert np.allclose(skeleton.place, REST - [3.0625, -1.625, 5.125], rtol=0, atol=1e-7)
    assert skeleton.segment.dtype == np.int64 and skeleton.segment.tolist() == SEGMENT.tolist()
    # none held: from the mean of the body, without the obstacle
    loose = build_skeleton(replace(trajectory, node_kind=np.where(KIND == OBSTACLE, OBSTACLE, NORMAL).astype(np.uint8)), SEGMENT)
    assert np.allclose(loose.place, REST - [3.375, -1.6, 5.45], rtol=0, atol=3e-7)


def test_edges_of_all_kinds_of_cells_are_there_once():
    edges = mesh_edges(tiny()).tolist()
    assert edges == sorted([a, b] for a, b in edges_by_hand() if a < b) and len(edges) == 9 + 5
    # 4 x 2 x 2 blocks of two prisms with 45 nodes: 36 edges along x, 5 sections of 12 sides and 4 diagonals
    beam = bending(cells=(4, 2, 2))
    body = mesh_edges(beam)[:36 + 5 * 16 + 1]
    assert (body[:-1] < 45).all() and (body[-1] >= 45).all()


def test_features_do_not_know_where_the_scene_is():
    trajectory = bending()
    moved = replace(trajectory, points=trajectory.points + [3.0, -2.0, 1.0])
    here, there = frame(trajectory, 3), frame(moved, 3)
    assert torch.equal(here.contact_pair, there.contact_pair)
    for name in ("node", "mesh_edge", "contact_edge"):
        # features are float32 of at most 0.02 m: half a unit in the last place is 1e-9 m
        assert torch.allclose(getattr(here, name), getattr(there, name), rtol=0, atol=2e-9)


def test_numbering_makes_no_difference():
    trajectory, order = tiny(), np.array([4, 2, 0, 1, 3, 8, 6, 5, 7])  # new node i is old node order[i]
    name = np.argsort(order)
    other = replace(trajectory, points=REST[order], node_kind=KIND[order], connectivity=name[trajectory.connectivity],
                    displacement=trajectory.displacement[:, order])
    here, there = frame(trajectory, 2, 1.0), frame(other, 2, 1.0)
    assert torch.allclose(there.node, here.node[order], rtol=0, atol=2e-7)
    for pair, edge in (("mesh_pair", "mesh_edge"), ("contact_pair", "contact_edge")):
        one = {(int(name[s]), int(name[r])): row.tolist() for (s, r), row in zip(getattr(here, pair).T, getattr(here, edge), strict=True)}
        two = {(int(s), int(r)): row.tolist() for (s, r), row in zip(getattr(there, pair).T, getattr(there, edge), strict=True)}
        assert one == two and (getattr(there, pair)[1].diff() >= 0).all()


# contact

def test_contact_edges_are_those_of_all_pairs():
    trajectory = bending()
    rigid = trajectory.node_kind == OBSTACLE
    for step in (0, 4, 10):
        x = trajectory.points + trajectory.displacement[step]
        near = np.linalg.norm(x[:, None] - x[None], axis=-1) <= RADIUS
        expected = np.argwhere((near & (rigid[:, None] != rigid[None])).T)[:, ::-1]  # by receiver, then by sender
        assert len(expected) > 0
        assert np.array_equal(contact_edges(x, rigid, RADIUS).T, expected)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_radius_is_the_largest_distance_on_every_side(axis, side):
    # an obstacle node, and body nodes at, just inside and just outside of 5/4, along an axis and aslant by 3/4 and 1
    one, aslant = np.eye(3)[axis] * side, np.roll([0.75, 1.0, 0.0], axis) * side
    offset = np.array([0 * one, 1.25 * one, 1.2 * one, 1.3 * one, aslant, 1.05 * aslant, 0.95 * aslant, 0 * one])
    obstacle = np.arange(8) == 0
    x = np.array([8.0, -16.0, 4.0]) + offset
    found = contact_edges(x, obstacle, 1.25)
    assert found.T.tolist() == [[1, 0], [2, 0], [4, 0], [6, 0], [7, 0], [0, 1], [0, 2], [0, 4], [0, 6], [0, 7]]


def test_without_contact_or_obstacle_the_edges_are_empty():
    far = frame(bending(gap=0.05, travel=0.001), 3)
    assert far.contact_edge.shape == (0, 4) and far.contact_pair.shape == (2, 0)
    alone = contact_edges(np.zeros((5, 3)), np.zeros(5, bool), RADIUS)
    assert alone.shape == (2, 0) and alone.dtype == np.int64


# segments and encodings beside the nodes

def test_overlap_by_hand():
    # segments 0 = {0, 2}, 1 = {1, 3}, 2 = {4}: nodes 1, 2, 3 are joined to all, 0 and 4 are not joined to one another
    skeleton = build_skeleton(tiny(), SEGMENT, overlap=1)
    assert skeleton.shared.T.tolist() == [[0, 1], [1, 0], [1, 2], [2, 1], [2, 2], [3, 0], [3, 2], [4, 0], [4, 1]]
    assert np.array_equal(neighbours(SEGMENT.astype(np.int64), skeleton.pair), skeleton.shared)


def test_encodings_ride_along():
    skeleton = build_skeleton(tiny(), SEGMENT, overlap=1, walk=3)
    assert np.array_equal(skeleton.node_code, random_walk(mesh_graph(np.array(edges_by_hand()).T, 9), 3))
    # V_k with the ring around it: {0, 1, 2, 3, 4} twice, {1, 2, 3, 4}, the obstacle. The body has 9 edges, 6 of them among
    # 1, 2, 3, 4; from 0 three lead there. So A = (18, 18, 15; 18, 18, 15; 15, 15, 12), and back after one step come
    member = np.array([[1, 1, 1, 1, 1], [1, 1, 1, 1, 1], [0, 1, 1, 1, 1]])
    joined = np.ones((5, 5)) - np.eye(5)
    joined[0, 4] = joined[4, 0] = 0
    weight = member @ joined @ member.T
    assert weight.tolist() == [[18, 18, 15], [18, 18, 15], [15, 15, 12]]
    assert skeleton.segment_code[:, 0] == pytest.approx([18 / 51, 18 / 51, 12 / 42, 1])
    graph = build_graph(skeleton, REST, np.zeros((9, 3)), 0.1)
    for name in ("shared", "node_code", "segment_code"):
        assert np.array_equal(getattr(graph, name).numpy(), getattr(skeleton, name))
    plain = build_skeleton(tiny(), SEGMENT, walk=2)  # without overlap: {0, 2} has one edge of 3 + 4 ends
    assert plain.segment_code[0, 0] == pytest.approx(2 / 7) and plain.shared is None


# several graphs

def test_a_union_counts_nodes_and_segments_on():
    large = build_skeleton(tiny(), SEGMENT, overlap=1, walk=2)
    small = build_skeleton(one_cell(), np.array([1, 0, 1, 1]), overlap=1, walk=2)
    first = build_graph(large, REST + 0.25 * np.arange(27).reshape(9, 3), np.ones((9, 3)), 9.0)
    second = build_graph(small, small.rest, np.ones((4, 3)), 9.0)
    union = join([first, second, first])
    parts, at, by = (first, second, first), (0, 9, 13), (0, 4, 6)  # 9 nodes in 4 segments, 4 in 2, 9 in 4
    for name in ("node", "mesh_edge", "contact_edge", "node_code", "segment_code"):
        assert getattr(union, name).tolist() == [row for part in parts for row in getattr(part, name).tolist()]
    for name in ("mesh_pair", "contact_pair"):
        assert getattr(union, name).T.tolist() == [[s + a, r + a] for part, a in zip(parts, at, strict=True)
                                                   for s, r in getattr(part, name).T.tolist()]
    assert union.segment.tolist() == [s + b for part, b in zip(parts, by, strict=True) for s in part.segment.tolist()]
    assert union.shared.T.tolist() == [[n + a, s + b] for part, a, b in zip(parts, at, by, strict=True) for n, s in part.shared.T.tolist()]
    assert union.graph_of_segment.tolist() == [0, 0, 0, 0, 1, 1, 2, 2, 2, 2]
    assert first.contact_pair.shape[1] > 0 and second.contact_pair.shape == (2, 0)
    again = join([union, second])  # a union of three counts as three
    assert again.graph_of_segment.tolist() == [0, 0, 0, 0, 1, 1, 2, 2, 2, 2, 3, 3]
    assert again.segment[22:].tolist() == [11, 10, 11, 11] and join([first]) is first


def test_a_union_of_plain_graphs_has_neither_overlap_nor_encodings():
    union = join([frame(tiny(), 1), frame(tiny(), 2)])
    assert union.shared is union.node_code is union.segment_code is None
    assert union.node.shape == (18, 12)


def test_a_node_held_is_told_from_a_free_one_and_from_the_obstacle():
    assert [frame(tiny(), 1).node[i, :3].tolist() for i in (1, 5, 0)] == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert (NORMAL, OBSTACLE, HANDLE) == (0, 1, 3)  # the numbers of the files


def test_the_last_segment_may_be_another_ones_neighbour():
    """Three nodes in a row that goes round, each a segment of its own: 0 touches 2, the last one, and 1 touches nobody."""
    found = neighbours(np.array([0, 1, 2]), np.array([[0, 2], [2, 0]]))
    assert found.tolist() == [[0, 2], [2, 0]]


def test_a_graph_that_is_there_already_is_not_copied():
    skeleton = build_skeleton(tiny(), SEGMENT)
    graph = build_graph(skeleton, REST, np.zeros_like(REST), 1.0)
    assert graph.to(torch.device("cpu")) is graph and skeleton.levels == graph.levels == ()
    away = graph.to(torch.device("meta"))
    assert away is not graph and away.node.device.type == "meta"
