"""The parts of an estimate against closed forms, and an estimate itself against a plain solution of the same linear problem."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory
from learning.samples.estimate import estimator_of
from physics.contact.conditions import ContactSurface, cell_size
from physics.contact.obstacles import Rigid
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.reduced import quasistatic as module
from physics.reduced.elastic import Elastic
from physics.reduced.pose import PoseState, Press
from physics.reduced.quasistatic import Estimator, Solved, _loads
from physics.reduced.space import Reduced
from physics.scene import Body, read_scene
from physics.schema import InputError

TABLE = {
    "body": {"shape": "beam", "length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 2, 2], "cell": "hexahedron"},
    "material": {"young_modulus": 3e6, "poisson_ratio": 0.3, "law": "linear"},
    "support": [{"where": "x-min"}],
    "obstacle": {"shape": "half-space", "normal": [-0.001, -0.002, -1.0], "path": [[0.06, 0.02, 0.02025], [0.06, 0.02, 0.01985]]},
    "steps": {"count": 4},
}


def unsolved(table=None, *, centres=None):
    """A trajectory whose free nodes stay: geometry and obstacle are all that an estimate reads."""
    scene = read_scene(table or TABLE)
    mesh, rigid = build_mesh(scene.body), Rigid(scene.obstacle)
    surface, triangles = rigid.surface_mesh(mesh.points, size=0.01)
    nodes, count = len(mesh.points), scene.steps.count
    kind = np.concatenate([np.full(nodes, NORMAL, np.uint8), np.full(len(surface), OBSTACLE, np.uint8)])
    kind[mesh.places["x-min"]] = HANDLE
    if centres is None:
        centres = np.array([rigid.position(step / count) for step in range(count + 1)])
    displacement = np.zeros((len(centres), nodes + len(surface), 3), np.float32)
    displacement[:, nodes:] = (centres - rigid.path[0])[:, None]
    corners = mesh.cells.shape[1]
    return Trajectory(
        points=np.concatenate([mesh.points, surface]), connectivity=np.concatenate([mesh.cells.ravel(), (triangles + nodes).ravel()]),
        offsets=np.concatenate([np.arange(len(mesh.cells)) * corners, mesh.cells.size + np.arange(len(triangles) + 1) * 3]),
        types=np.concatenate([np.full(len(mesh.cells), CELLS[mesh.cell].vtk, np.uint8), np.full(len(triangles), 5, np.uint8)]),
        node_kind=kind, displacement=displacement, modes=np.zeros((0, nodes + len(surface), 3), np.float32), scene=scene.to_toml())


@pytest.mark.parametrize("normal", [(0.0, 0.6, 0.8), (1.0, 0.0, 0.0)])
def test_loads_are_bells_of_one_cell_around_a_point(normal):
    mesh = build_mesh(Body(length=0.06, width=0.02, height=0.02, cells=(4, 2, 2), cell="hexahedron"))
    surface = ContactSurface(mesh, "facets", np.zeros(len(mesh.points), bool))
    rest, size, at, normal = surface.positions(mesh.points), 0.008, np.array([0.035, 0.012, 0.02]), np.array(normal)
    loads = _loads(surface, rest, at, normal, size, mesh)
    assert loads.shape == (3 * len(mesh.points), 7)
    # the body's long axis is x: along it, but normal to the normal; where that is x itself, normal to the smallest of its components
    first = np.array([1.0, 0, 0]) if normal[0] == 0 else np.cross(normal, np.eye(3)[1])
    first = first * np.sign(loads[:, 1] @ np.tile(first, len(mesh.points)))
    across = np.cross(normal, first)

    def bell(centre):
        weight = np.array([np.exp(-np.sum((point - centre) ** 2) / (2 * size**2)) * area
                           for point, area in zip(rest, surface.area, strict=True)])
        nodal = np.zeros(len(mesh.points))
        for share, row in zip(weight / weight.sum(), surface.weights.toarray(), strict=True):
            nodal += share * row
        return nodal  # its sum is one

    middle = bell(at)
    pairs = [[bell(at + s * 2 * size * way) for s in (1, -1)] for way in (first, across)]
    shapes = [middle, middle, middle, *(a - b for a, b in pairs), *(a + b - 2 * middle for a, b in pairs)]
    ways = [normal, first, across, normal, normal, normal, normal]
    for column, shape, way in zip(loads.T, shapes, ways, strict=True):
        np.testing.assert_allclose(column.reshape(-1, 3), np.outer(shape, way), atol=1e-14)


def test_what_an_estimator_knows_of_its_scene(monkeypatch):
    monkeypatch.setattr(Estimator, "_prepare", lambda *given: None)
    centres = np.array([[0, 0, 0], [0, 0, 2e-4], [0, 3e-3, -3.8e-3], [0, 0, -3e-4], [0, 0, 4e-3]]) + [0.06, 0.02, 0.02025]
    trajectory = unsolved(centres=centres)
    estimator = estimator_of(trajectory)
    # 4 x 2 x 2 hexahedra of 15 x 10 x 10 mm: 36 edges of 15 and 66 of 10 mm
    assert estimator.size == pytest.approx(0.01)
    np.testing.assert_allclose(estimator.centres, centres, atol=1e-9)
    np.testing.assert_allclose(estimator._way, np.cumsum([0, 2e-4, 5e-3, np.hypot(3e-3, 3.5e-3), 4.3e-3]), atol=1e-8)
    assert estimator.overlaps.tolist() == [False, False, True, True, False]
    assert not (estimator.surface.positions(estimator.mesh.points)[:, 0] < 1e-9).any()  # what is held is not in contact


def press_of(trajectory):
    """The body of a trajectory in a space of three functions of no meaning, and its obstacle."""
    scene, mesh, held = read_scene(TABLE), trajectory.mesh, trajectory.node_kind[trajectory.body] == HANDLE
    elastic, rigid = Elastic(mesh, held, scene.material), Rigid(scene.obstacle)
    vectors = np.random.default_rng(0).normal(size=(3, elastic.size)) * ~elastic.held
    return Press(mesh, cell_size(mesh), ContactSurface(mesh, "facets", held), rigid, elastic, Reduced(elastic, vectors))


def test_what_a_pressed_body_knows_of_its_contact():
    press = press_of(unsolved())
    assert press.size == pytest.approx(0.01) and press._tolerance == pytest.approx(6e-7)  # 1e-5 of the length of 60 mm
    # of exact contact the inverse of a stiffness of 2e4 moduli over a cell, times the area
    np.testing.assert_allclose(press._softness, 0.01 / 2e4 / press.surface.area)


def on_path(centres, overlaps, size=1.0):
    estimator = Estimator.__new__(Estimator)
    estimator.centres, estimator.overlaps, estimator.size = np.array(centres, float), np.array(overlaps, bool), size
    estimator._way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(estimator.centres, axis=0), axis=1))])
    return estimator


def test_poses_are_closer_where_contact_begins_or_ends(monkeypatch):
    monkeypatch.setattr(module, "POSES", 4)
    monkeypatch.setattr(module, "GRADED", 2.0)
    line = np.arange(17)[:, None] * [0, 0, 0.01]
    pressing, leaving = on_path(line, np.arange(17) > 0), on_path(line, np.arange(17) < 16)
    assert pressing._poses(0, 16).tolist() == [0, 1, 4, 9, 16]  # the squares of quarters
    assert leaving._poses(0, 16).tolist() == [0, 7, 12, 15, 16]
    assert pressing._poses(4, 8).tolist() == [4, 5, 7, 8]  # 1/4, 1, 9/4 and 4 frames on, the first frames that are there
    far = on_path(20 * line, np.arange(17) > 0)  # of 3.2 cells no half may be passed over, at the end, where poses lie farthest apart
    assert np.diff(far._way[far._poses(0, 16)]).max() <= 0.5 + 1e-9


def test_parts_of_a_path_end_where_it_turns_and_where_overlap_begins_or_ends():
    corner = [[0, 0, 3], [0, 0, 2], [0, 0, 1], [0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0], [2, 0, 1], [2, 0, 2], [2, 0, 3]]
    estimator = on_path(corner, [0, 0, 1, 1, 1, 1, 1, 1, 0, 0], size=100.0)
    # from the last frame without overlap to the first with it, to the corner, to where it stands still and turns, to the last frame
    # with overlap, to the first without, to the end
    assert [part.tolist() for part in estimator._pieces(1)] == [[1, 2], [2, 3], [3, 4, 5], [6, 7], [7, 8], [8, 9]]


def plain(trajectory, frame):
    """The linear problem of the frame without any small space: forces p at points of contact by projected Gauss and Seidel."""
    scene, mesh = read_scene(TABLE), trajectory.mesh
    held = trajectory.node_kind[trajectory.body] == HANDLE
    elastic, rigid = Elastic(mesh, held, scene.material), Rigid(scene.obstacle)
    surface = ContactSurface(mesh, "facets", held)
    gap, normal = rigid.gap(surface.positions(mesh.points), rigid.path[0] + trajectory.displacement[frame, -1])
    g = np.einsum("qn,qi->qni", surface.weights.toarray(), normal).reshape(len(gap), -1)
    near = gap < 2e-3
    g, gap = g[near], gap[near]
    answers = elastic.solve(g.T * ~np.repeat(held, 3)[:, None])
    matrix = g @ answers + np.diag(0.01 / 2e4 / surface.area[near])
    p = np.zeros(len(gap))
    for _ in range(3000):
        for i in range(len(p)):
            p[i] = max(0.0, p[i] - (gap[i] + matrix[i] @ p) / matrix[i, i])
    return (answers @ p).reshape(-1, 3), p


def test_a_small_dent_is_that_of_the_linear_problem():
    trajectory = unsolved()
    found, answer = estimator_of(trajectory).frames([1, 2, 3, 4])
    assert not found[:2].any() and not answer[:2].any()  # 0.05 mm short of touching, and more
    # turned by some 7e-3
    for row, frame, close in ((2, 3, 2e-4), (3, 4, 2e-4)):
        expected, p = plain(trajectory, frame)
        assert (p > 0).sum() > 1 and abs(expected).max() > 4e-5
        assert abs(found[row] - expected).max() < close * abs(expected).max()
        assert 0 < abs(answer[row]).max() < close * abs(expected).max()


def test_an_obstacle_that_never_touches_leaves_all_at_rest():
    trajectory = unsolved(centres=np.array([[0.06, 0.02, 0.02025], [0.06, 0.02, 0.0201], [0.06, 0.02, 0.0203]]))
    estimator = estimator_of(trajectory)
    assert not estimator.overlaps.any() and not estimator._parts
    found, answer = estimator.frames([1, 2])
    assert found.shape == answer.shape == (2, len(trajectory.mesh.points), 3) and found.dtype == answer.dtype == np.float32
    assert not found.any() and not answer.any()


def test_columns_of_the_inverse_are_solved_for_once():
    elastic = press_of(unsolved()).elastic
    free = ~elastic.held
    whole = np.zeros((elastic.size, elastic.size))
    whole[np.ix_(free, free)] = np.linalg.inv(elastic.stiffness.toarray()[np.ix_(free, free)])
    solved, solve = [], elastic.solve
    elastic.solve = lambda force: solved.append(force.shape[1]) or solve(force)
    for nodes, new in (([20, 7], 2), ([7, 20, 31], 1), ([31, 7], 0), ([5], 1)):
        rows = elastic.learn(np.array(nodes))
        found = elastic.columns[rows]
        columns = (3 * np.array(nodes)[:, None] + np.arange(3)).ravel()
        np.testing.assert_allclose(found, whole[:, columns].T, atol=1e-9 * abs(whole).max())
        assert sum(solved) == 3 * new
        solved.clear()


def refining(monkeypatch, value, frames=65):
    """An estimator on a straight path of whole frames whose states are made up, and the frames that it was asked for."""
    estimator, asked = on_path(np.arange(frames)[:, None] * [0, 0, 1.0], np.ones(frames, bool)), []
    estimator.mesh = SimpleNamespace(points=np.zeros((1, 3)))
    press = SimpleNamespace(displacement=lambda state: np.array([[state.q[0], 0, 0]]))

    def solved(frame):
        return Solved(PoseState(estimator.centres[frame], np.array([value(frame)]), np.zeros((1, 3)), np.zeros(1), np.zeros(3)),
                      np.zeros(1), np.zeros(3))

    def ask(press, centre, guess, near):
        asked.append(int(centre[2]))
        return solved(asked[-1])

    monkeypatch.setattr(estimator, "_solved", ask)
    return estimator, press, solved, asked


def test_a_smooth_stretch_has_one_pose_more_and_a_bent_one_is_halved(monkeypatch):
    part = np.array([0, 16, 32, 48, 64])
    for value, expected in ((lambda frame: (frame / 64) ** 3, {8, 24, 40, 56}),  # a cubic is what the polynomial through four foretells
                            (lambda frame: max(0.0, frame - 50.0), set(range(2, 64, 2)))):  # a bend that is felt in all cubics
        estimator, press, solved, asked = refining(monkeypatch, value)
        found = {frame: solved(frame) for frame in part.tolist()}
        for one, other in pairwise(part.tolist()):
            estimator._refine(press, one, other, part, found, 3)
        assert len(asked) == len(set(asked)) and set(asked) <= expected
        assert {8, 24, 40, 56} <= set(asked)
        if max(expected) == 62:  # halved three times about the bend, and not in the first stretch's ends
            assert {50, 52, 54} <= set(asked) and not {2, 4} <= set(asked)


@pytest.mark.parametrize("changes", [
    {"load": [{"where": "x-max", "traction": [0, 0, 1.0]}]},
    {"support": [{"where": "x-min", "fixed": "xy"}]},
    {"support": [{"where": "x-min"}, {"where": "x-max", "displacement": [0, 0, 1e-3]}]},
    {"steps": {"count": 4, "duration": 0.1, "dynamic": True}},
    {"obstacle": None},
])
def test_scenes_of_other_kinds_are_refused(changes):
    trajectory = unsolved()
    table = {key: value for key, value in {**TABLE, **changes}.items() if value is not None}
    text = read_scene(table).to_toml()
    with pytest.raises(InputError, match="knows clamped bodies pressed by an obstacle alone"):
        estimator_of(replace(trajectory, scene=text))
    with pytest.raises(InputError, match="holds no scene"):
        estimator_of(replace(trajectory, scene=""))


def test_scenes_of_several_obstacles_or_materials_are_refused():
    box = {"box": [[0, 0, 0], [TABLE["body"]["length"] / 2, 1, 1]]}
    for several in ({"obstacle": [TABLE["obstacle"]] * 2}, {"material": [TABLE["material"] | {"where": box}, TABLE["material"]]}):
        with pytest.raises(InputError, match="knows one obstacle and one material"):
            estimator_of(replace(unsolved(), scene=read_scene(TABLE | several).to_toml()))


def test_a_sheet_whose_stretch_across_follows_is_refused():
    body = {"shape": "plate", "length": 0.06, "width": 0.02, "cells": [6, 2], "cell": "triangle", "plane": "stress"}
    with pytest.raises(InputError, match="knows no plane stress"):
        estimator_of(replace(unsolved(), scene=read_scene(TABLE | {"body": body}).to_toml()))


def test_between_the_first_poses_others_are_solved_and_a_rough_estimate_has_none():
    """Of a body pressed over 21 frames: poses in the middles of the way between the first ones, each of which stays."""
    scene, trajectory = read_scene(TABLE), unsolved(centres=np.linspace([0.06, 0.02, 0.02025], [0.06, 0.02, 0.019], 21))
    held = trajectory.node_kind[trajectory.body] == HANDLE
    rough, whole = (Estimator(scene, trajectory.mesh, held, trajectory.displacement[:, -1] + scene.obstacle.path[0], rough=rough)
                    for rough in (True, False))
    first = {int(frame) for part in rough._pieces(int(rough.overlaps.argmax()) - 1) for frame in part}
    assert set(rough._known) == first and len(first) > 5
    pairs = [(a, b) for a, b in pairwise(sorted(first)) if b > a + 1]
    assert len(pairs) > 2 and set(whole._known) > first
    assert all(a + (b - a + 1) // 2 in whole._known for a, b in pairs)  # on a straight path of even steps
    assert [tuple(part.x[[0, -1]]) for part in whole._parts] == [tuple(whole._way[part[[0, -1]]]) for part in whole._pieces(min(first))]
    between = next(frame for frame in range(min(first), max(first)) if frame not in rough._known)
    end = rough.frames([between - 1, between, between + 1])[0][:, :, 2].min(axis=1)
    assert end[0] > end[1] > end[2]  # what lies between goes down as well


def test_where_newton_leads_nowhere_the_body_stays_as_it_last_was_and_the_poses_are_named(monkeypatch):
    """From the fourteenth of 21 frames on no state is found."""
    trajectory, newton = unsolved(centres=np.linspace([0.06, 0.02, 0.02025], [0.06, 0.02, 0.019], 21)), Press.newton
    monkeypatch.setattr(Press, "newton", lambda press, centre, state, c: newton(press, centre, state, c) if centre[2] > 0.0194 else None)
    estimator = estimator_of(trajectory)
    poses = {int(frame) for part in estimator._pieces(int(estimator.overlaps.argmax()) - 1) for frame in part}
    assert estimator.lost == sorted(frame for frame in poses if frame > 13) and len(estimator.lost) > 1
    found, _ = estimator.frames(range(21))
    last = max(estimator._known)
    assert last in poses and last <= 13 and found[last].any()
    np.testing.assert_array_equal(found[last + 1:], np.broadcast_to(found[last], found[last + 1:].shape))
