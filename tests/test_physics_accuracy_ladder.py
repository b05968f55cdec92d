"""Which meshes a scene that asks for an error is tried on: their numbers, elements, words, and the points that they share."""

from dataclasses import replace

import numpy as np
import pytest

from physics.accuracy.choose import choose
from physics.accuracy.climb import Climb
from physics.accuracy.estimate import distance
from physics.accuracy.meshes.ladder import families, points_of
from physics.mesh.files import write_mesh
from physics.mesh.quality import cell_volumes
from physics.mesh.shapes.boxes import box
from physics.scene import Body, read_scene
from tests.scenes import beam, pressed
from tests.test_physics_mesh_curved import half_ring

SIDES = {"length": 0.06, "width": 0.02, "height": 0.01}
ASKED = {"count": 2, "error": 0.05}


def under(**obstacle):
    """A beam under a cylinder, of which an error is asked."""
    cylinder = {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.03], [0.05, 0.01, 0.02]]}
    return pressed(body=SIDES, steps=ASKED, obstacle=cylinder | obstacle)


def test_the_coarsest_mesh_has_six_cells_along_the_longest_side_or_such_as_the_obstacle_is_wide():
    """Cells of 10 mm; under a cylinder 4 mm wide of 8 mm, and where its nodes alone feel it of 4 mm. First order has two at least."""
    assert [(one.order, one.base) for one in families(under())] == [(2, (6, 2, 1)), (1, (6, 2, 2))]
    assert [one.axes for one in families(under())] == [("x", "y", "z")] * 2
    assert [one.base for one in families(under(radius=0.002))] == [(8, 3, 2), (8, 3, 2)]
    assert [one.base for one in families(under(radius=0.002, contact="nodes"))] == [(15, 5, 3), (15, 5, 3)]
    assert [one.highest for one in families(under())] == [4.0, 2.0]


def test_the_next_mesh_has_half_as_many_cells_more_along_one_direction():
    second, first = families(under())
    assert second.after((6, 2, 1), 0) == (9, 2, 1) and second.after((6, 2, 1), 1) == (6, 3, 1) and second.after((6, 2, 1), 2) == (6, 2, 2)
    assert first.after((9, 3, 5), 0) == (14, 3, 5) and first.after((9, 3, 5), 1) == (9, 5, 5)


@pytest.mark.parametrize("ratio, second, first", [(0.3, "standard", "mean-dilatation"), (0.449, "standard", "mean-dilatation"),
                                                  (0.45, "mean-dilatation", "mean-dilatation")])
def test_bricks_of_first_order_are_free_to_change_shape_and_stiff_bodies_at_both(ratio, second, first):
    scene = beam(body=SIDES, material={"young_modulus": 1e6, "poisson_ratio": ratio}, steps=ASKED)
    made = [one.rung((3, 2, 1)) for one in families(scene)]
    assert [scene.body.element for scene, _ in made] == [second, first]
    assert [(scene.body.cells, scene.body.order, mesh.cell) for scene, mesh in made] == [
        ((3, 2, 1), 2, "hexahedron27"), ((3, 2, 1), 1, "hexahedron")]
    assert all(scene.steps.error is None and scene.steps.quantity is None and scene.steps.count == 2 for scene, _ in made)
    assert [one.said((3, 2, 1)) for one in families(scene)] == [
        f"3 x 2 x 1 hexahedra, {order} order, graded to x-min" for order in ("second", "first")]


def test_boxes_are_graded_to_faces_that_are_clamped_where_nothing_else_bears_them():
    def graded(*supports, body=SIDES):
        scene = beam(body=body, steps=ASKED, support=[{"where": where, "fixed": fixed} for where, fixed in supports])
        (to,) = {one.rung(one.base)[0].body.graded for one in families(scene)}
        return to

    assert graded(("x-max", "xyz"), ("x-min", "xyz")) == ("x-min", "x-max")
    assert graded(("z-max", "xyz")) == ("z-max",) and graded(("z-max", "xyz"), ("x-min", "xy")) is None
    assert graded(("x-min", "xy"), ("x-min", "z"), ("y-max", "xyz")) == ("x-min", "y-max")
    assert graded(("x-min", "xy"), ("x-min", "z"), ("x-max", "y"), ("y-max", "x")) is None
    assert graded(("x-min z-min", "xyz")) is None
    plane = {"shape": "plate", "length": 0.06, "width": 0.02, "cell": "triangle"}
    assert graded(("x-min", "xy"), body=plane) == ("x-min",) and graded(("x-min", "xy"), ("x-max", "x"), body=plane) is None
    assert graded(("x-min", "xyz"), body=SIDES) == ("x-min",) and {one.body.graded for one in families(under())} == {("x-min",)}


@pytest.mark.parametrize("obstacle, x, y", [
    ({}, ((0.05, 0.005),), None),  # half of the radius along the way of a cylinder across the beam
    ({"shape": "sphere"}, ((0.05, 0.005),), ((0.01, 0.005),)),
    ({"axis": [1.0, 0.0, 0.0]}, None, ((0.01, 0.005),)),
    ({"axis": [0.6, 0.8, 0.0]}, ((0.05, 0.004 + 0.00375),), None),  # its axis crosses the beam within 7.5 mm to either side of its middle
    ({"path": [[0.04, 0.01, 0.03], [0.044, 0.01, 0.02]]}, ((pytest.approx(0.042), 0.005),), None),
])
def test_boxes_are_graded_to_where_round_obstacles_press_them(obstacle, x, y):
    for one in families(under(**obstacle)):
        body = one.rung(one.base)[0].body
        assert (body.graded, body.focus_x, body.focus_y, body.focus_z) == (("x-min",), x, y, None)
        assert one.said((6, 2, 1)).endswith("graded to x-min" + " and contact" * (x is not None or y is not None))


@pytest.mark.parametrize("obstacle", [
    {"contact": "nodes"}, {"path": [[0.04, 0.01, 0.03], [0.046, 0.01, 0.02]]},  # slides
    {"path": [[0.07, 0.01, 0.03], [0.07, 0.01, 0.02]]},  # beside the beam
    {"shape": "box", "size": [0.01, 0.01, 0.02], "radius": None}])
def test_under_nodes_and_where_an_obstacle_presses_no_one_place_a_box_stays_even(obstacle):
    assert all(one.rung(one.base)[0].body.even for one in families(under(**obstacle)))


def test_where_a_support_elsewhere_bears_it_too_a_pressed_box_stays_even():
    scene = under()
    both = replace(scene, support=(*scene.support, replace(scene.support[0], where="x-max", fixed="z")))
    assert all(one.rung(one.base)[0].body.even for one in families(both))


def test_a_plane_plate_keeps_its_cells_and_a_panel_has_tetrahedra():
    plane = beam(body={"shape": "plate", "length": 0.06, "width": 0.02, "cell": "triangle"}, steps=ASKED)
    second, first = families(plane)
    assert (first.order, first.base, first.axes, first.said((6, 2))) == (
        1, (6, 2), ("x", "y"), "6 x 2 triangles, first order, graded to x-min")
    assert (second.order, second.base, second.said((6, 2)), second.dimension) == (
        2, (6, 2), "6 x 2 triangles, second order, graded to x-min", 2)
    assert [one.rung((6, 2))[1].cell for one in (second, first)] == ["triangle6", "triangle"]
    scene, mesh = first.rung((6, 2))
    assert scene.body.element == "standard" and scene.body.cells == (6, 2) and scene.body.order == 1
    thin = beam(body={"shape": "plate", "length": 0.06, "width": 0.004, "cell": "quadrilateral"}, steps=ASKED,
                material={"young_modulus": 1e6, "poisson_ratio": 0.49})
    assert [(one.base, one.highest) for one in families(thin)] == [((6, 1), 4.0), ((6, 2), 2.0)]
    scene, mesh = families(thin)[0].rung((7, 1))  # plane cells are of standard sampling at any Poisson's ratio
    assert mesh.cell == "quadrilateral9" and scene.body.element == "standard" and len(mesh.points) == 15 * 3
    panel = beam(body={"shape": "panel", "height": 0.01, "outline": [[0, 0], [0.06, 0], [0.06, 0.05], [0, 0.05]],
                       "holes": [[0.03, 0.025, 0.004]]}, support=[{"where": "edge-4"}], steps=ASKED)
    second, first = families(panel)  # six cells along 60 mm would be as large as the hole, so there are eight
    assert (second.base, first.base, second.axes) == ((8, 1), (8, 2), ("in the plane", "layers"))
    scene, mesh = second.rung((12, 1))
    assert mesh.cell == "tetrahedron10" and scene.body.cell_size == 0.005 and scene.body.layers == 1
    assert first.said((12, 2)) == "12 x 2 tetrahedra, first order" and first.rung((12, 2))[0].body.element == "standard"


def test_triangles_of_second_order_come_in_even_numbers():
    second, first = families(beam(body={"shape": "plate", "length": 0.06, "width": 0.02, "cell": "triangle"}, steps=ASKED))
    assert [second.after((6, 2), axis) for axis in (0, 1)] == [(10, 2), (6, 4)] and second.finer((6, 2), (1.1, 2.4)) == (8, 6)
    assert [first.after((6, 2), axis) for axis in (0, 1)] == [(9, 2), (6, 3)] and first.finer((6, 2), (1.1, 2.4)) == (7, 5)


def test_a_plane_file_is_taken_at_both_orders_and_is_asked_for_its_error(tmp_path):
    half_ring("triangle", tmp_path / "ring.vtu", along=6, across=2)
    scene = beam(body={"shape": "file", "path": str(tmp_path / "ring.vtu")}, material={"young_modulus": 1e6, "poisson_ratio": 0.49},
                 support=[{"where": {"plane": [0, 0, 0], "normal": [0, 1, 0], "within": 1e-6}}],
                 load=[{"acceleration": [0, -9.81, 0]}], steps={"count": 2, "error": 0.01})
    second, first = families(scene)
    assert (second.order, first.order, second.dimension, second.spans) == (2, 1, 2, (2,))
    made = [one.rung(sizes) for one, sizes in ((second, (1,)), (second, (2,)), (first, (2,)))]
    assert [(mesh.cell, len(mesh.cells)) for _, mesh in made] == [("triangle6", 24), ("triangle6", 96), ("triangle", 96)]
    assert all(scene.body.element == "standard" for scene, _ in made)
    for _, mesh in made:  # the sides stay curved, and finer corners of first order lie on them
        rim = np.unique(np.concatenate([facets.ravel() for facets in mesh.boundary]))
        radius = np.linalg.norm(mesh.points[rim], axis=1)[abs(mesh.points[rim, 1]) > 1e-9]
        assert np.minimum(abs(radius - 0.5), abs(radius - 1)).max() < 2e-3
    choice = choose(scene)
    coarse = first.rung((1,))[1]  # before it is begun second order counts as four times the nodes
    assert Climb(second, choice.pilots, 0.01, 10**4, (1,)).nodes((2,)) == 16 * len(coarse.points)
    assert choice.climb.reached and choice.climb.family.order == 2 and choice.mesh.cell == "triangle6"
    truth = choice.pilots(second, (8,)).values
    assert distance(choice.pilot.values, truth, choice.pilots.weights) < 0.01


def test_a_files_cells_are_halved(tmp_path):
    write_mesh(tmp_path / "box.vtu", box(Body(**SIDES, cells=(3, 2, 1), cell="tetrahedron")), {})
    scene = beam(body={"shape": "file", "path": str(tmp_path / "box.vtu")}, steps=ASKED,
                 support=[{"where": {"plane": [0, 0, 0], "normal": [1, 0, 0], "within": 1e-6}}])
    second, first = families(scene)
    assert (second.order, first.order, second.base, second.axes) == (2, 1, (1,), ("the file's cells",)) and second.after((2,), 0) == (4,)
    assert second.said((1,)) == "the file's own, second order" and first.said((4,)) == "the file's own, first order, each side in 4"
    meshes = [one.rung(sizes)[1] for one, sizes in ((second, (1,)), (first, (1,)), (first, (2,)))]
    assert [(mesh.cell, len(mesh.cells)) for mesh in meshes] == [("tetrahedron10", 36), ("tetrahedron", 36), ("tetrahedron", 288)]
    points, weights = points_of(second)  # the middles of the file's cells
    file = meshes[1]
    np.testing.assert_allclose(points, file.points[file.cells].mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(weights, cell_volumes(file.points, file.cells, "tetrahedron") / 1.2e-5, rtol=1e-9)


def test_boxes_are_compared_at_the_middles_of_a_grid_of_ten_along_the_longest_side_and_three_at_least():
    points, weights = points_of(families(under())[0])
    assert points.shape == (10 * 3 * 3, 3) and np.allclose(weights, 1 / 90)
    assert points[0] == pytest.approx([0.003, 0.02 / 6, 0.01 / 6]) and points[-1] == pytest.approx([0.057, 0.1 / 6, 0.05 / 6])
    assert [len(np.unique(column.round(12))) for column in points.T] == [10, 3, 3]
    plane = beam(body={"shape": "plate", "length": 0.02, "width": 0.06, "cell": "triangle"}, steps=ASKED)
    points, weights = points_of(families(plane)[0])
    assert points.shape == (30, 3) and not points[:, 2].any() and weights.sum() == pytest.approx(1)


@pytest.mark.parametrize("shape, asked, felt", [
    ({"shape": "sphere", "radius": 0.01}, "facets", "smooth"), ({"shape": "sphere", "radius": 0.01}, "nodes", "nodes"),
    ({"shape": "half-space", "normal": [0, 0, -1]}, "facets", "facets")])
def test_what_rolls_over_a_body_rolls_over_a_smooth_surface(shape, asked, felt):
    obstacle = shape | {"contact": asked, "path": [[0.08, 0.01, 0.031], [0.08, 0.01, 0.025]]}
    scene = read_scene({"body": {"length": 0.1, "width": 0.02, "height": 0.02}, "material": {"young_modulus": 1e6, "poisson_ratio": 0.3},
                        "support": [{"where": "x-min", "fixed": "xyz"}], "steps": {"count": 4, "error": 0.01}, "obstacle": obstacle})
    assert [family.scene.obstacles[0].contact for family in families(scene)] == [felt] * 2
    both = families(replace(scene, obstacle=(scene.obstacle, scene.obstacle)))
    assert [each.contact for each in both[0].scene.obstacles] == [felt] * 2
