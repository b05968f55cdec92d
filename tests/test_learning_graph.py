"""Graphs of frames: the right edges, and features that know no origin."""

from dataclasses import replace

import numpy as np
import torch

from datagen.trajectory import OBSTACLE
from learning.graph import build_graph, build_skeleton, contact_edges, join
from tests.synthetic import bending

RADIUS = 0.006


def frame(trajectory, step, radius=RADIUS):
    u = trajectory.displacement.astype(np.float64)
    skeleton = build_skeleton(trajectory, np.where(trajectory.body, 0, 1))
    return build_graph(skeleton, trajectory.points + u[step], u[step + 1] - u[step], radius)


def test_contact_edges_are_those_of_all_pairs():
    trajectory = bending()
    for step in range(len(trajectory.displacement)):
        x = trajectory.points + trajectory.displacement[step]
        rigid = trajectory.node_kind == OBSTACLE
        near = np.linalg.norm(x[:, None] - x[None], axis=-1) <= RADIUS
        expected = np.argwhere(near & (rigid[:, None] != rigid[None]))
        found = contact_edges(x, rigid, RADIUS).T
        assert len(expected) > 0
        assert sorted(map(tuple, found)) == sorted(map(tuple, expected))


def test_mesh_edges_run_both_ways_once_and_are_sorted_by_receiver():
    graph = frame(bending(), 3)
    pairs = list(map(tuple, graph.mesh_pair.T.tolist()))
    assert len(set(pairs)) == len(pairs)
    assert {(b, a) for a, b in pairs} == set(pairs)
    assert (graph.mesh_pair[1].diff() >= 0).all() and (graph.contact_pair[1].diff() >= 0).all()


def test_body_and_obstacle_are_joined_by_contact_edges_alone():
    trajectory = bending()
    graph, rigid = frame(trajectory, 3), torch.from_numpy(trajectory.node_kind == OBSTACLE)
    assert (rigid[graph.mesh_pair[0]] == rigid[graph.mesh_pair[1]]).all()
    assert (rigid[graph.contact_pair[0]] != rigid[graph.contact_pair[1]]).all()


def test_features_do_not_know_where_the_scene_is():
    trajectory = bending()
    moved = replace(trajectory, points=trajectory.points + [3.0, -2.0, 1.0])
    here, there = frame(trajectory, 3), frame(moved, 3)
    assert torch.equal(here.contact_pair, there.contact_pair)
    for name in ("node", "mesh_edge", "contact_edge"):
        # features are float32 of at most 0.02 m: half a unit in the last place is 1e-9 m
        assert torch.allclose(getattr(here, name), getattr(there, name), rtol=0, atol=2e-9)


def test_only_prescribed_nodes_carry_their_next_velocity():
    trajectory = bending()
    velocity = frame(trajectory, 3).node[:, 3:6].numpy()
    assert not velocity[trajectory.free].any()
    rigid = trajectory.node_kind == OBSTACLE
    # a float32 difference of displacements near 0.02 m: one rounding of 2e-9 m
    assert np.allclose(velocity[rigid], (trajectory.displacement[4] - trajectory.displacement[3])[rigid], atol=2e-9)


def test_without_contact_or_obstacle_the_edges_are_empty():
    far = frame(bending(gap=0.05, travel=0.001), 3)
    assert far.contact_edge.shape == (0, 4) and far.contact_pair.shape == (2, 0)
    assert contact_edges(np.zeros((5, 3)), np.zeros(5, bool), RADIUS).shape == (2, 0)


def test_a_union_counts_nodes_and_segments_on():
    first, second = frame(bending(), 3), frame(bending(cells=(6, 2, 2)), 5)
    union = join([first, second, first])
    nodes, edges = len(first.node) + len(second.node), first.mesh_pair.shape[1] + second.mesh_pair.shape[1]
    assert torch.equal(union.mesh_pair[:, edges:] - nodes, first.mesh_pair)
    assert torch.equal(union.segment[nodes:] - 4, first.segment)
    assert union.graph_of_segment.tolist() == [0, 0, 1, 1, 2, 2]
