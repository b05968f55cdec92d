"""A scene seen from the beam's own frame: literal figures, symmetries, and what is refused."""

import numpy as np
import pytest

from learning.slender.beam import see
from physics.mesh.build import build_mesh
from physics.schema import InputError
from tests.slender import scene


def everywhere():
    """The same press on all four faces, from either end: scenes of which each is another one turned or mirrored."""
    length, low, high = 0.1, 0.022, 0.024
    for far in (False, True):
        for axis in (1, 2):
            for outward in (True, False):
                sides = (length, low, high) if axis == 2 else (length, high, low)
                cells = (20, 4, 6) if axis == 2 else (20, 6, 4)
                path = []
                for along, across, up in ((0.08, 0.012, 0.036), (0.081, 0.0125, 0.022)):
                    place = [length - along if far else along, across, across]
                    place[axis] = up if outward else high - up
                    path.append(place)
                yield scene(cells=cells, sides=sides, support=["x-max" if far else "x-min"], path=path)


def test_beams_that_are_alike_but_for_a_turn_or_a_reflection_look_alike():
    first, *others = [see(each) for each in everywhere()]
    assert len(others) == 7
    for other in others:
        assert (other.cells, other.held_at_both, other.diagonal) == (first.cells, False, first.diagonal)
        assert other.extent == pytest.approx(first.extent) and np.allclose(other.start, first.start) and np.allclose(other.end, first.end)
    assert first.extent == (0.1, 0.022, 0.024) and np.allclose(first.start, [0.08, 0.001, 0.024])


def test_an_odd_number_of_cells_turns_the_board_of_diagonals_by_one():
    down = ((0.08, 0.0115, 0.036), (0.08, 0.0115, 0.03))
    up = ((0.08, 0.0115, -0.012), (0.08, 0.0115, -0.006))
    for cells, boards in (((20, 4, 4), (0, 0)), ((20, 4, 5), (0, 1))):
        assert tuple(see(scene(cells=cells, path=path)).diagonal for path in (down, up)) == boards
    aside = ((0.08, 0.01, 0.036), (0.08, 0.01, 0.03))  # on the other side of the middle: mirrored
    assert see(scene(cells=(20, 5, 4), path=aside)).diagonal == 1


def test_the_functions_of_a_section_are_orthonormal_over_its_nodes():
    for each in everywhere():
        functions = see(each).functions()
        assert np.allclose(functions.T @ functions / len(functions), np.eye(6), atol=1e-12)


def test_nodes_of_known_coefficients_are_where_a_rigid_motion_puts_them():
    for each in everywhere():
        beam, points = see(each), build_mesh(each.body).points
        coefficients = np.zeros((1, 21, 3, 6))
        coefficients[0, :, 2, 0] = -0.001  # down by 1 mm
        coefficients[0, :, 0, 2] = 0.1 * beam.spread[1]  # x by 0.1 z
        moved = beam.nodes(coefficients)[0]
        down = np.zeros(3)
        down[beam.up] = -0.001 * beam.signs[2]
        height = (points[:, beam.up] - beam.extent[2] / 2) * beam.signs[2]
        assert np.allclose(moved, down + np.outer(0.1 * height * beam.signs[0], [1, 0, 0]), atol=1e-15)
        assert np.allclose(beam.project(moved[None]), coefficients, atol=1e-15)


def test_any_coefficients_come_back_from_the_nodes():
    dice = np.random.default_rng(0)
    for each in everywhere():
        beam, coefficients = see(each), dice.normal(size=(2, 21, 3, 6))
        assert np.allclose(beam.project(beam.nodes(coefficients)), coefficients, atol=1e-12)
        size = np.mean(np.sum(beam.nodes(coefficients) ** 2, axis=2), axis=1)  # over nodes
        assert np.allclose(size, np.mean(np.sum(coefficients**2, axis=(2, 3)), axis=1))  # over sections


def test_the_first_touch_is_where_the_sphere_reaches_the_face():
    beam = see(scene(path=((0.08, 0.011, 0.039), (0.08, 0.011, 0.029))))  # from 5 mm above to 5 mm below
    assert beam.first_touch == pytest.approx(0.5)
    assert see(scene(path=((0.08, 0.011, 0.039), (0.08, 0.011, 0.035)))).first_touch == 1
    assert see(scene(path=((0.08, 0.011, 0.033), (0.08, 0.011, 0.03)))).first_touch == 0


def test_the_groove_is_about_the_row_of_nodes_nearest_to_the_first_touch():
    for y, cells, nodes in ((0.0125, 4, 0.0), (0.0147, 4, 0.0055), (0.0125, 5, 0.0022)):  # from the middle 1.5 and 3.7 mm
        beam = see(scene(path=((0.08, y, 0.036), (0.08, y, 0.03)), cells=(20, cells, 4)))
        assert beam.row == pytest.approx(0.011 / cells)
        assert beam.groove == pytest.approx((y - 0.011, nodes))


@pytest.mark.parametrize(("changes", "said"), [
    ({"body": {"shape": "plate"}}, "not a beam of first-order prisms"),
    ({"body": {"cell": "hexahedron"}}, "not a beam of first-order prisms"),
    ({"cells": (20, 1, 4)}, "fewer than two cells across"), ({"body": {"graded": ["x-min"]}}, "its cells are not even"),
    ({"load": [{"acceleration": [0, 0, -1]}]}, "loads or inertia"),
    ({"obstacle": [{"shape": "sphere", "radius": 0.01, "path": [[0.08, 0.01, z]] * 2} for z in (0.04, -0.02)]}, "has several obstacles"),
    ({"material": [{"young_modulus": 1e6, "poisson_ratio": 0.4, **where} for where in ({"where": {"box": [[0] * 3, [0.05, 1, 1]]}}, {})]},
     "has several materials"),
    ({"support": ("y-min",)}, "not clamped"),
    ({"support": ()}, "not clamped"),
    ({"obstacle": {"shape": "capsule", "length": 0.01}}, "neither a sphere nor a cylinder"),
    ({"path": ((0.08, 0.01, 0.036), (0.08, 0.01, 0.03), (0.08, 0.01, 0.036))}, "not one straight line"),
    ({"path": ((0.02, 0.01, 0.036), (0.08, 0.01, 0.03))}, "moves along the beam"),
    ({"obstacle": {"shape": "cylinder", "axis": [1, 0.1, 0]}}, "lies along the beam"),
    ({"obstacle": {"shape": "cylinder", "axis": [0, 1, 0.1]}}, "does not lie in the face"),
])
def test_what_is_no_beam_under_an_obstacle_is_refused_in_one_line(changes, said):
    with pytest.raises(InputError, match=said) as caught:
        see(scene(**changes))
    assert "\n" not in str(caught.value) and str(caught.value).startswith("a predictor of beams does not take this scene: ")


@pytest.mark.parametrize("held, axis, across", [("x-min", [5.0, 12.0, 0.0], 1), ("x-max", [5.0, 12.0, 0.0], -1),
                                                ("x-min", [-5.0, 12.0, 0.0], -1)])
def test_a_cylinder_turned_the_other_way_is_seen_in_a_mirror(held, axis, across):
    """On z-max, by atan 5/12 towards x; seen from the other end x runs the other way, and y is mirrored."""
    path = ((0.05, 0.011, 0.036), (0.05, 0.011, 0.03))
    beam = see(scene(support=[held], path=path, obstacle={"shape": "cylinder", "axis": axis}))
    assert beam.turn == pytest.approx(np.arctan(5 / 12)) and beam.signs[1] == across
