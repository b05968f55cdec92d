"""Segments: in one piece, none empty, near in what they are cut by, and nobody's sign, origin or rounding in them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from datagen.files.trajectory import NORMAL, OBSTACLE, WALL, at_rest
from learning.graphs.graph import neighbours
from learning.segments.cut import body_graph, ends, segment
from learning.segments.edges import mesh_edges
from learning.segments.features import METHODS, features
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.schema import InputError
from tests.synthetic import bending

MODAL = [method for method in METHODS if "md" in method]


def channel():
    """A plane mesh of triangles with walls along y = 0 and y = 0.1, as fluid data sets have it, without modes."""
    mesh = build_mesh(Body(shape="plate", length=0.4, width=0.1, height=0.0, cells=(40, 10), cell="triangle"))
    wall = np.isin(mesh.points[:, 1], (0.0, mesh.points[:, 1].max()))
    return replace(at_rest(mesh, np.zeros((0, len(mesh.points), 3))), node_kind=np.where(wall, WALL, NORMAL).astype(np.uint8))


def pieces_of(trajectory, label):
    edges = mesh_edges(trajectory)
    edges = edges[label[edges[:, 0]] == label[edges[:, 1]]]
    inside = coo_array((np.ones(len(edges)), edges.T), shape=(len(label), len(label)))
    _, piece = connected_components(inside, directed=False)
    return [len(np.unique(piece[label == k])) for k in range(label.max() + 1)]


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
    assert pieces_of(trajectory, label)[:-1] == [1] * (body.max() + 1)


@pytest.mark.parametrize("method", METHODS)
def test_a_fluid_is_cut_by_laplacian_modes_and_walls(method):
    trajectory = channel()
    label = segment(trajectory, count=12, method=method, tau=1.0, modes="laplacian", mode_count=6)
    assert label.max() == 11 and pieces_of(trajectory, label) == [1] * 12


def test_the_obstacle_is_the_last_segment():
    trajectory = bending()
    label = segment(trajectory, count=7)
    assert (label[trajectory.node_kind == OBSTACLE] == 7).all()
    assert (label[trajectory.body] < 7).all()


@pytest.mark.parametrize("method", MODAL)
def test_the_sign_of_a_mode_makes_no_difference(method):
    trajectory = bending(cells=(20, 4, 4))
    sign = np.array([-1, 1], np.float32)[:, None, None]
    assert np.array_equal(segment(trajectory, method=method), segment(replace(trajectory, modes=sign * trajectory.modes), method=method))


@pytest.mark.parametrize("method", MODAL)
@pytest.mark.parametrize("angle", [0.7, 2.0])
def test_the_choice_inside_a_double_eigenvalue_makes_no_difference(method, angle):
    trajectory = bending(cells=(20, 4, 4))
    c, s = np.cos(angle), np.sin(angle)
    turned = np.einsum("ab,bnd->and", np.array([[c, -s], [s, c]]), trajectory.modes)
    turned /= np.linalg.norm(turned, axis=2).max(axis=1)[:, None, None]  # files keep modes with their largest displacement 1
    other = replace(trajectory, modes=turned.astype(np.float32))
    assert np.array_equal(segment(trajectory, method=method), segment(other, method=method))


@pytest.mark.parametrize("method", METHODS)
def test_rounding_decides_nothing(method):
    # The mesh is symmetric in y, so many nodes are as far from one segment as from another. 1e-6 is what packing leaves of a mode.
    trajectory = bending(cells=(20, 4, 4))
    noise = np.random.default_rng(0).uniform(-0.5e-6, 0.5e-6, trajectory.modes.shape).astype(np.float32)
    other = replace(trajectory, modes=trajectory.modes + noise, points=trajectory.points * (1 + 1e-15))
    assert np.array_equal(segment(trajectory, method=method), segment(other, method=method))


def test_a_mode_of_another_frequency_plays_no_part_until_it_is_asked_for():
    trajectory = bending(cells=(20, 4, 4))
    other = np.concatenate([trajectory.modes[:1], np.roll(trajectory.modes[1:], 7, axis=1)])
    apart = replace(trajectory, modes=other, frequencies_hz=(10.0, 10.3))
    alone = replace(trajectory, modes=trajectory.modes[:1], frequencies_hz=(10.0,))
    assert np.array_equal(segment(apart), segment(alone))
    assert not np.array_equal(segment(apart, mode_count=2), segment(alone))


def test_only_the_start_counts():
    trajectory = bending()
    other = trajectory.displacement.copy()
    other[1:] += 1.0
    assert np.array_equal(segment(trajectory), segment(replace(trajectory, displacement=other)))


@pytest.mark.parametrize("method", METHODS)
def test_the_scale_of_the_scene_makes_no_difference(method):
    # a thousand times larger by a power of two, so that every rounding stays the same
    trajectory = bending(cells=(20, 4, 4))
    assert np.array_equal(segment(trajectory, method=method), segment(replace(trajectory, points=1024 * trajectory.points), method=method))


@pytest.mark.parametrize("method", METHODS[1:])
def test_refinement_brings_nodes_nearer_to_their_segments(method):
    trajectory = bending(cells=(40, 4, 4))
    feature = features(trajectory, ends(body_graph(trajectory)), count=19, method=method, tau=0.5)

    def spread(label):  # mean distance d of the nodes from their segment's centroid
        label = label[trajectory.body]
        centroid = np.stack([np.bincount(label, weights=column) for column in feature.table.T], axis=1) / np.bincount(label)[:, None]
        return feature.distance(np.arange(len(label)), centroid[label]).mean()

    assert spread(segment(trajectory, method=method)) < 0.95 * spread(segment(trajectory, method="metis"))


def test_the_obstacle_feature_is_the_distance_its_logarithm_or_its_exponential():
    trajectory = bending(cells=(20, 4, 4))
    edges, body = ends(body_graph(trajectory)), trajectory.points[trajectory.body]
    size = np.linalg.norm(body[edges[0]] - body[edges[1]], axis=1).mean() * (len(body) / 19) ** (1 / 3)
    near = np.linalg.norm(body[:, None] - trajectory.points[~trajectory.body], axis=2).min(axis=1) / size
    for method, expected in (("slic-od", near), ("slic-od-l", np.log(near)), ("slic-mdod-e", np.exp(-near))):
        found = features(trajectory, edges, count=19, method=method, tau=0.5).table
        assert np.allclose(found[:, 0], expected, rtol=1e-12) and np.allclose(found[:, -3:], body / size, rtol=1e-12)


def test_overlap_is_one_ring_of_neighbours():
    trajectory = bending()
    label = segment(trajectory, count=7).astype(np.int64)
    edges = mesh_edges(trajectory)
    pairs = np.concatenate([edges, edges[:, ::-1]]).T
    expected = {(i, k) for k in range(8) for i in pairs[1, label[pairs[0]] == k].tolist() if label[i] != k}  # Adj(V_k) less V_k
    found = neighbours(label, pairs)
    assert {(i, k) for i, k in found.T.tolist()} == expected and found.shape[1] == len(expected)
    assert (np.diff(found[0]) >= 0).all()
    assert not (found[1] == 7).any()  # the obstacle's mesh touches nobody's


@pytest.mark.parametrize("change, words", [
    (dict(count=0), "0 segments"), (dict(count=100), "99 nodes"), (dict(method="slic-mdod-x"), "did you mean"),
    (dict(modes="laplace"), "did you mean 'laplacian'"), (dict(tau=-1.0), "tau = -1"), (dict(tau=float("nan")), "tau = nan"),
    (dict(mode_count=3), "carries 2 of the 3 modes")])
def test_wrong_requests_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        segment(bending(), **change)


def test_a_method_says_what_it_lacks():
    bare = replace(bending(), modes=np.zeros((0, 147, 3), np.float32), frequencies_hz=())
    with pytest.raises(InputError, match="'metis' does without"):
        segment(bare)
    for method, modes in (("metis", "elastic"), ("slic-od", "elastic"), ("slic-mdod-e", "laplacian")):
        segment(bare, method=method, modes=modes)
    open_field = replace(channel(), node_kind=np.zeros(len(channel().points), np.uint8))
    with pytest.raises(InputError, match="neither obstacle nor walls"):
        segment(open_field, method="slic-od-e")
    segment(open_field, method="slic-mdod-e", modes="laplacian")
