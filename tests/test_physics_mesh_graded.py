"""The channel whose triangles grow away from its hole."""

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.shapes.graded import quality
from physics.mesh.sound.curved import smallest_jacobian
from physics.scene import read_body
from physics.schema import InputError


def channel(**changes):
    table = {"shape": "channel", "length": 1.6, "height": 0.41, "hole_centre": [0.2, 0.2], "hole_radius": 0.05, "cell_size": 0.05,
             "hole_cell_size": 0.015}
    return build_mesh(read_body({"body": table | changes}))


@pytest.mark.parametrize("changes", [
    {}, {"hole_centre": [0.3, 0.1], "hole_radius": 0.08}, {"hole_centre": [0.16, 0.31], "hole_radius": 0.02}, {"length": 0.4},
    {"hole_centre": [0.3, 0.205], "hole_radius": 0.123}, {"cell_size": 0.02, "hole_cell_size": 0.02}, {"hole_centre": [0.8, 0.08]}],
    ids=["usual", "near a wall", "small", "short", "blocks 60 %", "even", "0.03 from a wall"])
def test_it_fills_the_channel_and_nothing_else(changes):
    """One piece with one hole (Euler's number 0), every cell positive, of good shape, also with its curved side."""
    mesh = channel(**changes)
    a, b, c = (mesh.points[mesh.cells[:, i], :2] for i in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    rim, length = len(mesh.places["hole"]), changes.get("length", 1.6)
    centre, radius = np.array(changes.get("hole_centre", [0.2, 0.2])), changes.get("hole_radius", 0.05)
    angles = np.sort(np.arctan2(*(mesh.points[mesh.places["hole"], :2] - centre).T[::-1]))
    polygon = radius**2 / 2 * np.sin(np.diff([*angles, angles[0] + 2 * np.pi])).sum()
    assert area.min() > 0
    assert area.sum() == pytest.approx(length * 0.41 - polygon, rel=1e-12)
    assert len(mesh.points) - len(mesh.edges) + len(mesh.cells) == 0
    assert len(mesh.boundary[0]) == rim + sum(len(mesh.places[side]) - 1 for side in ("x-min", "x-max", "y-min", "y-max"))
    assert quality(mesh.points[:, :2], mesh.cells).min() > 0.3
    assert smallest_jacobian(mesh.points, mesh.cells, "triangle", mesh.middles).min() > 0
    edges, middles = mesh.middles[2]
    on_rim = np.isin(edges, mesh.places["hole"]).all(axis=1) & (np.hypot(*(middles[:, :2] - centre).T) < radius * (1 + 1e-9))
    assert on_rim.sum() == rim
    np.testing.assert_allclose(np.hypot(*(middles[on_rim, :2] - centre).T), radius, rtol=1e-12)


def test_the_foremost_and_the_rearmost_point_of_the_hole_are_nodes():
    mesh = channel()
    hole = mesh.points[mesh.places["hole"], :2]
    for point in ([0.15, 0.2], [0.25, 0.2]):
        assert np.hypot(*(hole - point).T).min() < 1e-12


def test_cells_grow_from_the_hole_to_the_channel():
    """The mean edge within a radius of the hole against that far downstream: 0.015 growing by a fifth of the way, and 0.05."""
    mesh = channel()
    middle = mesh.points[mesh.edges].mean(axis=1)[:, :2]
    length = np.hypot(*(mesh.points[mesh.edges[:, 0]] - mesh.points[mesh.edges[:, 1]]).T[:2])
    away = np.hypot(*(middle - [0.2, 0.2]).T) - 0.05
    assert length[away < 0.02].mean() == pytest.approx(0.017, rel=0.15)
    assert length[middle[:, 0] > 0.8].mean() == pytest.approx(0.05, rel=0.1)


def test_the_same_body_has_the_same_mesh_to_the_bit():
    first, second = channel(), channel()
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(first.cells, second.cells)


@pytest.mark.parametrize(("changes", "words"), [
    ({"hole_cell_size": 0.06}, "hole_cell_size = 0.06: must be at most cell_size, 0.05 m"),
    ({"cell": "quadrilateral"}, "only triangles grow away from the hole"),
    ({"cell_size": 1e-3, "hole_cell_size": 1e-3}, "nodes; at most 400000")])
def test_what_cannot_be_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        channel(**changes)
