"""What holds and loads a body: which components, by how much, and forces over faces, against sums and integrals on paper."""

from dataclasses import replace

import numpy as np
import pytest

from physics.body.schedule import Moves
from physics.body.supports import held, loose, nodal_areas, rigid_motions_left, traction_load
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body, Load, Support
from physics.schema import InputError
from tests.scenes import beam

BOX = {"length": 0.3, "width": 0.2, "height": 0.1, "cells": [3, 2, 1]}


def scene(*support, load=()):
    return replace(beam(body=BOX), support=support, load=load)


def test_held_components_are_those_named_at_the_place_named():
    made = scene(Support(where="x-min", fixed="xz"), Support(where="y-max", fixed="y"))
    mesh = build_mesh(made.body)
    x, y, _ = mesh.points.T
    left, back = abs(x) < 1e-9, abs(y - 0.2) < 1e-9
    assert np.array_equal(held(made, mesh), np.stack([left, back, left], axis=1))
    assert not held(scene(), mesh).any()


def test_prescribed_displacements_are_those_of_held_components_alone():
    """Two supports that share an edge: each leads its own component, and both may give z the same way."""
    made = scene(Support(where="x-min", fixed="xz", displacement=(1.0, 2.0, 3.0)),
                 Support(where="y-max", fixed="yz", displacement=(4.0, 5.0, 3.0)))
    mesh = build_mesh(made.body)
    x, y, _ = mesh.points.T
    left, back = abs(x) < 1e-9, abs(y - 0.2) < 1e-9
    assert np.array_equal(Moves(made, mesh).at(1.0), np.stack([1.0 * left, 5.0 * back, 3.0 * (left | back)], axis=1))
    assert np.array_equal(Moves(scene(), mesh).at(1.0), np.zeros((24, 3)))


@pytest.mark.parametrize("first, second", [(1.0, 0.0), (0.0, 1.0), (1.0, 2.0)])
def test_supports_that_contradict_are_named(first, second):
    made = scene(Support(where="x-max", fixed="xyz"), Support(where="x-min", fixed="xz", displacement=(0.0, 9.0, first)),
                 Support(where="y-max", fixed="yz", displacement=(7.0, 0.0, second)))
    match = rf"support\[2\]: gives the z displacement of nodes at 'y-max' as {second:g} m"
    if first:  # else it is the corner with x-max that contradicts, at 'y-max' as well
        made = replace(made, support=(Support(where="z-max", fixed="x"), *made.support[1:]))
    with pytest.raises(InputError, match=match):
        Moves(made, build_mesh(made.body))


@pytest.mark.parametrize("components, left", [
    ([], 6),
    ([(0, "x")], 5), ([(0, "xy")], 4), ([(0, "xyz")], 3),
    ([(0, "xyz"), (1, "x")], 3),  # along the line through both points: it only stretches
    ([(0, "xyz"), (1, "y")], 2), ([(0, "xyz"), (1, "xyz")], 1),
    ([(0, "xyz"), (1, "yz"), (2, "z")], 0), ([(0, "xyz"), (1, "yz"), (2, "y")], 1), ([(0, "xyz"), (1, "yz"), (2, "x")], 1),
    ([(0, "z"), (1, "z"), (2, "z")], 3), ([(0, "xyz"), (1, "xyz"), (2, "xyz")], 0)])
def test_rigid_motions_left_by_points_on_two_axes(components, left):
    """Node 0 at a corner of the box, 1 beyond it along x, 2 along y: which motions are left is known."""
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(3, 2, 1)))
    mesh = replace(mesh, points=mesh.points + [40.0, -30.0, 20.0])  # far from the origin
    corner = mesh.points.min(axis=0)
    number = [int(np.linalg.norm(mesh.points - corner - way, axis=1).argmin()) for way in ([0, 0, 0], [0.3, 0, 0], [0, 0.2, 0])]
    fixed = np.zeros(mesh.points.shape, bool)
    for node, letters in components:
        fixed[number[node], ["xyz".index(letter) for letter in letters]] = True
    assert rigid_motions_left(mesh, fixed) == left


def test_rigid_motions_of_a_whole_face():
    mesh = build_mesh(Body(length=0.3, width=0.2, height=0.1, cells=(12, 8, 4)))
    for place, axis in (("x-min", 0), ("y-max", 1), ("z-min", 2)):
        fixed = np.zeros(mesh.points.shape, bool)
        fixed[mesh.places[place], axis] = True  # it slides in its plane, two ways and a turn
        assert rigid_motions_left(mesh, fixed) == 3
        fixed[mesh.places[place]] = True
        assert rigid_motions_left(mesh, fixed) == 0


def one_cell(points, cell):
    points = np.array(points, float)
    return Mesh(points=points, cells=np.arange(len(points))[None], cell=cell, places={"base": np.arange(4 if cell == "hexahedron" else 3)})


def test_nodal_areas_of_a_triangle_are_a_third_each():
    mesh = one_cell([[0, 0, 0], [3, 0, 4], [0, 2, 0], [1, 1, -9]], "tetrahedron")
    # Sides 5 and 2 at a right angle: 5.
    assert nodal_areas(mesh, "base") == pytest.approx([5 / 3, 5 / 3, 5 / 3, 0])


def test_nodal_areas_of_a_trapezoid_are_integrals_of_its_bilinear_shapes():
    """Corners (0, 0), (3, 0), (1, 2), (0, 2), tilted: x = s (3 - 2 t), y = 2 t has the determinant 2 (3 - 2 t).

    So with sides in s and t, integral of (1 - s)(1 - t) 2 (3 - 2 t) = (1/2) 2 (3/2 - 2/6) = 7/6, and of (1 - s) t 2 (3 - 2 t) =
    (1/2) 2 (3/2 - 2/3) = 5/6; two by two Gauss points are exact.
    """
    tilt = np.array([[0.6, 0, 0.8], [0, 1, 0]])
    base = np.array([[0, 0], [3, 0], [1, 2], [0, 2]]) @ tilt + [5.0, 6.0, 7.0]
    mesh = one_cell([*base, *(base + [-0.8, 0, 0.6])], "hexahedron")
    assert nodal_areas(mesh, "base") == pytest.approx([7 / 6, 7 / 6, 5 / 6, 5 / 6, 0, 0, 0, 0])
    # Another corner first: the same areas, each with its node.
    turned = np.roll(base, -1, axis=0)
    mesh = one_cell([*turned, *(turned + [-0.8, 0, 0.6])], "hexahedron")
    assert nodal_areas(mesh, "base")[:4] == pytest.approx([7 / 6, 5 / 6, 5 / 6, 7 / 6])


def test_nodal_areas_of_a_general_quadrilateral():
    """(0, 0), (4, 0), (3, 3), (0, 1): x = 4 s - s t, y = t + 2 s t, determinant (4 - t)(1 + 2 s) + s 2 t = 4 + 8 s - t."""
    base = np.array([[0, 0, 0], [4, 0, 0], [3, 3, 0], [0, 1, 0]], float)
    mesh = one_cell([*base, *(base + [0, 0, 1])], "hexahedron")
    # Means of (1 - s) and s: 1/2, of s (1 - s): 1/6, of s s: 1/3, products of those in s and t.
    low, high = 4 / 2 + 8 / 6, 4 / 2 + 8 / 3  # integrals over s of (1 - s)(4 + 8 s) and of s (4 + 8 s)
    expected = [low / 2 - 1 / 12, high / 2 - 1 / 12, high / 2 - 1 / 6, low / 2 - 1 / 6]
    assert nodal_areas(mesh, "base")[:4] == pytest.approx(expected)
    assert sum(expected) == pytest.approx(7.5)  # by the shoelace formula: (12 - 0 + 3 - 0) / 2


@pytest.mark.parametrize("cell", ["hexahedron", "prism"])
def test_tractions_are_spread_over_the_face_named_and_added_up(cell):
    """The face y-max, 0.3 by 0.1, is of three squares of 0.01 m2 in a row."""
    load = (Load(where="y-max", traction=(100.0, -200.0, 700.0)), Load(acceleration=(0.0, 0.0, -9.81)),
            Load(where="x-max", traction=(0.0, 50.0, 0.0)), Load(where="y-max", traction=(0.0, 0.0, 300.0)))
    made = scene(load=load)
    mesh = build_mesh(replace(made.body, cell=cell))
    x, y, _ = mesh.points.T
    force = traction_load(made, mesh)
    assert force.sum(axis=0) == pytest.approx([100 * 0.03, -200 * 0.03 + 50 * 0.02, 1000 * 0.03])
    back, ends = abs(y - 0.2) < 1e-9, (abs(x) < 1e-9) | (abs(x - 0.3) < 1e-9)
    area = np.where(back, np.where(ends, 0.0025, 0.005), 0.0)
    assert force[:, 0] == pytest.approx(100 * area) and force[:, 2] == pytest.approx(1000 * area)
    assert not traction_load(scene(load=load[1:2]), mesh).any()  # a body's weight is no traction


def test_nodal_areas_of_a_sides_segments_are_half_their_lengths_times_the_thickness():
    """Along the left side of a plane body: segments of 1 and 3 m, 0.5 m thick."""
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [2, 4, 0], [0, 4, 0]], float)
    mesh = Mesh(points=points, cells=np.array([[0, 1, 2, 3], [3, 2, 4, 5]]), cell="quadrilateral",
                places={"left": np.array([0, 3, 5])}, thickness=0.5)
    assert nodal_areas(mesh, "left") == pytest.approx([0.25, 0, 0, 1.0, 0, 0.75])


def test_two_turns_contradict_by_their_angles_and_two_rests_do_not_by_their_tables():
    """On the edge that two faces share: turned by 10 and by 20 degrees; held still, once with a table that says so."""
    turn = {"where": "x-min", "axis": [1, 0, 0], "angle": 10.0, "centre": [0, 0.01, 0.01]}
    mesh = build_mesh(beam().body)
    with pytest.raises(InputError, match=r"support\[1\]: gives the x displacement.*another support gives another"):
        Moves(beam(support=[turn, turn | {"where": "z-min", "angle": 20.0}]), mesh)
    Moves(beam(support=[turn, turn | {"where": "x-min z-min"}]), mesh)
    Moves(beam(support=[{"where": "x-min"}, {"where": "z-min", "steps": [0.0, 1.0], "factor": [0.0, 3.0]}]), mesh)


@pytest.mark.parametrize("common, left", [([0], 3), ([0, 1], 1), ([0, 1, 2], 0)])
def test_a_cell_that_hangs_on_a_held_one_by_a_point_an_edge_or_a_face(common, left):
    """It turns about the point in three ways, about the edge in one, about a face not at all."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, -1, -1], [0.5, -1, -1], [2, -1, -3]], float)
    other = [*common, *range(4, 8 - len(common))]
    used = np.unique([0, 1, 2, 3, *other])
    mesh = Mesh(points=points[used], cells=np.searchsorted(used, [[0, 1, 2, 3], other]), cell="tetrahedron", places={})
    fixed = np.repeat((used < 4)[:, None], 3, axis=1)
    said = loose(mesh, fixed)
    assert said.startswith(f"{left} motion{'s' if left > 1 else ''} left free: parts of the mesh hang together") if left else said == ""
