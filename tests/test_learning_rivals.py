"""Rivals of a learned simulator: what knows nothing, worked out on paper, and how finite elements are made cheaper."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from learning.prediction import rivals as module
from learning.prediction.predictor import Case, LeftOut, Prediction, Predictor
from learning.prediction.rivals import (
    REFERENCE,
    between,
    coarser,
    elements,
    follow,
    keep_acceleration,
    keep_velocity,
    nothing_moves,
    trivial,
)
from physics.mesh.build import build_mesh
from tests.scenes import beam
from tests.synthetic import bending

FREE = np.array([True, False])


def cubic(frames=6):
    """(T, 2, 3): a free node and a held one, both with t^3 + 2 t^2 + 5 t times (1, -2, 3); the held one ten times as far."""
    t = np.arange(float(frames))
    path = (t**3 + 2 * t**2 + 5 * t)[:, None, None] * np.array([1.0, -2, 3])
    return path * np.array([1.0, 10])[None, :, None]


# t^3 + 2 t^2 + 5 t at 0 .. 5
TRUTH = [0, 8, 26, 60, 116, 200]


@pytest.mark.parametrize("rule, path, steps", [
    (nothing_moves, [0, 0, 0, 0, 0, 0], [0, 8, 26, 60, 116]),
    # from 0 and 8 on by 8; one step from each true frame: 2 now - before, and rest from rest
    (keep_velocity, [0, 8, 16, 24, 32, 40], [0, 16, 44, 94, 172]),
    # from 0, 8, 26, whose second difference is 10: differences 18, 28, 38, 48; one step: 3 now - 3 before + before that,
    # a straight line where there are two frames, rest where there is one
    (keep_acceleration, [0, 8, 26, 54, 92, 140], [0, 16, 54, 110, 194]),
], ids=["nothing moves", "velocity", "acceleration"])
def test_what_knows_nothing_on_paper(rule, path, steps):
    truth = cubic()
    before = truth.copy()
    found, single = rule(truth, FREE)
    direction = np.array([1.0, -2, 3])
    assert truth[:, 0, 0].tolist() == TRUTH
    np.testing.assert_allclose(found[:, 0], np.outer(path, direction), atol=1e-12)
    np.testing.assert_allclose(single[:, 0], np.outer(steps, direction), atol=1e-12)
    np.testing.assert_array_equal(found[:, 1], truth[:, 1])
    np.testing.assert_array_equal(single[:, 1], truth[1:, 1])
    np.testing.assert_array_equal(truth, before)


def test_trivial_predictors_are_these_rules_by_name(monkeypatch):
    trajectory = bending(cells=(4, 2, 2))
    case = Case("a", trajectory, None, None)
    clock = iter([3.0, 3.5] * 3)
    monkeypatch.setattr(module, "time", SimpleNamespace(process_time=lambda: next(clock)))
    assert case.steps == 10 and case.truth.shape == (11, 45, 3) and case.free.sum() == 36
    np.testing.assert_array_equal(case.truth, trajectory.displacement[:, :45])
    for each, name, rule in zip(trivial(), ("nothing moves", "keep the last velocity", "quadratic extrapolation"),
                                (nothing_moves, keep_velocity, keep_acceleration), strict=True):
        assert (each.name, each.kind) == (name, "trivial")
        found, (path, steps) = each.predict(case), rule(case.truth, case.free)
        np.testing.assert_array_equal(found.path, path)
        np.testing.assert_array_equal(found.one_step, steps)
        assert (found.seconds, found.set_up, found.iterations) == (0.5, 0.0, None)


def test_a_prediction_costs_no_set_up_unless_it_says_so():
    found = Prediction(path=np.zeros(1), seconds=1.0)
    assert (found.one_step, found.set_up, found.iterations) == (None, 0.0, None)


@pytest.mark.parametrize("steps, expected", [(2, [0, 2, 8]), (4, [0, 1, 2, 5, 8]), (1, [0, 8]), (8, [0, 0.5, 1, 1.5, 2, 3.5, 5, 6.5, 8])])
def test_frames_between_lie_on_straight_lines(steps, expected):
    path = np.array([0.0, 2, 8])[:, None, None] * np.array([[1.0, -3, 2], [0.5, 0, 1]])
    found = between(path, steps)
    np.testing.assert_allclose(found, np.array(expected)[:, None, None] * np.array([[1.0, -3, 2], [0.5, 0, 1]]), atol=1e-14)


def test_cells_are_halved_down_to_two():
    def halves(cells):
        scene, found = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": cells}), []
        while (scene := coarser(scene)) is not None:
            found.append(scene.body.divisions)
        return found

    assert halves([13, 5, 3]) == [(6, 2, 2), (3, 2, 2), (2, 2, 2)]
    assert halves([8, 1, 2]) == [(4, 1, 2), (2, 1, 2)]  # one cell stays one
    assert halves([2, 2, 2]) == []
    scene = beam()
    assert coarser(replace(scene, body=replace(scene.body, shape="file"))) is None


LOADED = dict(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 2, 2]},
              load=[{"where": "x-max", "traction": [0.0, 0.0, -50.0]}],
              material={"young_modulus": 1e6, "poisson_ratio": 0.4, "law": "linear"})


class Road:
    """A solver made up: at a fraction f each node has gone f^2 times its own place; each step takes 2 s and 3 Newton steps, or fails."""

    def __init__(self, patch, fails=None):
        self.now, self.asked, self.mesh = 0.0, [], None
        road = self

        def solve(scene, *, mesh, tolerance, partial):
            road.scene, road.mesh, road.tolerance = scene, build_mesh(scene.body), tolerance
            road.now += 7
            u, failure = [np.zeros_like(road.mesh.points)], ""
            for step in range(1, scene.steps.count + 1):
                road.now += 2
                road.asked.append(step / scene.steps.count)
                if fails is not None and len(road.asked) == fails:
                    failure = f"no equilibrium at step {step}: lost"
                    break
                u.append(road.asked[-1] ** 2 * road.mesh.points)
            return SimpleNamespace(mesh=road.mesh, displacement=np.array(u), set_up=7.0, failure=failure,
                                   newton_iterations=np.array([0] + [3] * (len(u) - 1)))

        patch.setattr(module, "solve", solve)
        patch.setattr(module, "time", SimpleNamespace(process_time=lambda: self.now))
        for name in ("between", "interpolate"):
            patch.setattr(module, name, self.later(getattr(module, name)))

    def later(self, work):
        def do(*given):
            self.now += 0.5
            return work(*given)
        return do


@pytest.fixture
def case():
    scene = beam(**LOADED)
    return Case("a", bending(cells=(4, 2, 2), steps=8, length=0.06), scene, build_mesh(scene.body))


def test_the_reference_follows_every_step_at_the_solvers_tolerance(case, monkeypatch):
    road = Road(monkeypatch)
    predictor = elements(REFERENCE)
    assert (predictor.name, predictor.kind) == ("FE, the reference", "reference") and isinstance(predictor, Predictor)
    found = predictor.predict(case)
    assert road.asked == [step / 8 for step in range(1, 9)] and road.scene.steps.count == 8
    np.testing.assert_allclose(found.path, (np.arange(9) / 8)[:, None, None] ** 2 * case.mesh.points)
    assert (found.seconds, found.set_up, found.iterations, found.one_step) == (16.0, 7.0, 24, None)
    assert road.tolerance == module.TOLERANCE


def test_elements_are_made_cheaper_in_each_way_at_hand(case, monkeypatch):
    road = Road(monkeypatch)
    found = elements("FE, b", halvings=1, fewer=3, tolerance=0.125, law="neo-hookean").predict(case)
    assert road.scene.body.divisions == (2, 2, 2) and road.scene.material.law == "neo-hookean" and road.tolerance == 0.125
    assert road.asked == pytest.approx([1 / 3, 2 / 3, 1])  # 8 / 3 is nearest to 3
    share = np.interp(np.arange(9) / 8, [0, 1 / 3, 2 / 3, 1], [0, 1 / 9, 4 / 9, 1])
    # on the nodes of the case's own mesh, which a field that is linear in the place meets exactly
    np.testing.assert_allclose(found.path, share[:, None, None] * case.mesh.points, atol=1e-15)
    assert (found.seconds, found.set_up, found.iterations) == (6.0 + 2 * 0.5, 7.0, 9)
    assert elements("x").kind == "fe"
    road.asked.clear()
    assert elements("x", fewer=100).predict(case).path.shape == (9, *case.mesh.points.shape) and road.asked == [1.0]


def test_what_cannot_be_made_cheaper_is_left_out(case, monkeypatch):
    Road(monkeypatch)
    with pytest.raises(LeftOut, match="no cells left"):
        elements("x", halvings=3).predict(case)
    with pytest.raises(LeftOut, match="linear already"):
        elements("x", law="linear").predict(case)
    Road(monkeypatch, fails=3)
    with pytest.raises(LeftOut, match="at step 3: lost"):
        elements("x").predict(case)


def test_a_path_of_linear_elements_is_proportional_to_the_load():
    mesh, path, set_up, seconds, iterations = follow(beam(steps={"count": 2}, **LOADED))
    np.testing.assert_allclose(path[1], path[2] / 2, atol=1e-5 * abs(path[2]).max())
    # Euler-Bernoulli: F L^3 / (3 E I), F = 50 Pa 4 cm2, I = h^4 / 12; shear and four coarse cells change it by less than a third
    assert path[2][mesh.places["x-max"], 2].mean() == pytest.approx(-0.02 * 0.06**3 / (3 * 1e6 * 0.02**4 / 12), rel=0.35)
    assert set_up > 0 and seconds > 0 and iterations == 0  # solved at once


def test_nothing_moves_keeps_the_first_frame_of_further_fields_and_others_tell_none():
    trajectory = replace(bending(cells=(4, 2, 2), steps=3), fields={"stress": np.arange(4 * 93.0).reshape(4, 93, 1).astype(np.float32)})
    found = [each.predict(Case("a", trajectory, None, None)).fields for each in trivial()]
    assert list(found[0]) == ["stress"] and np.array_equal(found[0]["stress"], trajectory.fields["stress"][:1]) and found[1:] == [{}, {}]


@pytest.mark.parametrize("shape", ["file", "channel", "panel"])
def test_a_mesh_that_is_not_made_of_its_scene_is_not_made_coarser_but_followed_on_itself(shape, case, monkeypatch):
    road = Road(monkeypatch)
    of_file = replace(case, known=replace(case.scene, body=replace(case.scene.body, shape=shape)))
    assert coarser(of_file.scene) is None
    with pytest.raises(LeftOut, match="the mesh is that of a file" if shape == "file" else "no cells left to halve"):
        elements("x", halvings=1).predict(of_file)
    given = []
    monkeypatch.setattr(module, "follow", lambda scene, tolerance, mesh: given.append(mesh) or (case.mesh, case.truth, 1.0, 2.0, 3))
    assert elements("x").predict(of_file).set_up == 1.0 and given == [case.mesh if shape == "file" else None] and not road.asked
