"""Every limit of the check of a data set, reached from both sides: worked out on paper, with no solver."""

import dataclasses
import tomllib
import types

import numpy as np
import pytest

from datagen.files.trajectory import OBSTACLE
from datagen.sets import check
from physics.equilibrium.newton import TOLERANCE
from physics.fidelity.verify import Frame
from physics.mesh.build import build_mesh
from physics.scene import read_scene
from tests.five_nodes import tiny, write_set
from tests.unsolved import COUNT, scene, trajectory


def changed(made, at, by):
    displacement = made.displacement.copy()
    displacement[at] += np.array(by, np.float32)
    return dataclasses.replace(made, displacement=displacement)


# ---- motion


def test_the_rest_state_passes_and_wrong_shapes_do_not():
    good = trajectory(scene())
    assert check.against_scene(good) == []
    assert check.against_scene(dataclasses.replace(good, displacement=good.displacement[:-1])) == ["12 frames for 12 steps"]
    assert check.against_scene(dataclasses.replace(good, displacement=np.concatenate([good.displacement, good.displacement[-1:]]))) == [
        "14 frames for 12 steps"]
    points = good.points.copy()
    points[5, 1] = np.nextafter(points[5, 1], 1)
    assert check.against_scene(dataclasses.replace(good, points=points)) == ["the body's nodes are not those of its scene"]
    for at, same in ((0, False), (47, False), (48, True)):  # 6 bricks of 8 nodes; what follows is the obstacle's
        cells = good.connectivity.copy()
        cells[at] += 1
        found = check.against_scene(dataclasses.replace(good, connectivity=cells))
        assert found == ([] if same else ["the body's cells are not those of its scene"])


@pytest.mark.parametrize("penetration, found", [
    (0.99e-5, []), (1.01e-5, ["the obstacle penetrates 1e-05 m at step 12; 1e-05 m is allowed"]),
    (2.5e-5, ["the obstacle penetrates 2.5e-05 m at step 12; 1e-05 m is allowed"])])
def test_a_thousandth_of_the_smallest_side_may_be_penetrated(penetration, found):
    """The box is 10 mm high. The last way-point lies so far below its top."""
    path = [[0.0, 0.0, 0.02], [0.0, 0.0, 0.01 - penetration]]
    obstacle = {"shape": "half-space", "normal": [0, 0, -1], "path": path}
    assert check.against_scene(trajectory(scene(obstacle=obstacle))) == found


@pytest.mark.parametrize("penetration, found", [
    (0.49e-3, []), (0.51e-3, ["the obstacle penetrates 0.00051 m at step 12; 0.0005 m is allowed"])])
def test_a_smooth_surface_may_give_way_by_a_twentieth_of_a_cell(penetration, found):
    """28 of 46 edges are 10 mm long, the others 17 mm. What the solver saw counts as well, before a trajectory is stored."""
    path = [[0.0, 0.0, 0.02], [0.0, 0.0, 0.01 - penetration]]
    obstacle = {"shape": "half-space", "normal": [0, 0, -1], "path": path, "contact": "smooth"}
    seen = np.linspace(0, penetration, COUNT + 1)
    made = trajectory(scene(obstacle=obstacle), per_frame={"penetration": seen})
    assert check.against_scene(made) == found
    assert check.unfit(made) == ["the obstacle penetrates too far at step 12"] * len(found)


@pytest.mark.parametrize("smallest", [0.02, 0.03, 0.05])
def test_the_smallest_of_three_sides_counts(smallest):
    body = {"length": 0.05, "width": 0.06 if smallest > 0.02 else 0.02, "height": 0.07 if smallest > 0.03 else 0.03,
            "cells": [3, 2, 1], "cell": "hexahedron"}
    for part, wrong in ((0.99e-3, False), (1.01e-3, True)):
        obstacle = {"shape": "half-space", "normal": [0, 0, -1],
                    "path": [[0.0, 0.0, 0.1], [0.0, 0.0, body["height"] - part * smallest]]}
        assert bool(check.against_scene(trajectory(scene(body=body, obstacle=obstacle)))) == wrong


def test_what_the_solver_saw_between_the_nodes_counts_too():
    """Stored penetration, deepest at a step in the middle; the larger of stored and computed is said."""
    stored = np.zeros(COUNT + 1)
    for largest, found in ((0.99e-5, []), (3e-5, ["the obstacle penetrates 3e-05 m at step 2; 1e-05 m is allowed"])):
        stored[[2, 10]] = largest, largest / 2
        assert check.against_scene(trajectory(scene(), per_frame={"penetration": stored.copy()})) == found


def test_nodes_held_in_all_components_may_be_inside_of_the_obstacle_others_not():
    """A small ball comes to rest inside of the end x = 0, 12 mm from the next nodes."""
    obstacle = {"shape": "sphere", "radius": 0.004, "path": [[-0.05, 0.01, 0.01], [0.0, 0.01, 0.01]]}
    assert check.against_scene(trajectory(scene(obstacle=obstacle))) == []
    found = check.against_scene(trajectory(scene(obstacle=obstacle, support=[{"where": "x-min", "fixed": "xz"}, {"where": "x-max"}])))
    assert found == ["the obstacle penetrates 0.004 m at step 12; 1e-05 m is allowed"]


def pulled():
    """The far end is moved by (4, 1, 0) mm, the rest in proportion to x: what the scene prescribes, all along the way."""
    given = scene(support=[{"where": "x-min"}, {"where": "x-max", "displacement": [0.004, 0.001, 0.0]}])
    x = build_mesh(given.body).points[:, 0] / 0.05
    u = np.arange(COUNT + 1)[:, None, None] / COUNT * x[:, None] * np.array([0.004, 0.001, 0.0])
    return given, trajectory(given, u), int(np.flatnonzero(x == 1)[0]), int(np.flatnonzero((x > 0) & (x < 1))[0])


@pytest.mark.parametrize(("tolerance", "allowed"), [(0.0, 4.8e-9), (1e-6, 1e-6)])
def test_what_is_held_stays_where_it_should_within_the_rounding(tolerance, allowed):
    """Four times the rounding of the largest displacement, which is the obstacle's 10 mm, or the tolerance of a packed set.

    Held still at x = 0, where no rounding of single precision blurs the limit.
    """
    _, good, end, free = pulled()
    good = dataclasses.replace(good, extra={"tolerance": tolerance})
    assert check.against_scene(good) == []
    for sign in (1, -1):
        assert check.against_scene(changed(good, (5, 0, 1), sign * 0.98 * allowed)) == []
        assert check.against_scene(changed(good, (5, 0, 1), sign * 1.02 * allowed)) == [
            f"held nodes leave their prescription by {1.02 * allowed:.2g} m"]
    assert check.against_scene(changed(good, (5, end, 2), 3e-6)) == ["held nodes leave their prescription by 3e-06 m"]
    assert check.against_scene(changed(good, (5, free, 2), 3e-6)) == []


def test_only_the_components_that_are_held_are_held():
    good = trajectory(scene(support=[{"where": "x-min", "fixed": "xz"}]))
    assert check.against_scene(changed(good, (5, 0, 1), 3e-6)) == []
    assert len(check.against_scene(changed(good, (5, 0, 2), -3e-6))) == 1


@pytest.mark.parametrize(("tolerance", "allowed"), [(0.0, 4.8e-9), (1e-6, 1e-6)])
def test_the_obstacle_stays_on_its_path_within_the_rounding(tolerance, allowed):
    good = trajectory(scene(), extra={"tolerance": tolerance})
    corner = len(good.points) - 2
    for sign in (1, -1):
        assert check.against_scene(changed(good, (7, corner, 1), sign * 0.98 * allowed)) == []
        assert check.against_scene(changed(good, (7, corner, 1), sign * 1.02 * allowed)) == [
            f"the obstacle leaves its path by {1.02 * allowed:.2g} m"]


def test_a_path_with_a_corner_is_followed():
    """Two way-points after the start: the middle one is reached at step 6 of 12."""
    path = [[0.0, 0.0, 0.02], [0.0, 0.003, 0.02], [0.001, 0.003, 0.015]]
    given = scene(obstacle={"shape": "half-space", "normal": [0, 0, -1], "path": path})
    t = np.arange(COUNT + 1)[:, None] / 6
    way = np.minimum(t, 1) * np.array([0, 0.003, 0]) + np.maximum(t - 1, 0) * np.array([0.001, 0, -0.005])
    good = trajectory(dataclasses.replace(given, obstacle=dataclasses.replace(given.obstacle, path=given.obstacle.path[:2])))
    u = good.displacement.copy()
    u[:, good.node_kind == OBSTACLE] = way[:, None]
    good = dataclasses.replace(good, displacement=u, scene=given.to_toml())
    assert check.against_scene(good) == []


def test_a_cell_may_be_thin_but_not_inverted():
    """The whole body is squeezed along x to 1 - s of its length; det F is that."""
    given = scene()
    x = build_mesh(given.body).points[:, 0]
    for squeeze, found in ((0.99, []), (1.25, ["det F = -0.25 at step 8: a cell is inverted"])):
        u = np.zeros((COUNT + 1, len(x), 3))
        u[8, :, 0] = -squeeze * x
        assert check.against_scene(trajectory(given, u)) == found


# ---- the equations, in the place of which stand formulas


class Formulas:
    """Forces 8 u; an energy of 5 J + s/4 and a reaction (0, 0, 60 + 2 s) N, s the sum of |u - what was seen first|; `residual` is left."""

    residual, energy, floor = 0.0, 5.0, 1e-12
    laws, checked = [], []  # of each set of equations made; the steps that it was asked for

    def __init__(self, given, mesh):
        fixed = np.zeros((len(mesh.points), 3), bool)
        fixed[mesh.points[:, 0] == 0] = True
        elasticity = types.SimpleNamespace(force=lambda u: 8 * u)
        self.balance = types.SimpleNamespace(elasticity=elasticity, fixed=fixed, floor=self.floor, size=0.5)
        self.law, self.seen = given.material.law, {}
        Formulas.laws.append(self.law)
        Formulas.checked.append([])

    def frame(self, u, fraction):
        step = round(fraction * COUNT)
        if step not in self.seen:
            Formulas.checked[-1].append(step)
        first = self.seen.setdefault(step, u.copy())
        change = abs(u - first).sum()
        return Frame(self.residual, np.array([[0, 0, 60 + 2 * change]]), self.energy + 0.25 * change)


@pytest.fixture
def statics(monkeypatch):
    """A trajectory whose free nodes all lie (2, 0, 0) mm from rest at every step but the first; Formulas check it."""
    given = scene(obstacle={"shape": "half-space", "normal": [0, 0, -1], "path": [[0.0, 0.0, 0.02], [0.0, 0.0, 0.015]]},
                  steps={"count": COUNT})
    x = build_mesh(given.body).points[:, 0]
    u = np.zeros((COUNT + 1, len(x), 3))
    u[1:, x > 0, 0] = 2.0**-9
    monkeypatch.setattr(check, "Checker", Formulas)
    monkeypatch.setattr(Formulas, "laws", [])
    monkeypatch.setattr(Formulas, "checked", [])
    made = trajectory(given, u, per_frame={"energy": np.full(COUNT + 1, 5.0), "reaction": np.tile([0.0, 0, 60], (COUNT + 1, 1))})
    assert check.against_scene(made) == [] and (x > 0).sum() == FREE
    return made


FREE = 18  # 3 of the 4 planes of 3 x 2 nodes
BLUR = 2.0**-24 * 2**-9  # [m] half a unit in the last place, of one component of each free node
LOST = 8 * BLUR * FREE**0.5  # [N] what it changes in the forces
ALLOWED = 60 * TOLERANCE + 2 * LOST  # [N]


@pytest.mark.parametrize(("factor", "passes"), [(0.999, True), (1.001, False)])
def test_the_residual_may_be_the_solvers_tolerance_and_twice_the_rounding(statics, monkeypatch, factor, passes):
    monkeypatch.setattr(Formulas, "residual", factor * ALLOWED)
    found = check.against_scene(statics)
    assert found == ([] if passes else [f"no equilibrium at step 2: |R| = {1.001 * ALLOWED:.2g} N, where rounding allows {ALLOWED:.2g} N"])
    monkeypatch.setattr(Formulas, "residual", np.nan)
    assert len(check.against_scene(statics)) == 1


def test_the_solver_is_asked_for_a_millionth_of_the_reaction():
    assert TOLERANCE == 1e-6


@pytest.mark.parametrize(("factor", "passes"), [(0.999, True), (1.001, False)])
def test_the_residual_may_reach_the_floor_of_the_solver(statics, monkeypatch, factor, passes):
    monkeypatch.setattr(Formulas, "floor", 0.01)
    monkeypatch.setattr(Formulas, "residual", factor * (0.01 + 2 * LOST))
    assert (check.against_scene(statics) == []) == passes


@pytest.mark.parametrize(("factor", "passes"), [(0.999, True), (1.001, False)])
def test_the_residual_may_be_as_large_as_the_tolerance_of_a_packed_set_makes_it(statics, monkeypatch, factor, passes):
    """All three components of each free node may be off by 1e-5 m."""
    monkeypatch.setattr(Formulas, "residual", factor * (60 * TOLERANCE + 2 * 8 * 1e-5 * (3 * FREE) ** 0.5))
    assert (check.against_scene(dataclasses.replace(statics, extra={"tolerance": 1e-5})) == []) == passes


def test_forces_on_supports_count_where_they_are_larger_than_the_reaction(statics, monkeypatch):
    """Six held nodes whose stored displacement of 10 m (the tolerance of this set) pulls with 80 N each; a reaction of 60 N."""
    given = read_scene({**tomllib.loads(statics.scene), "support": [{"where": "x-min", "displacement": [0.0, 10.0, 0.0]}]})
    u = statics.displacement.copy()
    body = np.flatnonzero(statics.node_kind != OBSTACLE)
    u[:, body, 1] = 10 * np.arange(COUNT + 1)[:, None] / COUNT
    held = dataclasses.replace(statics, displacement=u, scene=given.to_toml())
    blur = 2.0**-24 * np.array([2.0**-9, 10])
    lost = 8 * (FREE * (blur**2).sum()) ** 0.5
    allowed = TOLERANCE * 80 * 6**0.5 + 2 * lost
    for factor, passes in ((0.999, True), (1.001, False)):
        monkeypatch.setattr(Formulas, "residual", factor * allowed)
        stored = {"energy": np.full(COUNT + 1, 5.0), "reaction": np.tile([0.0, 0, 60], (COUNT + 1, 1))}
        assert (check.against_scene(dataclasses.replace(held, per_frame=stored), steps=1) == []) == passes


ROOM = 1e-9 * 5 + 1e-12 * 0.5 + 2 * (0.25 * BLUR * FREE + 8 * 2.0**-9 * BLUR * FREE**0.5)  # [J]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("factor", "passes"), [(0.999, True), (1.001, False)])
def test_the_energy_may_differ_by_what_rounding_may_do_to_it(statics, sign, factor, passes):
    """A part in 1e9, the floor's force over a size, and twice: the change seen and f . d were it aligned."""
    energy = np.full(COUNT + 1, 5.0)
    energy[5] += sign * factor * ROOM
    found = check.against_scene(dataclasses.replace(statics, per_frame={"energy": energy}))
    assert found == ([] if passes else ["energy 5 J at step 5, computed anew 5 J"])
    energy[5] = np.nan
    assert len(check.against_scene(dataclasses.replace(statics, per_frame={"energy": energy}))) == 1


def test_the_floor_and_the_part_of_the_energy_count(statics, monkeypatch):
    """With a floor of 2 N over a size of 0.5 m a whole joule may be missing, with 1e9 J likewise."""
    for name, value, room in (("floor", 2.0, 1.0), ("energy", 1e9, 1.0)):
        with monkeypatch.context() as patch:
            patch.setattr(Formulas, name, value)
            for off, passes in ((0.999 * room, True), (1.001 * room, False)):
                energy = np.full(COUNT + 1, Formulas.energy + off)
                assert (check.against_scene(dataclasses.replace(statics, per_frame={"energy": energy})) == []) == passes, name


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("factor", "passes"), [(0.999, True), (1.001, False)])
def test_the_reaction_may_differ_by_the_residual_and_twice_its_own_rounding(statics, axis, factor, passes):
    reaction = np.tile([0.0, 0, 60], (COUNT + 1, 1))
    reaction[7, axis] -= factor * (ALLOWED + 2 * 2 * BLUR * FREE)
    found = check.against_scene(dataclasses.replace(statics, per_frame={"reaction": reaction}))
    assert (found == []) == passes
    assert passes or (found[0].startswith("reaction [") and found[0].endswith(" N at step 7, computed anew [0.0, 0.0, 60.0] N"))


@pytest.mark.parametrize(("steps", "checked"), [(1, [12]), (2, [6, 12]), (3, [4, 8, 12]), (5, [2, 5, 7, 10, 12]),
                                                (12, range(1, 13))])
def test_the_steps_whose_equilibrium_is_computed_are_evenly_spaced(statics, steps, checked):
    """count / steps, ..., count, rounded: 2.4, 4.8, 7.2, 9.6, 12 of 12 in 5. What is wrong elsewhere is not seen."""
    energy = np.full(COUNT + 1, 6.0)
    energy[list(checked)] = 5
    assert check.against_scene(dataclasses.replace(statics, per_frame={"energy": energy}), steps=steps) == []
    energy[:] = 5
    energy[checked[0]] = 6
    assert check.against_scene(dataclasses.replace(statics, per_frame={"energy": energy}), steps=steps) == [
        f"energy 6 J at step {checked[0]}, computed anew 5 J"]
    assert Formulas.checked[-1] == [checked[0]] and Formulas.checked[-2] == list(checked)
    reaction = np.tile([0.0, 0, 60], (COUNT + 1, 1))
    reaction[12] = 1, 2, 3
    assert check.against_scene(dataclasses.replace(statics, per_frame={"reaction": reaction}), steps=steps) == [
        "reaction [1.0, 2.0, 3.0] N at step 12, computed anew [0.0, 0.0, 60.0] N"]


def test_a_step_is_held_against_the_law_that_it_was_solved_with(statics):
    """Five steps are looked at, 2, 5, 7, 10 and 12; the first five of the path were linear. One set of equations for each law."""
    Formulas.laws.clear()
    assert check.against_scene(dataclasses.replace(statics, extra={"linear_steps": 5})) == []
    assert Formulas.laws == ["linear", "neo-hookean"]


def test_what_is_wrong_before_hides_the_equations(statics):
    wrong = changed(statics, (3, 0), (0, 1e-3, 0))
    assert check.against_scene(dataclasses.replace(wrong, per_frame={"energy": np.zeros(COUNT + 1)})) == [
        "held nodes leave their prescription by 0.001 m"]


def test_the_precision_is_half_a_unit_in_the_last_place_or_the_tolerance():
    made = tiny()
    expected = np.abs(made.displacement.astype(float)) / 2**24
    assert np.array_equal(check.precision(made), expected)
    blurred = check.precision(tiny(extra={"tolerance": 1e-9}))
    assert np.array_equal(blurred, np.where(expected > 1e-9, expected, 1e-9)) and len(np.unique(blurred)) > 2


# ---- a folder


def test_every_line_names_the_file_once(tmp_path):
    good = trajectory(scene())
    write_set(tmp_path, {"train/0000.vtkhdf": good, "train/0001.vtkhdf": dataclasses.replace(good, scene="]"),
                         "valid/0000.vtkhdf": dataclasses.replace(good, scene='name = "x"'), "test/0000.vtkhdf": tiny(scene=""),
                         "test/0001.vtkhdf": tiny(complete=False)})
    for split in ("train", "valid", "test"):
        (tmp_path / split / "0009.vtkhdf").touch()
    found = check.check(tmp_path)
    assert found[0].startswith(f"{tmp_path}/train/0001.vtkhdf: its scene is not TOML: ")
    assert found[1:] == [f"{tmp_path}/valid/0000.vtkhdf: body: missing",
                         f"{tmp_path}/test/0001.vtkhdf: the solver stopped before the last step",
                         *(f"{tmp_path}/{split}/0009.vtkhdf: not in the manifest" for split in ("test", "train", "valid"))]
    (tmp_path / "test/0000.vtkhdf").unlink()
    assert f"{tmp_path}/test/0000.vtkhdf: no such file" in check.check(tmp_path)
