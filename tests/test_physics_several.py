"""Several obstacles: each pushes by itself, what they do together is what symmetry, superposition and single obstacles say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from physics.contact.obstacles import Rigid, Rigids
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.state import State
from physics.fidelity.verify import Checker, verify
from physics.modes.elastic import elastic_modes
from physics.scene import read_scene
from physics.schema import InputError
from physics.solution import solve
from tests.test_physics_restart import assert_same, broken_off, save_always  # noqa: F401

BODY = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [10, 2, 2], "cell": "hexahedron"}
ENDS = [{"where": "x-min"}, {"where": "x-max"}]
AWAY = {"shape": "box", "size": [0.01, 0.02, 0.03], "path": [[0.05, 0.01, 0.9], [0.05, 0.01, 0.89]]}
DEPTH = 0.001


def sphere(side, x=0.05, depth=DEPTH, radius=0.01, height=0.02):
    """A sphere on the upper (1) or lower (-1) face that moves into it from a tenth of a millimetre outside."""
    ends = [height / 2 + side * (height / 2 + radius + gap) for gap in (1e-4, -depth)]
    return {"shape": "sphere", "radius": radius, "path": [[x, 0.01, z] for z in ends]}


def scene(*obstacles, **tables):
    return read_scene({"body": BODY, "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": ENDS, "steps": {"count": 4},
                       "obstacle": list(obstacles)} | tables)


@pytest.fixture(scope="module")
def squeezed():
    """A bar between two spheres."""
    given = scene(sphere(1), sphere(-1))
    return given, solve(given)


def test_what_presses_alike_from_both_sides_leaves_a_mirror_image_and_no_net_reaction(squeezed):
    _, found = squeezed
    points, u = found.mesh.points, found.displacement[-1]
    image = cKDTree(points).query(points * [1, 1, -1] + [0, 0, 0.02])[1]
    assert abs(u).max() > 0.9 * DEPTH and np.allclose(u[image] * [1, 1, -1], u, atol=1e-6 * DEPTH, rtol=0)
    upper, lower = found.reactions[-1]
    assert upper[2] > 1 and abs(upper + lower).max() < 1e-6 * upper[2] and abs(found.reaction[-1]).max() < 1e-6 * upper[2]
    assert found.relative_residual.max() < 1e-6 and found.penetration[-1] > 0


def test_each_of_the_two_pushes_as_one_does_on_half_of_the_body(squeezed):
    """The plane between them does not move: half of the bar on it, under one sphere, is the same problem."""
    half = solve(scene(sphere(1, height=0.01), body=BODY | {"height": 0.01, "cells": [10, 2, 1]},
                       support=[*ENDS, {"where": "z-min", "fixed": "z"}]))
    _, found = squeezed
    assert half.reactions is None and half.reaction[-1, 2] == pytest.approx(found.reactions[-1, 0, 2], rel=1e-6)
    assert half.energy[-1] == pytest.approx(found.energy[-1] / 2, rel=1e-6)
    upper = found.mesh.points[:, 2] > 0.01 - 1e-9
    where = cKDTree(half.mesh.points).query(found.mesh.points[upper] - [0, 0, 0.01])[1]
    assert np.allclose(half.displacement[-1, where], found.displacement[-1, upper], atol=1e-6 * DEPTH, rtol=0)


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("how", [{}, {"steps": {"count": 6, "duration": 0.02, "dynamic": True}}])
def test_one_that_never_touches_changes_nothing(first, how):
    alone = solve(scene(sphere(1), **how))
    both = solve(scene(*[AWAY, sphere(1)] if first else [sphere(1), AWAY], **how))
    for name in ("displacement", "reaction", "energy", "penetration", "newton_iterations"):
        assert np.array_equal(getattr(alone, name), getattr(both, name)), name
    own = both.reactions[:, int(first)]
    assert np.array_equal(own, alone.reaction) and own.any() and not both.reactions[:, 1 - first].any()


def test_of_two_far_apart_small_strain_is_the_sum():
    """A slab on the ground, which spreads a load over about its height: ten of these apart."""
    slab = {"body": {"length": 0.3, "width": 0.02, "height": 0.02, "cells": [30, 2, 2], "cell": "hexahedron"},
            "material": {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.3}, "support": [{"where": "z-min"}],
            "steps": {"count": 2}}
    left, right = sphere(1, x=0.05, depth=2e-4), sphere(1, x=0.25, depth=3e-4)
    both, one, other = solve(scene(left, right, **slab)), solve(scene(left, **slab)), solve(scene(right, **slab))
    summed = one.displacement[-1] + other.displacement[-1]
    assert np.linalg.norm(both.displacement[-1] - summed) < 1e-4 * np.linalg.norm(summed)
    for k, alone in enumerate((one, other)):
        assert both.reactions[-1, k] == pytest.approx(alone.reaction[-1], rel=1e-3, abs=1e-3 * alone.reaction[-1, 2])
    assert both.reactions[-1, 1, 2] > 1.2 * both.reactions[-1, 0, 2]
    assert both.reaction[-1] == pytest.approx(both.reactions[-1].sum(axis=0), rel=1e-12)


def test_a_small_load_on_both_sides_is_left_to_small_strain():
    found = solve(scene(sphere(1, depth=1e-6), sphere(-1, depth=1e-6), support=ENDS))
    alone = solve(scene(sphere(1, depth=1e-6), support=ENDS))
    assert found.linear_steps == 4 and found.model["kinematics"].startswith("small strain") and alone.linear_steps == 4
    assert found.reactions[-1, 0, 2] > 0 and abs(found.reaction[-1]).max() < 1e-6 * found.reactions[-1, 0, 2]


def test_multigrid_finds_the_same(squeezed):
    given, found = squeezed
    other = solve(given, method="multigrid")
    assert other.model["factor"].startswith("none: conjugate gradients")
    assert np.allclose(other.displacement, found.displacement, atol=1e-5 * DEPTH, rtol=0)
    assert other.reactions[-1] == pytest.approx(found.reactions[-1], rel=1e-5, abs=1e-4)


def test_how_exactly_a_step_is_solved_is_measured_by_both_reactions(squeezed):
    """Their sum is zero, of which no share could be asked for."""
    given, found = squeezed
    newton = Newton(Balance(given, found.mesh))
    felt = newton.pressing(newton.equilibrium(1.0, found.displacement[-1], State(0.9, found.displacement[-1], newton_forces(newton))))
    assert felt.reaction == pytest.approx(2 * found.reactions[-1, 0, 2], rel=1e-5)


def newton_forces(newton):
    """No contact forces yet."""
    return np.zeros(len(newton.balance.contact.surface.area))


def test_its_own_path_its_own_shape_and_its_own_points_of_contact():
    """A box that comes late by its own table, felt at nodes, beside a cylinder that was there from the start."""
    late = {"shape": "box", "size": [0.02, 0.03, 0.02], "path": [[0.07, 0.01, -0.012], [0.07, 0.01, -0.012], [0.07, 0.01, -0.0095]],
            "steps": [0, 0.5, 1], "contact": "nodes"}
    roll = {"shape": "cylinder", "radius": 0.01, "path": [[0.03, 0.01, 0.0301], [0.03, 0.01, 0.029]]}
    given = scene(roll, late)
    found = solve(given)
    assert (found.reactions[1:3, 1] == 0).all() and (found.reactions[1:, 0, 2] > 0).all() and found.reactions[4, 1, 2] < -0.1
    assert found.model["contact"] == ("frictionless at points of the surface facets, rigid cylinder; at surface nodes, rigid box; nothing "
                                      "is solved before one touches")
    alone = solve(scene(roll))
    assert np.allclose(found.displacement[:3], alone.displacement[:3], atol=1e-9, rtol=0)


def test_in_motion_both_are_felt_and_no_energy_is_made(squeezed):
    given = scene(sphere(1), sphere(-1), steps={"count": 12, "duration": 0.05, "dynamic": True})
    found = solve(given)
    upper, lower = found.reactions[-1]
    assert upper[2] > 1 and abs(upper + lower).max() < 1e-4 * upper[2]
    assert upper[2] == pytest.approx(squeezed[1].reactions[-1, 0, 2], rel=0.2)  # slow for a bar of 100 Hz and more
    free = scene({"shape": "half-space", "normal": [0, 0, 1], "path": [[0, 0, -0.0005]]},
                 {"shape": "half-space", "normal": [0, 0, -1], "path": [[0, 0, 0.0205]]}, support=[],
                 steps={"count": 60, "duration": 0.006, "dynamic": True, "velocity": [0, 0, -1.0]})
    bounced = solve(free)  # from one wall to the other and on
    total = bounced.energy + bounced.kinetic_energy
    assert total[-1] <= total[0] * (1 + 1e-6) and (np.diff(total) < 1e-4 * total[0]).all()
    assert bounced.reactions[:, 0, 2].min() < -1 and bounced.reactions[:, 1, 2].max() > 1
    assert bounced.reaction == pytest.approx(bounced.reactions.sum(axis=1), abs=1e-9)


def test_a_broken_off_path_goes_on_to_the_same_bits(squeezed, tmp_path, save_always):  # noqa: F811
    given, found = squeezed
    broken_off(given, tmp_path / "a.part", 2)
    again = solve(given, journal=tmp_path / "a.part")
    assert again.resumed == 2
    assert_same(found, again)


def test_the_equations_find_both_reactions_anew_and_miss_one_that_is_left_out(squeezed):
    given, found = squeezed
    u, free = found.displacement, np.ones(len(found.mesh.points), bool)
    frame = Checker(given, found.mesh).frame(u[-1], 1.0)
    assert frame.reactions == pytest.approx(found.reactions[-1], rel=1e-5, abs=1e-4)
    assert frame.residual < 1e-5 * frame.push and frame.push == pytest.approx(2 * found.reactions[-1, 0, 2], rel=1e-5)
    truth = verify(u, u, scene=given, mesh=found.mesh, free=free)
    assert truth.relative_residual < 1e-5 and truth.reaction_error == 0 and truth.largest_penetration < 1e-6
    half = verify(u, u, scene=replace(given, obstacle=given.obstacle[0]), mesh=found.mesh, free=free)
    assert half.relative_residual > 0.1
    moved = u + [0, 0, 1e-3]  # towards one and away from the other
    assert verify(moved, u, scene=given, mesh=found.mesh, free=free).largest_penetration == pytest.approx(1e-3, rel=0.01)


def test_between_two_plates_a_bar_swings_as_one_whose_faces_are_held():
    walls = [{"shape": "half-space", "normal": [0, 0, -side], "path": [[0, 0, 0.01 + side * 0.0101], [0, 0, 0.01 + side * 0.009999]]}
             for side in (1, -1)]
    given = scene(*walls, support=ENDS)
    found = solve(given)
    between = elastic_modes(given, count=3, mesh=found.mesh, at=(found.displacement[-1], 1.0))
    held = elastic_modes(scene(support=[*ENDS, {"where": "z-min", "fixed": "z"}, {"where": "z-max", "fixed": "z"}]), count=3)
    assert between.frequencies_hz == pytest.approx(held.frequencies_hz, rel=1e-3)
    one = scene(walls[1], support=ENDS)
    lying = elastic_modes(one, count=3, mesh=found.mesh, at=(solve(one).displacement[-1], 1.0))
    assert lying.frequencies_hz[1] < 0.9 * between.frequencies_hz[1]


def test_each_point_sees_its_own_obstacle():
    """Point by point what `Rigid` says of the obstacle that it belongs to."""
    each = [Rigid(obstacle) for obstacle in scene(sphere(1, radius=0.013), AWAY, sphere(-1)).obstacles]
    random = np.random.default_rng(3)
    of, points = np.array([2, 0, 1, 1, 0, 2, 0]), random.normal(0, 0.03, (7, 3))
    both, fraction = Rigids(each, of), 0.4
    centre, vector, force = both.position(fraction), random.normal(size=(3, 3)), random.normal(size=7)
    gap, normal = both.gap(points, centre)
    sums = np.zeros((3, 3))
    for q, k in enumerate(of):
        at = each[k].position(fraction)
        own_gap, own_normal = each[k].gap(points[q:q + 1], at)
        assert gap[q] == own_gap[0] and np.array_equal(normal[q], own_normal[0])
        assert np.array_equal(both.bend(points, centre)[q], each[k].bend(points[q:q + 1], at)[0])
        assert np.array_equal(both.offset(points, centre)[q], points[q] - at)
        assert both.along(normal, vector)[q] == pytest.approx(own_normal[0] @ vector[k])
        sums[k] += force[q] * own_normal[0]
    assert both.sums(force, normal) == pytest.approx(sums) and both.width == 0.01
    some = np.array([6, 2, 0])
    assert np.array_equal(both.among(some).gap(points[some], centre)[0], gap[some])


@pytest.mark.parametrize("second, words", [
    ({"shape": "sphere", "radius": 1e-4, "path": [[0.05, 0.01, -0.001]]}, "obstacle[1]: 0.0002 m wide, it is smaller than 1/8 of a cell"),
    ({"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.0]]}, "obstacle[1].path: the obstacle starts 0.01 m inside the body"),
    ({"shape": "sphere", "radius": 0.01, "path": [[0, 0, -1], [0, 0, -1000]]}, "obstacle[1].path: its length is 1e+05 times")])
def test_one_that_cannot_be_is_refused(second, words):
    with pytest.raises(InputError) as caught:
        solve(scene(sphere(1), second))
    assert words in str(caught.value), str(caught.value)
