"""Derivatives of the end of a path: against differences of the predictor, and against differences of finite elements."""

from pathlib import Path

import numpy as np
import pytest

from learning.prediction.checkpoint import load_model
from learning.prediction.gradient import gradient
from learning.slender.beam import see
from learning.slender.path import predict
from physics import build_mesh, read_scene, solve
from physics.schema import InputError
from tests.test_learning_slender_beam import everywhere

RUN = Path(__file__).parent.parent / "assets" / "m4gn-fast"
NUMBERS = np.array([0.1, 0.0125, 0.0385, 0.1, 0.0125, 0.0245, 0.012])  # start, end, radius [m]


def pressed(numbers, shape="cylinder"):
    start, end, radius = numbers[:3].tolist(), numbers[3:6].tolist(), float(numbers[6])
    return read_scene({"body": {"length": 0.13, "width": 0.0245, "height": 0.025, "cells": [25, 5, 5]}, "support": [{"where": "x-min"}],
                       "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "steps": {"count": 24},
                       "obstacle": {"shape": shape, "radius": radius, "path": [start, end]}})


def difference(numbers, k, step, last):
    """Central difference of last(numbers) by number k."""
    way = step * np.eye(7)[k]
    return (last(numbers + way) - last(numbers - way)) / (2 * step)


@pytest.mark.parametrize("shape", ("cylinder", "sphere"))
def test_it_is_the_slope_of_what_the_predictor_says(shape):
    model, numbers = load_model(RUN), NUMBERS + [0, 3e-4, 0, 2e-4, 5e-4, 0, 0]
    points = build_mesh(pressed(numbers).body).points
    found = gradient(model, pressed(numbers, shape))
    last = lambda numbers: predict(model, pressed(numbers, shape), points).displacement[-1].astype(float)  # noqa: E731
    assert np.allclose(found.displacement, last(numbers), atol=1e-8)
    for k, slope in enumerate([*found.by_start, *found.by_end, found.by_radius]):
        expected = difference(numbers, k, 1e-5, last)
        # single precision of 1e-2 m over 2e-5 m is 1e-4; curvature the rest
        assert abs(slope - expected).max() < 2e-3 * max(1.0, abs(expected).max()), k
    assert abs(found.by_end[2]).max() > 1 and abs(found.by_start[1]).max() > 1e-3 * (shape == "sphere") - 1e-12


def test_on_any_face_and_from_either_end_it_is_along_the_axes_of_the_scene():
    for scene in everywhere():
        model, points = load_model(RUN), build_mesh(scene.body).points
        found, up = gradient(model, scene), see(scene).up
        path = np.array(scene.obstacle.path)
        for k in (0, up):
            ends = []
            for step in (1e-5, -1e-5):
                path_there = path + step * np.array([np.zeros(3), np.eye(3)[k]])
                table = scene.obstacle.__class__(**(vars(scene.obstacle) | {"path": tuple(map(tuple, path_there.tolist()))}))
                there = scene.__class__(**(vars(scene) | {"obstacle": table}))
                ends.append(predict(model, there, points).displacement[-1].astype(float))
            expected = (ends[0] - ends[1]) / 2e-5
            assert abs(found.by_end[k] - expected).max() < 5e-3 * max(1.0, abs(expected).max())


def test_it_agrees_with_differences_of_finite_elements():
    """By depth and by radius at once. Along the beam the answer ripples from row to row of the points at which contact is felt, 2.6 mm
    apart, elements and prediction alike; the mean of the slopes over two rows is the difference across them."""
    model = load_model(RUN)
    found = gradient(model, pressed(NUMBERS))
    solved = lambda numbers: solve(pressed(numbers), final=True).displacement[-1]  # noqa: E731
    places = (np.arange(8) + 0.5) / 8 * 5.2e-3 - 2.6e-3
    along = np.mean([gradient(model, pressed(NUMBERS + place * np.eye(7)[3])).by_end[0] for place in places], axis=0)
    for k, step, slope, tolerance in ((5, 5e-4, found.by_end[2], 0.02), (6, 5e-4, found.by_radius, 0.02), (3, 2.6e-3, along, 0.04)):
        truth = difference(NUMBERS, k, step, solved)
        assert np.linalg.norm(slope - truth) < tolerance * np.linalg.norm(truth), k


def test_under_a_sphere_the_end_sinks_by_depth_as_finite_elements_say():
    """A sphere goes aside and turns the section in its groove; how far the groove gives is less well known than the bending."""
    found, end = gradient(load_model(RUN), pressed(NUMBERS, "sphere")), build_mesh(pressed(NUMBERS).body).place("x-max")
    for k, slope in ((5, found.by_end[2]), (6, found.by_radius)):
        truth = difference(NUMBERS, k, 5e-4, lambda numbers: solve(pressed(numbers, "sphere"), final=True).displacement[-1])
        assert slope[end, 2].mean() == pytest.approx(truth[end, 2].mean(), rel=0.02)
        assert np.linalg.norm(slope - truth) < 0.05 * np.linalg.norm(truth)


def test_what_is_never_touched_has_no_slope():
    with pytest.raises(InputError, match="never touches"):
        gradient(load_model(RUN), pressed(NUMBERS + [0, 0, 0.01, 0, 0, 0.02, 0]))
