"""Lengths counted in cells or body sizes: a body three times as large is seen, disturbed and predicted alike, and told in metres."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from learning.config import NetworkInputs
from learning.graphs.layout import Layout, layout_of
from learning.networks.kinds import build
from learning.prediction.checkpoint import Model
from learning.prediction.rollout import predict_step, rollout, rollout_error, walk
from learning.samples.samples import build_example, describe, fit_normaliser, sample
from physics.schema import InputError, read_table
from tests.networks import SMALL, training
from tests.synthetic import bending
from tests.test_learning_layout import channel

BEAM = bending(cells=(4, 2, 2), steps=4)  # 0.1 x 0.02 x 0.02 m: 36 edges of 25 mm along it, 60 of 10 mm across it
RADIUS = {"m": 0.03, "cell": 3.0, "body": 0.3}
LARGE = replace(BEAM, points=3 * BEAM.points, displacement=3 * BEAM.displacement)


def counted(lengths, **changes):
    network = replace(SMALL["mgn"], world_radius=0.0)
    return training(network, inputs=NetworkInputs(lengths=lengths), noise=0.01, contact_radius=RADIUS[lengths], batch_size=2, **changes)


def model_of(config):
    examples = [build_example(BEAM, config)]
    normaliser = fit_normaliser(examples, config)
    torch.manual_seed(1)
    return Model(network=build(config.network, normaliser.layout.widths).eval(), normaliser=normaliser, config=config, name="run")


@pytest.mark.parametrize(("lengths", "unit"), [("m", 1.0), ("cell", 0.01), ("body", 0.1)])
def test_a_unit_is_the_median_edge_or_the_largest_extent_of_the_body(lengths, unit):
    assert BEAM.points[~BEAM.body].size  # an obstacle, whose edges and extent do not count
    layout = layout_of([BEAM], lengths=lengths)
    assert layout == Layout(lengths=lengths) and layout.unit(BEAM) == pytest.approx(unit, rel=1e-12)


@pytest.mark.parametrize("lengths", ["cell", "body"])
def test_a_larger_body_is_seen_and_disturbed_alike(lengths):
    config = counted(lengths)
    (small, target), (large, same) = (sample(build_example(each, config), 2, config, torch.Generator().manual_seed(0))
                                      for each in (BEAM, LARGE))
    for name in ("node", "mesh_edge", "contact_edge", "place"):
        assert torch.allclose(getattr(small, name), getattr(large, name), rtol=1e-5, atol=1e-6), name
    assert torch.equal(small.contact_pair, large.contact_pair)
    assert 0 < small.contact_pair.shape[1] < 2 * BEAM.body.sum() * (~BEAM.body).sum()
    assert torch.allclose(target, same, rtol=1e-5, atol=1e-6)
    edges = small.mesh_edge[:, 3]  # rest lengths
    assert edges.max() == pytest.approx({"cell": 2.5, "body": 0.25}[lengths], rel=1e-6)


def test_the_disturbance_is_in_the_same_unit():
    config = counted("cell")
    case = build_example(BEAM, config)
    shown = sample(case, 2, config, torch.Generator().manual_seed(0))[0].place[:, 3:].numpy()
    off = (shown - case.states[2])[case.skeleton.free]
    assert off.std() == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("scheme", ["step", "pose"])
@pytest.mark.parametrize("lengths", ["cell", "body"])
def test_the_prediction_of_a_larger_body_is_larger_by_as_much(lengths, scheme):
    model = model_of(counted(lengths, scheme=scheme))
    found, large = rollout(model, BEAM), rollout(model, LARGE)
    free, moved = BEAM.free, abs(found.displacement[:, BEAM.free]).max()
    assert moved > 1e-4
    assert np.allclose(large.displacement, 3 * found.displacement, rtol=0, atol=1e-4 * moved)
    assert np.array_equal(large.displacement[:, ~free], LARGE.displacement[:, ~free])  # in metres, as given
    assert np.allclose(predict_step(model, LARGE), 3 * predict_step(model, BEAM), rtol=0, atol=1e-4 * moved)
    errors = [rollout_error(model, build_example(each, model.config)) for each in (BEAM, LARGE)]
    assert errors[1] == pytest.approx(3 * errors[0], rel=1e-3)
    off = (found.displacement - BEAM.displacement)[1:, free].astype(np.float64)
    assert errors[0] == pytest.approx(np.sqrt((off**2).sum(axis=-1).mean()), rel=1e-5)


def test_an_estimate_and_a_start_are_in_metres():
    config = counted("cell", estimate=True)
    case, rng = build_example(BEAM, replace(config, estimate=False)), np.random.default_rng(0)
    estimate, answer = rng.normal(size=(2, len(BEAM.points), 3))
    known = replace(case, estimate=SimpleNamespace(at=lambda target: (estimate, answer)))
    shown = describe(known, 3, case.states[2], case.states[1], config)
    assert np.allclose(shown.base, estimate / 0.01)
    assert shown.unit == pytest.approx(100 * np.sqrt((answer[BEAM.free]**2).sum(axis=1).mean()))
    model, start = model_of(counted("cell")), 1e-3 * answer
    paths = [walk(model, build_example(each, model.config), start=factor * start) for each, factor in ((BEAM, 1), (LARGE, 3))]
    assert np.allclose(paths[1], 3 * paths[0], rtol=0, atol=1e-4 * abs(paths[0]).max())
    assert abs(paths[0] - walk(model, build_example(BEAM, model.config))).max() > 1e-4


def test_in_metres_it_is_not():
    model = model_of(counted("m"))
    assert not np.allclose(rollout(model, LARGE).displacement, 3 * rollout(model, BEAM).displacement, rtol=0, atol=1e-3)


def test_corrections_are_asked_for_and_taken_in_metres():
    model, asked = model_of(counted("cell")), []

    def correct(u, frame):
        asked.append(u)
        return np.full_like(u, 1e-3 * frame)

    found = rollout(model, BEAM, correct=correct)
    free = BEAM.free & BEAM.body
    assert np.allclose(found.displacement[:, free], 1e-3 * np.arange(5)[:, None, None], rtol=1e-6)
    assert np.allclose(asked[0][BEAM.free[BEAM.body]], rollout(model, BEAM).displacement[1, free], rtol=1e-4, atol=1e-9)


def test_other_units_and_flows_are_refused():
    with pytest.raises(InputError, match="lengths = 'feet': must be one of m, cell, body"):
        read_table(NetworkInputs, {"lengths": "feet"})
    with pytest.raises(InputError, match="lengths = cell: is of bodies, and a fluid flows here"):
        layout_of([channel()], lengths="cell")
